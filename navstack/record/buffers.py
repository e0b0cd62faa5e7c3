"""Buffers of a recorder: they collect plans and costmap updates in the form of the record."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Window
from navstack.interfaces import LocalPlan
from navstack.record import format as fmt
from navstack.record._grid_kernels import copy_changes
from navstack.record.columns import Column, Streamed, Table, looked_up, side_by_side

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
