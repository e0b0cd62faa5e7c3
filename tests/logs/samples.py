"""Small logs for tests: strings, scans and transforms on known times, in every format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from navstack.core import LaserScan, Transform2D
from navstack.logs.writer import open_writer, typestore
from navstack.ros_messages import MessageBuilder

START_NS = 1_700_000_000_000_000_000
COUNT = 200
PERIOD_NS = 50_000_000


def scan(index: int) -> LaserScan:
    ranges = np.linspace(1.0, 2.0, 90, dtype=np.float32) + np.float32(0.01 * index)
    return LaserScan(ranges, -0.5, float(np.float32(0.01)), 0.125, 8.0, 0.0, "laser", "scan", 0.2)


def write_sample(path: Path, count: int = COUNT) -> Path:
    """Write `count` transforms and half as many scans, 50 ms apart."""
    target = open_writer(path)
    build = MessageBuilder(target.store, ros1=target.is_ros1)
    with target as writer:
        static = build.transforms([(START_NS, "base_link", "laser", Transform2D(0.1, 0.0, 0.0), 0.2)])
        writer.write("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, static, latched=True)
        for i in range(count):
            now = START_NS + i * PERIOD_NS
            moved = Transform2D(0.01 * i, 0.0, 0.001 * i)
            writer.write(
                "/tf", "tf2_msgs/msg/TFMessage", now, build.transforms([(now, "odom", "base_link", moved, 0.0)])
            )
            if i % 2 == 0:
                writer.write("/scan", "sensor_msgs/msg/LaserScan", now, build.scan(now, scan(i)))
    return path


def write_rosbag2(folder: Path, storage: str, count: int = COUNT) -> Path:
    """Write the same as a ROS 2 bag with rosbags' own writer."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store: Any = typestore(ros1=False)
    build = MessageBuilder(store, ros1=False)
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        transforms = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=store)
        scans = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        for i in range(count):
            now = START_NS + i * PERIOD_NS
            moved = build.transforms([(now, "odom", "base_link", Transform2D(0.01 * i, 0.0, 0.001 * i), 0.0)])
            writer.write(transforms, now, store.serialize_cdr(moved, "tf2_msgs/msg/TFMessage"))
            if i % 2 == 0:
                message = build.scan(now, scan(i))
                writer.write(scans, now, store.serialize_cdr(message, "sensor_msgs/msg/LaserScan"))
    return folder
