"""Headings survive their quaternion to the bit; transforms in space project to the plane."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navstack.core import FrameTree, Transform2D, normalize_angle
from navstack.ros_messages.messages import StampedTransform, short_decimal
from navstack.ros_messages.transforms import Quaternion, Transform3D, TransformTree, multiply, quaternion_of_yaw, rotate

angles = st.floats(-math.pi, math.pi).map(normalize_angle).filter(lambda yaw: yaw == 0.0 or abs(yaw) > 1e-300)


@pytest.mark.slow
@given(angles)
def test_heading_is_exact(yaw: float) -> None:
    assert quaternion_of_yaw(yaw).yaw == yaw


@pytest.mark.parametrize("yaw", [0.0, math.pi, 0.5 * math.pi, -0.5 * math.pi, 1e-300, math.nextafter(math.pi, 0.0)])
def test_heading_is_exact_at_special_angles(yaw: float) -> None:
    assert quaternion_of_yaw(yaw).yaw == yaw


@given(angles, angles)
def test_product_of_headings(a: float, b: float) -> None:
    both = multiply(quaternion_of_yaw(a), quaternion_of_yaw(b)).yaw
    assert abs(normalize_angle(both - normalize_angle(a + b))) < 1e-12


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: sum(x * x for x in q) > 1e-3))
def test_rotation_keeps_lengths(values: list[float]) -> None:
    x, y, z = rotate(Quaternion(*values).normalized(), (1.0, 2.0, 3.0))
    assert math.hypot(x, y, z) == pytest.approx(math.sqrt(14.0), rel=1e-12)


@pytest.mark.parametrize("resolution", [0.05, 0.025, 0.1, 0.1524, 0.039215])
def test_resolution_of_a_message_is_what_its_author_wrote(resolution: float) -> None:
    assert short_decimal(float(np.float32(resolution))) == resolution


def _static(parent: str, child: str, transform: Transform3D) -> StampedTransform:
    return StampedTransform(parent, child, 0.0, transform)


def test_optical_frame_of_a_camera_is_leveled() -> None:
    frames = TransformTree(FrameTree())
    optical = Quaternion(-0.5, 0.5, -0.5, 0.5)  # z forward, x right, y down
    frames.add_static(
        [
            _static("base_link", "camera", Transform3D(0.2, 0.0, 0.5)),
            _static("camera", "optical", Transform3D(0.0, 0.0, 0.0, optical)),
        ]
    )
    mounting = frames.mounting("optical")
    assert mounting.height == 0.5
    points = mounting.leveled(np.array([[0.0, 0.3, 2.0], [1.0, 0.0, 2.0]], np.float32))
    placed = frames.frames.lookup("base_link", "optical").apply_points(points[:, :2].astype(np.float64))
    # 2 m ahead and 0.3 m below the camera; 2 m ahead and 1 m to the right
    assert placed == pytest.approx(np.array([[2.2, 0.0], [2.2, -1.0]]), abs=1e-6)
    assert points[:, 2] == pytest.approx([0.2, 0.5], abs=1e-6)


def test_upside_down_lidar_has_its_heading_and_height() -> None:
    frames = TransformTree(FrameTree())
    turned = multiply(quaternion_of_yaw(0.7), Quaternion(1.0, 0.0, 0.0, 0.0))
    frames.add_static([_static("base_link", "laser", Transform3D(0.1, -0.2, 0.3, turned))])
    mounting = frames.mounting("laser")
    assert mounting.tilt == pytest.approx(math.pi)
    assert mounting.planar == pytest.approx((0.1, -0.2, 0.7))


def test_static_chain_ends_at_the_frame_that_moves() -> None:
    frames = TransformTree(FrameTree())
    frames.add_static(
        [
            _static("chassis", "laser", Transform3D(0.1, 0.0, 0.2)),
            _static("base_link", "chassis", Transform3D(0.0, 0.0, 0.1, quaternion_of_yaw(math.pi))),
        ]
    )
    frames.add([StampedTransform("odom", "base_link", 1.0, Transform3D(1.0, 0.0, 0.0))])
    assert frames.mounting("laser").parent == "base_link"
    assert frames.mounting("laser").height == pytest.approx(0.3)
    assert frames.frames.lookup("odom", "laser", 1.0) == pytest.approx(Transform2D(0.9, 0.0, math.pi))


def test_a_sensor_on_tf_has_its_height_and_tilt() -> None:
    """static_transform_publisher of tf publishes sensors on /tf; the base itself may be above the ground."""
    frames = TransformTree(FrameTree())
    upside_down = Quaternion(1.0, 0.0, 0.0, 0.0)
    for time in (1.0, 2.0):
        frames.add(
            [
                StampedTransform("odom", "base_footprint", time, Transform3D(time, 0.0, 0.0)),
                StampedTransform("base_footprint", "base_link", time, Transform3D(0.0, 0.0, 0.05)),
                StampedTransform("base_link", "laser", time, Transform3D(0.2, 0.0, 0.25)),
                StampedTransform("base_link", "under", time, Transform3D(0.1, 0.0, 0.1, upside_down)),
            ]
        )
    frames.add_static([StampedTransform("laser", "lens", 0.0, Transform3D(0.0, 0.0, 0.03))])
    assert frames.mounting("laser").height == pytest.approx(0.3) and frames.mounting("laser").tilt == 0.0
    assert frames.mounting("under").height == pytest.approx(0.15) and frames.mounting("under").tilt == pytest.approx(
        math.pi
    )
    lens = frames.mounting("lens")
    assert lens.parent == "laser" and lens.height == pytest.approx(0.33)
    assert frames.mounting("base_footprint").height == 0.0 and frames.mounting("nowhere").height == 0.0
    # another height counts, noise does not
    frames.add([StampedTransform("base_link", "laser", 3.0, Transform3D(0.2, 0.0, 0.45))])
    assert frames.mounting("laser").height == pytest.approx(0.5)
    frames.add([StampedTransform("base_link", "laser", 4.0, Transform3D(0.2, 0.0, 0.4505))])
    assert frames.mounting("laser").height == pytest.approx(0.5)
    frames.forget_moving()
    assert frames.mounting("laser").height == 0.0


@pytest.mark.parametrize(
    ("rotation", "height", "tilt"),
    [
        (Quaternion(), 1.0, 0.0),
        (Quaternion(), -0.5, 0.0),
        (Quaternion(1.0, 0.0, 0.0, 0.0), 0.0, math.pi),  # upside down, about x
        (Quaternion(0.0, 1.0, 0.0, 0.0), 0.0, math.pi),  # upside down, about y
        (Quaternion(math.sin(0.15), 0.0, 0.0, math.cos(0.15)), 0.0, 0.3),
        (Quaternion(0.0, math.sin(0.15), 0.0, math.cos(0.15)), 0.0, 0.3),
    ],
)
def test_height_and_tilt_of_a_frame_on_tf(rotation: Quaternion, height: float, tilt: float) -> None:
    tree = TransformTree(FrameTree())
    tree.add([StampedTransform("base_link", "laser", 1.0, Transform3D(0.1, 0.0, height, rotation))])
    found = tree.mounting("laser")
    assert found.height == height
    assert found.tilt == pytest.approx(tilt)
    # put back on the ground, level
    tree.add([StampedTransform("base_link", "laser", 2.0, Transform3D(0.1, 0.0, 0.0))])
    assert tree.mounting("laser").height == 0.0
    assert tree.mounting("laser").tilt == 0.0


def test_mountings_stay_while_the_robot_drives() -> None:
    tree = TransformTree(FrameTree())
    tree.add_static([_static("base_link", "laser", Transform3D(0.1, 0.0, 0.3))])
    before = tree.mounting("laser")
    for time in (1.0, 2.0):
        tree.add(
            [StampedTransform("odom", "base_link", time, Transform3D(time, 0.5, 0.0, quaternion_of_yaw(0.3 * time)))]
        )
    assert tree.mounting("laser") is before
