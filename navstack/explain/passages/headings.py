"""The headings at which a footprint can stand in an opening, exactly: no cell under it is lethal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D
from navstack.explain.passages._heading_kernels import first_free
from navstack.explain.passages.report import Passage

_ROOM: Final = 0.01
"""Cells: room that the planners over poses keep around a footprint."""
_STEPS: Final = (math.radians(2.0), math.radians(0.5))
"""Steps of the headings (rad); the second one where the first one finds nothing."""
_PER_CELL: Final = 16
"""Positions per cell on the line between the obstacles."""


@dataclass(frozen=True, slots=True)
class HeadingRange:
    """Headings from `low` to `high` (rad, counter-clockwise), and the pose in their middle."""

    low: float
    high: float
    """At most one turn above `low`."""
    pose: Pose2D
    """On the line between the obstacles, where the footprint is free."""


def free_headings(costmap: Costmap, footprint: Footprint, passage: Passage) -> tuple[HeadingRange, ...]:
    """The headings at which the robot fits somewhere with its base on the line between the two obstacles, widest range first.

    Every motion through the opening has the base on that line once, at one of these headings.
    """
    # the inscribed circle around the base does not reach the centres of the two cells
    points = along_line(
        passage, footprint.inscribed_radius if footprint.contains_center else 0.0, costmap.geometry.resolution
    )
    if not len(points):
        return ()
    fit = _Fit(costmap, footprint, points)
    return next((found for found in map(fit.ranges, _STEPS) if found), ())


def along_line(passage: Passage, margin: float, resolution: float) -> NDArray[np.float64]:
    """Points (n, 2) on the line between the two obstacles, from the middle outward, up to `margin` (m) before its ends."""
    a, b = np.array(passage.ends)
    length = math.dist(a, b)
    step = resolution / _PER_CELL
    half = math.floor((0.5 * length - margin) / step)
    along = np.arange(-half, half + 1) * (step / length)
    along = along[np.argsort(np.abs(along), kind="stable")]
    return 0.5 * (a + b) + (b - a) * along[:, None]


def padded_corners(footprint: Footprint, resolution: float) -> NDArray[np.float64]:
    """The corners (2, n) of a footprint in metres, with the room that the planners keep around it."""
    padded = footprint.polygon.buffer(_ROOM * resolution, join_style="mitre")
    return np.ascontiguousarray(np.asarray(padded.exterior.coords)[:-1].T)


class _Fit:
    """At which of `positions` (n, 2) on a line a footprint is free."""

    def __init__(self, costmap: Costmap, footprint: Footprint, positions: NDArray[np.float64]) -> None:
        g = costmap.geometry
        self.costs, self.grid, self.positions = costmap.data, (g.origin_x, g.origin_y, g.resolution), positions
        self.corners = padded_corners(footprint, g.resolution)

    def at(self, yaws: NDArray[np.float64]) -> NDArray[np.int64]:
        """For each heading (k,) the first position where the footprint is free, -1 without one."""
        first = np.empty(len(yaws), np.int64)
        first_free(self.costs, *self.grid, self.corners, self.positions, yaws, first)
        return first

    def ranges(self, step: float) -> tuple[HeadingRange, ...]:
        """The ranges of headings in steps (rad), the widest first."""
        n = round(2.0 * math.pi / step)
        free = self.at(np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)) >= 0
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
        yaws = np.array([low + 0.5 * width, low])
        position = self.at(yaws)
        k = int(position[0] < 0)  # the middle may be between two steps
        x, y = self.positions[position[k]]
        return HeadingRange(low, low + width, Pose2D(float(x), float(y), math.remainder(float(yaws[k]), 2.0 * math.pi)))
