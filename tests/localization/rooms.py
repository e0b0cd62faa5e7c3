"""A map that looks different from every place, and scans of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, LaserScan, OccupancyGrid, Transform2D
from navstack.sim.lidar import cast_ray
from navstack.sim.map_cells import free_rectangles, free_squares

BEAMS = 120


def rooms(*, yaw: float = 0.0, resolution: float = 0.1, seed: int = 3) -> OccupancyGrid:
    """12 x 9 m: walls, a door, boxes at random places; origin (-2, 1), turned by `yaw`."""
    ny, nx = round(9.0 / resolution), round(12.0 / resolution)
    cells = np.zeros((ny, nx), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    cells[:, nx // 2] = 100
    cells[ny // 3 : ny // 3 + round(1.0 / resolution), nx // 2] = 0
    rng = np.random.default_rng(seed)
    for _ in range(9):
        y, x = int(rng.integers(5, ny - 15)), int(rng.integers(5, nx - 15))
        h, w = rng.integers(round(0.2 / resolution), round(1.0 / resolution), 2).tolist()
        cells[y : y + h, x : x + w] = 100
    return OccupancyGrid(cells, GridGeometry(nx, ny, resolution, -2.0, 1.0), yaw)


def scan_from(
    grid: OccupancyGrid, pose: Transform2D, *, sensor: Transform2D | None = None, reach: float = 8.0
) -> LaserScan:
    """The exact scan of the full circle with the base at `pose` in the map frame."""
    g = grid.geometry
    leaps = free_rectangles(free_squares(np.ascontiguousarray(grid.data == 100)))
    eye = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw).inverse() @ pose @ (sensor or Transform2D())
    increment = 2.0 * np.pi / BEAMS
    angles = eye.yaw - np.pi + increment * np.arange(BEAMS)
    ranges: NDArray[np.float32] = np.empty(BEAMS, np.float32)
    _, ny, nx = leaps.shape
    for i, angle in enumerate(angles.tolist()):
        found = cast_ray(
            leaps.ravel(),
            ny,
            nx,
            eye.x / g.resolution,
            eye.y / g.resolution,
            np.cos(angle),
            np.sin(angle),
            reach / g.resolution,
        )
        ranges[i] = found * g.resolution
    return LaserScan(ranges, -np.pi, increment, 0.05, reach)


def free_pose(grid: OccupancyGrid, rng: np.random.Generator, margin: float = 0.4) -> Transform2D:
    """A random pose in the map frame, farther than `margin` (m) from every obstacle."""
    from scipy.ndimage import distance_transform_edt

    g = grid.geometry
    wide = np.argwhere(np.asarray(distance_transform_edt(grid.data != 100)) * g.resolution > margin)
    iy, ix = wide[rng.integers(len(wide))].tolist()
    inside = Transform2D(
        (ix + rng.random()) * g.resolution, (iy + rng.random()) * g.resolution, rng.uniform(-np.pi, np.pi)
    )
    return Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ inside
