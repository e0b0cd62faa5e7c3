# pyright: basic
"""The smooth control law of Park and Kuipers, and the trajectory that it drives.

J. J. Park, B. Kuipers, "A smooth control law for graceful motion of differential wheeled mobile robots in 2D environment", 2011.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import (
    OUTSIDE,
    edge_cost,
    fastest_corner,
    overlapped_cost,
    place_footprint,
    pose_cost,
)
from navstack.core.jit import kernel

LAW = np.dtype(
    [
        ("k_phi", "f8"),
        ("k_delta", "f8"),
        ("beta", "f8"),
        ("exponent", "f8"),
        ("slowdown_radius", "f8"),
        ("deceleration", "f8"),
        ("v_min", "f8"),
        ("v_max", "f8"),  # of this attempt
        ("v_full", "f8"),  # without lowering
        ("w_max", "f8"),
        ("w_min", "f8"),  # in place
        ("rotation_gain", "f8"),
        ("turn_tolerance", "f8"),
        ("scaling_speed", "f8"),
        ("scaling_factor", "f8"),
        ("beyond", "f8"),  # length of the path beyond the target, m
        ("period", "f8"),
        ("turn_first", "?"),
        ("backward", "?"),
        ("checked", "?"),
        ("corners_count", "?"),  # no corner of the footprint moves by more than a cell from check to check
        ("unknown_free", "?"),
        ("as_nav2", "?"),
    ],
    align=True,
)
"""Element type of the kernels' settings."""

NEAR_M = 1e-6
"""A target closer than this has no direction (m)."""


@kernel
def wrapped(angle):
    """Return the angle (rad) in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def in_float32(to_x, to_y, target_yaw, yaw, backward):
    """Return r, delta and phi of `law` as Nav2 computes them: offset, line of sight and results in float32."""
    dx, dy = np.float32(to_x), np.float32(to_y)
    sight = np.float64(np.float32(math.atan2(-dy, dx)))
    if backward:
        sight = np.float64(np.float32(sight + math.pi))
    square = np.float64(dx) * np.float64(dx) + np.float64(np.float32(dy * dy))
    r = np.float64(np.float32(math.sqrt(np.float64(np.float32(square)))))
    return r, np.float64(np.float32(wrapped(yaw + sight))), np.float64(np.float32(wrapped(target_yaw + sight)))


@kernel
def law(target_x, target_y, target_yaw, x, y, yaw, backward, p):
    """Return speed and turning speed at (x, y, yaw) on the way to the target. `p`: record of type `LAW`.

    With r the distance to the target, delta and phi the angles of the robot and the target against the line to it:
    curvature = -(k_delta (delta - atan(-k_phi phi)) + (1 + k_phi / (1 + (k_phi phi)²)) sin(delta)) / r,
    v = v_max / (1 + beta |curvature|^lambda), slower near the target.
    """
    if p.as_nav2:
        r, delta, phi = in_float32(target_x - x, target_y - y, target_yaw, yaw, backward)
    else:
        dx, dy = target_x - x, target_y - y
        r = math.sqrt(dx * dx + dy * dy)
        bearing = math.atan2(dy, dx)
        turned = math.pi if backward else 0.0
        delta = wrapped(yaw - bearing + turned)
        phi = wrapped(target_yaw - bearing + turned)
    r = max(r, NEAR_M)
    steep = p.k_phi * phi
    first = p.k_delta * (delta - math.atan(-steep))
    second = (1.0 + p.k_phi / (1.0 + steep * steep)) * math.sin(delta)
    curvature = -(first + second) / r
    if backward:
        curvature = -curvature
    v = p.v_max / (1.0 + p.beta * abs(curvature) ** p.exponent)
    left = r + p.beyond
    v = min(v, p.v_max * left / p.slowdown_radius, math.sqrt(2.0 * left * p.deceleration))
    v = min(max(v, p.v_min), p.v_max)
    if backward:
        v = -v
    w = min(max(curvature * v, -p.w_max), p.w_max)
    if curvature != 0.0:
        v = w / curvature
    return v, w


@kernel
def turning_in_place(error, p):
    """Return the turning speed (rad/s) of a turn in place by `error` (rad)."""
    w = p.rotation_gain * error * p.w_max
    size = max(abs(w), p.w_min)
    if not p.as_nav2:
        size = min(size, p.w_max, abs(error) / p.period)
    return size if w >= 0.0 else -size


@kernel
def nav2_edge_cost(costs, grid, corners, x, y, yaw):
    """Return what `edge_cost` does, with the edge between the last and the first corner drawn from the first, as Nav2 draws it.

    Lines of cells from one end and from the other differ where they pass between two cells.
    """
    ny, nx = costs.shape
    number = corners.shape[1]
    c, s = math.cos(yaw), math.sin(yaw)
    cells = np.empty((2, number), np.int64)
    for j in range(number):
        fx = ((x + (corners[0, j] * c - corners[1, j] * s)) - grid[0]) / grid[2]
        fy = ((y + (corners[0, j] * s + corners[1, j] * c)) - grid[1]) / grid[2]
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            return np.int64(OUTSIDE)
        cells[0, j], cells[1, j] = np.int64(fx), np.int64(fy)
    highest = np.int64(0)
    for j in range(number):
        a, b = (j, j + 1) if j < number - 1 else (0, number - 1)
        x0, y0 = cells[0, a], cells[1, a]
        dx, dy = cells[0, b] - x0, cells[1, b] - y0
        steps = max(abs(dx), abs(dy))
        for i in range(steps + 1):
            minor_x = (steps // 2 + i * abs(dx)) // steps if steps > 0 else np.int64(0)
            minor_y = (steps // 2 + i * abs(dy)) // steps if steps > 0 else np.int64(0)
            ix = x0 + (minor_x if dx >= 0 else -minor_x)
            iy = y0 + (minor_y if dy >= 0 else -minor_y)
            highest = max(highest, np.int64(costs[iy, ix]))
    return highest


@kernel
def simulate(costs, grid, corners, start, target, settings, out, command):
    """Simulate the way from `start` (3,) to `target` (3,). Returns (points, cost, seconds); points < 0: it fails.

    `grid` (3,): origin x, y and resolution; `corners` (2, n): the footprint (m). `settings` (1,): record of type `LAW`. `out`
    (m, 3) receives the poses after the start, `command` (2,) the first velocities. It fails (-1) where the footprint collides
    and (-2) if the target is not reached in m points. The cost is the highest under the robot's center.
    """
    p = settings[0]
    ny, nx = costs.shape
    resolution = grid[2]
    cells = np.empty(corners.shape, np.int32)
    placed, scaled = np.empty(corners.shape), np.empty(corners.shape)
    x, y, yaw = start[0], start[1], start[2]
    to_x, to_y, to_yaw = target[0], target[1], target[2]
    frame_x, frame_y, frame_yaw, frame_cos, frame_sin = 0.0, 0.0, 0.0, 1.0, 0.0
    if p.as_nav2:  # in the robot's frame: the law rounds to float32 there
        frame_x, frame_y, frame_yaw = x, y, yaw
        frame_cos, frame_sin = math.cos(yaw), math.sin(yaw)
        dx, dy = to_x - x, to_y - y
        to_x, to_y, to_yaw = frame_cos * dx + frame_sin * dy, frame_cos * dy - frame_sin * dx, wrapped(to_yaw - yaw)
        x, y, yaw = 0.0, 0.0, 0.0
    heading = math.atan2(to_y - y, to_x - x)
    if p.backward:
        heading += math.pi
    turning = p.turn_first
    dt = resolution / p.v_full
    most = len(out)
    if p.as_nav2:
        most = min(most, max(1, int(3.0 * math.hypot(to_x - x, to_y - y) / resolution)))
    else:
        # twice the way at the lowest speed, and the initial turn
        far = math.hypot(to_x - x, to_y - y) + resolution
        turn = math.pi / (max(p.w_min, 0.1) * dt) if turning else 0.0
        most = min(most, int(2.0 * far / (max(p.v_min, 0.01) * dt) + turn) + 1)
    highest = np.int64(0)
    v, w, seconds = 0.0, 0.0, 0.0
    for i in range(most):
        was_x, was_y, was_yaw = x, y, yaw
        if turning:
            error = wrapped(heading - yaw)
            if i == 0 or not p.as_nav2:
                v, w = 0.0, turning_in_place(error, p)
            if i == 0:
                command[0], command[1] = v, w
            turning = not abs(error) < p.turn_tolerance
            yaw += w * dt
        else:
            v, w = law(to_x, to_y, to_yaw, x, y, yaw, p.backward, p)
            if i == 0:
                command[0], command[1] = v, w
            x += v * dt * math.cos(yaw)
            y += v * dt * math.sin(yaw)
            yaw += w * dt
            if i > 0:
                seconds += math.hypot(x - was_x, y - was_y) / max(abs(v), 1e-3)
        at_x = frame_x + frame_cos * x - frame_sin * y
        at_y = frame_y + frame_sin * x + frame_cos * y
        at_yaw = yaw + frame_yaw
        out[i, 0], out[i, 1], out[i, 2] = at_x, at_y, at_yaw
        if p.checked:
            growth = 1.0
            fast = command[0] if p.as_nav2 else abs(v)
            if fast > p.scaling_speed and p.v_full > p.scaling_speed:
                growth += p.scaling_factor * ((fast - p.scaling_speed) / (p.v_full - p.scaling_speed))
            for j in range(corners.shape[1]):
                scaled[0, j], scaled[1, j] = growth * corners[0, j], growth * corners[1, j]
            if p.corners_count:
                parts = math.ceil(dt * fastest_corner(scaled, v, 0.0, w) / resolution - 1e-9)
                for k in range(1, parts):
                    share = k / parts
                    between = was_yaw + share * (yaw - was_yaw)
                    px, py = was_x + share * (x - was_x), was_y + share * (y - was_y)
                    cost = pose_cost(costs, grid[0], grid[1], resolution, scaled.T, px, py, between, True)
                    if cost == 254 or cost == OUTSIDE or (cost == 255 and not p.unknown_free):
                        return -1, cost, 0.0
            cx, cy = (at_x - grid[0]) / resolution, (at_y - grid[1]) / resolution
            if cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny:
                if p.as_nav2:
                    cost = nav2_edge_cost(costs, grid, scaled, at_x, at_y, at_yaw)
                else:
                    cost = edge_cost(costs, grid[0], grid[1], resolution, scaled, at_x, at_y, at_yaw, cells)
                if cost != OUTSIDE and not p.as_nav2:
                    place_footprint(costs, grid[0], grid[1], resolution, scaled, at_x, at_y, at_yaw, placed)
                    cost = overlapped_cost(costs, placed, max(cost, np.int64(costs[int(cy), int(cx)])))
                if cost == 254 or cost == OUTSIDE or (cost == 255 and not p.unknown_free):
                    return -1, cost, 0.0
                center = np.int64(costs[int(cy), int(cx)])
                if center != 255 or p.as_nav2:
                    highest = max(highest, center)
            elif not p.as_nav2:
                return -1, np.int64(OUTSIDE), 0.0
        if math.hypot(to_x - x, to_y - y) <= resolution:
            return i + 1, highest, seconds if p.as_nav2 else (i + 1) * dt
    return (most if p.as_nav2 else -2), highest, seconds if p.as_nav2 else most * dt


@kernel
def holds(costs, grid, vertices, start, v, w, period, unknown_free):
    """Return True if the footprint `vertices` (n, 2) does not collide while (v, w) is held: at its begin, middle and end.

    `grid` and `start` as of `simulate`.
    """
    for half in range(3):
        turned, length = 0.5 * half * period * w, 0.5 * half * period * v
        heading = start[2] + 0.5 * turned
        x, y = start[0] + length * math.cos(heading), start[1] + length * math.sin(heading)
        cost = pose_cost(costs, grid[0], grid[1], grid[2], vertices, x, y, start[2] + turned, True)
        if cost == OUTSIDE or cost == 254 or (cost == 255 and not unknown_free):
            return False
    return True
