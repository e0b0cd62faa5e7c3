"""A state lattice: headings, and the motion primitives between them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

# ----------------------------------------------------------------------------------------------------------------------
# Line-arc-line connections between poses, and the arcs and lines of a primitive that is given by its poses.


IN_PLACE: Final = "in_place"
SLIDE: Final = "slide"
LINE: Final = "line"
ARC: Final = "arc"
_PARALLEL: Final = 1e-9
_SHORTEST: Final = 1e-9


class Piece(NamedTuple):
    """A part of a primitive."""

    kind: str
    """IN_PLACE, SLIDE (a line with constant heading), LINE or ARC."""
    size: float
    """Length (m); angle of IN_PLACE (rad)."""
    curvature: float = 0.0
    """Of an ARC (1/m), positive to the left."""
    direction: float = 0.0
    """Of a SLIDE, relative to the heading (rad)."""


class Connections(NamedTuple):
    """Line-arc-line connections (arrays of one shape); lengths are NaN where there is none."""

    before: NDArray[np.float64]
    """Straight line before the arc."""
    radius: NDArray[np.float64]
    """Of the arc; 0 for a straight connection."""
    arc: NDArray[np.float64]
    """Length of the arc."""
    after: NDArray[np.float64]
    turn: NDArray[np.float64]
    """Angle of the arc, positive to the left."""

    @property
    def length(self) -> NDArray[np.float64]:
        """Length of the whole connection, NaN where there is none."""
        return self.before + self.arc + self.after


def wrapped(angle: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return angles in [-pi, pi)."""
    return np.remainder(np.asarray(angle, np.float64) + np.pi, 2.0 * np.pi) - np.pi


def connect(
    x: NDArray[np.float64], y: NDArray[np.float64], start: float, end: NDArray[np.float64], min_radius: float
) -> Connections:
    """Connect (0, 0, start) with the poses (x, y, end) by a line, an arc as wide as possible, and a line.

    The lines of the two headings meet at distance d1 from the start and d2 from the end, both positive; the arc touches both at
    m = min(d1, d2) from there and has the radius m / tan(turn / 2). Turns are at most a right angle.
    """
    turn = wrapped(end - start)
    c, s = math.cos(start), math.sin(start)
    along, aside = c * x + s * y, c * y - s * x
    parallel = np.abs(turn) < _PARALLEL
    sine = np.where(parallel, 1.0, np.sin(turn))
    d2 = aside / sine
    d1 = along - d2 * np.cos(turn)
    m = np.minimum(d1, d2)
    with np.errstate(invalid="ignore", divide="ignore"):
        radius = m / np.tan(0.5 * np.abs(np.where(parallel, 1.0, turn)))
    curved = ~parallel & (m > _SHORTEST) & (np.abs(turn) <= 0.5 * np.pi + 1e-9) & (radius >= min_radius - 1e-9)
    straight = parallel & (along > _SHORTEST) & (np.abs(aside) < 1e-6 * np.maximum(1.0, np.abs(along)))
    nan = np.where(curved | straight, 0.0, np.nan)
    return Connections(
        np.where(straight, along, np.where(curved, d1 - m, nan)),
        np.where(curved, radius, nan),
        np.where(curved, radius * np.abs(turn), nan),
        np.where(curved, d2 - m, nan),
        np.where(curved, turn, nan),
    )


def connection_pieces(connections: Connections, k: int) -> list[Piece]:
    """Return the pieces of connection number `k`."""
    before, arc, after = (float(v[k]) for v in (connections.before, connections.arc, connections.after))
    pieces = [Piece(LINE, before)] if before > _SHORTEST else []
    if arc > 0.0:
        sign = 1.0 if connections.turn[k] > 0.0 else -1.0
        pieces.append(Piece(ARC, arc, sign / float(connections.radius[k])))
    if after > _SHORTEST:
        pieces.append(Piece(LINE, after))
    return pieces


def scaled(pieces: Iterable[Piece], factor: float) -> tuple[Piece, ...]:
    """Return pieces in another unit of length."""
    return tuple(
        p if p.kind == IN_PLACE else p._replace(size=p.size * factor, curvature=p.curvature / factor) for p in pieces
    )


def sample(pieces: list[Piece], yaw: float, count: int) -> NDArray[np.float64]:
    """Return `count` poses (count, 3), evenly spaced along pieces from (0, 0, yaw), the end included and the start not."""
    ends = np.cumsum([p.size if p.kind != IN_PLACE else abs(p.size) for p in pieces])
    at = ends[-1] * np.arange(1, count + 1) / count
    out = np.zeros((count, 3))
    x = y = 0.0
    first = 0.0
    for piece, last in zip(pieces, ends.tolist(), strict=True):
        inside = (at > first) if first > 0.0 else np.ones(count, np.bool_)
        out[inside] = _along(piece, x, y, yaw, at[inside] - first)
        x, y, yaw = (float(v) for v in _along(piece, x, y, yaw, np.array([last - first]))[0])
        first = last
    out[-1] = x, y, yaw
    return out


def _along(piece: Piece, x: float, y: float, yaw: float, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses at distances `s` along a piece."""
    if piece.kind == IN_PLACE:
        turned = yaw + math.copysign(1.0, piece.size) * s
        return np.column_stack((np.full(len(s), x), np.full(len(s), y), turned))
    if piece.kind == ARC:
        turned = yaw + piece.curvature * s
        r = 1.0 / piece.curvature
        return np.column_stack(
            (x + r * (np.sin(turned) - math.sin(yaw)), y - r * (np.cos(turned) - math.cos(yaw)), turned)
        )
    direction = yaw + (piece.direction if piece.kind == SLIDE else 0.0)
    return np.column_stack((x + s * math.cos(direction), y + s * math.sin(direction), np.full(len(s), yaw)))


MotionModel = Literal["ackermann", "diff", "omni"]
MOTION_MODELS: Final[tuple[MotionModel, ...]] = ("ackermann", "diff", "omni")


@dataclass(frozen=True)
class Primitive:
    """A motion from the center of a cell at one heading to the center of another cell (or the same one) at another heading."""

    start: int
    """Index of the heading at its start."""
    end: int
    left_turn: bool
    radius: float
    """Of its arc (m), 0 without one."""
    arc_length: float
    straight_length: float
    poses: NDArray[np.float64]
    """(n, 3) x, y (m) relative to the start, yaw (rad), about a cell apart; the start itself is not among them."""
    pieces: tuple[Piece, ...]
    """The arcs and lines on which the poses are."""

    @property
    def length(self) -> float:
        """Length of the primitive (m), 0 for a turn in place."""
        return self.arc_length + self.straight_length


@dataclass(frozen=True, eq=False)
class Lattice:
    """Headings and primitives; what a primitive file contains. Lengths in meters, angles in radians."""

    motion_model: MotionModel
    turning_radius: float
    resolution: float
    """Side of a cell (m)."""
    headings: NDArray[np.float64]
    """(n,) in [0, 2 pi), ascending, not evenly spaced: straight lines along them hit centers of cells."""
    primitives: tuple[Primitive, ...]
    """Sorted by the heading at their start."""
    stopping_threshold: int | None = None
    distinctness_ratio: float | None = None
    source: str = "generated"
    """The file it was read from."""

    @cached_property
    def by_heading(self) -> tuple[tuple[Primitive, ...], ...]:
        """The primitives of each heading."""
        rows: list[list[Primitive]] = [[] for _ in self.headings]
        for primitive in self.primitives:
            rows[primitive.start].append(primitive)
        return tuple(tuple(row) for row in rows)

    @cached_property
    def headings_without_turns(self) -> tuple[int, ...]:
        """Headings from which no primitive turns to the left, or none to the right."""
        ways = [
            {round(math.remainder(self.headings[p.end] - yaw, 2.0 * math.pi), 9) for p in row}
            for yaw, row in zip(self.headings, self.by_heading, strict=True)
        ]
        return tuple(
            k for k, turns in enumerate(ways) if not (any(t > 0.0 for t in turns) and any(t < 0.0 for t in turns))
        )

    def nearest_heading(self, yaw: float) -> int:
        """Return the index of the heading nearest to `yaw` (rad)."""
        turn = np.abs(np.remainder(self.headings - yaw + np.pi, 2.0 * np.pi) - np.pi)
        return int(np.argmin(turn))
