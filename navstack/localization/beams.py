"""The beams of a scan in the base frame, as the matching kernels take them."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, Transform2D

FEWEST: Final = 10
"""With fewer beams in common, two scans are not compared."""


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


def continuity(before: Beams, now: Beams, step: Transform2D) -> float | None:
    """Return the share of the beams `now` that end where the scan `before` saw something, or saw as far.

    `step` is the motion between the scans, by the odometry: the base now in the base before. Ranges in the same direction are
    compared, with a tolerance of 0.2 m and 5 %; two directions beside a beam count, so that corners which the motion hides or
    shows agree. None if the scans have fewer than `FEWEST` directions in common.
    """
    if len(before.ends) < 2 or len(now.ends) == 0:
        return None
    seen = step.inverse().apply_points(np.ascontiguousarray(before.ends[:, :2])) - now.eye
    bearings, ranges = np.arctan2(seen[:, 1], seen[:, 0]), np.hypot(seen[:, 0], seen[:, 1])
    order = np.argsort(bearings, kind="stable")
    bearings, ranges = bearings[order], ranges[order]
    beams = now.ends[:, :2] - now.eye
    bearing, length = np.arctan2(beams[:, 1], beams[:, 0]), np.hypot(beams[:, 0], beams[:, 1])
    k = np.searchsorted(bearings, bearing)
    common = (k > 0) & (k < len(bearings))
    if int(common.sum()) < FEWEST:
        return None
    k, length = k[common], length[common]
    tolerance = 0.2 + 0.05 * length
    low, high = np.minimum(ranges[k - 1], ranges[k]), np.maximum(ranges[k - 1], ranges[k])
    return float(((length > low - tolerance) & (length < high + tolerance)).mean())
