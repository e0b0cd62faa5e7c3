"""Worlds for tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from navstack.core import GridGeometry, OccupancyGrid

UNKNOWN_SHARE = 0.05


def ascii_map(text: str, resolution: float = 1.0, *, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> OccupancyGrid:
    """`#` occupied, `?` unknown, anything else free; the last line is row 0."""
    rows = text.strip("\n").splitlines()[::-1]
    values = {"#": 100, "?": -1}
    data = np.array([[values.get(c, 0) for c in row.ljust(max(map(len, rows)))] for row in rows], np.int8)
    return OccupancyGrid(data, GridGeometry(data.shape[1], data.shape[0], resolution, x, y), yaw)


def random_map(seed: int, *, share: float = 0.05, size: int = 60, resolution: float = 0.1) -> OccupancyGrid:
    """Random occupied and unknown cells; the grid is rotated and translated."""
    rng = np.random.default_rng(seed)
    data = np.zeros((size - 7, size), np.int8)
    data[rng.random(data.shape) < UNKNOWN_SHARE] = -1
    data[rng.random(data.shape) < share] = 100
    geometry = GridGeometry(size, size - 7, resolution, *rng.uniform(-5, 5, 2).tolist())
    return OccupancyGrid(data, geometry, float(rng.uniform(-math.pi, math.pi)))


def to_world(grid: OccupancyGrid, u: Any, v: Any) -> tuple[Any, Any]:
    """Points given in the grid's own axes (m), in the map frame; numbers or arrays."""
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    return grid.geometry.origin_x + c * u - s * v, grid.geometry.origin_y + s * u + c * v
