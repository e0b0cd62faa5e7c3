# pyright: basic
"""A fixed piece of work to measure the current speed of the machine."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def flood(blocked, start, distance, queue):
    """Breadth-first distances from a cell of a (ny, nx) bool grid whose border is blocked; the number of reached cells.

    `distance` int32 and `queue` int32 have ny * nx elements.
    """
    ny, nx = blocked.shape
    flat = blocked.reshape(ny * nx)
    distance[:] = -1
    distance[start] = 0
    queue[0] = start
    head = 0
    tail = 1
    while head < tail:
        cell = queue[head]
        head += 1
        for step in (-1, 1, -nx, nx):
            other = cell + step
            if other >= 0 and other < flat.size and not flat[other] and distance[other] < 0:
                distance[other] = distance[cell] + 1
                queue[tail] = other
                tail += 1
    return tail


@kernel
def relax(field):
    """One in-place sweep over a (ny, nx) float32 field: limits each cell to 0.7 above its smallest neighbour (of four)."""
    ny, nx = field.shape
    for iy in range(1, ny - 1):
        for ix in range(1, nx - 1):
            beside = min(field[iy, ix - 1], field[iy, ix + 1])
            above = min(field[iy - 1, ix], field[iy + 1, ix])
            bound = min(beside, above) + np.float32(0.7)
            if bound < field[iy, ix]:
                field[iy, ix] = bound
