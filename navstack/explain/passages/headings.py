"""The headings at which a footprint can stand in an opening, exactly: no cell under it is lethal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, UNKNOWN, Costmap, Footprint, Pose2D
from navstack.core.footprint import CIRCLE_VERTICES
from navstack.core.footprint_kernels import overlaps_lethal, place_footprint
from navstack.explain.passages.report import Passage

_ROOM: Final = 0.01
"""Cells: room that the planners over poses keep around a footprint."""
_COARSE: Final = (math.radians(2.0), 4)
"""Steps of the headings (rad), and positions per cell."""
_FINE: Final = (math.radians(0.5), 16)
"""The steps where the coarse ones find nothing."""


@dataclass(frozen=True, slots=True)
class HeadingRange:
    """Headings from `low` to `high` (rad, counter-clockwise), and the pose in their middle."""

    low: float
    high: float
    """At most one turn above `low`."""
    pose: Pose2D
    """On the line between the obstacles, where the footprint is free."""


def is_round(footprint: Footprint) -> bool:
    """Whether a footprint is the polygon that stands for a `robot_radius`."""
    spread = footprint.circumscribed_radius - footprint.inscribed_radius
    limit = (1.0 - math.cos(math.pi / CIRCLE_VERTICES) + 1e-6) * footprint.circumscribed_radius
    return len(footprint.vertices) == CIRCLE_VERTICES and spread < limit


def blocked_costs(costmap: Costmap, *, unknown_blocked: bool) -> NDArray[np.uint8]:
    """The costs (ny, nx), with unknown cells lethal if they block."""
    return np.where(costmap.data == UNKNOWN, LETHAL, costmap.data).astype(np.uint8) if unknown_blocked else costmap.data


def free_headings(
    costmap: Costmap, costs: NDArray[np.uint8], footprint: Footprint, passage: Passage
) -> tuple[HeadingRange, ...]:
    """The headings at which the robot fits somewhere with its base on the line between the two obstacles, widest range first.

    Every motion through the opening has the base on that line once, at one of these headings.
    """
    a, b = np.array(passage.ends)
    if math.dist(a, b) < 2.0 * footprint.inscribed_radius:
        return ()  # the inscribed circle around the base does not fit between the centres of the two cells
    for step, per_cell in (_COARSE, _FINE):
        positions = _positions(a, b, costmap.geometry.resolution / per_cell)
        found = _Fit(costmap, costs, footprint, positions).ranges(step)
        if found:
            return found
    return ()


def _positions(a: NDArray[np.float64], b: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Points (n, 2) between two points, from the middle outward."""
    half = math.floor(0.5 * math.dist(a, b) / step)
    along = np.arange(-half, half + 1) * (step / math.dist(a, b))
    return 0.5 * (a + b) + (b - a) * along[np.argsort(np.abs(along), kind="stable")][:, None]


class _Fit:
    """Where on a line a footprint is free."""

    def __init__(
        self, costmap: Costmap, costs: NDArray[np.uint8], footprint: Footprint, positions: NDArray[np.float64]
    ) -> None:
        g = costmap.geometry
        self.costs, self.grid, self.positions = costs, (g.origin_x, g.origin_y, g.resolution), positions
        self.corners = np.ascontiguousarray(Footprint(footprint.vertices, _ROOM * g.resolution).vertices.T)
        self.placed = np.empty_like(self.corners)

    def at(self, yaw: float) -> int:
        """The first position where the footprint is free, -1 without one."""
        for i, (x, y) in enumerate(self.positions):
            if place_footprint(self.costs, *self.grid, self.corners, x, y, yaw, self.placed) and not overlaps_lethal(
                self.costs, self.placed
            ):
                return i
        return -1

    def ranges(self, step: float) -> tuple[HeadingRange, ...]:
        """The ranges of headings in steps (rad), the widest first."""
        n = round(2.0 * math.pi / step)
        free = np.array([self.at(k * step) >= 0 for k in range(n)])
        if free.all():
            return (self._range(0.0, 2.0 * math.pi),)
        begins = np.flatnonzero(free & ~np.roll(free, 1))
        ends = np.flatnonzero(free & ~np.roll(free, -1))
        found: list[HeadingRange] = []
        for i in begins.tolist():
            end = int(ends[int(np.searchsorted(ends, i)) % len(ends)])
            found.append(self._range(i * step, (end - i) % n * step))
        return tuple(sorted(found, key=lambda r: r.low - r.high))

    def _range(self, low: float, width: float) -> HeadingRange:
        low = math.remainder(low, 2.0 * math.pi)
        middle = low + 0.5 * width
        position = self.at(middle)
        if position < 0:  # between two steps
            middle = low
            position = self.at(middle)
        x, y = self.positions[position]
        return HeadingRange(low, low + width, Pose2D(float(x), float(y), math.remainder(middle, 2.0 * math.pi)))
