# pyright: basic
"""The motion of the robot's body: velocities, pose, odometry, collisions. One call runs many physics steps.

Motion over a step of dt at constant (vx, vy, wz): the displacement is taken along the heading at half of the step,
x += dt (vx cos(yaw + wz dt / 2) - vy sin(..)), yaw += wz dt (second-order Runge-Kutta).
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.sim._body_layout import (
    COLLIDING,
    COMMAND,
    CX,
    CY,
    CYAW,
    DISTANCE,
    DRIVEN_HIT,
    GX,
    IN_COLLISION,
    LSTEER,
    LX,
    ODOMETRY,
    OVERRUN,
    OVERRUN_HIT,
    OX,
    OY,
    OYAW,
    STEER,
    TRACTION,
    TRUE_POSE,
    VELOCITY,
    VX,
    VY,
    WZ,
    YAW,
    X,
    Y,
)
from navstack.sim._collision_kernels import choose_solids, distance_to_solid, find_collision, solid_collision
from navstack.sim._wheel_kernels import chord, counted_motion, limit_wheels, stop_wheels, true_motion
from navstack.sim.solids import SolidGeometry

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
def accelerate(state, body):
    """Updates the velocities (and the steering angle) by one step: lag, then the acceleration and jerk limits."""
    for axis in range(3):
        i = 2 - axis  # the steering angle first: a driven front wheel depends on it
        at, lagged, lag, target = VX + i, LX + i, body.lag_factor, state[COMMAND + i]
        if i == 2 and body.wheelbase > 0.0:
            at, lagged, lag = STEER, LSTEER, body.steering_lag_factor
        elif i == 0 and body.front_drive:
            # drives slower while its wheel still turns, so that it does not leave the arc
            at = TRACTION
            target *= max(math.cos(state[COMMAND + 2] - state[STEER]), 0.0)
        state[lagged] = target + lag * (state[lagged] - target)
        change = state[lagged] - state[at]
        if body.max_jerk[i] < math.inf:
            change = jerk_limited(change, state[GX + i], body.max_jerk[i])
        change = min(max(change, -body.max_change[i]), body.max_change[i])
        state[GX + i] = change
        state[at] += change
    if body.front_drive:
        state[VX] = state[TRACTION] * math.cos(state[STEER])
        state[WZ] = state[TRACTION] * math.sin(state[STEER]) / body.wheelbase
    elif body.wheelbase > 0.0:
        # at the centre of the rear axle: steering angle and wheelbase determine the circle
        state[WZ] = state[VX] * math.tan(state[STEER]) / body.wheelbase
    if body.wheels > 0:
        limit_wheels(state, body)


@kernel
def separate_overlapping(state, body, footprint, solids, chosen, count, placed):
    """Moves the numbers of the solids that overlap the robot to the end of `chosen`; returns how many do not overlap."""
    yaw = state[YAW] if math.isnan(body.fixed_yaw) else body.fixed_yaw
    c, s = math.cos(yaw), math.sin(yaw)
    clear = 0
    for k in range(count):
        if not solid_collision(solids, chosen[k], footprint, body.radius, state[X], state[Y], c, s, placed):
            chosen[clear], chosen[k] = chosen[k], chosen[clear]
            clear += 1
    return clear


@kernel
def approaches(state, solids, chosen, first, last, dx, dy):
    """True if the displacement moves the robot's centre towards one of the solids `chosen[first:last]`."""
    for k in range(first, last):
        now = distance_to_solid(solids, chosen[k], state[X], state[Y])
        if distance_to_solid(solids, chosen[k], state[X] + dx, state[Y] + dy) < now - TANGENT:
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
    mx, my, mz = body.dt * state[VX], body.dt * state[VY], body.dt * state[WZ]
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
        for i in range(3 if rotates else 2):
            state[VX + i] = 0.0
            state[LX + i] = 0.0
            state[GX + i] = 0.0
        state[TRACTION] = 0.0
        if hit != -1 and state[COLLIDING] == 0.0:
            state[COLLIDING] = 1.0
            state[CX], state[CY], state[CYAW] = state[X], state[Y], state[YAW]
            return True
    elif state[COLLIDING] != 0.0:
        turned = abs(wrapped(state[YAW] - state[CYAW]))
        if math.hypot(state[X] - state[CX], state[Y] - state[CY]) + body.radius * turned > RELEASE:
            state[COLLIDING] = 0.0
    return False


@kernel
def drive(state, settings, footprint, steps, noise, squares, grid, discs, circles, corners, first, samples):
    """Runs `steps` physics steps; returns the number of new collisions.

    `state` (STATE_SIZE,), with the command in it, is updated. `settings` (1,) is the body (`body.BODY`), `footprint` (n, 2) its
    outline (m). `noise` (steps or 0, 8): relative errors of the true motion vx, vy, wz and of the odometry's against the
    wheels', then the drift of both headings per square root of a metre (rad). `squares` (4, ny, nx), `grid` [origin x, origin
    y, origin yaw, resolution]: the map; `discs` .. `first`: the solids, as in `SolidGeometry` (numba unboxes single arrays
    faster than a NamedTuple). `samples` (>= steps, SAMPLE_SIZE) receives the state after each step.
    """
    body = settings[0]
    solids = SolidGeometry(discs, circles, corners, first)
    radius = body.radius
    rotates_footprint = math.isnan(body.fixed_yaw)
    # a round robot that is blocked can still turn in place; a steered base turns only as it rolls
    rotates = rotates_footprint or body.wheelbase > 0.0
    hits = 0
    placed = np.empty((footprint.shape[0], 2))
    chosen = np.empty(discs.shape[0] + circles.shape[0], np.int64)
    count = choose_solids(solids, state[X], state[Y], radius + HORIZON, chosen)
    chosen_x, chosen_y = state[X], state[Y]
    overlapping, struck, overrun_hit = 0, False, -1
    if body.moving_obstacles:
        # an obstacle that moves over the robot stops it; then the robot may turn, and drive away from the obstacle
        clear = separate_overlapping(state, body, footprint, solids, chosen, count, placed)
        overlapping, count = count - clear, clear
        struck = overlapping > 0 and state[OVERRUN] == 0.0
        if struck and state[COLLIDING] == 0.0:
            overrun_hit = -2 - chosen[clear]
            hits += 1
        state[OVERRUN] = 1.0 if overlapping > 0 else 0.0
    for step in range(steps):
        samples[step, OVERRUN_HIT] = overrun_hit if step == 0 else -1
        samples[step, DRIVEN_HIT] = -1
        accelerate(state, body)
        mx, my, mz, ox, oy, oz = step_motion(state, body, noise, step)
        c, s = math.cos(state[YAW] + 0.5 * mz), math.sin(state[YAW] + 0.5 * mz)
        if body.wheels > 0:
            mx, my = chord(mz) * mx, chord(mz) * my
        dx, dy = c * mx - s * my, s * mx + c * my
        length = math.hypot(dx, dy)
        moved = length + radius * abs(mz)
        if moved > 0.0:
            held = struck or approaches(state, solids, chosen, count, count + overlapping, dx, dy)
            if overlapping == 0 and math.hypot(state[X] + dx - chosen_x, state[Y] + dy - chosen_y) + length > HORIZON:
                count = choose_solids(solids, state[X], state[Y], radius + length + HORIZON, chosen)
                chosen_x, chosen_y = state[X], state[Y]
            # swept collision test: every SWEEP_STEP along the motion
            parts = math.ceil(moved / SWEEP_STEP)
            hit = -1
            free = 0
            for part in range(1, 1 if held else parts + 1):
                f = part / parts
                x, y, yaw = state[X] + f * dx, state[Y] + f * dy, state[YAW] + f * mz
                if not rotates_footprint:
                    yaw = body.fixed_yaw
                hit = find_collision(squares, grid, solids, chosen, count, footprint, radius, x, y, yaw, placed)
                if hit != -1:
                    break
                free = part
            f = free / parts
            g = f if rotates else 1.0
            state[X] += f * dx
            state[Y] += f * dy
            state[YAW] = wrapped(state[YAW] + g * mz)
            state[DISTANCE] += f * length
            if body.wheels > 0:
                counted = counted_motion(state, body, f, g)
                ox, oy, oz = odometry_errors(body, noise, step, counted[0], counted[1], counted[2])
                f, g = chord(oz) if body.integration == EXACT else 1.0, 1.0
            middle = state[OYAW] + (0.0 if body.integration == EULER else 0.5 * oz)
            c, s = math.cos(middle), math.sin(middle)
            state[OX] += f * (c * ox - s * oy)
            state[OY] += f * (s * ox + c * oy)
            state[OYAW] = wrapped(state[OYAW] + g * oz)
            if stop_or_release(state, body, rotates, hit != -1 or held, hit):
                samples[step, DRIVEN_HIT] = hit
                hits += 1
            if body.wheels > 0 and (hit != -1 or held):
                stop_wheels(state, body)
        for i in range(3):
            samples[step, TRUE_POSE + i] = state[X + i]
            samples[step, ODOMETRY + i] = state[OX + i]
            samples[step, VELOCITY + i] = state[VX + i]
        samples[step, IN_COLLISION] = max(state[COLLIDING], state[OVERRUN])
    return hits
