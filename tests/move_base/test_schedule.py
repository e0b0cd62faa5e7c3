from __future__ import annotations

import math
from itertools import pairwise

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


def drive(schedule: Schedule, arrivals: list[float], margin: float = 0.001) -> list[float]:
    """Run a schedule that follows arrivals; return its times."""
    times: list[float] = []
    for arrival in arrivals:
        while schedule.due < arrival:
            times.append(schedule.due)
            schedule.advance(times[-1])
        schedule.approach(arrival + margin)
    return times


def test_a_schedule_approaches_the_times_of_scans() -> None:
    times = drive(Schedule(20.0, 0.013), [0.1 * scan + 0.001 * (scan % 3) for scan in range(1, 60)])
    periods = [b - a for a, b in pairwise(times)]
    # once far off, then right after the latest of the scattered arrivals
    assert sorted(periods)[1:] == pytest.approx([0.05] * (len(periods) - 1), abs=0.0021)
    assert [time % 0.05 for time in times[-20:]] == pytest.approx([0.003] * 20, abs=0.0005)
    never = Schedule(0.0)
    assert drive(never, [1.0, 2.0]) == [] and never.due == math.inf


@pytest.mark.parametrize("frequency", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("interval", [0.025, 0.1, 0.101, 0.2])
def test_each_scan_that_fits_the_period_is_followed_at_once(frequency: float, interval: float) -> None:
    schedule = Schedule(frequency)
    times = drive(schedule, [0.031 + interval * scan for scan in range(400)])[-50:]
    step = min(interval, 1.0 / frequency)
    delays = [(time - 0.031) % step for time in times] if interval != 0.101 else []
    assert delays == pytest.approx([0.001] * len(delays), abs=1e-6)
    # also scans that drift
    largest = 0.0021 * max(1.0, 1.0 / (frequency * interval))
    assert [b - a for a, b in pairwise(times)] == pytest.approx([1.0 / frequency] * 49, abs=largest)


@pytest.mark.parametrize("interval", [0.0143, 1.0 / 15.0, 0.1818])
def test_scans_that_do_not_fit_the_period_change_nothing(interval: float) -> None:
    times = drive(Schedule(20.0), [interval * scan for scan in range(1, 400)])
    assert times == [k / 20.0 for k in range(len(times))]


def test_one_late_scan_changes_nothing_and_a_late_cycle_is_not_due_earlier() -> None:
    schedule = Schedule(20.0)
    times = drive(schedule, [0.1 * scan + (0.02 if scan == 20 else 0.0) for scan in range(1, 40)])
    assert [b - a for a, b in pairwise(times[10:])] == pytest.approx([0.05] * (len(times) - 11), abs=0.0021)
    due = schedule.due
    for late in (0.11, 0.21):
        schedule.approach(due + late)
    assert schedule.due == due


def test_a_hastened_call_leaves_the_later_ones() -> None:
    schedule = Schedule(10.0)
    schedule.advance(0.0)
    schedule.hasten(0.04)
    schedule.hasten(0.05)  # it is due before
    assert schedule.due == 0.04
    schedule.advance(0.04)
    assert schedule.due == 0.1
    never = Schedule(0.0)
    never.hasten(1.0)
    assert never.due == math.inf
