"""Curves that are too tight: circles, corners, changes of direction, and the place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Path, Pose2D, Twist2D
from navstack.core.kinematics import integrate
from navstack.core.path_turns import reversals, tight_turn, turn_note


def arcs(*segments: tuple[float, float], step: float = 0.05, yaw: float = 0.0) -> Path:
    """A path of arcs (signed length m, curvature 1/m)."""
    poses = [Pose2D(1.0, 2.0, yaw)]
    for length, curvature in segments:
        first, count = poses[-1], max(1, math.ceil(abs(length) / step))
        whole = Twist2D(length, 0.0, length * curvature)
        poses += [integrate(first, whole, (k + 1) / count) for k in range(count)]
    return Path(np.array(poses))


@settings(deadline=None, max_examples=60)
@given(radius=st.floats(0.3, 3.0), length=st.floats(3.0, 12.0), yaw=st.floats(-3.0, 3.0), left=st.booleans())
def test_a_circle_is_measured_within_five_percent(radius: float, length: float, yaw: float, left: bool) -> None:
    """Chords of a polyline of 5 cm: their ends are within c² / 8R of the circle."""
    path = arcs((length, (1.0 if left else -1.0) / radius), yaw=yaw)
    assert tight_turn(path, 0.95 * radius) is None
    found = tight_turn(path, 1.3 * radius)
    assert found is not None and found[0] == pytest.approx(radius, rel=0.05)


def test_the_place_is_where_the_curve_begins() -> None:
    path = arcs((3.0, 0.0), (1.0, 2.0), (3.0, 0.0))
    found = tight_turn(path, 1.0)
    assert found is not None
    assert found[1].distance_to(Pose2D(4.0, 2.0)) < 0.4  # within two chords of 0.25 m
    assert turn_note(path, 1.0) is not None and turn_note(path, 0.4) is None


def test_a_corner_of_cells_is_too_tight() -> None:
    x = np.concatenate((np.arange(0.0, 3.0, 0.05), np.full(60, 3.0)))
    y = np.concatenate((np.zeros(60), np.arange(0.0, 3.0, 0.05)))
    found = tight_turn(Path(np.stack((x, y, np.zeros(120)), axis=1)), 0.8)
    assert found is not None and found[0] < 0.3 and found[1].distance_to(Pose2D(3.0, 0.0)) < 0.3


def test_a_change_of_direction_is_no_curve() -> None:
    path = arcs((2.0, 0.0), (-2.0, 0.5), (2.0, 0.0))
    assert tight_turn(path, 1.9) is None
    at = reversals(path.poses)
    assert at == [40, 80]
    assert tight_turn(path, 2.5) is not None


def test_short_and_standing_paths_have_no_curves() -> None:
    for poses in (np.zeros((1, 3)), np.zeros((50, 3)), np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])):
        assert tight_turn(Path(poses), 1.0) is None
    assert tight_turn(arcs((5.0, 3.0)), 0.0) is None
