"""The obstacles of the world that are not on the map, at one time, in the form that the kernels take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class SolidGeometry(NamedTuple):
    """Positions and outlines of `Solids`, without their heights; the argument of the kernels."""

    discs: NDArray[np.float64]
    circles: NDArray[np.float64]
    corners: NDArray[np.float64]
    first: NDArray[np.int64]


class Solids(NamedTuple):
    """Discs and polygons in the map frame (m) at one time. Read-only.

    Solids are numbered: first the discs, then the polygons.
    """

    discs: NDArray[np.float64]
    """(k, 3) x, y, radius."""
    circles: NDArray[np.float64]
    """(p, 3) x, y, radius of a bounding circle of each polygon."""
    corners: NDArray[np.float64]
    """(m, 2) corners of all polygons, concatenated."""
    first: NDArray[np.int64]
    """(p + 1,) index of each polygon's first corner; the last entry is m."""
    tops: NDArray[np.float64]
    """(k + p,) heights of discs and polygons (m): a lidar or sonar mounted higher does not see them."""

    @property
    def geometry(self) -> SolidGeometry:
        """The solids without their heights."""
        return SolidGeometry(self.discs, self.circles, self.corners, self.first)

    @property
    def disc_tops(self) -> NDArray[np.float64]:
        """(k,) heights of the discs."""
        return self.tops[: len(self.discs)]

    @property
    def polygon_tops(self) -> NDArray[np.float64]:
        """(p,) heights of the polygons."""
        return self.tops[len(self.discs) :]

    def polygon(self, k: int) -> NDArray[np.float64]:
        """Returns the corners (n, 2) of polygon `k`."""
        return self.corners[self.first[k] : self.first[k + 1]]


def solids_from_discs(discs: NDArray[np.float64], tops: NDArray[np.float64]) -> Solids:
    """Returns solids without polygons."""
    return Solids(discs, np.empty((0, 3)), np.empty((0, 2)), np.zeros(1, np.int64), tops)


def concatenate_solids(parts: Sequence[Solids]) -> Solids:
    """Concatenates the discs of all parts, and their polygons."""
    if len(parts) == 1:
        return parts[0]
    lengths = np.concatenate([np.diff(part.first) for part in parts])
    return Solids(
        np.concatenate([part.discs for part in parts]),
        np.concatenate([part.circles for part in parts]),
        np.concatenate([part.corners for part in parts]),
        np.concatenate((np.zeros(1, np.int64), np.cumsum(lengths, dtype=np.int64))),
        np.concatenate([*(part.disc_tops for part in parts), *(part.polygon_tops for part in parts)]),
    )
