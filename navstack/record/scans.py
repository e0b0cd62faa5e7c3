"""The scans of a record, bounded in number."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import DeferredScan, LaserScan, Pose2D
from navstack.record import format as fmt
from navstack.record.columns import Column, Streamed

MAX_RANGES: Final = 20_000_000
"""Largest number of recorded ranges of one lidar (80 MB): an hour of 640 beams at 8 Hz."""

WAITING_RANGES: Final = 1_000_000
"""Largest number of ranges in memory of a lidar whose scans are kept on disk."""
_ROWS: Final = np.dtype([("number", "<i8"), *fmt.TABLES["scans"], ("placed", "?")])
_Row = tuple[int, float, Pose2D | None, LaserScan]
"""Number in the order of the sensor, time (s), pose and scan."""


class ScanBuffer:
    """The scans of one lidar. When they exceed `limit` ranges, every second one is dropped, and from then on left out.

    So a long run has all its scans at a lower rate, instead of a part of them. The ranges of a `DeferredScan` are computed
    when the record is read, if it is in memory: the run itself does not wait for them.
    """

    def __init__(self, source: int, limit: int | None = None, folder: Path | None = None) -> None:
        self._limit = MAX_RANGES if limit is None else limit
        self._every = 1
        self._offered = 0
        self._pending: list[_Row] = []
        self._spooled = folder is not None
        self._rows = Column(_ROWS, None, folder)
        self._ranges = Column("<f4", None, folder)
        self._source = source
        self._most: int | None = None
        self._batch = math.inf

    def add(self, t: float, scan: LaserScan, pose: Pose2D | None) -> None:
        """Adds a scan; its ranges are copied unless they are still to be computed. Raises OutputError."""
        number, self._offered = self._offered, self._offered + 1
        if number % self._every:
            return
        if not isinstance(scan, DeferredScan):
            scan = dataclasses.replace(scan, ranges=np.array(scan.ranges, np.float32))
        self._pending.append((number, t, pose, scan))
        if self._most is None:
            self._most = max(2, self._limit // max(len(scan.ranges), 1))
            self._batch = max(1, WAITING_RANGES // max(len(scan.ranges), 1)) if self._spooled else math.inf
        if number // self._every + 1 > self._most:
            self._every *= 2
            self._pending = [row for row in self._pending if row[0] % self._every == 0]
        if len(self._pending) >= self._batch:
            self._settle()

    def times(self) -> list[float]:
        """Times of the scans that are kept (s)."""
        return self.kept()["t"].tolist()

    def kept(self) -> NDArray[Any]:
        """Returns the rows of the scans that are kept."""
        self._settle()
        rows = self._rows.array()
        return rows[rows["number"] % self._every == 0]

    def ranges(self) -> NDArray[np.float32]:
        """Returns the ranges of all scans, in which the rows have their place."""
        return self._ranges.array()

    def _settle(self) -> None:
        pending, self._pending = self._pending, []
        first = len(self._ranges)
        for number, t, pose, scan in pending:
            row = np.zeros(1, _ROWS)
            place = (math.nan,) * 3 if pose is None else tuple(pose)
            described = scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, scan.height
            row[0] = (number, t, *place, *described, self._source, first, len(scan.ranges), pose is not None)
            self._rows.extend(row)
            # beams without a hit are infinite
            self._ranges.extend(np.round(scan.ranges * np.float32(1000.0)) / np.float32(1000.0))
            first += len(scan.ranges)


def scan_arrays(buffers: list[ScanBuffer], samples: NDArray[Any]) -> dict[str, NDArray[Any] | Streamed]:
    """The table of scans and their ranges, to the millimetre.

    Scans without a pose get it by linear interpolation between the poses of the control cycles `samples`.
    """
    rows = np.concatenate([np.zeros(0, _ROWS), *(buffer.kept() for buffer in buffers)])
    rows = rows[np.lexsort((rows["source"], rows["t"]))]
    given = rows["placed"]
    if not given.all():
        at = _interpolated(rows["t"], samples)
        for i, name in enumerate(("x", "y", "yaw")):
            rows[name] = np.where(given, rows[name], at[:, i])
    own_first, counts = rows["first"].copy(), rows["count"]
    rows["first"] = np.cumsum(counts) - counts
    table = fmt.table(fmt.TABLES["scans"], {name: rows[name] for name, _ in fmt.TABLES["scans"]}, len(rows))
    places = np.column_stack((rows["source"], own_first, counts)).tolist()

    def pieces() -> Iterator[Any]:
        ranges = [buffer.ranges() for buffer in buffers]
        for source, first, count in places:
            yield ranges[source][first : first + count].tobytes()

    def array() -> NDArray[np.float32]:
        ranges = [buffer.ranges() for buffer in buffers]
        return np.concatenate([np.empty(0, "<f4"), *(ranges[s][first : first + n] for s, first, n in places)])

    shape = (int(counts.sum()),)
    return {"scans": table, "scan_ranges": Streamed(np.dtype("<f4"), shape, False, pieces, array)}


def _interpolated(t: NDArray[np.float64], samples: NDArray[Any]) -> NDArray[np.float64]:
    """(n, 3) poses at `t`; before the first and after the last time, those of the first and last."""
    if not len(samples):
        return np.zeros((len(t), 3))
    times = samples["t"]
    columns = [samples["x"], samples["y"], np.unwrap(samples["yaw"])]
    x, y, yaw = (np.interp(t, times, column) for column in columns)
    return np.column_stack((x, y, np.arctan2(np.sin(yaw), np.cos(yaw))))
