"""A mapper as a localizer: the robot drives on the map that it makes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization import LoggedScan
from navstack.logs import MappingModel, map_from_frames
from navstack.mapping.mapper import Mapper
from navstack.mapping.params import MapperParams
from navstack.plugins import Localizer, ParamModel, PoseEstimate


class OnlineMapper(Localizer):
    """Gives every scan to a `Mapper`; its estimate is the mapper's pose. Needs no map.

    The frame of the map is that in which the first pose is `start`: a robot that knows where it begins maps in coordinates
    that people know.
    """

    Params: ClassVar[type[ParamModel]] = MapperParams

    def __init__(self, params: MapperParams | None = None, *, start: Pose2D | None = None, seed: int = 0) -> None:
        """`seed` is not used: it draws no random numbers."""
        self.mapper = Mapper(params)
        self.start = Transform2D(*(start or Pose2D(0.0, 0.0)))
        """Pose of the mapper's frame, the first pose of the base, in the map."""
        self._estimate: PoseEstimate | None = None

    def set_map(self, grid: OccupancyGrid) -> None:
        """The map is not used: it makes its own."""

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Set the first pose. Later, a given pose is not used: it would tear the map apart."""
        if self._estimate is None and pose.is_finite():
            self.start = Transform2D(*pose)

    def start_globally(self) -> None:
        """Nothing is searched: the first pose is the origin of the map, wherever that is."""

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Use a scan; None if it was rejected."""
        made = self.mapper.add_scan(scan.stamp, odometry, scan, sensor)
        pose = self.mapper.pose
        if made.rejected or pose is None:
            return None
        here = self.start.apply(pose)
        covariance = np.diag([0.05**2, 0.05**2, 0.02**2])
        details = {
            "keyframes": self.keyframes,
            "response": made.response,
        }
        self._estimate = PoseEstimate(here, covariance, Transform2D(*here) @ odometry.inverse(), scan.stamp, details)
        return self._estimate

    @property
    def estimate(self) -> PoseEstimate | None:
        """The last estimate."""
        return self._estimate

    @property
    def keyframes(self) -> int:
        """Number of scans in the map."""
        return len(self.mapper.keyframes)

    def frames(self) -> Iterator[LoggedScan]:
        """Yield the scans of the map, with their poses in it as reference."""
        for frame in self.mapper.frames():
            assert frame.reference is not None
            yield replace(frame, reference=self.start.apply(frame.reference))

    def poses(self) -> NDArray[np.float64]:
        """Return the poses (n, 3) of the scans of the map (m, rad)."""
        poses = self.mapper.graph.poses
        return self.start.apply_poses(np.asarray(poses, np.float64).reshape(-1, 3))

    def map(self, *, max_range: float = math.inf, clear_without_return: bool = True) -> OccupancyGrid:
        """Return the map so far. Raises LogError before the first scan."""
        params = self.mapper.params
        reach = min(max_range, params.max_laser_range)
        model = MappingModel(max_range=reach, clear_without_return=clear_without_return)
        return map_from_frames(self.frames, resolution=params.resolution, model=model)[0]
