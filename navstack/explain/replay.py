"""A recorded run, driven once more: a run is a pure function of its scenario, so everything it ever knew can be asked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from navstack.core import Transform2D
from navstack.core.errors import InputError, RecordError
from navstack.costmap import LayeredCostmap
from navstack.record import Record
from navstack.scenario import Run, Scenario

COSTMAPS = ("global", "local")
_SLACK_S = 1e-3
"""Times are shown with three digits: what is shown can be asked for."""


@dataclass(frozen=True, slots=True)
class Replay:
    """A run as it stood at a time: live costmaps, planners and robot."""

    record: Record
    run: Run
    time: float
    """Of the last control cycle (s)."""

    def costmap(self, name: str) -> LayeredCostmap:
        """`global` or `local`."""
        live = self.run.move_base.local_costmap if name == "local" else self.run.move_base.global_costmap
        assert isinstance(live, LayeredCostmap)
        return live

    def to_map(self, name: str) -> Transform2D:
        """Takes coordinates in a costmap's frame to the map's, as the robot believed them to lie."""
        robot = self.run.robot
        return robot.frames.lookup(robot.map_frame, self.costmap(name).frame)


def time_in(record: Record, time: float | None) -> float:
    """`time` (s) checked against the run, its end when None. Raises InputError or, for an empty run, RecordError."""
    end = float(record.times[record.index_at(math.inf)])
    first = float(record.times[0])
    if time is None:
        return end
    if not first - _SLACK_S <= time <= end + _SLACK_S:  # false for NaN
        raise InputError(
            f"nothing was recorded at {time:g} s: the run covers {first:.3f} .. {end:.3f} s; give --time in between",
            time=time,
            first=first,
            last=end,
        )
    return min(max(time, first), end)


def replay(record: Record, time: float | None = None) -> Replay:
    """Drives the run again up to `time` (s; the end when None) and hands it over as it stood then.

    Raises RecordError when the record does not hold its scenario, or when this version drives otherwise than the record
    says: then nothing that it explains would be about that run.
    """
    until = time_in(record, time)
    run = Run(Scenario.from_record(record))
    for expected in record.times[: record.index_at(until) + 1].tolist():
        if not run.step():
            raise _differs(record, expected, "the run is over")
        if run.robot.time != expected:
            raise _differs(record, expected, f"the control cycle falls on {run.robot.time:.6f} s")
    _check(record, run, until)
    return Replay(record, run, run.robot.time)


def _check(record: Record, run: Run, until: float) -> None:
    """What was recorded up to then is what happened now, to the bit."""
    assert run.recorder is not None
    again = run.recorder.record()
    n = len(again.times)
    before, now = record.samples[:n], again.samples
    for column in now.dtype.names or ():
        same = before[column] == now[column]
        if not same.all():
            first = int(np.argmin(same))
            was, is_now = before[column][first], now[column][first]
            raise _differs(record, float(now["t"][first]), f"{column} is {is_now}, the record has {was}")
    for name in again.costmap_names:
        rows: Any = again.arrays[f"costmaps/{name}"]
        old: Any = record.arrays.get(f"costmaps/{name}")
        cells = again.arrays[f"costmaps/{name}_cells"]
        if (
            old is None
            or not np.array_equal(old[: len(rows)], rows)
            or not np.array_equal(record.arrays[f"costmaps/{name}_cells"][: len(cells)], cells)
        ):
            raise _differs(record, until, f"the {name} costmap is another one")


def _differs(record: Record, time: float, what: str) -> RecordError:
    from navstack import __version__

    by = record.scenario.get("navstack")
    versions = (
        f"it was recorded by navstack {by}, this is {__version__}" if by != __version__ else "the code has changed"
    )
    return RecordError(
        f"{record.path or 'the record'} is of another version: driven again, {what} at {time:.3f} s ({versions}); "
        "record the run again",
        time=time,
        recorded_by=by,
    )
