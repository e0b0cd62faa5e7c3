"""Measures the loop of the node: periods, late control cycles, and what they waited for."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from typing import Final, NamedTuple

from navstack.move_base.tick_result import TickResult

LATE_S: Final = 0.005
"""A cycle that starts this long (s, wall) after it was due is late."""
SPEED_S: Final = 1.0
"""Time (s, wall) over which the speed of a simulated clock is measured."""
KEPT: Final = 6000
"""Periods and delays that are kept: five minutes at 20 Hz."""
PHASES: Final = ("messages", "cycle", "publishing")


class LateCycle(NamedTuple):
    """A cycle that started late."""

    time: float
    """Time of the node (s)."""
    late_s: float
    cause: str
    """What the loop did, or waited for, meanwhile."""


class LoopTimes:
    """Counts the cycles of one node; the phases of the loop are marked as it goes."""

    def __init__(self, *, is_simulated: bool = False) -> None:
        """With `is_simulated` the clock is that of a simulator: it advances in steps, at a speed of its own."""
        self._is_simulated = is_simulated
        self._step = 0.0 if not is_simulated else math.inf
        """Smallest step of the clock (s)."""
        self._speed = 1.0
        self._last_now = math.nan
        self._measured = (time.perf_counter(), math.nan)
        self.cycles = 0
        self.late = Counter[str]()
        """Number of late cycles by cause."""
        self.worst: LateCycle | None = None
        """The latest cycle since `take_worst`."""
        self.periods: deque[float] = deque(maxlen=KEPT)
        """Times (s, wall) between consecutive commands of the local planner."""
        self.delays: deque[float] = deque(maxlen=KEPT)
        """Times (s) from the stamp of a scan to the first command after its costmap update."""
        self._last_command = math.nan
        self._scan = self._used = math.nan
        self._begin = time.perf_counter()
        self._cpu = time.thread_time()
        self._spent: dict[str, float] = dict.fromkeys(PHASES, 0.0)
        self._waited = 0.0
        """Time (s) in which this thread wanted to run and did not, since the last cycle."""

    def mark(self, phase: str, *, idle_s: float = 0.0) -> None:
        """End a phase that began at the last call; for `idle_s` (s) of it the thread had nothing to do."""
        now, cpu = time.perf_counter(), time.thread_time()
        wall, used = now - self._begin, cpu - self._cpu
        self._begin, self._cpu = now, cpu
        self._spent[phase] += used
        self._waited += max(0.0, wall - used - idle_s)

    def clock(self, now: float) -> None:
        """Note the time (s) of the node's clock: its steps, and its speed."""
        if not self._is_simulated or now == self._last_now:
            return
        if now > self._last_now:
            self._step = min(self._step, now - self._last_now)
        self._last_now = now
        wall, (begin, first) = time.perf_counter(), self._measured
        if not wall - begin < SPEED_S or not now >= first:
            if now > first:
                self._speed = (now - first) / (wall - begin)
            self._measured = wall, now

    def cycle(self, now: float, due: float) -> LateCycle | None:
        """Count a cycle that starts at `now` (s) and was due at `due`; return it if it is late, by wall time."""
        self.cycles += 1
        step = self._step if math.isfinite(self._step) else 0.0
        late = (now - due - step) / self._speed if math.isfinite(due) else 0.0
        found: LateCycle | None = None
        if late > LATE_S:
            spent = {**self._spent, "waiting for the processor or the interpreter": self._waited}
            cause = max(spent, key=lambda name: spent[name])
            if spent[cause] < 0.5 * late:
                cause = "late clock messages" if self._is_simulated else "several parts"
            found = LateCycle(now, late, cause)
            self.late[cause] += 1
            if self.worst is None or late > self.worst.late_s:
                self.worst = found
        self._spent = dict.fromkeys(PHASES, 0.0)
        self._waited = 0.0
        return found

    def command(self, tick: TickResult, now: float) -> None:
        """Note the command of a tick, at `now` (s, the node's clock) when it was sent; without one, the series ends."""
        stamps = [data.stamp for data in tick.scans]
        if stamps:
            self._scan = max(stamps)
        if tick.local_window is not None:
            self._used, self._scan = (self._scan if self._scan == self._scan else self._used), math.nan
        if tick.local_plan is None:
            return
        if self._used == self._used:
            self.delays.append(now - self._used)
            self._used = math.nan
        wall = time.perf_counter()
        if self._last_command == self._last_command:
            self.periods.append(wall - self._last_command)
        self._last_command = wall

    def rest(self) -> None:
        """End the series of periods: the local planner does not run."""
        self._last_command = self._used = math.nan

    def take_worst(self) -> LateCycle | None:
        """Return the latest cycle since the last call, and forget it."""
        found, self.worst = self.worst, None
        return found
