"""The robot's body as the kernels take it: from parameters and an outline to numbers per physics step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, Twist2D
from navstack.parameters.models.sim import SimParams


class BodyModel(NamedTuple):
    """What of a robot does not change while it drives."""

    limits: NDArray[np.float64]
    """(3,) most change of vx, vy and wz (a car: of the steering angle) in a step; inf: any."""
    jerks: NDArray[np.float64]
    """(3,) most change of that change from step to step; inf: any."""
    bias: NDArray[np.float64]
    """(2,) systematic errors of the odometry: relative, and turns (rad) for every metre."""
    keep: float
    """Share of the velocity error that the lag leaves after a step: exp(-dt / lag), 0 without one."""
    wheelbase: float
    """Of a car (m); 0: not a car."""
    footprint: NDArray[np.float64]
    """(n, 2) outline (m) in the robot's frame."""
    radius: float
    """Circumscribed, m."""
    facing: float
    """Direction (rad) of a footprint that does not turn with the robot, NaN for one that does."""


def body_model(params: SimParams, footprint: Footprint, yaw: float) -> BodyModel:
    """The body of a robot that starts facing `yaw` (rad)."""
    dt = 1.0 / params.physics_frequency
    car = params.kinematics == "ackermann"
    limits = (params.acc_lim_x, params.acc_lim_y, params.max_steering_rate if car else params.acc_lim_theta)
    jerks = (params.jerk_lim_x, params.jerk_lim_y, None if car else params.jerk_lim_theta)
    return BodyModel(
        limits=np.array([math.inf if limit is None else limit * dt for limit in limits]),
        jerks=np.array([math.inf if jerk is None else jerk * dt * dt for jerk in jerks]),
        bias=np.array([params.odometry_scale, params.odometry_turn]),
        keep=math.exp(-dt / params.velocity_lag) if params.velocity_lag > 0.0 else 0.0,
        wheelbase=params.wheelbase if car else 0.0,
        footprint=footprint.vertices.copy(),  # the kernels are compiled for arrays that may be written to
        radius=footprint.circumscribed_radius,
        # the corners of a polygon that stands for a circle must not catch: it does not turn with the robot
        facing=yaw if is_round(footprint) else math.nan,
    )


def steering(params: SimParams, twist: Twist2D, last: float) -> float:
    """The steering angle (rad) that a command asks of a car, within its limits; `last` is the one it asked before.

    atan(wheelbase w / v), as ROS's Ackermann controllers have it. The sign of v is in it: backwards, the same turning rate
    needs the opposite angle. A command to stand leaves the wheels as they are.
    """
    if params.steering_command == "angle":
        wanted = twist.wz
    elif twist.vx == 0.0:
        return last
    else:
        wanted = math.atan(params.wheelbase * twist.wz / twist.vx)
    return min(max(wanted, -params.steering_limit), params.steering_limit)


def is_round(footprint: Footprint) -> bool:
    """True for the polygon of a radius."""
    circle = Footprint.from_radius(footprint.circumscribed_radius).vertices
    return footprint.vertices.shape == circle.shape and bool(
        np.allclose(footprint.vertices, circle, rtol=0.0, atol=1e-9)
    )
