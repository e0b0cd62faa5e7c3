"""The parameters of the velocity smoother (Nav2: nav2_velocity_smoother)."""

from collections.abc import Mapping
from typing import ClassVar, Final, Literal, Self

from pydantic import field_validator, model_validator

from navstack.plugins import ParamModel, param

ROS2_NO_EFFECT: Final[Mapping[str, str]] = {
    "use_sim_time": "navstack gets the time with every call",
    "bond_heartbeat_period": "navstack has no life cycle manager",
    "use_realtime_priority": "navstack runs step by step, without a thread of its own",
}
"""Parameters that every Nav2 node has and that have no meaning without ROS."""

_LISTS = ("max_velocity", "min_velocity", "max_accel", "max_decel", "deadband_velocity")


class VelocitySmootherParams(ParamModel):
    """Namespace `velocity_smoother`: limits of velocity and acceleration between the controller and the robot.

    Lists have an element per axis: [x, y, yaw], or [x, y, z, roll, pitch, yaw], of which x, y and yaw are used.
    """

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **ROS2_NO_EFFECT,
        "stamp_smoothed_velocity_with_smoothing_time": "every command has the time of its step",
    }

    smoothing_frequency: float = param(20.0, "frequency of the output", unit="Hz", gt=0.0, le=1000.0)
    feedback: Literal["OPEN_LOOP", "CLOSED_LOOP"] = param(
        "OPEN_LOOP", "the current velocity: OPEN_LOOP the last output, CLOSED_LOOP the odometry"
    )
    scale_velocities: bool = param(False, "one factor for the change of all axes, which keeps its direction")
    max_velocity: list[float] = param([0.5, 0.0, 2.5], "highest velocities, at least 0", unit="m/s, rad/s")
    min_velocity: list[float] = param([-0.5, 0.0, -2.5], "lowest velocities, at most 0", unit="m/s, rad/s")
    max_accel: list[float] = param([2.5, 0.0, 3.2], "accelerations, at least 0", unit="m/s², rad/s²")
    max_decel: list[float] = param([-2.5, 0.0, -3.2], "decelerations, at most 0", unit="m/s², rad/s²")
    deadband_velocity: list[float] = param([0.0, 0.0, 0.0], "smaller outputs are sent as 0", unit="m/s, rad/s")
    velocity_timeout: float = param(1.0, "age of the last command from which on it counts as 0", unit="s", ge=0.0)
    odom_topic: str = param("odom", "topic of the odometry in ROS; navstack takes the odometry of the robot")
    odom_duration: float = param(0.1, "window over which the odometry's velocity is averaged", unit="s", ge=0.0)
    enable_stamped_cmd_vel: bool = param(True, "type of the commands in ROS; navstack's have the time of the call")
    nav2_compatible: bool = param(
        False, "compute as Nav2 does, with the defects that the parity page lists; not a parameter of Nav2"
    )

    @field_validator("max_velocity", "max_accel", "deadband_velocity")
    @classmethod
    def _check_positive(cls, value: list[float]) -> list[float]:
        if any(v < 0.0 for v in value):
            raise ValueError(f"{value} has a negative element; all elements must be at least 0")
        return value

    @field_validator("min_velocity", "max_decel")
    @classmethod
    def _check_negative(cls, value: list[float]) -> list[float]:
        if any(v > 0.0 for v in value):
            raise ValueError(f"{value} has a positive element; all elements must be at most 0")
        return value

    @model_validator(mode="after")
    def _check_lists(self) -> Self:
        lengths = {name: len(getattr(self, name)) for name in _LISTS}
        if len(set(lengths.values())) > 1 or next(iter(lengths.values())) not in (3, 6):
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(
                f"the lists have different or wrong lengths ({listed}); give all of them 3 elements [x, y, yaw], or all 6"
            )
        return self

    def planar(self, name: str) -> tuple[float, float, float]:
        """Return x, y and yaw of one of the lists."""
        values: list[float] = getattr(self, name)
        return (values[0], values[1], values[2] if len(values) == 3 else values[5])
