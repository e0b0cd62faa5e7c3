"""Localization by the odometry alone: what a localizer must be better than."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.plugins import LOCALIZERS, Localizer, ParamModel, PoseEstimate


class DeadReckoningParams(ParamModel):
    """It has no parameters."""


@LOCALIZERS.register("dead_reckoning")
class DeadReckoning(Localizer):
    """Moves the first pose by the odometry and uses no scan. It cannot start globally."""

    Params: ClassVar[type[ParamModel]] = DeadReckoningParams

    def __init__(self, params: ParamModel | None = None, *, seed: int = 0) -> None:
        self.params = params or DeadReckoningParams()
        self._given: tuple[Pose2D, NDArray[np.float64]] | None = None
        self._map_to_odom: Transform2D | None = None
        self._covariance = np.zeros((3, 3))
        self._estimate: PoseEstimate | None = None

    def set_map(self, grid: OccupancyGrid) -> None:
        """The map is not used."""

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Start from a pose. Raises InputError for one that is not finite."""
        if not pose.is_finite() or not np.isfinite(covariance).all():
            raise InputError(f"the initial pose {tuple(pose)} and its covariance must be finite", argument="pose")
        self._given = (pose, np.asarray(covariance, np.float64))
        self._map_to_odom = self._estimate = None

    def start_globally(self) -> None:
        """Forget the pose: there is no estimate until one is given."""
        self._given = self._map_to_odom = self._estimate = None

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Return the pose by the odometry; None before a pose was given, and for defective or old input."""
        if not all(map(math.isfinite, (*odometry, scan.stamp))):
            return None
        if self._estimate is not None and scan.stamp <= self._estimate.stamp:
            return None
        if self._given is not None:
            pose, self._covariance = self._given
            self._map_to_odom, self._given = Transform2D(*pose) @ odometry.inverse(), None
        if self._map_to_odom is None:
            return None
        here = Pose2D(*(self._map_to_odom @ odometry))
        self._estimate = PoseEstimate(here, self._covariance, self._map_to_odom, scan.stamp)
        return self._estimate

    @property
    def estimate(self) -> PoseEstimate | None:
        """The last estimate."""
        return self._estimate
