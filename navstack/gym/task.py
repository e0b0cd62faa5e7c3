"""What an agent sees, does and is rewarded for: spaces, robots with random variations, rewards with presets."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import ValidationError

from navstack.core import Footprint, InputError
from navstack.gym.simulation import TASK, TERMS, RobotModel
from navstack.parameters import Configuration, LidarParams, SimParams, nearest
from navstack.plugins import VelocityLimits

REWARDS: Final[Mapping[str, Mapping[str, float]]] = {
    "jaxnav": {"goal": 4.0, "collision": -4.0, "progress": 0.25, "time": -0.01, "near": -0.1},
    "ros_jackal": {"goal": 20.0, "collision": -1.0, "progress": 1.0},
    "appl": {"goal": 20.0, "progress": 1.0, "forward": 1.0},
    "crowdnav": {"goal": 1.0, "collision": -0.25, "discomfort": 0.5},
}
"""Weights of published works: JaxNav; ros_jackal's end-to-end policy; APPL; CrowdNav.

Terms: `goal` (1 when it is reached), `collision` (new ones), `progress` (m nearer to the goal), `forward` (m along y of the map),
`time` (1 per step), `near` (1 if a range is at most 0.1 m over the circumscribed radius), `discomfort` (clearance - 0.2 m, times
the period, where that is negative), `turning` (rad), `change` (sum of the changes of the action).
"""
DISCRETE: Final = [(v, w) for v in (0.0, 0.5, 1.0) for w in (-1.0, -0.5, 0.0, 0.5, 1.0)]
"""The 15 discrete actions, as shares of the highest speed and of the highest turning speed."""
NEAR_M: Final = 0.1
COMFORT_M: Final = 0.2
SPACING_M: Final = 0.5
PLAN_RANGE_M: Final = 5.0


def refuse_unknown(unknown: Mapping[str, Any], *makers: Any) -> None:
    """Raise InputError if there are `unknown` arguments; `makers`: the functions whose keywords an environment takes."""
    known = [
        name
        for maker in makers
        for name, parameter in inspect.signature(maker).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    ]
    for name in unknown:
        close = nearest(name, known)
        hint = f'did you mean "{close}"?' if close else f"arguments: {', '.join(sorted(set(known)))}"
        raise InputError(f'unknown argument "{name}" of the environment; {hint}', argument=name)


BUSY: Final = (
    "another thread steps or resets this environment at this moment; give each thread an environment of its own"
)


def check_positive(name: str, value: Any) -> None:
    """Raise InputError if an argument is not a finite number above 0."""
    if not (isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value) and value > 0.0):
        raise InputError(f"{name} is {value}; it must be a number above 0", argument=name, value=str(value))


def check_points(name: str, value: Any) -> None:
    """Raise InputError if an argument is not a number of points."""
    if not (isinstance(value, (int, np.integer)) and value >= 0):
        raise InputError(
            f"{name} is {value}; it must be a number of points, 0 or more", argument=name, value=str(value)
        )


def check_reset_options(options: object, known: Sequence[str]) -> None:
    """Raise InputError for options of `reset` that are no dictionary, and for one that is not among the known ones."""
    if not isinstance(options, Mapping):
        raise InputError(f"the options of reset are {options!r}; give a dictionary with {', '.join(known)}")
    for name in options:
        if name not in known:
            raise InputError(f'unknown option "{name}" of reset; options: {", ".join(known)}', option=str(name))


def reward_weights(reward: str | Mapping[str, float]) -> dict[str, float]:
    """Return the weights of a preset, or of terms by name; a key `preset` is the start that others change.

    Raises InputError for unknown presets and terms, and weights that are not finite.
    """
    terms: dict[str, Any] = {"preset": reward} if isinstance(reward, str) else dict(reward)
    preset = terms.pop("preset", None)
    if preset is not None and preset not in REWARDS:
        close = nearest(str(preset), list(REWARDS))
        hint = f'did you mean "{close}"?' if close else f"presets: {', '.join(REWARDS)}"
        raise InputError(f'unknown reward "{preset}"; {hint}', reward=str(preset))
    for name, weight in terms.items():
        if name not in TERMS:
            close = nearest(name, list(TERMS))
            hint = f'did you mean "{close}"?' if close else f"terms: {', '.join(TERMS)}"
            raise InputError(f'unknown reward term "{name}"; {hint}', term=name)
        if not isinstance(weight, (int, float)) or not math.isfinite(weight):
            raise InputError(f"the weight of the reward term {name} is {weight!r}; give a finite number", term=name)
    return {**(REWARDS[preset] if preset is not None else {}), **{k: float(v) for k, v in terms.items()}}


@dataclass(frozen=True, slots=True)
class ActionScale:
    """From actions in [-1, 1] to velocities."""

    low: NDArray[np.float64]
    """(3,) vx, vy, wz of the action -1 (m/s, rad/s)."""
    high: NDArray[np.float64]
    """(3,) those of the action 1."""
    holonomic: bool
    discrete: bool

    @classmethod
    def of(cls, limits: VelocityLimits, *, holonomic: bool, discrete: bool) -> ActionScale:
        """Return the scale of velocity limits; a least speed above zero counts as zero, so that the robot can stop."""
        y, w = (limits.max_vel_y if holonomic else 0.0), limits.max_vel_theta
        low = np.array([min(limits.min_vel_x, 0.0), -y, -w])
        return cls(low, np.array([limits.max_vel_x, y, w]), holonomic, discrete)

    @property
    def size(self) -> int:
        """Numbers of an action: forward (and sideways) and turning."""
        return 3 if self.holonomic else 2

    @property
    def space(self) -> spaces.Box | spaces.Discrete[Any]:
        """The action space."""
        if self.discrete:
            return spaces.Discrete(len(DISCRETE))
        return spaces.Box(-1.0, 1.0, (self.size,), np.float32)

    def read(self, actions: Any, number: int) -> NDArray[np.float64]:
        """Return the actions (n, size) as numbers in [-1, 1]. Raises InputError for any other."""
        if self.discrete:
            return self._read_discrete(actions, number)
        try:
            values = np.asarray(actions, np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.size != number * self.size:
            raise InputError(
                f"an action of the shape {np.shape(actions)} was given; give ({self.size},) numbers in [-1, 1] per environment",
                shape=list(np.shape(actions)),
            )
        values = np.ascontiguousarray(values.reshape(number, self.size))
        # a little more than 1: a policy's float32 may round up
        if not np.abs(values).max() <= 1.0 + 1e-6:
            bad = values[~(np.abs(values) <= 1.0 + 1e-6).all(axis=1)][0].tolist()
            problem = "is not finite" if not np.isfinite(bad).all() else "is outside [-1, 1]"
            raise InputError(
                f"the action {[round(v, 4) for v in bad]} {problem}; clip or squash what the policy gives", action=bad
            )
        return values

    def _read_discrete(self, actions: Any, number: int) -> NDArray[np.float64]:
        chosen = np.asarray(actions)
        if chosen.size != number or not np.issubdtype(chosen.dtype, np.integer):
            raise InputError(
                f"the action {actions!r} is not one of the numbers 0 .. {len(DISCRETE) - 1}", action=str(actions)
            )
        chosen = chosen.reshape(number)
        if ((chosen < 0) | (chosen >= len(DISCRETE))).any():
            bad = int(chosen[(chosen < 0) | (chosen >= len(DISCRETE))][0])
            raise InputError(f"the action {bad} is not one of the numbers 0 .. {len(DISCRETE) - 1}", action=bad)
        # as shares of the range, which may reach below zero
        table = np.zeros((len(DISCRETE), self.size))
        top, bottom = self.high[0], self.low[0]
        for row, (v, w) in zip(table, DISCRETE, strict=True):
            row[0], row[-1] = 2.0 * (v * top - bottom) / (top - bottom) - 1.0, w
        return table[chosen]


def limits_of(configuration: Configuration) -> VelocityLimits:
    """Return the velocity limits of the robot's local planner."""
    choice = configuration.local_planner
    return choice.cls(choice.params).limits


@dataclass(frozen=True, slots=True)
class Observation:
    """The layout of an observation: names, sizes and bounds, in the order of a flat one."""

    parts: Mapping[str, tuple[slice, tuple[int, ...], float]]
    """Name -> place in the flat observation, shape, lowest value (the highest is 1)."""
    size: int
    flat: bool

    @classmethod
    def of(cls, beams: int, plan: int, action: int, *, flat: bool) -> Observation:
        """Return the layout; `plan`: points of the plan, `action`: numbers of the last action that is repeated; 0: none."""
        parts: dict[str, tuple[slice, tuple[int, ...], float]] = {}
        at = 0
        for name, shape, low in (
            ("scan", (beams,), 0.0),
            ("goal", (3,), -1.0),
            ("velocity", (3,), -1.0),
            ("plan", (plan, 2), -1.0),
            ("last_action", (action,), -1.0),
        ):
            size = math.prod(shape)
            if size:
                parts[name] = slice(at, at + size), shape, low
                at += size
        return cls(parts, at, flat)

    @property
    def space(self) -> spaces.Box | spaces.Dict:
        """The observation space."""
        if self.flat:
            low = np.concatenate([np.full(math.prod(shape), low) for _, shape, low in self.parts.values()])
            return spaces.Box(low.astype(np.float32), np.float32(1.0), (self.size,), np.float32)
        return spaces.Dict(
            {name: spaces.Box(low, 1.0, shape, np.float32) for name, (_, shape, low) in self.parts.items()}
        )

    def of_row(self, row: NDArray[np.float32]) -> NDArray[np.float32] | dict[str, NDArray[np.float32]]:
        """Return the observation of a flat one, which is kept."""
        if self.flat:
            return row
        return {n: row[at] if len(shape) == 1 else row[at].reshape(shape) for n, (at, shape, _) in self.parts.items()}

    def of_rows(self, rows: NDArray[np.float32]) -> NDArray[np.float32] | dict[str, NDArray[np.float32]]:
        """Return the observations (n, ..) of flat ones (n, size), which are kept."""
        if self.flat:
            return rows
        return {name: rows[:, at].reshape(len(rows), *shape) for name, (at, shape, _) in self.parts.items()}


def make_task(
    *,
    period: float,
    frequency: float,
    collision: Literal["end", "stop"],
    clip: float,
    reach: float,
    plan: int,
    scale: ActionScale,
    weights: Mapping[str, float],
    same_step: bool,
    repeats_action: bool,
) -> NDArray[np.void]:
    """Return the settings of the kernel, (1,) of type `TASK`. Raises InputError."""
    if collision not in ("end", "stop"):
        raise InputError(f'collision is "{collision}"; it must be "end" or "stop"', collision=collision)
    for name, value in (("period", period), ("scan_clip", clip), ("goal_range", reach)):
        check_positive(name, value)
    check_points("plan", plan)
    steps = round(period * frequency)
    if steps < 1 or abs(steps - period * frequency) > 1e-6:
        raise InputError(
            f"a period of {period:g} s is no whole number of physics steps of {1.0 / frequency:g} s; use a multiple",
            period=period,
        )
    task = np.zeros(1, TASK)
    values: dict[str, Any] = {
        "physics_steps": steps,
        "period": steps / frequency,
        "frequency": frequency,
        "ends_at_collision": collision == "end",
        "same_step": same_step,
        "clip": clip,
        "reach": reach,
        "low": scale.low,
        "high": scale.high,
        "repeats_action": repeats_action,
        "plan_points": plan,
        "plan_spacing": SPACING_M,
        "plan_range": PLAN_RANGE_M,
        "max_velocity": np.maximum(np.abs(scale.low), np.abs(scale.high)),
        "near": NEAR_M,
        "comfort": COMFORT_M,
        "weights": [weights.get(name, 0.0) for name in TERMS],
    }
    for name, value in values.items():
        task[name] = value
    return task


# --- robots -----------------------------------------------------------------------------------------------------------

Variation = tuple[float, float] | Sequence[float]
FOOTPRINT_SCALE: Final = "footprint_scale"
FIXED: Final = ("physics_frequency", "kinematics", "beams")
"""Parameters that the robots of one environment share."""


def robot_models(
    configuration: Configuration, randomize: Mapping[str, Variation], count: int, seed: int, beams: int | None
) -> list[RobotModel]:
    """Return robots with random parameters, `count` of them; one without variations.

    Args:
        configuration: whose section `navstack: sim:` and footprint describe the robot.
        randomize: parameter of `navstack: sim:` (`velocity_lag`, `laser/range_noise`, ..) or `footprint_scale` -> (lowest,
            highest), drawn uniformly, or a list of three or more values.
        count: number of robots, from which each episode draws one.
        seed: of the draws.
        beams: beams of the lidar, if not those of the parameters.

    Raises InputError for unknown parameters, bounds that are not numbers, and values that a parameter cannot have.
    """
    sim = configuration.navstack.sim
    if not sim.lasers:
        raise InputError("the robot has no lidar; list one in navstack/sim/lasers", lasers=[])
    name = sim.lasers[0]
    lidar = sim.lidar(name)
    if beams is not None:
        lidar = _changed(lidar, {"beams": beams})
    footprint = configuration.local_costmap.true_footprint
    believed = "odometry" if sim.localization == "odometry" else "truth"
    if count < 1:
        raise InputError(f"variants is {count}; it must be at least 1", variants=count)
    if not randomize:
        return [RobotModel(sim, footprint, lidar, believed)]
    for key, bounds in randomize.items():
        _check_variation(key, bounds, name)
    rng = np.random.Generator(np.random.PCG64([seed, 42]))
    models: list[RobotModel] = []
    for _ in range(count):
        drawn = {key: _draw(rng, bounds) for key, bounds in randomize.items()}
        scaled = drawn.pop(FOOTPRINT_SCALE, 1.0)
        of_lidar = {key.partition("/")[2]: v for key, v in drawn.items() if key.startswith(f"{name}/")}
        of_body = {key: v for key, v in drawn.items() if not key.startswith(f"{name}/")}
        body = footprint if scaled == 1.0 else _scaled(footprint, scaled)
        models.append(RobotModel(_changed(sim, of_body), body, _changed(lidar, of_lidar), believed))
    return models


def _check_variation(key: str, bounds: Variation, lidar: str) -> None:
    numeric: tuple[Any, ...] = (float, float | None)
    known = [FOOTPRINT_SCALE, *(n for n, f in SimParams.model_fields.items() if f.annotation in numeric)]
    known += [f"{lidar}/{n}" for n, f in LidarParams.model_fields.items() if f.annotation is float]
    known = [name for name in known if name.rpartition("/")[2] not in FIXED]
    if key not in known:
        close = nearest(key, known)
        hint = f'did you mean "{close}"?' if close else f"known: {', '.join(known)}"
        raise InputError(f'randomize: "{key}" is no parameter of navstack/sim that can vary; {hint}', parameter=key)
    numbers: list[Any] = list(bounds) if isinstance(bounds, (tuple, list)) else []
    if len(numbers) < 2 or not all(isinstance(v, (int, float)) and math.isfinite(v) for v in numbers):
        raise InputError(f"randomize: {key} is {bounds!r}; give (lowest, highest), or a list of values", parameter=key)


def _draw(rng: np.random.Generator, bounds: Variation) -> float:
    if len(bounds) == 2:
        return float(rng.uniform(bounds[0], bounds[1]))
    return float(bounds[int(rng.integers(len(bounds)))])


def _scaled(footprint: Footprint, factor: float) -> Footprint:
    if footprint.is_round:
        return Footprint.from_radius(factor * footprint.circumscribed_radius)
    return Footprint(factor * footprint.vertices)


def _changed(params: Any, values: Mapping[str, Any]) -> Any:
    """Return parameters with other values, which are checked."""
    if not values:
        return params
    model = type(params)
    try:
        return model.model_validate({**{n: getattr(params, n) for n in model.model_fields}, **values})
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        where = "/".join(map(str, error["loc"])) or next(iter(values))
        raise InputError(f"{where} is {values.get(where, '')}: {error['msg']}", parameter=where) from None
