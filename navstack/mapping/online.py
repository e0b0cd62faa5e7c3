"""A mapper as a localizer: the robot drives on the map that it makes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from navstack.core import GridGeometry, InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization import LoggedScan
from navstack.logs import GrowingMap, MappingModel, map_from_frames
from navstack.mapping.mapper import Mapper
from navstack.mapping.params import MapperParams
from navstack.plugins import LOCALIZERS, Localizer, ParamModel, PoseEstimate

_BLOCK_M: Final = 2.0
"""The corners of the growing map are multiples of this, so that a costmap is seldom resized."""
_MARGIN_M: Final = 1.0
_MOVED: Final = (0.02, 0.02, 0.01)
"""From this change of the pose of one of its scans on (m, m, rad), the map is drawn from the beginning."""


@LOCALIZERS.register("mapping")
class OnlineMapper(Localizer):
    """Gives every scan to a `Mapper`; its estimate is the mapper's pose. Needs no map, and makes one.

    The frame of the map is that in which the first pose is the given one: a robot that knows where it begins maps in
    coordinates that people know. Without a pose, the first one is the origin.
    """

    Params: ClassVar[type[ParamModel]] = MapperParams

    def __init__(self, params: MapperParams | None = None, *, seed: int = 0) -> None:
        """`seed` is not used: it draws no random numbers."""
        self.mapper = Mapper(params)
        self.start = Transform2D()
        """Pose of the mapper's frame, the first pose of the base, in the map."""
        self._estimate: PoseEstimate | None = None
        self._reach = math.inf
        """Range of the lidar (m); beams without a return are free up to there."""
        self._drawn = np.empty((0, 3))
        """Poses of the scans in the map that grows."""
        self._growing: GrowingMap | None = None

    def set_map(self, grid: OccupancyGrid) -> None:
        """The map is not used: it makes its own."""

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Set the first pose. Later, a given pose is not used: it would tear the map apart.

        Raises InputError for a pose or covariance that is not finite.
        """
        if not pose.is_finite() or not np.isfinite(covariance).all():
            raise InputError(f"the initial pose {tuple(pose)} and its covariance must be finite", argument="pose")
        if self._estimate is None:
            self.start = Transform2D(*pose)

    def start_globally(self) -> None:
        """Nothing is searched: the first pose is the origin of the map, wherever that is."""

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Use a scan; None if it was rejected."""
        self._reach = min(self._reach, float(scan.range_max) - 0.01)
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

    @property
    def pose_entropy(self) -> float | None:
        """Differential entropy (nats) of the last matched pose, normally distributed; None before the first match."""
        edges = [edge for edge in self.mapper.graph.edges[-20:] if not edge.is_loop]
        if not edges:
            return None
        sign, logarithm = np.linalg.slogdet(np.asarray(edges[-1].information, np.float64))
        return float(1.5 * math.log(2.0 * math.pi * math.e) - 0.5 * logarithm) if sign > 0.0 else None

    def frames(self) -> Iterator[LoggedScan]:
        """Yield the scans of the map, with their poses in it as reference."""
        for frame in self.mapper.frames():
            assert frame.reference is not None
            yield replace(frame, reference=self.start.apply(frame.reference))

    def poses(self) -> NDArray[np.float64]:
        """Return the poses (n, 3) of the scans of the map (m, rad)."""
        poses = self.mapper.graph.poses
        return self.start.apply_poses(np.asarray(poses, np.float64).reshape(-1, 3))

    def map(
        self, *, max_range: float = math.inf, clear_without_return: bool = True, radius: float = 0.0
    ) -> OccupancyGrid:
        """Return the map so far, unknown cells within `radius` (m) of where the base has been being free.

        Raises LogError before the first scan.
        """
        model, resolution = self._model(max_range, clear_without_return), self.mapper.params.resolution
        grid = map_from_frames(self.frames, resolution=resolution, model=model)[0]
        return grid if radius <= 0.0 else self._with_way(grid, radius)

    def grown_map(self, radius: float) -> OccupancyGrid | None:
        """Return the map, with unknown space around it, if it has a new scan; see `Localizer.grown_map`."""
        poses, drawn = self.poses(), self._drawn
        if len(poses) == len(drawn):
            return None
        growing = self._growing
        moved = np.abs(poses[: len(drawn)] - drawn)
        if growing is None or (len(drawn) and bool((moved > _MOVED).any())):
            growing, drawn = GrowingMap(self.mapper.params.resolution, self._model(math.inf, True)), drawn[:0]
        for k, frame in enumerate(self.frames()):
            if k >= len(drawn):
                growing.add(frame)
        self._growing, self._drawn = growing, np.concatenate((drawn, poses[len(drawn) :]))
        return padded(self._with_way(growing.grid(), radius), _MARGIN_M, _BLOCK_M)

    def _model(self, max_range: float, clear_without_return: bool) -> MappingModel:
        reach = min(max_range, self._reach, self.mapper.params.max_laser_range)
        return MappingModel(max_range=reach, clear_without_return=clear_without_return)

    def _with_way(self, grid: OccupancyGrid, radius: float) -> OccupancyGrid:
        """Return the map with unknown cells free where the base has been: no sensor sees the place that it stands on."""
        g = grid.geometry
        data = grid.data.copy()
        passed = np.zeros(g.shape, bool)
        here = [] if self._estimate is None else [tuple(self._estimate.pose)[:2]]
        for x, y in (*self.poses()[:, :2].tolist(), *here):
            cell = g.world_to_cell(x, y)
            if cell is not None:
                passed[cell[1], cell[0]] = True
        if passed.any():
            away = np.asarray(ndimage.distance_transform_edt(~passed)) * g.resolution
            data[(data == -1) & (away <= radius + g.resolution)] = 0
        return replace(grid, data=data)


def padded(grid: OccupancyGrid, margin_m: float, block_m: float) -> OccupancyGrid:
    """Return the map with unknown space around it, its corners at multiples of a block (m)."""
    g = grid.geometry
    block = max(1, round(block_m / g.resolution))
    margin = math.ceil(margin_m / g.resolution)
    x0, y0 = round(g.origin_x / g.resolution), round(g.origin_y / g.resolution)
    low_x, low_y = ((v - margin) // block * block for v in (x0, y0))
    high_x, high_y = (-(-(v + margin) // block) * block for v in (x0 + g.nx, y0 + g.ny))
    data = np.full((high_y - low_y, high_x - low_x), -1, np.int8)
    data[y0 - low_y : y0 - low_y + g.ny, x0 - low_x : x0 - low_x + g.nx] = grid.data
    corner = g.origin_x - (x0 - low_x) * g.resolution, g.origin_y - (y0 - low_y) * g.resolution
    return replace(grid, data=data, geometry=GridGeometry(high_x - low_x, high_y - low_y, g.resolution, *corner))
