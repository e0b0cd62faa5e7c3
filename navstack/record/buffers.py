"""Buffers of a recorder: they collect local plans and costmap updates and convert them to arrays of the record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Window
from navstack.interfaces import LocalPlan
from navstack.record import format as fmt
from navstack.record._grid_kernels import copy_changes


def stacked(parts: list[Any], width: int, dtype: str) -> NDArray[Any]:
    """Concatenates arrays (n, width); an empty array for no parts."""
    return np.concatenate([np.empty((0, width), dtype), *parts], dtype=dtype)


def joined(parts: list[Any], dtype: str) -> NDArray[Any]:
    """Concatenates arrays (n,); an empty array for no parts."""
    return np.concatenate([np.empty(0, dtype), *parts], dtype=dtype)


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


class CostmapBuffer:
    """The updates of one costmap: the whole grid if it moved, else the box of changed cells."""

    def __init__(self, frame: str) -> None:
        self.frame = frame
        self.cells: list[bytes] = []
        self._rows: list[tuple[float | int, ...]] = []
        self._size = 0
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
        self._rows.append((t, g.nx, g.ny, g.resolution, g.origin_x, g.origin_y, *box, self._size))
        if not box.is_empty:
            cells = data[box.slices].tobytes()
            self.cells.append(cells)
            self._size += len(cells)

    def table(self) -> NDArray[np.void]:
        """Returns the updates as a structured array."""
        out = np.zeros(len(self._rows), fmt.COSTMAP_TABLE)
        for i, (name, _) in enumerate(fmt.COSTMAP_TABLE):
            out[name] = [row[i] for row in self._rows]
        return out


def critics_of(rows: list[LocalPlanRow]) -> tuple[str, ...]:
    """Returns the names of all critics, in order of their first appearance."""
    names: dict[str, None] = {}
    for row in rows:
        names.update(dict.fromkeys(row.critics))
    return tuple(names)


def local_plan_arrays(rows: list[LocalPlanRow], critics: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Returns the table and the arrays of the local plans; the costs have a column for each of `critics`."""
    counts = np.array([len(row.samples) for row in rows], np.int64)
    poses = np.array([len(row.trajectory) for row in rows], np.int64)
    data: dict[str, Any] = {
        "first": np.cumsum(counts) - counts,
        "count": counts,
        "first_pose": np.cumsum(poses) - poses,
        "poses": poses,
    }
    for name in ("t", "mode", "vx", "vy", "wz", "best", "tried", "rejected"):
        data[name] = [getattr(row, name) for row in rows]
    scales = np.full((len(rows), len(critics)), np.nan, np.float32)
    costs: list[NDArray[np.float32]] = []
    rejected: list[NDArray[np.int8]] = []
    for i, row in enumerate(rows):
        columns = [critics.index(name) for name in row.critics]
        if row.scales is not None:
            scales[i, columns] = row.scales
        if row.critics == critics:
            costs.append(row.costs)
            rejected.append(row.rejected_by)
        elif len(row.samples):
            # of another planner: its critics have columns of their own
            wide = np.full((len(row.samples), len(critics)), np.nan, np.float32)
            wide[:, columns] = row.costs
            costs.append(wide)
            lookup = np.array([*columns, -2, -1], np.int8)
            rejected.append(lookup[row.rejected_by])
    return {
        "local_plans": fmt.table(fmt.TABLES["local_plans"], data, len(rows)),
        # column-major: the costs of one critic compress much better than those of one sample
        "local_plan_samples": np.asfortranarray(stacked([row.samples for row in rows], 3, "<f4")),
        "local_plan_costs": np.asfortranarray(stacked(costs, len(critics), "<f4")),
        "local_plan_totals": joined([row.totals for row in rows], "<f4"),
        "local_plan_rejected_by": joined(rejected, "|i1"),
        "local_plan_scales": scales,
        "local_plan_poses": stacked([row.trajectory for row in rows], 3, "<f4"),
    }
