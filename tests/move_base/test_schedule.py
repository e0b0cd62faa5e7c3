from __future__ import annotations

import math

import pytest

from navstack.move_base.schedule import Schedule


def test_no_drift() -> None:
    schedule = Schedule(20.0, 0.1)
    for k in range(100_000):
        assert schedule.due == 0.1 + k / 20.0
        schedule.advance(schedule.due)


def test_frequency_zero_is_never_due() -> None:
    schedule = Schedule(0.0)
    assert schedule.due == schedule.period == math.inf
    assert not schedule.is_due(1e300)


def test_less_than_one_period_late_catches_up() -> None:
    schedule = Schedule(5.0)
    schedule.advance(0.0)
    assert schedule.due == 0.2
    schedule.advance(0.35)
    assert schedule.due == 0.4
    schedule.advance(0.45)
    assert schedule.due == 0.6


def test_more_than_one_period_late_restarts() -> None:
    schedule = Schedule(5.0)
    schedule.advance(0.0)
    schedule.advance(1.0)
    assert schedule.due == 1.2


def test_resume_after_a_long_call() -> None:
    schedule = Schedule(5.0)
    schedule.advance(0.0)
    schedule.resume(0.1)
    assert schedule.due == 0.2
    schedule.resume(0.3)  # less than one period late: due now, the next one on time
    assert schedule.due == 0.2
    assert schedule.is_due(0.3)
    schedule.resume(6.25)
    assert schedule.due == 6.25
    schedule.advance(6.25)
    assert schedule.due == 6.45


def test_accumulated_rounding_does_not_delay() -> None:
    schedule = Schedule(10.0)
    now = 0.0
    for _ in range(1000):
        assert schedule.is_due(now)
        schedule.advance(now)
        assert not schedule.is_due(now)
        now += 0.1


def test_a_schedule_approaches_the_times_of_scans() -> None:
    schedule = Schedule(20.0, 0.013)
    periods: list[float] = []
    now = 0.0
    for scan in range(1, 40):
        arrival = 0.1 * scan + 0.003 * (scan % 3)
        while schedule.due < arrival:
            periods.append(schedule.due - now)
            now = schedule.due
            schedule.advance(now)
        schedule.approach(arrival + 0.001)
    # once far off, then right after the latest of the scattered arrivals
    assert sorted(periods[1:])[1:] == pytest.approx([0.05] * (len(periods) - 2), abs=0.0021)
    assert schedule.due % 0.05 == pytest.approx(0.0065, abs=0.0011)
    never = Schedule(0.0)
    never.approach(1.0)
    assert never.due == math.inf
