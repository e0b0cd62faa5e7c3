"""Rays within one level of voxels: the fast loop clears what the steps of Bresenham's line clear, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.costmap.voxel_layer import VOXEL_GRID, clear_voxel_rays

N, RESOLUTION = 60, 0.1


def step_by_step(
    costs: NDArray[np.uint8],
    columns: NDArray[np.int64],
    start: tuple[int, int],
    end: tuple[int, int],
    level: int,
    levels: int,
) -> None:
    """Clear the voxels of one ray, as voxel_grid.h does."""
    (x, y), (ex, ey) = start, end
    spans = abs(ex - x), abs(ey - y)
    dominant = max(spans)
    errors = [dominant // 2, dominant // 2]
    for _ in range(dominant + 1):
        columns[y, x] = (columns[y, x] | 1 << level) & ~(1 << (level + levels))
        if columns[y, x] >> levels == 0:
            costs[y, x] = 0
        errors = [error + span for error, span in zip(errors, spans, strict=True)]
        if errors[0] >= dominant:
            errors[0] -= dominant
            x += 1 if ex > x else -1
        if errors[1] >= dominant:
            errors[1] -= dominant
            y += 1 if ey > y else -1


@pytest.mark.parametrize(("levels", "word"), [(2, np.uint16), (8, np.uint16), (10, np.uint32), (16, np.uint32)])
def test_level_rays_clear_the_cells_of_each_step(levels: int, word: type) -> None:
    """300 rays among random marks, the sensor's own cell and straight and diagonal rays included."""
    rng = np.random.default_rng(levels)
    costs = np.where(rng.random((N, N)) < 0.3, 254, 255).astype(np.uint8)
    columns = np.where(rng.random((N, N)) < 0.3, rng.integers(0, 1 << 2 * levels, (N, N)), 0).astype(word)
    expected_costs, expected = costs.copy(), columns.astype(np.int64)
    grid = np.zeros(1, VOXEL_GRID)
    grid[0] = (0.0, 0.0, 0.0, RESOLUTION, 0.2, 10.0, -np.inf, 10.0, 0.5, 0.0, levels, 0, 16)
    level, z = 1, 0.3
    start = 25, 31
    sx, sy = ((c + 0.5) * RESOLUTION for c in start)
    points = np.empty((300, 3), np.float32)
    last = (-1, -1)
    for i in range(300):
        end = int(rng.integers(1, N - 1)), int(rng.integers(1, N - 1))
        if i % 5 == 0:
            k = int(rng.integers(0, 20))
            end = ((25 + k, 31), (25, 31 - k), (25 + k, 31 + k), (25 - k, 31 + k))[i // 5 % 4]
        # rays are shortened by two cells: aim beyond the end
        dx, dy = end[0] - start[0], end[1] - start[1]
        length = max(np.hypot(dx, dy), 1e-9)
        scale = 1.0 + 2.0 / length
        points[i] = sx + dx * scale * RESOLUTION, sy + dy * scale * RESOLUTION, z
        if end != last:
            step_by_step(expected_costs, expected, start, end, level, levels)
        last = end
    bounds = np.array([9.0, 9.0, -9.0, -9.0])
    assert clear_voxel_rays(costs, columns, points, 300, grid, sx, sy, z, 0.0, 100.0, bounds)
    assert (costs == expected_costs).all()
    assert (columns == expected).all()
