"""Bags of drives written for tests: the same drive as the CARMEN logs, with what only bags have."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D, Twist2D
from navstack.logs.writer import open_writer
from navstack.ros_messages import MessageBuilder
from tests.localization.rooms import scan_from

START_NS = 1_700_000_000_000_000_000
STEP_S = 0.5
"""Time between two scans."""
SENSOR = Transform2D(0.1, 0.05, 0.3)
"""Pose of the lidar, which is mounted upside down."""


def reversed_scan(scan: LaserScan) -> LaserScan:
    """The same scan by a lidar that turns the other way."""
    last = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
    return dataclasses.replace(scan, ranges=np.ascontiguousarray(scan.ranges[::-1]), angle_min=-last)


def write_bag(
    path: Path,
    grid: OccupancyGrid,
    truths: list[Transform2D],
    *,
    drift: float = 0.02,
    tf: bool = True,
    truth: bool = True,
    localized: bool = False,
    odometry: bool = True,
    poses: str = "",
    static: bool = True,
    scan_topics: tuple[str, ...] = ("/scan",),
) -> Path:
    """Scans every half second; the odometry comes between them, after the scans of its time; see `odometry_of`.

    `poses`: where the true pose of the base in the map is besides, `tf` or a topic.
    """
    target = open_writer(path)
    build = MessageBuilder(target.store, ros1=target.is_ros1)
    odometry_poses = odometry_of(truths, drift=drift)
    with target as writer:
        mounted = build.transforms([(START_NS, "base_link", "laser", SENSOR, 0.2)])
        quaternion = mounted.transforms[0].transform.rotation
        half = 0.5 * SENSOR.yaw
        # about z by the yaw, then half a turn about x
        quaternion.x, quaternion.y, quaternion.z, quaternion.w = np.cos(half), np.sin(half), 0.0, 0.0
        if static:
            writer.write("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, mounted, latched=True)
        # what an exported run has besides: the fields of its scans in double precision
        fields = scan_from(grid, truths[0], sensor=SENSOR, reach=20.0)
        fields = reversed_scan(fields)
        names = ("angle_min", "angle_increment", "range_min", "range_max")
        exact = {topic: {name: getattr(fields, name) for name in names} for topic in scan_topics}
        text = build.of("std_msgs/msg/String", data=json.dumps({"scans": exact}))
        writer.write("/navstack/sensors", "std_msgs/msg/String", START_NS, text, latched=True)
        writer.write("/map", "nav_msgs/msg/OccupancyGrid", START_NS, build.map(START_NS, grid), latched=True)
        for i, at in enumerate(truths):
            stamp = START_NS + round(i * STEP_S * 1e9)
            scan = reversed_scan(scan_from(grid, at, sensor=SENSOR, reach=20.0))
            scan = dataclasses.replace(scan, frame="laser")
            for topic in scan_topics:
                writer.write(topic, "sensor_msgs/msg/LaserScan", stamp, build.scan(stamp, scan))
            # two poses of the odometry around the scan: the one at its stamp is halfway between them
            for late_s, pose in ((-0.1, _before(odometry_poses[i])), (0.1, _after(odometry_poses[i]))):
                now = stamp + round(late_s * 1e9)
                sent = stamp + round(abs(late_s) * 1e9) + 1
                if tf:
                    items = [(now, "odom", "base_link", pose, 0.0)]
                    if localized:
                        items.append((now, "map", "odom", at @ odometry_poses[i].inverse(), 0.0))
                    writer.write("/tf", "tf2_msgs/msg/TFMessage", sent, build.transforms(items))
                elif odometry:
                    message = build.odometry(now, "odom", "base_link", Pose2D(*pose), Twist2D())
                    writer.write("/odom", "nav_msgs/msg/Odometry", sent, message)
            if poses == "tf":
                items = [(stamp, "map", "base_link", at, 0.0)]
                writer.write("/tf", "tf2_msgs/msg/TFMessage", stamp + 3, build.transforms(items))
            elif poses == "/amcl_pose":
                with_covariance = build.of(
                    "geometry_msgs/msg/PoseWithCovariance", pose=build.pose(Pose2D(*at)), covariance=np.zeros(36)
                )
                message = build.of(
                    "geometry_msgs/msg/PoseWithCovarianceStamped",
                    header=build.header(stamp, "map"),
                    pose=with_covariance,
                )
                writer.write(poses, "geometry_msgs/msg/PoseWithCovarianceStamped", stamp + 3, message)
            if truth or poses == "/base_pose_ground_truth":
                message = build.odometry(stamp, "map", "base_link", Pose2D(*at), Twist2D())
                writer.write("/base_pose_ground_truth", "nav_msgs/msg/Odometry", stamp + 3, message)
    return path


def odometry_of(truths: list[Transform2D], *, drift: float) -> list[Transform2D]:
    """The odometry at the scans: the true steps, each turned by `drift` (rad) too much."""
    poses = [Transform2D()]
    for before, after in itertools.pairwise(truths):
        step = before.inverse() @ after
        poses.append(poses[-1] @ Transform2D(step.x, step.y, step.yaw + drift))
    return poses


def _before(pose: Transform2D) -> Transform2D:
    return Transform2D(pose.x - 0.03, pose.y + 0.01, pose.yaw - 0.02)


def _after(pose: Transform2D) -> Transform2D:
    return Transform2D(pose.x + 0.03, pose.y - 0.01, pose.yaw + 0.02)
