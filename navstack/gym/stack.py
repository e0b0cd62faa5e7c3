"""`navstack/PlannerParams-v0` and `navstack/Residual-v0`: an agent beside the whole stack, which plans and drives as always."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Literal, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from navstack.bringup import reconfigure
from navstack.core import InputError, NavError, Path, Pose2D, Twist2D
from navstack.gym.levels import Level, Levels, level_number, level_weights, read_levels
from navstack.gym.render import DrawnRobot, LevelPicture
from navstack.gym.task import (
    BUSY,
    COMFORT_M,
    NEAR_M,
    check_positive,
    check_reset_options,
    refuse_unknown,
    reward_weights,
)
from navstack.gym.watch import RENDER_MODES, Watch, check_render_mode
from navstack.parameters import Configuration, LidarParams, Source, load_configuration
from navstack.plugins import ControlDiagnostics, ControlInput, LocalPlan, LocalPlanner, VelocityLimits
from navstack.scenario import START_RADIUS_M, Run, Scenario, barn_score
from navstack.sim import Lidar
from navstack.studies import parse_search_space

T = TypeVar("T")

MAX_CYCLES: int = 100_000
"""Cycles of the stack per step, at most: a run that does not go on is an error."""


class StackEnv(gymnasium.Env[Any, Any], ABC):
    """A scenario driven by the whole stack, in steps."""

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
    }

    def __init__(
        self,
        *,
        levels: Levels | Sequence[Levels] = "office",
        split: str = "train",
        count: int | None = None,
        level_seed: int = 0,
        robot: Source | Sequence[Source] = "turtlebot",
        overrides: Sequence[str] = (),
        collision: Literal["end", "stop"] = "end",
        reward: str | Mapping[str, float] = "ros_jackal",
        scan_clip: float = 5.0,
        goal_range: float = 10.0,
        beams: int | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        port: int = 0,
        **unknown: Any,
    ) -> None:
        refuse_unknown(unknown, StackEnv.__init__, type(self).__init__)
        check_render_mode(render_mode, port)
        if collision not in ("end", "stop"):
            raise InputError(f'collision is "{collision}"; it must be "end" or "stop"', collision=collision)
        if max_episode_steps is not None and max_episode_steps < 1:
            raise InputError(f"max_episode_steps is {max_episode_steps}; it must be at least 1")
        check_positive("scan_clip", scan_clip)
        check_positive("goal_range", goal_range)
        self.render_mode = render_mode
        single = isinstance(robot, (str, Mapping)) or not isinstance(robot, Sequence)
        self._sources: list[Source] = [robot] if single else list(robot)  # pyright: ignore[reportArgumentType, reportAttributeAccessIssue]
        self._overrides = list(overrides)
        configuration = load_configuration(self._sources, overrides=self._overrides)
        self._levels = read_levels(
            levels,
            split=split,
            count=count,
            seed=level_seed,
            radius=configuration.local_costmap.true_footprint.inscribed_radius,
        )
        if any(level.spec is None for level in self._levels):
            raise InputError("the whole stack drives scenarios; give scenarios, suites, maps or BARN worlds as levels")
        self._scenarios: dict[int, Scenario] = {}
        self._weights = np.ones(len(self._levels))
        self._reward = reward_weights(reward)
        self._ends_at_collision = collision == "end"
        self._limit = max_episode_steps
        self._clip, self._reach = scan_clip, goal_range
        sim = self._scenario(0).configuration.navstack.sim
        if not sim.lasers:
            raise InputError("the robot has no lidar; list one in navstack/sim/lasers", lasers=[])
        lidar = sim.lidar(sim.lasers[0])
        self._lidar_params = LidarParams.model_validate(
            {**lidar.model_dump(), "message": "LaserScan", "beams": beams or lidar.beams}
        )
        self._shown: dict[str, spaces.Space[Any]] = {
            "scan": spaces.Box(0.0, 1.0, (self._lidar_params.beams,), np.float32),
            "goal": spaces.Box(-1.0, 1.0, (3,), np.float32),
            "velocity": spaces.Box(-1.0, 1.0, (3,), np.float32),
        }
        self._run: Run | None = None
        self._level = self._levels[0]
        self._picture: LevelPicture | None = None
        self._watch = Watch(port, self._shown_run) if render_mode == "live" else None
        self._needs_reset = True
        self._is_closed = self._busy = False
        self._moved_at: float | None = None
        """Time at which the robot was `START_RADIUS_M` from its start (s)."""

    # --- to be supplied -----------------------------------------------------------------------------------------------

    def _begin(self, run: Run) -> None:
        """Prepare a new run."""

    @abstractmethod
    def _apply(self, action: NDArray[np.float64]) -> None:
        """Do what an action says."""

    @abstractmethod
    def _advance(self, run: Run) -> bool:
        """Drive for a step; return False if the run is over."""

    @abstractmethod
    def _own_observation(self) -> dict[str, NDArray[np.float32]]:
        """Return what this environment shows beside scan, goal and velocity."""

    # --- Gymnasium ----------------------------------------------------------------------------------------------------

    @property
    def levels(self) -> list[str]:
        """Names of the levels."""
        return [level.name for level in self._levels]

    def set_level_weights(self, weights: Sequence[float]) -> None:
        """Set how often each level is drawn from now on, in proportion (one weight per level)."""
        self._weights = level_weights(weights, len(self._levels))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode; `options={"level": NAME or NUMBER}` chooses its level."""
        reset = partial(self._reset, seed, options)
        return self._alone(reset if self._watch is None else partial(self._watch.reset, reset))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do what the action says, and let the stack drive."""
        step = partial(self._step, action)
        return self._alone(step if self._watch is None else partial(self._watch.step, step))

    def _alone(self, action: Callable[[], T]) -> T:
        """Call a function. Raises InputError while another thread does."""
        if self._busy:
            raise InputError(BUSY)
        self._busy = True
        try:
            return action()
        finally:
            self._busy = False

    def _reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._check_open()
        drawn = float(self.np_random.random()) * float(self._weights.sum())
        index = min(int(np.searchsorted(np.cumsum(self._weights), drawn, side="right")), len(self._levels) - 1)
        options = {} if options is None else options
        check_reset_options(options, ("level",))
        wanted = options.get("level")
        index = index if wanted is None else level_number(wanted, self.levels)
        self._level = self._levels[index]
        scenario = replace(self._scenario(index), seed=int(self.np_random.integers(1 << 31)))
        self._run = run = Run(scenario, record=False, scans=False, measure=False)
        self._lidar = Lidar(self._lidar_params, seed=scenario.seed, number=0)
        self._steps = self._scans = 0
        self._nearest, self._moved_at = math.inf, None
        self._collisions = 0
        if self._picture is not None:
            self._picture.begin_episode()
        self._seed = scenario.seed
        self._needs_reset = False
        configuration = scenario.configuration
        choice = configuration.local_planner
        limits = choice.cls(choice.params).limits
        self._scales = np.array(
            [max(abs(limits.max_vel_x), abs(limits.min_vel_x)), abs(limits.max_vel_y), limits.max_vel_theta]
        )
        self._begin(run)
        observation, _ = self._observe()
        return observation, self._report()

    def _step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._check_open()
        run = self._run
        if self._needs_reset or run is None:
            raise InputError("the episode has ended or not begun; call reset() before step()")
        try:
            values = np.asarray(action, np.float64)
        except (TypeError, ValueError):
            values = np.full(self.action_space.shape or 1, math.nan)
        if values.shape != self.action_space.shape or not (np.abs(values) <= 1.0 + 1e-6).all():
            shown = action if values.size < 20 else f"of the shape {values.shape}"
            raise InputError(
                f"the action {shown} is not {self.action_space.shape} finite numbers in [-1, 1]; clip what the policy gives"
            )
        before, robot = run.robot.pose, run.robot
        self._apply(np.clip(values, -1.0, 1.0))
        running = self._advance(run)
        self._steps += 1
        hits = len(robot.collisions) - self._collisions
        self._collisions += hits
        goal, pose = self._level.goal, robot.pose
        away = pose.distance_to(goal)
        done = run.outcomes[-1].state if run.outcomes else ""
        outcome = ""
        if hits and self._ends_at_collision:
            outcome = "collision"
        elif done == "SUCCEEDED" or away <= self._level.tolerance:
            outcome = "goal"
        elif robot.time >= self._level.time_limit or self._steps == self._limit:
            outcome = "timeout"
        elif not running or done:
            outcome = "aborted"
        observation, lowest = self._observe()
        terms = self._terms(outcome == "goal", hits, before, lowest)
        info = {**self._report(), "reward_terms": terms}
        self._needs_reset = bool(outcome)
        if outcome:
            info |= self._end(outcome)
        terminated = outcome in ("goal", "collision", "aborted")
        return observation, math.fsum(terms.values()), terminated, outcome == "timeout", info

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a picture (height, width, 3) of the world, the robot and its way with `rgb_array`, else None."""
        if self.render_mode != "rgb_array":
            return None
        self._check_open()
        if self._run is None:
            raise InputError("there is nothing to draw yet; call reset() before render()")
        if self._picture is None:
            self._picture = LevelPicture()
        p, robot = self._lidar_params, self._run.robot
        angles = p.angle_min + p.angle_increment * np.arange(p.beams)
        pose = robot.pose.x, robot.pose.y, robot.pose.yaw
        beams, mounted = np.column_stack((np.cos(angles), np.sin(angles))), np.array([p.x, p.y, p.yaw])
        return self._picture.draw(
            [self._level], [DrawnRobot.of(robot.footprint, pose, mounted, beams, self._seen, self._clip)]
        )

    def close(self) -> None:
        """Close the environment; a second time does nothing."""
        if self._watch is not None:
            self._watch.close()
        self._is_closed, self._run = True, None
        if self._picture is not None:
            self._picture.close()
            self._picture = None

    def _cycle(self, run: Run) -> bool:
        """Run a cycle of the stack; return False if the run is over."""
        goes_on = run.step()
        if self._moved_at is None and run.robot.pose.distance_to(self._level.start) >= START_RADIUS_M:
            self._moved_at = run.robot.time
        if self._watch is not None:
            self._watch.seen()
        return goes_on

    def _shown_run(self) -> tuple[Scenario, Run]:
        """Return the episode as pages show it."""
        assert self._run is not None
        return self._run.scenario, self._run

    # --- parts --------------------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if self._is_closed:
            raise InputError("the environment is closed; make a new one")

    def _scenario(self, index: int) -> Scenario:
        """Return the scenario of a level with the robot's parameters; its goal is that of the level."""
        if index not in self._scenarios:
            level: Level = self._levels[index]
            assert level.spec is not None
            built = level.spec.build(params=self._sources, overrides=self._overrides, goals=[level.goal])
            self._scenarios[index] = built
        return self._scenarios[index]

    def _observe(self) -> tuple[dict[str, NDArray[np.float32]], float]:
        """Return the observation and the lowest range (m)."""
        run = self._run
        assert run is not None
        robot = run.robot
        scan: Any = self._lidar.scan(robot.world, robot.pose, self._scans, robot.time, robot.solids)
        self._scans += 1
        ranges = np.where(np.isnan(scan.ranges), np.float32(np.inf), np.maximum(scan.ranges, np.float32(0.0)))
        self._seen = (np.minimum(ranges, np.float32(self._clip)) / np.float32(self._clip)).astype(np.float32)
        believed = robot.frames.lookup(robot.map_frame, robot.base_frame, robot.time)
        goal = self._level.goal
        bearing = math.atan2(goal.y - believed.y, goal.x - believed.x) - believed.yaw
        away = min(math.hypot(goal.x - believed.x, goal.y - believed.y), self._reach) / self._reach
        velocity = np.array(robot.state().velocity)
        scaled = np.divide(velocity, self._scales, out=np.zeros(3), where=self._scales > 0.0)
        observation = {
            "scan": self._seen.copy(),
            "goal": np.array([away, math.cos(bearing), math.sin(bearing)], np.float32),
            "velocity": np.clip(scaled, -1.0, 1.0).astype(np.float32),
            **self._own_observation(),
        }
        return observation, float(ranges.min())

    def _terms(self, reached: bool, hits: int, before: Pose2D, lowest: float) -> dict[str, float]:
        """Return the weighted terms of the reward, as the kernel of `LocalControl` computes them."""
        run = self._run
        assert run is not None
        pose, goal = run.robot.pose, self._level.goal
        passed = run.robot.time - self._time
        self._time = run.robot.time
        clear = self._clear
        terms = {
            "goal": float(reached),
            "collision": float(hits),
            "progress": before.distance_to(goal) - pose.distance_to(goal),
            "forward": pose.y - before.y,
            "time": 1.0,
            "near": float(lowest <= run.robot.footprint.circumscribed_radius + NEAR_M),
            "discomfort": min(clear - COMFORT_M, 0.0) * passed,
            "turning": abs(run.robot.state().velocity.wz) * passed,
            "change": self._change,
        }
        return {name: weight * terms[name] + 0.0 for name, weight in self._reward.items()}

    _time = 0.0
    _change = 0.0
    """Sum of the changes of the action in the last step."""

    def _report(self) -> dict[str, Any]:
        run = self._run
        assert run is not None
        robot = run.robot
        self._clear = robot.clearance
        self._nearest = min(self._nearest, self._clear)
        if self._steps == 0:
            self._time = robot.time
        return {
            "time": robot.time,
            "pose": np.array(robot.pose),
            "collisions": len(robot.collisions),
            "clearance": self._clear,
        }

    def _end(self, outcome: str) -> dict[str, Any]:
        run = self._run
        assert run is not None
        reached, taken, driven = outcome == "goal", run.robot.time, run.robot.distance_travelled
        shortest = self._level.length
        return {
            "is_success": reached,
            "outcome": outcome,
            "path_length": driven,
            "time_to_goal": taken if reached else math.nan,
            "spl": shortest / max(shortest, driven) if reached and driven > 0.0 else float(reached),
            "min_clearance": self._nearest,
            "barn_score": barn_score(shortest, taken - (self._moved_at or 0.0)) if reached else 0.0,
            "scenario": self._level.name,
            "seed": self._seed,
        }


class PlannerParamsEnv(StackEnv):
    """An agent changes parameters of the running stack, as in APPL: one step is a second of driving with them.

    Xiao, Liu, Warnell, Stone et al., "APPL: Adaptive Planner Parameter Learning", RAS 2022.
    """

    def __init__(
        self,
        *,
        parameters: Sequence[str] = (),
        period: float = 1.0,
        collision: Literal["end", "stop"] = "stop",
        reward: str | Mapping[str, float] = "appl",
        max_episode_steps: int | None = 100,
        **options: Any,
    ) -> None:
        """Make the environment; `options` are those of `StackEnv`, as of `LocalControlEnv`.

        `parameters`: `NAME=LOW:HIGH` or `NAME`, as the option `--param` of `navstack tune`; default: its ranges of the local
        planner. An action in [-1, 1] is a share of the range. `period` (s): of a step.

        Raises NavError for invalid arguments, parameters that do not exist and ranges that they cannot have.
        """
        super().__init__(collision=collision, reward=reward, max_episode_steps=max_episode_steps, **options)
        check_positive("period", period)
        _check_texts(parameters)
        self._period = period
        self._space = parse_search_space(
            self._scenario(0).configuration, space=None if parameters else "local_planner", params=parameters
        )
        self._dimensions = tuple(self._space)
        present = self._space.present()
        self._initial = np.array([_share(d, present[d.name]) for d in self._dimensions])
        size = len(self._dimensions)
        self.action_space = spaces.Box(-1.0, 1.0, (size,), np.float32)
        self.observation_space = spaces.Dict({**self._shown, "parameters": spaces.Box(-1.0, 1.0, (size,), np.float32)})

    @property
    def parameter_names(self) -> list[str]:
        """Names of the parameters, in the order of the action."""
        return [d.name for d in self._dimensions]

    def values_of(self, action: Any) -> dict[str, Any]:
        """Return the parameters that an action sets, by full name."""
        shares = 0.5 * (np.asarray(action, np.float64) + 1.0)
        candidate = {d.name: d.at(min(max(float(s), 0.0), 1.0)) for d, s in zip(self._dimensions, shares, strict=True)}
        return self._space.settings(candidate)

    def _begin(self, run: Run) -> None:
        self._in_force = self._initial.copy()
        self._configuration = run.scenario.configuration

    def _apply(self, action: NDArray[np.float64]) -> None:
        self._change = float(np.abs(action - self._in_force).sum())
        self._in_force = action.copy()
        run = self._run
        assert run is not None
        after = with_parameters(self._configuration, self.values_of(action))
        reconfigure(run.move_base, after)
        self._configuration = run.interventions.configuration = after

    def _advance(self, run: Run) -> bool:
        until = run.robot.time + self._period - 1e-9
        for _ in range(MAX_CYCLES):
            if not self._cycle(run):
                return False
            if run.robot.time >= until or (self._ends_at_collision and len(run.robot.collisions) > self._collisions):
                return True
            if run.robot.pose.distance_to(self._level.goal) <= self._level.tolerance:
                return True
        raise NavError(f"the stack does not advance beyond {run.robot.time:.3f} s", time=run.robot.time)

    def _own_observation(self) -> dict[str, NDArray[np.float32]]:
        return {"parameters": self._in_force.astype(np.float32)}


def _check_texts(parameters: Any) -> None:
    if isinstance(parameters, str) or not all(isinstance(text, str) for text in parameters):
        raise InputError(f'parameters is {parameters!r}; give a list such as ["DWAPlannerROS/max_vel_x=0.2:0.5"]')


def _share(dimension: Any, value: Any) -> float:
    """Return the action in [-1, 1] whose value is nearest to this one."""
    shares = np.linspace(0.0, 1.0, 201)
    if dimension.kind == "choice":
        return 2.0 * (dimension.choices.index(value) + 0.5) / len(dimension.choices) - 1.0
    errors = [abs(float(dimension.at(float(s))) - float(value)) for s in shares]
    return float(2.0 * shares[int(np.argmin(errors))] - 1.0)


def with_parameters(configuration: Configuration, values: Mapping[str, Any]) -> Configuration:
    """Return a configuration with other values of parameters, by full name.

    Parameters of the local planner and of layers are replaced in place, in microseconds; the values must be valid. Others
    are loaded again.
    """
    found = configuration
    others: list[str] = []
    planner = found.local_planner
    own: dict[str, Any] = {}
    for name, value in values.items():
        space, _, key = name.rpartition("/")
        if space == planner.namespace and key in type(planner.params).model_fields:
            own[key] = value
            continue
        changed = _with_layer_value(found, space, key, value)
        if changed is None:
            others.append(f"{name}={value}")
        else:
            found = changed
    if own:
        found = replace(found, local_planner=replace(planner, params=planner.params.model_copy(update=own)))
    if not others:
        return found
    loaded = load_configuration(
        [configuration.tree.as_dict()], overrides=others, distro=configuration.navstack.ros_distro
    )
    if len(others) == len(values):
        return loaded
    known = {name: value for name, value in values.items() if not any(text.startswith(f"{name}=") for text in others)}
    return with_parameters(loaded, known)


def _with_layer_value(configuration: Configuration, space: str, key: str, value: Any) -> Configuration | None:
    for which in ("global_costmap", "local_costmap"):
        costmap = getattr(configuration, which)
        for number, layer in enumerate(costmap.layers):
            if layer.namespace == space and key in type(layer.params).model_fields:
                layers = list(costmap.layers)
                layers[number] = replace(layer, params=layer.params.model_copy(update={key: value}))
                return replace(configuration, **{which: replace(costmap, layers=tuple(layers))})
    return None


class ResidualEnv(StackEnv):
    """An agent corrects the commands of the controller; velocity smoother and collision monitor come after it.

    One step is one control period. The observation `base_command` is the controller's last command, without the correction.
    """

    def __init__(self, *, share: float = 0.3, **options: Any) -> None:
        """Make the environment; `options` are those of `StackEnv`, as of `LocalControlEnv`.

        `share`: the action 1 adds this share of the highest speed. Raises NavError for invalid arguments.
        """
        super().__init__(**options)
        if not (math.isfinite(share) and 0.0 < share <= 1.0):
            raise InputError(f"share is {share:g}; it must be above 0 and at most 1", share=share)
        self._share = share
        holonomic = self._scenario(0).configuration.navstack.sim.kinematics == "holonomic"
        self._axes = [0, 1, 2] if holonomic else [0, 2]
        self.action_space = spaces.Box(-1.0, 1.0, (len(self._axes),), np.float32)
        self.observation_space = spaces.Dict({**self._shown, "base_command": spaces.Box(-1.0, 1.0, (3,), np.float32)})

    def _begin(self, run: Run) -> None:
        self._planner = CorrectedPlanner(run.move_base.local_planner)
        run.move_base.reconfigure(run.scenario.configuration.move_base, local_planner=self._planner)
        self._last = np.zeros(len(self._axes))
        self._catch_up(run)

    def _apply(self, action: NDArray[np.float64]) -> None:
        self._change = float(np.abs(action - self._last).sum())
        self._last = action.copy()
        offset = np.zeros(3)
        offset[self._axes] = action
        self._planner.offset = self._share * offset * self._scales

    def _advance(self, run: Run) -> bool:
        commands, until = self._planner.commands, run.robot.time + 1.0
        for _ in range(MAX_CYCLES):
            if not self._cycle(run):
                return False
            # without a command (the robot plans, or recovers) a step is a second
            if self._planner.commands > commands or run.robot.time >= until:
                return self._catch_up(run)
        raise NavError(f"the stack does not advance beyond {run.robot.time:.3f} s", time=run.robot.time)

    @staticmethod
    def _catch_up(run: Run) -> bool:
        """Let the robot drive until the next cycle: the observation is what that cycle starts from."""
        if not run.done:
            run.robot.advance_to(run.move_base.next_due(run.robot.time))
        return True

    def _own_observation(self) -> dict[str, NDArray[np.float32]]:
        base = np.array(self._planner.base)
        scaled = np.divide(base, self._scales, out=np.zeros(3), where=self._scales > 0.0)
        return {"base_command": np.clip(scaled, -1.0, 1.0).astype(np.float32)}


class CorrectedPlanner(LocalPlanner[Any]):
    """A local planner whose commands are corrected by an offset, within its limits."""

    def __init__(self, planner: LocalPlanner[Any]) -> None:
        super().__init__(planner.params)
        self._planner = planner
        self.offset = np.zeros(3)
        """(3,) vx, vy, wz (m/s, rad/s)."""
        self.base = Twist2D()
        """The last command without the correction."""
        self.commands = 0
        """Number of commands so far."""

    @property
    def limits(self) -> VelocityLimits:
        """Those of the planner."""
        return self._planner.limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Those of the planner."""
        self._planner.set_limits(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)

    def reset(self) -> None:
        """Reset the planner."""
        self._planner.reset()

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow this plan."""
        self._planner.set_plan(plan, goal)

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Return the planner's command with the correction; a robot that has arrived stands still."""
        self.commands += 1
        self.base = Twist2D()
        plan = self._planner.compute_command(inputs)
        self.base = plan.command
        if plan.mode == "arrived":
            return plan
        limits, wanted = self._planner.limits, np.array(plan.command) + self.offset
        vx = min(max(float(wanted[0]), min(limits.min_vel_x, 0.0)), limits.max_vel_x)
        vy = min(max(float(wanted[1]), min(limits.min_vel_y, 0.0)), max(limits.max_vel_y, 0.0))
        speed = math.hypot(vx, vy)
        share = limits.max_vel_trans / speed if speed > limits.max_vel_trans else 1.0
        wz = min(max(float(wanted[2]), -limits.max_vel_theta), limits.max_vel_theta)
        note = f"corrected by ({', '.join(f'{v:+.3f}' for v in self.offset.tolist())})"
        return replace(plan, command=Twist2D(share * vx, share * vy, wz), notes=(*plan.notes, note))

    def brake(self, inputs: ControlInput) -> LocalPlan | None:
        """Brake as the planner does."""
        return self._planner.brake(inputs)

    def goal_reached(self, inputs: ControlInput) -> bool:
        """By the planner."""
        return self._planner.goal_reached(inputs)

    def diagnostics(self) -> ControlDiagnostics | None:
        """Those of the planner."""
        return self._planner.diagnostics()
