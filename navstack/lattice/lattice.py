"""A state lattice: headings, and the motion primitives between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.lattice.geometry import Piece

MotionModel = Literal["ackermann", "diff", "omni"]
MOTION_MODELS: Final[tuple[MotionModel, ...]] = ("ackermann", "diff", "omni")


@dataclass(frozen=True)
class Primitive:
    """A motion from the centre of a cell at one heading to the centre of another cell (or the same one) at another heading."""

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
    """Headings and primitives; what a primitive file contains. Lengths in metres, angles in radians."""

    motion_model: MotionModel
    turning_radius: float
    resolution: float
    """Side of a cell (m)."""
    headings: NDArray[np.float64]
    """(n,) in [0, 2 pi), ascending, not evenly spaced: straight lines along them hit centres of cells."""
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
