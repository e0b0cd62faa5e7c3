# pyright: basic
"""The wheels of the robot's body: limits of each wheel, and the way that their encoders count.

Layout of the state: `navstack.sim._body_layout`. The velocities of the rims (m/s) are a linear function of those of the base,
and the base's the least-squares solution for given rims (`navstack.kinematics`).
"""

from __future__ import annotations

import math

from navstack.core.jit import kernel
from navstack.sim._body_layout import RIM, ROLL, TARGET, TICK, VX, VY, WZ


@kernel
def limit_wheels(state, body):
    """Limits the speed and the acceleration of every wheel; updates the velocity of the base.

    One factor for the speeds keeps the base on its arc. Accelerations are limited wheel by wheel, as motors are.
    """
    fastest = 0.0
    for i in range(body.wheels):
        rim = (
            body.to_wheels[3 * i] * state[VX]
            + body.to_wheels[3 * i + 1] * state[VY]
            + body.to_wheels[3 * i + 2] * state[WZ]
        )
        state[TARGET + i] = rim
        fastest = max(fastest, abs(rim))
    factor = body.max_rim_speed / fastest if fastest > body.max_rim_speed else 1.0
    vx, vy, wz = 0.0, 0.0, 0.0
    for i in range(body.wheels):
        change = factor * state[TARGET + i] - state[RIM + i]
        state[RIM + i] += min(max(change, -body.max_rim_change), body.max_rim_change)
        vx += body.from_wheels[i] * state[RIM + i]
        vy += body.from_wheels[4 + i] * state[RIM + i]
        wz += body.from_wheels[8 + i] * state[RIM + i]
    state[VX], state[VY], state[WZ] = vx, vy, wz


@kernel
def true_motion(state, body):
    """Displacement of one step (dx, dy, dyaw) in the robot's frame, with the true radii of the wheels."""
    mx, my, mz = 0.0, 0.0, 0.0
    for i in range(body.wheels):
        way = body.dt * state[RIM + i] * (1.0 + body.radius_errors[i])
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
            moved * (body.to_wheels[3 * i] * state[VX] + body.to_wheels[3 * i + 1] * state[VY])
            + turned * body.to_wheels[3 * i + 2] * state[WZ]
        )
        state[ROLL + i] += way
        if body.metres_per_tick > 0.0:
            ticks = math.floor(state[ROLL + i] / body.metres_per_tick)
            way = (ticks - state[TICK + i]) * body.metres_per_tick
            state[TICK + i] = ticks
        ox += body.from_wheels[i] * way
        oy += body.from_wheels[4 + i] * way
        oz += body.from_wheels[8 + i] * way
    return ox, oy, oz


@kernel
def stop_wheels(state, body):
    """Sets the rims to the velocity of the base, after a collision has changed it."""
    for i in range(body.wheels):
        state[RIM + i] = (
            body.to_wheels[3 * i] * state[VX]
            + body.to_wheels[3 * i + 1] * state[VY]
            + body.to_wheels[3 * i + 2] * state[WZ]
        )


@kernel
def chord(turn):
    """Length of the chord of an arc that turns by `turn` (rad), as a share of its length."""
    half = 0.5 * turn
    return math.sin(half) / half if abs(half) > 1e-9 else 1.0
