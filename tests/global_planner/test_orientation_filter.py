from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.global_planner._search.orientation_filter import OrientationMode, orient

CORNER = np.array(
    [[0.0, 0.0, 9.0], [1.0, 0.0, 9.0], [2.0, 0.0, 9.0], [2.0, 1.0, 9.0], [2.0, 2.0, 9.0], [2.0, 2.0, -1.0]]
)


def oriented(mode: OrientationMode, start_yaw: float = 0.5, window: int = 1) -> np.ndarray:
    poses = CORNER.copy()
    orient(poses, start_yaw, mode, window)
    assert (poses[:, :2] == CORNER[:, :2]).all()
    assert poses[-1, 2] == -1.0
    return poses[:, 2]


def test_none_changes_nothing() -> None:
    assert oriented(OrientationMode.NONE)[:-1].tolist() == [9.0] * 5


def test_forward_follows_the_path() -> None:
    half = math.pi / 2.0
    assert oriented(OrientationMode.FORWARD)[:-1] == pytest.approx([0.0, 0.0, math.pi / 4.0, half, half])
    # window of 2: from the first point to the point after the corner
    assert oriented(OrientationMode.FORWARD, window=2)[1] == pytest.approx(math.atan2(1.0, 2.0))


@pytest.mark.parametrize(
    ("mode", "turn"),
    [
        (OrientationMode.BACKWARD, math.pi),
        (OrientationMode.LEFTWARD, -math.pi / 2.0),
        (OrientationMode.RIGHTWARD, math.pi / 2.0),
    ],
)
def test_other_sides_in_front(mode: OrientationMode, turn: float) -> None:
    turned = oriented(mode)[:-1] - oriented(OrientationMode.FORWARD)[:-1]
    assert np.cos(turned - turn) == pytest.approx(np.ones(5))
    assert (np.abs(oriented(mode)) <= math.pi).all()


def test_interpolate_turns_evenly_in_the_shorter_direction() -> None:
    yaw = oriented(OrientationMode.INTERPOLATE, start_yaw=1.5)
    assert yaw == pytest.approx(np.linspace(1.5, -1.0, 6))
    poses = CORNER.copy()
    poses[-1, 2] = 3.0
    orient(poses, -3.0, OrientationMode.INTERPOLATE)
    assert np.cos(np.diff(poses[:, 2])) == pytest.approx(np.full(5, math.cos((2.0 * math.pi - 6.0) / 5.0)))


def test_forward_then_interpolate_keeps_the_bend() -> None:
    straight = np.column_stack(
        [np.r_[np.zeros(5), np.arange(1.0, 8.0)], np.r_[np.arange(-5.0, 0.0), np.zeros(7)], np.zeros(12)]
    )
    straight[-1, 2] = 1.0
    poses = straight.copy()
    orient(poses, 0.2, OrientationMode.FORWARD_THEN_INTERPOLATE)
    forward = straight.copy()
    orient(forward, 0.2, OrientationMode.FORWARD)
    assert poses[0, 2] == 0.2
    assert poses[1:5, 2] == pytest.approx(forward[1:5, 2])
    last = np.diff(poses[7:, 2])
    assert last == pytest.approx(np.full(len(last), last[0]))
    assert last[0] > 0.0


@pytest.mark.parametrize("mode", list(OrientationMode))
@pytest.mark.parametrize("n", [1, 2, 3])
def test_short_paths(mode: OrientationMode, n: int) -> None:
    poses = CORNER[:n].copy()
    poses[:, 2] = 0.3
    orient(poses, 0.1, mode, 5)
    assert np.isfinite(poses).all()
    assert poses[-1, 2] == pytest.approx(0.3)
