# pyright: basic
"""Relaxation of paths toward their smooth form."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def relax(costs, grid, data, points, previous, weights, limits):
    """Move `points` (n, 2) toward the mean of their neighbors and toward `data` (n, 2), in sweeps; ends stay.

    `grid`: x and y of the origin, resolution. `weights`: of the data, of smoothness. `limits`: tolerance of a sweep (m), number
    of sweeps. `previous` is scratch. Returns whether it converged; otherwise `points` are those of the last sweep without
    collision.
    """
    ny, nx = costs.shape
    n = len(points)
    previous[:] = points
    change = limits[0]
    sweeps = 0
    while change >= limits[0]:
        change = 0.0
        sweeps += 1
        if sweeps >= limits[1]:
            points[:] = previous
            return False
        for i in range(1, n - 1):
            for j in range(2):
                old = points[i, j]
                points[i, j] = (
                    old
                    + weights[0] * (data[i, j] - old)
                    + weights[1] * (points[i + 1, j] + points[i - 1, j] - 2.0 * old)
                )
                change += abs(points[i, j] - old)
            fx, fy = (points[i, 0] - grid[0]) / grid[2], (points[i, 1] - grid[1]) / grid[2]
            inside = fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny
            cost = np.int64(costs[np.int64(fy), np.int64(fx)]) if inside else 254
            if cost > 252 and cost != 255:
                points[:] = previous
                return False
        previous[:] = points
    return True
