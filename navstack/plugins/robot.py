"""The robot, which the user of navstack supplies.

A robot may also have a property `localization_status -> LocalizationStatus | None`: then the goal manager stops it while it is
lost (`navstack/lost_action`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from navstack.core import (
    FrameTree,
    RobotState,
    SensorData,
    Twist2D,
)


class Robot(Protocol):
    """A robot, simulated or real."""

    @property
    def frames(self) -> FrameTree:
        """The frames map -> odom -> base and those of the sensors, kept up to date by the robot."""
        ...

    def state(self) -> RobotState:
        """Return the odometry: pose in the odometry frame, velocity in the base frame."""
        ...

    def scans(self) -> Sequence[SensorData]:
        """Return the sensor data since the last call, the oldest first."""
        ...

    def command(self, twist: Twist2D) -> None:
        """Drive at this velocity until the next command."""
        ...
