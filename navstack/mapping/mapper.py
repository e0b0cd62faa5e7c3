"""The mapper: keyframes from scans as they come, their graph, and the map.

    mapper = Mapper()
    for frame in open_scan_log("run.bag"):
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan, frame.sensor)
    mapper.finish()
    save_map(mapper.map(), "map.yaml")

The same scans in the same order give the same map, to the bit.
"""

from __future__ import annotations

import bisect
import itertools
import math
from array import array
from collections import OrderedDict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, LogError, OccupancyGrid, Pose2D, Transform2D, normalize_angle, normalize_angles
from navstack.localization import LoggedScan, scan_beams
from navstack.logs import MappingModel, map_from_frames
from navstack.mapping.loops import (
    EDGE_FLOOR,
    LEAST_INFORMATION,
    LEAST_SHARE,
    Loop,
    Scene,
    agree,
    compare,
    edge_information,
    position_information,
)
from navstack.mapping.matching import SPACING, Match, Surfaces, surface_points
from navstack.mapping.params import MapperParams
from navstack.mapping.pose_graph import Edge, PoseGraph, solve
from navstack.mapping.refinement import UNCALIBRATED, Calibration, calibrate, refine

FEWEST_POINTS: Final = 15
"""A scan with fewer points cannot be matched."""
ODOMETRY_SPEED: Final = 5.0
"""An odometry that moves faster (m/s), by more than a meter, has jumped."""
ODOMETRY_TURN_RATE: Final = 6.0
"""The same of its heading (rad/s)."""
FARTHEST_SENSOR_M: Final = 100.0
"""No robot has its lidar farther from its base: such a pose is that of something else."""
NEAR_M: Final = 0.05
NEAR_RAD: Final = 0.05
"""A scan within this motion from the last match keeps the odometry's pose: nothing is gained by matching it."""
ACCELERATION: Final = 1.0
TURN_ACCELERATION: Final = 2.0
"""Standard deviations of the acceleration (m/s^2, rad/s^2) of a robot without odometry: it is expected to go on as it went."""
VELOCITY_S: Final = 0.3
"""Time over which its velocity is measured,"""
UNKNOWN_S: Final = 2.0
"""and after which it says nothing: the place of the robot must then be recognized, as that of a loop."""
SEEK_S: Final = 1.0
"""A robot that is lost is sought at each scan at first, later at this interval: the search is wide."""
WIDE_RAD: Final = 2.6
"""A scan of at least this angle sees enough walls to recognize a place by itself."""
PLACE_M: Final = 0.5
PLACE_RAD: Final = 0.4
"""Keyframes within this distance and difference of the heading are at the same place."""
FOLLOWED_DRIFT: Final = 0.03
MOST_FOLLOWED_DRIFT_M: Final = 0.3
"""Error of the position per distance that is followed where scans leave it open, as along a corridor, and the most (m)."""
DRIFT_M: Final = 0.3
DRIFT_PER_M: Final = 0.02
"""Drift to expect between two keyframes, and of it per length of the path between them."""
CALIBRATION_INTERVAL: Final = 20
"""Keyframes after which the odometry is calibrated again: what the scans leave open has its systematic errors."""
CALIBRATION_STEPS: Final = 400
"""Steps to keyframes that it is calibrated by, the newest."""
KERNEL_WIDTH: Final = 3.0
"""Loops with an error of more standard deviations than this lose weight when the graph is solved."""
SOLVED_STEP: Final = 0.005
"""While scans come, the graph is solved until no pose moves by more (m, rad): a match corrects much more."""
MOST_STRAIN: Final = 5.0
LEAST_STRAIN: Final = 1.0
"""Loops are wrong if a match along the way is then off by more standard deviations, and by so much more than before them."""


@dataclass(frozen=True, slots=True)
class MatchResult:
    """What the mapper made of a scan."""

    stamp: float
    pose: Pose2D
    """Of the base in the map, as far as known now; loops may move it later."""
    keyframe: int | None = None
    """Number of the keyframe that the scan became; None: it did not."""
    response: float = math.nan
    """Mean likelihood of the points of the scan, 1 for all on surfaces; NaN if it was not matched."""
    correction: Transform2D | None = None
    """From the predicted pose to the matched one, in the frame of the robot."""
    loops: tuple[Loop, ...] = ()
    """Loops that were decided with this scan."""
    rejected: str = ""
    """Why the scan was not used; empty if it was."""


class Step(NamedTuple):
    """The motion to a keyframe by the odometry and by the match, for the report."""

    keyframe: int
    before: int
    """The keyframe that the motion begins at: an older one if the robot has followed known places until here."""
    stamp: float
    odometry: Transform2D
    matched: Transform2D
    sigma: tuple[float, float]
    """Standard error that was expected of the odometry (m, rad)."""
    response: float


@dataclass(slots=True)
class Unfinished:
    """What `Mapper.finish` changes, as it was before: more scans go on from there."""

    poses: NDArray[np.float64]
    pending: list[Loop]
    decided: int
    """Number of loops that were decided."""


class Lost(NamedTuple):
    """A part of a log that has no odometry, and no scans that fit around the last known pose."""

    known_until: float
    """Stamp of the last scan before it that was placed (s)."""
    until: float
    """Stamp of the last scan that was not; if there was none, of the first one after a gap (s)."""
    scans: int
    """Number of scans that were not placed."""
    keyframe: int
    """The keyframe from which the last known pose is seen,"""
    pose: Transform2D
    """and that pose, in its frame."""


@dataclass(slots=True)
class Observations:
    """What the mapper noticed about its input, for the report."""

    rejected: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    """Stamps of scans that were not used, by reason."""
    gaps: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    """Stamps before and after a pause (s)."""
    jumps: list[tuple[float, Transform2D]] = field(default_factory=list[tuple[float, Transform2D]])
    """Stamp and step of odometry that jumped."""
    unmatched: list[tuple[float, int, float]] = field(default_factory=list[tuple[float, int, float]])
    """Stamp, keyframe and response of scans that fit nothing before them; the odometry placed them."""
    lost: list[Lost] = field(default_factory=list["Lost"])
    """Parts in which nothing told where the robot was, in order."""


class KeyframeStore:
    """The scans of the keyframes in millimeters, 16 bits a beam; points and normals are computed again when they are needed."""

    def __init__(self) -> None:
        self.ranges: list[NDArray[np.uint16]] = []
        self.stamps: list[float] = []
        self.setups: list[int] = []
        """Number of the sensor's setup of each keyframe."""
        self.known_setups: list[tuple[float, float, float, float, float, float, float]] = []
        """angle_min, angle_increment, range_min, range_max, x, y, yaw of the sensor."""
        self._surfaces: OrderedDict[int, NDArray[np.float64]] = OrderedDict()

    def __len__(self) -> int:
        return len(self.ranges)

    def add(self, scan: LaserScan, sensor: Transform2D) -> int:
        """Store a scan; return its number."""
        mounting = (sensor.x, sensor.y, sensor.yaw)
        setup = (scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, *mounting)
        if setup not in self.known_setups:
            self.known_setups.append(setup)
        self.ranges.append(compact_ranges(scan))
        self.stamps.append(scan.stamp)
        self.setups.append(self.known_setups.index(setup))
        return len(self.ranges) - 1

    def scan(self, k: int) -> tuple[LaserScan, Transform2D]:
        """Return a scan and the pose of its sensor."""
        angle_min, step, low, high, x, y, yaw = self.known_setups[self.setups[k]]
        return LaserScan(_expanded(self.ranges[k]), angle_min, step, low, high, self.stamps[k]), Transform2D(x, y, yaw)

    def surface(self, k: int, reach: float) -> NDArray[np.float64]:
        """Return the points with normals (n, 4) of a keyframe in the base frame."""
        if k in self._surfaces:
            self._surfaces.move_to_end(k)
            return self._surfaces[k]
        scan, sensor = self.scan(k)
        self._surfaces[k] = points_of(scan, sensor, reach)
        if len(self._surfaces) > 300:
            self._surfaces.popitem(last=False)
        return self._surfaces[k]

    def eye(self, k: int) -> NDArray[np.float64]:
        """Return the position (2,) of the sensor in the base frame."""
        return np.array(self.known_setups[self.setups[k]][4:6])


def compact_ranges(scan: LaserScan) -> NDArray[np.uint16]:
    """Return the ranges in mm: 0 for an invalid one, 65535 for no return."""
    values = np.asarray(scan.ranges, np.float64)
    with np.errstate(invalid="ignore"):
        none = (values >= scan.range_max) | (values >= 65.0)
        bad = ~(values >= scan.range_min) | (values <= 0.0)
        return np.where(none, 65535.0, np.where(bad, 0.0, np.rint(values * 1000.0))).astype(np.uint16)


def _expanded(ranges: NDArray[np.uint16]) -> NDArray[np.float32]:
    values = ranges.astype(np.float32) / np.float32(1000.0)
    values[ranges == 65535] = np.inf
    values[ranges == 0] = np.nan
    return values


def points_of(scan: LaserScan, sensor: Transform2D, reach: float) -> NDArray[np.float64]:
    """Return the points with normals (n, 4) of a scan in the base frame, thinned."""
    beams = scan_beams(scan, sensor, reach)
    return np.asarray(surface_points(beams.points, beams.eye, SPACING), np.float64)


class Mapper:
    """Simultaneous localization and mapping in the plane with one lidar, with odometry or without."""

    def __init__(self, params: MapperParams | None = None) -> None:
        self.params = params or MapperParams()
        self.graph = PoseGraph()
        """Poses of the keyframes (base in the map) and their edges. The first keyframe is the origin."""
        self.keyframes = KeyframeStore()
        self.loops: list[Loop] = []
        """Every loop that was decided, accepted or not, in order."""
        self.steps: list[Step] = []
        self.observations = Observations()
        self.pending: list[Loop] = []
        """Loops that wait for a second match."""
        self.unfinished: Unfinished | None = None
        """The state that further scans go on from; None before `finish`."""
        self.final_graph: PoseGraph | None = None
        """The graph of the refinement, whose solution the poses are; None before `finish`."""
        self.calibration: Calibration | None = None
        """Of the odometry, by the refinement."""
        self._poses: NDArray[np.float64] = np.empty((64, 3))
        self._links = array("d")
        """Nodes and length of every edge (i, j, m): an array, because all of it is used at each keyframe near a known place."""
        self._middles = array("d")
        self._travelled: list[float] = []
        """Length of the path at each keyframe (m)."""
        self.travelled = 0.0
        """Length of the path (m)."""
        self.followed = 0.0
        """Of it the part in known places, without new keyframes (m)."""
        self._reference = -1
        """The keyframe that the robot is seen from: the last one, or one of a known place."""
        self._at = Transform2D()
        """Pose seen from the reference at which the place was last looked at."""
        self._open_m = 0.0
        """Length of the path that was followed since a scan determined the position (m)."""
        self._recent: deque[int] = deque(maxlen=self.params.scan_buffer_size)
        """Keyframes that scans are matched with."""
        self._starts: list[int] = []
        """Keyframes that do not follow the one before them, in order."""
        self._last: tuple[float, Transform2D | None] | None = None
        self._moved = Transform2D()
        self._driven = Transform2D()
        self._matched = Transform2D()
        self.track = array("d")
        """Stamp, number of the last keyframe, and the step from it (m, rad), of every scan that was used."""
        self._velocity = Transform2D()
        """Per second, of a robot without odometry."""
        self._known_at = 0.0
        """Stamp of the last scan that was placed; earlier than the last one if the robot is lost."""
        self._is_lost = False
        self._sought_at = 0.0
        """Stamp at which a robot that was lost was last sought."""
        self._errors = UNCALIBRATED
        """Systematic errors of the odometry, by the last keyframes."""
        self._local: Surfaces | None = None
        self._intervals: deque[float] = deque(maxlen=50)
        self._waiting: list[list[Loop]] = []
        """Loops that were accepted since the graph was solved, those together that confirm each other."""
        self._tried_at = -math.inf

    # --- what others read ---------------------------------------------------------------------------------------------

    @property
    def pose(self) -> Pose2D | None:
        """The pose of the base in the map at the last scan; None before the first one."""
        if not len(self.keyframes):
            return None
        return Pose2D(*(self._keyframe_pose(self._reference) @ self._moved))

    @property
    def last_stamp(self) -> float | None:
        """Stamp of the last scan that was added (s); None before the first one."""
        return None if self._last is None else self._last[0]

    def map(self, model: MappingModel | None = None) -> OccupancyGrid:
        """Return the map of all keyframes at the poses of the graph. Raises LogError without a keyframe."""
        if not len(self.keyframes):
            why = [f"{len(stamps)} scans: {reason}" for reason, stamps in self.observations.rejected.items()]
            raise LogError(f"no scan could be used, so there is no map ({'; '.join(why) or 'the log has no scans'})")
        chosen = model or MappingModel(max_range=self.params.max_laser_range)
        return map_from_frames(self.frames, resolution=self.params.resolution, model=chosen)[0]

    def frames(self) -> Iterator[LoggedScan]:
        """Yield the keyframes as scans of a log, with their poses as reference."""
        for k in range(len(self.keyframes)):
            scan, sensor = self.keyframes.scan(k)
            yield LoggedScan(k, scan, sensor, Transform2D(), Pose2D(*self._keyframe_pose(k)))

    def trajectory(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return stamps (n,) and poses (n, 3) of all scans that were used."""
        table = np.array(self.track).reshape(-1, 5)
        base, step = self.graph.poses[table[:, 1].astype(np.int64)], table[:, 2:]
        c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
        x = base[:, 0] + c * step[:, 0] - s * step[:, 1]
        y = base[:, 1] + s * step[:, 0] + c * step[:, 1]
        return table[:, 0], np.column_stack((x, y, normalize_angles(base[:, 2] + step[:, 2])))

    # --- scans --------------------------------------------------------------------------------------------------------

    def add_scan(
        self, stamp: float, odometry: Transform2D | Pose2D | None, scan: LaserScan, sensor: Transform2D | None = None
    ) -> MatchResult:
        """Use a scan.

        Args:
            stamp: time (s); a scan that is not newer than the last one is rejected.
            odometry: pose of the base in the odometry frame; None for a robot without, at any scan.
            scan: the scan; its own stamp is not used.
            sensor: pose of the sensor in the base frame; None: that of the base.
        """
        self._go_on()
        mounting = sensor or Transform2D()
        reason = self._defect(stamp, odometry, scan, mounting)
        odom = None if odometry is None else Transform2D(*odometry)
        if reason:
            return self._rejected(stamp, reason)
        if self._last is None:
            surface = points_of(scan, mounting, self.params.max_laser_range)
            if len(surface) < FEWEST_POINTS:
                return self._rejected(stamp, f"fewer than {FEWEST_POINTS} points, so it cannot be matched")
            self._add_keyframe(stamp, scan, mounting, Transform2D())
            self._last = stamp, odom
            return MatchResult(stamp, Pose2D(0.0, 0.0, 0.0), 0)
        before, last_odometry = self._last
        step = self._motion(stamp, before, last_odometry, odom)
        has_odometry = (
            odom is not None and last_odometry is not None and not self._has_jumped(stamp, before, step, True)
        )
        if not has_odometry:
            dt = stamp - before if stamp - before <= UNKNOWN_S else 0.0
            step = Transform2D(*(dt * v for v in self._velocity))
        self._last = stamp, odom
        self._driven = self._driven @ step
        if has_odometry and self._errors.steps:
            step = Transform2D(*self._errors.corrected(np.array([step]))[0].tolist())
        self._moved = self._moved @ step
        p = self.params
        far = self._is_far(self._moved)
        since = self._matched.inverse() @ self._moved
        if (
            has_odometry
            and not self._is_lost
            and not far
            and math.hypot(since.x, since.y) < NEAR_M
            and abs(since.yaw) < NEAR_RAD
        ):
            self._passed(stamp)
            return MatchResult(stamp, self.pose or Pose2D(0.0, 0.0))
        surface = points_of(_expand(scan), mounting, p.max_laser_range)
        is_guess = not has_odometry or self._is_lost
        if self._is_lost and stamp - self._sought_at < min(SEEK_S, 0.1 * (stamp - self._known_at)):
            return self._lose(stamp, math.nan)
        if len(surface) < FEWEST_POINTS:
            if is_guess:
                self._lose(stamp, math.nan)
            else:
                self._passed(stamp)
            return self._rejected(stamp, f"fewer than {FEWEST_POINTS} points, so it cannot be matched")
        return self._match(stamp, scan, mounting, surface, is_guess)

    def finish(self) -> None:
        """Decide what is pending, and refine the poses.

        More scans may follow: the mapping then goes on as if it had not been finished.
        """
        self._go_on()
        self.unfinished = Unfinished(self.graph.poses.copy(), self.pending, len(self.loops))
        for loop in self.pending:
            self._decide(loop, False, "no second match confirmed it")
        self.pending = []
        if any(edge.is_loop for edge in self.graph.edges):
            solution = solve(self.graph, starts=("poses",), kernel_width=KERNEL_WIDTH, max_iterations=20)
            self._poses[: len(solution.poses)] = solution.poses
        final = self._refine() or self.graph
        self._judge(final)
        wrong = {(loop.place, loop.keyframe) for loop in self.loops if loop.withdrawn}
        if wrong:
            final = PoseGraph(self.graph.poses, [e for e in final.edges if not e.is_loop or (e.i, e.j) not in wrong])
            solution = solve(final, starts=("poses",), kernel_width=KERNEL_WIDTH, max_iterations=20)
            self._poses[: len(solution.poses)] = solution.poses
            self.final_graph = PoseGraph(self.graph.poses, final.edges)
            self._judge(self.final_graph)

    def _judge(self, final: PoseGraph) -> None:
        """Measure the accepted loops by the final graph; withdraw those that it contradicts.

        A loop that asked for a small correction was accepted where the graph was wrong in the same way.
        """
        chi2 = final.edge_chi2() if final.edges else np.empty(0)
        accepted = {(loop.place, loop.keyframe) for loop in self.loops if loop.accepted}
        pairs = zip(final.edges, chi2.tolist(), strict=True)
        by_nodes = {(e.i, e.j): math.sqrt(c) for e, c in pairs if (e.i, e.j) in accepted}
        for loop in self.loops:
            if loop.accepted:
                loop.residual = by_nodes.get((loop.place, loop.keyframe), math.nan)
                if loop.residual > MOST_STRAIN:
                    loop.withdrawn = f"the final graph is off by {loop.residual:.1f} standard deviations from it"

    def _go_on(self) -> None:
        """Undo what `finish` has changed."""
        if self.unfinished is None:
            return
        self._poses[: len(self.graph.poses)] = self.unfinished.poses
        self.pending = self.unfinished.pending
        del self.loops[self.unfinished.decided :]
        for loop in self.loops:
            loop.withdrawn = ""
        self.unfinished = self.final_graph = self.calibration = None

    def state(self) -> dict[str, Any]:
        """Return what else the mapper needs to go on, for JSON; `restore` takes it."""
        return {
            "last": None
            if self._last is None
            else [self._last[0], None if self._last[1] is None else list(self._last[1])],
            "moved": list(self._moved),
            "driven": list(self._driven),
            "matched": list(self._matched),
            "velocity": list(self._velocity),
            "known": [self._known_at, self._is_lost, self._sought_at],
            "odometry_errors": [*self._errors[:3], self._errors.steps],
            "intervals": list(self._intervals),
            "decided": None if self.unfinished is None else self.unfinished.decided,
            "waiting": [[self.loops.index(loop) for loop in group] for group in self._waiting],
            "tried_at": self._tried_at if math.isfinite(self._tried_at) else None,
            "travelled": self._travelled,
            "path": [self.travelled, self.followed, self._open_m],
            "reference": self._reference,
            "at": list(self._at),
            "recent": list(self._recent),
            "starts": self._starts,
            "lengths": self._links[2::3].tolist(),
            "middles": self._middles.tolist(),
        }

    def restore(
        self,
        poses: NDArray[np.float64],
        edges: list[Edge],
        state: dict[str, Any],
        unfinished: NDArray[np.float64] | None = None,
    ) -> None:
        """Take the poses (n, 3) of the keyframes, the edges, and what `state` returned.

        `unfinished`: the poses to go on from; None for a mapping that is not finished.
        """
        self._poses = np.concatenate((poses, np.empty((max(64, len(poses)), 3))))
        self.graph = PoseGraph(self._poses[: len(poses)], edges)
        last = state["last"]
        self._last = None if last is None else (last[0], None if last[1] is None else Transform2D(*last[1]))
        self._moved, self._driven = Transform2D(*state["moved"]), Transform2D(*state["driven"])
        self._matched, self._velocity = Transform2D(*state["matched"]), Transform2D(*state["velocity"])
        self._known_at, self._is_lost, self._sought_at = state["known"]
        scale, turn_scale, curve, count = state["odometry_errors"]
        self._errors = UNCALIBRATED._replace(scale=scale, turn_scale=turn_scale, curve=curve, steps=count)
        self._intervals.extend(state["intervals"])
        self._waiting = [[self.loops[n] for n in group] for group in state["waiting"]]
        self._tried_at = -math.inf if state["tried_at"] is None else state["tried_at"]
        self._travelled, self._middles = state["travelled"], array("d", np.ravel(state["middles"]).tolist())
        self.travelled, self.followed, self._open_m = state["path"]
        self._reference, self._at, self._starts = state["reference"], Transform2D(*state["at"]), state["starts"]
        self._recent.extend(state["recent"])
        self._links = array("d")
        for edge, length in zip(edges, state["lengths"], strict=True):
            self._links.extend((edge.i, edge.j, length))
        if unfinished is not None:
            self.unfinished = Unfinished(unfinished, self.pending, state["decided"])
            self.pending = []

    # --- parts --------------------------------------------------------------------------------------------------------

    def _defect(self, stamp: float, odometry: Transform2D | Pose2D | None, scan: LaserScan, sensor: Transform2D) -> str:
        if not math.isfinite(stamp):
            return "its time is not finite"
        if odometry is not None and not all(map(math.isfinite, odometry)):
            return "its odometry is not finite"
        if not all(map(math.isfinite, sensor)):
            return "the pose of its sensor is not finite"
        if math.hypot(sensor.x, sensor.y) > FARTHEST_SENSOR_M:
            return f"its sensor is more than {FARTHEST_SENSOR_M:.0f} m from the base"
        if not all(map(math.isfinite, (scan.angle_min, scan.angle_increment))):
            return "the angles of its beams are not finite"
        if self._last is not None and stamp <= self._last[0]:
            return "its time is not after that of the scan before"
        return ""

    def _rejected(self, stamp: float, reason: str) -> MatchResult:
        self.observations.rejected.setdefault(reason, []).append(stamp)
        return MatchResult(stamp, self.pose or Pose2D(0.0, 0.0), rejected=reason)

    def _motion(
        self, stamp: float, before: float, last: Transform2D | None, odometry: Transform2D | None
    ) -> Transform2D:
        """Return the motion by the odometry since the last scan; note gaps."""
        dt = stamp - before
        if len(self._intervals) >= 10 and dt > max(2.0, 10.0 * sorted(self._intervals)[len(self._intervals) // 2]):
            self.observations.gaps.append((before, stamp))
        else:
            self._intervals.append(dt)
        return Transform2D() if last is None or odometry is None else last.inverse() @ odometry

    def _has_jumped(self, stamp: float, before: float, step: Transform2D, note: bool) -> bool:
        dt = stamp - before
        far = math.hypot(step.x, step.y) > 1.0 + ODOMETRY_SPEED * min(dt, 2.0)
        jumped = far or abs(step.yaw) > 1.0 + ODOMETRY_TURN_RATE * min(dt, 2.0)
        if jumped and note:
            self.observations.jumps.append((stamp, step))
        return jumped

    def _match(
        self,
        stamp: float,
        scan: LaserScan,
        sensor: Transform2D,
        surface: NDArray[np.float64],
        is_guess: bool,
    ) -> MatchResult:
        """Match a scan with the last keyframes; make it a keyframe if the robot has moved.

        `is_guess`: the step was not by odometry. A scan that fits nothing is then not used.
        """
        p, last = self.params, self._reference
        start = self._keyframe_pose(last)
        predicted = start @ self._moved
        since = self._matched.inverse() @ self._moved
        moved, turned = math.hypot(since.x, since.y), abs(since.yaw)
        if is_guess:
            dt = stamp - self._known_at
            spread = 0.5 * dt * (dt + VELOCITY_S)
            sigma = 0.05 + ACCELERATION * spread, 0.05 + TURN_ACCELERATION * spread
        else:
            sigma = (
                0.03 + p.odometry_distance_error * moved + 0.02 * turned,
                0.02 + p.odometry_heading_error * turned + 0.03 * moved,
            )
        sigma = sigma[0] + min(FOLLOWED_DRIFT * self._open_m, MOST_FOLLOWED_DRIFT_M), sigma[1]
        is_unknown = is_guess and (self._is_lost or stamp - self._known_at > UNKNOWN_S)
        if is_unknown:
            self._sought_at = stamp
            match = self._recognized(Scene(surface, np.array([sensor.x, sensor.y]), predicted), start, sigma)
        else:
            match = self._best_match(surface, predicted, sigma, widely=is_guess)
        fits = match.response >= p.link_match_minimum_response_fine
        prior = _prior(predicted, sigma)
        if not fits and is_guess:
            return self._lose(stamp, match.response)
        if not fits:
            self.observations.unmatched.append((stamp, len(self.keyframes), match.response))
            match = match._replace(pose=np.array(predicted), hessian=prior)
        pose = Transform2D(float(match.pose[0]), float(match.pose[1]), normalize_angle(float(match.pose[2])))
        relative = start.inverse() @ pose
        correction = predicted.inverse() @ pose
        if is_unknown:
            self._note_lost(stamp, 0)
        if is_guess:
            self._velocity = Transform2D() if self._is_lost else self._velocity_to(stamp, pose)
        if not self._is_far(relative):
            self._moved = self._matched = relative
            self._passed(stamp)
            return MatchResult(stamp, Pose2D(*pose), None, match.response, correction)
        if fits and p.keyframes_per_place and self._follow(stamp, surface, pose, (predicted, prior)):
            return MatchResult(stamp, self.pose or Pose2D(*pose), None, match.response, correction)
        driven = relative if is_guess else self._driven
        if last != len(self.keyframes) - 1:
            self._starts.append(len(self.keyframes))
        away = self._open_m + math.hypot(relative.x, relative.y) + 0.3 * abs(relative.yaw)
        k = self._add_keyframe(stamp, scan, sensor, pose)
        self.graph.edges.append(Edge(last, k, relative, edge_information(match.hessian, pose.yaw, EDGE_FLOOR)))
        self._links.extend((last, k, away))
        self.steps.append(Step(k, last, stamp, driven, relative, sigma, match.response if fits else math.nan))
        decided = self._close_loops(k) if p.do_loop_closing else ()
        if len(self.steps) % CALIBRATION_INTERVAL == 0:
            self._calibrate()
        return MatchResult(stamp, self.pose or Pose2D(*pose), k, match.response, correction, decided)

    def _lose(self, stamp: float, response: float) -> MatchResult:
        """Do not use a scan, because nothing tells where the robot is."""
        self._note_lost(stamp, 1)
        self._is_lost, self._velocity = True, Transform2D()
        reason = "it fits nothing around the last known pose, and no odometry says where the robot is"
        return MatchResult(stamp, self.pose or Pose2D(0.0, 0.0), None, response, rejected=reason)

    def _note_lost(self, stamp: float, scans: int) -> None:
        """Note that nothing but the scan of this stamp tells where the robot is; `scans`: how many more are not used."""
        lost = self.observations.lost
        if not self._is_lost:
            *_, keyframe, x, y, yaw = self.track[-5:]
            lost.append(Lost(self._known_at, stamp, 0, int(keyframe), Transform2D(x, y, yaw)))
        elif scans:
            lost[-1] = lost[-1]._replace(until=stamp)
        lost[-1] = lost[-1]._replace(scans=lost[-1].scans + scans)

    def _velocity_to(self, stamp: float, pose: Transform2D) -> Transform2D:
        """Return the velocity (per second) with which a pose was reached, over `VELOCITY_S` or since the last scan."""
        for n in range(len(self.track) - 5, -1, -5):
            before, keyframe, *seen = self.track[n : n + 5]
            if stamp - before >= VELOCITY_S or n == 0 or stamp - self.track[n - 5] > 2.0 * VELOCITY_S:
                made = (self._keyframe_pose(int(keyframe)) @ Transform2D(*seen)).inverse() @ pose
                return Transform2D(*(v / max(stamp - before, 1e-3) for v in made))
        return Transform2D()

    def _best_match(
        self, surface: NDArray[np.float64], predicted: Transform2D, sigma: tuple[float, float], *, widely: bool
    ) -> Match:
        """Return the match near the prediction; where nothing fits there, the best of a wider search if it fits better.

        `widely`: there was no odometry. After a step of the odometry the wider search is narrow enough for a slip: a scan that
        sees mostly new things fits badly where it belongs, and somewhere else by chance.
        """
        p = self.params
        if self._local is None:
            self._local = self._surfaces(self._recent)
        half_m = min(max(0.5 * p.correlation_search_space_dimension, 3.0 * sigma[0]), 1.5)
        half_rad = min(max(0.1, 3.0 * sigma[1]), 0.8)
        found, _ = self._local.search(surface, predicted, half_m=half_m, half_rad=half_rad, sigma=sigma)
        prior = _prior(predicted, sigma)
        match = self._local.align(surface, found, (predicted, prior))
        if match.response < 0.5:
            half, gain = ((min(4.0 * sigma[0], 2.0), min(4.0 * sigma[1], 1.2)), 0.15) if widely else ((0.4, 0.5), 0.2)
            found, _ = self._local.search(surface, predicted, half_m=half[0], half_rad=half[1], sigma=half)
            wide = self._local.align(surface, found)
            if wide.response > match.response + gain:
                return wide
        return match

    def _recognized(self, scene: Scene, start: Transform2D, sigma: tuple[float, float]) -> Match:
        """Return the match of a scan whose place is unknown with the last keyframes; its response is 0 if there is a doubt."""
        if self._local is None:
            self._local = self._surfaces(self._recent)
        drift = min(4.0 * sigma[0], 0.5 * self.params.loop_search_space_dimension), min(4.0 * sigma[1], math.pi)
        chain = [self._scene(k) for k in self._recent]
        _, pose, _, why_not = compare(scene, chain, start, drift, self.params)
        match = self._local.align(scene.surface, pose)
        return match._replace(response=0.0) if why_not else match

    def _add_keyframe(self, stamp: float, scan: LaserScan, sensor: Transform2D, pose: Transform2D) -> int:
        k = self.keyframes.add(scan, sensor)
        self.keyframes.stamps[k] = stamp
        if k == len(self._poses):
            self._poses = np.concatenate((self._poses, np.empty_like(self._poses)))
        self._poses[k] = pose
        self.graph.poses = self._poses[: k + 1]
        surface = self.keyframes.surface(k, self.params.max_laser_range)
        self._middles.extend((float(surface[:, 0].mean()), float(surface[:, 1].mean())))
        self.travelled += 0.0 if k == 0 else self._distance(pose)
        self._travelled.append(self.travelled)
        self._reference, self._open_m = k, 0.0
        self._recent.append(k)
        self._moved = self._matched = self._driven = self._at = Transform2D()
        self._local = None
        self._passed(stamp)
        return k

    def _is_far(self, moved: Transform2D) -> bool:
        """Return whether a pose seen from the reference is far enough from the last one to look at the place."""
        p, at = self.params, self._at
        far = math.hypot(moved.x - at.x, moved.y - at.y) >= p.minimum_travel_distance
        return far or abs(math.remainder(moved.yaw - at.yaw, math.tau)) >= p.minimum_travel_heading

    def _distance(self, pose: Transform2D) -> float:
        """Return the distance of a pose from the one at which the place was last looked at (m)."""
        at = self._keyframe_pose(self._reference) @ self._at
        return math.hypot(pose.x - at.x, pose.y - at.y)

    def _surfaces(self, keyframes: Iterable[int]) -> Surfaces:
        """Return the surfaces that keyframes have seen."""
        reach = self.params.max_laser_range
        return Surfaces([(self.keyframes.surface(k, reach), self._keyframe_pose(k)) for k in keyframes])

    # --- known places -------------------------------------------------------------------------------------------------

    def _follow(
        self,
        stamp: float,
        surface: NDArray[np.float64],
        pose: Transform2D,
        prior: tuple[Transform2D, NDArray[np.float64]],
    ) -> bool:
        """Localize a scan against the keyframes of a place that has enough of them; return whether they explain it.

        The number of keyframes then depends on the area, not on the time: after Kretzschmar and Stachniss
        (Information-theoretic compression of pose graphs for laser-based SLAM, IJRR 2012), scans are kept while they tell
        something new; here a scan tells nothing new if enough others of the same place and heading explain it. The newest
        of them count, so that a place that has changed gets keyframes once.
        """
        known = self._place(pose)
        if not known:
            return False
        surfaces = self._surfaces(known)
        match = surfaces.align(surface, pose, prior)
        found = Transform2D(float(match.pose[0]), float(match.pose[1]), normalize_angle(float(match.pose[2])))
        off = math.hypot(found.x - pose.x, found.y - pose.y)
        if match.response < self.params.loop_match_minimum_response_fine or off > PLACE_M:
            return False
        moved = self._distance(found)
        self.travelled, self.followed = self.travelled + moved, self.followed + moved
        least, most = position_information(match.hessian - prior[1])
        is_open = least < max(LEAST_INFORMATION, LEAST_SHARE * most)
        self._open_m = self._open_m + moved if is_open else 0.0
        places = self._poses[known]
        self._reference = known[int(np.argmin(np.hypot(places[:, 0] - found.x, places[:, 1] - found.y)))]
        relative = self._keyframe_pose(self._reference).inverse() @ found
        self._moved = self._matched = self._driven = self._at = relative
        self._recent.clear()
        self._recent.extend(known)
        self._local = surfaces
        self._passed(stamp)
        return True

    def _place(self, pose: Transform2D) -> list[int]:
        """Return the newest keyframes at the place of a pose; none if they are fewer than `keyframes_per_place`.

        Only those count that a short path in the graph connects with the reference: the others may be off by the drift.
        """
        p, poses = self.params, self.graph.poses
        turned = np.abs(normalize_angles(poses[:, 2] - pose.yaw))
        near = np.flatnonzero((np.hypot(poses[:, 0] - pose.x, poses[:, 1] - pose.y) < PLACE_M) & (turned < PLACE_RAD))
        if len(near) < p.keyframes_per_place:
            return []
        path = self._paths(self._reference, 2.0 * p.loop_minimum_path)
        known = near[np.isfinite(path[near])].tolist()
        return known[-p.scan_buffer_size :] if len(known) >= p.keyframes_per_place else []

    def _passed(self, stamp: float) -> None:
        """Keep the place of a scan: its stamp, the last keyframe, and the step from there."""
        self._known_at, self._is_lost = stamp, False
        self.track.extend((stamp, self._reference, *self._moved))

    def _keyframe_pose(self, k: int) -> Transform2D:
        return Transform2D(*self._poses[k].tolist())

    # --- loops --------------------------------------------------------------------------------------------------------

    def _close_loops(self, k: int) -> tuple[Loop, ...]:
        """Compare a keyframe with the places near it; return the loops that are decided with it."""
        decided: list[Loop] = []
        for loop in [each for each in self.pending if self.travelled - self._travelled[each.keyframe] > 10.0]:
            self.pending.remove(loop)
            decided.append(self._decide(loop, False, "no second match confirmed it"))
        for place, path, drift in self._places(k):
            loop, why_not = self._compare(k, place, path, drift)
            if why_not:
                decided.append(self._decide(loop, False, why_not))
                continue
            partners = [
                each
                for each in self.pending
                if agree(each, loop, self.graph.poses, self.travelled - self._travelled[each.keyframe])
            ]
            self.pending.append(loop)
            if partners:
                self._accept([*partners, loop])
                decided += [*partners, loop]
                break
        return tuple(decided)

    def _places(self, k: int) -> list[tuple[int, float, tuple[float, float]]]:
        """Return the nearest keyframe of each place to compare, its distance in the graph (m), and the drift to expect.

        Near are scans whose points are near each other, on average: a narrow scan sees a place that is ahead of the robot.
        """
        p = self.params
        end = k - p.scan_buffer_size
        if end < 1 or self.travelled - self._tried_at < 0.5:
            return []
        poses, middles = self.graph.poses, np.array(self._middles).reshape(-1, 2)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * middles[:, 0] - s * middles[:, 1]
        y = poses[:, 1] + s * middles[:, 0] + c * middles[:, 1]
        away = np.hypot(x[:end] - x[k], y[:end] - y[k])
        widest = 0.5 * p.loop_search_space_dimension
        if not (away < p.loop_search_maximum_distance + widest).any():
            return []
        self._tried_at = self.travelled
        # from this path on, the drift may be as large as the search is wide
        limit = max((widest - DRIFT_M) / DRIFT_PER_M, p.loop_minimum_path)
        path = np.minimum(self._paths(k, limit)[:end], limit)
        drift = np.minimum(DRIFT_M + DRIFT_PER_M * path, widest)
        near = np.flatnonzero((away < p.loop_search_maximum_distance + drift) & (path >= p.loop_minimum_path))
        if not len(near):
            return []
        chains = [chain for chain in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(chain) >= 1]
        nearest = [int(chain[np.argmin(away[chain])]) for chain in chains]
        nearest.sort(key=lambda j: (away[j], j))
        return [(j, float(path[j]), (float(drift[j]), min(0.15 + 0.004 * float(path[j]), 0.5))) for j in nearest[:2]]

    def _paths(self, k: int, limit: float) -> NDArray[np.float64]:
        """Return the length of the shortest way in the graph from each keyframe to `k` (m); infinite beyond the limit."""
        from scipy.sparse import coo_matrix  # slow import
        from scipy.sparse.csgraph import dijkstra

        n = len(self.keyframes)
        table = np.array(self._links).reshape(-1, 3)
        i, j = table[:, :2].astype(np.int64).T
        links = coo_matrix((table[:, 2] + 1e-3, (i, j)), (n, n)).tocsr()
        return np.asarray(dijkstra(links, directed=False, indices=k, limit=limit))

    def _scene(self, k: int) -> Scene:
        return Scene(
            self.keyframes.surface(k, self.params.max_laser_range), self.keyframes.eye(k), self._keyframe_pose(k)
        )

    def _compare(self, k: int, place: int, path: float, drift: tuple[float, float]) -> tuple[Loop, str]:
        together = self._seen_together(k)
        size = max(self.params.loop_match_minimum_chain_size, 2 * together)
        first = max(0, place - size // 2)
        chain = range(first, min(first + size, k - self.params.scan_buffer_size))
        scene, at = self._scene(k), self._keyframe_pose(place)
        if together > 1:
            begin = self._starts[bisect.bisect(self._starts, k) - 1] if self._starts and self._starts[0] <= k else 0
            others = [self._scene(j) for j in range(max(chain[-1] + 1, k - together + 1, begin), k)]
            seen = [_moved(each.surface, scene.pose.inverse() @ each.pose) for each in others]
            scene = scene._replace(surface=np.concatenate([*seen, scene.surface]), scans=len(seen) + 1)
        figures, pose, information, why_not = compare(scene, [self._scene(j) for j in chain], at, drift, self.params)
        x, y, yaw = scene.pose.inverse() @ pose
        stamps = self.keyframes.stamps
        loop = Loop(
            k,
            place,
            stamps[k],
            stamps[place],
            path,
            figures["coarse"],
            figures["runner_up"],
            figures["response"],
            figures["contradiction"],
            figures["rms"],
            correction=(x, y, yaw),
            measured=at.inverse() @ pose,
            information=information,
        )
        return loop, why_not

    def _seen_together(self, k: int) -> int:
        """Return how many of the last keyframes to compare with a place together: a narrow scan alone looks like many places."""
        _, step, *_ = self.keyframes.known_setups[self.keyframes.setups[k]]
        angle = abs(step) * len(self.keyframes.ranges[k])
        return 1 if angle > WIDE_RAD else min(2 * math.ceil(math.pi / max(angle, 0.1)), self.params.scan_buffer_size)

    def _decide(self, loop: Loop, accepted: bool, reason: str) -> Loop:
        loop.in_graph, loop.decision = accepted, reason
        self.loops.append(loop)
        return loop

    def _accept(self, loops: list[Loop]) -> None:
        """Add loops that confirm each other to the graph, unless the way between them then contradicts its matches."""
        numbers = [loop.keyframe for loop in loops]
        for loop in loops:
            self.pending.remove(loop)
            confirmed_by = next(n for n in reversed(numbers) if n != loop.keyframe)
            self._decide(loop, True, f"confirmed by keyframe {confirmed_by}")
        self._add(loops)
        self._waiting.append(loops)
        large = any(math.hypot(x, y) > 0.05 or abs(yaw) > 0.01 for x, y, yaw in (loop.correction for loop in loops))
        # of a long mapping, more wait: each solution takes time by the size of the graph
        if large or sum(map(len, self._waiting)) > max(20, len(self.keyframes) // 50):
            self._solve_waiting()

    def _solve_waiting(self) -> None:
        """Solve the graph with the loops that wait; reject those that contradict the matches along the way."""
        groups, self._waiting = self._waiting, []
        worst = self._solve()
        if worst <= MOST_STRAIN:
            return
        if len(groups) > 1:
            # one that waited may be the wrong one: all again, one after the other
            self._remove([loop for group in groups for loop in group])
        for group in groups:
            if len(groups) > 1:
                self._add(group)
                worst = self._solve()
            if worst > MOST_STRAIN:
                self._remove(group)
                for loop in group:
                    loop.in_graph = False
                    loop.decision = f"a match along the way would be off by {worst:.1f} standard deviations"

    def _add(self, loops: list[Loop]) -> None:
        for loop in loops:
            self.graph.edges.append(Edge(loop.place, loop.keyframe, loop.measured, loop.information, True))
            self._links.extend((loop.place, loop.keyframe, math.hypot(loop.measured.x, loop.measured.y)))

    def _remove(self, loops: list[Loop]) -> None:
        wrong = {(loop.place, loop.keyframe) for loop in loops}
        keep = [not edge.is_loop or (edge.i, edge.j) not in wrong for edge in self.graph.edges]
        self.graph.edges[:] = itertools.compress(self.graph.edges, keep)
        self._links = array("d", np.array(self._links).reshape(-1, 3)[keep].tobytes())

    def _calibrate(self) -> None:
        """Compare the odometry with the newest keyframes."""
        steps = self.steps[-CALIBRATION_STEPS:]
        known = np.array(
            [
                each.before == each.keyframe - 1 and each.odometry != each.matched and math.isfinite(each.response)
                for each in steps
            ]
        )
        self._errors = calibrate(
            np.array([each.odometry for each in steps]), self.graph.poses[-len(steps) - 1 :], known
        )

    def _refine(self) -> PoseGraph | None:
        """Match every keyframe with all places near it; see `refine`."""
        passes, reach = self.params.refinement_passes, self.params.max_laser_range
        if passes == 0 or len(self.keyframes) < 3:
            return None
        found = refine(
            self.graph.poses.copy(),
            lambda k: self.keyframes.surface(k, reach),
            np.array([step.odometry for step in self.steps]),
            np.array([step.matched for step in self.steps]),
            [edge._replace(is_loop=True) for edge in self.graph.edges if edge.is_loop or edge.i != edge.j - 1],
            passes,
            self._starts,
        )
        self._poses[: len(found.poses)] = found.poses
        self.calibration = found.calibration
        self.final_graph = PoseGraph(self.graph.poses, found.edges)
        return self.final_graph

    def _solve(self) -> float:
        """Solve the graph; return the largest error of a match between keyframes that it has made larger (sigma).

        The poses stay if that is too much.
        """
        before = np.sqrt(np.maximum(self.graph.edge_chi2(), 0.0))
        solution = solve(
            self.graph, starts=("poses",), kernel_width=KERNEL_WIDTH, max_iterations=20, least_step=SOLVED_STEP
        )
        after = np.sqrt(np.maximum(solution.edge_chi2, 0.0))
        matches = np.array([not edge.is_loop for edge in self.graph.edges])
        worst = float(after[matches & (after > before + LEAST_STRAIN)].max(initial=0.0))
        if worst <= MOST_STRAIN:
            self._poses[: len(solution.poses)] = solution.poses
            self._local = None
        return worst


def _expand(scan: LaserScan) -> LaserScan:
    """Return the scan as the store keeps it, so that the points of a match are those of the keyframe."""
    return LaserScan(
        _expanded(compact_ranges(scan)),
        scan.angle_min,
        scan.angle_increment,
        scan.range_min,
        scan.range_max,
        scan.stamp,
    )


def _moved(surface: NDArray[np.float64], pose: Transform2D) -> NDArray[np.float64]:
    """Return points with normals (n, 4) of a frame at `pose`, in the frame that this pose is in."""
    turned = Transform2D(0.0, 0.0, pose.yaw).apply_points(np.ascontiguousarray(surface[:, 2:]))
    return np.column_stack((pose.apply_points(np.ascontiguousarray(surface[:, :2])), turned))


def _prior(pose: Transform2D, sigma: tuple[float, float]) -> NDArray[np.float64]:
    """Return the information (3, 3) of a prediction."""
    return np.diag([1.0 / sigma[0] ** 2, 1.0 / sigma[0] ** 2, 1.0 / sigma[1] ** 2])
