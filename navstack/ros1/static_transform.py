"""static_transform_publisher of tf: one fixed transform on /tf, again and again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from navstack.core import InputError, clean_frame
from navstack.ros1 import ros
from navstack.ros_messages import Quaternion, multiply, quaternion_of_yaw

USAGE = "x y z yaw pitch roll FRAME CHILD PERIOD_MS, or x y z qx qy qz qw FRAME CHILD PERIOD_MS"


class FixedTransform(NamedTuple):
    """What is published, and how often."""

    translation: tuple[float, float, float]
    rotation: Quaternion
    frame: str
    child: str
    period_s: float
    """0: once, latched on /tf_static, as tf2_ros's program does without a period."""


def parse(words: Sequence[str]) -> FixedTransform:
    """Return the transform of the arguments of tf's or tf2_ros's static_transform_publisher. Raises InputError."""
    values: list[float] = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            break
    names = list(words[len(values) :])
    if len(values) not in (6, 7) or not 2 <= len(names) <= 3 or not all(map(math.isfinite, values)):
        raise InputError(f'"{" ".join(words)}" is no transform; give {USAGE}')
    try:
        period = float(names[2]) / 1000.0 if len(names) == 3 else 0.0
    except ValueError:
        period = math.nan
    if not 0.0 <= period <= 3600.0:
        raise InputError(f'the period "{names[2]}" is not a time in milliseconds')
    rotation = _of_angles(*values[3:]) if len(values) == 6 else Quaternion(*values[3:])
    if not rotation.is_valid:
        raise InputError(f"the quaternion {tuple(rotation)} is not a rotation")
    frame, child = clean_frame(names[0]), clean_frame(names[1])
    if frame == child:
        raise InputError(f'"{frame}" cannot be its own child')
    return FixedTransform((values[0], values[1], values[2]), rotation.normalized(), frame, child, period)


def _of_angles(yaw: float, pitch: float, roll: float) -> Quaternion:
    """Return the rotation by roll about x, then pitch about y, then yaw about z (rad)."""
    about_x = Quaternion(math.sin(0.5 * roll), 0.0, 0.0, math.cos(0.5 * roll))
    about_y = Quaternion(0.0, math.sin(0.5 * pitch), 0.0, math.cos(0.5 * pitch))
    return multiply(quaternion_of_yaw(yaw), multiply(about_y, about_x))


def spin(given: FixedTransform) -> None:
    """Publish until the node is shut down. As in tf, a transform is stamped one period ahead."""
    rospy = ros.rospy()
    is_static = given.period_s == 0.0
    tf = ros.message("tf2_msgs/TFMessage")
    out = rospy.Publisher("/tf_static" if is_static else "/tf", tf, queue_size=100, latch=is_static)
    stamped = ros.message("geometry_msgs/TransformStamped")()
    stamped.header.frame_id, stamped.child_frame_id = given.frame, given.child
    at, turn = stamped.transform.translation, stamped.transform.rotation
    at.x, at.y, at.z = given.translation
    turn.x, turn.y, turn.z, turn.w = given.rotation
    while not ros.is_stopping():
        stamped.header.stamp = rospy.Time.now() + rospy.Duration(given.period_s)
        out.publish(tf([stamped]))
        if is_static:
            while not ros.is_stopping():
                ros.STOP.wait(0.1)
        ros.STOP.wait(given.period_s)
    ros.shut_down(lambda: None)
