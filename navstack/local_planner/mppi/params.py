"""Parameters of MPPIController (nav2_mppi_controller), under their names in YAML."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final, Self

from pydantic import field_validator, model_validator

from navstack.local_planner.path_follower import PathFollowerParams
from navstack.local_planner.rollouts import MAX_POINTS
from navstack.plugins import CRITICS, CheckContext, Issue, ParamModel, PluginSection, PluginSpec, param

# ----------------------------------------------------------------------------------------------------------------------
# The motion models of MPPI: `motion_model: diff_drive` and `diff_drive: {plugin: "mppi::DiffDriveMotionModel"}`.


DIFF, OMNI, ACKERMANN = "mppi::DiffDriveMotionModel", "mppi::OmniMotionModel", "mppi::AckermannMotionModel"
FORMER: Final[Mapping[str, str]] = {"DiffDrive": DIFF, "Omni": OMNI, "Ackermann": ACKERMANN}
"""Names of the motion models in Nav2 up to Kilted, where they have no namespace."""
FORMER_CONSTRAINTS: Final = "AckermannConstraints"
USUAL: Final[Mapping[str, str]] = {"diff_drive": DIFF, "omni": OMNI, "ackermann": ACKERMANN}
"""The plugin of a motion model that has no namespace, by its name."""


class MotionModelParams(PluginSection):
    """The kind of the base."""

    plugin: str = param(DIFF, f"{DIFF}, {OMNI} or {ACKERMANN}")
    min_turning_r: float = param(0.2, "smallest turning radius of the Ackermann model", unit="m", gt=0.0)

    @field_validator("plugin")
    @classmethod
    def _check_plugin(cls, value: str) -> str:
        if value.replace("/", "::") not in FORMER.values():
            raise ValueError(f'unknown motion model "{value}"; known: {", ".join(FORMER.values())}')
        return value.replace("/", "::")


class FormerConstraints(ParamModel):
    """`AckermannConstraints` of Nav2 up to Kilted."""

    min_turning_r: float = param(0.2, "smallest turning radius", unit="m", gt=0.0)


def model_of_namespace(values: Mapping[str, Any]) -> tuple[str, type[ParamModel]]:
    """Return the namespace of the motion model that `values` select, and its parameter model."""
    name = values.get("motion_model", "diff_drive")
    if name in FORMER or not isinstance(name, str):
        return FORMER_CONSTRAINTS, FormerConstraints
    return name, MotionModelParams


def motion_model(name: str, sections: Mapping[str, Any]) -> MotionModelParams:
    """Return the motion model of a name, by the parameters of its namespace."""
    if name in FORMER:
        former = sections.get(FORMER_CONSTRAINTS) or FormerConstraints()
        return MotionModelParams(plugin=FORMER[name], min_turning_r=former.min_turning_r)
    written = sections.get(name)
    if isinstance(written, MotionModelParams) and "plugin" in written.model_fields_set:
        return written
    radius = written.min_turning_r if isinstance(written, MotionModelParams) else 0.2
    return MotionModelParams(plugin=USUAL.get(name, DIFF), min_turning_r=radius)


DEFAULT_CRITICS: Final = (
    "ConstraintCritic",
    "CostCritic",
    "GoalCritic",
    "GoalAngleCritic",
    "PathAlignCritic",
    "PathFollowCritic",
    "PathAngleCritic",
    "PreferForwardCritic",
)
"""Those of nav2_bringup, in its order."""
VALIDATOR: Final = "mppi::DefaultOptimalTrajectoryValidator"
SAME_PERIOD_S: Final = 1e-6
SHORTEST_FILTERED: Final = 20
"""Sequences of up to this many steps are not filtered."""


class TrajectoryValidatorParams(PluginSection):
    """The check of the chosen trajectory."""

    plugin: str = param(VALIDATOR, "type of the validator")
    collision_lookahead_time: float = param(2.0, "this much of the trajectory is checked", unit="s", ge=0.0)
    consider_footprint: bool = param(False, "check the footprint; otherwise the cost of the center's cell")

    @field_validator("plugin")
    @classmethod
    def _check_plugin(cls, value: str) -> str:
        if value.replace("/", "::") != VALIDATOR:
            raise ValueError(f'unknown trajectory validator "{value}"; known: {VALIDATOR}')
        return value


class TrajectoryVisualizerParams(ParamModel):
    """Which trajectories Nav2 publishes."""

    trajectory_step: int = param(5, "no effect: `explain command` draws every trajectory", ge=1)
    time_step: int = param(3, "no effect: `explain command` draws every point of a trajectory", ge=1)


class MPPIParams(PathFollowerParams):
    """Parameters of MPPIController. Its critics and its motion model have namespaces below it, named like them."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **PathFollowerParams.NO_EFFECT,
        "visualize": "navstack publishes no topics; `explain command` draws the trajectories",
        "publish_critics_stats": "navstack publishes no topics; `explain command` lists the shares of the critics",
        "critic_index_to_visualize": "navstack publishes no topics",
        "publish_optimal_trajectory": "navstack publishes no topics; every command has its trajectory",
        "reset_period": "Nav2 removed it after Humble",
    }
    SEARCHED: ClassVar[frozenset[str]] = PathFollowerParams.SEARCHED
    CHILD_FIELD: ClassVar[str | None] = "sections"

    batch_size: int = param(1000, "sampled trajectories per cycle", ge=1, le=1_000_000)
    time_steps: int = param(56, "steps of a trajectory", ge=2, le=10_000)
    model_dt: float = param(
        0.05, "length of a step; not below 1 / controller_frequency, best equal to it", unit="s", gt=0.0
    )
    iteration_count: int = param(1, "optimizations per cycle", ge=1, le=1000)
    temperature: float = param(0.3, "cost that makes a trajectory e times less important than the best one", gt=0.0)
    gamma: float = param(0.015, "weight of the cost of controls: draws them towards 0", ge=0.0)
    vx_max: float = param(0.5, "highest forward speed", unit="m/s", ge=0.0)
    vx_min: float = param(-0.35, "lowest forward speed; negative allows driving backward", unit="m/s")
    vy_max: float = param(0.5, "highest speed to both sides; holonomic robots only", unit="m/s", ge=0.0)
    wz_max: float = param(1.9, "highest turning speed", unit="rad/s", ge=0.0)
    ax_max: float = param(3.0, "acceleration along x when speeding up", unit="m/s²", gt=0.0)
    ax_min: float = param(-3.0, "acceleration along x when slowing down; negative", unit="m/s²", lt=0.0)
    ay_max: float = param(3.0, "acceleration along y when speeding up", unit="m/s²", gt=0.0)
    ay_min: float = param(-3.0, "acceleration along y when slowing down; negative", unit="m/s²", lt=0.0)
    az_max: float = param(3.5, "turning acceleration", unit="rad/s²", gt=0.0)
    vx_std: float = param(0.2, "standard deviation of the noise of vx", unit="m/s", gt=0.0)
    vy_std: float = param(0.2, "standard deviation of the noise of vy", unit="m/s", gt=0.0)
    wz_std: float = param(0.4, "standard deviation of the noise of the turning speed", unit="rad/s", ge=0.0)
    model_delay_vx: float = param(0.0, "dead time of the drive along x", unit="s", ge=0.0)
    model_delay_vy: float = param(0.0, "dead time of the drive along y", unit="s", ge=0.0)
    model_delay_wz: float = param(0.0, "dead time of turning", unit="s", ge=0.0)
    clamp_raw_controls: bool = param(False, "average the reachable instead of the sampled controls")
    open_loop: bool = param(False, "the current speed is the last command, not the measured one")
    sgf_order: int = param(2, "order of the smoothing filter", ge=1, le=2)
    retry_attempt_limit: int = param(1, "further attempts if a cycle fails", ge=0, le=100)
    regenerate_noises: bool = param(
        False, "new noise in every optimization", ros_differs="drawn in the cycle itself, not by a thread"
    )
    seed: int = param(0, "seed of the noise; an addition of navstack", ge=0)
    motion_model: str = param(
        "diff_drive", "namespace of the motion model, or DiffDrive, Omni, Ackermann (Nav2 up to Kilted)"
    )
    critics: list[PluginSpec] | None = param(
        None,
        "ordered critics: names, or a list of {name, type}; if not set, those of nav2_bringup",
        ros_differs="no critics if not set",
    )

    @field_validator("temperature")
    @classmethod
    def _check_temperature(cls, value: float) -> float:
        if value < 1e-6:
            raise ValueError(f"temperature = {value:g} divides by nearly zero; set it to about 0.3")
        return value

    @model_validator(mode="after")
    def _check_work(self) -> Self:
        points = self.batch_size * self.time_steps * self.iteration_count
        if points > MAX_POINTS:
            raise ValueError(
                f"batch_size {self.batch_size:,} * time_steps {self.time_steps:,} * iteration_count {self.iteration_count:,} are "
                f"{points:,} points in a cycle; lower them to at most {MAX_POINTS:,} in total (Nav2's have 112,000)"
            )
        return self

    @property
    def listed_critics(self) -> list[tuple[str, str]]:
        """Name and type of each critic, in order."""
        if self.critics is None:
            return [(name, name) for name in DEFAULT_CRITICS]
        return [(spec.name, spec.type) for spec in self.critics]

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Models of critics, motion model, validator, visualizer, goal checker and path handler, by namespace."""
        found = super().child_models(values)
        listed = values.get("critics")
        if not isinstance(listed, list):
            listed = [{"name": name, "type": name} for name in DEFAULT_CRITICS]
        for entry in listed:
            name, kind = (entry.get("name"), entry.get("type")) if isinstance(entry, Mapping) else (entry, entry)
            if isinstance(name, str) and isinstance(kind, str) and kind in CRITICS:
                found[name] = CRITICS.get(kind).cls.Params
        name, model = model_of_namespace(values)
        found[name] = model
        found["TrajectoryValidator"] = TrajectoryValidatorParams
        found["TrajectoryVisualizer"] = TrajectoryVisualizerParams
        return found

    @property
    def motion(self) -> MotionModelParams:
        """The motion model."""
        return motion_model(self.motion_model, self.sections)

    @property
    def turning_radius(self) -> float:
        """Radius (m) of the tightest curve: that of the Ackermann model."""
        return self.motion.min_turning_r if self.motion.plugin == ACKERMANN else 0.0

    @property
    def drives_backward(self) -> bool:
        """True if it may drive backward."""
        return self.vx_min < 0.0

    @property
    def is_omni(self) -> bool:
        """True for a base that moves sideways."""
        return self.motion.plugin == OMNI

    @property
    def validator(self) -> TrajectoryValidatorParams:
        """The check of the chosen trajectory."""
        return self.sections.get("TrajectoryValidator") or TrajectoryValidatorParams()

    @property
    def period(self) -> float:
        """Seconds between two commands."""
        return 1.0 / self.controller_frequency if self.controller_frequency > 0.0 else self.model_dt

    def too_slow(self) -> str | None:
        """What is wrong if a step of the model is shorter than the control period, as Nav2 refuses it; None if it is not."""
        if self.period <= self.model_dt + SAME_PERIOD_S:
            return None
        return (
            f"model_dt = {self.model_dt:g} s is shorter than the control period of {self.period:g} s (controller_frequency "
            f"{self.controller_frequency:g} Hz): commands would be held longer than the model assumes, and Nav2 refuses it; set "
            f"model_dt to {self.period:g} (and time_steps to {max(2, round(self.time_steps * self.model_dt / self.period))} "
            f"for the same horizon), or controller_frequency to {1.0 / self.model_dt:g}"
        )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from driving, or from driving as the parameters say."""
        yield from super().check(context)
        text = self.too_slow()
        if text is not None:
            yield Issue("error", "model-dt", ("model_dt", "/controller_frequency"), text, f"{self.period:g}")
        elif self.period < self.model_dt - SAME_PERIOD_S:
            message = (
                f"model_dt = {self.model_dt:g} s is longer than the control period of {self.period:g} s, so the controls are not "
                f"shifted between cycles; set it to {self.period:g}"
            )
            yield Issue("warning", "model-dt", ("model_dt", "/controller_frequency"), message, f"{self.period:g}")
        if not self.listed_critics:
            message = (
                "critics is empty, so that every sample is as good as any other: the robot neither follows its path nor keeps "
                "off obstacles; list critics, or remove the key for those of nav2_bringup"
            )
            yield Issue("error", "no-critics", ("critics",), message)
        yield from self._check_speeds(context)
        yield from self._check_footprint(context)

    def _check_speeds(self, context: CheckContext) -> Iterator[Issue]:
        if self.vx_min > self.vx_max:
            message = f"vx_min = {self.vx_min:g} is greater than vx_max = {self.vx_max:g}; swap or correct the values"
            yield Issue("error", "minimum-over-maximum", ("vx_min", "vx_max"), message)
        reach = self.time_steps * self.model_dt * self.vx_max
        handler = getattr(self.make_path_handler(), "params", None)
        prune = float(getattr(handler, "prune_distance", math.inf))
        costmap = context.local_costmap
        half = min(costmap.width, costmap.height) / 2.0 if costmap.rolling_window else math.inf
        shorter = min(prune, half)
        if reach > shorter + 0.05:
            name, fix = ("prune_distance", "raise it") if prune <= half else ("half the local costmap", "enlarge it")
            message = (
                f"trajectories reach {reach:.3g} m (time_steps {self.time_steps} * model_dt {self.model_dt:g} s * vx_max "
                f"{self.vx_max:g} m/s), beyond {name} = {shorter:.3g} m, so the robot does not reach vx_max; {fix} to "
                f"{reach if prune <= half else 2.0 * reach:.3g} m, or lower time_steps"
            )
            yield Issue("warning", "horizon-over-path", ("prune_distance", "time_steps", "vx_max"), message)

    def _check_footprint(self, context: CheckContext) -> Iterator[Issue]:
        footprint = context.local_costmap.footprint
        motion = self.motion
        if motion.plugin == ACKERMANN and self.vx_max > 0.0 and self.vx_max / motion.min_turning_r < 0.3 * self.wz_max:
            tightest = self.vx_max / motion.min_turning_r
            message = (
                f"min_turning_r = {motion.min_turning_r:g} m allows turns of at most {tightest:.2g} rad/s at vx_max "
                f"{self.vx_max:g} m/s, so most samples up to wz_max {self.wz_max:g} rad/s are wasted; lower wz_max to "
                f"{tightest:.2g} and wz_std in proportion"
            )
            yield Issue("warning", "turning-radius", (f"{self.motion_model}/min_turning_r", "wz_max"), message)
        for name, kind in self.listed_critics:
            entry = CRITICS.get(kind)
            if "consider_footprint" not in entry.cls.Params.model_fields:
                continue
            own: Any = self.sections.get(name) or entry.cls.Params()
            elongated = footprint.circumscribed_radius > 1.3 * footprint.inscribed_radius
            if own.enabled and elongated and not own.consider_footprint:
                message = (
                    f"consider_footprint of {name} is false, so it treats the robot as a disc of "
                    f"{footprint.inscribed_radius:.3g} m, but its corners are {footprint.circumscribed_radius:.3g} m from its "
                    "center; set it to true"
                )
                yield Issue("warning", "footprint-ignored", (f"{name}/consider_footprint",), message, "true")
