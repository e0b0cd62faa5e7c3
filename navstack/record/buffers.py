"""Buffers of a recorder: they collect plans, costmap updates, scans and obstacles in the form of the record."""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernel's arguments

from __future__ import annotations

import dataclasses
import itertools
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, DeferredScan, GridGeometry, LaserScan, Pose2D, Window, kernel
from navstack.plugins import LocalPlan
from navstack.record import format as fmt
from navstack.record.columns import Column, Streamed, Table, looked_up, side_by_side


@kernel
def copy_changes(new, last, x0, y0, x1, y1):
    """Copies the window x0 <= ix < x1, y0 <= iy < y1 of `new` into `last` (both uint8); returns the box of changed cells.

    The box is half open; all 0 if no cell changed.
    """
    left, bottom, right, top = x1, y1, x0, y0
    for iy in range(y0, y1):
        row, before = new[iy, x0:x1], last[iy, x0:x1]
        differs = False
        for i in range(len(row)):
            differs |= row[i] != before[i]
        if not differs:
            continue
        bottom, top = min(bottom, iy), iy + 1
        first, end = 0, len(row)
        while row[first] == before[first]:
            first += 1
        while row[end - 1] == before[end - 1]:
            end -= 1
        left, right = min(left, x0 + first), max(right, x0 + end)
        for i in range(first, end):
            before[i] = row[i]
    if right <= left:
        return 0, 0, 0, 0
    return left, bottom, right, top


_VALID: Final = -1
_NO_TRAJECTORY: Final = -2
"""Codes of `local_plan_rejected_by`."""
_BATCH: Final = 64
_INT: Final = struct.Struct("<i").pack


def stacked(parts: list[Any], width: int, dtype: str) -> NDArray[Any]:
    """Concatenates arrays (n, width); an empty array for no parts."""
    return np.concatenate([np.empty((0, width), dtype), *parts], dtype=dtype)


class PlanBuffer:
    """The plans of the global planner."""

    def __init__(self, folder: Path | None = None) -> None:
        self._table = Table(fmt.TABLES["plans"], folder)
        self._poses = Column("<f8", 3, folder)

    def add(self, t: float, poses: NDArray[np.float64], goal: int, frame: str) -> None:
        """Adds a plan (n, 3)."""
        poses = np.asarray(poses, np.float64).reshape(-1, 3)
        self._table.add(t, len(self._poses), len(poses), goal, self._table.texts["frame"].number(frame))
        self._poses.extend(poses)

    def arrays(self) -> dict[str, Streamed]:
        """Returns the arrays of the record."""
        return {"plans": self._table.streamed(), "plan_poses": self._poses.streamed()}


class LocalPlanRow:
    """The recorded part of a `LocalPlan`: copies in single precision."""

    __slots__ = (
        *("best", "costs", "critics", "mode", "notes", "rejected", "rejected_by", "samples", "scales", "t"),
        *("totals", "trajectory", "tried", "vx", "vy", "wz"),
    )

    def __init__(self, t: float, plan: LocalPlan, keep_table: bool) -> None:
        self.t = t
        self.mode = plan.mode
        self.vx, self.vy, self.wz = plan.command
        self.best = plan.best
        self.notes = plan.notes
        self.trajectory = _EMPTY3 if plan.trajectory is None else plan.trajectory.astype(np.float32)
        self.tried = 0 if plan.samples is None else len(plan.samples)
        self.rejected = 0 if plan.rejected_by is None else len(plan.rejected_by) - plan.rejected_by.tolist().count(-1)
        self.critics = plan.critics
        self.scales = None if plan.scales is None else plan.scales.astype(np.float32)
        if plan.samples is None or not keep_table:
            self.samples = _EMPTY3
            self.costs = np.empty((0, len(plan.critics)), np.float32)
            self.totals = np.empty(0, np.float32)
            self.rejected_by = np.empty(0, np.int8)
            return
        k = len(plan.samples)
        self.samples = plan.samples.astype(np.float32)
        self.costs = _or_nan(plan.costs, (k, len(plan.critics)))
        self.totals = _or_nan(plan.totals, (k,))
        self.rejected_by = np.full(k, -1, np.int8) if plan.rejected_by is None else plan.rejected_by.astype(np.int8)


_EMPTY3 = np.empty((0, 3), np.float32)


def _or_nan(values: NDArray[np.float64] | None, shape: tuple[int, ...]) -> NDArray[np.float32]:
    return np.full(shape, np.nan, np.float32) if values is None else values.astype(np.float32)


class LocalPlanBuffer:
    """The plans of the local planner with their tables of samples."""

    def __init__(self, keep_tables: bool, folder: Path | None = None) -> None:
        self._keep_tables = keep_tables
        self._folder = folder
        self._pending: list[LocalPlanRow] = []
        self._table = Table(fmt.TABLES["local_plans"], folder)
        self._critics: dict[str, int] = {}
        self._samples = [Column("<f4", None, folder) for _ in range(3)]
        self._costs: list[Column] = []
        self._totals = Column("<f4", None, folder)
        self._rejected_by = Column("|i1", None, folder)
        self._weights: dict[tuple[tuple[int, ...], bytes], int] = {}
        self._scales = Column("<i4", None, folder)
        self._poses = Column("<f4", 3, folder)
        self._notes: dict[str, list[str]] = {}

    @property
    def critics(self) -> tuple[str, ...]:
        """The names of all critics, in the order of their first appearance."""
        self._settle()
        return tuple(self._critics)

    @property
    def notes(self) -> dict[str, list[str]]:
        """Notes by number of the plan."""
        self._settle()
        return self._notes

    def add(self, t: float, plan: LocalPlan) -> None:
        """Adds a plan."""
        self._pending.append(LocalPlanRow(t, plan, self._keep_tables))
        if len(self._pending) >= _BATCH:
            self._settle()

    def arrays(self) -> dict[str, Streamed]:
        """Returns the arrays of the record; the costs have a column for each critic."""
        self._settle()
        scored = len(self._totals)
        for column in self._costs:
            _pad(column, scored)
        # column-major: the costs of one critic compress much better than those of one sample
        return {
            "local_plans": self._table.streamed(),
            "local_plan_samples": side_by_side(self._samples, scored),
            "local_plan_costs": side_by_side(self._costs, scored),
            "local_plan_totals": self._totals.streamed(),
            "local_plan_rejected_by": self._rejected_by.streamed(),
            "local_plan_scales": looked_up(self._scales, self._scale_rows()),
            "local_plan_poses": self._poses.streamed(),
        }

    def _scale_rows(self) -> NDArray[np.float32]:
        """The different rows of scales, by number."""
        rows = np.full((len(self._weights), len(self._critics)), np.nan, np.float32)
        for (columns, scales), number in self._weights.items():
            if scales:
                rows[number, list(columns)] = np.frombuffer(scales, np.float32)
        return rows

    def _settle(self) -> None:
        """Appends what is pending to the columns, many rows at once: one by one they would cost as much as the run."""
        rows, self._pending = self._pending, []
        scored, posed = len(self._totals), len(self._poses)
        for row in rows:
            columns = self._columns_of(row.critics)
            count, poses = len(row.samples), len(row.trajectory)
            mode = self._table.texts["mode"].number(row.mode)
            if row.notes:
                self._notes[str(len(self._table))] = list(row.notes)
            counts = scored, count, row.tried, row.rejected, posed, poses
            self._table.add(row.t, mode, row.vx, row.vy, row.wz, row.best, *counts)
            weights = columns, b"" if row.scales is None else row.scales.tobytes()
            self._scales.extend_bytes(_INT(self._weights.setdefault(weights, len(self._weights))))
            scored, posed = scored + count, posed + poses
        first = len(self._totals)
        for critics, group in itertools.groupby((row for row in rows if len(row.samples)), lambda row: row.critics):
            first = self._add_samples(list(group), self._columns_of(critics), first)
        self._poses.extend(stacked([row.trajectory for row in rows], 3, "<f4"))

    def _columns_of(self, critics: tuple[str, ...]) -> tuple[int, ...]:
        """Returns the columns of these critics, new ones included."""
        for name in critics:
            if name not in self._critics:
                self._critics[name] = len(self._critics)
                self._costs.append(Column("<f4", None, self._folder))
        return tuple(self._critics[name] for name in critics)

    def _add_samples(self, rows: list[LocalPlanRow], columns: tuple[int, ...], first: int) -> int:
        """Adds the tables of plans with the same critics; those of another planner have columns of their own."""
        for column, values in zip(self._samples, np.concatenate([row.samples for row in rows]).T, strict=True):
            column.extend(values)
        for column, values in zip(columns, np.concatenate([row.costs for row in rows]).T, strict=True):
            _pad(self._costs[column], first)
            self._costs[column].extend(values)
        self._totals.extend(np.concatenate([row.totals for row in rows]))
        rejected = np.concatenate([row.rejected_by for row in rows])
        if columns != tuple(range(len(columns))):
            rejected = np.array([*columns, _NO_TRAJECTORY, _VALID], np.int8)[rejected]
        self._rejected_by.extend(rejected)
        return len(self._totals)


def _pad(column: Column, length: int) -> None:
    """Fills a column with NaN up to a length."""
    if len(column) < length:
        column.extend(np.full(length - len(column), np.nan, np.float32))


class CostmapBuffer:
    """The updates of one costmap: the whole grid if it moved, else the box of changed cells."""

    def __init__(self, frame: str, folder: Path | None = None) -> None:
        self.frame = frame
        self._table = Table(fmt.COSTMAP_TABLE, folder)
        self._cells = Column("|u1", None, folder)
        self._geometry: GridGeometry | None = None
        self._last: NDArray[np.uint8] | None = None

    def add(self, t: float, costmap: Costmap, window: Window | None) -> None:
        """Adds an update of the cells in `window` (None: of any cell)."""
        geometry = costmap.geometry
        data = costmap.data
        if self._last is None or geometry != self._geometry:
            box = geometry.window
            self._last = data.copy()
            self._geometry = geometry
        else:
            inside = geometry.window if window is None else window
            box = Window(*copy_changes(data, self._last, *inside))
        g = geometry
        self._table.add(t, g.nx, g.ny, g.resolution, g.origin_x, g.origin_y, *box, len(self._cells))
        if not box.is_empty:
            self._cells.extend_bytes(data[box.slices].tobytes())

    def arrays(self, name: str) -> dict[str, Streamed]:
        """Returns the arrays of the record for the costmap `name`."""
        return {f"costmaps/{name}": self._table.streamed(), f"costmaps/{name}_cells": self._cells.streamed()}


def copy_changed_window(new: NDArray[np.uint8], last: NDArray[np.uint8], within: Window | None = None) -> Window:
    """Copies the cells of `new` into `last` (both (ny, nx)) and returns the smallest window that contains the changes.

    Only cells in the window `within` (default: all) are compared.
    """
    ny, nx = new.shape
    return Window(*copy_changes(new, last, *(Window(0, 0, nx, ny) if within is None else within)))


# --- scans ------------------------------------------------------------------------------------------------------------


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
    """The table of scans and their ranges, to the millimeter.

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


# --- obstacles --------------------------------------------------------------------------------------------------------


class SolidNames(NamedTuple):
    """What identifies the obstacles of one row, in its order."""

    discs: tuple[str, ...]
    polygons: tuple[str, ...]


class _SolidsRow(NamedTuple):
    sample: int
    discs: NDArray[np.float32]
    corners: NDArray[np.float32]
    first: NDArray[np.int64]
    names: SolidNames | None
    """None: as listed first."""


class SolidsBuffer:
    """Collects rows of obstacles. A named obstacle keeps its column; it is NaN while it is absent."""

    def __init__(self) -> None:
        self._rows: list[_SolidsRow] = []
        self._initial: SolidNames | None = None

    def add(
        self,
        sample: int,
        discs: NDArray[np.float64],
        corners: NDArray[np.float64],
        first: NDArray[np.int64],
        names: SolidNames | None = None,
    ) -> None:
        """Adds the obstacles from the sample with this index on."""
        self._rows.append(_SolidsRow(sample, discs.astype(np.float32), corners.astype(np.float32), first, names))

    def identify(
        self, discs: NDArray[np.float64], corners: NDArray[np.float64], first: NDArray[np.int64], names: SolidNames
    ) -> None:
        """Names the obstacles of the rows so far; without rows, these are the obstacles since the start."""
        self._initial = names
        if not self._rows:
            self.add(0, discs, corners, first)

    def arrays(self, samples: int) -> dict[str, NDArray[Any]]:
        """Returns the arrays of the record: one row, or one per sample."""
        rows = self._rows
        if not rows:
            return {}
        if self._initial is None:
            return {
                "solid_discs": np.array([row.discs for row in rows], "<f4"),
                "solid_corners": np.array([row.corners for row in rows], "<f4"),
                "solid_first": rows[-1].first.astype("<i8"),
            }
        columns = _Columns()
        placed = [columns.place(row, row.names or self._initial) for row in rows]
        index = np.searchsorted([row.sample for row in rows], np.arange(samples), side="right") - 1
        discs = np.full((samples, len(columns.discs), 3), np.nan, "<f4")
        corners = np.full((samples, columns.corner_count, 2), np.nan, "<f4")
        for sample, at in enumerate(index.tolist()):
            row, (disc_columns, corner_columns) = rows[at], placed[at]
            discs[sample, disc_columns] = row.discs
            corners[sample, corner_columns] = row.corners
        return {"solid_discs": discs, "solid_corners": corners, "solid_first": columns.first()}


class _Columns:
    """The columns of all obstacles that ever existed, in the order of their appearance."""

    def __init__(self) -> None:
        self.discs: dict[str, int] = {}
        self._polygons: dict[tuple[str, int], int] = {}
        self._counts: list[int] = []
        self._known: dict[SolidNames, tuple[list[int], list[int]]] = {}

    @property
    def corner_count(self) -> int:
        return sum(self._counts)

    def first(self) -> NDArray[np.int64]:
        return np.cumsum([0, *self._counts]).astype("<i8")

    def place(self, row: _SolidsRow, names: SolidNames) -> tuple[list[int], list[int]]:
        """Returns the columns of the row's discs and of its corners."""
        if names in self._known:
            return self._known[names]
        discs = [self.discs.setdefault(name, len(self.discs)) for name in names.discs]
        corners: list[int] = []
        for name, count in zip(names.polygons, np.diff(row.first).tolist(), strict=True):
            # a polygon with another number of corners is another one
            key = (name, count)
            if key not in self._polygons:
                self._polygons[key] = self.corner_count
                self._counts.append(count)
            corners += range(self._polygons[key], self._polygons[key] + count)
        self._known[names] = discs, corners
        return discs, corners
