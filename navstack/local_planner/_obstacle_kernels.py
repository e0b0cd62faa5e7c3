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
def cell_coordinate(value, origin, resolution, inverse):
    """floor((value - origin) / resolution), by the quotient itself only where the product might be on the other side."""
    offset = value - origin
    product = offset * inverse
    cell = math.floor(product)
    if abs(product - math.floor(product + 0.5)) < 1e-6:
        cell = math.floor(offset / resolution)
    return cell


@kernel
def perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, scale):
    """The highest cost under the outline (scaled by `scale`) at a pose, or ON_LETHAL, ON_UNKNOWN, OFF_MAP.

    Each edge is walked cell by cell from one vertex's cell to the next one's (Bresenham, the longer axis leading).
    The pose's own cell must be on the map.
    """
    ny, nx = costs.shape
    flat = costs.ravel()
    inverse = 1.0 / resolution
    c, s = math.cos(yaw), math.sin(yaw)
    number = len(vertices)
    highest = 0
    x0, y0 = 0, 0
    for i in range(number + 1):
        j = 0 if i == number else i
        vx, vy = scale * vertices[j, 0], scale * vertices[j, 1]
        fx = cell_coordinate(x + (vx * c - vy * s), origin_x, resolution, inverse)
        fy = cell_coordinate(y + (vx * s + vy * c), origin_y, resolution, inverse)
        if not (fx >= 0 and fy >= 0 and fx < nx and fy < ny):
            return OFF_MAP
        x1, y1 = int(fx), int(fy)
        if i == 1:
            highest = max(highest, np.int64(flat[y0 * nx + x0]))
        if i > 0:
            # the start was seen as the end of the edge before
            dx, dy = x1 - x0, y1 - y0
            step_x = 1 if dx >= 0 else -1
            step_y = nx if dy >= 0 else -nx
            dx, dy = abs(dx), abs(dy)
            along_x = dx >= dy
            steps = dx if along_x else dy
            add = dy if along_x else dx
            major = step_x if along_x else step_y
            minor = step_y if along_x else step_x
            cell = y0 * nx + x0
            if steps > 2:
                error = steps // 2
                for _ in range(steps - 1):
                    cell += major
                    error += add
                    if error >= steps:
                        error -= steps
                        cell += minor
                    highest = max(highest, np.int64(flat[cell]))
            elif steps == 2:
                # the one cell between, without a loop to mispredict
                highest = max(highest, np.int64(flat[cell + major + (minor if add > 0 else 0)]))
            highest = max(highest, np.int64(flat[y1 * nx + x1]))
            if highest >= 254:
                break
        x0, y0 = x1, y1
    if highest < 254:
        return highest
    return collision_code(flat, nx, ny, origin_x, origin_y, resolution, vertices, x, y, c, s, scale)


@kernel
def collision_code(flat, nx, ny, origin_x, origin_y, resolution, vertices, x, y, c, s, scale):
    """ON_LETHAL or ON_UNKNOWN: what the walk along the outline meets first, known to meet one of them."""
    inverse = 1.0 / resolution
    number = len(vertices)
    x0, y0 = 0, 0
    for i in range(number + 1):
        j = 0 if i == number else i
        vx, vy = scale * vertices[j, 0], scale * vertices[j, 1]
        x1 = int(cell_coordinate(x + (vx * c - vy * s), origin_x, resolution, inverse))
        y1 = int(cell_coordinate(y + (vx * s + vy * c), origin_y, resolution, inverse))
        if i > 0:
            steps = max(abs(x1 - x0), abs(y1 - y0))
            along_x = abs(x1 - x0) >= abs(y1 - y0)
            add = abs(y1 - y0) if along_x else abs(x1 - x0)
            for m in range(steps + 1):
                side = (steps // 2 + m * add) // max(steps, 1)
                ix = x0 + (m if along_x else side) * (1 if x1 >= x0 else -1)
                iy = y0 + (side if along_x else m) * (1 if y1 >= y0 else -1)
                cost = flat[iy * nx + ix]
                if cost == 254:
                    return ON_LETHAL
                if cost == 255:
                    return ON_UNKNOWN
        x0, y0 = x1, y1
    return OFF_MAP


@kernel
def highest_around(costs, x0, y0, x1, y1, reach, rows, out):
    """Into `out` (ny, nx), for the cells x0 <= ix < x1, y0 <= iy < y1: no outline around the cell can cost more.

    The highest cost of all cells that an outline can touch whose points are at most `reach` cells from a centre anywhere in
    the cell: along each axis a point's cell is less than one cell off, and a cell of the walk half a cell more off the edge.
    Cells from which the outline can leave the map get 255. `rows` (ny, nx) is scratch.
    """
    ny, nx = costs.shape
    radius = math.ceil(reach)
    low_x, high_x = max(x0, radius), min(x1, nx - radius)
    low_y, high_y = max(y0, radius), min(y1, ny - radius)
    for iy in range(y0, y1):
        out[iy, x0:x1] = 255
    if low_x >= high_x or low_y >= high_y:
        return
    for iy in range(low_y, high_y):
        out[iy, low_x:high_x] = 0
    for iy in range(low_y - radius, high_y + radius):
        rows[iy, low_x:high_x] = costs[iy, low_x:high_x]
    width = 0
    for dy in range(radius, -1, -1):
        wanted = 0
        squared = reach * reach
        if squared >= max(0.0, dy - 1.0) ** 2:
            wanted = int(1.5 + math.sqrt(squared - max(0.0, dy - 1.0) ** 2))
        if squared >= max(0.0, dy - 1.5) ** 2:
            wanted = max(wanted, int(1.0 + math.sqrt(squared - max(0.0, dy - 1.5) ** 2)))
        wanted = min(wanted, radius)
        while width < wanted:
            width += 1
            for iy in range(low_y - radius, high_y + radius):
                row = rows[iy, low_x:high_x]
                left = costs[iy, low_x - width : high_x - width]
                right = costs[iy, low_x + width : high_x + width]
                for i in range(len(row)):
                    row[i] = max(row[i], max(left[i], right[i]))
        for iy in range(low_y, high_y):
            target = out[iy, low_x:high_x]
            above = rows[iy + dy, low_x:high_x]
            below = rows[iy - dy, low_x:high_x]
            for i in range(len(target)):
                target[i] = max(target[i], max(above[i], below[i]))


@kernel
def footprint_scale(command, scaling_speed, max_speed, max_scaling):
    """How much the outline has grown at the speed of `command`."""
    speed = math.hypot(command[0], command[1])
    if speed > scaling_speed:
        return max_scaling * ((speed - scaling_speed) / (max_speed - scaling_speed)) + 1.0
    return 1.0


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
    bounds,
    cells,
    out,
    where,
):
    """ObstacleCostFunction: per trajectory the highest (or summed) cost of max(outline, centre), -6 where it collides.

    `rows` (ny, nx), `bounds` (2, ny, nx) uint8 and `cells` (K, T) int32 are scratch. `where` (K,): index of the first
    point that collides, -1 without. The outline is walked only where the costs around can change the result.
    """
    ny, nx = costs.shape
    low_x, low_y, high_x, high_y = nx, ny, -1, -1
    inverse = 1.0 / resolution
    largest = 1.0
    for k in range(len(counts)):
        if not alive[k]:
            continue
        largest = max(largest, footprint_scale(commands[k], scaling_speed, max_speed, max_scaling))
        for i in range(counts[k]):
            fx = cell_coordinate(poses[k, i, 0], origin_x, resolution, inverse)
            fy = cell_coordinate(poses[k, i, 1], origin_y, resolution, inverse)
            cells[k, i] = -1
            if fx >= 0 and fy >= 0 and fx < nx and fy < ny:
                ix, iy = int(fx), int(fy)
                cells[k, i] = iy * nx + ix
                low_x, high_x = min(low_x, ix), max(high_x, ix)
                low_y, high_y = min(low_y, iy), max(high_y, iy)
    # two upper bounds: for the outline as it is, and for the one that has grown most
    farthest = 1.0 * (nx + ny)
    reach = min(circumscribed / resolution + 1e-6, farthest)
    grown = min(largest * circumscribed / resolution + 1e-6, farthest)
    if high_x >= 0:
        highest_around(costs, low_x, low_y, high_x + 1, high_y + 1, reach, rows, bounds[0])
        if grown > reach:
            highest_around(costs, low_x, low_y, high_x + 1, high_y + 1, grown, rows, bounds[1])
    flat = costs.ravel()

    for k in range(len(counts)):
        where[k] = -1
        if not alive[k]:
            continue
        n = counts[k]
        scale = footprint_scale(commands[k], scaling_speed, max_speed, max_scaling)
        bound = bounds[0 if scale == 1.0 else 1].ravel()
        total = 0.0
        # the costliest neighbourhood first: after it most points cannot raise the maximum
        first = -1
        if not sum_scores:
            most = 0
            for i in range(n):
                around = 255 if cells[k, i] < 0 else np.int64(bound[cells[k, i]])
                if around >= most:
                    most, first = around, i
            if most == 0:
                out[k] = 0.0
                continue
            cell = cells[k, first]
            cost = -1
            if cell >= 0:
                cost = perimeter_cost(
                    costs,
                    origin_x,
                    origin_y,
                    resolution,
                    vertices,
                    poses[k, first, 0],
                    poses[k, first, 1],
                    poses[k, first, 2],
                    scale,
                )
            if cost >= 0:
                total = np.float64(max(cost, np.int64(flat[cell])))
            else:
                first = -1  # found again below, in order, unless an earlier point collides
        for i in range(n):
            cell = cells[k, i]
            if cell < 0:
                total = ILLEGAL
                where[k] = i
                break
            around = np.int64(bound[cell])
            if sum_scores:
                if around == 0:
                    continue
            elif i == first or np.float64(around) <= total:
                continue
            cost = perimeter_cost(
                costs,
                origin_x,
                origin_y,
                resolution,
                vertices,
                poses[k, i, 0],
                poses[k, i, 1],
                poses[k, i, 2],
                scale,
            )
            if cost < 0:
                total = ILLEGAL
                where[k] = i
                break
            cost = max(cost, np.int64(flat[cell]))
            if sum_scores:
                total += cost
            else:
                total = max(total, np.float64(cost))
        out[k] = total
