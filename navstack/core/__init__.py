"""Values that every package uses: poses, grids, footprints, scans, frames, events."""

from navstack.core.angles import angle_between, normalize_angle
from navstack.core.costs import FREE, INSCRIBED, LETHAL, UNKNOWN, describe_cost
from navstack.core.events import Event, Listener
from navstack.core.footprint import Footprint
from navstack.core.frames import FrameTree
from navstack.core.geometry import Pose2D, Transform2D, Twist2D
from navstack.core.grid import Bounds, Costmap, GridGeometry, Window
from navstack.core.occupancy import OccupancyGrid
from navstack.core.path import Path
from navstack.core.sensing import (
    DeferredScan,
    ImuReading,
    LaserScan,
    PointCloud,
    RangeReading,
    RobotState,
    SensorData,
)

__all__ = [
    "FREE",
    "INSCRIBED",
    "LETHAL",
    "UNKNOWN",
    "Bounds",
    "Costmap",
    "DeferredScan",
    "Event",
    "Footprint",
    "FrameTree",
    "GridGeometry",
    "ImuReading",
    "LaserScan",
    "Listener",
    "OccupancyGrid",
    "Path",
    "PointCloud",
    "Pose2D",
    "RangeReading",
    "RobotState",
    "SensorData",
    "Transform2D",
    "Twist2D",
    "Window",
    "angle_between",
    "describe_cost",
    "normalize_angle",
]
