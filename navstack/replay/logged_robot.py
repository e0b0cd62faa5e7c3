"""A robot whose sensor data and odometry come from a log. Its motion is recorded: commands have no effect."""

from __future__ import annotations

from collections.abc import Sequence

from navstack.core import FrameTree, Pose2D, RobotState, SensorData, Twist2D
from navstack.core.errors import NavError
from navstack.move_base.errors import StaleOdometryError


class LoggedRobot:
    """Implements `navstack.interfaces.Robot`; the player of a log fills it."""

    def __init__(self) -> None:
        self.frames = FrameTree()
        self.odometry: RobotState | None = None
        """The newest odometry."""
        self.true_pose: Pose2D | None = None
        """The newest true pose (map frame), if the log has it."""
        self.requested = Twist2D()
        """The newest command of navstack, which has no effect."""
        self.recorded: Twist2D | None = None
        """The newest command in the log."""
        self._scans: list[SensorData] = []

    def add_scan(self, data: SensorData) -> None:
        """Add sensor data, for the next call of `scans`."""
        self._scans.append(data)

    def state(self) -> RobotState:
        """Return the newest odometry. Raises StaleOdometryError before the first one."""
        if self.odometry is None:
            raise StaleOdometryError("no odometry has been received; check the log's topic of odometry")
        return self.odometry

    def scans(self) -> Sequence[SensorData]:
        """Return the sensor data since the last call, in the order of the log."""
        found, self._scans = self._scans, []
        return found

    def command(self, twist: Twist2D) -> None:
        """Keep a command; it has no effect."""
        self.requested = twist

    def pose_in(self, frame: str, base_frame: str) -> Pose2D | None:
        """Return the newest pose of the robot in `frame`; None if it is not known."""
        try:
            return Pose2D(*self.frames.lookup(frame, base_frame))
        except NavError:
            return None
