"""What stands in the world beside the map, at one moment, as the kernels take it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Solids(NamedTuple):
    """Discs and polygons in the map's frame (m) at one moment. Not to be written to.

    Collisions count the discs first, then the polygons.
    """

    discs: NDArray[np.float64]
    """(k, 3) x, y, radius."""
    disc_tops: NDArray[np.float64]
    """(k,) heights: a lidar or sonar mounted higher does not see it."""
    circles: NDArray[np.float64]
    """(p, 3) x, y, radius of a circle about each polygon."""
    corners: NDArray[np.float64]
    """(m, 2) of all polygons, one after the other."""
    first: NDArray[np.int64]
    """(p + 1,) where each polygon's corners begin; the last is m."""
    polygon_tops: NDArray[np.float64]
    """(p,) heights, as of discs."""

    def polygon(self, k: int) -> NDArray[np.float64]:
        """Corners (n, 2) of polygon `k`."""
        return self.corners[self.first[k] : self.first[k + 1]]


def discs_only(discs: NDArray[np.float64], tops: NDArray[np.float64]) -> Solids:
    """Solids without polygons."""
    return Solids(discs, tops, np.empty((0, 3)), np.empty((0, 2)), np.zeros(1, np.int64), np.empty(0))


def joined(parts: Sequence[Solids]) -> Solids:
    """All of them, in order: the discs of the first, of the second ..; then the polygons likewise."""
    if len(parts) == 1:
        return parts[0]
    lengths = np.concatenate([np.diff(part.first) for part in parts])
    return Solids(
        np.concatenate([part.discs for part in parts]),
        np.concatenate([part.disc_tops for part in parts]),
        np.concatenate([part.circles for part in parts]),
        np.concatenate([part.corners for part in parts]),
        np.concatenate((np.zeros(1, np.int64), np.cumsum(lengths, dtype=np.int64))),
        np.concatenate([part.polygon_tops for part in parts]),
    )
