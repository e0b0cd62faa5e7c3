"""What the user of the stack supplies: a robot, simulated or real."""

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
        """Map -> odom -> base and the sensors, kept up to date by the robot."""
        ...

    def state(self) -> RobotState:
        """Odometry: pose in the odometry frame, velocity in the robot's own."""
        ...

    def scans(self) -> Sequence[SensorData]:
        """What the sensors delivered since the last call, oldest first."""
        ...

    def command(self, twist: Twist2D) -> None:
        """Drive so until told otherwise."""
        ...
