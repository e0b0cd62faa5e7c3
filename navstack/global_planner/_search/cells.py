"""Cells of a grid as (ix, iy), and positions in units of cells."""

from __future__ import annotations

from navstack.core import GridGeometry, Pose2D, Window

Cell = tuple[int, int]


def start_fronts(cell: Cell) -> list[Cell]:
    """The four orthogonal neighbours of a cell, in the order in which navfn queues them."""
    x, y = cell
    return [(x + 1, y), (x - 1, y), (x, y - 1), (x, y + 1)]


def cell_coordinates(geometry: GridGeometry, pose: Pose2D) -> tuple[float, float]:
    """Position of a pose in units of cells; cell i covers [i, i + 1)."""
    return (pose.x - geometry.origin_x) / geometry.resolution, (pose.y - geometry.origin_y) / geometry.resolution


def position_in_cells(geometry: GridGeometry, pose: Pose2D) -> tuple[float, float]:
    """Position of a pose in units of cells; cell centres are at whole numbers."""
    x, y = cell_coordinates(geometry, pose)
    return x - 0.5, y - 0.5


def union(a: Window, b: Window) -> Window:
    """The smallest window that contains two."""
    if a.is_empty:
        return b
    if b.is_empty:
        return a
    return Window(min(a.x0, b.x0), min(a.y0, b.y0), max(a.x1, b.x1), max(a.y1, b.y1))
