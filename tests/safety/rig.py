"""A robot in a `FrameTree` and sensor data made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from navstack.core import Footprint, FrameTree, LaserScan, Pose2D, RobotState, SensorData, Transform2D, Twist2D
from navstack.parameters import CollisionMonitorParams, MonitorSourceParams, ZoneParams
from navstack.safety import CollisionMonitor

FOOTPRINT = Footprint(np.array([[0.2, 0.15], [-0.2, 0.15], [-0.2, -0.15], [0.2, -0.15]]))


def frames_at(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, stamp: float = 0.0) -> FrameTree:
    """A tree with the base at a pose in odom and a sensor at the base."""
    tree = FrameTree()
    tree.set("odom", "base", Transform2D(x, y, yaw), stamp)
    tree.set_static("base", "laser", Transform2D())
    return tree


def scan_of(*points: tuple[float, float], stamp: float = 0.0, copies: int = 1, **more: Any) -> LaserScan:
    """A scan with a beam through each point of the sensor frame (m), `copies` times."""
    # one beam per point: of all directions only the given ones are finite
    count = 7200
    ranges = np.full(count * copies, np.inf, np.float32)
    for x, y in points:
        beam = round(np.arctan2(y, x) % (2.0 * np.pi) / (2.0 * np.pi / count)) % count
        for copy in range(copies):
            ranges[beam + copy * count] = np.hypot(x, y)
    return LaserScan(ranges, 0.0, 2.0 * np.pi / count, 0.01, 30.0, stamp, "laser", "scan", **more)


def zone(**values: Any) -> ZoneParams:
    """A zone whose polygon is FOOTPRINT unless given, triggered by one point."""
    if values.get("type", "polygon") == "polygon" and "points" not in values:
        values["points"] = str(FOOTPRINT.vertices.tolist())
    merged: dict[str, Any] = {"min_points": 1, **values}
    return ZoneParams(**merged)


def square(half: float) -> str:
    """The text of a square zone around the base."""
    return str([[half, half], [-half, half], [-half, -half], [half, -half]])


def monitor(
    zones: dict[str, ZoneParams],
    sources: dict[str, MonitorSourceParams] | None = None,
    frames: FrameTree | None = None,
    **values: Any,
) -> CollisionMonitor:
    """A monitor of a robot with FOOTPRINT, with one laser scan as its source unless given."""
    sources = sources or {"scan": MonitorSourceParams()}
    params = CollisionMonitorParams(
        polygons=list(zones), observation_sources=list(sources), blocks={**zones, **sources}, **values
    )
    return CollisionMonitor(
        params, frames=frames or frames_at(), base_frame="base", footprint=FOOTPRINT, padded_footprint=FOOTPRINT
    )


class ScriptedRobot:
    """A robot that obeys at once and returns the sensor data it was given."""

    def __init__(self, frames: FrameTree | None = None) -> None:
        self.frames = frames or frames_at()
        self.commands: list[Twist2D] = []
        self.data: list[SensorData] = []

    def state(self) -> RobotState:
        """The odometry: the last command is the velocity."""
        return RobotState(Pose2D(0.0, 0.0), self.commands[-1] if self.commands else Twist2D())

    def scans(self) -> list[SensorData]:
        """The data since the last call."""
        data, self.data = self.data, []
        return data

    def command(self, twist: Twist2D) -> None:
        """Obey."""
        self.commands.append(twist)
