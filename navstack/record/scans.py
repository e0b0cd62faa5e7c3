"""The scans of a record, bounded in number."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import DeferredScan, LaserScan, Pose2D
from navstack.record import format as fmt

MAX_RANGES: Final = 20_000_000
"""Largest number of recorded ranges of one lidar (80 MB): an hour of 640 beams at 8 Hz."""


class ScanBuffer:
    """The scans of one lidar. When they exceed `limit` ranges, every second one is dropped, and from then on left out.

    So a long run has all its scans at a lower rate, instead of a part of them. The ranges of a `DeferredScan` are computed
    when the record is read: the run itself does not wait for them.
    """

    def __init__(self, source: int, limit: int | None = None) -> None:
        self._source = source
        self._limit = MAX_RANGES if limit is None else limit
        self._every = 1
        self._offered = 0
        self._rows: list[tuple[float, Pose2D | None, LaserScan]] = []
        self._most: int | None = None

    def add(self, t: float, scan: LaserScan, pose: Pose2D | None) -> None:
        """Adds a scan; its ranges are copied unless they are still to be computed."""
        self._offered += 1
        if (self._offered - 1) % self._every:
            return
        if not isinstance(scan, DeferredScan):
            scan = dataclasses.replace(scan, ranges=np.array(scan.ranges, np.float32))
        self._rows.append((t, pose, scan))
        if self._most is None:
            self._most = max(2, self._limit // max(len(scan.ranges), 1))
        if len(self._rows) > self._most:
            self._rows = self._rows[::2]
            self._every *= 2

    def rows(self) -> list[tuple[float, int, Pose2D | None, LaserScan]]:
        """Time (s), source, pose and scan of each."""
        return [(t, self._source, pose, scan) for t, pose, scan in self._rows]


def scan_arrays(
    buffers: list[ScanBuffer], times: NDArray[np.float64], poses: NDArray[np.float64]
) -> dict[str, NDArray[Any]]:
    """The table of scans and their ranges, to the millimetre.

    Scans without a pose get it by linear interpolation between the `poses` (n, 3) of the `times` (n,) of the control cycles.
    """
    rows = sorted((row for buffer in buffers for row in buffer.rows()), key=lambda row: row[:2])
    scans = [scan for *_, scan in rows]
    counts = np.array([len(scan.ranges) for scan in scans], np.int64)
    t = np.array([row[0] for row in rows], np.float64)
    at = _interpolated(t, times, poses)
    for i, (_, _, pose, _) in enumerate(rows):
        if pose is not None:
            at[i] = pose
    data: dict[str, Any] = {"t": t, "x": at[:, 0], "y": at[:, 1], "yaw": at[:, 2]}
    for name in ("angle_min", "angle_increment", "range_min", "range_max", "height"):
        data[name] = [getattr(scan, name) for scan in scans]
    data |= {"source": [row[1] for row in rows], "first": np.cumsum(counts) - counts, "count": counts}
    ranges: NDArray[np.float32] = np.concatenate([np.empty(0, np.float32), *(scan.ranges for scan in scans)])
    # beams without a hit are infinite
    rounded = np.round(ranges * np.float32(1000.0)) / np.float32(1000.0)
    return {"scans": fmt.table(fmt.TABLES["scans"], data, len(rows)), "scan_ranges": rounded.astype("<f4")}


def _interpolated(
    t: NDArray[np.float64], times: NDArray[np.float64], poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, 3) poses at `t`; before the first and after the last time, those of the first and last."""
    if not len(times):
        return np.zeros((len(t), 3))
    columns = [poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2])]
    x, y, yaw = (np.interp(t, times, column) for column in columns)
    return np.column_stack((x, y, np.arctan2(np.sin(yaw), np.cos(yaw))))
