from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import FrameTree, Pose2D, Transform2D
from navstack.core.errors import FrameError

coordinates = st.floats(-100, 100)
angles = st.floats(-math.pi, math.pi)
transforms = st.builds(Transform2D, coordinates, coordinates, angles)


def close(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    turn = math.remainder(a[2] - b[2], 2 * math.pi)
    return math.isclose(a[0], b[0], abs_tol=1e-9) and math.isclose(a[1], b[1], abs_tol=1e-9) and abs(turn) < 1e-9


@settings(deadline=None)
@given(transforms, transforms, st.builds(Pose2D, coordinates, coordinates, angles))
def test_composition_and_inverse(ab: Transform2D, bc: Transform2D, pose: Pose2D) -> None:
    assert close((ab @ bc).apply(pose), ab.apply(bc.apply(pose)))
    assert close(ab.inverse().apply(ab.apply(pose)), pose)


def tree() -> FrameTree:
    frames = FrameTree()
    frames.set_static("map", "odom", Transform2D(1.0, 2.0, math.pi / 2))
    frames.set("odom", "base", Transform2D(0.0, 0.0, 0.0), 0.0)
    frames.set("odom", "base", Transform2D(2.0, 0.0, 1.0), 1.0)
    frames.set_static("base", "laser", Transform2D(0.1, 0.0, 0.0))
    return frames


def test_interpolates_between_two_stamps_and_across_the_tree() -> None:
    frames = tree()
    assert close(frames.lookup("odom", "base", 0.5), (1.0, 0.0, 0.5))
    at = frames.lookup("map", "laser", 0.5)
    assert close(at, (1.0 - 0.1 * math.sin(0.5), 3.0 + 0.1 * math.cos(0.5), 0.5 + math.pi / 2))
    back = frames.lookup("laser", "map", 0.5)
    assert close(at @ back, (0.0, 0.0, 0.0))


def test_yaw_interpolates_in_the_shorter_direction() -> None:
    frames = FrameTree()
    frames.set("odom", "base", Transform2D(0, 0, 3.0), 0.0)
    frames.set("odom", "base", Transform2D(0, 0, -3.0), 1.0)
    assert abs(frames.lookup("odom", "base", 0.5).yaw) == pytest.approx(math.pi)


def test_leading_slash_is_ignored() -> None:
    assert tree().lookup("/map", "odom") == Transform2D(1.0, 2.0, math.pi / 2)


def test_lookup_in_the_future_fails_beyond_the_tolerance() -> None:
    frames = tree()
    assert frames.lookup("odom", "base", 1.2, tolerance_s=0.3) == Transform2D(2.0, 0.0, 1.0)
    with pytest.raises(FrameError, match=r"1\.000 s old"):
        frames.lookup("odom", "base", 2.0, tolerance_s=0.3)


def test_newest_common_time() -> None:
    assert tree().latest_stamp("map", "laser") == 1.0
    assert tree().lookup("map", "base").yaw == pytest.approx(1.0 + math.pi / 2)


def test_unconnected_frames_and_loops_are_errors() -> None:
    frames = tree()
    with pytest.raises(FrameError, match="not connected"):
        frames.lookup("map", "moon", 0.0)
    with pytest.raises(FrameError, match="its own ancestor"):
        frames.set_static("laser", "map", Transform2D())


def test_history_is_bounded() -> None:
    frames = FrameTree(history_s=1.0)
    for i in range(10_000):
        frames.set("odom", "base", Transform2D(i * 0.01), i * 0.01)
    assert len(frames._edges["base"].stamps) < 400  # pyright: ignore[reportPrivateUsage]
    with pytest.raises(FrameError, match="known from"):
        frames.lookup("odom", "base", 50.0)


def test_late_transforms_are_inserted_in_order() -> None:
    frames = tree()
    frames.set("odom", "base", Transform2D(9.0, 0.0, 0.5), 0.5)
    assert frames.lookup("odom", "base", 0.25).x == pytest.approx(4.5)


def test_static_transforms_can_be_replaced() -> None:
    frames = FrameTree()
    frames.set_static("map", "odom", Transform2D(1.0, 0.0, 0.0))
    frames.set_static("odom", "base", Transform2D(0.0, 2.0, 0.0))
    assert frames.lookup("map", "base") == frames.lookup("map", "base", 5.0) == Transform2D(1.0, 2.0, 0.0)
    frames.set_static("map", "odom", Transform2D(3.0, 0.0, 0.0))
    assert frames.lookup("map", "base") == frames.lookup("map", "base", 5.0) == Transform2D(3.0, 2.0, 0.0)
