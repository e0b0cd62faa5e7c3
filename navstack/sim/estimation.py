"""What the simulated robot believes: its pose in the map from a localizer, its odometry from a filter."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from navstack.core import FrameTree, ImuReading, LaserScan, Pose2D, SensorData, Transform2D, Twist2D
from navstack.core.errors import FrameError
from navstack.interfaces import LocalizationStatus, Localizer, OdometryFilter, PoseEstimate
from navstack.parameters.models.sim import SimParams

GIVEN_COVARIANCE = np.diag([0.01, 0.01, 0.003])
"""Of a pose that a person gives (m², rad²)."""


class Estimation:
    """A localizer and an odometry filter, fed with the simulated sensors; either may be absent."""

    def __init__(
        self,
        localizer: Localizer | None = None,
        odometry: OdometryFilter | None = None,
        believed: Pose2D | None = None,
    ) -> None:
        """The localizer has its map and its first pose; `believed` is where the robot takes itself to be at the start."""
        self._believed = believed
        self.localizer = localizer
        self.odometry = odometry
        self._topic = ""
        self._frames: tuple[str, str, str] = ("map", "odom", "base_link")
        self._unfetched: list[SensorData] = []
        self._correction = Transform2D()

    def begin(self, params: SimParams, frames: tuple[str, str, str], odometry: Transform2D) -> None:
        """Name the frames of map, odometry and base, and the first odometry."""
        self._topic = params.lidar(params.lasers[0]).topic if params.lasers else ""
        self._frames = frames
        if self._believed is not None:
            self._correction = Transform2D(*self._believed) @ odometry.inverse()

    @property
    def correction(self) -> Transform2D:
        """The present transform map -> odom."""
        return self._correction

    @property
    def estimate(self) -> PoseEstimate | None:
        """The localizer's last estimate."""
        return None if self.localizer is None else self.localizer.estimate

    @property
    def status(self) -> LocalizationStatus | None:
        """Whether the robot is localized; None without a localizer that watches it."""
        return None if self.localizer is None else self.localizer.status

    def set_pose(self, pose: Transform2D, odometry: Transform2D) -> None:
        """Set the pose of the base in the map, as a person does."""
        if self.localizer is not None:
            self.localizer.set_pose(Pose2D(*pose), GIVEN_COVARIANCE, math.inf)
            self._correction = pose @ odometry.inverse()

    def process(self, data: Sequence[SensorData], frames: FrameTree) -> bool:
        """Give new scans to the localizer; return True if map -> odom has changed. `fetch` returns the data later."""
        self._unfetched += data
        changed = False
        _, odom, base = self._frames
        if self.localizer is None:
            return False
        for scan in data:
            if not isinstance(scan, LaserScan) or scan.topic != self._topic:
                continue
            try:
                pose = frames.lookup(odom, base, scan.stamp, math.inf)
                sensor = frames.lookup(base, scan.frame)
            except FrameError:
                continue
            found = self.localizer.update(pose, scan, sensor)
            if found is not None:
                self._correction = found.map_to_odom
                changed = True
        return changed

    def fetch(self) -> list[SensorData]:
        """Return the data since the last call."""
        data, self._unfetched = self._unfetched, []
        return data

    def filtered(
        self, wheels: Sequence[Transform2D], stamps: Sequence[float], readings: Sequence[ImuReading]
    ) -> list[Transform2D]:
        """Return the odometry's poses at `stamps` (s) from those of the wheels."""
        return list(wheels) if self.odometry is None else self.odometry.run(wheels, stamps, readings)

    @property
    def twist(self) -> Twist2D | None:
        """Velocity by the filter; None without one."""
        return None if self.odometry is None else self.odometry.twist
