from __future__ import annotations

import math

from navstack.core import Pose2D, normalize_angle
from navstack.move_base.checks import OscillationChecker, Progress


def test_distance_counts_from_the_last_progress() -> None:
    checker = OscillationChecker(0.2)
    seen = [checker.update(Pose2D(0.05 * k, 0.0)) for k in range(9)]
    assert [k for k, p in enumerate(seen) if p is Progress.MOVED] == [0, 4, 8]
    assert set(seen) == {Progress.MOVED, Progress.NONE}


def test_a_turn_counts_while_headings_are_new() -> None:
    checker = OscillationChecker(0.2)
    checker.update(Pose2D(0.0, 0.0, 0.0))
    seen = [checker.update(Pose2D(0.0, 0.0, normalize_angle(0.1 * k))) for k in range(1, 500)]
    turned = [k + 1 for k, p in enumerate(seen) if p is Progress.TURNED]
    assert turned[0] == 5
    # a full turn in steps of half a radian, then no more
    assert len(turned) == math.ceil(2.0 * math.pi / 0.5)
    assert Progress.MOVED not in seen


def test_swinging_back_and_forth_is_not_progress() -> None:
    checker = OscillationChecker(0.2)
    checker.update(Pose2D(0.0, 0.0, 0.0))
    seen = [checker.update(Pose2D(0.0, 0.0, 0.6 * math.sin(0.3 * k))) for k in range(1, 500)]
    assert sum(p is Progress.TURNED for p in seen) == 2  # once to each side
    assert Progress.TURNED not in seen[30:]


def test_a_motion_allows_another_turn() -> None:
    checker = OscillationChecker(0.2)
    for k in range(200):
        checker.update(Pose2D(0.0, 0.0, normalize_angle(0.1 * k)))
    assert checker.update(Pose2D(0.3, 0.0, 0.0)) is Progress.MOVED
    assert checker.update(Pose2D(0.3, 0.0, 0.6)) is Progress.TURNED


def test_reset() -> None:
    checker = OscillationChecker(0.2)
    checker.update(Pose2D(0.0, 0.0))
    checker.reset()
    assert checker.update(Pose2D(0.01, 0.0)) is Progress.MOVED
