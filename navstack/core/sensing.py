"""What a robot reports: its state and its scans."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core.geometry import Pose2D, Twist2D


class RobotState(NamedTuple):
    """Pose in `frame`, velocity in the robot's own frame, at `stamp` (s)."""

    pose: Pose2D
    velocity: Twist2D = Twist2D()
    stamp: float = 0.0
    frame: str = "odom"


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """One sweep of a planar range finder, as sensor_msgs/LaserScan.

    `ranges` (n,) float32, metres; beam i points along `angle_min + i * angle_increment` (rad) in `frame`. Beams that hit
    nothing are +inf; invalid ones NaN. `height` is the sensor's height above the ground (m), since frames here are planar.
    """

    ranges: NDArray[np.float32]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    stamp: float = 0.0
    frame: str = "base_laser_link"
    topic: str = "scan"
    height: float = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points (n, 3) float32, metres, in `frame` (z above the ground), as sensor_msgs/PointCloud2."""

    points: NDArray[np.float32]
    stamp: float = 0.0
    frame: str = "base_link"
    topic: str = "points"


@dataclass(frozen=True, slots=True)
class RangeReading:
    """One distance of a sonar or infrared sensor, as sensor_msgs/Range: something lies on an arc of `field_of_view` (rad)
    about the x axis of `frame`, `range_m` metres away; nothing within `max_range` when it is that or more.
    """

    range_m: float
    field_of_view: float
    min_range: float
    max_range: float
    stamp: float = 0.0
    frame: str = "sonar_link"
    topic: str = "sonar"


SensorData = LaserScan | PointCloud | RangeReading
