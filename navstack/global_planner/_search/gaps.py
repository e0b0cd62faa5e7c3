"""Gaps between the obstacles on either side of a route."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap

_MAX_GAP_CELLS: Final = 64
_OPPOSITE: Final = math.cos(math.radians(120.0))
"""Two obstacles are on opposite sides of a point if they are seen from it at least 120 degrees apart."""

_EQUAL: Final = 0.7
"""Cells: lines whose lengths differ by less differ by the raster only."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The line between two obstacles on opposite sides of a route."""

    x: float
    """Its middle (m)."""
    y: float
    width_m: float
    """Accurate to one cell."""
    heading: float
    """Direction through the gap along the route (rad)."""


def gaps(costmap: Costmap, cells: NDArray[np.int64]) -> list[Gap | None]:
    """For each cell (n, 2) of a route the gap there; None without obstacles on both sides within 64 cells."""
    along = np.zeros((len(cells), 2))
    if len(cells) > 1:
        along[:] = np.gradient(cells.astype(np.float64), axis=0)
    return [_gap(costmap, int(ix), int(iy), step) for (ix, iy), step in zip(cells, along, strict=True)]


def narrowest(found: Iterable[Gap | None]) -> Gap | None:
    """The narrowest gap, the middle one of equal ones; None without gaps."""
    real = [gap for gap in found if gap is not None]
    least = min((gap.width_m for gap in real), default=0.0) + 1e-9
    equal = [gap for gap in real if gap.width_m <= least]
    return equal[len(equal) // 2] if equal else None


def _gap(costmap: Costmap, ix: int, iy: int, along: NDArray[np.float64]) -> Gap | None:
    """The shortest lines from the nearest obstacle to one on the opposite side of a cell, their mean."""
    g = costmap.geometry
    x0, y0 = max(0, ix - _MAX_GAP_CELLS), max(0, iy - _MAX_GAP_CELLS)
    rows, columns = np.nonzero(
        costmap.data[y0 : iy + _MAX_GAP_CELLS + 1, x0 : ix + _MAX_GAP_CELLS + 1] == LETHAL,
    )
    if not len(rows):
        return None
    seen = np.column_stack((columns + x0 - ix, rows + y0 - iy)).astype(np.float64)
    away = np.hypot(seen[:, 0], seen[:, 1])
    nearest = seen[int(away.argmin())]
    cosine = seen @ nearest / np.maximum(away * away.min(), 1e-9)
    if not (cosine <= _OPPOSITE).any():
        return None
    one, other = seen[(cosine >= -_OPPOSITE) & (away <= away.min() + _EQUAL)], seen[cosine <= _OPPOSITE]
    span = np.hypot(*(other - nearest).T)
    other = other[span <= span.min() + 2.0 * _EQUAL]
    across = other[None] - one[:, None]
    length = np.hypot(across[..., 0], across[..., 1])
    alike = length <= length.min() + _EQUAL
    far = across[alike].mean(axis=0)
    centre = 0.5 * (other[None] + one[:, None])[alike].mean(axis=0)
    if (np.hypot(*(seen - centre).T) < 0.5 * length.min() - _EQUAL).any():
        return None  # two bumps of one wall
    heading = math.atan2(-far[0], far[1])
    if math.cos(heading) * along[0] + math.sin(heading) * along[1] < 0.0:
        heading = math.remainder(heading + math.pi, 2.0 * math.pi)
    middle = (centre + 0.5 + np.array([ix, iy])) * g.resolution
    width = max(0.0, float(length.min()) - 1.0) * g.resolution
    return Gap(float(middle[0]) + g.origin_x, float(middle[1]) + g.origin_y, width, heading)
