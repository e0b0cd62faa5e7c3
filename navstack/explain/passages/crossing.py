"""How a robot with a turning radius gets through an opening: the motion with the fewest changes of direction.

The search is over all poses in the opening, i.e. with a part of the robot on the line between the two obstacles: first from the
line to both sides, which shows where the robot can be out of the opening, then from one side to the other. So it is small,
and complete up to its steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path
from navstack.explain.passages import _crossing_kernels as kernels
from navstack.explain.passages.headings import HeadingRange, along_line, padded_corners
from navstack.explain.passages.report import Passage

_STEP: Final = 2.0
"""Length of a motion in cells of the search: a motion leads to another cell."""
_CHECK: Final = 0.25
"""Distance of the poses that are checked along a motion, in cells of the costmap."""
_FINER: Final = 8
"""Times as many poses are checked along the way that is found."""
_WIDE: Final = 1.8
"""Circumscribed radii: half of the side of the square from which on its cells grow with the opening instead of the robot."""
_STATES: Final = 1_000_000
"""Poses of one search, at most: 32 MB."""


class _Fineness(NamedTuple):
    """Steps of a search; it keeps one pose per cell, heading and direction of travel."""

    per_radius: int
    """Cells per circumscribed radius."""
    headings: int
    every: int
    """Of the points on the line between the obstacles, from which the search begins."""
    turn: float
    """Step of the headings there (rad)."""
    changes: int
    """Most changes of direction."""


_QUICK: Final = (_Fineness(36, 180, 64, math.radians(45.0), 0), _Fineness(36, 180, 8, math.radians(10.0), 0))
"""Find most ways without a change of direction; the first one also where the robot has much room, and so many poses."""
_FULL: Final = (_Fineness(36, 180, 1, math.radians(1.0), 99), _Fineness(72, 360, 1, math.radians(0.5), 99))
"""The second one where the first one finds nothing."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A motion through an opening."""

    path: Path
    """From one side to the other, free for the whole footprint."""
    changes: int
    """Changes between driving forward and backward."""


class _Window(NamedTuple):
    """The poses around an opening. Lengths in cells of the costmap."""

    bar: NDArray[np.float64]
    settings: NDArray[np.void]
    shape: tuple[int, ...]
    """(2, headings, ny, nx) of the cells of the search: directions of travel, headings, positions."""


class CrossingSearch:
    """Searches motions through openings of one costmap, for one footprint and turning radius (m)."""

    def __init__(self, costmap: Costmap, footprint: Footprint, radius: float) -> None:
        g = costmap.geometry
        self.costmap, self.costs = costmap, np.ascontiguousarray(costmap.data)
        self.corners = padded_corners(footprint, g.resolution) / g.resolution
        self.hull = _hull_with_base(self.corners)
        self.reach = float(np.hypot(*self.corners).max())
        self.curvature = g.resolution / radius
        self.nodes, self.ends = np.empty(_STATES, kernels.NODE), np.empty((_STATES, 2), np.int32)
        self.limited = False
        """Whether a search for the last passage ended at the limit of poses."""

    def through(self, passage: Passage, headings: tuple[HeadingRange, ...]) -> Crossing | None:
        """The way with the fewest changes of direction; None if none is found."""
        self.limited = False
        found = (self._with(fineness, passage, headings) for fineness in (*_QUICK, *_FULL))
        return next((way for way in found if way is not None), None)

    def _with(self, fineness: _Fineness, passage: Passage, headings: tuple[HeadingRange, ...]) -> Crossing | None:
        window = self._window(passage, fineness)
        seen = np.zeros(window.shape, np.bool_)
        g = self.costmap.geometry
        points = (along_line(passage, 0.0, g.resolution)[:: fineness.every] - (g.origin_x, g.origin_y)) / g.resolution
        yaws = np.concatenate(
            [[0.5 * (r.low + r.high), *np.arange(r.low, r.high + 1e-9, fineness.turn)] for r in headings]
        )
        count = kernels.add_seeds(self.costs, self.corners, window.settings, points, yaws, seen, self.nodes)
        found = self._search(window, seen, count, 0)
        ends = self.ends[:found]
        out, sides = self.nodes[ends[:, 0]], ends[:, 1].copy()
        out["parent"], out["direction"] = -1, 0
        for side in (1, -1):
            starts = out[sides == -side]
            if len(starts) in (0, found):
                return None
            path = self._from(starts, window, side)
            if path is not None:
                return Crossing(path, path.cusps)
        return None

    def _from(self, starts: NDArray[np.void], window: _Window, side: int) -> Path | None:
        """A way from one of the poses `starts` to one side; with more checks if the first one is not free between its checks."""
        window = window._replace(settings=window.settings.copy())
        coarse = int(window.settings["checks"][0])
        for checks in (coarse, _FINER * coarse):
            window.settings["checks"] = checks
            self.nodes[: len(starts)] = starts
            if not self._search(window, np.zeros(window.shape, np.bool_), len(starts), side):
                return None
            last = int(self.ends[0, 0])
            if kernels.way_is_free(self.costs, self.corners, window.settings, self.nodes, last, _FINER * coarse):
                return self._path(last)
        return None

    def _search(self, window: _Window, seen: NDArray[np.bool_], count: int, side: int) -> int:
        """Search from the first `count` nodes to one side of the line, or to both (0); return how many poses are out."""
        found = kernels.search(
            self.costs, self.corners, self.hull, window.bar, window.settings, seen, self.nodes, count, side, self.ends
        )
        self.limited = self.limited or bool(window.settings["full"][0])
        return found

    def _window(self, passage: Passage, fineness: _Fineness) -> _Window:
        g = self.costmap.geometry
        bar = (np.array(passage.ends) - (g.origin_x, g.origin_y)) / g.resolution
        half = 0.5 * math.dist(*bar) + self.reach
        cell = max(self.reach, half / _WIDE) / fineness.per_radius
        settings = np.zeros(1, kernels.SETTINGS)
        settings["x"], settings["y"] = bar.mean(axis=0) - half
        settings["cell"], settings["step"], settings["curvature"] = cell, _STEP * cell, self.curvature
        settings["changes"] = fineness.changes
        settings["checks"] = math.ceil(_STEP * cell * self._fastest() / _CHECK)
        return _Window(bar.ravel(), settings, (2, fineness.headings, *[math.ceil(2.0 * half / cell)] * 2))

    def _fastest(self) -> float:
        """How far a corner moves per distance along the tightest arc, at most."""
        return float(np.hypot(1.0 + np.abs(self.corners[1]) * self.curvature, self.corners[0] * self.curvature).max())

    def _path(self, last: int) -> Path:
        """The poses that lead to a node."""
        chain = [last]
        while (parent := int(self.nodes[chain[-1]]["parent"])) >= 0:
            chain.append(parent)
        way: Any = self.nodes[chain[::-1]]
        g = self.costmap.geometry
        x, y = way["x"] * g.resolution + g.origin_x, way["y"] * g.resolution + g.origin_y
        yaw = np.remainder(way["yaw"] + np.pi, 2.0 * np.pi) - np.pi
        return Path(np.column_stack((x, y, yaw)), self.costmap.frame)


def _hull_with_base(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The convex hull (2, n) of corners (2, m) and the base, counterclockwise."""
    import shapely

    hull: Any = shapely.convex_hull(shapely.MultiPoint(np.vstack((corners.T, (0.0, 0.0)))))
    outline = np.asarray(shapely.geometry.polygon.orient(hull).exterior.coords)[:-1]
    return np.ascontiguousarray(outline.T)


def crossings(poses: NDArray[np.float64], passage: Passage) -> NDArray[np.int64]:
    """Indices i at which a path (n, 3) crosses the line between the ends of a passage between pose i and i + 1."""
    (ax, ay), (bx, by) = passage.ends
    length = math.dist(*passage.ends)
    side = ((bx - ax) * (poses[:, 1] - ay) - (by - ay) * (poses[:, 0] - ax)) / length
    share = ((poses[:, 0] - ax) * (bx - ax) + (poses[:, 1] - ay) * (by - ay)) / length**2
    at = np.flatnonzero((side[1:] > 0.0) != (side[:-1] > 0.0))
    weight = side[at] / (side[at] - side[at + 1])
    where = share[at] + weight * (share[at + 1] - share[at])
    return at[(where >= 0.0) & (where <= 1.0)]
