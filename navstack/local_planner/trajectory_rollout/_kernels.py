# pyright: basic
"""Rollouts of base_local_planner's TrajectoryPlanner, in double precision; its heading score and footprint checks."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import edge_cost, overlaps_lethal, place_footprint
from navstack.core.jit import kernel
from navstack.core.line_kernels import line_next, line_start
from navstack.local_planner._map_grid_kernels import BLOCKED, FREE_UNREACHED, STATE_SIZE, grid_value

# results of `perimeter_cost`
ON_LETHAL = -1
ON_UNKNOWN = -2
OFF_MAP = -3
HALF_PI = 0.5 * math.pi


@kernel
def count_points(samples, sim_time, granularity, angular_granularity, by_time, counts):
    """Write the points per rollout, at least 1, to `counts` (K,). Returns the largest count.

    `by_time`: as heading_scoring, the granularity is a time.
    """
    longest = 1
    for k in range(len(samples)):
        if by_time:
            steps = sim_time / granularity
        else:
            along = math.hypot(samples[k, 0], samples[k, 1]) * sim_time / granularity
            steps = max(along, abs(samples[k, 2]) / angular_granularity)
        counts[k] = max(1, int(steps + 0.5))
        longest = max(longest, counts[k])
    return longest


@kernel
def distances_ahead(grid, storage, poses, counts, first, ahead, out):
    """Write the grid's value `ahead` metres in front of the last point of each rollout from `first` on to `out`; -1 off the map.

    `grid`, `storage`: see `start_wavefront`.
    """
    nx, ny = grid[0].nx, grid[0].ny
    width = nx + 2
    end = STATE_SIZE + (ny + 2) * width + 1
    state, distances, queue = storage[:STATE_SIZE], storage[STATE_SIZE:end], storage[end:]
    for k in range(first, len(counts)):
        last = counts[k] - 1
        yaw = poses[k, last, 2]
        fx = (poses[k, last, 0] + ahead * math.cos(yaw) - grid[0].origin_x) / grid[0].resolution
        fy = (poses[k, last, 1] + ahead * math.sin(yaw) - grid[0].origin_y) / grid[0].resolution
        out[k - first] = -1.0
        if fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny:
            cell = (int(fy) + 1) * width + int(fx) + 1
            out[k - first] = grid_value(distances, queue, state, cell, width, nx * ny)


@kernel
def simulate_accelerating(samples, pose, velocity, acceleration, sim_time, counts, poses):
    """Write rollouts that accelerate towards their sample to `poses` (K, T, 3); the first point is `pose`.

    `counts` (K,): points per rollout.
    """
    c, s, at = math.cos(pose[2]), math.sin(pose[2]), pose[2]
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
            if yaw != at:
                c, s, at = math.cos(yaw), math.sin(yaw), yaw
            if vy == 0.0:
                x += (vx * c) * dt
                y += (vx * s) * dt
            else:
                left = HALF_PI + yaw
                x += (vx * c + vy * math.cos(left)) * dt
                y += (vx * s + vy * math.sin(left)) * dt
            yaw += vw * dt


@kernel
def approach(value, target, change):
    """`value` changed towards `target` by at most `change`."""
    if value < target:
        return min(target, value + change)
    return max(target, value - change)


@kernel
def heading_errors(costs, origin_x, origin_y, resolution, plan, poses, alive, out):
    """Write the angle (rad) from each pose's heading to the farthest visible cell of the plan to `out` (K,).

    `poses` (K, 3). A cell is visible if no cell on the line to it costs 253 or more; inf if no cell is visible.
    """
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
def open_footprint(grid, storage, vertices, pose, lows, highs):
    """Make blocked cells under the footprint at `pose` passable in a started wavefront: the robot already covers them.

    As FootprintHelper::getFootprintCells: the cells on the edges and between them; if a vertex is off the map, only the edges
    before it. `grid`, `storage`: see `start_wavefront`. `lows`, `highs` (nx,) int64 are scratch.
    """
    nx, ny = grid[0].nx, grid[0].ny
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    width = nx + 2
    distances = storage[STATE_SIZE : STATE_SIZE + (ny + 2) * width]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    lows[:] = ny
    highs[:] = -1
    number = len(vertices)
    x0, y0 = 0, 0
    filled = True
    for i in range(number + 1):
        j = 0 if i == number else i
        fx = ((pose[0] + (vertices[j, 0] * c - vertices[j, 1] * s)) - origin_x) / resolution
        fy = ((pose[1] + (vertices[j, 0] * s + vertices[j, 1] * c)) - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            filled = False
            break
        x1, y1 = int(fx), int(fy)
        if i > 0:
            line = line_start(x0, y0, x1, y1, nx)
            cell, error = y0 * nx + x0, line[0] // 2
            for _ in range(line[0] + 1):
                iy = cell // nx
                ix = cell - iy * nx
                lows[ix] = min(lows[ix], iy)
                highs[ix] = max(highs[ix], iy)
                open_cell(distances, (iy + 1) * width + ix + 1)
                cell, error = line_next(cell, error, line)
        x0, y0 = x1, y1
    if filled:
        for ix in range(nx):
            for iy in range(lows[ix], highs[ix] + 1):
                open_cell(distances, (iy + 1) * width + ix + 1)


@kernel
def open_cell(distances, cell):
    """Make a blocked cell passable."""
    if distances[cell] == BLOCKED:
        distances[cell] = FREE_UNREACHED


@kernel
def sum_in_order(costs, scales, order, rejected_by, totals):
    """Write the totals of the legal rows, added up in the order of the columns `order`: C++'s rounding decides between equals."""
    for k in range(len(totals)):
        if rejected_by[k] == -1:
            total = 0.0
            for column in order:
                if scales[column] != 0.0:
                    total += costs[k, column] * scales[column]
            totals[k] = total


@kernel
def perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, scale):
    """Highest cost along the edges of the footprint `vertices` (n, 2), scaled by `scale`; ON_LETHAL, ON_UNKNOWN or OFF_MAP.

    ON_LETHAL also if the footprint overlaps a lethal cell elsewhere. ROS differs: only the cells of its edges are checked.
    """
    number = len(vertices)
    corners = np.empty((2, number))
    for j in range(number):
        corners[0, j] = scale * vertices[j, 0]
        corners[1, j] = scale * vertices[j, 1]
    cells, placed = np.empty((2, number), np.int32), np.empty((2, number))
    highest = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, cells)
    if highest < 254:
        place_footprint(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed)
        return ON_LETHAL if overlaps_lethal(costs, placed) else highest
    return collision_reason(costs, origin_x, origin_y, resolution, corners, x, y, yaw)


@kernel
def collision_reason(costs, origin_x, origin_y, resolution, corners, x, y, yaw):
    """The first of ON_LETHAL, ON_UNKNOWN and OFF_MAP along the edges of a footprint that is in collision."""
    ny, nx = costs.shape
    flat = costs.ravel()
    c, s = math.cos(yaw), math.sin(yaw)
    number = corners.shape[1]
    x0, y0 = 0, 0
    for i in range(number + 1):
        j = 0 if i == number else i
        vx, vy = corners[0, j], corners[1, j]
        fx = ((x + (vx * c - vy * s)) - origin_x) / resolution
        fy = ((y + (vx * s + vy * c)) - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            return OFF_MAP
        x1, y1 = int(fx), int(fy)
        if i > 0:
            line = line_start(x0, y0, x1, y1, nx)
            cell, error = y0 * nx + x0, line[0] // 2
            for _ in range(line[0] + 1):
                if flat[cell] == 254:
                    return ON_LETHAL
                if flat[cell] == 255:
                    return ON_UNKNOWN
                cell, error = line_next(cell, error, line)
        x0, y0 = x1, y1
    return OFF_MAP
