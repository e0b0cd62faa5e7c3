"""Measures the loop of a node: periods, late control cycles, and what they waited for."""

from __future__ import annotations

import math
import os
import time
from collections import Counter, deque
from typing import Final, NamedTuple

from navstack.move_base import TickResult

LATE_S: Final = 0.005
"""A cycle that starts this long (s, wall) after it was due is late."""
SPEED_S: Final = 1.0
"""Time (s, wall) over which the speed of a simulated clock is measured."""
KEPT: Final = 6000
"""Periods and delays that are kept: five minutes at 20 Hz."""
PHASES: Final = ("messages", "cycle", "publishing", "record")
"""What the loop does in turn."""
PROGRAMS: Final = "other programs on the processor"
THREADS: Final = "other threads of the node"
EITHER: Final = "other programs on the processor or other threads of the node"
"""Where the system does not distinguish them."""
CLOCK: Final = "late clock messages"
STEP: Final = "a step of the system clock"
ENOUGH: Final = 0.5
"""The loop explains a delay if its parts took this share of it together."""


class ThreadTimes:
    """Times of the current thread (s)."""

    def __init__(self) -> None:
        try:
            self._queue: int | None = os.open("/proc/thread-self/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        except OSError:  # another system, or a kernel without it
            self._queue = None

    def wall(self) -> float:
        """Return the time of a clock on the wall."""
        return time.perf_counter()

    def used(self) -> float:
        """Return the processor time so far."""
        return time.thread_time()

    def queued(self) -> float | None:
        """Return for how long the thread could have run, but the processor had other work; None where it is not known."""
        return None if self._queue is None else 1e-9 * int(os.pread(self._queue, 100, 0).split()[1])


class LateCycle(NamedTuple):
    """A cycle that started late."""

    time: float
    """Time of the node (s)."""
    late_s: float
    cause: str
    """What the loop did, or waited for, meanwhile."""
    spent: dict[str, float]
    """Time (s, wall) by what the loop did, or waited for, since the cycle before."""

    def __str__(self) -> str:
        parts = ", ".join(f"{name} {1e3 * spent:.1f}" for name, spent in self.spent.items() if spent >= 1e-3)
        return f"{self.late_s:.4f} s at {self.time:.3f} s: {self.cause}" + (f" ({parts} ms)" if parts else "")


class LoopTimes:
    """Counts the cycles of one node; the phases of the loop are marked as it goes."""

    def __init__(self, times: ThreadTimes | None = None, *, is_simulated: bool = False) -> None:
        """Create it in the thread of the loop, whose times are `times`.

        With `is_simulated` the clock is that of a simulator: it advances in steps, at a speed of its own.
        """
        self._times = times = times or ThreadTimes()
        self._is_simulated = is_simulated
        self._step = 0.0 if not is_simulated else math.inf
        """Smallest step of the clock (s)."""
        self._speed = 1.0 if not is_simulated else math.inf
        """Speed of the clock; infinite until it is known."""
        self._last_now = math.nan
        self._measured = (times.wall(), math.nan)
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
        self._begin, self._cpu, self._queued = times.wall(), times.used(), times.queued()
        self._spent: dict[str, float] = dict.fromkeys(PHASES, 0.0)
        self._waited = 0.0
        """Time (s) in which this thread wanted to run and did not, since the last cycle."""

    def mark(self, phase: str, *, idle_s: float = 0.0) -> None:
        """End a phase that began at the last call; for `idle_s` (s) of it the thread had nothing to do."""
        now, cpu = self._times.wall(), self._times.used()
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
        wall, (begin, first) = self._times.wall(), self._measured
        if not wall - begin < SPEED_S or not now >= first:
            if now > first:
                self._speed = (now - first) / (wall - begin)
            self._measured = wall, now

    def cycle(self, now: float, due: float) -> LateCycle | None:
        """Count a cycle that starts at `now` (s) and was due at `due`; return it if it is late, by wall time."""
        self.cycles += 1
        step = self._step if math.isfinite(self._step) else 0.0
        late = (now - due - step) / self._speed if math.isfinite(due) else 0.0
        spent = self._take_spent()
        if not late > LATE_S:
            return None
        found = LateCycle(now, late, self._cause(late, spent), spent)
        self.late[found.cause] += 1
        if self.worst is None or late > self.worst.late_s:
            self.worst = found
        return found

    def _take_spent(self) -> dict[str, float]:
        """Return what the loop did and waited for since the last call, longest first."""
        before, self._queued = self._queued, self._times.queued()
        if before is None or self._queued is None:
            waits = {EITHER: self._waited}
        else:
            programs = min(self._queued - before, self._waited)
            waits = {PROGRAMS: programs, THREADS: self._waited - programs}
        spent = {**self._spent, **waits}
        self._spent = dict.fromkeys(self._spent, 0.0)
        self._waited = 0.0
        return dict(sorted(spent.items(), key=lambda item: -item[1]))

    def _cause(self, late: float, spent: dict[str, float]) -> str:
        """Return what took longest before a cycle that is late (s), or the clock if the loop had little to do."""
        if sum(spent.values()) < ENOUGH * late:
            return CLOCK if self._is_simulated else STEP
        return max(spent, key=lambda name: spent[name])

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
        wall = self._times.wall()
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
