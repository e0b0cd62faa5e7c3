"""The detector of V-shaped reflectors: accuracy under noise, and what is no reflector."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import LaserScan, Pose2D, angle_between
from navstack.docking.reflector import VReflectorDetector, VReflectorParams, vee_of
from navstack.testing.dock_detector import heading_of
from tests.docking.scenes import reflector_scan

MARKER = Pose2D(0.9, 0.1, 0.15)


def detect(scan: LaserScan, expected: Pose2D = MARKER, **values: float):  # type: ignore[no-untyped-def]
    detector = VReflectorDetector(VReflectorParams(**values))
    return detector.detect(scan, expected), detector.remark


@pytest.mark.slow
def test_errors_under_noise_have_no_bias_and_shrink_with_the_mean() -> None:
    # 1 cm per beam; about 27 points per wall: sigma of the heading about 1 degree, of the vertex about 3 mm
    errors: list[tuple[float, float, float]] = []
    for seed in range(30):
        found, remark = detect(reflector_scan(MARKER, noise=0.01, seed=seed))
        assert found is not None, remark
        errors.append((found.x - MARKER.x, found.y - MARKER.y, angle_between(MARKER.yaw, heading_of(found))))
    mean, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert np.all(np.abs(mean[:2]) < 0.003)
    assert abs(mean[2]) < math.radians(0.7)
    assert np.all(spread[:2] < 0.01)
    assert spread[2] < math.radians(2.5)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ({"angle": math.pi / 2.0}, "corner of 90 degrees"),
        ({"angle": 3.9}, "corner of 223 degrees"),
        ({"length": 0.45}, "walls of 0.45 and 0.45 m"),
        ({"length": 0.08}, "a wall without a corner"),
        ({"length": 0.002}, "no wall"),
    ],
)
def test_other_shapes_are_no_reflector_and_the_remark_says_why(shape: dict[str, float], said: str) -> None:
    found, remark = detect(reflector_scan(MARKER, beams=1440, **shape))
    assert found is None
    assert said in remark


def test_a_straight_wall_is_no_reflector() -> None:
    scan = reflector_scan(Pose2D(50.0, 0.0, 0.0), wall_m=0.9)
    found, remark = detect(scan)
    assert found is None
    assert remark == "a wall without a corner"


def test_scans_without_a_finite_range_show_nothing() -> None:
    for value in (np.nan, np.inf, -np.inf, 0.0):
        ranges = np.full(720, value, np.float32)
        found, remark = detect(LaserScan(ranges, -2.0, 0.005, 0.05, 10.0))
        assert found is None
        assert "no wall" in remark
    assert detect(LaserScan(np.empty(0, np.float32), 0.0, 0.01, 0.05, 10.0))[0] is None


def test_the_topic_selects_the_lidar() -> None:
    detector = VReflectorDetector(VReflectorParams(topic="rear_scan"))
    assert detector.detect(reflector_scan(MARKER), MARKER) is None


def test_the_nearer_one_to_the_shape_wins_over_another_corner() -> None:
    scan, other = reflector_scan(MARKER), reflector_scan(Pose2D(0.9, -0.35, 0.0), angle=1.7)
    both = LaserScan(np.minimum(scan.ranges, other.ranges), scan.angle_min, scan.angle_increment, 0.05, 10.0)
    found, _ = detect(both)
    assert found is not None
    assert math.hypot(found.x - MARKER.x, found.y - MARKER.y) < 0.01


def test_parallel_walls_have_no_vertex() -> None:
    line = np.column_stack((np.linspace(1.0, 2.0, 8), np.zeros(8)))
    assert vee_of(line, line) is None
