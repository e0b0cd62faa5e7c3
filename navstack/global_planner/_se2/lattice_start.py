"""The first steps from a heading that a lattice does not have: lines and arcs to its nearest states."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.curves.curve_kernels import LEFT, RIGHT, STRAIGHT
from navstack.global_planner._se2.records import PRIMITIVE, SEGMENT
from navstack.lattice import Lattice, connect

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
