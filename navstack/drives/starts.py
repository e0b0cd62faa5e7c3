"""Global starts along a drive: from how many places a localizer finds the pose, how soon, and how often it is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import angle_between
from navstack.core.errors import InputError, LogError
from navstack.drives.follow import is_sure
from navstack.drives.messages import DriveFrame
from navstack.interfaces import Localizer
from navstack.statistics import Interval, share

LEAST_SCANS: Final = 20
"""A start has at least this many scans to find the pose,"""
LEAST_S: Final = 30.0
"""and at least this time (s)."""
WRONG_M: Final = 0.5
"""A pose farther off (m) is wrong,"""
WRONG_RAD: Final = 0.35
"""and one turned by more than this (rad)."""

Frames = Callable[[], Iterable[DriveFrame]]
"""Returns the scans of a drive from its beginning."""


class StartResult(NamedTuple):
    """What came of one start."""

    scan: int
    """Number of its first scan in the drive."""
    pose: tuple[float, float, float]
    """True pose at the start."""
    scans: int
    """Scans until the pose was found; of a start that failed: those it had."""
    seconds: float
    metres: float
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
        """Return (n, 3) scans, seconds and metres until the pose was found."""
        rows = [(r.scans, r.seconds, r.metres) for r in self.results if r.found]
        return np.array(rows, np.float64).reshape(-1, 3)

    def summary(self) -> dict[str, Any]:
        """Return the results for JSON."""
        table, rate = self.table(), self.rate()
        names = ("scans", "seconds", "metres")
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
    """Start `count` times without a pose, at scans spread evenly over the drive.

    `make` returns a localizer with a map for a start's number. A start ends after LEAST_SCANS scans and LEAST_S seconds, or with
    the drive. Raises LogError for a drive without a reference, InputError for more starts than scans.
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

    def __init__(self, number: int, frame: DriveFrame, localizer: Localizer) -> None:
        self.number = number
        self._first = self._last = frame
        self._localizer = localizer
        localizer.start_globally()
        self._scans = 0
        self._metres = 0.0
        self._found: tuple[int, float, float, float] | None = None
        self._wrong, self._wrong_error = 0, math.nan

    @property
    def is_over(self) -> bool:
        return self._scans >= LEAST_SCANS and self._last.scan.stamp - self._first.scan.stamp >= LEAST_S

    def take(self, frame: DriveFrame) -> None:
        """Process a scan."""
        self._scans += 1
        step = self._last.odometry.inverse() @ frame.odometry
        self._metres += math.hypot(step.x, step.y)
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
            self._found = (self._scans, frame.scan.stamp - self._first.scan.stamp, self._metres, error)

    def result(self) -> StartResult:
        """Return what has come of it."""
        duration = self._last.scan.stamp - self._first.scan.stamp
        scans, seconds, metres, error = self._found or (self._scans, duration, self._metres, math.nan)
        reference = self._first.reference
        nan = math.nan
        pose = (nan, nan, nan) if reference is None else (reference.x, reference.y, reference.yaw)
        if self._wrong:
            error = self._wrong_error
        return StartResult(self._first.index, pose, scans, seconds, metres, self._found is not None, self._wrong, error)
