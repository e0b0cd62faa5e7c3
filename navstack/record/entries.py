"""Plans and scans of a record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, Pose2D, Transform2D
from navstack.interfaces import LocalPlan


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPlan:
    """A global plan made at `t` (s) for goal number `goal`: poses (n, 3) x, y, yaw in `frame`."""

    t: float
    poses: NDArray[np.float64]
    frame: str
    goal: int


@dataclass(frozen=True, slots=True, eq=False)
class RecordedLocalPlan:
    """A local plan at `t` (s). `plan` has the table of samples in single precision, None if it was not recorded."""

    t: float
    plan: LocalPlan
    tried: int
    """Number of samples of the cycle."""
    rejected: int
    """Number of samples rejected by a critic or a limit."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """A scan taken at `t` (s) with the robot at `pose` in the global frame."""

    t: float
    scan: LaserScan
    """Ranges to the millimetre."""
    pose: Pose2D
    mounting: Transform2D = Transform2D()
    """Pose of the lidar in the base frame."""

    @property
    def base_points(self) -> NDArray[np.float64]:
        """(n, 2) end points of the beams that hit, in the base frame (m)."""
        scan = self.scan
        ranges = scan.ranges.astype(np.float64)
        hit = (ranges >= scan.range_min) & (ranges <= scan.range_max)
        angle = scan.angle_min + scan.angle_increment * np.flatnonzero(hit)
        return self.mounting.apply_points(ranges[hit, None] * np.column_stack((np.cos(angle), np.sin(angle))))

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 2) end points of the beams that hit, in the global frame (m)."""
        return Transform2D(*self.pose).apply_points(self.base_points)
