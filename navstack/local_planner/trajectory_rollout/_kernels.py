# pyright: basic
"""Trajectories of base_local_planner's TrajectoryPlanner (double precision throughout), and its heading score."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import line_next, line_start


@kernel
def simulate_accelerating(samples, pose, velocity, acceleration, sim_time, counts, poses):
    """Trajectories into `poses` (K, T, 3) that accelerate toward their sample; the first point is `pose`.

    `counts` (K,): points per trajectory.
    """
    for k in range(len(samples)):
        x, y, yaw = pose[0], pose[1], pose[2]
        vx, vy, vw = velocity[0], velocity[1], velocity[2]
        n = counts[k]
        if n == 0:
            continue
        dt = sim_time / n
        for i in range(n):
            poses[k, i, 0] = x
            poses[k, i, 1] = y
            poses[k, i, 2] = yaw
            vx = approach(vx, samples[k, 0], acceleration[0] * dt)
            vy = approach(vy, samples[k, 1], acceleration[1] * dt)
            vw = approach(vw, samples[k, 2], acceleration[2] * dt)
            c, s = math.cos(yaw), math.sin(yaw)
            x += (vx * c - vy * s) * dt
            y += (vx * s + vy * c) * dt
            yaw += vw * dt


@kernel
def approach(value, target, change):
    """`value` moved toward `target` by at most `change`."""
    if value < target:
        return min(target, value + change)
    return max(target, value - change)


@kernel
def heading_errors(costs, origin_x, origin_y, resolution, plan, poses, alive, out):
    """Per row of `poses` (K, 3): the turn (rad) to the farthest cell of the plan in free sight; inf where none is."""
    ny, nx = costs.shape
    flat = costs.ravel()
    for k in range(len(poses)):
        if not alive[k]:
            continue
        out[k] = np.inf
        x, y = poses[k, 0], poses[k, 1]
        fx, fy = (x - origin_x) / resolution, (y - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            continue
        x0, y0 = int(fx), int(fy)
        for j in range(len(plan) - 1, -1, -1):
            gx, gy = (plan[j, 0] - origin_x) / resolution, (plan[j, 1] - origin_y) / resolution
            if not (gx >= 0.0 and gy >= 0.0 and gx < nx and gy < ny):
                continue
            x1, y1 = int(gx), int(gy)
            line = line_start(x0, y0, x1, y1, nx)
            cell, error = y0 * nx + x0, line[0] // 2
            free = True
            for _ in range(line[0] + 1):
                if flat[cell] >= 253:
                    free = False
                    break
                cell, error = line_next(cell, error, line)
            if free:
                to_x = origin_x + (x1 + 0.5) * resolution - x
                to_y = origin_y + (y1 + 0.5) * resolution - y
                turn = math.atan2(to_y, to_x) - poses[k, 2]
                out[k] = abs(turn - 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi)))
                break


@kernel
def clear_footprint(costs, origin_x, origin_y, resolution, vertices, pose, lows, highs):
    """Makes the cells under the outline at `pose` passable (at most 252): the robot is where it is.

    Nothing changes when a vertex is off the map. `lows`, `highs` (nx,) int64 are scratch.
    """
    ny, nx = costs.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    lows[:] = ny
    highs[:] = -1
    number = len(vertices)
    for pass_ in range(2):
        x0, y0 = 0, 0
        for i in range(number + 1):
            j = 0 if i == number else i
            fx = (pose[0] + vertices[j, 0] * c - vertices[j, 1] * s - origin_x) / resolution
            fy = (pose[1] + vertices[j, 0] * s + vertices[j, 1] * c - origin_y) / resolution
            if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
                return
            x1, y1 = int(fx), int(fy)
            if i > 0 and pass_ == 1:
                line = line_start(x0, y0, x1, y1, nx)
                cell, error = y0 * nx + x0, line[0] // 2
                for _ in range(line[0] + 1):
                    iy = cell // nx
                    ix = cell - iy * nx
                    lows[ix] = min(lows[ix], iy)
                    highs[ix] = max(highs[ix], iy)
                    cell, error = line_next(cell, error, line)
            x0, y0 = x1, y1
    for ix in range(nx):
        for iy in range(lows[ix], highs[ix] + 1):
            costs[iy, ix] = min(costs[iy, ix], np.uint8(252))
