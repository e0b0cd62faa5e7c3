# pyright: basic
"""Kernel of the headings at which a footprint fits into an opening."""

from __future__ import annotations

import numpy as np

from navstack.core.footprint_kernels import overlaps_lethal, place_footprint
from navstack.core.jit import kernel


@kernel
def first_free(costs, origin_x, origin_y, resolution, corners, points, yaws, first):
    """Write to `first` (k,), for each of `yaws`, the index of the first of `points` (n, 2) where a footprint is free, or -1.

    `corners` (2, m): of the footprint in the robot's frame (m). Free is a pose inside the grid with no lethal cell under it.
    """
    placed = np.empty(corners.shape)
    for k in range(len(yaws)):
        first[k] = -1
        for i in range(len(points)):
            x, y = points[i]
            if place_footprint(
                costs, origin_x, origin_y, resolution, corners, x, y, yaws[k], placed
            ) and not overlaps_lethal(costs, placed):
                first[k] = i
                break
