"""Tables of motion primitives for the search over poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.global_planner._curves import LEFT as LEFT_ARC
from navstack.global_planner._curves import RIGHT as RIGHT_ARC
from navstack.global_planner._curves import STRAIGHT as LINE
from navstack.global_planner._se2.records import HEADING, PRIMITIVE, SEGMENT

STRAIGHT, LEFT, RIGHT = 0, 1, 2


@dataclass(frozen=True)
class PrimitiveTable:
    """Primitives, the samples along them, and which primitives each heading has. Lengths in cells."""

    primitives: NDArray[np.void]
    headings: NDArray[np.void]
    samples: NDArray[np.float64]
    """(n, 4): x, y, cosine and sine of the heading, relative to the start of the primitive."""
    rotates: bool
    pieces: NDArray[np.void]
    """SEGMENT: arcs and lines of each primitive, without the poses where they begin."""
    turn_step: float = 0.0
    """Largest angle of a turn in place (rad), 0 without one."""


@dataclass(frozen=True)
class Arc:
    """A primitive of Hybrid-A*."""

    length: float
    """Signed (cells)."""
    curvature: float
    """Signed (1/cells)."""
    bins: int
    """Heading bins turned, signed."""


def hybrid_arcs(radius: float, bins: int, *, reverse: bool, interpolate: bool) -> list[Arc]:
    """The primitives of a turning radius (cells): the smallest arc that leaves the cell and ends on a bin, and a chord as long.

    `interpolate` adds arcs of the same chord that turn by fewer bins. As Nav2's Hybrid-A*.
    """
    width = 2.0 * math.pi / bins
    angle = 2.0 * math.asin(min(1.0, math.sqrt(2.0) / (2.0 * radius)))
    most = max(1, math.ceil(angle / width - 1e-9))
    chord = 2.0 * radius * math.sin(0.5 * most * width)
    arcs = [Arc(chord, 0.0, 0)]
    for n in range(most, 0, -1) if interpolate else (most,):
        r = chord / (2.0 * math.sin(0.5 * n * width))
        arcs += [Arc(r * n * width, 1.0 / r, n), Arc(r * n * width, -1.0 / r, -n)]
    if reverse:
        arcs += [Arc(-a.length, a.curvature, -a.bins) for a in arcs]
    return arcs


def hybrid_table(arcs: list[Arc], bins: int, offset: float, *, reach: float, step: float) -> PrimitiveTable:
    """The table of these arcs for `bins` headings, the first of which is `offset` (rad).

    `reach`: circumscribed radius of the footprint (cells), 0 for a round robot; `step`: largest motion of its points between
    samples (cells).
    """
    rows = np.zeros(len(arcs), PRIMITIVE)
    pieces = np.zeros(len(arcs), SEGMENT)
    samples: list[NDArray[np.float64]] = []
    first = 0
    for row, arc in zip(rows, arcs, strict=True):
        turn = arc.length * arc.curvature
        count = max(1, math.ceil((abs(arc.length) + reach * abs(turn)) / step))
        s = arc.length * np.arange(1, count + 1) / count
        if arc.curvature == 0.0:
            points = np.column_stack((s, np.zeros(count), np.ones(count), np.zeros(count)))
        else:
            k = arc.curvature
            points = np.column_stack((np.sin(k * s) / k, (1.0 - np.cos(k * s)) / k, np.cos(k * s), np.sin(k * s)))
        samples.append(points)
        row["dx"], row["dy"] = points[-1, :2]
        row["length"], row["end"] = arc.length, arc.bins
        row["turn"] = STRAIGHT if arc.curvature == 0.0 else LEFT if arc.curvature > 0.0 else RIGHT
        row["reverse"] = arc.length < 0.0
        row["first"], row["count"] = first, count
        first += count
    for i, arc in enumerate(arcs):
        rows["piece"][i], rows["pieces"][i] = i, 1
        pieces["kind_"][i] = LINE if arc.curvature == 0.0 else LEFT_ARC if arc.curvature > 0.0 else RIGHT_ARC
        pieces["size"][i] = arc.length
        pieces["radius"][i] = 1.0 if arc.curvature == 0.0 else 1.0 / abs(arc.curvature)
    headings = np.zeros(bins, HEADING)
    yaws = offset + 2.0 * np.pi / bins * np.arange(bins)
    headings["cos"], headings["sin"], headings["yaw"] = np.cos(yaws), np.sin(yaws), yaws
    headings["count"] = len(arcs)
    return PrimitiveTable(rows, headings, np.concatenate(samples), rotates=True, pieces=pieces)
