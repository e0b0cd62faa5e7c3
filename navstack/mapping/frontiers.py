"""Frontiers: where the known free space of a map ends, and how the robot gets there.

Source of the idea: Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from navstack.core import INSCRIBED, LETHAL, Costmap, OccupancyGrid, Pose2D

_image: Any = ndimage  # its stubs do not know what most functions return
_EIGHT: Final = np.ones((3, 3), bool)
_COST_WEIGHT: Final = 2.0
"""A cell of the cost before INSCRIBED counts as this much longer."""


class ExplorationParams(NamedTuple):
    """What a frontier is, and which one is next."""

    min_size: float = 0.5
    """Frontiers shorter than this (m) are left: gaps between beams, and openings that no robot fits through."""
    min_unknown: float = 0.05
    """Unknown areas smaller than this (m²) are no unknown space."""
    reach: float = 1.0
    """A goal is at most this far from its frontier, over free cells (m)."""
    gain: float = 1.0
    """A meter of frontier is worth this much way (m),"""
    most_gain: float = 3.0
    """up to this (m)."""


@dataclass(frozen=True, slots=True)
class Frontier:
    """A connected line of free cells beside unknown space."""

    x: float
    y: float
    """Its middle cell (m, map frame)."""
    size: float
    """Number of its cells times their size (m)."""
    goal: Pose2D | None
    """Where the robot sees it from; None if it cannot get there."""
    distance: float
    """Length of the way there, longer near obstacles (m); infinite without a goal."""
    reason: str = ""
    """Why there is no goal."""
    tight: bool = False
    """The robot cannot turn in place at the goal: it may not find out of there."""
    cells: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)), repr=False, compare=False)
    """(n, 2) centers of its cells (m)."""

    def is_near(self, x: float, y: float, distance: float) -> bool:
        """Return whether one of its cells is within a distance (m) of a point."""
        return bool((np.hypot(self.cells[:, 0] - x, self.cells[:, 1] - y) <= distance).any())


def unknown_space(grid: OccupancyGrid, least_m2: float) -> NDArray[np.bool_]:
    """Return the unknown cells (ny, nx), without groups smaller than `least_m2`; beyond the map's edge nothing is unknown."""
    unknown = grid.data == -1
    labels, _ = _image.label(unknown)
    sizes = np.bincount(np.asarray(labels).ravel())
    return unknown & (sizes >= least_m2 / grid.geometry.resolution**2)[labels]


def travel_costs(costmap: Costmap, start: Pose2D) -> NDArray[np.float64]:
    """Return the cost (ny, nx) of the way from `start` to every cell that the robot's center may enter (m), else infinite.

    A robot that stands in a forbidden cell starts from the nearest allowed one within 0.5 m.
    """
    data, g = costmap.data, costmap.geometry
    open_ = data < INSCRIBED
    result = np.full(g.shape, np.inf)
    cell = g.world_to_cell(start.x, start.y)
    if cell is None:
        return result
    if not open_[cell[1], cell[0]]:
        distance, nearest = _image.distance_transform_edt(~open_, return_indices=True)
        if distance[cell[1], cell[0]] * g.resolution > 0.5:
            return result
        cell = int(nearest[1, cell[1], cell[0]]), int(nearest[0, cell[1], cell[0]])
    labels, _ = _image.label(open_, _EIGHT)
    inside = np.asarray(labels) == labels[cell[1], cell[0]]
    number = np.full(g.shape, -1, np.int64)
    number[inside] = np.arange(int(inside.sum()))
    slow = 1.0 + _COST_WEIGHT * data.astype(np.float64) / INSCRIBED
    rows: list[NDArray[np.int64]] = []
    columns: list[NDArray[np.int64]] = []
    lengths: list[NDArray[np.float64]] = []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: g.ny - dy, max(0, -dx) : g.nx - max(0, dx)]
        there = np.s_[dy:, max(0, dx) : g.nx + min(0, dx)]
        both = inside[here] & inside[there]
        rows.append(number[here][both])
        columns.append(number[there][both])
        lengths.append(math.hypot(dx, dy) * g.resolution * 0.5 * (slow[here][both] + slow[there][both]))
    count = int(inside.sum())
    edges: Any = sparse.csr_matrix(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count)
    )
    found = csgraph.dijkstra(edges, directed=False, indices=int(number[cell[1], cell[0]]))
    result[inside] = found
    return result


def find_frontiers(
    grid: OccupancyGrid,
    costmap: Costmap,
    robot: Pose2D,
    params: ExplorationParams | None = None,
    *,
    turning_radius: float = 0.0,
) -> list[Frontier]:
    """Return the frontiers of a map whose cells are those of the costmap, the next one first.

    The goal of a frontier is the cell nearest to its middle that the robot reaches, over free cells of the map, so never
    behind a wall; where it can, one farther from obstacles than `turning_radius` (m). The order is that of way minus gain;
    frontiers whose goals are nearer to obstacles come after the others, those without a goal last.
    """
    p = params or ExplorationParams()
    g = grid.geometry
    # without the thin lines of single beams beside walls
    free = np.asarray(_image.binary_opening(grid.data == 0, _EIGHT))
    clear = np.asarray(_image.distance_transform_edt(costmap.data != LETHAL)) * g.resolution > turning_radius
    unknown = unknown_space(grid, p.min_unknown)
    edge = free & _image.binary_dilation(unknown)
    labels, _ = _image.label(edge, _EIGHT)
    labels = np.asarray(labels)
    costs = travel_costs(costmap, robot)
    found: list[Frontier] = []
    steps = math.ceil(p.reach / g.resolution)
    for label, box in enumerate(_image.find_objects(labels), start=1):
        ys, xs = box
        top, left = max(0, ys.start - steps), max(0, xs.start - steps)
        near = np.s_[top : ys.stop + steps, left : xs.stop + steps]
        line = labels[near] == label
        size = float(line.sum()) * g.resolution
        if size < p.min_size:
            continue
        iy, ix = np.nonzero(line)
        middle = int(np.argmin(np.square(iy - iy.mean()) + np.square(ix - ix.mean())))
        cells = np.column_stack((ix + left, iy + top)).astype(np.float64) + 0.5
        cells = np.asarray(cells * g.resolution + (g.origin_x, g.origin_y), np.float64)
        x, y = cells[middle].tolist()
        around = _image.binary_dilation(line, _EIGHT, iterations=steps, mask=free[near] | line)
        candidates = around & np.isfinite(costs[near])
        if not candidates.any():
            reason = (
                "the robot does not fit there" if (around & (costmap.data[near] >= INSCRIBED)).any() else "no way there"
            )
            if (around & (costmap.data[near] < INSCRIBED)).any():
                reason = "no way there that is wide enough"
            found.append(Frontier(x, y, size, None, math.inf, reason, cells=cells))
            continue
        tight = not (candidates & clear[near]).any()
        if not tight:
            candidates &= clear[near]
        cy, cx = np.nonzero(candidates)
        best = int(np.argmin(np.square(cy - iy[middle]) + np.square(cx - ix[middle])))
        gx, gy = g.cell_to_world(left + int(cx[best]), top + int(cy[best]))
        uy, ux = np.nonzero(unknown[near] & _image.binary_dilation(line, _EIGHT, iterations=3))
        yaw = math.atan2(float(uy.mean() - cy[best]), float(ux.mean() - cx[best]))
        way = float(costs[near][cy[best], cx[best]])
        found.append(Frontier(x, y, size, Pose2D(gx, gy, yaw), way, tight=tight, cells=cells))
    return sorted(
        found, key=lambda f: (f.goal is None, f.tight, f.distance - p.gain * min(f.size, p.most_gain), f.x, f.y)
    )
