"""Compares the commands and plans of a replay with those in the log."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Twist2D
from navstack.record import Table

LINEAR_M_S: Final = 0.05
"""Commands differ if their translational velocities differ by more (m/s),"""
ANGULAR_RAD_S: Final = 0.1
"""or their rotational velocities by more (rad/s)."""


class Cycle(NamedTuple):
    """One cycle of a replay."""

    time: float
    state: str
    """State of the goal manager."""
    goal: int
    """Index of the active goal, -1 without one."""
    command: Twist2D
    """The command of navstack."""
    recorded: Twist2D | None
    """The newest command in the log; None before the first one."""
    rejected: bool
    """True if the local planner found no valid command."""
    controlled: bool
    """True if the local planner found a command."""
    planned: bool
    """True if a new global plan arrived."""


_COLUMNS: Final = [
    *(("time", "<f8"), ("state", "<U"), ("goal", "<i4"), ("vx", "<f8"), ("vy", "<f8"), ("wz", "<f8")),
    *(("recorded_vx", "<f8"), ("recorded_vy", "<f8"), ("recorded_wz", "<f8"), ("flags", "<i4")),
]
_RECORDED, _REJECTED, _CONTROLLED, _PLANNED = 1, 2, 4, 8


class Cycles(Iterable[Cycle]):
    """The cycles of a replay in compact form: a day of them has 130 MB at 20 Hz, in memory or, with a folder, on disk."""

    def __init__(self, cycles: Iterable[Cycle] = (), folder: Path | None = None) -> None:
        self._table = Table(_COLUMNS, folder)
        self.first: Cycle | None = None
        self.last: Cycle | None = None
        for cycle in cycles:
            self.append(cycle)

    def __len__(self) -> int:
        return len(self._table)

    def __iter__(self) -> Iterator[Cycle]:
        for row in self.rows():
            flags = int(row["flags"])
            recorded = Twist2D(*(float(row[f"recorded_{axis}"]) for axis in ("vx", "vy", "wz")))
            yield Cycle(
                float(row["time"]),
                str(row["state"]),
                int(row["goal"]),
                Twist2D(float(row["vx"]), float(row["vy"]), float(row["wz"])),
                recorded if flags & _RECORDED else None,
                bool(flags & _REJECTED),
                bool(flags & _CONTROLLED),
                bool(flags & _PLANNED),
            )

    def append(self, cycle: Cycle) -> None:
        """Add a cycle."""
        state = self._table.texts["state"].number(cycle.state)
        recorded = cycle.recorded
        flags = _REJECTED * cycle.rejected + _CONTROLLED * cycle.controlled + _PLANNED * cycle.planned
        flags += _RECORDED * (recorded is not None)
        self._table.add(cycle.time, state, cycle.goal, *cycle.command, *(recorded or _NOTHING), flags)
        self.first = self.first or cycle
        self.last = cycle

    def rows(self) -> NDArray[Any]:
        """Return the cycles as a structured array."""
        return self._table.streamed().array()

    @property
    def duration(self) -> float:
        """Time (s) between the first and the last cycle."""
        return self.last.time - self.first.time if self.first is not None and self.last is not None else 0.0

    def count(self) -> tuple[int, int, int]:
        """Return the number of cycles with an active goal, and of those without and with a valid command."""
        rows = self.rows()
        flags = rows["flags"][rows["goal"] >= 0]
        return len(flags), int(((flags & _REJECTED) > 0).sum()), int(((flags & _CONTROLLED) > 0).sum())

    def compared(self) -> NDArray[Any]:
        """Return the rows of the cycles in which navstack found a command and the log had one."""
        rows = self.rows()
        both = _RECORDED | _CONTROLLED
        return rows[(rows["flags"] & both) == both]

    def series(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return times (n,), commands (n, 3), commands of the log (n, 3) and rejected cycles (n,); NaN without a command."""
        rows = self.rows()
        commands = np.where((rows["goal"] >= 0)[:, None], commands_of(rows), math.nan)
        return rows["time"].copy(), commands, commands_of(rows, "recorded_"), (rows["flags"] & _REJECTED) > 0


_NOTHING: Final = (math.nan,) * 3


def commands_of(rows: NDArray[Any], prefix: str = "") -> NDArray[np.float64]:
    """Return the commands (n, 3) of rows of `Cycles`; with the prefix `recorded_`, those of the log."""
    return np.column_stack([rows[f"{prefix}{axis}"] for axis in ("vx", "vy", "wz")])


class Difference(NamedTuple):
    """A cycle in which the commands differ."""

    time: float
    command: Twist2D
    recorded: Twist2D


class CommandComparison(NamedTuple):
    """Commands of navstack and of the log, over the cycles in which navstack had a command and the log had one."""

    cycles: int
    """Number of compared cycles."""
    different: int
    """Number of cycles in which they differ by more than `LINEAR_M_S` or `ANGULAR_RAD_S`."""
    equal: int
    """Number of cycles in which they are equal to the bit."""
    first: Difference | None
    """The first difference."""
    mean_linear: float
    """Mean difference of the translational velocity (m/s)."""
    mean_angular: float
    """Mean difference of the rotational velocity (rad/s)."""
    opposite: int
    """Number of cycles in which one drives forward and the other backward, or they turn in opposite directions."""

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for JSON."""
        first = self.first
        return {
            "cycles": self.cycles,
            "different": self.different,
            "equal": self.equal,
            "opposite": self.opposite,
            "mean_linear_m_s": self.mean_linear,
            "mean_angular_rad_s": self.mean_angular,
            "first": None
            if first is None
            else {"time": first.time, "command": list(first.command), "recorded": list(first.recorded)},
        }


def compare_commands(cycles: Cycles) -> CommandComparison | None:
    """Compare the commands; None if the log has none while a goal was active."""
    rows = cycles.compared()
    if not len(rows):
        return None
    ours, theirs = commands_of(rows), commands_of(rows, "recorded_")
    linear = np.hypot(*(ours - theirs)[:, :2].T)
    angular = np.abs(ours[:, 2] - theirs[:, 2])
    differs = (linear > LINEAR_M_S) | (angular > ANGULAR_RAD_S)
    opposite = _opposite(ours[:, 0], theirs[:, 0], LINEAR_M_S) | _opposite(ours[:, 2], theirs[:, 2], ANGULAR_RAD_S)
    first = None
    if differs.any():
        index = int(np.argmax(differs))
        commands = (Twist2D(*map(float, found[index])) for found in (ours, theirs))
        first = Difference(float(rows["time"][index]), *commands)
    return CommandComparison(
        len(rows),
        int(differs.sum()),
        int((ours == theirs).all(axis=1).sum()),
        first,
        float(linear.mean()),
        float(angular.mean()),
        int(opposite.sum()),
    )


def _opposite(a: NDArray[np.float64], b: NDArray[np.float64], threshold: float) -> NDArray[np.bool_]:
    return (a * b < 0.0) & (np.abs(a) > threshold) & (np.abs(b) > threshold)


class PlanComparison(NamedTuple):
    """Plans of navstack and of the log for the same time."""

    plans: int
    """Number of compared pairs."""
    length: float
    """Mean length of navstack's plans (m)."""
    recorded_length: float
    """Mean length of the log's plans (m)."""
    deviation: float
    """Mean over the pairs of the largest distance (m) of a pose of navstack's plan from the log's plan."""
    largest: float
    """The largest of these distances (m)."""
    largest_at: float
    """Time of the largest distance (s)."""

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for JSON."""
        return {
            "plans": self.plans,
            "mean_length_m": self.length,
            "recorded_mean_length_m": self.recorded_length,
            "mean_deviation_m": self.deviation,
            "largest_deviation_m": self.largest,
            "largest_deviation_at_s": self.largest_at,
        }


class PlanComparer:
    """Compares each plan of the log with navstack's nearest in time while both arrive; keeps only the last seconds of them."""

    def __init__(self, within_s: float = 1.0) -> None:
        """`within_s`: plans that are further apart (s) are not compared."""
        self._within = within_s
        self._ours: deque[tuple[float, NDArray[np.float64]]] = deque()
        self._waiting: deque[tuple[float, NDArray[np.float64]]] = deque()
        self._rows: list[tuple[float, float, float, float]] = []

    def add(self, time: float, poses: NDArray[np.float64]) -> None:
        """Add a plan (n, 3) of navstack."""
        self._ours.append((time, poses))

    def add_recorded(self, time: float, poses: NDArray[np.float64]) -> None:
        """Add a plan (n, 3) of the log, in the same frame."""
        if len(poses) >= 2:
            self._waiting.append((time, poses))

    def settle(self, now: float = math.inf) -> None:
        """Compare the plans of the log for which no nearer plan can come after `now` (s; default: the end)."""
        while self._waiting and self._waiting[0][0] + self._within < now:
            time, poses = self._waiting.popleft()
            nearest = min(self._ours, key=lambda plan: abs(plan[0] - time), default=None)
            if nearest is not None and abs(nearest[0] - time) <= self._within and len(nearest[1]) >= 2:
                mine = nearest[1]
                self._rows.append((time, _length(mine), _length(poses), _farthest(mine, poses)))
        while self._ours and self._ours[0][0] < now - 2.0 * self._within:
            self._ours.popleft()

    def result(self) -> PlanComparison | None:
        """Return the comparison of the settled plans; None without a pair."""
        if not self._rows:
            return None
        table = np.array(self._rows)
        worst = int(np.argmax(table[:, 3]))
        length, recorded_length, deviation = table[:, 1:].mean(axis=0).tolist()
        largest, at = float(table[worst, 3]), float(table[worst, 0])
        return PlanComparison(len(table), length, recorded_length, deviation, largest, at)


def _length(poses: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def _farthest(poses: NDArray[np.float64], line: NDArray[np.float64]) -> float:
    """Return the largest distance (m) of a pose from the polyline `line`."""
    import shapely

    distances = shapely.distance(shapely.points(poses[:, :2]), shapely.LineString(line[:, :2]))
    return float(np.max(distances))
