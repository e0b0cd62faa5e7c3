"""Where the tool works: passes along the border of the area, and straight swaths in cells of what they leave.

Cells are those of the boustrophedon decomposition (H. Choset, Coverage of known spaces: the boustrophedon cellular
decomposition, 2000): a line sweeps the area, and a new cell begins where the number of stretches on it changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.coverage._kernels import is_clear, rows_across, shortened, stamp
from navstack.coverage.area import Area, distance_to

BORDER_LEVEL: Final = 0.999
"""Distance (cells) from the first center that is not free: just outside the outermost free centers."""
END_INSET: Final = 0.42
"""A swath ends this far (tool widths) inside the edge of what it must cover: the tool is round."""
SMOOTHING: Final = 0.6
"""Cells by which a pass along the border may cut its steps short."""
SPARE: Final = 0.2
"""Tool widths that may stay uncovered between the swaths of a cell: one less is driven for less than that."""
COARSE_RAD: Final = 0.1
"""Step of the first search for the best angle (rad)."""
CLOSE: Final = 1.05
"""Angles with up to so many times the fewest stretches are compared exactly."""
LINE_SHARE: Final = 0.3
"""Distance of the lines that are counted for it (distances of swaths): closer ones depend less on where they are."""
MAIN_SHARE: Final = 0.3
"""A cell goes on past a branch if this share of its stretch does: a notch or a niche at its side is no reason for a new one."""
NARROW: Final = 0.25
"""What is narrower than this (tool widths) gets no swath of its own."""


@dataclass(eq=False)
class Pass:
    """A stretch on which the tool works: a swath, or a piece of the border."""

    kind: str
    """`headland` or `swath`."""
    points: NDArray[np.float64]
    """(n, 2) (m)."""
    cell: int = -1
    """Index of the cell of a swath; of a piece of the border, of its line."""
    index: int = 0
    """Place in the cell or along the line."""
    keep: bool = True

    @property
    def length(self) -> float:
        """Length (m)."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


class Canvas:
    """How many passes cover each cell of the grid of `area`."""

    def __init__(self, area: Area) -> None:
        self.area = area
        self.passes = np.zeros(area.grid.shape, np.int32)
        self._mark = np.zeros(area.grid.shape, np.int32)
        self._number = 0
        self.radius = 0.5 * area.operation_width / area.grid.resolution

    def stamp(self, points: NDArray[np.float64], change: int) -> tuple[int, int]:
        """Add a pass (1), take it away (-1) or look (0); returns its cells, and those that no other pass covers."""
        self._number += 1
        cells = self.area.to_grid(points)
        found = stamp(cells, self.radius, 0.5, self.area.reachable, self.passes, self._mark, self._number, change)
        return int(found[0]), int(found[1])


def headland_lines(area: Area, number: int, spacing: float) -> list[NDArray[np.float64]]:
    """Return closed lines (n, 2) (m) along the border of the free positions, `number` of them `spacing` (m) apart."""
    from contourpy import contour_generator

    inside = distance_to(~np.pad(area.free, 1))
    generator = contour_generator(z=inside)
    lines: list[NDArray[np.float64]] = []
    for k in range(number):
        for line in generator.lines(BORDER_LEVEL + k * spacing / area.geometry.resolution):
            cells = np.ascontiguousarray(line, np.float64) - 1.0
            if k == 0:  # on the centers themselves
                cells = np.where(np.abs(cells - np.rint(cells)) < 0.002, np.rint(cells), cells)
            kept = shortened(area.free, cells, SMOOTHING)
            lines.append(area.to_world(cells[kept]))
    return lines


def pieces_of(line: NDArray[np.float64], length: float) -> list[NDArray[np.float64]]:
    """Cut a polyline (n, 2) into pieces of about `length` (m)."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    at = np.concatenate(([0.0], np.cumsum(steps)))
    total = float(at[-1])
    if total <= 0.0:
        return [line[:1].repeat(2, axis=0)]
    cuts = np.linspace(0.0, total, max(1, round(total / length)) + 1)
    pieces: list[NDArray[np.float64]] = []
    for a, b in pairwise(cuts.tolist()):
        inner = line[(at > a + 1e-9) & (at < b - 1e-9)]
        ends = np.column_stack([np.interp((a, b), at, line[:, i]) for i in (0, 1)])
        pieces.append(np.concatenate((ends[:1], inner, ends[1:])))
    return pieces


def best_angle(needed: NDArray[np.bool_], spacing: float, step: float) -> float:
    """Return the angle (rad) in [0, pi) whose lines, `spacing` (cells) apart, cross `needed` in the fewest stretches.

    That is the direction with the fewest swaths, and so turns. Angles are `step` (rad) apart: first some of them, then those
    around the best. Of equals the smallest.
    """
    angles = np.arange(0.0, math.pi - 1e-9, step)
    stride = max(1, round(COARSE_RAD / step))
    counts: dict[int, int] = {}

    def count(candidates: Iterable[int]) -> None:
        for k in candidates:
            if k not in counts:
                counts[k] = int(rows_across(needed, float(angles[k]), LINE_SHARE * spacing))

    count(range(0, len(angles), stride))
    best = min(counts, key=lambda k: (counts[k], k))
    count(k % len(angles) for k in range(best - stride + 1, best + stride))
    # close ones are counted again on every line, where chance matters less
    close = [k for k, number in counts.items() if number <= CLOSE * min(counts.values())]
    exact = {k: int(rows_across(needed, float(angles[k]), 1.0)) for k in close}
    return float(angles[min(exact, key=lambda k: (exact[k], k))])


class Stretch(NamedTuple):
    """Cells `first` to `last` of a row."""

    row: int
    first: int
    last: int

    @property
    def length(self) -> int:
        """Number of its cells."""
        return self.last - self.first + 1


def cells_of(mask: NDArray[np.bool_]) -> list[list[Stretch]]:
    """Return the cells of the boustrophedon decomposition of `mask`, swept row by row: a stretch of each of its rows."""
    cells: list[list[Stretch]] = []
    open_: list[tuple[Stretch, int]] = []
    for row in range(mask.shape[0]):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], mask[row].view(np.int8), [0]))))
        here = [Stretch(row, int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2])]
        before = [[k for k, (old, _) in enumerate(open_) if _touch(old, new)] for new in here]
        heirs: dict[int, int] = {}  # of an open cell: the stretch that goes on with most of it
        for j, found in enumerate(before):
            for k in found:
                if k not in heirs or here[j].length > here[heirs[k]].length:
                    heirs[k] = j
        now: list[tuple[Stretch, int]] = []
        for j, (new, found) in enumerate(zip(here, before)):
            main = max(found, key=lambda k: open_[k][0].length, default=-1)
            if main >= 0 and heirs[main] == j and _goes_on(open_[main][0], new, found, before):
                index = open_[main][1]
                cells[index].append(new)
            else:
                index = len(cells)
                cells.append([new])
            now.append((new, index))
        open_ = now
    return cells


def _goes_on(old: Stretch, new: Stretch, found: list[int], before: list[list[int]]) -> bool:
    """Return True if `new` continues the cell of `old`: alone, or with most of its length."""
    splits = sum(any(k in other for k in found) for other in before) > 1
    if len(found) == 1 and not splits:
        return True
    longest = max(old.length, new.length)
    return min(old.length, new.length) >= MAIN_SHARE * longest


def _touch(a: Stretch, b: Stretch) -> bool:
    return a.first <= b.last and b.first <= a.last


@dataclass(eq=False)
class RotatedMask:
    """A mask whose rows are lines at an angle."""

    mask: NDArray[np.bool_]
    angle: float
    """Of a row (rad)."""
    origin: tuple[float, float]
    """Position (m) of the center of [0, 0]."""
    resolution: float
    """m."""

    def to_world(self, u: float, v: float) -> tuple[float, float]:
        """Return the position (m) of column `u` and row `v`."""
        c, s, r = math.cos(self.angle), math.sin(self.angle), self.resolution
        return self.origin[0] + r * (u * c - v * s), self.origin[1] + r * (u * s + v * c)


def rotated(mask: NDArray[np.bool_], area: Area, angle: float) -> RotatedMask:
    """Return `mask`, on the grid of `area`, with rows at `angle` (rad): the nearest cell of each."""
    g = area.grid
    ys, xs = np.nonzero(mask)
    c, s = math.cos(angle), math.sin(angle)
    u, v = xs * c + ys * s, ys * c - xs * s
    u0, v0 = math.floor(u.min()) - 1, math.floor(v.min()) - 1
    nu, nv = math.ceil(u.max()) - u0 + 2, math.ceil(v.max()) - v0 + 2
    uu, vv = np.arange(u0, u0 + nu), np.arange(v0, v0 + nv)[:, None]
    ix, iy = np.rint(uu * c - vv * s).astype(np.int64), np.rint(uu * s + vv * c).astype(np.int64)
    inside = (ix >= 0) & (iy >= 0) & (ix < g.nx) & (iy < g.ny)
    found = np.zeros((nv, nu), np.bool_)
    found[inside] = mask[iy[inside], ix[inside]]
    x0, y0 = g.origin_x + 0.5 * g.resolution, g.origin_y + 0.5 * g.resolution
    origin = x0 + g.resolution * (u0 * c - v0 * s), y0 + g.resolution * (u0 * s + v0 * c)
    return RotatedMask(found, angle, origin, g.resolution)


def swaths_in(cell: list[Stretch], frame: RotatedMask, width: float, *, across: bool) -> list[list[tuple[float, ...]]]:
    """Return the swaths (u0, v0, u1, v1) of a cell, in rows and columns of `frame`; a list for each line, in order.

    Lines are evenly spaced, at most `width` (cells) apart, along the rows or `across` them.
    """
    rows = np.array([s.row for s in cell])
    firsts, lasts = np.array([s.first for s in cell]), np.array([s.last for s in cell])
    base = int(firsts.min())
    block = np.zeros((len(cell), int(lasts.max()) - base + 1), np.bool_)
    for k, (first, last) in enumerate(zip(firsts, lasts)):
        block[k, first - base : last - base + 1] = True
    if across:
        block = block.T
    height = block.shape[0]
    number = max(1, math.ceil(height / width - SPARE))
    spacing = height / number
    inset = END_INSET * width
    lines: list[list[tuple[float, ...]]] = []
    for k in range(number):
        low, high = round(k * spacing), round((k + 1) * spacing)
        filled = block[low : max(high, low + 1)].any(axis=0)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], filled.view(np.int8), [0]))))
        level = (k + 0.5) * spacing - 0.5
        line: list[tuple[float, ...]] = []
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist()):
            begin, end = a - 0.5 + inset, b - 0.5 - inset
            if begin > end:
                begin = end = 0.5 * (a + b - 1)
            if across:
                line.append((base + level, rows[0] + begin, base + level, rows[0] + end))
            else:
                line.append((base + begin, rows[0] + level, base + end, rows[0] + level))
        lines.append(line)
    return lines


def clear_parts(area: Area, a: tuple[float, float], b: tuple[float, float]) -> list[NDArray[np.float64]]:
    """Return the parts (2, 2) of a straight line from `a` to `b` (m) on which the robot can drive and work."""
    ends = np.array((a, b))
    cells = area.to_cells(ends)
    if is_clear(area.free, *cells[0].tolist(), *cells[1].tolist()):
        return [ends]
    count = max(2, math.ceil(float(np.hypot(*(cells[1] - cells[0]))) / 0.5) + 1)
    points = np.linspace(cells[0], cells[1], count)
    ok = [is_clear(area.free, *p.tolist(), *p.tolist()) for p in points]
    parts: list[NDArray[np.float64]] = []
    first = 0
    while first < count:
        if not ok[first]:
            first += 1
            continue
        last = first
        while (
            last + 1 < count
            and ok[last + 1]
            and is_clear(area.free, *points[first].tolist(), *points[last + 1].tolist())
        ):
            last += 1
        parts.append(area.to_world(points[[first, last]]))
        first = last + 1
    return parts
