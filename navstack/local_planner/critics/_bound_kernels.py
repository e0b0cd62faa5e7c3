# pyright: basic
"""Upper bounds of the footprint's cost: where they cannot change a rollout's score, the footprint is not rasterized."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

BOUND_GRIDS = 3
"""Grids of `bound_footprint_costs`."""


@kernel
def highest_around(costs, x0, y0, x1, y1, reach, rows, out):
    """Write an upper bound of the footprint's cost to `out` (ny, nx), for the cells x0 <= ix < x1, y0 <= iy < y1.

    The bound of a cell is the highest cost among all cells that a footprint can touch whose points are at most `reach` cells
    from a centre anywhere in that cell: along each axis a point's cell is less than one cell away, and a cell of a rasterized
    edge at most half a cell more. Cells from which the footprint can leave the map get 255. `rows` (ny, nx) is scratch.
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
    # unsigned indices cannot wrap around, so the loops over a row are vectorized
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
def footprint_scale(command, settings):
    """Factor by which the footprint has grown at the speed of `command`."""
    speed = math.hypot(command[0], command[1])
    if speed > settings.scaling_speed:
        return (
            settings.max_scaling * ((speed - settings.scaling_speed) / (settings.max_speed - settings.scaling_speed))
            + 1.0
        )
    return 1.0


@kernel
def largest_scale(commands, alive, settings):
    """Factor by which the footprint has grown at the fastest of the rollouts that are alive."""
    largest = 1.0
    for k in range(len(alive)):
        if alive[k]:
            largest = max(largest, footprint_scale(commands[k], settings))
    return largest


@kernel
def bound_footprint_costs(costs, settings, commands, alive, box, bounds):
    """Write upper bounds of the cost of the footprint (`bounds[0]`) and of the largest scaled footprint (`bounds[1]`).

    `box`: x0, y0, x1, y1, see `highest_around`. `bounds` (BOUND_GRIDS, ny, nx): the last one is scratch.
    """
    x0, y0, x1, y1 = np.int64(box[0]), np.int64(box[1]), np.int64(box[2]), np.int64(box[3])
    if x0 >= x1:
        return
    ny, nx = costs.shape
    largest = largest_scale(commands, alive, settings)
    reach = settings.circumscribed_radius / settings.resolution + 1e-6
    farthest = float(nx + ny)
    scratch = bounds[BOUND_GRIDS - 1]
    highest_around(costs, x0, y0, x1, y1, min(reach, farthest), scratch, bounds[0])
    if largest > 1.0:
        highest_around(costs, x0, y0, x1, y1, min(largest * reach, farthest), scratch, bounds[1])
