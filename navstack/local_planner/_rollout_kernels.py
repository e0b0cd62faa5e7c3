# pyright: basic
"""Which cells the points of trajectories lie in: computed once a cycle, for all critics."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def point_cells(poses, counts, nx, ny, origin_x, origin_y, resolution, cells, ringed, boxes):
    """Cells of all points into `cells` and `ringed` (K, T) int32: flat, and flat in a grid with a ring of one cell around.

    -1 off the map. `boxes` (K, 4) int32: lowest ix, iy and highest ix, iy of each row's points, -1 and less for the lowest
    where a point is off the map; rows without points keep nx, ny, -1, -1. Returns x0, y0, x1, y1: the half open box around
    all points, cut to the map; empty without points.
    """
    width = nx + 2
    x0, y0, x1, y1 = nx, ny, 0, 0
    for k in range(len(counts)):
        low_x, low_y, high_x, high_y = np.int32(nx), np.int32(ny), np.int32(-1), np.int32(-1)
        for i in range(np.uint64(counts[k])):
            fx = (poses[k, i, 0] - origin_x) / resolution
            fy = (poses[k, i, 1] - origin_y) / resolution
            # without branches, so that it becomes vector instructions; what is not a number is outside
            inside = (fx >= 0.0) & (fy >= 0.0) & (fx < nx) & (fy < ny)
            ix = np.int32(fx if inside else -1.0)
            iy = np.int32(fy if inside else -1.0)
            cells[k, i] = iy * nx + ix if inside else -1
            ringed[k, i] = (iy + 1) * width + ix + 1 if inside else -1
            low_x, high_x = min(low_x, ix), max(high_x, ix)
            low_y, high_y = min(low_y, iy), max(high_y, iy)
        boxes[k, 0] = low_x
        boxes[k, 1] = low_y
        boxes[k, 2] = high_x
        boxes[k, 3] = high_y
        x0, y0 = min(x0, max(low_x, 0)), min(y0, max(low_y, 0))
        x1, y1 = max(x1, high_x + 1), max(y1, high_y + 1)
    return x0, y0, x1, y1
