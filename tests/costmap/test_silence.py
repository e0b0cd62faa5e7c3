"""How long a sensor may be silent."""

from __future__ import annotations

from navstack.costmap.sensor_timeout import Silence


def test_it_counts_from_the_first_question_without_any_message() -> None:
    silence = Silence()
    assert silence.is_within(1.0, 10.0)
    assert silence.is_within(1.0, 11.0)
    assert not silence.is_within(1.0, 11.5)
    assert silence.is_within(0.0, 1e9)  # 0 allows any


def test_it_counts_from_the_newest_message() -> None:
    silence = Silence()
    silence.arrived(10.0)
    assert not silence.is_within(1.0, 12.0)
    silence.arrived(12.0)
    assert silence.is_within(1.0, 12.5)


def test_a_stamp_from_the_future_counts_as_now() -> None:
    silence = Silence()
    silence.arrived(1000.0)
    assert silence.is_within(1.0, 10.0)
    assert not silence.is_within(1.0, 11.5)


def test_a_restart_gives_the_full_time_again() -> None:
    silence = Silence()
    silence.arrived(10.0)
    assert not silence.is_within(1.0, 20.0)
    silence.restart()
    assert silence.is_within(1.0, 20.0)
    assert not silence.is_within(1.0, 21.5)
