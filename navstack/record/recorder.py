"""Takes down a run while it happens: appends to lists, copies what will change, computes nothing until the end."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Event,
    Footprint,
    GridGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.core.errors import jsonable
from navstack.core.files import atomic_write, ensure_directory
from navstack.interfaces import LocalPlan
from navstack.record import format as fmt
from navstack.record._grid_kernels import take_over
from navstack.record.log import render_log
from navstack.record.reader import Record


class Collision(Protocol):
    """What a simulator knows of a collision."""

    @property
    def time(self) -> float:
        """Seconds."""
        ...

    @property
    def pose(self) -> Pose2D:
        """The robot in the global frame."""
        ...


class RunRecorder:
    """The record of one run, in memory until `save`. A `Listener`: hand it the events, and the rest by its methods.

    Times (s) are those of the run's clock and never run backwards. Whatever is handed over may be changed afterwards:
    arrays are copied. The same calls give the same file, byte for byte; so nothing handed over may stem from a wall
    clock. See `navstack.record.format` for the file.
    """

    def __init__(
        self,
        *,
        map: OccupancyGrid | None,
        footprint: Footprint,
        scenario: Mapping[str, Any],
        global_frame: str = "map",
        local_frame: str = "odom",
        base_frame: str = "base_link",
        keep_tables: bool = True,
    ) -> None:
        """`footprint`: the true outline, without the costmaps' padding. `scenario`: what the run was started with, as
        JSON knows it. `keep_tables=False` leaves the local planner's samples out (a few hundred bytes a cycle).
        """
        self._map = map
        self._footprint = footprint
        self._scenario: dict[str, Any] = jsonable(dict(scenario))
        self._frames = {"global": global_frame, "local": local_frame, "base": base_frame}
        self._keep_tables = keep_tables
        self._results: list[dict[str, Any]] = []
        self._events: list[dict[str, Any]] = []
        self._samples = array("d")
        self._sample_goal = array("i")
        self._clearances = array("d")
        self._clearance_source: Callable[[], Sequence[float]] | None = None
        self._solids: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
        self._solid_first: NDArray[np.int64] = np.zeros(1, np.int64)
        self._sample_state: list[str] = []
        self._goals: list[tuple[float, ...]] = []
        self._collisions: list[tuple[float, ...]] = []
        self._plans: list[tuple[float, NDArray[np.float64], int, str]] = []
        self._local_plans: list[_LocalPlanRow] = []
        self._costmaps: dict[str, _CostmapLog] = {}
        self._scans: list[tuple[tuple[float, ...], int, NDArray[np.float32]]] = []
        self._scan_sources: dict[tuple[str, str], int] = {}

    # --- while the run goes on ----------------------------------------------------------------------------------------

    hears_feedback = False
    """`Listener` may say so: the samples say the same."""

    def on_event(self, event: Event) -> None:
        """Takes down an event of the goal manager; feedback is left out, the samples say the same."""
        if event.kind == "feedback":
            return
        self._events.append(
            {"time": float(event.time), "kind": event.kind, "text": event.text, "data": jsonable(event.data)}
        )

    def goal(self, t: float, pose: Pose2D) -> None:
        """A goal was accepted (global frame); goals are counted from 0 in this order."""
        self._goals.append((t, *pose))

    def sample(
        self,
        t: float,
        *,
        pose: Pose2D,
        odom: RobotState,
        map_to_odom: Transform2D,
        command: Twist2D,
        state: int | str,
        goal_index: int,
        clearance: float = math.nan,
    ) -> None:
        """Where the robot is (`pose` in the global frame, `odom` as it reports), what it was told, and why.

        `clearance` (m): from its true outline to the nearest obstacle, where somebody knows.
        """
        self._clearances.append(clearance)
        self._samples.extend((t, *pose, *odom.pose, *odom.velocity, *map_to_odom, *command))
        self._sample_goal.append(goal_index)
        self._sample_state.append(state if isinstance(state, str) else str(state))

    def set_clearance_source(self, source: Callable[[], Sequence[float]]) -> None:
        """`source` gives the clearances (m) of all samples so far, in place of those noted with them: asked at the end, and
        whenever the run so far is read.
        """
        self._clearance_source = source

    def solids(self, discs: NDArray[np.float64], corners: NDArray[np.float64], first: NDArray[np.int64]) -> None:
        """What stands beside the map (global frame): discs (k, 3) x, y, radius, and the corners (m, 2) of polygons, those of
        polygon i from `first[i]` to `first[i + 1] - 1`. Once where nothing moves, else with every sample; always as many.
        """
        self._solids.append((discs.astype(np.float32), corners.astype(np.float32)))
        self._solid_first = np.array(first, np.int64)

    def plan(self, t: float, poses: NDArray[np.float64], frame: str) -> None:
        """The global planner's plan (n, 3), for the goal accepted last."""
        self._plans.append((t, np.array(poses, np.float64).reshape(-1, 3), len(self._goals) - 1, frame))

    def local_plan(self, t: float, plan: LocalPlan) -> None:
        """The local planner's choice, with the table of samples it was made from."""
        self._local_plans.append(_LocalPlanRow(t, plan, self._keep_tables))

    def costmap(self, t: float, name: str, costmap: Costmap, window: Window | None = None) -> None:
        """A costmap after an update that rewrote `window` (None: perhaps every cell).

        Kept are the cells that differ from the update before, or all when the grid moved. Names are "global" and
        "local"; a trailing "_costmap" is dropped.
        """
        name = name.removesuffix("_costmap")
        log = self._costmaps.get(name)
        if log is None:
            log = self._costmaps[name] = _CostmapLog(costmap.frame)
        log.add(t, costmap, window)

    def scan(self, t: float, scan: LaserScan, pose: Pose2D) -> None:
        """A scan and the robot's pose (global frame) at that time."""
        source = self._scan_sources.setdefault((scan.topic, scan.frame), len(self._scan_sources))
        self._scans.append(
            (
                (t, *pose, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, scan.height),
                source,
                np.array(scan.ranges, np.float32),
            )
        )

    def collision(self, t: float, pose: Pose2D) -> None:
        """The true footprint touched something with the robot at `pose` (global frame)."""
        self._collisions.append((t, *pose))

    def finish(self, results: Sequence[Mapping[str, Any]], collisions: Sequence[Collision] | None = None) -> None:
        """How each goal ended, one JSON-able object per goal (no wall-clock times); `collisions` replace those noted."""
        self._results = [jsonable(dict(result)) for result in results]
        self._take_clearances()
        self._clearance_source = None  # and all that it holds on to
        if collisions is not None:
            self._collisions = [(collision.time, *collision.pose) for collision in collisions]

    # --- afterwards ---------------------------------------------------------------------------------------------------

    def record(self) -> Record:
        """The run so far, as `Record.load` would give it back."""
        return Record(*self._members())

    def save(self, folder: Path) -> dict[str, Path]:
        """Writes `run.npz` and `run.log` into `folder` (made when missing), whole or not at all: name -> path.

        Raises OutputError.
        """
        folder = Path(folder)
        meta, events, arrays = self._members()
        text = render_log(meta, events)
        ensure_directory(folder)
        files = {"record": folder / fmt.RUN_FILE, "log": folder / fmt.LOG_FILE}
        with atomic_write(files["record"]) as record, atomic_write(files["log"]) as log:
            with record.open("wb") as out:
                fmt.write(out, meta, events, arrays)
            log.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")
        return files

    def _members(self) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, NDArray[Any]]]:
        self._take_clearances()
        critics = self._critics()
        arrays: dict[str, NDArray[Any]] = {}
        if self._map is not None:
            arrays["map"] = np.ascontiguousarray(self._map.data, np.int8)
        values = np.array(self._samples, "<f8").reshape(-1, len(fmt.SAMPLE_COLUMNS))
        samples: dict[str, Any] = {name: values[:, i] for i, name in enumerate(fmt.SAMPLE_COLUMNS)}
        samples |= {"goal": self._sample_goal, "state": self._sample_state}
        arrays["samples"] = fmt.table(fmt.TABLES["samples"], samples, len(values))
        clearances = np.array(self._clearances, "<f8")
        if not np.isnan(clearances).all():
            arrays["clearances"] = clearances
        if self._solids:
            arrays["solid_discs"] = np.array([discs for discs, _ in self._solids], "<f4")
            arrays["solid_corners"] = np.array([corners for _, corners in self._solids], "<f4")
            arrays["solid_first"] = self._solid_first.astype("<i8")
        for name, rows in (("goals", self._goals), ("collisions", self._collisions)):
            columns = np.array(rows, np.float64).reshape(-1, 4)
            arrays[name] = fmt.table(
                fmt.TABLES[name], {key: columns[:, i] for i, key in enumerate(("t", "x", "y", "yaw"))}, len(rows)
            )
        arrays |= self._plan_arrays()
        arrays |= self._local_plan_arrays(critics)
        arrays |= self._scan_arrays()
        for name, log in self._costmaps.items():
            arrays[f"costmaps/{name}"] = log.table()
            arrays[f"costmaps/{name}_cells"] = np.frombuffer(b"".join(log.cells), np.uint8)
        meta = {
            "format": fmt.FORMAT,
            "version": fmt.VERSION,
            "frames": self._frames,
            "map": _map_meta(self._map),
            "footprint": self._footprint.vertices.tolist(),
            "scenario": self._scenario,
            "results": self._results,
            "critics": list(critics),
            "local_plan_notes": {str(i): list(row.notes) for i, row in enumerate(self._local_plans) if row.notes},
            "costmaps": {name: log.frame for name, log in self._costmaps.items()},
            "scan_sources": [list(source) for source in self._scan_sources],
        }
        return meta, self._events, arrays

    def _take_clearances(self) -> None:
        if self._clearance_source is not None:
            self._clearances = array("d", self._clearance_source())

    def _critics(self) -> tuple[str, ...]:
        names: dict[str, None] = {}
        for row in self._local_plans:
            names.update(dict.fromkeys(row.critics))
        return tuple(names)

    def _plan_arrays(self) -> dict[str, NDArray[Any]]:
        plans = self._plans
        counts = np.array([len(poses) for _, poses, _, _ in plans], np.int64)
        data: dict[str, Any] = {
            "t": [t for t, _, _, _ in plans],
            "first": np.cumsum(counts) - counts,
            "count": counts,
            "goal": [goal for _, _, goal, _ in plans],
            "frame": [frame for _, _, _, frame in plans],
        }
        return {
            "plans": fmt.table(fmt.TABLES["plans"], data, len(plans)),
            "plan_poses": _stacked([poses for _, poses, _, _ in plans], 3, "<f8"),
        }

    def _local_plan_arrays(self, critics: tuple[str, ...]) -> dict[str, NDArray[Any]]:
        rows = self._local_plans
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
                # another planner had the word: its critics keep their own columns
                wide = np.full((len(row.samples), len(critics)), np.nan, np.float32)
                wide[:, columns] = row.costs
                costs.append(wide)
                lookup = np.array([*columns, -2, -1], np.int8)
                rejected.append(lookup[row.rejected_by])
        return {
            "local_plans": fmt.table(fmt.TABLES["local_plans"], data, len(rows)),
            # column by column: a critic's costs, one after the other, shrink far better than rows
            "local_plan_samples": np.asfortranarray(_stacked([row.samples for row in rows], 3, "<f4")),
            "local_plan_costs": np.asfortranarray(_stacked(costs, len(critics), "<f4")),
            "local_plan_totals": _joined([row.totals for row in rows], "<f4"),
            "local_plan_rejected_by": _joined(rejected, "|i1"),
            "local_plan_scales": scales,
            "local_plan_poses": _stacked([row.trajectory for row in rows], 3, "<f4"),
        }

    def _scan_arrays(self) -> dict[str, NDArray[Any]]:
        columns = [name for name, _ in fmt.TABLES["scans"]]
        values = np.array([row for row, _, _ in self._scans], np.float64).reshape(-1, 9)
        counts = np.array([len(ranges) for _, _, ranges in self._scans], np.int64)
        data: dict[str, Any] = {name: values[:, i] for i, name in enumerate(columns[:9])}
        data |= {
            "source": [source for _, source, _ in self._scans],
            "first": np.cumsum(counts) - counts,
            "count": counts,
        }
        return {
            "scans": fmt.table(fmt.TABLES["scans"], data, len(self._scans)),
            "scan_ranges": _joined([ranges for _, _, ranges in self._scans], "<f4"),
        }


class _LocalPlanRow:
    """What is kept of a `LocalPlan`: copies in single precision."""

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


class _CostmapLog:
    """The updates of one costmap: whole grids when it moved, else the box of cells that changed."""

    def __init__(self, frame: str) -> None:
        self.frame = frame
        self.cells: list[bytes] = []
        self._rows: list[tuple[float | int, ...]] = []
        self._size = 0
        self._geometry: GridGeometry | None = None
        self._last: NDArray[np.uint8] | None = None

    def add(self, t: float, costmap: Costmap, window: Window | None) -> None:
        geometry = costmap.geometry
        data = costmap.data
        if self._last is None or geometry != self._geometry:
            box = geometry.window
            self._last = data.copy()
            self._geometry = geometry
        else:
            inside = geometry.window if window is None else window
            box = Window(*take_over(data, self._last, *inside))
        g = geometry
        self._rows.append((t, g.nx, g.ny, g.resolution, g.origin_x, g.origin_y, *box, self._size))
        if not box.is_empty:
            cells = data[box.slices].tobytes()
            self.cells.append(cells)
            self._size += len(cells)

    def table(self) -> NDArray[np.void]:
        """The rows as a structured array."""
        out = np.zeros(len(self._rows), fmt.COSTMAP_TABLE)
        for i, (name, _) in enumerate(fmt.COSTMAP_TABLE):
            out[name] = [row[i] for row in self._rows]
        return out


def _stacked(parts: list[Any], width: int, dtype: str) -> NDArray[Any]:
    return np.concatenate([np.empty((0, width), dtype), *parts], dtype=dtype)


def _joined(parts: list[Any], dtype: str) -> NDArray[Any]:
    return np.concatenate([np.empty(0, dtype), *parts], dtype=dtype)


def _map_meta(grid: OccupancyGrid | None) -> dict[str, Any] | None:
    if grid is None:
        return None
    return {
        "resolution": grid.geometry.resolution,
        "origin_x": grid.geometry.origin_x,
        "origin_y": grid.geometry.origin_y,
        "origin_yaw": grid.origin_yaw,
        "frame": grid.frame,
    }
