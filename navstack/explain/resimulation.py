"""Replays recorded runs. A run is a pure function of its scenario, so a replay restores every state of the run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from navstack.core import InputError, Pose2D, RecordError, Transform2D
from navstack.costmap import LayeredCostmap
from navstack.fleet import is_of_fleet, replay_member
from navstack.record import Record
from navstack.replay import LogReplay, is_of_log, replay_of_log
from navstack.scenario import Run, Scenario

Replayed = Run | LogReplay
"""A simulation that runs again, or a log that is replayed again."""

COSTMAPS = ("global", "local")
_SLACK_S = 1e-3
"""Tolerance of requested times: commands print times with three digits."""


@dataclass(frozen=True, slots=True)
class Replay:
    """The state of a run at one time: costmaps, planners and robot."""

    record: Record | None
    """The record; None for a run that goes on."""
    run: Replayed
    time: float
    """Time of the last control cycle (s)."""

    def costmap(self, name: str) -> LayeredCostmap:
        """Return the `global` or `local` costmap."""
        live = self.run.move_base.local_costmap if name == "local" else self.run.move_base.global_costmap
        assert isinstance(live, LayeredCostmap)
        return live

    def to_map(self, name: str) -> Transform2D:
        """Return the transform from a costmap's frame to the map frame, by the robot's localization at this time."""
        frames = self.run.move_base.robot.frames
        return frames.lookup(_map_frame(self.run), self.costmap(name).frame)

    @property
    def robot_pose(self) -> Pose2D:
        """The robot in the map frame: its true pose in a simulation, its localization in a log."""
        return self.run.robot.pose if isinstance(self.run, Run) else self.run.pose


def time_in(record: Record, time: float | None) -> float:
    """Return `time` (s; default: the end of the run) if the run covers it.

    Raises InputError if not, RecordError for an empty run.
    """
    end = float(record.times[record.index_at(math.inf)])
    first = float(record.times[0])
    if time is None:
        return end
    if not first - _SLACK_S <= time <= end + _SLACK_S:  # false for NaN
        raise InputError(
            f"--time {time:g} is outside the run, which covers {first:.3f} .. {end:.3f} s",
            time=time,
            first=first,
            last=end,
        )
    return min(max(time, first), end)


def replay(record: Record, time: float | None = None) -> Replay:
    """Replay a run up to `time` (s; default: the end of the run).

    Raises InputError for a time outside the run. Raises RecordError if the record does not contain its scenario, or if
    the replay differs from the record: the diagnostics would then be about another run.
    """
    until = time_in(record, time)
    run = _again(record)
    for expected in record.times[: record.index_at(until) + 1].tolist():
        if not run.step():
            raise _differs(record, expected, "the run has ended")
        if run.move_base.now != expected:
            raise _differs(record, expected, f"the control cycle is at {run.move_base.now:.6f} s")
    _check(record, run, until)
    return Replay(record, run, run.move_base.now)


def _again(record: Record) -> Replayed:
    """Return the run before the first cycle of the record."""
    if record.resume is not None:
        return record.resume()
    if is_of_fleet(record):
        return replay_member(record)
    return replay_of_log(record) if is_of_log(record) else Run(Scenario.from_record(record))


def _map_frame(run: Replayed) -> str:
    return run.robot.map_frame if isinstance(run, Run) else run.move_base.global_costmap.frame


def _check(record: Record, run: Replayed, until: float) -> None:
    """Raise RecordError unless the replay equals the record up to its end, bit by bit."""
    recorder = run.recorder if isinstance(run, Run) else run.run_recorder
    assert recorder is not None
    again = recorder.record()
    n = len(again.times)
    before, now = record.samples[:n], again.samples
    for column in now.dtype.names or ():
        same = before[column] == now[column]
        if not same.all():
            first = int(np.argmin(same))
            was, is_now = before[column][first], now[column][first]
            raise _differs(record, float(now["t"][first]), f"{column} is {is_now} instead of {was}")
    for name in again.costmap_names:
        rows: Any = again.arrays[f"costmaps/{name}"]
        old: Any = record.arrays.get(f"costmaps/{name}")
        cells = again.arrays[f"costmaps/{name}_cells"]
        if (
            old is None
            or not np.array_equal(old[: len(rows)], rows)
            or not np.array_equal(record.arrays[f"costmaps/{name}_cells"][: len(cells)], cells)
        ):
            raise _differs(record, until, f"the {name} costmap differs")


def _differs(record: Record, time: float, what: str) -> RecordError:
    from navstack import __version__

    by = record.scenario.get("navstack")
    versions = f"recorded by navstack {by}, replayed by {__version__}" if by != __version__ else "the code has changed"
    return RecordError(
        f"{record.path or 'the record'} was made by another version: in the replay, {what} at {time:.3f} s ({versions}); "
        "record the run again",
        time=time,
        recorded_by=by,
    )
