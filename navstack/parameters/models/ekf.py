"""The parameters of the odometry filter (robot_localization: ekf_localization_node)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Final, NamedTuple

from pydantic import create_model, field_validator

from navstack.plugins import ParamModel, param

STATES: Final = ("x", "y", "z", "roll", "pitch", "yaw", "vx", "vy", "vz", "vroll", "vpitch", "vyaw", "ax", "ay", "az")
"""The order of robot_localization."""
PLANAR: Final = (0, 1, 5, 6, 7, 11, 12, 13)
"""Those of a planar robot: x, y, yaw, vx, vy, vyaw, ax, ay."""
SOURCES_PER_KIND: Final = 2
KINDS: Final = ("odom", "pose", "twist", "imu")
HUGE: Final = 1e300
_NOISE: Final = (0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015)


class SourceParams(NamedTuple):
    """What is used of one input."""

    name: str
    used: tuple[bool, ...]
    """(8,) in the order of `PLANAR`."""
    differential: bool
    relative: bool
    pose_threshold: float
    twist_threshold: float
    acceleration_threshold: float


class _FilterParams(ParamModel):
    """Namespace `ekf`, without the inputs."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "publish_tf": "the estimate is a return value",
        "publish_acceleration": "the estimate has the acceleration",
        "print_diagnostics": "every decision is kept with its reason",
        "transform_time_offset": "the estimate has its own time",
        "transform_timeout": "navstack does not wait",
        "use_control": "commands are not used by the filter",
        "stamped_control": "commands are not used by the filter",
        "control_timeout": "commands are not used by the filter",
        "control_config": "commands are not used by the filter",
        "dynamic_process_noise_covariance": "the process noise is constant",
        "reset_on_time_jump": "inputs that go back in time are rejected",
        "permit_corrected_publication": "estimates are return values",
        "disabled_at_startup": "the filter runs when it is called",
        "use_sim_time": "navstack gets the time with every call",
        "debug": "every decision is kept with its reason",
        "debug_out_file": "every decision is kept with its reason",
    }

    frequency: float = param(30.0, "rate of the estimates", unit="Hz", gt=0.0, le=10_000.0)
    sensor_timeout: float | None = param(
        None, "without measurements for longer, the estimate is a prediction; none: 1 / frequency", unit="s", gt=0.0
    )
    two_d_mode: bool = param(True, "no effect: poses are planar", ros_differs="navstack's robots are planar")
    map_frame: str = param("map", "map frame")
    odom_frame: str = param("odom", "odometry frame")
    base_link_frame: str = param("base_link", "base frame")
    world_frame: str = param("odom", "frame of the estimated pose")
    smooth_lagged_data: bool = param(False, "apply a late measurement at its own time, from the history")
    history_length: float = param(0.0, "length of the history for late measurements", unit="s", ge=0.0)
    predict_to_current_time: bool = param(False, "no effect: `predicted` gives the estimate at any time")
    initial_state: list[float] = param([0.0] * 15, "state at the start, 15 numbers")
    process_noise_covariance: list[float] = param(
        list(_NOISE), "noise of the prediction per second: 15 variances, or the 15 x 15 matrix row by row"
    )
    initial_estimate_covariance: list[float] = param(
        [1e-9] * 15, "covariance at the start: 15 variances, or the 15 x 15 matrix row by row"
    )

    @field_validator("initial_state")
    @classmethod
    def _check_state(cls, value: list[float]) -> list[float]:
        if len(value) != len(STATES):
            raise ValueError(f"it has {len(value)} numbers; the state has 15: {', '.join(STATES)}")
        return value

    @field_validator("process_noise_covariance", "initial_estimate_covariance")
    @classmethod
    def _check_covariance(cls, value: list[float]) -> list[float]:
        if len(value) not in (15, 225):
            raise ValueError(f"it has {len(value)} numbers; write 15 variances or 225 elements")
        diagonal = value if len(value) == 15 else value[::16]
        if min(diagonal) < 0.0:
            raise ValueError(f"it has the negative variance {min(diagonal)}")
        return value

    def sources(self) -> dict[str, SourceParams]:
        """Return the inputs that are configured, by name (`odom0`)."""
        found: dict[str, SourceParams] = {}
        for kind in KINDS:
            for number in range(SOURCES_PER_KIND):
                name = f"{kind}{number}"
                config = getattr(self, f"{name}_config")
                if config is not None:
                    found[name] = self._source(kind, name, config)
        return found

    def _source(self, kind: str, name: str, config: list[bool]) -> SourceParams:
        def value(key: str, default: float) -> float:
            return getattr(self, f"{name}_{key}", default)

        common = value("rejection_threshold", HUGE)
        return SourceParams(
            name,
            tuple(config[index] for index in PLANAR),
            bool(value("differential", False)),
            bool(value("relative", False)),
            value("pose_rejection_threshold", common),
            value("twist_rejection_threshold", common),
            value("linear_acceleration_rejection_threshold", common),
        )

    @field_validator("*")
    @classmethod
    def _check_config(cls, value: Any, info: Any) -> Any:
        if str(info.field_name).endswith("_config") and value is not None and len(value) != len(STATES):
            raise ValueError(f"it has {len(value)} elements; write 15 booleans: {', '.join(STATES)}")
        return value


def _source_fields() -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for kind in KINDS:
        for number in range(SOURCES_PER_KIND):
            name = f"{kind}{number}"
            fields[name] = str, param("", f"topic of {name}; navstack takes the data by this name")
            fields[f"{name}_config"] = list[bool] | None, param(None, f"which of the 15 variables {name} measures")
            if kind != "twist":
                fields[f"{name}_differential"] = bool, param(False, "use differences of poses as velocities")
                fields[f"{name}_relative"] = bool, param(False, "take poses relative to the first one")
            thresholds = {
                "odom": ("pose_rejection_threshold", "twist_rejection_threshold"),
                "imu": (
                    "pose_rejection_threshold",
                    "twist_rejection_threshold",
                    "linear_acceleration_rejection_threshold",
                ),
            }.get(kind, ("rejection_threshold",))
            for key in thresholds:
                fields[f"{name}_{key}"] = (
                    float,
                    param(HUGE, "measurements of at least this Mahalanobis distance are rejected", gt=0.0),
                )
            fields[f"{name}_queue_size"] = int, param(1, "no effect: every message is used", ge=0)
            fields[f"{name}_nodelay"] = bool, param(False, "no effect: no messages are sent")
            if kind == "imu":
                fields[f"{name}_remove_gravitational_acceleration"] = (
                    bool,
                    param(False, "no effect: on a plane, gravity has no component in the accelerations that are used"),
                )
    fields["gravitational_acceleration"] = float, param(9.80665, "no effect: see above", unit="m/s²")
    return fields


EkfParams: type[_FilterParams] = create_model(
    "EkfParams",
    __base__=_FilterParams,
    __doc__="Namespace `ekf`: odometry from several sensors, with the names of robot_localization.",
    __module__=__name__,
    **_source_fields(),
)
FilterParams = _FilterParams
"""The type of `EkfParams`, for annotations."""
