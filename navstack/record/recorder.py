"""Records a run: appends to buffers, in memory or on disk, and computes nothing until the end."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import yaml
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Event,
    Footprint,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    Window,
    atomic_write,
    ensure_directory,
    jsonable,
)
from navstack.move_base import MoveBase
from navstack.plugins import Localizer, LocalPlan
from navstack.record import format as fmt
from navstack.record.archive import dump_json, write
from navstack.record.buffers import (
    CostmapBuffer,
    LocalPlanBuffer,
    PlanBuffer,
    ScanBuffer,
    SolidNames,
    SolidsBuffer,
    scan_arrays,
)
from navstack.record.columns import Column, OnDemand, Streamed, Table
from navstack.record.commands import CommandBuffer
from navstack.record.estimates import EstimateBuffer
from navstack.record.reader import Record
from navstack.record.social import PeopleTrack
from navstack.record.steering import SteeredBase
from navstack.safety import CommandStep

# --- the log ----------------------------------------------------------------------------------------------------------


def render_log(meta: dict[str, Any], events: list[dict[str, Any]]) -> str:
    """Returns the scenario as YAML, a line per event (time in s, kind, text) and a line per goal result. No wall-clock times.

    The first event of each exception in a plugin has the traceback below it.
    """
    lines = [f"# navstack run, format {meta['version']}", "# scenario:", *_scenario(meta["scenario"])]
    tracebacks: set[str] = set()
    # repeated events (of a planner that runs five times per second) take one line with a count
    for event, count, until in _group_repeats(events):
        again = f" (repeated {count - 1} times until {until:.3f} s)" if count > 1 else ""
        line = f"{event['time']:10.3f}  {_one_line(event['kind']):<14}  {_one_line(event['text'])}{again}"
        lines.append(line.rstrip())
        trace = event.get("data", {}).get("traceback")
        if isinstance(trace, str) and trace not in tracebacks:
            tracebacks.add(trace)
            lines += [f"{'':28}{_one_line(line)}".rstrip() for line in trace.splitlines()]
    lines += [f"# goal {i} {dump_json(result)}" for i, result in enumerate(meta["results"])]
    return "\n".join(lines) + "\n"


class _Dumper(yaml.SafeDumper):
    """Writes subclasses of str as texts: values of the command line know the option that they come from."""


_Dumper.add_multi_representer(str, yaml.SafeDumper.represent_str)


def _scenario(scenario: dict[str, Any]) -> Iterator[str]:
    """Yields the scenario as lines of YAML, its parameters last."""
    ordered = {key: value for key, value in scenario.items() if key != "parameters"}
    ordered |= {key: value for key, value in scenario.items() if key == "parameters"}
    text = yaml.dump(ordered, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)
    return (f"#   {_one_line(line)}" for line in text.splitlines())


def _group_repeats(events: list[dict[str, Any]]) -> list[tuple[dict[str, Any], int, float]]:
    """Groups consecutive events with the same kind and text: the first, the count, the time of the last."""
    groups: list[tuple[dict[str, Any], int, float]] = []
    for event in events:
        if groups and (groups[-1][0]["kind"], groups[-1][0]["text"]) == (event["kind"], event["text"]):
            first, count, _ = groups[-1]
            groups[-1] = (first, count + 1, event["time"])
        else:
            groups.append((event, 1, event["time"]))
    return groups


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


_FLOAT: Final = struct.Struct("<d").pack


class Collision(Protocol):
    """A collision as reported by a simulator."""

    @property
    def time(self) -> float:
        """Seconds."""
        ...

    @property
    def pose(self) -> Pose2D:
        """Pose of the robot in the global frame."""
        ...


class RunRecorder:
    """The record of one run, in memory or on disk until `save`. It is a `Listener` for events; methods add the other data.

    Times (s) are those of the run's clock and must not decrease. Arrays are copied, so the caller may change them afterwards.
    The same calls give the same file byte for byte, so no data may come from a wall clock. See `navstack.record.format`.
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
        sensors: Mapping[str, Transform2D] | None = None,
        steering: SteeredBase | None = None,
        keep_tables: bool = True,
        keep_scans: bool = True,
        spool: Path | None = None,
    ) -> None:
        """`footprint`: without the costmaps' padding. `scenario`: JSON data that describes the run. `sensors`: pose of every
        lidar frame in the base frame. `steering`: of a steered base. `keep_tables=False` omits the local planner's samples (a
        few hundred bytes per cycle), `keep_scans=False` the scans (about 1 kB each). `spool`: folder for what grows with the run,
        in temporary files instead of in memory, deleted with the process; the methods then raise OutputError if the disk is full.
        """
        self._map = map
        self._footprint = footprint
        self._scenario: dict[str, Any] = jsonable(dict(scenario))
        self._frames = {"global": global_frame, "local": local_frame, "base": base_frame}
        self._sensors = {frame: [*pose] for frame, pose in (sensors or {}).items()}
        self._keep_scans = keep_scans
        self._results: list[dict[str, Any]] = []
        self._events: list[dict[str, Any]] = []
        self._spool = spool
        self._samples = Table(fmt.TABLES["samples"], spool)
        self._clearances = Column("<f8", None, spool)
        self._knows_clearance = False
        self._steered_base, self._steering = steering, Column("<f8", None, spool)
        self._clearance_source: Callable[[], Sequence[float]] | None = None
        self._people_source: Callable[[], PeopleTrack | None] | None = None
        self._solids = SolidsBuffer()
        self._goals: list[tuple[float, ...]] = []
        self._collisions: list[tuple[float, ...]] = []
        self._plans = PlanBuffer(spool)
        self._local_plans = LocalPlanBuffer(keep_tables, spool)
        self._costmaps: dict[str, CostmapBuffer] = {}
        self._scans: dict[tuple[str, str], ScanBuffer] = {}
        self._commands = CommandBuffer(spool)
        self._zones: list[Any] = []
        self._estimates = EstimateBuffer()

    # --- during the run -----------------------------------------------------------------------------------------------

    hears_feedback = False
    """Feedback events are not needed: the samples contain the same data."""

    def on_event(self, event: Event) -> None:
        """Adds an event of the goal manager, except feedback: the samples contain the same data."""
        if event.kind == "feedback":
            return
        self._events.append(
            {"time": float(event.time), "kind": event.kind, "text": event.text, "data": jsonable(event.data)}
        )

    def command_step(self, step: CommandStep) -> None:
        """Adds a command on its way from its source to the robot."""
        self._commands.add(step)

    def estimate(self, localizer: Localizer) -> None:
        """Adds the last estimate of a localizer, with some of its particles, unless it has been added."""
        self._estimates.take(localizer)

    def zones(self, zones: Sequence[Mapping[str, Any]]) -> None:
        """Sets the zones of the collision monitor: name, action and corners (m, base frame) of each."""
        self._zones = jsonable([dict(zone) for zone in zones])

    def goal(self, t: float, pose: Pose2D) -> None:
        """Adds an accepted goal (global frame); goals are numbered from 0 in this order."""
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
        steering: float = 0.0,
    ) -> None:
        """Adds a control cycle: true `pose` in the global frame, odometry `odom`, command and state.

        `clearance` (m): distance from the unpadded footprint to the nearest obstacle, if known. `steering` (rad): the angle of
        a steered base.
        """
        self._knows_clearance = self._knows_clearance or clearance == clearance
        self._clearances.extend_bytes(_FLOAT(clearance))
        if self._steered_base is not None:
            self._steering.extend_bytes(_FLOAT(steering))
        number = self._samples.texts["state"].number(state if isinstance(state, str) else str(state))
        self._samples.add(t, *pose, *odom.pose, *odom.velocity, *map_to_odom, *command, goal_index, number)

    def set_clearance_source(self, source: Callable[[], Sequence[float]]) -> None:
        """Sets a function that returns the clearances (m) of all samples so far; they replace those passed to `sample`.

        It is called at the end, and whenever the record is read before.
        """
        self._clearance_source = source

    def set_people_source(self, source: Callable[[], PeopleTrack | None]) -> None:
        """Sets a function that returns where the people were at all samples so far; it is called as that of the clearances."""
        self._people_source = source

    def solids(
        self,
        discs: NDArray[np.float64],
        corners: NDArray[np.float64],
        first: NDArray[np.int64],
        names: SolidNames | None = None,
    ) -> None:
        """Adds the obstacles that are not on the map (global frame): discs (k, 3) x, y, radius, and corners (m, 2) of polygons,
        those of polygon i at `first[i]` .. `first[i + 1] - 1`. Call it once if none of them moves, else for every sample.

        The numbers of discs and corners are constant, unless `names` identifies them: see `identify_solids`.
        """
        self._solids.add(len(self._samples), discs, corners, first, names)

    def identify_solids(
        self, discs: NDArray[np.float64], corners: NDArray[np.float64], first: NDArray[np.int64], names: SolidNames
    ) -> None:
        """Names the obstacles so far, before the first of them is added or removed. Without a call of `solids` before, these
        are the obstacles since the start.
        """
        self._solids.identify(discs, corners, first, names)

    def plan(self, t: float, poses: NDArray[np.float64], frame: str) -> None:
        """Adds a plan (n, 3) of the global planner, for the goal accepted last."""
        self._plans.add(t, poses, len(self._goals) - 1, frame)

    def local_plan(self, t: float, plan: LocalPlan) -> None:
        """Adds a plan of the local planner, with its table of samples."""
        self._local_plans.add(t, plan)

    def costmap(self, t: float, name: str, costmap: Costmap, window: Window | None = None) -> None:
        """Adds a costmap after an update of `window` (None: of any cell).

        Records the cells that differ from the previous update, or all if the grid moved. Names are "global" and "local"; a
        trailing "_costmap" is removed.
        """
        name = name.removesuffix("_costmap")
        log = self._costmaps.get(name)
        if log is None:
            log = self._costmaps[name] = CostmapBuffer(costmap.frame, self._spool)
        log.add(t, costmap, window)

    def scan(self, t: float, scan: LaserScan, pose: Pose2D | None = None) -> None:
        """Adds a scan and the robot's pose (global frame) at that time; None: interpolated between the samples."""
        if not self._keep_scans:
            return
        source = (scan.topic, scan.frame)
        buffer = self._scans.get(source)
        if buffer is None:
            buffer = self._scans[source] = ScanBuffer(len(self._scans), folder=self._spool)
        buffer.add(t, scan, pose)

    def collision(self, t: float, pose: Pose2D) -> None:
        """Adds a collision with the robot at `pose` (global frame)."""
        self._collisions.append((t, *pose))

    def finish(self, results: Sequence[Mapping[str, Any]], collisions: Sequence[Collision] | None = None) -> None:
        """Sets the result of each goal, as JSON data without wall-clock times; `collisions` replace those added before."""
        self._results = [jsonable(dict(result)) for result in results]
        self._fetch_clearances()
        self._clearance_source = None  # releases the simulator
        if collisions is not None:
            self._collisions = [(collision.time, *collision.pose) for collision in collisions]

    # --- after the run ------------------------------------------------------------------------------------------------

    def record(self) -> Record:
        """Returns the run so far, as `Record.load` would read it."""
        meta, events, arrays = self._members()
        return Record(meta, events, OnDemand(arrays))

    def set_sensors(self, sensors: Mapping[str, Transform2D]) -> None:
        """Replaces the poses of the lidar frames in the base frame: those of a log are known only when its scans arrive."""
        self._sensors = {frame: [*pose] for frame, pose in sensors.items()}

    def set_scenario(self, scenario: Mapping[str, Any]) -> None:
        """Replaces the JSON data that describe the run: a run that people take part in is known only at its end."""
        self._scenario = jsonable(dict(scenario))

    def save(self, folder: Path) -> dict[str, Path]:
        """Writes `run.npz` and `run.log` into `folder` atomically, creating it if necessary; returns name -> path.

        Raises OutputError.
        """
        folder = Path(folder)
        meta, events, arrays = self._members()
        text = render_log(meta, events)
        ensure_directory(folder)
        files = {"record": folder / fmt.RUN_FILE, "log": folder / fmt.LOG_FILE}
        with atomic_write(files["record"]) as record, atomic_write(files["log"]) as log:
            with record.open("wb") as out:
                write(out, meta, events, arrays)
            log.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")
        return files

    def _members(self) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, NDArray[Any] | Streamed]]:
        self._fetch_clearances()
        arrays: dict[str, NDArray[Any] | Streamed] = {}
        if self._map is not None:
            arrays["map"] = np.ascontiguousarray(self._map.data, np.int8)
        arrays["samples"] = self._samples.streamed()
        if self._knows_clearance:
            arrays["clearances"] = self._clearances.streamed()
        if self._steered_base is not None:
            arrays["steering"] = self._steering.streamed()
        arrays |= self._solids.arrays(len(self._samples))
        people = None if self._people_source is None else self._people_source()
        if people is not None:
            arrays |= people.arrays()
        for name, rows in (("goals", self._goals), ("collisions", self._collisions)):
            columns = np.array(rows, np.float64).reshape(-1, 4)
            arrays[name] = fmt.table(
                fmt.TABLES[name], {key: columns[:, i] for i, key in enumerate(("t", "x", "y", "yaw"))}, len(rows)
            )
        arrays |= self._plans.arrays()
        arrays |= self._local_plans.arrays()
        arrays |= scan_arrays(list(self._scans.values()), self._samples.rows.array())
        if len(self._commands):
            arrays["commands"] = self._commands.table()
        if len(self._estimates):
            arrays |= self._estimates.arrays()
        for name, log in self._costmaps.items():
            arrays |= log.arrays(name)
        meta = {
            "format": fmt.FORMAT,
            "version": fmt.VERSION,
            "frames": self._frames,
            "map": _map_meta(self._map),
            "footprint": self._footprint.vertices.tolist(),
            "scenario": self._scenario,
            "results": self._results,
            "critics": list(self._local_plans.critics),
            "local_plan_notes": self._local_plans.notes,
            "costmaps": {name: log.frame for name, log in self._costmaps.items()},
            "scan_sources": [list(source) for source in self._scans],
            "sensors": self._sensors,
        }
        if self._steered_base is not None:
            meta["steering"] = self._steered_base.as_dict()
        if self._zones:
            meta["zones"] = self._zones
        return meta, self._events, arrays

    def _fetch_clearances(self) -> None:
        if self._clearance_source is not None:
            found = np.array(self._clearance_source(), "<f8")
            self._clearances = Column("<f8")
            self._clearances.extend(found)
            self._knows_clearance = not np.isnan(found).all()


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


def record_tick_outputs(recorder: RunRecorder, move_base: MoveBase, mount: Callable[[str], None] | None = None) -> None:
    """Add the changed cells, plans, scans and command steps of the last tick.

    `mount` is called with the frame of each scan before the scan is added.
    """
    tick = move_base.last_tick
    t = tick.time
    if tick.global_window is not None:
        recorder.costmap(t, "global", move_base.global_costmap.master, tick.global_window)
    if tick.local_window is not None:
        recorder.costmap(t, "local", move_base.local_costmap.master, tick.local_window)
    if tick.plan is not None:
        recorder.plan(t, tick.plan.path.poses, tick.plan.path.frame)
    if tick.local_plan is not None:
        recorder.local_plan(t, tick.local_plan)
    for scan in tick.scans:
        if isinstance(scan, LaserScan):
            if mount is not None:
                mount(scan.frame)
            recorder.scan(scan.stamp, scan)
    if move_base.chain is not None:
        for step in move_base.chain.take_steps():
            recorder.command_step(step)
