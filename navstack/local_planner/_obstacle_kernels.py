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
    source, across, target = costs.ravel(), rows.ravel(), out.ravel()
    radius = math.ceil(reach)
    low_x, high_x = max(x0, radius), min(x1, nx - radius)
    low_y, high_y = max(y0, radius), min(y1, ny - radius)
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            out[iy, ix] = 0 if low_x <= ix < high_x and low_y <= iy < high_y else 255
    if low_x >= high_x or low_y >= high_y:
        return
    # unsigned indices: nothing to wrap around, so that the loops over a row become vector instructions
    number = np.uint64(high_x - low_x)
    for iy in range(low_y - radius, high_y + radius):
        base = np.uint64(iy * nx + low_x)
        for i in range(number):
            across[base + i] = source[base + i]
    width = 0
    for dy in range(radius, -1, -1):
        squared = reach * reach
        wanted = 0
        if squared >= max(0.0, dy - 1.0) ** 2:
            wanted = int(1.5 + math.sqrt(squared - max(0.0, dy - 1.0) ** 2))
        if squared >= max(0.0, dy - 1.5) ** 2:
            wanted = max(wanted, int(1.0 + math.sqrt(squared - max(0.0, dy - 1.5) ** 2)))
        while width < min(wanted, radius):
            width += 1
            for iy in range(low_y - radius, high_y + radius):
                base = np.uint64(iy * nx + low_x)
                left = np.uint64(iy * nx + low_x - width)
                right = np.uint64(iy * nx + low_x + width)
                for i in range(number):
                    across[base + i] = max(across[base + i], max(source[left + i], source[right + i]))
        for iy in range(low_y, high_y):
            base = np.uint64(iy * nx + low_x)
            above = np.uint64((iy + dy) * nx + low_x)
            below = np.uint64((iy - dy) * nx + low_x)
            for i in range(number):
                target[base + i] = max(target[base + i], max(across[above + i], across[below + i]))


@kernel
def footprint_scale(command, scaling_speed, max_speed, max_scaling):
    """How much the outline has grown at the speed of `command`."""
    speed = math.hypot(command[0], command[1])
    if speed > scaling_speed:
        return max_scaling * ((speed - scaling_speed) / (max_speed - scaling_speed)) + 1.0
    return 1.0


@kernel
def cells_of(poses, counts, alive, commands, scaling, nx, ny, origin_x, origin_y, resolution, cells):
    """Flat cells of all points into `cells` (K, T), -1 off the map; the box around them and the largest outline's scale.

    `scaling` = scaling_speed, max_speed, max_scaling. The box is x0, y0, x1, y1, half open; empty when x0 >= x1.
    """
    low_x, low_y, high_x, high_y = nx, ny, -1, -1
    inverse = 1.0 / resolution
    largest = 1.0
    for k in range(len(counts)):
        if not alive[k]:
            continue
        largest = max(largest, footprint_scale(commands[k], scaling[0], scaling[1], scaling[2]))
        for i in range(counts[k]):
            fx = cell_coordinate(poses[k, i, 0], origin_x, resolution, inverse)
            fy = cell_coordinate(poses[k, i, 1], origin_y, resolution, inverse)
            cells[k, i] = -1
            if fx >= 0 and fy >= 0 and fx < nx and fy < ny:
                ix, iy = int(fx), int(fy)
                cells[k, i] = iy * nx + ix
                low_x, high_x = min(low_x, ix), max(high_x, ix)
                low_y, high_y = min(low_y, iy), max(high_y, iy)
    return low_x, low_y, high_x + 1, high_y + 1, largest


@kernel
def obstacle_scores(
    costs,
    origin_x,
    origin_y,
    resolution,
    vertices,
    commands,
    poses,
    counts,
    alive,
    scaling,
    sum_scores,
    bounds,
    cells,
    out,
    where,
):
    """ObstacleCostFunction: per trajectory the highest (or summed) cost of max(outline, centre), -6 where it collides.

    `bounds` (2, ny, nx): what no outline around a cell can exceed, for the outline as it is and for the largest; `cells`
    (K, T) as `cells_of` left them. `where` (K,): index of the first point that collides, -1 without. The outline is
    walked only where the costs around can change the result.
    """
    flat = costs.ravel()
    for k in range(len(counts)):
        where[k] = -1
        if not alive[k]:
            continue
        n = counts[k]
        scale = footprint_scale(commands[k], scaling[0], scaling[1], scaling[2])
        bound = bounds[0 if scale == 1.0 else 1].ravel()
        total = 0.0
        # the costliest neighbourhood first: after it most points cannot raise the maximum
        first = 0
        done = -1
        if not sum_scores:
            most = 0
            for i in range(n):
                around = 255 if cells[k, i] < 0 else np.int64(bound[cells[k, i]])
                if around >= most:
                    most, first = around, i
            if most == 0:
                out[k] = 0.0
                continue
        for step in range(-1, n):
            i = step
            if step < 0:
                if sum_scores:
                    continue
                i = first
            elif i == done:
                continue
            cell = cells[k, i]
            cost = OFF_MAP
            if cell >= 0:
                around = np.float64(bound[cell])
                if around == 0.0 or (around <= total and not sum_scores):
                    continue
                x, y, yaw = poses[k, i, 0], poses[k, i, 1], poses[k, i, 2]
                cost = perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, scale)
            if cost < 0:
                if step < 0:
                    continue  # found again below, in order, unless an earlier point collides
                total = ILLEGAL
                where[k] = i
                break
            if step < 0:
                done = first
            cost = max(cost, np.int64(flat[cell]))
            total = total + cost if sum_scores else max(total, np.float64(cost))
        out[k] = total
