"""Rays that leave the voxel grid are clipped alike on all sides."""

from __future__ import annotations

import math

import numpy as np

from navstack.costmap.voxel_layer import VOXEL_GRID, clear_voxel_rays, mark_voxels

CELLS, RESOLUTION = 80, 0.05


def test_no_ray_is_lost_on_any_side() -> None:
    """Rays far beyond the grid, from random places at odd origins: each clears the cells up to the border."""
    rng = np.random.default_rng(7)
    lost = dict.fromkeys(("left", "right", "bottom", "top", "floor"), 0)
    for _ in range(300):
        origin = rng.uniform(-9.0, 9.0, 2)
        sensor = origin + rng.uniform(0.3, 0.7, 2) * CELLS * RESOLUTION
        for side, yaw, drop in (
            ("left", math.pi, 0.0),
            ("right", 0.0, 0.0),
            ("bottom", -math.pi / 2, 0.0),
            ("top", math.pi / 2, 0.0),
            ("floor", 0.0, 30.0),
        ):
            angle = yaw + rng.uniform(-0.3, 0.3)
            reach = rng.uniform(8.0, 30.0)
            point = [sensor[0] + reach * math.cos(angle), sensor[1] + reach * math.sin(angle), 0.5 - drop]
            costs = np.full((CELLS, CELLS), 255, np.uint8)
            columns = np.zeros((CELLS, CELLS), np.uint64)
            grid = np.zeros(1, VOXEL_GRID)
            grid[0] = (*origin, 0.0, RESOLUTION, 0.2, 2.0, -math.inf, 2.0, 0.5, 0.0, 10, 0, 15)
            bounds = np.array([np.inf, np.inf, -np.inf, -np.inf])
            points = np.array([point], np.float32)
            clear_voxel_rays(costs, columns, points, 1, grid, *sensor, 0.5, 0.0, 100.0, bounds)
            rows, cols = np.nonzero(costs == 0)
            reached = {
                "left": len(cols) and cols.min() == 0,
                "right": len(cols) and cols.max() == CELLS - 1,
                "bottom": len(rows) and rows.min() == 0,
                "top": len(rows) and rows.max() == CELLS - 1,
                "floor": len(rows) > 0,
            }
            lost[side] += not reached[side]
    assert not any(lost.values()), lost


def test_marked_points_grow_the_bounds_on_every_side() -> None:
    """A window that left one out would keep its cell out of the costmap."""
    around = [(0.5, 2.0), (3.5, 2.0), (2.0, 0.5), (2.0, 3.5)]
    costs = np.zeros((CELLS, CELLS), np.uint8)
    grid = np.zeros(1, VOXEL_GRID)
    grid[0] = (0.0, 0.0, 0.0, RESOLUTION, 0.2, 2.0, -math.inf, 2.0, 0.5, 0.0, 10, 0, 15)
    for number in range(1, 5):
        bounds = np.array([np.inf, np.inf, -np.inf, -np.inf])
        points = np.array([(x, y, 0.3) for x, y in around[:number]], np.float32)
        columns = np.zeros((CELLS, CELLS), np.uint64)
        mark_voxels(costs, columns, 1, points, number, grid, 2.0, 2.0, 0.3, 0.0, 10.0, bounds)
        assert bounds.tolist() == [*points[:, :2].min(axis=0).tolist(), *points[:, :2].max(axis=0).tolist()]
    assert np.count_nonzero(costs) == 4
