"""Tuning of localization: amcl over drives whose true poses are known, simulated or from logs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.core import OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import LogError
from navstack.drives import Drive, DriveFrame, drive_frames, open_drive
from navstack.drives.follow import Track, follow
from navstack.drives.mapping import map_from_frames
from navstack.drives.run_record import RecordDrive
from navstack.localization import Amcl
from navstack.parameters.configuration import Configuration
from navstack.parameters.models.amcl import AmclParams
from navstack.parameters.sources import Source
from navstack.record import RunRecorder
from navstack.scenario import Run, Scenario
from navstack.tune.evaluation import FAILED_SCORE, Case, Evaluation, NamedScenario, RunOutcome

HELD_M: Final = 0.5
"""A pose is held while it is less than this off (m)."""
HELD_SHARE: Final = 0.95
"""A drive succeeds if the pose is held at this share of its scans, and at the last one."""
START_ERROR: Final = (0.15, 0.15, 0.1)
"""Standard deviations of the error of the first pose (m, m, rad)."""
MOST_PARTS: Final = 16
"""Parts of a log that are cases of their own; half of them are held out."""
PART_SCANS: Final = 8
"""A part has at least this many scans."""
LEAST_PARTS: Final = 4
ENVIRONMENT: Final[Source] = {
    "amcl": {},
    "navstack": {
        "sim": {"localization": "truth", "odometry_turn": 0.03, "odometry_noise": 0.02, "wheel_slip": 0.02},
    },
}
"""Of simulated drives: the robot drives on true poses, with odometry that drifts."""


@dataclass(frozen=True, slots=True)
class LogPart:
    """A part of a log: scans `first` to `last` of those that are localized."""

    name: str
    path: Path
    first: int
    last: int


def parts_of_log(path: Path) -> tuple[LogPart, ...]:
    """Return the parts of a log. Raises LogError for a log without reference poses."""
    frames, _ = _log_frames(path)
    known = sum(frame.reference is not None for frame in frames)
    count = min(MOST_PARTS, known // PART_SCANS)
    if count < LEAST_PARTS:
        raise LogError(f"{path} has {known} scans with a reference pose; tuning needs {LEAST_PARTS * PART_SCANS}")
    ends = np.round(np.linspace(0, len(frames), count + 1)).astype(int).tolist()
    return tuple(LogPart(f"part {i + 1}", path, ends[i], ends[i + 1]) for i in range(count))


@cache
def _log_frames(path: Path) -> tuple[list[DriveFrame], OccupancyGrid]:
    """Return the scans to localize and the map: that of the log, or one made of the odd scans; then the even ones are used."""
    drive: Drive = open_drive(path)
    grid = drive.map
    if grid is not None:
        return list(drive_frames(drive)), grid
    grid, _ = map_from_frames(lambda: drive_frames(drive, every=2, first=0))
    return list(drive_frames(drive, every=2, first=1)), grid


class LocalizationEvaluation(Evaluation):
    """Drives with amcl; the score is 1 for no error, 0 for an error (rms) of HELD_M, -1 for a pose that was lost.

    A simulated drive is simulated once and does not depend on the candidate: the robot drives on its true pose.
    """

    failed_score = FAILED_SCORE
    best_score = 1.0

    def __init__(
        self, name: str, scenarios: Sequence[NamedScenario], parts: Sequence[LogPart], seeds: Sequence[int]
    ) -> None:
        self._scenarios = {s.name: s for s in scenarios}
        self._parts = {p.name: p for p in parts}
        self._frames: dict[Case, tuple[list[DriveFrame], OccupancyGrid]] = {}
        super().__init__(name, [Case(case, seed) for seed in seeds for case in (*self._scenarios, *self._parts)])

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_frames": {}}

    def overlays(self, case: Case) -> tuple[Mapping[str, Any], ...]:
        """Those of the scenario."""
        named = self._scenarios.get(case.name)
        return () if named is None else named.overlays

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Localize along the drive; there is no recorder."""
        frames, grid = self._drive_of(case)
        params = configuration.localization.amcl or AmclParams()
        localizer = Amcl(params, seed=case.seed)
        localizer.set_map(grid)
        reference = next(frame.reference for frame in frames if frame.reference is not None)
        start = Transform2D(*reference).apply(_start_error(case.seed))
        return _outcome(follow(frames, localizer, initial_pose=start)), None

    def _drive_of(self, case: Case) -> tuple[list[DriveFrame], OccupancyGrid]:
        found = self._frames.get(case)
        if found is None:
            part = self._parts.get(case.name)
            if part is None:
                found = _simulated(self._scenarios[case.name].scenario, case.seed)
            else:
                frames, grid = _log_frames(part.path)
                found = frames[part.first : part.last], grid
            self._frames[case] = found
        return found


def _simulated(scenario: Scenario, seed: int) -> tuple[list[DriveFrame], OccupancyGrid]:
    run = Run(replace(scenario, seed=seed), record=True)
    while run.step():
        pass
    assert run.recorder is not None
    return list(drive_frames(RecordDrive.of(run.recorder.record()))), scenario.map


def _start_error(seed: int) -> Pose2D:
    return Pose2D(*(np.random.default_rng([seed, 19]).standard_normal(3) * START_ERROR).tolist())


def _outcome(track: Track) -> RunOutcome:
    errors = track.errors[track.known]
    held = errors < HELD_M
    success = bool(len(held)) and bool(held[-1]) and float(held.mean()) >= HELD_SHARE
    rms = float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else math.inf
    steps = np.diff(track.references[track.known, :2], axis=0)
    return RunOutcome(
        success=success,
        outcome="success" if success else "lost",
        score=max(0.0, 1.0 - rms / HELD_M) if success else FAILED_SCORE,
        time_s=0.0,
        length_m=float(np.hypot(*steps.T).sum()),
        clearance_m=0.0,
        jerk=0.0,
        recoveries=0,
        text="" if success else f"within {HELD_M:g} m at {100.0 * float(held.mean()):.0f} % of the scans",
        error_m=rms,
    )
