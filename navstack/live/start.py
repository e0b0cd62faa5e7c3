"""A place to start on a map that names none."""

from __future__ import annotations

import numpy as np

from navstack.core import OccupancyGrid
from navstack.core.errors import InputError


def free_pose(grid: OccupancyGrid) -> tuple[float, float]:
    """Returns the position (m) with much space around it that is nearest to the middle of the free area.

    Raises InputError for a map without free cells.
    """
    from scipy.ndimage import distance_transform_edt  # slow import

    free = grid.data == 0
    if not free.any():
        raise InputError("the map has no free cell; give --start x,y")
    distance = np.asarray(distance_transform_edt(np.pad(free, 1)))[1:-1, 1:-1]
    enough = distance >= min(0.6 * float(distance.max()), 1.0 / grid.geometry.resolution)
    iy, ix = np.nonzero(enough)
    middle_y, middle_x = np.argwhere(free).mean(axis=0)
    best = int(np.argmin((iy - middle_y) ** 2 + (ix - middle_x) ** 2))
    u, v = (ix[best] + 0.5) * grid.geometry.resolution, (iy[best] + 0.5) * grid.geometry.resolution
    c, s = np.cos(grid.origin_yaw), np.sin(grid.origin_yaw)
    return float(grid.geometry.origin_x + c * u - s * v), float(grid.geometry.origin_y + s * u + c * v)
