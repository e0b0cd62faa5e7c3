"""The collision detector: its frequency, and what it finds."""

from __future__ import annotations

import pytest

from navstack.parameters import CollisionDetectorParams, MonitorSourceParams
from navstack.safety import CollisionDetector
from tests.safety.rig import FOOTPRINT, frames_at, scan_of, zone


def detector(frequency: float) -> CollisionDetector:
    blocks = {"near": zone(action_type="none"), "scan": MonitorSourceParams()}
    params = CollisionDetectorParams(
        frequency=frequency, polygons=["near"], observation_sources=["scan"], blocks=blocks, source_timeout=10.0
    )
    return CollisionDetector(params, frames=frames_at(), base_frame="base", footprint=FOOTPRINT)


@pytest.mark.parametrize("frequency", [4.0, 10.0])
def test_the_next_check_is_a_period_after_the_last(frequency: float) -> None:
    checks = detector(frequency)
    checks.observe(scan_of((1.0, 0.0)))
    checks.step(0.0)
    assert checks.due == pytest.approx(1.0 / frequency)
    checks.step(checks.due)
    assert checks.due == pytest.approx(2.0 / frequency)


def test_a_late_check_does_not_make_up_for_missed_ones() -> None:
    checks = detector(4.0)
    checks.observe(scan_of((1.0, 0.0)))
    checks.step(0.0)
    checks.step(1.6)
    assert checks.due == pytest.approx(1.85)


@pytest.mark.parametrize(("x", "inside"), [(0.1, True), (1.0, False)])
def test_points_inside_are_found(x: float, inside: bool) -> None:
    checks = detector(4.0)
    checks.observe(scan_of((x, 0.0)))
    assert checks.step(0.0).zones == {"near": inside}
