"""Monte Carlo localization with the parameters of ROS's amcl."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D, angle_between, normalize_angle
from navstack.localization.inputs import InputCheck, require_covariance
from navstack.localization.particles import Clusters, ParticleSet
from navstack.localization.sensor_model import Readings, SensorModel
from navstack.parameters import AmclParams
from navstack.plugins import LOCALIZERS, Localizer, ParamModel, PoseEstimate

# ----------------------------------------------------------------------------------------------------------------------
# The odometry at the times of the scans.


HISTORY: Final = 600
"""Odometry poses that are kept: a minute at 10 Hz."""


class OdometryHistory:
    """Poses of the base in the odometry frame over time."""

    def __init__(self) -> None:
        self._stamps: deque[float] = deque(maxlen=HISTORY)
        self._poses: deque[Transform2D] = deque(maxlen=HISTORY)

    def add(self, stamp: float, pose: Transform2D) -> None:
        """Append the pose at `stamp` (s); poses that are not older are dropped: a scan was repeated, or time began again."""
        while self._stamps and self._stamps[-1] >= stamp:
            self._stamps.pop()
            self._poses.pop()
        self._stamps.append(stamp)
        self._poses.append(pose)

    def since(self, stamp: float) -> Transform2D:
        """Return the motion of the base from `stamp` (s) to the last pose; none for a stamp outside of the history."""
        if not self._stamps or stamp >= self._stamps[-1] or stamp < self._stamps[0]:
            return Transform2D()
        stamps = list(self._stamps)
        after = bisect.bisect_right(stamps, stamp)
        a, b = self._poses[after - 1], self._poses[after]
        span = stamps[after] - stamps[after - 1]
        share = (stamp - stamps[after - 1]) / span if span > 0.0 else 0.0
        then = Transform2D(
            a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), a.yaw + share * angle_between(a.yaw, b.yaw)
        )
        return then.inverse() @ self._poses[-1]


Array = NDArray[np.float64]


@LOCALIZERS.register("amcl", aliases=("amcl/amcl", "nav2_amcl/AmclNode"))
class Amcl(Localizer):
    """A particle filter over the pose of the base in a map.

    Scans count once the robot has moved by `update_min_d` or `update_min_a`; `resample_interval` updates later the particles are
    redrawn and the estimate changes. Dieter Fox et al.: Monte Carlo Localization (1999); Probabilistic Robotics, chapter 8.
    Deliberate differences from noetic's amcl are on the parity page; `ros_defects` switches them off.
    """

    Params: ClassVar[type[ParamModel]] = AmclParams

    def __init__(self, params: AmclParams, *, seed: int = 0) -> None:
        """`seed` applies if `random_seed` is negative."""
        self.params = params
        self.particles = ParticleSet(params, params.random_seed if params.random_seed >= 0 else seed)
        self._inputs = InputCheck()
        self.rejections = self._inputs.rejections
        """Inputs that were not used, with the reason."""
        self._per_axis = "axis_threshold" in params.ros_defects
        self._alphas = np.array(params.alphas)
        self._model: SensorModel | None = None
        self._free = np.empty((0, 2), np.int32)
        self._history = OdometryHistory()
        self._pending: tuple[Pose2D | None, Array, float] | None = self._first_pose()
        self._forced = False
        self._last: Transform2D | None = None
        self._due: dict[str, bool] = {}
        self._updates = 0
        self._estimate: PoseEstimate | None = None

    def _first_pose(self) -> tuple[Pose2D, Array, float]:
        params = self.params
        variances = params.initial_cov_xx, params.initial_cov_yy, params.initial_cov_aa
        return Pose2D(*params.start), np.diag(variances), math.inf

    # --- inputs of the filter --------------------------------------------------------------------------------------

    @property
    def estimate(self) -> PoseEstimate | None:
        """The last estimate; None before the first."""
        return self._estimate

    @property
    def updates(self) -> int:
        """Number of scans that have weighed the particles since the start."""
        return self._updates

    @property
    def sensor_model(self) -> SensorModel | None:
        """The likelihood of scans on the current map."""
        return self._model

    def set_map(self, grid: OccupancyGrid) -> None:
        """Use this map from now on; the particles stay. Raises InputError for a map without free cells."""
        free = np.argwhere(grid.data.T == 0).astype(np.int32)
        if not len(free):
            raise InputError("the map has no free cell; localization needs one", argument="grid")
        self._model = SensorModel(self.params, grid)
        self._free = np.ascontiguousarray(free)
        self._due.clear()
        if self._pending is None:
            # ROS differs: the estimate survives a new map
            self._forced |= self.params.force_update_after_set_map

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Restart from a normal distribution, as the topic `initialpose` does.

        The motion from `stamp` (s) to the last scan is added; math.inf for now. Raises InputError for a pose that is not finite
        and for a covariance that is not symmetric or has a negative eigenvalue.
        """
        self._pending = pose, require_covariance(pose, covariance), stamp
        self._forced |= self.params.force_update_after_initialpose
        if self._model is not None:
            self._begin()

    def start_globally(self) -> None:
        """Spread the particles over all free cells (`global_localization`)."""
        self._pending = None, np.zeros((3, 3)), math.inf
        if self._model is not None:
            self._begin()

    def possible_poses(self) -> tuple[Array, Array]:
        """Return the particles (n, 3) and their weights (n,)."""
        return self.particles.poses.copy(), self.particles.weights.copy()

    def put_particles(self, poses: Array, weights: Array) -> None:
        """Start from these poses (n, 3) with `weights` (n,), as a search over the map finds them."""
        self.particles.put(poses[: self.params.max_particles], weights[: self.params.max_particles])
        self._pending = None
        self._restart()

    def set_hypotheses(self, poses: Sequence[Pose2D], covariances: Array, weights: Array) -> None:
        """Start from several poses: each gets particles by its probability, at least one."""
        if self._model is None:
            raise InputError("the localizer has no map; call set_map first")
        share = np.asarray(weights, np.float64) / float(np.sum(weights))
        counts = np.maximum(1, np.floor(share * (self.params.max_particles - len(poses))).astype(np.intp))
        drawn: list[Array] = []
        for pose, covariance, count in zip(poses, covariances, counts.tolist(), strict=True):
            self.particles.draw_gaussian(pose, require_covariance(pose, covariance))
            drawn.append(self.particles.poses[:count].copy())
        self.put_particles(np.concatenate(drawn), np.repeat(share / counts, counts))

    def request_update(self) -> None:
        """Use the next scan even if the robot has not moved."""
        self._forced = True

    # --- scans --------------------------------------------------------------------------------------------------------

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Process a scan; see `Localizer.update`. A defective input is rejected with a reason in `rejections`."""
        if not self._inputs.accept(odometry, scan, sensor):
            return None
        self._history.add(scan.stamp, odometry)
        model = self._model
        if model is None:
            self._inputs.reject(scan.stamp, "there is no map yet; call set_map")
            return None
        if self._pending is not None:
            self._begin()
            self._inputs.stamps[scan.frame] = scan.stamp
        first = self._last is None
        self._move(odometry, first)
        resampled = False
        if first or self._due.pop(scan.frame, False):
            resampled = self._weigh(model, scan, sensor, first)
            self._last = odometry
        if first or resampled:
            return self._publish(odometry, scan.stamp)
        return None

    def _move(self, odometry: Transform2D, first: bool) -> None:
        """Move the particles if the robot has moved enough, and let every laser's next scan count."""
        if first:
            self._due = dict.fromkeys(self._inputs.stamps, True)
            return
        last = self._last
        assert last is not None
        dx, dy, dyaw = odometry.x - last.x, odometry.y - last.y, angle_between(last.yaw, odometry.yaw)
        # ROS differs: the distance counts, not the larger of its components
        moved = max(abs(dx), abs(dy)) if self._per_axis else math.hypot(dx, dy)
        if not (moved > self.params.update_min_d or abs(dyaw) > self.params.update_min_a or self._forced):
            return
        self._forced = False
        self.particles.move(np.array([dx, dy, dyaw]), last.yaw, self._alphas, self.params.odom_model_type)
        self._due = dict.fromkeys(self._inputs.stamps, True)
        self._last = odometry

    def _weigh(self, model: SensorModel, scan: LaserScan, sensor: Transform2D, first: bool) -> bool:
        """Weigh the particles by a scan; return True if they were resampled, or count as if."""
        del first
        particles = self.particles
        readings = Readings.of(scan, sensor, self.params)
        factors = model.factors(particles.poses, readings, converged=particles.converged)
        if not particles.weigh(factors):
            self._inputs.reject(scan.stamp, "the scan fits no particle: all weights are equal now")
        self._updates += 1
        if self._updates % self.params.resample_interval:
            return False
        if self.params.selective_resampling and particles.effective > 0.5 * particles.count:
            return True
        particles.resample(self._free, self._cell_origin(), model.place.cell)
        return True

    def _publish(self, odometry: Transform2D, stamp: float) -> PoseEstimate:
        clusters = self.particles.clusters()
        pose = clusters.pose
        pose = Pose2D(pose.x, pose.y, normalize_angle(pose.yaw))
        map_to_odom = Transform2D(*pose) @ odometry.inverse()
        self._estimate = PoseEstimate(pose, clusters.covariance, map_to_odom, stamp, self._details(clusters))
        return self._estimate

    def _details(self, clusters: Clusters) -> dict[str, object]:
        return {
            "particles": self.particles.count,
            "clusters": len(clusters.weights),
            "cluster_weight": float(clusters.weights[0]),
            "cluster_covariance": clusters.covariances[0],
            "injected": self.particles.injected,
            "effective": self.particles.effective,
            "turn": self.particles.turn,
        }

    # --- start --------------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Draw the particles of the pose, or the whole map, that was set."""
        assert self._pending is not None
        assert self._model is not None
        (pose, covariance, stamp), self._pending = self._pending, None
        if pose is None:
            self.particles.draw_uniform(self._free, self._cell_origin(), self._model.place.cell)
        else:
            motion = self._history.since(stamp)
            self.particles.draw_gaussian(Transform2D(*pose).apply(Pose2D(*motion)), covariance)
        self._restart()

    def _restart(self) -> None:
        # the scan to which the new pose belongs may be given once more: without it, the motion up to the next one would be lost
        self._inputs.stamps = dict.fromkeys(self._inputs.stamps, -math.inf)
        self._last = None
        self._updates = 0

    def _cell_origin(self) -> tuple[float, float]:
        """Return the point (m) of the cell (0, 0): its center, or its corner as in amcl."""
        assert self._model is not None
        place = self._model.place
        shift_x, shift_y = place.shift_x, place.shift_y
        if shift_x == 0.0:
            return place.center_x + 0.5 * place.cell, place.center_y + 0.5 * place.cell
        return place.center_x - (shift_x - 0.5) * place.cell, place.center_y - (shift_y - 0.5) * place.cell
