"""The times of the node's loop: periods, delays, and an explanation of every late cycle. Without ROS."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import LaserScan, Twist2D, Window
from navstack.move_base import TickResult
from navstack.plugins import LocalPlan
from navstack.ros_node.loop_times import CLOCK, EITHER, PROGRAMS, STEP, THREADS, LoopTimes, ThreadTimes


class FakeTimes(ThreadTimes):
    """Times that the test sets."""

    def __init__(self, *, has_queue: bool = True) -> None:
        self._wall, self._used = 100.0, 7.0
        self._queued = 3.0 if has_queue else None

    def wall(self) -> float:
        return self._wall

    def used(self) -> float:
        return self._used

    def queued(self) -> float | None:  # type: ignore[override]
        return self._queued

    def spend(self, wall: float, *, used: float = 0.0, queued: float = 0.0) -> None:
        self._wall += wall
        self._used += used
        if self._queued is not None:
            self._queued += queued


def cycle(loop: LoopTimes, times: FakeTimes, now: float, late: float, **spent: float) -> str:
    """Let the loop spend times (s) since a cycle, then start one that is late by `late` (s); return the cause."""
    for phase in ("cycle", "record", "publishing"):
        work = spent.get(phase, 0.0)
        times.spend(work, used=work)
        loop.mark(phase)
    idle = spent.get("idle", 0.0)
    queued, blocked = spent.get("queued", 0.0), spent.get("blocked", 0.0)
    times.spend(idle + queued + blocked, queued=queued)
    loop.mark("messages", idle_s=idle)
    before = sum(loop.late.values())
    found = loop.cycle(now, now - late)
    assert (found is None) == (sum(loop.late.values()) == before)
    return "" if found is None else found.cause


@pytest.mark.parametrize(
    ("spent", "cause"),
    [
        ({"cycle": 0.06}, "cycle"),
        ({"publishing": 0.055, "cycle": 0.004}, "publishing"),
        ({"record": 0.055, "cycle": 0.004}, "record"),
        ({"idle": 0.048, "queued": 0.02, "cycle": 0.002}, PROGRAMS),
        ({"idle": 0.048, "blocked": 0.02, "cycle": 0.002}, THREADS),
        ({"idle": 0.048, "blocked": 0.008, "queued": 0.009, "publishing": 0.0039}, PROGRAMS),
        ({"idle": 0.05, "cycle": 0.001}, STEP),
    ],
)
def test_every_late_cycle_has_a_cause(spent: dict[str, float], cause: str) -> None:
    times = FakeTimes()
    loop = LoopTimes(times)
    assert cycle(loop, times, 1.0, 0.004, **spent) == ""
    assert cycle(loop, times, 1.1, 0.02, **spent) == cause
    assert loop.late == {cause: 1}
    # what was spent before a cycle does not explain the next one
    assert cycle(loop, times, 1.2, 0.02, idle=0.05) == STEP
    worst = loop.take_worst()
    assert worst is not None and str(worst).startswith(f"0.0200 s at 1.100 s: {cause}")
    assert loop.take_worst() is None


def test_without_the_queue_of_the_processor() -> None:
    times = FakeTimes(has_queue=False)
    assert cycle(LoopTimes(times), times, 1.0, 0.02, idle=0.04, blocked=0.01, queued=0.01) == EITHER


def test_the_causes_sum_to_the_late_cycles() -> None:
    rng = np.random.default_rng(4)
    for is_simulated in (False, True):
        times = FakeTimes()
        loop = LoopTimes(times, is_simulated=is_simulated)
        late = 0
        for k in range(500):
            parts = rng.random(6) ** 4 * 0.02
            names = ("cycle", "record", "publishing", "idle", "queued", "blocked")
            now = 0.05 * k
            loop.clock(now)
            late += cycle(loop, times, now, rng.random() ** 4 * 0.1, **dict(zip(names, parts, strict=True))) != ""
        assert loop.cycles == 500
        assert 30 < late == sum(loop.late.values())


def test_a_simulated_clock_counts_in_wall_time_and_in_its_steps() -> None:
    times = FakeTimes()
    loop = LoopTimes(times, is_simulated=True)
    assert loop.cycle(0.0, -0.08) is None  # the speed is not known yet
    now = 0.0
    for _ in range(1000):  # ten times real time, in steps of 0.02 s
        now += 0.02
        times.spend(0.002)
        loop.clock(now)
    loop.mark("messages", idle_s=1.0)
    assert loop.cycle(now, now - 0.02) is None  # the first step after it was due
    assert loop.cycle(now, now - 0.065) is None  # 4.5 ms
    found = loop.cycle(now, now - 0.08)
    assert found is not None
    assert (found.late_s, found.cause) == (pytest.approx(0.006), CLOCK)
    assert loop.cycle(now, -math.inf) is None  # a goal has arrived


def test_periods_and_delays() -> None:
    times = FakeTimes()
    loop = LoopTimes(times)
    scan = LaserScan(np.ones(3, np.float32), -1.0, 1.0, 0.1, 10.0, 0.98, "laser", "scan")
    plan = LocalPlan(Twist2D(0.1))
    window = Window(0, 0, 1, 1)

    def command(now: float, **found: object) -> None:
        tick = TickResult(now)
        for name, value in found.items():
            setattr(tick, name, value)
        loop.command(tick, now)
        times.spend(0.05)

    command(1.0, scans=(scan,), local_plan=plan)  # the costmap does not have the scan yet
    command(1.01, local_window=window)
    command(1.06, local_plan=plan)
    command(1.11, local_plan=plan)
    assert list(loop.delays) == [pytest.approx(1.06 - scan.stamp)]
    assert list(loop.periods) == [pytest.approx(0.1), pytest.approx(0.05)]
    loop.rest()
    command(1.5, local_plan=plan)
    assert len(loop.periods) == 2


def test_the_times_of_this_thread() -> None:
    times = ThreadTimes()
    wall, used, queued = times.wall(), times.used(), times.queued()
    sum(k * k for k in range(20_000))
    assert times.wall() > wall
    assert times.used() > used
    later = times.queued()
    assert queued is None or later is None or later >= queued >= 0.0
