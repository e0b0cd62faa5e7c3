"""How well a localizer follows a log: its track, its starts without a pose, and its errors by known relations.

The scans come as `LoggedScan`; `navstack.logs` reads them from files.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    InputError,
    Interval,
    LaserScan,
    LogError,
    Pose2D,
    Transform2D,
    angle_between,
    normalize_angles,
    share,
)
from navstack.localization.metrics import (
    PoseErrors,
    Poses,
    absolute_errors,
    pairs_by_distance,
    relation_errors,
    relative_errors,
)
from navstack.localization.searching import is_sure
from navstack.plugins import Localizer


@dataclass(frozen=True, slots=True, eq=False)
class LoggedScan:
    """A scan of a log with the odometry and, if there is one, the reference pose at its stamp."""

    index: int
    """Number of the scan in the log, from 0."""
    scan: LaserScan
    sensor: Transform2D
    """Pose of the sensor in the base frame."""
    odometry: Transform2D
    """Pose of the base in the odometry frame, which never jumps."""
    reference: Pose2D | None
    """Pose of the base in the map, as recorded by the author of the log."""


MAX_SNAPSHOTS: Final = 400
"""Most clouds of particles that a track keeps; of a longer log every second one, and so on."""

Cloud = Callable[[], NDArray[np.float64]]
"""Returns the possible poses (n, 3) of a localizer in the map: particles or hypotheses."""


@dataclass(slots=True, eq=False)
class Track:
    """The estimates of a localizer over a log, one row per scan."""

    indices: NDArray[np.int64]
    """(n,) numbers of the scans in the log."""
    stamps: NDArray[np.float64]
    """(n,) s."""
    poses: NDArray[np.float64]
    """(n, 3) estimated x, y, yaw in the map; NaN before the first estimate."""
    references: NDArray[np.float64]
    """(n, 3) reference poses; NaN where there is none."""
    particles: NDArray[np.int64]
    """(n,) number of particles or hypotheses."""
    lost: NDArray[np.bool_]
    """(n,) whether the localizer said that it does not know where it is."""
    sure: NDArray[np.bool_]
    """(n,) whether it was sure of its pose: not lost, and not in doubt after scans that contradict it."""
    explained: NDArray[np.float64]
    """(n,) share of the scan that the estimate explains; NaN if the localizer does not say."""
    clouds: dict[int, NDArray[np.float64]] = field(default_factory=dict[int, NDArray[np.float64]])
    """Possible poses (k, 3) at some rows."""
    ms_per_scan: float = math.nan
    """Processor time."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) rows with an estimate and a reference."""
        return np.asarray(np.isfinite(self.poses).all(axis=1) & np.isfinite(self.references).all(axis=1))

    @property
    def errors(self) -> NDArray[np.float64]:
        """(n,) distance between estimate and reference (m); NaN without one of them."""
        return np.hypot(self.poses[:, 0] - self.references[:, 0], self.poses[:, 1] - self.references[:, 1])

    @property
    def in_doubt(self) -> NDArray[np.bool_]:
        """(n,) rows at which the localizer was not sure of its pose, although it was not lost."""
        return ~self.lost & ~self.sure

    def absolute(self) -> PoseErrors:
        """Return the absolute trajectory error of the rows with a reference, without alignment."""
        return absolute_errors(self.poses[self.known], self.references[self.known])

    def relations(self) -> PoseErrors:
        """Return the errors of the relations between consecutive rows with a reference."""
        count = int(self.known.sum())
        first = np.arange(max(count - 1, 0))
        return relative_errors(self.poses[self.known], self.references[self.known], first, first + 1)

    def relative(self, meters: float) -> PoseErrors:
        """Return the relative pose error over `meters` of the reference's path."""
        pairs = pairs_by_distance(self.references[self.known], meters)
        return relative_errors(self.poses[self.known], self.references[self.known], *pairs)

    def summary(self) -> dict[str, Any]:
        """Return the results for JSON: counts, and errors where there is a reference."""
        estimated = np.isfinite(self.poses).all(axis=1)
        document: dict[str, Any] = {
            "scans": len(self.indices),
            "with_estimate": int(estimated.sum()),
            "lost": int(self.lost.sum()),
            "in_doubt": int(self.in_doubt.sum()),
            "particles_median": float(np.median(self.particles)) if len(self.particles) else None,
            "particles_max": int(self.particles.max()) if len(self.particles) else None,
            "ms_per_scan": self.ms_per_scan,
        }
        if self.known.sum() > 1:
            document |= {
                "ate": self.absolute().as_dict(),
                "relations": self.relations().as_dict(),
                "rpe_10m": self.relative(10.0).as_dict(),
            }
            document["sure_but_wrong"] = self.sure_but_wrong
        return document

    @property
    def sure_but_wrong(self) -> int:
        """Number of scans at which the localizer was sure although it was more than 0.5 m off."""
        return int((self.known & self.sure & (self.errors > 0.5)).sum())


def follow(
    frames: Iterable[LoggedScan],
    localizer: Localizer,
    *,
    initial_pose: Pose2D | None = None,
    globally: bool = False,
    cloud: Cloud | None = None,
) -> Track:
    """Run `localizer`, which has a map, over the scans of a log.

    It starts at `initial_pose`, by default the reference of the first scan; with `globally`, without a pose. The estimate of a
    scan that did not count is the last one moved by the odometry. Raises LogError if there is no scan, or no pose to start from.
    """
    rows: list[tuple[int, float, tuple[float, ...], tuple[float, ...], int, bool, bool, float]] = []
    clouds: dict[int, NDArray[np.float64]] = {}
    every, spent = 1, 0.0
    for n, frame in enumerate(frames):
        if n == 0:
            _start(localizer, frame, initial_pose, globally)
        began = time.process_time()
        localizer.update(frame.odometry, frame.scan, frame.sensor)
        spent += time.process_time() - began
        latest = localizer.estimate
        details = {} if latest is None else latest.details
        pose = (math.nan,) * 3 if latest is None else tuple(latest.map_to_odom @ frame.odometry)
        reference = (math.nan,) * 3 if frame.reference is None else tuple(frame.reference)
        if cloud is not None and n % every == 0:
            clouds[n] = cloud().astype(np.float64)
            if len(clouds) > MAX_SNAPSHOTS:
                every *= 2
                clouds = {row: poses for row, poses in clouds.items() if row % every == 0}
        count = details.get("particles", details.get("hypotheses", 0))
        sure = latest is not None and is_sure(latest)
        lost = not sure and bool(details.get("lost", True))
        explained = details.get("explained", math.nan)
        rows.append((frame.index, frame.scan.stamp, pose, reference, int(count), lost, sure, explained))
    if not rows:
        raise LogError("the log has no scan with odometry before it, so there is nothing to localize")
    index, stamp, poses, references, count, lost, sure, shares = zip(*rows, strict=True)
    return Track(
        np.array(index, np.int64),
        np.array(stamp, np.float64),
        np.array(poses, np.float64),
        np.array(references, np.float64),
        np.array(count, np.int64),
        np.array(lost, np.bool_),
        np.array(sure, np.bool_),
        np.array(shares, np.float64),
        clouds,
        1e3 * spent / len(rows),
    )


def _start(localizer: Localizer, frame: LoggedScan, initial_pose: Pose2D | None, globally: bool) -> None:
    if globally:
        localizer.start_globally()
        return
    pose = frame.reference if initial_pose is None else initial_pose
    if pose is None:
        raise LogError(
            "the log has no reference pose to start from; give --initial-pose x,y,yaw, or --global to find the pose by a search"
        )
    localizer.set_pose(pose, np.diag([0.05**2, 0.05**2, 0.03**2]), math.inf)


# --- global starts along a log: from how many places a localizer finds the pose, how soon, how often it is wrong ------


LEAST_SCANS: Final = 20
"""A start has at least this many scans to find the pose,"""
LEAST_S: Final = 30.0
"""and at least this time (s)."""
WRONG_M: Final = 0.5
"""A pose farther off (m) is wrong,"""
WRONG_RAD: Final = 0.35
"""and one turned by more than this (rad)."""

Frames = Callable[[], Iterable[LoggedScan]]
"""Returns the scans of a log from its beginning."""


class StartResult(NamedTuple):
    """What came of one start."""

    scan: int
    """Number of its first scan in the log."""
    pose: tuple[float, float, float]
    """True pose at the start."""
    scans: int
    """Scans until the pose was found; of a start that failed: those it had."""
    seconds: float
    meters: float
    found: bool
    """A pose near the true one was certain."""
    wrong: int
    """Scans at which a wrong pose was certain."""
    error: float
    """Distance to the true pose when it was found (m), NaN if it was not; or of the last wrong pose that was certain."""

    @property
    def outcome(self) -> str:
        """`found`, `uncertain`, or `wrong` if a wrong pose was certain at any time."""
        return "wrong" if self.wrong else "found" if self.found else "uncertain"


@dataclass(frozen=True, slots=True)
class Starts:
    """The results of all starts."""

    results: tuple[StartResult, ...]
    path: NDArray[np.float64]
    """(n, 3) reference poses of all scans; NaN where there is none."""

    def of(self, outcome: str) -> list[StartResult]:
        """Return the starts with this outcome."""
        return [result for result in self.results if result.outcome == outcome]

    def rate(self) -> Interval:
        """Return the share of starts that found the pose and were never wrong, with its interval."""
        return share([result.outcome == "found" for result in self.results])

    def table(self) -> NDArray[np.float64]:
        """Return (n, 3) scans, seconds and meters until the pose was found."""
        rows = [(r.scans, r.seconds, r.meters) for r in self.results if r.found]
        return np.array(rows, np.float64).reshape(-1, 3)

    def summary(self) -> dict[str, Any]:
        """Return the results for JSON."""
        table, rate = self.table(), self.rate()
        names = ("scans", "seconds", "meters")
        document: dict[str, Any] = {
            "starts": len(self.results),
            **{outcome: len(self.of(outcome)) for outcome in ("found", "uncertain", "wrong")},
            "rate": rate.value,
            "rate_low": rate.low,
            "rate_high": rate.high,
        }
        if len(table):
            document["median"] = dict(zip(names, np.median(table, axis=0).tolist(), strict=True))
            document["p95"] = dict(zip(names, np.quantile(table, 0.95, axis=0).tolist(), strict=True))
            errors = np.array([r.error for r in self.results if r.outcome == "found"])
            document["error_median_m"] = float(np.median(errors)) if len(errors) else None
        document["results"] = [{**r._asdict(), "outcome": r.outcome} for r in self.results]
        return document


def run_starts(
    frames: Frames,
    make: Callable[[int], Localizer],
    count: int,
    progress: Callable[[int, int], None] | None = None,
) -> Starts:
    """Start `count` times without a pose, at scans spread evenly over the log.

    `make` returns a localizer with a map for a start's number. A start ends after LEAST_SCANS scans and LEAST_S seconds, or with
    the log. Raises LogError for a log without a reference, InputError for more starts than scans.
    """
    path = np.array([(math.nan,) * 3 if f.reference is None else tuple(f.reference) for f in frames()]).reshape(-1, 3)
    if not np.isfinite(path).any():
        raise LogError(
            "the log has no reference poses, with which the poses that were found could be compared; see --reference"
        )
    usable = len(path) - LEAST_SCANS
    if not 1 <= count <= max(usable, 0):
        raise InputError(
            f"{count} starts: the log has {len(path)} scans and a start needs {LEAST_SCANS}, so at most {max(usable, 0)}",
            argument="--starts",
            value=count,
        )
    rows = np.unique(np.round(np.linspace(0, usable, count + 1)[:-1]).astype(int)).tolist()
    waiting = {row: number for number, row in enumerate(rows)}
    running: list[_Start] = []
    done: dict[int, StartResult] = {}
    for row, frame in enumerate(frames()):
        if row in waiting:
            running.append(_Start(waiting[row], frame, make(waiting[row])))
        for start in running:
            start.take(frame)
            if start.is_over:
                done[start.number] = start.result()
                if progress is not None:
                    progress(len(done), len(rows))
        running = [start for start in running if not start.is_over]
    done |= {start.number: start.result() for start in running}
    return Starts(tuple(done[number] for number in sorted(done)), path)


class _Start:
    """One start on its way."""

    def __init__(self, number: int, frame: LoggedScan, localizer: Localizer) -> None:
        self.number = number
        self._first = self._last = frame
        self._localizer = localizer
        localizer.start_globally()
        self._scans = 0
        self._meters = 0.0
        self._found: tuple[int, float, float, float] | None = None
        self._wrong, self._wrong_error = 0, math.nan

    @property
    def is_over(self) -> bool:
        return self._scans >= LEAST_SCANS and self._last.scan.stamp - self._first.scan.stamp >= LEAST_S

    def take(self, frame: LoggedScan) -> None:
        """Process a scan."""
        self._scans += 1
        step = self._last.odometry.inverse() @ frame.odometry
        self._meters += math.hypot(step.x, step.y)
        self._last = frame
        self._localizer.update(frame.odometry, frame.scan, frame.sensor)
        estimate = self._localizer.estimate
        if estimate is None or frame.reference is None or not is_sure(estimate):
            return
        pose = estimate.map_to_odom @ frame.odometry
        error = math.hypot(pose.x - frame.reference.x, pose.y - frame.reference.y)
        turned = abs(angle_between(frame.reference.yaw, pose.yaw))
        if error > WRONG_M or turned > WRONG_RAD:
            self._wrong, self._wrong_error = self._wrong + 1, error
        elif self._found is None:
            self._found = (self._scans, frame.scan.stamp - self._first.scan.stamp, self._meters, error)

    def result(self) -> StartResult:
        """Return what has come of it."""
        duration = self._last.scan.stamp - self._first.scan.stamp
        scans, seconds, meters, error = self._found or (self._scans, duration, self._meters, math.nan)
        reference = self._first.reference
        nan = math.nan
        pose = (nan, nan, nan) if reference is None else (reference.x, reference.y, reference.yaw)
        if self._wrong:
            error = self._wrong_error
        return StartResult(self._first.index, pose, scans, seconds, meters, self._found is not None, self._wrong, error)


# --- hand-checked relations between poses of a log, and the errors of a trajectory by them ----------------------------
# Format and measure: Kümmerle et al. (On measuring the accuracy of SLAM algorithms, Autonomous Robots 27, 2009). A line has
# `stamp1 stamp2 x y z roll pitch yaw`: the pose of the robot at `stamp2` as seen from its pose at `stamp1` (s, m, rad).


EXACT_S: Final = 5e-4
"""A pose this near to the stamp of a relation (s) is taken as it is."""


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Relative poses (n, 3) between the times `first` and `second` (n,), in seconds of the log's own clock."""

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    poses: Poses


@dataclass(frozen=True, slots=True)
class RelationResult:
    """The errors of a trajectory by a file of relations."""

    errors: PoseErrors
    square_m2: tuple[float, float]
    """Mean and standard deviation of the squares of the errors of position (m²)."""
    square_rad2: tuple[float, float]
    """The same of the heading (rad²)."""
    interpolated: int
    """Relations of which at least one pose was interpolated between two estimates."""
    outside: int
    """Relations outside the times of the trajectory, which do not count."""

    def as_dict(self) -> dict[str, Any]:
        """Return the values by name."""
        return {
            **self.errors.as_dict(),
            "square_m2": {"mean": self.square_m2[0], "std": self.square_m2[1]},
            "square_rad2": {"mean": self.square_rad2[0], "std": self.square_rad2[1]},
            "interpolated": self.interpolated,
            "outside": self.outside,
        }


def errors_by_relations(relations: Relations, stamps: NDArray[np.float64], poses: Poses) -> RelationResult:
    """Return the errors of a trajectory, poses (n, 3) at increasing stamps (n,) in the time of the relations (s).

    Between two poses, the trajectory is interpolated linearly. Raises LogError if it covers no relation.
    """
    known = np.isfinite(poses).all(axis=1)
    stamps, poses = stamps[known], poses[known]
    inside = np.zeros(len(relations.first), np.bool_)
    if len(stamps):
        first, last = stamps[0] - EXACT_S, stamps[-1] + EXACT_S
        inside = (np.minimum(relations.first, relations.second) >= first) & (
            np.maximum(relations.first, relations.second) <= last
        )
    if not inside.any():
        covered = f"{stamps[0]:.3f} .. {stamps[-1]:.3f} s" if len(stamps) else "nothing"
        low, high = float(relations.first.min()), float(relations.second.max())
        raise LogError(
            f"no relation lies within the trajectory: the relations have the times {low:.3f} .. {high:.3f} s, the trajectory "
            f"covers {covered}; the file belongs to another log, or the log has lost its times"
        )
    a, exact_a = poses_at(relations.first[inside], stamps, poses)
    b, exact_b = poses_at(relations.second[inside], stamps, poses)
    errors, moved, turned = relation_errors(a, b, relations.poses[inside])
    return RelationResult(
        errors,
        _mean_and_std(moved**2),
        _mean_and_std(turned**2),
        int((~(exact_a & exact_b)).sum()),
        int((~inside).sum()),
    )


def poses_at(times: NDArray[np.float64], stamps: NDArray[np.float64], poses: Poses) -> tuple[Poses, NDArray[np.bool_]]:
    """Return the poses (m, 3) at `times` (m,), and whether the trajectory has a pose at each of them."""
    columns = [np.interp(times, stamps, poses[:, 0]), np.interp(times, stamps, poses[:, 1])]
    yaw = np.interp(times, stamps, np.unwrap(poses[:, 2]))
    after = np.clip(np.searchsorted(stamps, times), 0, len(stamps) - 1)
    near = np.minimum(np.abs(times - stamps[np.maximum(after - 1, 0)]), np.abs(times - stamps[after]))
    return np.column_stack((*columns, normalize_angles(yaw))), near <= EXACT_S


def _mean_and_std(values: NDArray[np.float64]) -> tuple[float, float]:
    return float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else 0.0
