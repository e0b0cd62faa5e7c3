"""Typed access to a recorded run; large data is converted when it is first used."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Event,
    Footprint,
    GridGeometry,
    InputError,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    RecordError,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.plugins import LocalPlan
from navstack.record.archive import locate, read
from navstack.record.commands import RecordedCommand, recorded_command
from navstack.record.estimates import COVARIANCE, ESTIMATE_TABLE
from navstack.record.social import PeopleTrack
from navstack.record.steering import SteeredBase, steered_base_of


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPlan:
    """A global plan made at `t` (s) for goal number `goal`: poses (n, 3) x, y, yaw in `frame`."""

    t: float
    poses: NDArray[np.float64]
    frame: str
    goal: int


@dataclass(frozen=True, slots=True, eq=False)
class RecordedLocalPlan:
    """A local plan at `t` (s). `plan` has the table of samples in single precision, None if it was not recorded."""

    t: float
    plan: LocalPlan
    tried: int
    """Number of samples of the cycle."""
    rejected: int
    """Number of samples rejected by a critic or a limit."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """A scan taken at `t` (s) with the robot at `pose` in the global frame."""

    t: float
    scan: LaserScan
    """Ranges to the millimeter."""
    pose: Pose2D
    mounting: Transform2D = Transform2D()
    """Pose of the lidar in the base frame."""

    @property
    def base_points(self) -> NDArray[np.float64]:
        """(n, 2) end points of the beams that hit, in the base frame (m)."""
        scan = self.scan
        ranges = scan.ranges.astype(np.float64)
        hit = (ranges >= scan.range_min) & (ranges <= scan.range_max)
        angle = scan.angle_min + scan.angle_increment * np.flatnonzero(hit)
        return self.mounting.apply_points(ranges[hit, None] * np.column_stack((np.cos(angle), np.sin(angle))))

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 2) end points of the beams that hit, in the global frame (m)."""
        return Transform2D(*self.pose).apply_points(self.base_points)


class Record:
    """A recorded run. Meters, radians, seconds of the run's clock; "at t" means the last entry not later than t."""

    def __init__(
        self,
        meta: dict[str, Any],
        events: list[dict[str, Any]],
        arrays: Mapping[str, NDArray[Any]],
        path: Path | None = None,
    ) -> None:
        """Takes the checked members of a file (`navstack.record.format`); use `Record.load`."""
        self.path = path
        self.resume: Callable[[], Any] | None = None
        """Returns the run, recorded again, before the first sample of this record; None: the run has to begin from its start."""
        self.meta = meta
        self.arrays = arrays
        """The tables and arrays of the file by name (`navstack.record.format`)."""
        frames = meta["frames"]
        self.global_frame: str = frames["global"]
        self.local_frame: str = frames["local"]
        self.base_frame: str = frames["base"]
        self.scenario: dict[str, Any] = meta["scenario"]
        self.results: list[dict[str, Any]] = meta["results"]
        self.footprint = Footprint(np.array(meta["footprint"], np.float64))
        self.map: OccupancyGrid | None = None
        if meta["map"] is not None:
            m = meta["map"]
            ny, nx = arrays["map"].shape
            geometry = GridGeometry(nx, ny, float(m["resolution"]), float(m["origin_x"]), float(m["origin_y"]))
            self.map = OccupancyGrid(arrays["map"], geometry, float(m["origin_yaw"]), str(m["frame"]), raw=True)
        self.events: tuple[Event, ...] = tuple(Event(float(e["time"]), e["kind"], e["text"], e["data"]) for e in events)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Record:
        """Reads the run in a file, or in a folder that contains `run.npz`.

        Raises RecordError if it is missing, truncated, damaged, not a record, or of a newer format version.
        """
        file = locate(Path(path))
        members = read(file)
        try:
            return cls(*members, file)
        except (InputError, ValueError, TypeError, KeyError) as exc:
            raise RecordError(
                f"{file} is damaged or not a recorded run ({exc}); record the run again", path=str(file)
            ) from exc

    # --- the robot ----------------------------------------------------------------------------------------------------

    @property
    def samples(self) -> NDArray[np.void]:
        """The table of control cycles: `record.samples["x"]`, `pandas.DataFrame(record.samples)`."""
        return self.arrays["samples"]

    @property
    def times(self) -> NDArray[np.float64]:
        """(n,) times of the samples (s)."""
        return self.samples["t"]

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """(n, 3) x, y, yaw in the global frame."""
        return self._columns("x", "y", "yaw")

    @cached_property
    def odom_poses(self) -> NDArray[np.float64]:
        """(n, 3) x, y, yaw of the odometry in the local frame."""
        return self._columns("odom_x", "odom_y", "odom_yaw")

    @cached_property
    def velocities(self) -> NDArray[np.float64]:
        """(n, 3) vx, vy, wz of the odometry in the robot's frame."""
        return self._columns("vx", "vy", "wz")

    @cached_property
    def commands(self) -> NDArray[np.float64]:
        """(n, 3) commanded vx, vy, wz in the robot's frame."""
        return self._columns("cmd_vx", "cmd_vy", "cmd_wz")

    @cached_property
    def map_to_odom(self) -> NDArray[np.float64]:
        """(n, 3) x, y, yaw of the local frame in the global frame."""
        return self._columns("map_to_odom_x", "map_to_odom_y", "map_to_odom_yaw")

    @property
    def clearances(self) -> NDArray[np.float64]:
        """(n,) distance (m) from the unpadded footprint to the nearest obstacle, inf without obstacles, nan if unknown."""
        found = self.arrays.get("clearances")
        return np.full(len(self.times), np.nan) if found is None else found

    @cached_property
    def steered_base(self) -> SteeredBase | None:
        """The base, if it is steered: a car or a tricycle."""
        return steered_base_of(self.meta)

    @property
    def steering(self) -> NDArray[np.float64]:
        """(n,) steering angle (rad) of a steered base, nan for any other."""
        found = self.arrays.get("steering")
        return np.full(len(self.times), np.nan) if found is None else found

    @cached_property
    def people(self) -> PeopleTrack | None:
        """Where the people were; None for a run without people."""
        return PeopleTrack.of(self.arrays)

    @property
    def has_moving_solids(self) -> bool:
        """True if obstacles that are not on the map moved."""
        discs = self.arrays.get("solid_discs")
        return discs is not None and len(discs) > 1

    def solids_at(self, t: float, *, absent: bool = False) -> tuple[NDArray[np.float32], list[NDArray[np.float32]]]:
        """Returns the obstacles that are not on the map at `t` (s), global frame: discs (k, 3) x, y, radius; polygons (n, 2).

        Both are empty if there were only the scenario's `obstacles`. With `absent`, obstacles that exist at another time only
        are listed as NaN, so that the order is the same at every time.
        """
        discs, corners = self.arrays.get("solid_discs"), self.arrays.get("solid_corners")
        if discs is None or corners is None:
            return np.empty((0, 3), np.float32), []
        row = self.index_at(t) if len(discs) > 1 else 0
        first = self.arrays["solid_first"]
        polygons = [corners[row, a:b] for a, b in itertools.pairwise(first.tolist())]
        if absent:
            return discs[row], polygons
        return discs[row][~np.isnan(discs[row, :, 0])], [p for p in polygons if not np.isnan(p).any()]

    @property
    def states(self) -> NDArray[np.str_]:
        """(n,) state of the goal manager, by name."""
        return self.samples["state"]

    @property
    def goal_indices(self) -> NDArray[np.int32]:
        """(n,) number of the current goal, -1 none."""
        return self.samples["goal"]

    @property
    def duration(self) -> float:
        """Time between the first and the last sample, s."""
        return float(self.times[-1] - self.times[0]) if len(self.times) else 0.0

    @property
    def path_length(self) -> float:
        """Length of the driven path, m."""
        step = np.diff(self.poses[:, :2], axis=0)
        return float(np.hypot(step[:, 0], step[:, 1]).sum())

    def index_at(self, t: float) -> int:
        """Returns the row of the last sample not later than `t`, at least 0. Raises RecordError without samples."""
        if not len(self.times):
            raise RecordError("the run has no samples: it was stopped before the first control cycle")
        return max(_last_at(self.times, t), 0)

    def pose_at(self, t: float) -> Pose2D:
        """Returns the robot's pose in the global frame."""
        x, y, yaw = self.poses[self.index_at(t)]
        return Pose2D(float(x), float(y), float(yaw))

    def map_to_odom_at(self, t: float) -> Transform2D:
        """Returns the pose of the local frame in the global frame."""
        x, y, yaw = self.map_to_odom[self.index_at(t)]
        return Transform2D(float(x), float(y), float(yaw))

    def to_global(self, frame: str, t: float) -> Transform2D:
        """Returns the transform from `frame` (global or local) to the global frame at `t`."""
        return self.map_to_odom_at(t) if frame == self.local_frame != self.global_frame else Transform2D()

    # --- goals, plans, collisions -------------------------------------------------------------------------------------

    @property
    def goal_times(self) -> NDArray[np.float64]:
        """(g,) times at which the goals were accepted (s)."""
        return self.arrays["goals"]["t"]

    @cached_property
    def goals(self) -> NDArray[np.float64]:
        """(g, 3) x, y, yaw in the global frame."""
        return self._columns("x", "y", "yaw", table="goals")

    @property
    def collision_times(self) -> NDArray[np.float64]:
        """(c,) s."""
        return self.arrays["collisions"]["t"]

    @cached_property
    def collisions(self) -> NDArray[np.float64]:
        """(c, 3) x, y, yaw of the robot in the global frame at each collision."""
        return self._columns("x", "y", "yaw", table="collisions")

    @cached_property
    def plans(self) -> tuple[RecordedPlan, ...]:
        """All global plans, ordered by time."""
        poses = self.arrays["plan_poses"]
        return tuple(
            RecordedPlan(
                float(row["t"]), poses[row["first"] : row["first"] + row["count"]], str(row["frame"]), int(row["goal"])
            )
            for row in self.arrays["plans"]
        )

    def plan_at(self, t: float) -> RecordedPlan | None:
        """Returns the current global plan."""
        i = _last_at(self.arrays["plans"]["t"], t)
        return self.plans[i] if i >= 0 else None

    def events_of(self, *kinds: str) -> list[Event]:
        """Returns the events of these kinds, ordered by time."""
        return [event for event in self.events if event.kind in kinds]

    # --- local plans --------------------------------------------------------------------------------------------------

    @property
    def critics(self) -> tuple[str, ...]:
        """Names of the critics, in the order of their columns."""
        return tuple(self.meta["critics"])

    @property
    def local_plan_times(self) -> NDArray[np.float64]:
        """(m,) s."""
        return self.arrays["local_plans"]["t"]

    def local_plan(self, index: int) -> RecordedLocalPlan:
        """Returns local plan number `index`, with its table of samples."""
        row = self.arrays["local_plans"][index]
        table = slice(row["first"], row["first"] + row["count"])
        poses = slice(row["first_pose"], row["first_pose"] + row["poses"])
        scored = bool(row["count"])
        notes = self.meta["local_plan_notes"].get(str(index % len(self.local_plan_times)), ())
        plan = LocalPlan(
            command=Twist2D(float(row["vx"]), float(row["vy"]), float(row["wz"])),
            mode=str(row["mode"]),
            samples=self.arrays["local_plan_samples"][table].astype(np.float64) if scored else None,
            critics=self.critics if scored else (),
            costs=self.arrays["local_plan_costs"][table].astype(np.float64) if scored else None,
            scales=self.arrays["local_plan_scales"][index].astype(np.float64) if scored else None,
            totals=self.arrays["local_plan_totals"][table].astype(np.float64) if scored else None,
            rejected_by=self.arrays["local_plan_rejected_by"][table] if scored else None,
            best=int(row["best"]),
            trajectory=self.arrays["local_plan_poses"][poses].astype(np.float64) if row["poses"] else None,
            notes=tuple(notes),
        )
        return RecordedLocalPlan(float(row["t"]), plan, int(row["tried"]), int(row["rejected"]))

    def local_plan_at(self, t: float) -> RecordedLocalPlan | None:
        """Returns the current local plan."""
        i = _last_at(self.local_plan_times, t)
        return self.local_plan(i) if i >= 0 else None

    # --- commands -----------------------------------------------------------------------------------------------------

    @property
    def command_steps(self) -> NDArray[np.void]:
        """The table of the commands on their way to the robot, empty without a chain."""
        found = self.arrays.get("commands")
        return np.zeros(0, [("t", "<f8")]) if found is None else found

    def command_step_at(self, t: float) -> RecordedCommand | None:
        """Returns the command in force, None without a chain or before the first one."""
        steps = self.command_steps
        i = _last_at(steps["t"], t)
        return recorded_command(steps[i]) if i >= 0 else None

    @property
    def zones(self) -> tuple[tuple[str, str, NDArray[np.float64]], ...]:
        """Name, action and corners (n, 2) in the base frame of the collision monitor's zones."""
        found: list[dict[str, Any]] = self.meta.get("zones", [])
        return tuple((z["name"], z["action"], np.array(z["corners"], np.float64).reshape(-1, 2)) for z in found)

    # --- costmaps -----------------------------------------------------------------------------------------------------

    @property
    def costmap_names(self) -> tuple[str, ...]:
        """Names of the recorded costmaps: usually "global" and "local"."""
        return tuple(self.meta["costmaps"])

    def costmap_times(self, name: str) -> NDArray[np.float64]:
        """(u,) times of the updates of a costmap ("local" or "local_costmap") (s); empty if it was not recorded."""
        name = name.removesuffix("_costmap")
        return self.arrays[f"costmaps/{name}"]["t"] if name in self.costmap_names else np.empty(0)

    def costmap_at(self, name: str, t: float) -> Costmap | None:
        """Returns the state of a costmap, in its own frame; None before its first update or if it was not recorded."""
        name = name.removesuffix("_costmap")
        last = _last_at(self.costmap_times(name), t)
        if last < 0:
            return None
        rows = self.arrays[f"costmaps/{name}"]
        first = last
        while not _is_whole(rows[first]):
            first -= 1
        *_, (_, costmap) = self._replay(name, first, last + 1)
        return costmap

    def costmap_updates(self, name: str) -> Iterator[tuple[float, Costmap]]:
        """Yields time and state of a costmap after each update. The Costmap object is reused: copy it to keep it."""
        return self._replay(name.removesuffix("_costmap"), 0, len(self.costmap_times(name)))

    def costmap_frame(self, name: str) -> str:
        """Returns the frame of a costmap; if it was not recorded, the local frame for "local", else the global frame."""
        name = name.removesuffix("_costmap")
        return self.meta["costmaps"].get(name, self.local_frame if name == "local" else self.global_frame)

    def _replay(self, name: str, first: int, end: int) -> Iterator[tuple[float, Costmap]]:
        costmap: Costmap | None = None
        if first == end:
            return
        rows = self.arrays[f"costmaps/{name}"]
        cells = self.arrays[f"costmaps/{name}_cells"]
        for row in rows[first:end]:
            window = Window(int(row["x0"]), int(row["y0"]), int(row["x1"]), int(row["y1"]))
            shape = (window.y1 - window.y0, window.x1 - window.x0)
            update = cells[row["first"] : row["first"] + shape[0] * shape[1]].reshape(shape)
            if costmap is None or _is_whole(row):
                geometry = GridGeometry(
                    int(row["nx"]),
                    int(row["ny"]),
                    float(row["resolution"]),
                    float(row["origin_x"]),
                    float(row["origin_y"]),
                )
                costmap = Costmap(geometry, update.copy(), self.meta["costmaps"][name])
            else:
                costmap.data[window.slices] = update
            yield float(row["t"]), costmap

    # --- scans --------------------------------------------------------------------------------------------------------

    @cached_property
    def scans(self) -> tuple[RecordedScan, ...]:
        """All recorded scans, ordered by time."""
        out: list[RecordedScan] = []
        for row in self.arrays["scans"]:
            topic, frame = self.meta["scan_sources"][row["source"]]
            scan = LaserScan(
                ranges=self.arrays["scan_ranges"][row["first"] : row["first"] + row["count"]],
                angle_min=float(row["angle_min"]),
                angle_increment=float(row["angle_increment"]),
                range_min=float(row["range_min"]),
                range_max=float(row["range_max"]),
                stamp=float(row["t"]),
                frame=str(frame),
                topic=str(topic),
                height=float(row["height"]),
            )
            mounting = Transform2D(*map(float, self.meta.get("sensors", {}).get(frame, (0.0, 0.0, 0.0))))
            pose = Pose2D(float(row["x"]), float(row["y"]), float(row["yaw"]))
            out.append(RecordedScan(float(row["t"]), scan, pose, mounting))
        return tuple(out)

    def scans_at(self, t: float) -> tuple[RecordedScan, ...]:
        """Returns the last scan of every lidar."""
        row = self.arrays["scans"]
        until = _last_at(row["t"], t) + 1
        source = row["source"][:until]
        return tuple(self.scans[int(np.flatnonzero(source == k)[-1])] for k in np.unique(source))

    def _columns(self, *names: str, table: str = "samples") -> NDArray[np.float64]:
        rows = self.arrays[table]
        return np.column_stack([rows[name] for name in names])

    def __repr__(self) -> str:
        name = self.path.name if self.path else "in memory"
        return f"Record({name}, {len(self.events)} events)"


def _last_at(times: NDArray[np.float64], t: float) -> int:
    """Returns the index of the last time not later than `t`, -1 if all are later."""
    return int(np.searchsorted(times, t, side="right")) - 1


def _is_whole(row: NDArray[np.void] | np.void) -> bool:
    return bool(row["x0"] == 0 and row["y0"] == 0 and row["x1"] == row["nx"] and row["y1"] == row["ny"])


# --- estimates --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class RecordedEstimate:
    """One estimate of a localizer."""

    t: float
    """Stamp of the scan (s)."""
    pose: Pose2D
    """Of the base, in the map."""
    covariance: NDArray[np.float64]
    """(3, 3) of x, y, yaw (m, rad)."""
    count: int
    """Number of particles or hypotheses."""
    lost: bool
    """The robot knew that it does not know where it is."""
    explained: float
    """Share of the scan that the estimate explains; NaN if the localizer does not say."""
    particles: NDArray[np.float32]
    """(k, 4) x, y, yaw (map) and weight of possible poses, at most MAX_DRAWN of them."""


def estimates_of(record: Record) -> NDArray[np.void]:
    """Return the table `estimates`, empty for a run without a localizer."""
    found = record.arrays.get("estimates")
    return np.zeros(0, ESTIMATE_TABLE) if found is None else found


def recorded_estimate(record: Record, row: int) -> RecordedEstimate:
    """Return a row of the table."""
    e = estimates_of(record)[row]
    covariance = np.empty((3, 3))
    covariance[np.triu_indices(3)] = [float(e[name]) for name in COVARIANCE]
    covariance[np.tril_indices(3)] = covariance.T[np.tril_indices(3)]
    first, drawn = int(e["first"]), int(e["drawn"])
    return RecordedEstimate(
        float(e["t"]),
        Pose2D(float(e["x"]), float(e["y"]), float(e["yaw"])),
        covariance,
        int(e["count"]),
        bool(e["lost"]),
        float(e["explained"]),
        record.arrays["particles"][first : first + drawn],
    )


def estimate_at(record: Record, t: float) -> RecordedEstimate | None:
    """Return the last estimate not later than `t` (s); None before the first one, and for a run without a localizer."""
    row = int(np.searchsorted(estimates_of(record)["t"], t, side="right")) - 1
    return recorded_estimate(record, row) if row >= 0 else None


def moved(record: Record, found: RecordedEstimate, t: float) -> RecordedEstimate:
    """Return an estimate with its possible poses where they are at `t` (s), by the odometry since its scan."""
    odometry = record.odom_poses
    then, now = (Transform2D(*odometry[record.index_at(time)].tolist()) for time in (found.t, t))
    step = then.inverse() @ now
    cloud = found.particles.astype(np.float64)
    c, s = np.cos(cloud[:, 2]), np.sin(cloud[:, 2])
    x, y = cloud[:, 0] + c * step.x - s * step.y, cloud[:, 1] + s * step.x + c * step.y
    particles = np.column_stack((x, y, cloud[:, 2] + step.yaw, cloud[:, 3])).astype(np.float32)
    return replace(found, pose=Pose2D(*(Transform2D(*found.pose) @ step)), particles=particles)


def believed_poses(record: Record) -> NDArray[np.float64]:
    """Return where the robot took itself to be at each sample: (n, 3) x, y, yaw in the global frame."""
    frame, odometry = record.map_to_odom, record.odom_poses
    c, s = np.cos(frame[:, 2]), np.sin(frame[:, 2])
    x = frame[:, 0] + c * odometry[:, 0] - s * odometry[:, 1]
    y = frame[:, 1] + s * odometry[:, 0] + c * odometry[:, 1]
    yaw = frame[:, 2] + odometry[:, 2]
    return np.column_stack((x, y, np.arctan2(np.sin(yaw), np.cos(yaw))))
