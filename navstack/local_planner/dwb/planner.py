# pyright: basic
"""DWB: dwb_core::DWBLocalPlanner, the local planner of Nav2 until its release Iron.

The dynamic window approach with the parts as plugins: a generator samples velocities and simulates them, critics score the
trajectories, the lowest weighted total is commanded. Formulas and parameters as in nav2_dwb_controller.
"""

from __future__ import annotations

import copyreg
import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import ValidationInfo, create_model, field_validator, model_validator

from navstack.core import NoValidControlError, ParameterError, Path, Twist2D, UnknownPluginError, plain_kernel
from navstack.local_planner import parameter_checks as checks
from navstack.local_planner.critics.base_obstacle import BaseObstacleCritic
from navstack.local_planner.critics.rotate_to_goal import RotateToGoalCritic, RotateToGoalParams
from navstack.local_planner.dwb.critics import ObstacleFootprintCritic, ObstacleFootprintParams
from navstack.local_planner.dwb.generator import LIMITED_ACCEL, STANDARD, DWBGenerator, Kinematics
from navstack.local_planner.dwb.map_grid import AlignParams
from navstack.local_planner.dwb.plan_window import PlanWindow
from navstack.local_planner.path_follower import Following, PathFollower, PathFollowerParams, check_speed
from navstack.local_planner.path_handlers import FeasiblePathHandlerParams
from navstack.local_planner.rollouts import check_samples
from navstack.local_planner.scoring import (
    ScoreTable,
    checked_scores,
    control_diagnostics,
    prepared_scale,
    rejection_report,
)
from navstack.plugins import (
    CRITICS,
    LOCAL_PLANNERS,
    CheckContext,
    ControlDiagnostics,
    Critic,
    Issue,
    LocalPlan,
    ParamModel,
    PathHandler,
    Plugin,
    Rollouts,
    ScoringContext,
    VelocityLimits,
    normalize,
    param,
)

DEFAULT_CRITICS: Mapping[str, Mapping[str, float]] = {
    "RotateToGoal": {"scale": 32.0, "slowing_factor": 5.0, "lookahead_time": -1.0},
    "Oscillation": {},
    "BaseObstacle": {"scale": 0.02},
    "GoalAlign": {"scale": 24.0, "forward_point_distance": 0.1},
    "PathAlign": {"scale": 32.0, "forward_point_distance": 0.1},
    "PathDist": {"scale": 32.0},
    "GoalDist": {"scale": 24.0},
}
"""Those of nav2_bringup, in its order, with its values."""
NAMESPACE = "dwb_critics"
LARGEST = float(np.finfo(np.float32).max)
"""Totals beyond it are infinite in Nav2."""
UNTIL_KILTED = ("prune_plan", "prune_distance", "forward_prune_distance", "shorten_transformed_plan")
"""Parameters that Nav2 removed after Kilted; one of them selects its way to cut the plan."""
_TOPIC = "navstack publishes no topics; `explain command` lists and draws the trajectories"


# ----------------------------------------------------------------------------------------------------------------------
# Parameters.


def critic_plugin(name: str, kind: str, namespaces: list[str]) -> Plugin[Critic]:
    """Return the critic that Nav2 means by `kind`, its class or a short form of it: `PathDist`, `dwb_critics::PathDistCritic`.

    Raises UnknownPluginError with the closest name.
    """
    full = kind if "Critic" in kind else f"{kind}Critic"
    tried = [full] if "/" in normalize(full) else [f"{space}::{full}" for space in namespaces]
    for candidate in (*tried, kind):
        if candidate in CRITICS:
            return CRITICS.get(candidate)
    known = sorted(n for n, aliases in _names().items() if any(a.startswith(f"{NAMESPACE}/") for a in aliases))
    close = CRITICS.suggest(kind)
    named = next((n for n, aliases in _names().items() if close == n or close in aliases), close)
    hint = f'did you mean "{named}"? ' if named else ""
    of = "" if kind == name else f" of {name}"
    raise UnknownPluginError(
        f'unknown critic "{kind}"{of}; {hint}the critics of DWB are {", ".join(known)}',
        kind="critic",
        plugin=kind,
        known=known,
        suggestion=named,
    )


def _names() -> dict[str, tuple[str, ...]]:
    """The name by which Nav2 lists a critic (PathDist), or its registered name, with all its names."""
    found: dict[str, tuple[str, ...]] = {}
    for name, aliases in CRITICS.names():
        nav2 = [a for a in aliases if a.startswith(f"{NAMESPACE}/")]
        short = nav2[0].rpartition("/")[2].removesuffix("Critic") if nav2 else name
        found[short] = (name, *aliases)
    return found


@cache
def with_class(model: type[ParamModel]) -> type[ParamModel]:
    """Return the parameters of a critic, and `class`, which is no name for a field in Python."""
    fields: dict[str, Any] = {"class": (str, param("", "type of the critic; empty: its name"))}
    made = create_model(model.__name__, __base__=model, __module__=model.__module__, __doc__=model.__doc__, **fields)
    copyreg.pickle(
        made, lambda params: (_restored, (model, params.__getstate__()))
    )  # a pickle finds no class of its name
    return made


def _restored(model: type[ParamModel], state: dict[Any, Any]) -> ParamModel:
    """The parameters of a critic that were sent to another process."""
    cls = with_class(model)
    params = cls.__new__(cls)
    params.__setstate__(state)
    return params


def listed_critics(values: Mapping[str, Any]) -> list[str]:
    """The names in `critics`, those of nav2_bringup if it is not written."""
    listed = values.get("critics")
    return [n for n in (listed if isinstance(listed, list) else DEFAULT_CRITICS) if isinstance(n, str)]


def class_of(name: str, section: Any) -> str:
    """The type of a critic: `class` in its namespace, or its name."""
    written = section.get("class") if isinstance(section, Mapping) else getattr(section, "class", "")
    return written if isinstance(written, str) and written else name


class DWBParams(PathFollowerParams):
    """Parameters of dwb_core::DWBLocalPlanner. Each critic has a namespace below it, named like the critic."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        "max_rot_vel": "max_vel_theta",
        "min_trans_vel": "min_speed_xy",
        "max_trans_vel": "max_speed_xy",
        "min_rot_vel": "min_speed_theta",
    }
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **PathFollowerParams.NO_EFFECT,
        "debug_trajectory_details": "`explain command` lists every sample with its scores",
        "publish_evaluation": _TOPIC,
        "publish_global_plan": _TOPIC,
        "publish_transformed_plan": _TOPIC,
        "publish_local_plan": _TOPIC,
        "publish_trajectories": _TOPIC,
        "publish_cost_grid_pc": _TOPIC,
        "marker_lifetime": _TOPIC,
        "stateful": "a parameter of the goal checker",
    }
    SEARCHED: ClassVar[frozenset[str]] = PathFollowerParams.SEARCHED
    CHILD_FIELD: ClassVar[str | None] = "sections"

    min_vel_x: float = param(0.0, "lowest forward speed; negative allows driving backward", unit="m/s")
    max_vel_x: float = param(0.0, "highest forward speed", unit="m/s")
    min_vel_y: float = param(0.0, "lowest speed to the left; negative is to the right", unit="m/s")
    max_vel_y: float = param(0.0, "highest speed to the left", unit="m/s")
    max_vel_theta: float = param(0.0, "highest turning speed in both directions", unit="rad/s", ge=0.0)
    min_speed_xy: float = param(
        0.0, "lowest translational speed of samples that turn by less than min_speed_theta; negative: none", unit="m/s"
    )
    max_speed_xy: float = param(0.0, "highest translational speed; negative: none", unit="m/s")
    min_speed_theta: float = param(
        0.0, "lowest turning speed of samples that move by less than min_speed_xy; negative: none", unit="rad/s"
    )
    acc_lim_x: float = param(0.0, "acceleration along x", unit="m/s²", ge=0.0)
    acc_lim_y: float = param(0.0, "acceleration along y", unit="m/s²", ge=0.0)
    acc_lim_theta: float = param(0.0, "turning acceleration", unit="rad/s²", ge=0.0)
    decel_lim_x: float = param(0.0, "deceleration along x; negative", unit="m/s²", le=0.0)
    decel_lim_y: float = param(0.0, "deceleration along y; negative", unit="m/s²", le=0.0)
    decel_lim_theta: float = param(0.0, "turning deceleration; negative", unit="rad/s²", le=0.0)
    trajectory_generator_name: str = param(STANDARD, f"{STANDARD} or {LIMITED_ACCEL}")
    sim_time: float = param(1.7, "duration of the simulated trajectories", unit="s", gt=0.0)
    sim_period: float | None = param(
        None,
        "LimitedAccelGenerator: samples are reached within this time; not set: 1 / controller_frequency",
        unit="s",
        gt=0.0,
    )
    discretize_by_time: bool = param(False, "steps of time_granularity instead of the other two granularities")
    time_granularity: float = param(0.5, "time between the points of a trajectory", unit="s", gt=0.0)
    linear_granularity: float = param(0.5, "distance between the points of a trajectory", unit="m", gt=0.0)
    angular_granularity: float = param(0.025, "turn between the points of a trajectory", unit="rad", gt=0.0)
    include_last_point: bool = param(True, "the last point of a trajectory is there twice, so that sums count it twice")
    limit_vel_cmd_in_traj: bool = param(
        False, "command the velocity of the first step, which the accelerations allow, instead of the sample"
    )
    vx_samples: int = param(20, "number of velocities along x (at least 2 are used)", ge=0)
    vy_samples: int = param(5, "number of velocities along y (at least 2 are used)", ge=0)
    vtheta_samples: int = param(20, "number of turning speeds (at least 2 are used)", ge=0)
    short_circuit_trajectory_evaluation: bool = param(
        True, "stop scoring a trajectory when its total exceeds the lowest one so far"
    )
    prune_plan: bool = param(True, "drop poses of the plan that the robot has passed (Nav2 up to Kilted)")
    prune_distance: float | None = param(
        None, "the plan begins at the first pose nearer than this; not set: 2 m (Nav2 up to Kilted)", unit="m", gt=0.0
    )
    forward_prune_distance: float = param(
        2.0, "the plan ends at the first pose farther than this; negative: no limit (Nav2 up to Kilted)", unit="m"
    )
    shorten_transformed_plan: bool = param(
        True, "apply forward_prune_distance; otherwise half the local costmap (Nav2 up to Kilted)"
    )
    xy_goal_tolerance: float = param(
        0.25, "distance from the goal at which RotateToGoal starts, if not in its namespace", unit="m", ge=0.0
    )
    trans_stopped_velocity: float = param(
        0.25,
        "speed up to which the robot counts as stopped for RotateToGoal, if not in its namespace",
        unit="m/s",
        ge=0.0,
    )
    path_length_tolerance: float = param(
        1.0, "RotateToGoal does not start while more of the path is left, if not in its namespace", unit="m", ge=0.0
    )
    default_critic_namespaces: list[str] = param(
        [NAMESPACE], "packages in which critics are looked for by their short names"
    )
    critics: list[str] | None = param(
        None, "ordered critics; if not set, those of nav2_bringup with its values", ros_differs="required there"
    )

    @field_validator("trajectory_generator_name")
    @classmethod
    def _check_generator(cls, value: str) -> str:
        known = {normalize(n): n for n in (STANDARD, LIMITED_ACCEL)}
        short = {n.rpartition("/")[2]: full for n, full in known.items()}
        found = known.get(normalize(value)) or short.get(value)
        if found is None:
            raise ValueError(f'unknown trajectory generator "{value}"; use {STANDARD} or {LIMITED_ACCEL}')
        return found

    @field_validator("critics")
    @classmethod
    def _check_critics(cls, value: list[str] | None, info: ValidationInfo) -> list[str] | None:
        sections = info.data.get("sections") or {}
        namespaces = info.data.get("default_critic_namespaces") or [NAMESPACE]
        for i, name in enumerate(value or ()):
            if name in (value or ())[:i]:
                raise ValueError(f'critics lists "{name}" twice; remove one, or give it another name and set its class')
            try:
                critic_plugin(name, class_of(name, sections.get(name)), namespaces)
            except UnknownPluginError as exc:
                raise ValueError(exc.message) from None
        return value

    @model_validator(mode="after")
    def _check_samples(self) -> Self:
        check_samples({name: max(2, getattr(self, name)) for name in ("vx_samples", "vy_samples", "vtheta_samples")})
        return self

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Models of the critics, of the goal checker and of the path handler, by namespace."""
        found = super().child_models(values)
        namespaces = values.get("default_critic_namespaces")
        if not isinstance(namespaces, list):
            namespaces = [NAMESPACE]
        for name in listed_critics(values):
            try:
                entry = critic_plugin(name, class_of(name, values.get(name)), namespaces)
                found[name] = with_class(entry.cls.Params)
            except UnknownPluginError:  # reported with the list
                if isinstance(values.get(name), Mapping):
                    found[name] = with_class(ParamModel)
        return found

    @property
    def kinematics(self) -> Kinematics:
        """The limits of the base."""
        return Kinematics(*(getattr(self, name) for name in Kinematics._fields))

    @property
    def drives_backward(self) -> bool:
        """True if it may drive backward."""
        return self.min_vel_x < 0.0

    def make_critics(self) -> list[Critic]:
        """The critics, with the parameters of their namespaces; some of those of RotateToGoal are the controller's."""
        made: list[Critic] = []
        for name in listed_critics({"critics": self.critics}):
            own = self.sections.get(name)
            cls: Any = critic_plugin(name, class_of(name, own), self.default_critic_namespaces).cls
            model: type[ParamModel] = cls.Params
            values: dict[str, Any] = {}
            if self.critics is None:
                values.update(DEFAULT_CRITICS[name])
            if issubclass(model, RotateToGoalParams):
                inherited = ("xy_goal_tolerance", "trans_stopped_velocity", "path_length_tolerance")
                values.update({n: getattr(self, n) for n in inherited})
                if self.until_kilted and "path_length_tolerance" not in self.model_fields_set:
                    # this tolerance came with the path handlers; the window of before begins behind the robot
                    values["path_length_tolerance"] = LARGEST
            if own is not None:
                values.update({n: getattr(own, n) for n in own.model_fields_set if n in model.model_fields})
            made.append(cls(name, model(**values)))
        return made

    @property
    def until_kilted(self) -> bool:
        """True if a parameter selects the window of Nav2 up to Kilted."""
        return any(name in self.model_fields_set for name in UNTIL_KILTED)

    def make_path_handler(self) -> PathHandler:
        """The path handler, or the window of Nav2 up to Kilted if one of its parameters is set."""
        if not self.until_kilted:
            return super().make_path_handler()
        return PlanWindow(
            prune=self.prune_plan,
            prune_distance=2.0 if self.prune_distance is None else self.prune_distance,
            shorten=self.shorten_transformed_plan,
            forward_prune_distance=self.forward_prune_distance if self.forward_prune_distance >= 0.0 else math.inf,
        )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from moving, from stopping or from reaching its goal."""
        yield from super().check(context)
        yield from self._check_limits()
        yield from self._check_plan_window()
        critics = self.make_critics()
        ahead = max(
            (c.params.forward_point_distance for c in critics if isinstance(c.params, AlignParams)), default=0.0
        )
        fastest = checks.Limit("max_vel_x", self.max_vel_x)
        yield from checks.window_too_small(context, self.sim_time, fastest, ahead)
        yield from checks.updates_too_slow(context, fastest)
        braking = checks.Limit("decel_lim_x", -self.decel_lim_x)
        yield from checks.stopping_time(context, braking, fastest, self.sim_time)
        yield from checks.minimum_over_maximum(
            [
                ("min_vel_x", self.min_vel_x, "max_vel_x", self.max_vel_x),
                ("min_vel_y", self.min_vel_y, "max_vel_y", self.max_vel_y),
                ("min_speed_theta", self.min_speed_theta, "max_vel_theta", self.max_vel_theta),
            ]
        )
        if self.max_speed_xy >= 0.0:
            limits = ("min_speed_xy", self.min_speed_xy, "max_speed_xy", self.max_speed_xy)
            yield from checks.minimum_over_maximum([limits])
        yield from self._check_critics_fit(context, critics)

    def _check_plan_window(self) -> Iterator[Issue]:
        written = [name for name in UNTIL_KILTED if name in self.model_fields_set]
        handlers = [n for n, section in self.sections.items() if isinstance(section, FeasiblePathHandlerParams)]
        useless = [n for n in handlers if self.sections[n].model_fields_set]
        if written and useless:
            message = (
                f"{written[0]} selects the part of the plan as Nav2 does up to Kilted, so the parameters of {useless[0]} have no "
                f"effect; remove {' and '.join(written)}, or {useless[0]}"
            )
            yield Issue("warning", "two-plan-windows", (written[0], useless[0]), message)

    def _check_limits(self) -> Iterator[Issue]:
        axes = (
            ("x", max(self.max_vel_x, -self.min_vel_x), self.acc_lim_x, self.decel_lim_x),
            ("y", max(self.max_vel_y, -self.min_vel_y), self.acc_lim_y, self.decel_lim_y),
            ("theta", self.max_vel_theta, self.acc_lim_theta, self.decel_lim_theta),
        )
        moving = [axis for axis in axes if axis[1] > 0.0]
        if not moving:
            message = (
                "max_vel_x, max_vel_y and max_vel_theta are 0, their default, so no motion is sampled and the robot does not "
                "move; set them to the speeds of the base"
            )
            yield Issue("error", "zero-limits", ("max_vel_x", "max_vel_theta"), message)
            return
        if self.max_speed_xy == 0.0 and any(name != "theta" for name, *_ in moving):
            fastest = math.hypot(max(0.0, self.max_vel_x), max(0.0, self.max_vel_y))
            message = (
                "max_speed_xy is 0 (its default), so every sample that drives is rejected and the robot only turns; set it to "
                f"{fastest:g}, or to a negative value for no limit"
            )
            yield Issue("error", "zero-limits", ("max_speed_xy", "max_vel_x"), message, f"{fastest:g}")
        for name, speed, acceleration, deceleration in moving:
            if acceleration == 0.0:
                message = (
                    f"acc_lim_{name} is 0 (its default), so from rest no speed along {name} is reached, though up to {speed:g} "
                    "is allowed; set it to the acceleration of the base"
                )
                yield Issue("warning", "zero-limits", (f"acc_lim_{name}", f"max_vel_{name}"), message)
            elif deceleration == 0.0:
                message = (
                    f"decel_lim_{name} is 0 (its default), so no sample is slower along {name} than the robot: it never brakes "
                    f"for obstacles or its goal; set it to {-acceleration:g}, the negative of acc_lim_{name}"
                )
                yield Issue(
                    "warning",
                    "no-deceleration",
                    (f"decel_lim_{name}", f"acc_lim_{name}"),
                    message,
                    f"{-acceleration:g}",
                )

    def _check_critics_fit(self, context: CheckContext, critics: list[Critic]) -> Iterator[Issue]:
        if not critics:
            message = (
                "critics is empty, so that every sample is as good as any other: the robot neither follows its path nor keeps "
                "off obstacles; list critics, or remove the key for those of nav2_bringup"
            )
            yield Issue("error", "no-critics", ("critics",), message)
            return
        centers = [c.name for c in critics if isinstance(c, BaseObstacleCritic) and c.scale > 0.0]
        outlines = [c.name for c in critics if isinstance(c, ObstacleFootprintCritic) and c.scale > 0.0]
        others = [c.name for c in critics if "obstacle" in type(c).__name__.lower() and c.scale > 0.0]
        if not others:
            message = (
                "no critic rejects trajectories that hit obstacles: neither BaseObstacle nor ObstacleFootprint is in critics "
                "with a scale above 0; add BaseObstacle (round robots) or ObstacleFootprint"
            )
            yield Issue("warning", "no-obstacle-critic", ("critics",), message)
        footprint = context.local_costmap.footprint
        if centers and not outlines and footprint.circumscribed_radius > 1.3 * footprint.inscribed_radius:
            message = (
                f"{centers[0]} treats the robot as a disc of {footprint.inscribed_radius:.3g} m, but its corners are "
                f"{footprint.circumscribed_radius:.3g} m from its center; list ObstacleFootprint instead"
            )
            yield Issue("warning", "footprint-ignored", ("critics",), message)
        tolerance = self.make_goal_checker().xy_tolerance
        for critic in critics:
            if (
                isinstance(critic, RotateToGoalCritic)
                and critic.scale > 0.0
                and critic.params.xy_goal_tolerance > tolerance
            ):
                message = (
                    f"{critic.name} starts to turn at xy_goal_tolerance = {critic.params.xy_goal_tolerance:g} m, outside of the "
                    f"goal checker's {tolerance:g} m: the robot stops in between and never arrives; set it to {tolerance:g}"
                )
                yield Issue(
                    "warning",
                    "rotate-before-goal",
                    (f"{critic.name}/xy_goal_tolerance", "xy_goal_tolerance", "critics"),
                    message,
                    f"{tolerance:g}",
                )


# ----------------------------------------------------------------------------------------------------------------------
# The planner.


@LOCAL_PLANNERS.register("dwb", aliases=("dwb_core/DWBLocalPlanner",))
class DWBPlanner(PathFollower):
    """Follows a path by sampling velocities and scoring their trajectories.

    State between cycles: the plan, the goal checker, the state of the critics.
    """

    Params: ClassVar[type[ParamModel]] = DWBParams
    params: Any

    def __init__(self, params: DWBParams) -> None:
        super().__init__(params)
        self.critics = params.make_critics()
        if not self.critics:
            raise ParameterError(
                "DWB needs critics: list them in `critics`, or remove the key for those of nav2_bringup"
            )
        # Nav2 differs: where costs are not inflated, the cost of the center says nothing about obstacles next to it
        self._on_raw_costs = [outline_of(c) if isinstance(c, BaseObstacleCritic) else c for c in self.critics]
        self.generator = DWBGenerator(params, self.period)
        self._names = tuple(critic.name for critic in self.critics)
        self._kinematics = params.kinematics
        self._last: tuple[ScoringContext, Rollouts, ScoreTable, LocalPlan, list[Critic]] | None = None
        self._raw, self._scales = np.empty((len(self.critics), 0)), np.empty(len(self.critics))
        self._use(self._kinematics)

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        return self._limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value.

        A lower translational speed lowers all speeds in proportion, as setSpeedLimit of Nav2.
        """
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        base = self.params.kinematics
        fastest = _fastest(base)
        lowered = base
        if max_vel_trans is not None and max_vel_trans < fastest:
            lowered = base.scaled(max_vel_trans / fastest)
            if base.max_speed_xy >= 0.0:
                lowered = lowered._replace(max_speed_xy=max_vel_trans)
        if max_vel_theta is not None:
            lowered = lowered._replace(max_vel_theta=min(lowered.max_vel_theta, max_vel_theta))
        self._use(lowered)

    def set_speed_limit(self, limit: float, *, percentage: bool) -> None:
        """Lower all speeds as a message on Nav2's topic speed_limit does: to `limit` percent, or to `limit` m/s; 0 restores."""
        check_speed(speed_limit=limit)
        if limit == 0.0:
            self.set_limits()
        elif percentage:
            self._use(self.params.kinematics.scaled(limit / 100.0))
        else:
            self.set_limits(max_vel_trans=limit)

    def _use(self, limits: Kinematics) -> None:
        self._kinematics = limits
        self.generator.set_limits(limits)
        self._limits = VelocityLimits(
            max_vel_x=limits.max_vel_x,
            min_vel_x=limits.min_vel_x,
            max_vel_y=limits.max_vel_y,
            min_vel_y=limits.min_vel_y,
            max_vel_trans=_fastest(limits),
            min_vel_trans=max(0.0, limits.min_speed_xy),
            max_vel_theta=limits.max_vel_theta,
            min_vel_theta=max(0.0, limits.min_speed_theta),
            acc_lim_x=_braking(limits.acc_lim_x, limits.decel_lim_x),
            acc_lim_y=_braking(limits.acc_lim_y, limits.decel_lim_y),
            acc_lim_theta=_braking(limits.acc_lim_theta, limits.decel_lim_theta),
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
        )

    # --- plan -------------------------------------------------------------------------------------------------------

    def set_plan(self, plan: Path, goal: Any) -> None:
        """Follow `plan` to `goal`; every plan resets the critics."""
        super().set_plan(plan, goal)
        for critic in self.critics:
            critic.reset()

    # --- the command ------------------------------------------------------------------------------------------------

    def compute_command(self, inputs: Any) -> LocalPlan:
        """As `PathFollower`; a cycle without a search has no diagnostics."""
        self._last = None
        return super().compute_command(inputs)

    def follow(self, now: Following) -> LocalPlan:
        """Score all samples and command the one with the lowest total.

        Raises NoValidControlError if critics reject every sample, or the limits leave none.
        """
        costmap = now.costmap
        if not costmap.data.flags.c_contiguous or not costmap.data.flags.writeable:
            costmap = costmap.copy()
        context = ScoringContext(now.state, costmap, now.footprint, now.path.poses, now.goal, self._limits)
        samples, rollouts = self.generator.rollouts(now.state)
        local = Path(now.path.poses, costmap.frame)
        if not len(samples):
            return self._standstill(local)
        critics = self.critics if now.inflation is not None else self._on_raw_costs
        table = self._scored(context, rollouts, critics)
        best = table.best
        command = Twist2D(*rollouts.commands[best].tolist()) if best >= 0 else Twist2D()
        plan = LocalPlan(
            command,
            "follow",
            samples.copy(),
            self._names,
            table.costs,
            table.scales,
            table.totals,
            table.rejected_by,
            best,
            rollouts.poses[best, : rollouts.counts[best]].copy() if best >= 0 else None,
            local,
            tuple(context.notes),
        )
        self._last = context, rollouts, table, plan, critics
        for critic in self.critics:
            critic.debrief(command, now.state.pose)
        if best < 0:
            text, data = rejection_report(table, critics, samples)
            raise NoValidControlError(text, **data, plan=plan)
        return plan

    def _standstill(self, local: Path) -> LocalPlan:
        """The command if the limits allow no motion: they were lowered to 0, or the parameters are wrong."""
        limits = self._kinematics
        if limits != self.params.kinematics and (limits.max_vel_theta == 0.0 or _fastest(limits) == 0.0):
            return LocalPlan(Twist2D(), local_plan=local, notes=("the speed limit is 0: no motion is sampled",))
        raise NoValidControlError(
            "the limits leave no velocity to sample: max_vel_x, max_vel_theta and max_speed_xy, and the accelerations from rest, "
            "must not be 0",
            samples=0,
            rejected={},
        )

    def _scored(self, context: ScoringContext, rollouts: Rollouts, critics: list[Critic]) -> ScoreTable:
        k = len(rollouts.counts)
        if self._raw.shape[1] != k:
            self._raw = np.empty((len(critics), k))
        scales = self._scales
        for i, critic in enumerate(critics):
            # weights are float32 in Nav2
            scales[i] = np.float32(prepared_scale(critic, context))
        for i, critic in enumerate(critics):
            if scales[i] != 0.0:
                self._raw[i] = checked_scores(critic, rollouts)
        costs, totals = np.empty((k, len(critics))), np.empty(k)
        rejected_by = np.empty(k, np.int8)
        short_circuit = self.params.short_circuit_trajectory_evaluation
        best = select(self._raw, scales, short_circuit, costs, totals, rejected_by)
        return ScoreTable(costs, scales.copy(), totals, rejected_by, int(best))

    # --- diagnostics ------------------------------------------------------------------------------------------------

    def diagnostics(self) -> ControlDiagnostics | None:
        """Diagnostics of the last cycle, legal or not; None before the first, without a search, and on arrival."""
        if self._last is None:
            return None
        context, rollouts, table, plan, critics = self._last
        return control_diagnostics(plan, context, rollouts, table, critics, self.rule)

    @property
    def rule(self) -> str:
        """What the totals of samples are, if not all critics scored them."""
        if not self.params.short_circuit_trajectory_evaluation:
            return ""
        return (
            "the lowest total is commanded; a sample is not scored further when its total exceeds the lowest one before it "
            "(short_circuit_trajectory_evaluation)"
        )


def outline_of(critic: BaseObstacleCritic) -> ObstacleFootprintCritic:
    """Return a critic that rejects what the footprint's outline hits, in place of one that looks at the center."""
    values = ObstacleFootprintParams(scale=critic.params.scale, sum_scores=critic.params.sum_scores)
    return ObstacleFootprintCritic(critic.name, values)


def _fastest(limits: Kinematics) -> float:
    """Highest translational speed (m/s)."""
    if limits.max_speed_xy >= 0.0:
        return limits.max_speed_xy
    along = max(limits.max_vel_x, -limits.min_vel_x, 0.0)
    return math.hypot(along, max(limits.max_vel_y, -limits.min_vel_y, 0.0))


def _braking(acceleration: float, deceleration: float) -> float:
    """The lower one of both; without a deceleration, the acceleration."""
    return min(acceleration, -deceleration) if deceleration < 0.0 else acceleration


@plain_kernel
def select(raw, scales, short_circuit, costs, totals, rejected_by):
    """Add up the weighted scores `raw` (C, K) of each sample, and return the index of the lowest total (the first of equals).

    A negative score rejects, and is the total; -1 if all are rejected. With `short_circuit` a sample is not scored further once
    its total exceeds a lowest one above 0. Totals are rounded to float32 after every critic, as Nav2 stores them. Writes `costs`
    (K, C), NaN where a critic did not score, `totals` and `rejected_by` (K,).
    """
    f32 = np.float32
    number = raw.shape[0]
    best, lowest = -1, f32(-1.0)
    for k in range(raw.shape[1]):
        total = f32(0.0)
        rejected_by[k] = -1
        done = False
        for i in range(number):
            costs[k, i] = np.nan
            if done or scales[i] == 0.0:
                continue
            score = raw[i, k]
            costs[k, i] = score
            if not score >= 0.0:
                rejected_by[k] = i
                totals[k] = score
                done = True
                continue
            total = f32(total + score * scales[i])
            done = short_circuit and lowest > f32(0.0) and total > lowest
        if rejected_by[k] < 0:
            totals[k] = min(np.float64(total), LARGEST)
            if best < 0 or total < lowest:
                best, lowest = k, total
    return best
