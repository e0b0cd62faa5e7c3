"""Localizers: filters that estimate the pose of the robot in a map."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import ImuReading, LaserScan, OccupancyGrid, Pose2D, Transform2D, Twist2D
from navstack.plugins.guards import check_results, number_problem, pose_problem, truth_problem
from navstack.plugins.parameters import ParamModel


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """An estimated pose of the base in the map at `stamp` (s)."""

    pose: Pose2D
    covariance: NDArray[np.float64]
    """(3, 3) of x, y, yaw (m, rad)."""
    map_to_odom: Transform2D
    """Pose of the odometry frame in the map: `map_to_odom @ odometry` is the pose at `stamp`."""
    stamp: float
    details: dict[str, Any] = field(default_factory=dict[str, Any])
    """What the method knows beyond this: number of particles, clusters, notes on defective inputs."""


class LocalizationStatus(NamedTuple):
    """Whether a robot is localized in the map."""

    lost: bool = False
    since: float | None = None
    """Stamp (s) of the first scan that contradicts the believed pose, if the robot is lost."""
    explained: float | None = None
    """Share of the last scan's beams that the map explains from the believed pose; None if it is not known."""
    text: str = ""
    """The same in a sentence, for a log."""


def _estimate_problem(value: Any) -> str:
    if value is None:
        return ""
    if not isinstance(value, PoseEstimate):
        return "which is not a PoseEstimate or None"
    for what, pose in (("pose", value.pose), ("map_to_odom", value.map_to_odom)):
        if problem := pose_problem(pose):
            return problem.replace("which", f"whose {what}")
    covariance: Any = value.covariance
    if not isinstance(covariance, np.ndarray) or covariance.shape != (3, 3) or covariance.dtype.kind != "f":
        return "whose covariance is not an array (3, 3)"
    return number_problem(value.stamp).replace("which", "whose stamp") or (
        "" if math.isfinite(value.stamp) else "whose stamp is not finite"
    )


def _status_problem(value: Any) -> str:
    if value is None:
        return ""
    if not isinstance(value, LocalizationStatus):
        return "which is not a LocalizationStatus or None"
    return truth_problem(value.lost).replace("which", "whose lost")


def _poses_problem(value: Any) -> str:
    if not isinstance(value, tuple) or len(value) != 2 or not all(isinstance(array, np.ndarray) for array in value):
        return "which is not a pair of arrays"
    poses, weights = value
    good = poses.ndim == 2 and poses.shape == (len(weights), 3) and weights.ndim == 1
    good = good and poses.dtype.kind == weights.dtype.kind == "f"
    return "" if good else "which is not an array (n, 3) of poses and one (n,) of weights"


class Localizer(ABC):
    """A localizer takes odometry and scans in the order of their stamps and estimates map -> odom.

    It reads no clock and draws its random numbers from a seed: equal inputs give equal estimates. One that returns anything
    other than its methods promise, or raises, ends the run with an InternalError that names it.
    """

    Params: ClassVar[type[ParamModel]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        estimates = dict.fromkeys(("update", "estimate"), _estimate_problem)
        check_results(cls, {**estimates, "status": _status_problem, "possible_poses": _poses_problem})

    @abstractmethod
    def set_map(self, grid: OccupancyGrid) -> None:
        """Use this map from now on; a localizer that is running keeps its estimate."""

    @abstractmethod
    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Start from the pose of the base in the map at `stamp` (s), with its (3, 3) covariance."""

    @abstractmethod
    def start_globally(self) -> None:
        """Start without knowledge of the pose."""

    @abstractmethod
    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Process a scan. Return the new estimate, None if this scan did not change it.

        `odometry` is the pose of the base in the odometry frame at the scan's stamp, `sensor` the pose of the scan's frame
        in the base frame.
        """

    @property
    @abstractmethod
    def estimate(self) -> PoseEstimate | None:
        """The last estimate; None before the first."""

    @property
    def status(self) -> LocalizationStatus | None:
        """Whether the robot is localized; None (the default) for a localizer that does not watch that."""
        return None

    def set_hypotheses(
        self, poses: Sequence[Pose2D], covariances: NDArray[np.float64], weights: NDArray[np.float64]
    ) -> None:
        """Start from several possible poses of the base in the map, with (n, 3, 3) covariances and (n,) probabilities.

        Default: starts from the most probable one.
        """
        best = int(np.argmax(weights))
        self.set_pose(poses[best], covariances[best], math.inf)

    def possible_poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses of the base in the map that the estimate is made of, (n, 3), and their weights (n,).

        Particles or hypotheses, at the stamp of the estimate. Default: the estimate alone.
        """
        found = self.estimate
        poses = np.empty((0, 3)) if found is None else np.array([tuple(found.pose)], np.float64)
        return poses, np.ones(len(poses))

    def grown_map(self, radius: float) -> OccupancyGrid | None:
        """Return the map that the localizer makes, if it has changed since the last call; None (the default) for no map.

        `radius` (m) is that of the circle in the footprint: cells where the base has been are free.
        """
        return None

    def request_update(self) -> None:
        """Let the next scan count even if the robot has not moved (`request_nomotion_update`). Default: does nothing."""
        return


class OdometryFilter(ABC):
    """Improves the wheels' odometry with inertial sensors."""

    @abstractmethod
    def start(self, stamp: float, pose: Transform2D) -> None:
        """Begin at a pose of the wheels' odometry at `stamp` (s)."""

    @abstractmethod
    def run(
        self, wheels: Sequence[Transform2D], stamps: Sequence[float], readings: Sequence[ImuReading]
    ) -> list[Transform2D]:
        """Return the poses of the base in the odometry frame at `stamps` (s).

        `wheels` are the poses by the wheels alone at these times, `readings` those of the inertial sensor since the last call.
        """

    @property
    @abstractmethod
    def twist(self) -> Twist2D:
        """Velocity in the base frame at the last stamp."""
