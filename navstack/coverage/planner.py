"""A plan that covers an area: passes along the border, swaths in cells, their order, and the ways between them."""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, clean_frame, require_finite_pose
from navstack.coverage._kernels import FAR, STRAIGHT, flood, is_clear, shortened, way_back
from navstack.coverage.area import Area, make_area, nearest_free
from navstack.coverage.errors import InvalidCoverageRequestError, NothingToCoverError
from navstack.coverage.field import Field, check_field
from navstack.coverage.measure import CoverageFigures, figures_of
from navstack.coverage.params import CoverageParams
from navstack.coverage.swaths import (
    NARROW,
    Canvas,
    Pass,
    best_angle,
    cells_of,
    clear_parts,
    headland_lines,
    pieces_of,
    rotated,
    swaths_in,
)
from navstack.coverage.tour import Choice, best_tour
from navstack.global_planner import dubins_curve, reeds_shepp_curve

PIECE_WIDTHS: Final = 2.5
"""Length of the pieces in which a pass along the border is kept or left out (tool widths)."""
LEAST_GAIN: Final = 0.35
"""A pass that alone covers less than this share of its strip is left out."""
HEADLAND_LOST: Final = 0.01
"""Share of the reachable area that may be lost by leaving out passes along the border, before there are swaths."""
BRIDGED_WIDTHS: Final = 2.0
"""Gaps of a pass along the border up to this length (tool widths) are driven through with the tool off."""
BESIDE_WIDTHS: Final = 2.5
"""Swaths of a cell whose ends are farther apart than this (tool widths) are not joined by a turn."""
ENTRIES: Final = 12
"""Places at which a closed line may begin, at most."""
COARSE_M: Final = 0.3
"""Cells of the grid on which distances for the order are measured (m)."""


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A part of the plan."""

    kind: Literal["headland", "swath", "turn", "travel"]
    points: NDArray[np.float64]
    """(n, 2) (m); the first one is the last one of the segment before."""
    works: bool
    """Whether the tool works."""
    cell: int = -1
    """Cell of a swath."""
    curved: bool = False
    """Whether it is a curve of the turning radius."""

    @property
    def length(self) -> float:
        """Length (m)."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


@dataclass(frozen=True, slots=True, eq=False)
class CoveragePlan:
    """Segments in the order in which they are driven."""

    area: Area
    segments: tuple[Segment, ...]
    figures: CoverageFigures
    swath_angle: float
    """rad."""
    took_s: dict[str, float] = field(default_factory=dict[str, float])
    """Time of each stage (s)."""

    @property
    def planning_time(self) -> float:
        """Time of all stages (s)."""
        return sum(self.took_s.values())

    @property
    def tight(self) -> int:
        """Number of turns and ways that are not curves of the turning radius; a base that turns in place needs no curves."""
        return sum(not segment.works and not segment.curved for segment in self.segments)

    def line(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return all points (n, 2) (m), and whether the tool works from each to the next one."""
        return _line_of(self.segments)


def plan_coverage(
    costmap: Costmap,
    footprint: Footprint,
    start: Pose2D,
    params: CoverageParams,
    *,
    polygon: Field | None = None,
    avoid: NDArray[np.bool_] | None = None,
    done: NDArray[np.bool_] | None = None,
) -> CoveragePlan:
    """Return a plan that covers what a tool at the center of the robot can reach from `start`.

    `costmap` in the frame of `start` and `polygon`; for `avoid` see `make_area`, for `done` see `plan_in`. Raises
    NothingToCoverError and InvalidCoverageRequestError.
    """
    clock = _Clock()
    require_finite_pose(start, "start")
    if clean_frame(params.frame_id) != clean_frame(costmap.frame):
        raise InvalidCoverageRequestError(
            f'frame_id is "{params.frame_id}", but the costmap is in "{costmap.frame}"; give the polygon in that frame'
        )
    if polygon is not None:
        check_field(polygon, costmap.geometry)
    area = make_area(
        costmap, footprint, start, params.operation_width, clearance=params.clearance, polygon=polygon, avoid=avoid
    )
    clock.lap("area")
    return plan_in(area, params, done=done, clock=clock)


class _Clock:
    """Times of stages."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + now - self._last
        self._last = now


def plan_in(
    area: Area, params: CoverageParams, *, done: NDArray[np.bool_] | None = None, clock: _Clock | None = None
) -> CoveragePlan:
    """Return a plan for what is not `done` of an area (as `area.reachable`). Raises NothingToCoverError."""
    clock = clock or _Clock()
    canvas = Canvas(area)
    if done is not None:
        canvas.passes[done & area.reachable] = 1
    headland = _headland(area, params, canvas)
    clock.lap("headland")
    swaths, angle = _swaths(area, params, canvas, NARROW)
    if _share(canvas) < params.min_coverage:  # what is narrower, too
        more, _ = _swaths(
            area, params, canvas, 0.0, first=1 + max((each.cell for each in swaths), default=-1), angle=angle
        )
        swaths += more
    clock.lap("swaths")
    passes = [*headland, *swaths]
    _leave_out(passes, canvas, LEAST_GAIN, params.min_coverage)
    clock.lap("selection")
    ways = _Ways(area.passable)
    units = [*_lines(headland, area), *_chains(swaths, area, params, ways)]
    if not units:
        raise NothingToCoverError("the tool reaches nothing that could be covered", reachable_m2=area.reachable_m2)
    segments = (
        _joined(units, area, ways, clock) if params.generate_route else [s for unit in units for s in unit.ways[0]]
    )
    if params.min_turning_radius > 0.0:
        segments = _curved(segments, area, params)
    if not params.generate_path or not params.generate_route:
        segments = [segment for segment in segments if segment.works]
    points, works = _line_of(segments)
    figures = figures_of(area, points, works)
    clock.lap("figures")
    return CoveragePlan(area, tuple(segments), figures, angle, clock.laps)


def _line_of(segments: Sequence[Segment]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    if not segments:
        return np.zeros((0, 2)), np.zeros(0, np.bool_)
    works = [np.append(np.full(len(s.points) - 1, s.works), False) for s in segments]
    return np.concatenate([s.points for s in segments]), np.concatenate(works)


# --- passes -----------------------------------------------------------------------------------------------------------


def _headland(area: Area, params: CoverageParams, canvas: Canvas) -> list[Pass]:
    if not params.generate_headland:
        return []
    number = max(1, round(params.headland_mode.width / area.operation_width)) if params.headland_mode.width else 1
    passes: list[Pass] = []
    for k, line in enumerate(headland_lines(area, number, area.operation_width)):
        pieces = pieces_of(line, PIECE_WIDTHS * area.operation_width)
        passes += [Pass("headland", piece, k, i) for i, piece in enumerate(pieces)]
    for each in passes:
        canvas.stamp(each.points, 1)
    _leave_out(passes, canvas, LEAST_GAIN, _share(canvas) - HEADLAND_LOST)
    return passes


def _leave_out(passes: list[Pass], canvas: Canvas, least: float, share: float) -> None:
    """Leave out passes, from that with the least gain on, down to `share` of the reachable area.

    The gain is what a pass alone covers, in relation to its strip; passes with a gain of at least `least` stay.
    """
    area = canvas.area
    cell, width = area.grid.resolution, area.operation_width
    budget = int((canvas.passes > 0).sum()) - share * int(area.reachable.sum())
    kept = [each for each in passes if each.keep]
    strips = [max(each.length, 0.5 * width) * width / cell**2 for each in kept]
    queue = [(canvas.stamp(each.points, 0)[1] / strip, k) for k, (each, strip) in enumerate(zip(kept, strips))]
    heapq.heapify(queue)
    while queue and queue[0][0] < least:
        gain, k = heapq.heappop(queue)
        alone = canvas.stamp(kept[k].points, 0)[1]
        if alone / strips[k] > gain + 1e-9:  # another one that covered the same is gone
            heapq.heappush(queue, (alone / strips[k], k))
        elif alone <= budget or alone == 0:
            canvas.stamp(kept[k].points, -1)
            kept[k].keep = False
            budget -= alone


def _share(canvas: Canvas) -> float:
    return float((canvas.passes > 0).sum()) / max(1.0, float(canvas.area.reachable.sum()))


def _swaths(
    area: Area, params: CoverageParams, canvas: Canvas, narrow: float, *, first: int = 0, angle: float | None = None
) -> tuple[list[Pass], float]:
    """Return swaths over what is not covered, and their angle; `narrow`: what is left out (tool widths).

    `first`: index of the first cell; `angle` (rad): that of earlier swaths.
    """
    width = area.operation_width / area.grid.resolution
    needed = area.reachable & (canvas.passes == 0)
    if narrow > 0.0:
        from scipy import ndimage

        radius = max(1, round(0.5 * narrow * width))
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        needed = np.asarray(ndimage.binary_opening(needed, x * x + y * y <= radius * radius), np.bool_)
    mode = params.swath_mode
    fixed = mode.mode == "SET_ANGLE"
    if angle is None:
        angle = mode.best_angle % math.pi if fixed else best_angle(needed, width, mode.step_angle)
    if not needed.any():
        return [], angle
    frame = rotated(needed, area, angle)
    passes: list[Pass] = []
    for number, cell in enumerate(cells_of(frame.mask), first):
        if sum(s.last - s.first + 1 for s in cell) < 0.15 * width * width:
            continue
        found = [swaths_in(cell, frame, width, across=across) for across in (False, True)]
        costs = [_cost(lines) for lines in found]
        lines = found[0] if fixed or costs[0] <= costs[1] else found[1]
        index = 0
        for line in lines:
            for u0, v0, u1, v1 in line:
                parts = clear_parts(area, frame.to_world(u0, v0), frame.to_world(u1, v1))
                passes += [Pass("swath", part, number, index) for part in parts]
                index += 1
    for each in passes:
        canvas.stamp(each.points, 1)
    return passes, angle


def _cost(lines: list[list[tuple[float, ...]]]) -> float:
    """Number of swaths: fewer turns are better; of equal numbers the shorter ones."""
    length = sum(math.hypot(u1 - u0, v1 - v0) for line in lines for u0, v0, u1, v1 in line)
    return sum(len(line) for line in lines) + 1e-6 * length


# --- units of the tour ------------------------------------------------------------------------------------------------


@dataclass(eq=False)
class Unit:
    """What is driven without a way between: ways through it, each a list of segments."""

    ways: list[list[Segment]]

    def ends(self, way: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the first and the last point (m) of a way."""
        return self.ways[way][0].points[0], self.ways[way][-1].points[-1]


def _backwards(segments: list[Segment]) -> list[Segment]:
    return [Segment(s.kind, s.points[::-1], s.works, s.cell) for s in reversed(segments)]


def _lines(passes: list[Pass], area: Area) -> list[Unit]:
    """Units of the passes along the border: closed lines, or stretches of them."""
    units: list[Unit] = []
    by_line: dict[int, list[Pass]] = {}
    for each in passes:
        by_line.setdefault(each.cell, []).append(each)
    gap = BRIDGED_WIDTHS * area.operation_width
    for pieces in by_line.values():
        kept = [k for k, piece in enumerate(pieces) if piece.keep]
        if not kept:
            continue
        n = len(pieces)
        # cut where too much is left out; the pieces of a line close it
        runs: list[list[int]] = [[kept[0]]]
        for k in kept[1:]:
            skipped = sum(pieces[j].length for j in range(runs[-1][-1] + 1, k))
            if skipped <= gap:
                runs[-1] += range(runs[-1][-1] + 1, k + 1)
            else:
                runs.append([k])
        around = [*range(runs[-1][-1] + 1, n), *range(runs[0][0])]
        closes = sum(pieces[j].length for j in around) <= gap
        if closes and len(runs) > 1:
            runs[0] = [*runs.pop(), *around, *runs[0]]
        elif closes:
            runs[0] += around
        for run in runs:
            parts = _merged([pieces[k] for k in run])
            if closes and len(runs) == 1 and len(run) == n:
                units.append(Unit(_around(parts)))
            else:
                units.append(Unit([parts, _backwards(parts)]))
    return units


def _merged(pieces: list[Pass]) -> list[Segment]:
    """Consecutive pieces as segments, one for each stretch with or without work."""
    segments: list[Segment] = []
    for piece in pieces:
        if segments and segments[-1].works == piece.keep:
            points = np.concatenate((segments[-1].points, piece.points[1:]))
            segments[-1] = Segment(segments[-1].kind, points, piece.keep)
        else:
            segments.append(Segment("headland" if piece.keep else "travel", piece.points, piece.keep))
    return segments


def _around(parts: list[Segment]) -> list[list[Segment]]:
    """Ways around a closed line: from several of its corners, in both directions."""
    ways: list[list[Segment]] = []
    corners = [(i, k) for i, part in enumerate(parts) for k in range(len(part.points) - 1)]
    for i, k in corners[:: max(1, math.ceil(len(corners) / ENTRIES))]:
        part = parts[i]
        tail = Segment(part.kind, part.points[k:], part.works)
        head = [Segment(part.kind, part.points[: k + 1], part.works)] if k else []
        way = [tail, *parts[i + 1 :], *parts[:i], *head]
        ways += [way, _backwards(way)]
    return ways


def _chains(passes: list[Pass], area: Area, params: CoverageParams, around: _Ways) -> list[Unit]:
    """Units of the swaths of a cell, joined by turns in the order of the route mode."""
    units: list[Unit] = []
    by_cell: dict[int, list[Pass]] = {}
    for each in passes:
        if each.keep:
            by_cell.setdefault(each.cell, []).append(each)
    for number, swaths in by_cell.items():
        for chain in _connected(swaths, area):
            order = params.route_mode.order(len(chain))
            ways: list[list[Segment]] = []
            for rows in (order, order[::-1]):
                for flip in (0, 1):
                    lines = [
                        chain[k].points if (i + flip) % 2 == 0 else chain[k].points[::-1] for i, k in enumerate(rows)
                    ]
                    ways.append(_with_turns(lines, number, area, around))
            units.append(Unit(ways))
    return units


def _connected(swaths: list[Pass], area: Area) -> list[list[Pass]]:
    """Split the swaths of a cell where two neighbors are not side by side."""
    chains: list[list[Pass]] = []
    for each in swaths:
        if chains:
            last = chains[-1][-1].points
            if min(math.dist(p, q) for p in last for q in each.points) <= BESIDE_WIDTHS * area.operation_width:
                chains[-1].append(each)
                continue
        chains.append([each])
    return chains


def _with_turns(lines: list[NDArray[np.float64]], cell: int, area: Area, ways: _Ways) -> list[Segment]:
    segments: list[Segment] = []
    for line in lines:
        if segments:
            way = ways.between(area, segments[-1].points[-1], line[0])
            segments.append(Segment("turn", way, False, cell))
        segments.append(Segment("swath", line, True, cell))
    return segments


def _curved(segments: list[Segment], area: Area, params: CoverageParams) -> list[Segment]:
    """Replace turns by curves of the turning radius, from heading to heading, where they are free.

    A way that no free curve replaces stays as it is: `CoveragePlan.tight` counts those.
    """
    make = reeds_shepp_curve if params.path_mode.mode == "REEDS_SHEPP" else dubins_curve
    found: list[Segment] = []
    for k, segment in enumerate(segments):
        if segment.works or k == 0 or k + 1 == len(segments):
            found.append(segment)
            continue
        before, after = segments[k - 1].points[-2:], segments[k + 1].points[:2]
        ends = [
            Pose2D(float(at[0]), float(at[1]), math.atan2(b[1] - a[1], b[0] - a[0]))
            for at, (a, b) in ((before[1], before), (after[0], after))
        ]
        curve = make(ends[0], ends[1], params.min_turning_radius)
        points = curve.poses(params.path_mode.turn_point_distance)[:, :2]
        cells = area.to_cells(points)
        clear = all(is_clear(area.passable, *a, *b) for a, b in pairwise(cells.tolist()))
        found.append(Segment(segment.kind, points, False, segment.cell, curved=True) if clear else segment)
    return found


# --- ways -------------------------------------------------------------------------------------------------------------


class _Ways:
    """Distances and ways around the obstacles of a grid of free centers."""

    def __init__(self, free: NDArray[np.bool_]) -> None:
        self.free = free
        self._distance = np.empty(free.size, np.int32)
        self._after = np.empty(free.size + 8, np.int32)
        self._before = np.empty(free.size + 8, np.int32)

    def flood(self, source: int, target: int = -1) -> NDArray[np.int32]:
        """Return the distances from a cell, in fifths of a cell; overwritten by the next call."""
        flood(self.free, source, target, self._distance, self._after, self._before)
        return self._distance

    def between(self, area: Area, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a way (n, 2) (m) between two points: straight where that is free. `area` has this grid."""
        ends = area.to_cells(np.array((a, b)))
        if is_clear(self.free, *ends[0].tolist(), *ends[1].tolist()):
            return np.array((a, b))
        nx = self.free.shape[1]
        source, target = (iy * nx + ix for ix, iy in (_cell_of(self.free, end) for end in ends))
        distance = self.flood(source, target)
        if distance[target] >= FAR:
            raise NothingToCoverError("two passes are not connected", start=a.tolist(), end=b.tolist())
        way = way_back(self.free, distance, target).astype(np.float64)
        way = np.concatenate((ends[:1], way, ends[1:]))
        return area.to_world(way[shortened(self.free, way, math.inf)])


def _cell_of(free: NDArray[np.bool_], point: NDArray[np.float64]) -> tuple[int, int]:
    """Return the free center nearest to a point in cells: one of the four around it."""
    x, y = point.tolist()
    around = [(ix, iy) for ix in (math.floor(x), math.floor(x) + 1) for iy in (math.floor(y), math.floor(y) + 1)]
    ny, nx = free.shape
    inside = [(ix, iy) for ix, iy in around if 0 <= ix < nx and 0 <= iy < ny and free[iy, ix]]
    return min(inside, key=lambda c: (c[0] - x) ** 2 + (c[1] - y) ** 2)


def _joined(units: list[Unit], area: Area, ways: _Ways, clock: _Clock) -> list[Segment]:
    """Return the segments of the units in the order of a short tour, with the ways between them."""
    ix, iy = nearest_free(area.passable, area.geometry, area.start)
    begin = np.array(area.geometry.cell_to_world(ix, iy))
    sites: dict[tuple[int, int], int] = {}
    factor = max(1, round(COARSE_M / area.geometry.resolution))
    coarse = _coarse(area.passable, factor)

    def site(point: NDArray[np.float64]) -> int:
        u, v = np.rint(area.to_cells(point[None])[0]).astype(np.int64) // factor
        return sites.setdefault((int(u), int(v)), len(sites))

    start = site(begin)
    choices: list[list[Choice]] = []
    for unit in units:
        lengths = [sum(s.length for s in way) for way in unit.ways]
        ends = [unit.ends(k) for k in range(len(unit.ways))]
        choices.append([Choice(site(a), site(b), length) for (a, b), length in zip(ends, lengths)])
    blocks = _Ways(coarse)
    cells = np.array([v * coarse.shape[1] + u for u, v in sites])
    distances = np.empty((len(cells), len(cells)))
    for k, cell in enumerate(cells.tolist()):
        distances[k] = blocks.flood(cell)[cells]
    distances *= factor * area.geometry.resolution / STRAIGHT
    clock.lap("distances")
    tour = best_tour(choices, distances, start)
    clock.lap("order")
    segments: list[Segment] = []
    at = begin
    for unit, way in tour:
        parts = units[unit].ways[way]
        if math.dist(at, parts[0].points[0]) > 1e-6:
            segments.append(Segment("travel", ways.between(area, at, parts[0].points[0]), False))
        segments += parts
        at = parts[-1].points[-1]
    clock.lap("ways")
    return segments


def _coarse(free: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return a coarser grid: a cell is free if one of its `factor` x `factor` cells is."""
    ny, nx = free.shape
    padded = np.pad(free, ((0, -ny % factor), (0, -nx % factor)))
    blocks = padded.reshape(padded.shape[0] // factor, factor, -1, factor)
    return np.asarray(blocks.any(axis=(1, 3)), np.bool_)
