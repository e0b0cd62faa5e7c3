"""The initial pose for a localization, as RViz's "2D Pose Estimate" sends it."""

from __future__ import annotations

import math
import time
from typing import Any, Final

from navstack.core import InputError, Pose2D
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder

POSITION_VARIANCE: Final = 0.25
"""m²."""
YAW_VARIANCE: Final = (math.pi / 12.0) ** 2
"""rad²."""
LINGER_S: Final = 1.0
"""Time for further subscribers to connect (s, wall)."""


def message(build: MessageBuilder, stamp_ns: int, frame: str, pose: Pose2D) -> Any:
    """Return a PoseWithCovarianceStamped with RViz's covariance."""
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = POSITION_VARIANCE
    covariance[35] = YAW_VARIANCE
    made = ros.message("geometry_msgs/PoseWithCovarianceStamped")()
    made.header = build.header(stamp_ns, frame)
    made.pose.pose, made.pose.covariance = build.pose(pose), covariance
    return made


def publish(pose: Pose2D, frame: str, wait_s: float) -> bool:
    """Publish a pose on `initialpose`, latched, once a node has subscribed; return False if none did within `wait_s` (wall).

    Raises InputError without a time.
    """
    rospy = ros.rospy()
    out = rospy.Publisher(
        "initialpose", ros.message("geometry_msgs/PoseWithCovarianceStamped"), queue_size=1, latch=True
    )
    end = time.monotonic() + wait_s
    while not ros.is_stopping() and (out.get_num_connections() == 0 or rospy.Time.now().is_zero()):
        if time.monotonic() > end:
            break
        ros.STOP.wait(0.05)
    if rospy.Time.now().is_zero():
        raise InputError("/use_sim_time is set, but no node publishes /clock; start the simulation first")
    build = MessageBuilder(ros.MessageTypes(), ros1=True)
    out.publish(message(build, int(rospy.Time.now().to_nsec()), frame, pose))
    ros.STOP.wait(LINGER_S)
    found = int(out.get_num_connections()) > 0
    topic = rospy.resolve_name("initialpose")
    if found:
        rospy.loginfo("published x %.3f, y %.3f, yaw %.3f in %s on %s", pose.x, pose.y, pose.yaw, frame, topic)
    else:
        rospy.logwarn("no node subscribes to %s; start the localization first", topic)
    ros.shut_down(lambda: None)
    return found
