"""The motion models of amcl (amcl/src/amcl/sensors/amcl_odom.cpp; Thrun, Burgard, Fox: Probabilistic Robotics, 5.4)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel
from navstack.localization.amcl._random_kernels import normal

DIFF, OMNI, DIFF_CORRECTED, OMNI_CORRECTED = 0, 1, 2, 3


@kernel
def difference(a: float, b: float) -> float:
    """Return the shortest rotation (rad, in [-pi, pi]) from `b` to `a`."""
    turn = a - b
    if abs(turn) > math.pi:
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    return turn


@kernel
def move_diff(
    particles: NDArray[np.float64],
    motion: NDArray[np.float64],
    start_yaw: float,
    alphas: NDArray[np.float64],
    corrected: bool,
    state: NDArray[np.uint64],
) -> None:
    """Move `particles` (n, 3) by the odometry's `motion` (dx, dy in the odometry frame, dyaw) from the heading `start_yaw`.

    Rotation, translation, rotation, each with noise. The plain model takes the variances as standard deviations.
    """
    distance = math.sqrt(motion[0] * motion[0] + motion[1] * motion[1])
    first = 0.0 if distance < 0.01 else difference(math.atan2(motion[1], motion[0]), start_yaw)
    second = difference(motion[2], first)
    # driving backward is no rotation by half a turn
    noise_first = min(abs(difference(first, 0.0)), abs(difference(first, math.pi)))
    noise_second = min(abs(difference(second, 0.0)), abs(difference(second, math.pi)))
    square = distance * distance
    turns = noise_first * noise_first, noise_second * noise_second
    sigma_first = alphas[0] * turns[0] + alphas[1] * square
    sigma_distance = alphas[2] * square + alphas[3] * turns[0] + alphas[3] * turns[1]
    sigma_second = alphas[0] * turns[1] + alphas[1] * square
    if corrected:
        sigma_first = math.sqrt(sigma_first)
        sigma_distance = math.sqrt(sigma_distance)
        sigma_second = math.sqrt(sigma_second)
    for i in range(len(particles)):
        turn = difference(first, normal(sigma_first, state))
        way = distance - normal(sigma_distance, state)
        rest = difference(second, normal(sigma_second, state))
        heading = particles[i, 2] + turn
        particles[i, 0] += way * math.cos(heading)
        particles[i, 1] += way * math.sin(heading)
        particles[i, 2] += turn + rest


@kernel
def move_omni(
    particles: NDArray[np.float64],
    motion: NDArray[np.float64],
    start_yaw: float,
    alphas: NDArray[np.float64],
    corrected: bool,
    state: NDArray[np.uint64],
) -> None:
    """Move `particles` (n, 3) as `move_diff` does, by the model for bases that drive sideways; `alphas` (5,)."""
    distance = math.sqrt(motion[0] * motion[0] + motion[1] * motion[1])
    bearing = difference(math.atan2(motion[1], motion[0]), start_yaw)
    turn = motion[2]
    way, rotation = distance * distance, turn * turn
    if corrected:
        sigma_way = math.sqrt(alphas[2] * way + alphas[3] * rotation)
        sigma_turn = math.sqrt(alphas[0] * rotation + alphas[1] * way)
        sigma_side = math.sqrt(alphas[3] * rotation + alphas[4] * way)
    else:
        sigma_way = alphas[2] * way + alphas[0] * rotation
        sigma_turn = alphas[3] * rotation + alphas[1] * way
        sigma_side = alphas[0] * rotation + alphas[4] * way
    for i in range(len(particles)):
        heading = bearing + particles[i, 2]
        c, s = math.cos(heading), math.sin(heading)
        ahead = distance + normal(sigma_way, state)
        turned = turn + normal(sigma_turn, state)
        side = normal(sigma_side, state)
        particles[i, 0] += ahead * c + side * s
        particles[i, 1] += ahead * s - side * c
        particles[i, 2] += turned


@kernel
def wrap_yaws(particles: NDArray[np.float64]) -> None:
    """Bring the headings (column 2) into [-pi, pi)."""
    full = 2.0 * math.pi
    for i in range(len(particles)):
        yaw = particles[i, 2]
        if not -math.pi <= yaw < math.pi:
            particles[i, 2] = yaw - full * math.floor((yaw + math.pi) / full)


@kernel
def turn_by(particles: NDArray[np.float64], turns: NDArray[np.float64], distance: float) -> None:
    """Turn each of the `particles` by its own rate (rad/m) times `distance` (m)."""
    for i in range(len(particles)):
        particles[i, 2] += turns[i] * distance


@kernel
def draw_turns(
    turns: NDArray[np.float64],
    parents: NDArray[np.int64],
    start: float,
    walk: float,
    state: NDArray[np.uint64],
    out: NDArray[np.float64],
) -> None:
    """Inherit the turn rates (rad/m) of the `parents` (n,) with a normal step `walk`; without one (-1), draw from `start`."""
    for i in range(len(parents)):
        out[i] = turns[parents[i]] + normal(walk, state) if parents[i] >= 0 else normal(start, state)
