"""Timeout of a sensor."""

from __future__ import annotations

from navstack.costmap.observation_buffer import SensorTimeout


def test_starts_at_the_first_check_without_messages() -> None:
    timeout = SensorTimeout()
    assert timeout.is_within(1.0, 10.0)
    assert timeout.is_within(1.0, 11.0)
    assert not timeout.is_within(1.0, 11.5)
    assert timeout.is_within(0.0, 1e9)  # 0: no limit


def test_starts_at_the_newest_message() -> None:
    timeout = SensorTimeout()
    timeout.received(10.0)
    assert not timeout.is_within(1.0, 12.0)
    timeout.received(12.0)
    assert timeout.is_within(1.0, 12.5)


def test_stamp_from_the_future_counts_as_the_present() -> None:
    timeout = SensorTimeout()
    timeout.received(1000.0)
    assert timeout.is_within(1.0, 10.0)
    assert not timeout.is_within(1.0, 11.5)


def test_restart_grants_the_full_timeout() -> None:
    timeout = SensorTimeout()
    timeout.received(10.0)
    assert not timeout.is_within(1.0, 20.0)
    timeout.restart()
    assert timeout.is_within(1.0, 20.0)
    assert not timeout.is_within(1.0, 21.5)
