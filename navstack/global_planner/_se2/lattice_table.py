"""Tables of the primitives of a state lattice for the search over poses, and the first step from any heading onto the lattice."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.global_planner._curves import LEFT, RIGHT, STRAIGHT
from navstack.global_planner._lattice import Lattice, Piece, connect, sample, scaled
from navstack.global_planner._se2.primitives import PrimitiveTable
from navstack.global_planner._se2.records import HEADING, PRIMITIVE, SEGMENT

# ----------------------------------------------------------------------------------------------------------------------
# The first steps from a heading that a lattice does not have: lines and arcs to its nearest states.


_PER_HEADING: Final = 3
"""Connections to each heading of the lattice."""
_WIDEST: Final = 0.45 * math.pi
_LEAST: Final = 1e-9

Rows = tuple[NDArray[np.void], NDArray[np.void], NDArray[np.float64]]
"""PRIMITIVE, SEGMENT, and samples (n, 4), as in a PrimitiveTable."""


class StartConnections:
    """Finds the shortest connections to each heading among the cells around."""

    def __init__(self, lattice: Lattice, *, reach: float, step: float) -> None:
        self._headings = lattice.headings
        self._radius = lattice.turning_radius / lattice.resolution
        self._reach, self._step = reach, step
        far = max((np.abs(p.poses[-1, :2]).max() / lattice.resolution for p in lattice.primitives), default=4.0)
        n = max(4, math.ceil(far))
        x, y = np.meshgrid(np.arange(-n, n + 1, dtype=np.float64), np.arange(-n, n + 1, dtype=np.float64))
        self._x, self._y = x.ravel(), y.ravel()

    def rows(self, yaw: float, ends: list[int], *, reverse: bool) -> Rows:
        """Return the rows for a course (rad); `ends`: heading of the robot by the heading of the course at the end."""
        turn = np.remainder(self._headings - yaw + np.pi, 2.0 * np.pi) - np.pi
        chosen = np.flatnonzero(np.abs(turn) <= _WIDEST)
        ahead = self._x * math.cos(yaw) + self._y * math.sin(yaw) > 1.0
        x, y = (np.broadcast_to(v[ahead], (len(chosen), int(ahead.sum()))) for v in (self._x, self._y))
        links = connect(x, y, yaw, self._headings[chosen][:, None], self._radius)
        length = np.where(np.isnan(links.length), np.inf, links.length)
        order = np.argsort(length, axis=1, kind="stable")[:, :_PER_HEADING]
        picked = np.repeat(np.arange(len(chosen)), order.shape[1]), order.ravel()
        finite = np.isfinite(length[picked])
        at = picked[0][finite], picked[1][finite]
        sizes = np.column_stack((links.before[at], links.arc[at], links.after[at]))
        straight = links.radius[at] == 0.0
        curvature = np.where(straight, 0.0, np.sign(links.turn[at]) / np.where(straight, 1.0, links.radius[at]))
        end = np.array(ends, np.int64)[chosen[at[0]]]
        return self._table_rows(sizes, curvature, end, -1.0 if reverse else 1.0)

    def _table_rows(
        self, sizes: NDArray[np.float64], curvature: NDArray[np.float64], end: NDArray[np.int64], sign: float
    ) -> Rows:
        """Rows of connections with lines and arcs of these sizes (n, 3), driven forward or backward (sign)."""
        length = sizes.sum(axis=1)
        counts = np.maximum(1, np.ceil(length * (1.0 + self._reach * np.abs(curvature)) / self._step).astype(np.int64))
        first = np.concatenate([[0], np.cumsum(counts)])
        row = np.repeat(np.arange(len(counts)), counts)
        s = (np.arange(first[-1]) - first[row] + 1) / counts[row] * length[row]
        samples = _along(sizes[row], curvature[row], s)
        samples[:, :2] *= sign
        primitives = np.zeros(len(counts), PRIMITIVE)
        last = samples[first[1:] - 1]
        primitives["dx"], primitives["dy"] = last[:, 0], last[:, 1]
        primitives["length"], primitives["end"] = sign * length, end
        curved = curvature * sign
        primitives["turn"] = np.where(curved == 0.0, 0, np.where(curved > 0.0, 1, 2))
        primitives["reverse"] = sign < 0.0
        primitives["first"], primitives["count"] = first[:-1], counts
        used = sizes > _LEAST
        primitives["pieces"] = used.sum(axis=1)
        primitives["piece"] = np.concatenate([[0], np.cumsum(primitives["pieces"])[:-1]])
        number, column = np.nonzero(used)
        pieces = np.zeros(len(number), SEGMENT)
        arc = (column == 1) & (curvature[number] != 0.0)
        pieces["kind_"] = np.where(arc, np.where(curved[number] > 0.0, LEFT, RIGHT), STRAIGHT)
        pieces["size"] = sign * sizes[number, column]
        pieces["radius"] = np.where(arc, 1.0 / np.where(arc, np.abs(curvature[number]), 1.0), 1.0)
        return primitives, pieces, samples


def _along(sizes: NDArray[np.float64], curvature: NDArray[np.float64], s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Samples (n, 4): x, y, cosine and sine of the heading, at distances `s` along a line, an arc and a line (n, 3)."""
    before = np.minimum(s, sizes[:, 0])
    arc = np.clip(s - sizes[:, 0], 0.0, sizes[:, 1])
    after = np.maximum(s - sizes[:, 0] - sizes[:, 1], 0.0)
    turned = curvature * arc
    radius = 1.0 / np.where(curvature == 0.0, 1.0, curvature)
    c, sine = np.cos(turned), np.sin(turned)
    along = np.where(curvature == 0.0, arc, radius * sine)
    aside = np.where(curvature == 0.0, 0.0, radius * (1.0 - c))
    return np.column_stack((before + along + after * c, aside + after * sine, c, sine))


IN_PLACE, SIDEWAYS = 0, -1
MIN_BINS: Final = 72
"""Headings of the table of curve lengths, at least; more than the lattice has, because its own are too far apart."""
_SAME: Final = 1e-9
_TURN: Final = math.radians(10.0)
"""Most that a robot turns in place between checks."""


@dataclass(frozen=True)
class _Motion:
    """A primitive in cells, from a heading of the table."""

    end: int
    pieces: tuple[Piece, ...]
    """In the direction of travel."""
    reverse: bool


class LatticeTables:
    """Makes the tables of a lattice for one footprint."""

    def __init__(self, lattice: Lattice, *, reverse: bool, reach: float, step: float) -> None:
        self.lattice = lattice
        self._reverse, self._reach, self._step = reverse, reach, step
        self._bins = bins_of(lattice)
        self._turn_step = max(
            (abs(p.pieces[0].size) for p in lattice.primitives if p.pieces[0].kind == "in_place"), default=0.0
        )
        self._rows = _Rows(reach, step)
        n = len(lattice.headings)
        self._headings = np.zeros(self._bins, HEADING)
        self._headings["yaw"][:n] = lattice.headings
        self._headings["cos"], self._headings["sin"] = np.cos(self._headings["yaw"]), np.sin(self._headings["yaw"])
        self._opposite = [lattice.nearest_heading(float(yaw) + math.pi) for yaw in lattice.headings]
        for k in range(n):
            first = len(self._rows.primitives)
            for motion in self._motions(k):
                self._rows.add(motion)
            self._headings["first"][k], self._headings["count"][k] = first, len(self._rows.primitives) - first
        primitives, pieces, samples = self._rows.arrays()
        self._table = PrimitiveTable(primitives, self._headings, samples, False, pieces, self._turn_step)
        self._starts = StartConnections(lattice, reach=reach, step=step)

    def _motions(self, k: int) -> list[_Motion]:
        lattice = self.lattice
        motions = [_Motion(p.end, scaled(p.pieces, 1.0 / lattice.resolution), False) for p in lattice.by_heading[k]]
        if self._reverse:
            driven = [p for p in lattice.by_heading[self._opposite[k]] if p.length > 0.0]
            motions += [
                _Motion(self._opposite[p.end], scaled(p.pieces, 1.0 / lattice.resolution), True) for p in driven
            ]
        return motions

    def table(self, start_yaw: float) -> tuple[PrimitiveTable, int]:
        """Return the table for a start heading (rad), and the number of that heading in it."""
        near = self.lattice.nearest_heading(start_yaw)
        if abs(math.remainder(start_yaw - float(self.lattice.headings[near]), 2.0 * math.pi)) < _SAME:
            return self._table, near
        at = len(self.lattice.headings)
        parts = [(self._table.primitives, self._table.pieces, self._table.samples), *self._first_steps(start_yaw)]
        first = len(self._table.primitives)
        primitives, pieces, samples = joined(parts)
        headings = self._headings.copy()
        headings["yaw"][at] = start_yaw
        headings["cos"][at], headings["sin"][at] = math.cos(start_yaw), math.sin(start_yaw)
        headings["first"][at], headings["count"][at] = first, len(primitives) - first
        return PrimitiveTable(primitives, headings, samples, False, pieces, self._turn_step), at

    def _first_steps(self, yaw: float) -> list[Rows]:
        parts = [self._starts.rows(yaw, list(range(len(self.lattice.headings))), reverse=False)]
        if self._reverse:
            parts.append(self._starts.rows(yaw + math.pi, self._opposite, reverse=True))
        if self._turn_step > 0.0:
            turns = np.remainder(self.lattice.headings - yaw + math.pi, 2.0 * math.pi) - math.pi
            left, right = np.where(turns > 0.0, turns, np.inf).argmin(), np.where(turns < 0.0, -turns, np.inf).argmin()
            rows = _Rows(self._reach, self._step)
            for k in (left, right):
                rows.add(_Motion(int(k), (Piece("in_place", float(turns[k])),), False))
            parts.append(rows.arrays())
        return parts


def joined(parts: list[Rows]) -> Rows:
    """Return the rows of several tables as those of one."""
    pieces = sample_count = 0
    primitives: list[NDArray[np.void]] = []
    for rows, segments, samples in parts:
        moved = rows
        if pieces > 0 or sample_count > 0:
            moved = rows.copy()
            moved["piece"] += pieces
            moved["first"] += sample_count
        primitives.append(moved)
        pieces += len(segments)
        sample_count += len(samples)
    return (
        np.concatenate(primitives),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]),
    )


def bins_of(lattice: Lattice) -> int:
    """Headings of the tables of a lattice: its own, the start's, and unused ones."""
    return max(MIN_BINS, len(lattice.headings) + 1)


class _Rows:
    """Rows of a table that is being built."""

    def __init__(self, reach: float, step: float) -> None:
        self._reach, self._step = reach, step
        self.primitives: list[tuple[float | int, ...]] = []
        self._pieces: list[tuple[float | int, ...]] = []
        self._samples: list[NDArray[np.float64]] = []
        self._sampled = 0

    def add(self, motion: _Motion) -> None:
        """Add a motion, relative to the heading at its start."""
        pieces, sign = motion.pieces, -1.0 if motion.reverse else 1.0
        in_place = pieces[0].kind == "in_place"
        length = 0.0 if in_place else sum(p.size for p in pieces)
        if in_place:
            turn = abs(pieces[0].size)
            count = max(self._reach * turn / self._step, turn / _TURN)
        else:
            # evenly spaced along lines and arcs: where the robot turns, its outermost points move faster
            count = length * (1.0 + self._reach * max(abs(p.curvature) for p in pieces)) / self._step
        course = math.pi if motion.reverse else 0.0
        poses = sample(list(pieces), course, max(1, math.ceil(count)))
        headings = poses[:, 2] - course
        self._samples.append(np.column_stack((poses[:, :2], np.cos(headings), np.sin(headings))))
        curved = next((p.curvature for p in pieces if p.curvature != 0.0), 0.0) * sign
        kind = 0 if curved == 0.0 else 1 if curved > 0.0 else 2
        self.primitives.append(
            (
                float(poses[-1, 0]),
                float(poses[-1, 1]),
                sign * length,
                motion.end,
                kind,
                int(motion.reverse),
                int(in_place),
                self._sampled,
                len(poses),
                len(self._pieces),
                len(pieces),
            )
        )
        self._sampled += len(poses)
        self._pieces += [_segment(p, sign) for p in pieces]

    def arrays(self) -> Rows:
        """Return the rows as arrays."""
        return np.array(self.primitives, PRIMITIVE), np.array(self._pieces, SEGMENT), np.concatenate(self._samples)


def _segment(p: Piece, sign: float) -> tuple[float | int, ...]:
    """A row of SEGMENT: kind, signed size, radius, direction of a slide. Backward, an arc to the left is one to the right."""
    if p.kind == "in_place":
        return 0.0, 0.0, 0.0, IN_PLACE, p.size, 1.0, 0.0, 0.0
    if p.kind == "slide":
        return 0.0, 0.0, 0.0, SIDEWAYS, p.size, 1.0, p.direction, 0.0
    if p.kind == "line":
        return 0.0, 0.0, 0.0, STRAIGHT, sign * p.size, 1.0, 0.0, 0.0
    kind = LEFT if p.curvature * sign > 0.0 else RIGHT
    return 0.0, 0.0, 0.0, kind, sign * p.size, 1.0 / abs(p.curvature), 0.0, 0.0
