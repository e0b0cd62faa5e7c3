"""Parameters of the body of the simulated robot: kinematics and limits."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import model_validator

from navstack.core.parameters import ParamModel, param

MAX_CAR_ANGLE = 0.5 * math.pi - 1e-6
"""Steering angles above this (rad) count as a quarter turn: only a base driven at its steered wheel moves then."""


class BodyParams(ParamModel):
    """The body of the simulated robot: kinematics, and limits of velocity and steering."""

    kinematics: Literal["differential", "holonomic", "ackermann", "tricycle"] = param(
        "differential",
        "differential: no sideways motion; holonomic: motion in every direction; ackermann: a car, driven at its rear axle, "
        "which is its centre: the yaw rate of a command sets the steering angle, and it cannot turn in place; tricycle: "
        "steered and driven at its single front wheel, its centre on the rear axle",
    )
    physics_frequency: float = param(
        50.0, "frequency of the simulation steps of the body", unit="Hz", gt=0.0, le=10_000.0
    )
    acc_lim_x: float | None = param(
        None, "maximum forward acceleration (tricycle: of the front wheel); none: unlimited", unit="m/s²", gt=0.0
    )
    acc_lim_y: float | None = param(None, "maximum sideways acceleration; none: unlimited", unit="m/s²", gt=0.0)
    acc_lim_theta: float | None = param(None, "maximum angular acceleration; none: unlimited", unit="rad/s²", gt=0.0)
    jerk_lim_x: float | None = param(
        None,
        "maximum forward jerk; none: unlimited. Observed where the command allows; the velocity does not overshoot a constant "
        "command",
        unit="m/s³",
        gt=0.0,
    )
    jerk_lim_y: float | None = param(None, "maximum sideways jerk; none: unlimited", unit="m/s³", gt=0.0)
    jerk_lim_theta: float | None = param(
        None, "maximum angular jerk; none: unlimited; not used by ackermann and tricycle", unit="rad/s³", gt=0.0
    )
    wheelbase: float = param(
        0.5, "ackermann, tricycle: distance from the rear axle to the front wheels", unit="m", gt=0.0
    )
    max_steering_angle: float = param(
        0.6,
        "ackermann, tricycle: maximum angle of the (centre) front wheel, in both directions; a tricycle whose wheel turns by "
        "pi / 2 can turn in place",
        unit="rad",
        gt=0.0,
        le=0.5 * math.pi,
    )
    max_steering_rate: float | None = param(
        None, "ackermann, tricycle: maximum rate of the steering angle; none: unlimited", unit="rad/s", gt=0.0
    )
    steering_lag: float | None = param(
        None,
        "ackermann, tricycle: time constant of the controller of the steering angle; none: velocity_lag",
        unit="s",
        ge=0.0,
    )
    min_turning_radius: float = param(
        0.0,
        "ackermann, tricycle: minimum turning radius of the rear axle's centre, if larger than wheelbase / "
        "tan(max_steering_angle)",
        unit="m",
        ge=0.0,
    )
    steering_command: Literal["yaw_rate", "angle"] = param(
        "yaw_rate",
        "ackermann, tricycle: meaning of the angular part of a command. yaw_rate: the yaw rate w, which gives the steering "
        "angle atan(wheelbase * w / v); a stopped base keeps its steering angle. angle: the steering angle; the "
        "linear part is then the velocity of the driven wheels",
    )

    @model_validator(mode="after")
    def _check_steering(self) -> BodyParams:
        if self.kinematics == "ackermann" and self.max_steering_angle > MAX_CAR_ANGLE:
            raise ValueError(
                f"max_steering_angle = {self.max_steering_angle:g} rad of kinematics ackermann must be less than pi / 2: a car "
                "is driven at its rear axle; use tricycle for a base that is driven at its steered wheel"
            )
        return self

    @property
    def is_steered(self) -> bool:
        """True for a base with a steering angle: `ackermann` and `tricycle`."""
        return self.kinematics in ("ackermann", "tricycle")

    @property
    def steering_limit(self) -> float:
        """Maximum steering angle of a steered base (rad), from `max_steering_angle` and `min_turning_radius`."""
        if self.min_turning_radius <= 0.0:
            return self.max_steering_angle
        return min(self.max_steering_angle, math.atan(self.wheelbase / self.min_turning_radius))

    @property
    def turning_radius(self) -> float:
        """Minimum turning radius of a steered base's rear axle (m); 0 for a base that can turn in place."""
        limit = self.steering_limit
        return self.wheelbase / math.tan(limit) if self.is_steered and limit <= MAX_CAR_ANGLE else 0.0
