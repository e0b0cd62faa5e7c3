"""How a robot with a turning radius gets through an opening: the motion with the fewest changes of direction.

The search is over all poses in the opening, i.e. with a part of the robot on the line between the two obstacles: first from the
line to both sides, which shows where the robot can be out of the opening, then from one side to the other. So it is small,
and complete up to its steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path, Pose2D
from navstack.explain import _crossing_kernels as kernels
from navstack.explain._crossing_kernels import first_free

Ends = tuple[tuple[float, float], tuple[float, float]]
"""Two obstacles (x, y in m) with an opening between them."""
Verdict = Literal["free", "turns", "fits", "stuck", "blocked"]
VERDICT_TEXTS: Final[dict[Verdict, str]] = {
    "free": "passable",
    "turns": "passable with changes of direction",
    "fits": "the robot fits",
    "stuck": "fits, no way found",
    "blocked": "not passable",
}

# --- headings at which a footprint fits -------------------------------------------------------------------------------


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


def free_headings(costmap: Costmap, footprint: Footprint, ends: Ends) -> tuple[HeadingRange, ...]:
    """Return the headings at which the robot fits with its base on the line between the two obstacles, widest range first.

    Every motion through the opening has the base on that line once, at one of these headings.
    """
    # the inscribed circle around the base does not reach the centers of the two cells
    points = along_line(
        ends, footprint.inscribed_radius if footprint.contains_center else 0.0, costmap.geometry.resolution
    )
    if not len(points):
        return ()
    fit = _Fit(costmap, footprint, points)
    return next((found for found in map(fit.ranges, _STEPS) if found), ())


def along_line(ends: Ends, margin: float, resolution: float) -> NDArray[np.float64]:
    """Points (n, 2) on the line between the two obstacles, from the middle outward, up to `margin` (m) before its ends."""
    a, b = np.array(ends)
    length = math.dist(a, b)
    step = resolution / _PER_CELL
    half = math.floor((0.5 * length - margin) / step)
    along = np.arange(-half, half + 1) * (step / length)
    along = along[np.argsort(np.abs(along), kind="stable")]
    return 0.5 * (a + b) + (b - a) * along[:, None]


def padded_corners(footprint: Footprint, resolution: float) -> NDArray[np.float64]:
    """Return the corners (2, n) of a footprint in meters, with the room that the planners keep around it."""
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
        """Return the ranges of headings in steps (rad), the widest first."""
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
        """Whether the last search ended at the limit of poses."""

    def through(self, ends: Ends, headings: tuple[HeadingRange, ...]) -> Crossing | None:
        """Return the way with the fewest changes of direction; None if none is found."""
        self.limited = False
        found = (self._with(fineness, ends, headings) for fineness in (*_QUICK, *_FULL))
        return next((way for way in found if way is not None), None)

    def _with(self, fineness: _Fineness, ends: Ends, headings: tuple[HeadingRange, ...]) -> Crossing | None:
        window = self._window(ends, fineness)
        seen = np.zeros(window.shape, np.bool_)
        g = self.costmap.geometry
        points = (along_line(ends, 0.0, g.resolution)[:: fineness.every] - (g.origin_x, g.origin_y)) / g.resolution
        yaws = np.concatenate(
            [[0.5 * (r.low + r.high), *np.arange(r.low, r.high + 1e-9, fineness.turn)] for r in headings]
        )
        count = kernels.add_seeds(self.costs, self.corners, window.settings, points, yaws, seen, self.nodes)
        found = self._search(window, seen, count, 0)
        outside = self.ends[:found]
        out, sides = self.nodes[outside[:, 0]], outside[:, 1].copy()
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
        """Return a way from one of the poses `starts` to one side; with more checks if the first one is not free between."""
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

    def _window(self, ends: Ends, fineness: _Fineness) -> _Window:
        g = self.costmap.geometry
        bar = (np.array(ends) - (g.origin_x, g.origin_y)) / g.resolution
        half = 0.5 * math.dist(*bar) + self.reach
        cell = max(self.reach, half / _WIDE) / fineness.per_radius
        settings = np.zeros(1, kernels.SETTINGS)
        settings["x"], settings["y"] = bar.mean(axis=0) - half
        settings["cell"], settings["step"], settings["curvature"] = cell, _STEP * cell, self.curvature
        settings["changes"] = fineness.changes
        settings["checks"] = math.ceil(_STEP * cell * self._fastest() / _CHECK)
        return _Window(bar.ravel(), settings, (2, fineness.headings, *[math.ceil(2.0 * half / cell)] * 2))

    def _fastest(self) -> float:
        """Return how far a corner moves per distance along the tightest arc, at most."""
        return float(np.hypot(1.0 + np.abs(self.corners[1]) * self.curvature, self.corners[0] * self.curvature).max())

    def _path(self, last: int) -> Path:
        """Return the poses that lead to a node."""
        chain = [last]
        while (parent := int(self.nodes[chain[-1]]["parent"])) >= 0:
            chain.append(parent)
        way: Any = self.nodes[chain[::-1]]
        g = self.costmap.geometry
        x, y = way["x"] * g.resolution + g.origin_x, way["y"] * g.resolution + g.origin_y
        yaw = np.remainder(way["yaw"] + np.pi, 2.0 * np.pi) - np.pi
        return Path(np.column_stack((x, y, yaw)), self.costmap.frame)


def _hull_with_base(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the convex hull (2, n) of corners (2, m) and the base, counterclockwise."""
    import shapely

    hull: Any = shapely.convex_hull(shapely.MultiPoint(np.vstack((corners.T, (0.0, 0.0)))))
    outline = np.asarray(shapely.geometry.polygon.orient(hull).exterior.coords)[:-1]
    return np.ascontiguousarray(outline.T)


# --- what an opening means for a footprint ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ShapePassage:
    """What an opening means for a footprint."""

    headings: tuple[HeadingRange, ...]
    """At which the robot fits with its base between the two obstacles, the widest range first."""
    changes: int | None
    """Changes between forward and backward of the way found through it; None without a turning radius, and without a way."""
    path: Path | None
    """That way."""
    searched: bool
    """Whether a way was searched: with a turning radius only."""
    limited: bool = False
    """Whether no way was found, and a search ended at its limit of poses."""

    @property
    def verdict(self) -> Verdict:
        """Whether the robot passes: from wholly on one side of the opening to wholly on the other.

        `blocked` and the ways of `free` and `turns` are exact; `stuck` may miss a way that needs finer steps than the search.

        `fits`: without a turning radius no way is searched.
        """
        if not self.headings:
            return "blocked"
        if not self.searched:
            return "fits"
        return "stuck" if self.changes is None else "turns" if self.changes else "free"

    def as_dict(self) -> dict[str, Any]:
        """Return the answer for JSON; headings in radians."""
        return {
            "verdict": self.verdict,
            "headings": [[r.low, r.high] for r in self.headings],
            "changes_of_direction": self.changes,
            "limit_reached": self.limited,
            "path": None if self.path is None else self.path.poses.tolist(),
        }


def shape_passages(
    costmap: Costmap,
    footprint: Footprint,
    turning_radius: float,
    openings: Sequence[Ends],
    progress: Callable[[int, int], None] | None = None,
) -> tuple[ShapePassage, ...]:
    """Return what each opening of a costmap in which all walls are lethal means for a footprint (with padding).

    With a `turning_radius` (m) of 0, only the headings are computed. `progress(done, total)` is called after each opening.
    """
    search = CrossingSearch(costmap, footprint, turning_radius) if turning_radius > 0.0 else None
    found: list[ShapePassage] = []
    for ends in openings:
        headings = free_headings(costmap, footprint, ends)
        crossing = search.through(ends, headings) if search is not None and headings else None
        changes, path = (None, None) if crossing is None else (crossing.changes, crossing.path)
        limited = search is not None and crossing is None and bool(headings) and search.limited
        found.append(ShapePassage(headings, changes, path, search is not None, limited))
        if progress is not None:
            progress(len(found), len(openings))
    return tuple(found)
