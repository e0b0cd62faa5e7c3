"""The robot's body as the kernels take it: limits and errors per physics step, computed from the parameters."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, Twist2D
from navstack.kinematics import DifferentialDrive, MecanumDrive, OmniDrive, WheelDrive
from navstack.parameters.models.body import MAX_CAR_ANGLE
from navstack.parameters.models.sim import SimParams

INTEGRATIONS: Final = {"rk2": 0, "exact": 1, "euler": 2}
"""Numbers of the methods in the kernels."""

BODY: Final = np.dtype(
    [
        ("dt", "f8"),  # length of a physics step, s
        (
            "max_change",
            "f8",
            (3,),
        ),  # maximum change of vx, vy and wz (a steered base: of the steering angle) per step; inf: unlimited
        ("max_jerk", "f8", (3,)),  # maximum difference of that change between consecutive steps; inf: unlimited
        ("lag_factor", "f8"),  # share of the velocity error that remains after a step: exp(-dt / lag), 0 without lag
        ("steering_lag_factor", "f8"),  # the same for the steering angle
        ("wheelbase", "f8"),  # of a steered base, m; 0: not steered
        ("front_drive", "?"),  # driven at the steered wheel
        ("radius", "f8"),  # circumscribed radius of the footprint, m
        ("fixed_yaw", "f8"),  # yaw of a footprint that does not rotate with the robot, rad; NaN: it rotates
        ("odometry_scale", "f8"),  # systematic relative error of the odometry's distances
        ("odometry_turn", "f8"),  # systematic error of the odometry's heading, rad/m
        ("moving_obstacles", "?"),  # the solids may move between two calls
        ("wheels", "i8"),  # number of wheels; 0: the base executes velocities
        ("to_wheels", "f8", (12,)),  # row by row (n, 3): velocities of the rims from vx, vy, wz
        ("from_wheels", "f8", (12,)),  # row by row (3, 4): vx, vy, wz from the rims
        ("radius_errors", "f8", (4,)),  # relative errors of the true radii
        ("max_rim_speed", "f8"),  # m/s; inf: unlimited
        ("max_rim_change", "f8"),  # maximum change of a rim's velocity per step, m/s; inf: unlimited
        ("metres_per_tick", "f8"),  # of the encoders; 0: continuous
        ("integration", "i8"),  # of the odometry: `_body_kernels.RK2`, EXACT or EULER
    ],
    align=True,
)
"""Element type of the kernels' body settings."""


def body_settings(
    params: SimParams, footprint: Footprint, start_yaw: float, *, moving_obstacles: bool
) -> NDArray[np.void]:
    """Returns the body of a robot as an array (1,) of type `BODY`; `start_yaw` (rad) is its yaw at the start."""
    dt = 1.0 / params.physics_frequency
    steered = params.is_steered
    steering_lag = params.velocity_lag if params.steering_lag is None else params.steering_lag
    limits = (params.acc_lim_x, params.acc_lim_y, params.max_steering_rate if steered else params.acc_lim_theta)
    jerks = (params.jerk_lim_x, params.jerk_lim_y, None if steered else params.jerk_lim_theta)
    settings = np.zeros(1, BODY)
    values: dict[str, Any] = {
        "dt": dt,
        "max_change": [math.inf if limit is None else limit * dt for limit in limits],
        "max_jerk": [math.inf if jerk is None else jerk * dt * dt for jerk in jerks],
        "lag_factor": _remaining(dt, params.velocity_lag),
        "steering_lag_factor": _remaining(dt, steering_lag),
        "wheelbase": params.wheelbase if steered else 0.0,
        "front_drive": params.kinematics == "tricycle",
        "radius": footprint.circumscribed_radius,
        # the corners of a polygon that approximates a circle must not collide: it does not rotate with the robot
        "fixed_yaw": start_yaw if footprint.is_round else math.nan,
        "odometry_scale": params.odometry_scale,
        "odometry_turn": params.odometry_turn,
        "moving_obstacles": moving_obstacles,
    }
    values |= _wheel_values(params, dt)
    for name, value in values.items():
        settings[name] = value
    return settings


def wheel_drive(params: SimParams) -> WheelDrive | None:
    """Returns the kinematics of the wheels; None for a base without. Raises InputError for impossible positions."""
    p = params.wheels
    match p.drive:
        case "differential":
            return DifferentialDrive(p.separation)
        case "omni":
            return OmniDrive(p.circle_radius, p.angles)
        case "mecanum":
            return MecanumDrive(p.wheelbase, p.separation)
        case _:
            return None


def _wheel_values(params: SimParams, dt: float) -> dict[str, Any]:
    """Returns the fields of `BODY` that describe the wheels."""
    drive, p = wheel_drive(params), params.wheels
    to_wheels, from_wheels, errors = np.zeros((4, 3)), np.zeros((3, 4)), np.zeros(4)
    if drive is not None:
        n = len(drive.names)
        to_wheels[:n], from_wheels[:, :n] = drive.matrix, drive.inverse
        listed = p.radius_errors[:n]
        errors[: len(listed)] = listed
    return {
        "wheels": 0 if drive is None else len(drive.names),
        "to_wheels": to_wheels.ravel(),
        "from_wheels": from_wheels.ravel(),
        "radius_errors": errors,
        "max_rim_speed": math.inf if p.max_speed is None else p.max_speed * p.radius,
        "max_rim_change": math.inf if p.max_acceleration is None else p.max_acceleration * p.radius * dt,
        "metres_per_tick": p.metres_per_tick,
        "integration": INTEGRATIONS[p.integration] if drive is not None else INTEGRATIONS["rk2"],
    }


def _remaining(dt: float, lag: float) -> float:
    """Returns the share of an error that a first-order lag (s) leaves after `dt` (s)."""
    return math.exp(-dt / lag) if lag > 0.0 else 0.0


def steered_command(params: SimParams, twist: Twist2D, last: float) -> tuple[float, float]:
    """Returns the velocity of the driven wheels (m/s) and the steering angle (rad) for a command to a steered base.

    The angle is atan(wheelbase w / v), within its limits, as in ROS's Ackermann and tricycle controllers. The sign of v is
    included: in reverse, the same turning rate needs the opposite angle. A command to stop leaves the wheel at its angle
    `last`. A tricycle's front wheel rolls at v / cos(angle); where it can turn by pi / 2, a command to turn in place turns it so
    and rolls it at wheelbase |w|.
    """
    limit = params.steering_limit
    v, w = twist.vx, twist.wz
    tricycle = params.kinematics == "tricycle"
    if params.steering_command == "angle":
        angle = w
    elif v == 0.0:
        if tricycle and w != 0.0 and limit > MAX_CAR_ANGLE:
            return params.wheelbase * abs(w), math.copysign(limit, w)
        return 0.0, last
    else:
        angle = math.atan(params.wheelbase * w / v)
    angle = min(max(angle, -limit), limit)
    # the command of a steering angle gives the velocity of the driven wheel itself
    if tricycle and params.steering_command == "yaw_rate":
        v /= math.cos(angle)
    return v, angle
