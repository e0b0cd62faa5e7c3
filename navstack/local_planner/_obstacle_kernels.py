# pyright: basic
"""Costs under the robot's outline (base_local_planner's CostmapModel and ObstacleCostFunction)."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

ON_LETHAL = -1
ON_UNKNOWN = -2
OFF_MAP = -3
ILLEGAL = -6.0  # the critic's code


@kernel
def perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, scale):
    """The highest cost under the outline (scaled by `scale`) at a pose, or ON_LETHAL, ON_UNKNOWN, OFF_MAP.

    Each edge is walked cell by cell from one vertex's cell to the next one's (Bresenham, the longer axis leading).
    """
    ny, nx = costs.shape
    fx = (x - origin_x) / resolution
    fy = (y - origin_y) / resolution
    if not (x >= origin_x and y >= origin_y and fx < nx and fy < ny):
        return OFF_MAP
    flat = costs.ravel()
    c, s = math.cos(yaw), math.sin(yaw)
    number = len(vertices)
    highest = 0
    x0, y0 = 0, 0
    for i in range(number + 1):
        j = 0 if i == number else i
        vx, vy = scale * vertices[j, 0], scale * vertices[j, 1]
        px = x + (vx * c - vy * s)
        py = y + (vx * s + vy * c)
        fx = (px - origin_x) / resolution
        fy = (py - origin_y) / resolution
        if not (px >= origin_x and py >= origin_y and fx < nx and fy < ny):
            return OFF_MAP
        x1, y1 = int(fx), int(fy)
        if i == 1:
            cost = np.int64(flat[y0 * nx + x0])
            if cost >= 254:
                return ON_LETHAL if cost == 254 else ON_UNKNOWN
            highest = cost
        if i > 0:
            dx, dy = abs(x1 - x0), abs(y1 - y0)
            step_x = 1 if x1 >= x0 else -1
            step_y = nx if y1 >= y0 else -nx
            if dx >= dy:
                steps, add, major, minor = dx, dy, step_x, step_y
            else:
                steps, add, major, minor = dy, dx, step_y, step_x
            cell = y0 * nx + x0  # seen as the end of the edge before
            error = steps // 2
            for _ in range(steps):
                cell += major
                error += add
                if error >= steps:
                    error -= steps
                    cell += minor
                cost = np.int64(flat[cell])
                if cost >= 254:
                    return ON_LETHAL if cost == 254 else ON_UNKNOWN
                highest = max(highest, cost)
        x0, y0 = x1, y1
    return highest


@kernel
def highest_around(costs, window, radius, rows, out):
    """Into `out` (ny, nx), inside `window` = x0, y0, x1, y1: the highest cost within `radius` cells along each axis.

    Cells nearer than that to the border count as 255. An upper bound of every perimeter around the cell.
    `rows` (ny, nx) is scratch.
    """
    ny, nx = costs.shape
    x0, y0, x1, y1 = window
    for iy in range(max(0, y0 - radius), min(ny, y1 + radius)):
        source = costs[iy]
        target = rows[iy, x0:x1]
        low, high = max(x0, radius), min(x1, nx - radius)
        target[:] = 255
        if low < high:
            inner = rows[iy, low:high]
            inner[:] = source[low - radius : high - radius]
            for shift in range(1 - radius, radius + 1):
                other = source[low + shift : high + shift]
                for i in range(len(inner)):
                    inner[i] = max(inner[i], other[i])
    for iy in range(y0, y1):
        target = out[iy, x0:x1]
        if iy < radius or iy >= ny - radius:
            target[:] = 255
            continue
        target[:] = rows[iy - radius, x0:x1]
        for shift in range(1 - radius, radius + 1):
            other = rows[iy + shift, x0:x1]
            for i in range(len(target)):
                target[i] = max(target[i], other[i])


@kernel
def obstacle_scores(
    costs,
    origin_x,
    origin_y,
    resolution,
    vertices,
    circumscribed,
    commands,
    poses,
    counts,
    alive,
    scaling_speed,
    max_speed,
    max_scaling,
    sum_scores,
    rows,
    bound,
    out,
    where,
):
    """ObstacleCostFunction: per trajectory the highest (or summed) cost of max(outline, centre), -6 where it collides.

    `rows`, `bound`: scratch, uint8 (ny, nx). `where` (K,): index of the first point that collides, -1 without.
    The outline is walked only where the highest cost around can change the result.
    """
    ny, nx = costs.shape
    # the cells that trajectories touch
    low_x, low_y, high_x, high_y = nx, ny, -1, -1
    scale = 1.0
    for k in range(len(counts)):
        if not alive[k]:
            continue
        speed = math.hypot(commands[k, 0], commands[k, 1])
        if speed > scaling_speed:
            scale = max(scale, max_scaling * (speed - scaling_speed) / (max_speed - scaling_speed) + 1.0)
        for i in range(counts[k]):
            fx = math.floor((poses[k, i, 0] - origin_x) / resolution)
            fy = math.floor((poses[k, i, 1] - origin_y) / resolution)
            if fx >= 0 and fy >= 0 and fx < nx and fy < ny:
                ix, iy = int(fx), int(fy)
                low_x, high_x = min(low_x, ix), max(high_x, ix)
                low_y, high_y = min(low_y, iy), max(high_y, iy)
    if high_x >= 0:
        radius = math.ceil(min(scale * circumscribed / resolution + 1e-6, 1.0 * (nx + ny)))
        highest_around(costs, (low_x, low_y, high_x + 1, high_y + 1), radius, rows, bound)

    for k in range(len(counts)):
        where[k] = -1
        if not alive[k]:
            continue
        speed = math.hypot(commands[k, 0], commands[k, 1])
        scale = 1.0
        if speed > scaling_speed:
            scale = max_scaling * ((speed - scaling_speed) / (max_speed - scaling_speed)) + 1.0
        n = counts[k]
        total = 0.0
        # the costliest neighbourhood first: after it most points cannot raise the maximum
        first = -1
        if not sum_scores:
            most = -1
            for i in range(n):
                x, y = poses[k, i, 0], poses[k, i, 1]
                fx = (x - origin_x) / resolution
                fy = (y - origin_y) / resolution
                if x >= origin_x and y >= origin_y and fx < nx and fy < ny:
                    around = np.int64(bound[int(fy), int(fx)])
                    if around >= most:
                        most, first = around, i
            if most > 0:
                x, y = poses[k, first, 0], poses[k, first, 1]
                cost = perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, poses[k, first, 2], scale)
                if cost >= 0:
                    cost = max(
                        cost, np.int64(costs[int((y - origin_y) / resolution), int((x - origin_x) / resolution)])
                    )
                    total = np.float64(cost)
                else:
                    first = -1  # found again below, in order, unless an earlier point collides
        for i in range(n):
            x, y = poses[k, i, 0], poses[k, i, 1]
            fx = (x - origin_x) / resolution
            fy = (y - origin_y) / resolution
            if not (x >= origin_x and y >= origin_y and fx < nx and fy < ny):
                total = ILLEGAL
                where[k] = i
                break
            ix, iy = int(fx), int(fy)
            around = np.int64(bound[iy, ix])
            if sum_scores:
                if around == 0:
                    continue
            elif i == first or np.float64(around) <= total:
                continue
            cost = perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, poses[k, i, 2], scale)
            if cost < 0:
                total = ILLEGAL
                where[k] = i
                break
            cost = max(cost, np.int64(costs[iy, ix]))
            if sum_scores:
                total += cost
            else:
                total = max(total, np.float64(cost))
        out[k] = total
