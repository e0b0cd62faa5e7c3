"""The beams of a scan in the base frame, as the matching kernels take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, Transform2D


class Beams(NamedTuple):
    """Valid beams of a scan."""

    ends: NDArray[np.float64]
    """(m, 3) end in the base frame (m), and 1 for a return or 0 for none: then the end is where the range ends."""
    eye: NDArray[np.float64]
    """(2,) the sensor in the base frame (m)."""

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 2) ends of the beams with a return."""
        return np.ascontiguousarray(self.ends[self.ends[:, 2] > 0.0, :2])

    def thinned(self, count: int) -> Beams:
        """Return at most `count` of the beams, evenly spaced."""
        m = len(self.ends)
        if m <= count:
            return self
        return Beams(self.ends[np.linspace(0, m - 1, count).astype(np.intp)], self.eye)


def scan_beams(scan: LaserScan, sensor: Transform2D, reach: float = np.inf) -> Beams:
    """Return the beams of `scan` by a sensor at `sensor` in the base frame.

    Beams that end at `reach` (m) or the scan's `range_max` or beyond have no return; they end there. NaN, negative ranges and
    those below `range_min` are invalid and left out.
    """
    ranges = np.asarray(scan.ranges, np.float64)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges)) + sensor.yaw
    valid = (ranges >= scan.range_min) & (ranges > 0.0)
    limit = min(scan.range_max, reach)
    returned = ranges < limit
    length = np.where(returned, ranges, limit)[valid]
    if not np.isfinite(limit):
        keep = np.isfinite(length)
        valid[valid] = keep
        length = length[keep]
    ends = np.column_stack(
        (
            sensor.x + length * np.cos(angles[valid]),
            sensor.y + length * np.sin(angles[valid]),
            returned[valid].astype(np.float64),
        )
    )
    return Beams(ends, np.array([sensor.x, sensor.y]))
