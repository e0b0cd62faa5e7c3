"""The robot's body: velocities, wheels, pose, odometry and collisions, in physics steps.

`BODY` describes it, `BodyState` is its state, and one call of `drive` runs many steps.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import DifferentialDrive, Footprint, MecanumDrive, OmniDrive, Twist2D, WheelDrive, kernel
from navstack.parameters import MAX_CAR_ANGLE, SimParams
from navstack.sim.collision import choose_solids, distance_to_solid, find_collision, solid_collision
from navstack.sim.solids import SolidGeometry, place_polygons, polygon_to_polygon

INTEGRATIONS: Final = {"rk2": 0, "exact": 1, "euler": 2}
"""Numbers of the methods in the kernels."""

BODY: Final = np.dtype(
    [
        ("dt", "f8"),  # length of a physics step, s
        # maximum change of vx, vy and wz (a steered base: of the steering angle) per step; inf: unlimited
        ("max_change", "f8", (3,)),
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
        ("meters_per_tick", "f8"),  # of the encoders; 0: continuous
        ("integration", "i8"),  # of the odometry: RK2, EXACT or EULER
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
        "meters_per_tick": p.meters_per_tick,
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


class BodyState(NamedTuple):
    """The state of the body after a step, as floats; the kernels take it, and the wheels', as a record of type `STATE`.

    Of a steered base, `command_vx` is the velocity of the driven wheels and `command_wz` the steering angle (rad).
    """

    x: float
    """True pose in the map (m, rad)."""
    y: float
    yaw: float
    vx: float
    """Velocity by the wheels (m/s, rad/s)."""
    vy: float
    wz: float
    lagged_vx: float
    """Output of the lag of the velocity controller."""
    lagged_vy: float
    lagged_wz: float
    change_vx: float
    """Change of the velocity in the last step; `change_wz` of a steered base: of the steering angle."""
    change_vy: float
    change_wz: float
    odom_x: float
    """Odometry in its frame (m, rad)."""
    odom_y: float
    odom_yaw: float
    distance: float
    """Travelled (m)."""
    collided: float
    """1 from a collision until the robot has left it."""
    hit_x: float
    """Pose at that collision (m, rad)."""
    hit_y: float
    hit_yaw: float
    overrun: float
    """1 while a moving obstacle overlaps the robot."""
    steering: float
    """Steering angle (rad)."""
    lagged_steering: float
    """Output of the lag of its controller (rad)."""
    traction: float
    """Velocity of a driven and steered front wheel (m/s)."""
    command_vx: float
    """The command in force."""
    command_vy: float
    command_wz: float


STATE: Final = np.dtype(
    [
        *((name, "f8") for name in BodyState._fields),
        ("rim", "f8", (4,)),  # velocities of the wheels' rims, m/s
        ("way", "f8", (4,)),  # ways of the rims since the start, m
        ("ticks", "f8", (4,)),  # counts of the encoders
        ("target", "f8", (4,)),  # velocities that the rims should have, m/s
    ]
)
"""Element type of the kernels' state."""

# columns of the samples that `drive` writes
TRUE_POSE, ODOMETRY, VELOCITY = 0, 3, 6  # three columns each
IN_COLLISION = 9  # 1 while the robot is in collision
OVERRUN_HIT, DRIVEN_HIT = 10, 11  # what a new collision of the step hit (as `find_collision`), -1 for none
SAMPLE_SIZE = 12


# --- wheels ----------------------------------------------------------------------------------------------------------
# The velocities of the rims (m/s) are a linear function of those of the base, and the base's the least-squares solution for
# given rims (`navstack.core.kinematics`).


@kernel
def limit_wheels(state, body):
    """Limits the speed and the acceleration of every wheel; updates the velocity of the base.

    One factor for the speeds keeps the base on its arc. Accelerations are limited wheel by wheel, as motors are.
    """
    fastest = 0.0
    for i in range(body.wheels):
        rim = (
            body.to_wheels[3 * i] * state.vx
            + body.to_wheels[3 * i + 1] * state.vy
            + body.to_wheels[3 * i + 2] * state.wz
        )
        state.target[i] = rim
        fastest = max(fastest, abs(rim))
    factor = body.max_rim_speed / fastest if fastest > body.max_rim_speed else 1.0
    vx, vy, wz = 0.0, 0.0, 0.0
    for i in range(body.wheels):
        change = factor * state.target[i] - state.rim[i]
        state.rim[i] += min(max(change, -body.max_rim_change), body.max_rim_change)
        vx += body.from_wheels[i] * state.rim[i]
        vy += body.from_wheels[4 + i] * state.rim[i]
        wz += body.from_wheels[8 + i] * state.rim[i]
    state.vx, state.vy, state.wz = vx, vy, wz


@kernel
def true_motion(state, body):
    """Displacement of one step (dx, dy, dyaw) in the robot's frame, with the true radii of the wheels."""
    mx, my, mz = 0.0, 0.0, 0.0
    for i in range(body.wheels):
        way = body.dt * state.rim[i] * (1.0 + body.radius_errors[i])
        mx += body.from_wheels[i] * way
        my += body.from_wheels[4 + i] * way
        mz += body.from_wheels[8 + i] * way
    return mx, my, mz


@kernel
def counted_motion(state, body, moved, turned):
    """Displacement (dx, dy, dyaw) in the robot's frame that the encoders count in one step.

    `moved` and `turned` are the shares of the step's translation and rotation before a collision.
    """
    ox, oy, oz = 0.0, 0.0, 0.0
    for i in range(body.wheels):
        way = body.dt * (
            moved * (body.to_wheels[3 * i] * state.vx + body.to_wheels[3 * i + 1] * state.vy)
            + turned * body.to_wheels[3 * i + 2] * state.wz
        )
        state.way[i] += way
        if body.meters_per_tick > 0.0:
            ticks = math.floor(state.way[i] / body.meters_per_tick)
            way = (ticks - state.ticks[i]) * body.meters_per_tick
            state.ticks[i] = ticks
        ox += body.from_wheels[i] * way
        oy += body.from_wheels[4 + i] * way
        oz += body.from_wheels[8 + i] * way
    return ox, oy, oz


@kernel
def stop_wheels(state, body):
    """Sets the rims to the velocity of the base, after a collision has changed it."""
    for i in range(body.wheels):
        state.rim[i] = (
            body.to_wheels[3 * i] * state.vx
            + body.to_wheels[3 * i + 1] * state.vy
            + body.to_wheels[3 * i + 2] * state.wz
        )


@kernel
def chord(turn):
    """Length of the chord of an arc that turns by `turn` (rad), as a share of its length."""
    half = 0.5 * turn
    return math.sin(half) / half if abs(half) > 1e-9 else 1.0


# --- motion ----------------------------------------------------------------------------------------------------------
# Motion over a step of dt at constant (vx, vy, wz): the displacement is taken along the heading at half of the step,
# x += dt (vx cos(yaw + wz dt / 2) - vy sin(..)), yaw += wz dt (second-order Runge-Kutta).


# integration of the odometry
RK2, EXACT, EULER = 0, 1, 2
# maximum motion of any footprint point between two collision tests, m
SWEEP_STEP = 0.005
# a collision ends once a point of the footprint has moved this far, m
RELEASE = 0.02
# tolerance for rounding: motion tangential to an overlapping obstacle does not approach it, m
TANGENT = 1e-9
# solids beyond this distance from where they were last chosen are ignored, m
HORIZON = 1.0


@kernel
def wrapped(angle):
    """Normalizes `angle` (rad), at most one turn outside, to (-pi, pi]."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    if angle <= -math.pi:
        return angle + 2.0 * math.pi
    return angle


@kernel
def jerk_limited(error, last, jerk):
    """The next change of a velocity whose total change is `error`, if consecutive changes differ by at most `jerk`.

    It is the largest change from which the velocity still reaches its target without overshoot: in units of `jerk`, with
    integer m and 0 <= f < 1, the changes m + f, m - 1 + f, .., f add up to (m + 1) (f + m / 2). Setting this equal to the error
    gives m and f. An acceleration in the wrong direction is reduced first.
    """
    steps = abs(error) / jerk
    m = math.floor(0.5 * (math.sqrt(8.0 * steps + 1.0) - 1.0))
    wanted = math.copysign(jerk * (m + steps / (m + 1.0) - 0.5 * m), error) if m > 0 else error
    return min(max(wanted, last - jerk), last + jerk)


@kernel
def approach(now, target, lagged, last, lag, max_change, max_jerk):
    """One velocity (or steering angle) a step nearer to its target: the new value, the lag's output and the change.

    `last` is the change of the step before; `lag` the share of the error that remains after a step.
    """
    lagged = target + lag * (lagged - target)
    change = lagged - now
    if max_jerk < math.inf:
        change = jerk_limited(change, last, max_jerk)
    change = min(max(change, -max_change), max_change)
    return now + change, lagged, change


@kernel
def accelerate(state, body):
    """Updates the velocities (and the steering angle) by one step: lag, then the acceleration and jerk limits."""
    lag, most, jerk = body.lag_factor, body.max_change, body.max_jerk
    # the steering angle first: a driven front wheel depends on it
    if body.wheelbase > 0.0:
        now, lagged, change = approach(
            state.steering,
            state.command_wz,
            state.lagged_steering,
            state.change_wz,
            body.steering_lag_factor,
            most[2],
            jerk[2],
        )
        state.steering, state.lagged_steering, state.change_wz = now, lagged, change
    else:
        now, lagged, change = approach(
            state.wz, state.command_wz, state.lagged_wz, state.change_wz, lag, most[2], jerk[2]
        )
        state.wz, state.lagged_wz, state.change_wz = now, lagged, change
    now, lagged, change = approach(state.vy, state.command_vy, state.lagged_vy, state.change_vy, lag, most[1], jerk[1])
    state.vy, state.lagged_vy, state.change_vy = now, lagged, change
    target = state.command_vx
    if body.front_drive:
        # drives slower while its wheel still turns, so that it does not leave the arc
        target *= max(math.cos(state.command_wz - state.steering), 0.0)
    now = state.traction if body.front_drive else state.vx
    now, lagged, change = approach(now, target, state.lagged_vx, state.change_vx, lag, most[0], jerk[0])
    state.lagged_vx, state.change_vx = lagged, change
    if body.front_drive:
        state.traction = now
        state.vx = now * math.cos(state.steering)
        state.wz = now * math.sin(state.steering) / body.wheelbase
    else:
        state.vx = now
        if body.wheelbase > 0.0:
            # at the center of the rear axle: steering angle and wheelbase determine the circle
            state.wz = now * math.tan(state.steering) / body.wheelbase
    if body.wheels > 0:
        limit_wheels(state, body)


@kernel
def separate_overlapping(state, body, footprint, solids, chosen, count, placed):
    """Moves the numbers of the solids that overlap the robot to the end of `chosen`; returns how many do not overlap."""
    yaw = state.yaw if math.isnan(body.fixed_yaw) else body.fixed_yaw
    c, s = math.cos(yaw), math.sin(yaw)
    clear = 0
    for k in range(count):
        if not solid_collision(solids, chosen[k], footprint, body.radius, state.x, state.y, c, s, placed):
            chosen[clear], chosen[k] = chosen[k], chosen[clear]
            clear += 1
    return clear


@kernel
def approaches(state, solids, chosen, first, last, dx, dy):
    """True if the displacement moves the robot's center towards one of the solids `chosen[first:last]`."""
    for k in range(first, last):
        now = distance_to_solid(solids, chosen[k], state.x, state.y)
        if distance_to_solid(solids, chosen[k], state.x + dx, state.y + dy) < now - TANGENT:
            return True
    return False


@kernel
def odometry_errors(body, noise, step, ox, oy, oz):
    """The displacement (dx, dy, dyaw) that the odometry reports for one that its wheels have made."""
    if noise.shape[0] > 0:
        root = math.sqrt(math.hypot(ox, oy))
        ox, oy, oz = ox * (1.0 + noise[step, 3]), oy * (1.0 + noise[step, 4]), oz * (1.0 + noise[step, 5])
        oz += root * noise[step, 7]
    if body.odometry_scale != 0.0 or body.odometry_turn != 0.0:
        oz += body.odometry_turn * ox
        ox, oy = ox * (1.0 + body.odometry_scale), oy * (1.0 + body.odometry_scale)
    return ox, oy, oz


@kernel
def step_motion(state, body, noise, step):
    """Displacements of one step in the robot's frame: true dx, dy, dyaw, then those that the odometry reports."""
    mx, my, mz = body.dt * state.vx, body.dt * state.vy, body.dt * state.wz
    ox, oy, oz = mx, my, mz
    if body.wheels > 0:
        mx, my, mz = true_motion(state, body)
    if noise.shape[0] > 0:
        root = math.sqrt(math.hypot(mx, my))
        mx, my, mz = mx * (1.0 + noise[step, 0]), my * (1.0 + noise[step, 1]), mz * (1.0 + noise[step, 2])
        mz += root * noise[step, 6]
    ox, oy, oz = odometry_errors(body, noise, step, ox, oy, oz)
    return mx, my, mz, ox, oy, oz


@kernel
def stop_or_release(state, body, rotates, blocked, hit):
    """Stops the wheels of a blocked robot and ends a collision that it has left; returns whether a collision began."""
    if blocked:
        state.vx = state.lagged_vx = state.change_vx = 0.0
        state.vy = state.lagged_vy = state.change_vy = 0.0
        if rotates:
            state.wz = state.lagged_wz = state.change_wz = 0.0
        state.traction = 0.0
        if hit != -1 and state.collided == 0.0:
            state.collided = 1.0
            state.hit_x, state.hit_y, state.hit_yaw = state.x, state.y, state.yaw
            return True
    elif state.collided != 0.0:
        turned = abs(wrapped(state.yaw - state.hit_yaw))
        if math.hypot(state.x - state.hit_x, state.y - state.hit_y) + body.radius * turned > RELEASE:
            state.collided = 0.0
    return False


@kernel
def drive(states, settings, footprint, steps, noise, squares, grid, discs, circles, corners, first, samples):
    """Runs `steps` physics steps; returns the number of new collisions.

    `states` (1,) of type `STATE`, with the command in it, is updated. `settings` (1,) of type `BODY`, `footprint` (n, 2) its
    outline (m). `noise` (steps or 0, 8): relative errors of the true motion vx, vy, wz and of the odometry's against the
    wheels', then the drift of both headings per square root of a meter (rad). `squares` (4, ny, nx), `grid` [origin x, origin
    y, origin yaw, resolution]: the map; `discs` .. `first`: the solids, as in `SolidGeometry` (numba unboxes single arrays
    faster than a NamedTuple). `samples` (>= steps, SAMPLE_SIZE) receives the state after each step.
    """
    state, body = states[0], settings[0]
    solids = SolidGeometry(discs, circles, corners, first)
    radius = body.radius
    rotates_footprint = math.isnan(body.fixed_yaw)
    # a round robot that is blocked can still turn in place; a steered base turns only as it rolls
    rotates = rotates_footprint or body.wheelbase > 0.0
    hits = 0
    placed = np.empty((footprint.shape[0], 2))
    chosen = np.empty(discs.shape[0] + circles.shape[0], np.int64)
    count = choose_solids(solids, state.x, state.y, radius + HORIZON, chosen)
    chosen_x, chosen_y = state.x, state.y
    overlapping, struck, overrun_hit = 0, False, -1
    if body.moving_obstacles:
        # an obstacle that moves over the robot stops it; then the robot may turn, and drive away from the obstacle
        clear = separate_overlapping(state, body, footprint, solids, chosen, count, placed)
        overlapping, count = count - clear, clear
        struck = overlapping > 0 and state.overrun == 0.0
        if struck and state.collided == 0.0:
            overrun_hit = -2 - chosen[clear]
            hits += 1
        state.overrun = 1.0 if overlapping > 0 else 0.0
    for step in range(steps):
        samples[step, OVERRUN_HIT] = overrun_hit if step == 0 else -1
        samples[step, DRIVEN_HIT] = -1
        accelerate(state, body)
        mx, my, mz, ox, oy, oz = step_motion(state, body, noise, step)
        c, s = math.cos(state.yaw + 0.5 * mz), math.sin(state.yaw + 0.5 * mz)
        if body.wheels > 0:
            mx, my = chord(mz) * mx, chord(mz) * my
        dx, dy = c * mx - s * my, s * mx + c * my
        length = math.hypot(dx, dy)
        moved = length + radius * abs(mz)
        if moved > 0.0:
            held = struck or approaches(state, solids, chosen, count, count + overlapping, dx, dy)
            if overlapping == 0 and math.hypot(state.x + dx - chosen_x, state.y + dy - chosen_y) + length > HORIZON:
                count = choose_solids(solids, state.x, state.y, radius + length + HORIZON, chosen)
                chosen_x, chosen_y = state.x, state.y
            # swept collision test: every SWEEP_STEP along the motion
            parts = math.ceil(moved / SWEEP_STEP)
            hit = -1
            free = 0
            for part in range(1, 1 if held else parts + 1):
                f = part / parts
                x, y, yaw = state.x + f * dx, state.y + f * dy, state.yaw + f * mz
                if not rotates_footprint:
                    yaw = body.fixed_yaw
                hit = find_collision(squares, grid, solids, chosen, count, footprint, radius, x, y, yaw, placed)
                if hit != -1:
                    break
                free = part
            f = free / parts
            g = f if rotates else 1.0
            state.x += f * dx
            state.y += f * dy
            state.yaw = wrapped(state.yaw + g * mz)
            state.distance += f * length
            if body.wheels > 0:
                counted = counted_motion(state, body, f, g)
                ox, oy, oz = odometry_errors(body, noise, step, counted[0], counted[1], counted[2])
                f, g = chord(oz) if body.integration == EXACT else 1.0, 1.0
            middle = state.odom_yaw + (0.0 if body.integration == EULER else 0.5 * oz)
            c, s = math.cos(middle), math.sin(middle)
            state.odom_x += f * (c * ox - s * oy)
            state.odom_y += f * (s * ox + c * oy)
            state.odom_yaw = wrapped(state.odom_yaw + g * oz)
            if stop_or_release(state, body, rotates, hit != -1 or held, hit):
                samples[step, DRIVEN_HIT] = hit
                hits += 1
            if body.wheels > 0 and (hit != -1 or held):
                stop_wheels(state, body)
        row = samples[step]
        row[TRUE_POSE], row[TRUE_POSE + 1], row[TRUE_POSE + 2] = state.x, state.y, state.yaw
        row[ODOMETRY], row[ODOMETRY + 1], row[ODOMETRY + 2] = state.odom_x, state.odom_y, state.odom_yaw
        row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2] = state.vx, state.vy, state.wz
        row[IN_COLLISION] = max(state.collided, state.overrun)
    return hits


# --- several robots --------------------------------------------------------------------------------------------------


class Outlines(NamedTuple):
    """The footprints of several robots, in their own frames, as `place_polygons` takes them."""

    corners: NDArray[np.float64]
    """(m, 2) of all footprints, concatenated (m)."""
    first: NDArray[np.int64]
    """(n + 1,) index of each footprint's first corner."""
    centers: NDArray[np.float64]
    """(n, 3) x, y, radius of a bounding circle of each."""


# columns of what is nearest to a robot
NEAREST_M, NEAREST_ROBOT, NEAREST_STEP = 0, 1, 2


@kernel
def place_bodies(states, settings, outlines):
    """Corners (m, 2) and bounding circles (n, 3) of the footprints of n robots in the map (m)."""
    poses = np.empty((states.shape[0], 3))
    for i in range(states.shape[0]):
        fixed = settings[i].fixed_yaw
        poses[i, 0], poses[i, 1] = states[i].x, states[i].y
        poses[i, 2] = states[i].yaw if math.isnan(fixed) else fixed
    return place_polygons(outlines.corners, outlines.first, outlines.centers, poses)


@kernel
def note_nearest(bodies, circles, first, nearest, step):
    """Updates the smallest distance of every robot from another one, which robot that is, and the step: `nearest` (n, 3)."""
    n = circles.shape[0]
    for i in range(n):
        for j in range(i + 1, n):
            dx, dy = circles[i, 0] - circles[j, 0], circles[i, 1] - circles[j, 1]
            reach = max(nearest[i, NEAREST_M], nearest[j, NEAREST_M]) + circles[i, 2] + circles[j, 2]
            if dx * dx + dy * dy >= reach * reach:
                continue
            away = polygon_to_polygon(bodies[first[i] : first[i + 1]], bodies[first[j] : first[j + 1]])
            if away < nearest[i, NEAREST_M]:
                nearest[i, NEAREST_M], nearest[i, NEAREST_ROBOT], nearest[i, NEAREST_STEP] = away, j, step
            if away < nearest[j, NEAREST_M]:
                nearest[j, NEAREST_M], nearest[j, NEAREST_ROBOT], nearest[j, NEAREST_STEP] = away, i, step


@kernel
def drive_together(states, settings, outlines, noise, squares, grid, solids, samples, nearest, step):
    """Runs the physics steps of n robots together; returns the number of new collisions of each (n,).

    In every step, each robot moves among the others as they were before the step, so that their order does not matter.
    `states` (n,), `settings` (n,): as in `drive`; `outlines`: the footprints; `noise` (n, steps or 0, 8); `solids`: the
    `SolidGeometry` of all other obstacles; `samples` (n, steps, SAMPLE_SIZE); `nearest` (n, 3): see `note_nearest`; `step`: the
    number of the first step. Robots count as solids behind all others, each by its own number.
    """
    n, steps = samples.shape[0], samples.shape[1]
    hits = np.zeros(n, np.int64)
    still, cornered = solids.circles.shape[0], solids.corners.shape[0]
    known = solids.discs.shape[0] + still
    circles = np.empty((still + n, 3))
    corners = np.empty((cornered + outlines.corners.shape[0], 2))
    first = np.empty(still + n + 1, np.int64)
    circles[:still], corners[:cornered], first[: still + 1] = solids.circles, solids.corners, solids.first
    others = np.empty(n, np.int64)
    bodies, rounds = place_bodies(states, settings, outlines)
    for k in range(steps):
        for i in range(n):
            count, end = 0, cornered
            for j in range(n):
                dx, dy = rounds[j, 0] - states[i].x, rounds[j, 1] - states[i].y
                far = settings[i].radius + HORIZON + rounds[j, 2]
                if j == i or dx * dx + dy * dy >= far * far:
                    continue
                size = outlines.first[j + 1] - outlines.first[j]
                circles[still + count] = rounds[j]
                corners[end : end + size] = bodies[outlines.first[j] : outlines.first[j + 1]]
                end += size
                others[count] = j
                count += 1
                first[still + count] = end
            hits[i] += drive(
                states[i : i + 1],
                settings[i : i + 1],
                outlines.corners[outlines.first[i] : outlines.first[i + 1]],
                1,
                noise[i, k : k + 1],
                squares,
                grid,
                solids.discs,
                circles[: still + count],
                corners[:end],
                first[: still + count + 1],
                samples[i, k : k + 1],
            )
            for column in (OVERRUN_HIT, DRIVEN_HIT):
                hit = samples[i, k, column]
                if hit <= -2 - known:
                    samples[i, k, column] = -2 - known - others[int(-2 - hit) - known]
        bodies, rounds = place_bodies(states, settings, outlines)
        note_nearest(bodies, rounds, outlines.first, nearest, step + k)
    return hits


_NONE = np.empty((0, 8))


class DriveNoise:
    """Draws the errors of physics steps, as the kernel `drive` takes them."""

    def __init__(self, params: SimParams, seed: int) -> None:
        self._params = params
        self._frequency = params.physics_frequency
        self._turns = params.wheel_slip_turn > 0.0 or params.odometry_noise_turn > 0.0
        self._any = params.wheel_slip > 0.0 or params.odometry_noise > 0.0 or self._turns
        self._heading_rng = np.random.Generator(np.random.PCG64([seed, 1 << 24]))
        self._rng = np.random.Generator(np.random.PCG64([seed, 0]))

    def of(self, steps: int) -> NDArray[np.float64]:
        """Return errors per step, (steps, 8), or (0, 8) without any.

        The variances of the relative errors over one second add up to the square of the parameter.
        """
        if not self._any:
            return _NONE
        noise = np.zeros((steps, 8))
        relative = self._rng.standard_normal((steps, 6)) * math.sqrt(self._frequency)
        noise[:, :3] = relative[:, :3] * self._params.wheel_slip
        noise[:, 3:6] = relative[:, 3:] * self._params.odometry_noise
        if self._turns:
            sigmas = self._params.wheel_slip_turn, self._params.odometry_noise_turn
            noise[:, 6:] = self._heading_rng.standard_normal((steps, 2)) * sigmas
        return noise
