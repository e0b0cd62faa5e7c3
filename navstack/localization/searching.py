"""A localizer that notices when it is lost, searches the whole map, and goes on from the pose it finds."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Localizer, PoseEstimate
from navstack.localization.lost import Agreement, LostDetector, LostParams
from navstack.localization.match_map import MatchMap
from navstack.localization.scan_matcher import ScanMatcher, ScanMatcherParams


class SearchingParams(ScanMatcherParams, LostParams):
    """Parameters of the search and of the detection."""

    same_pose_m: float = param(0.5, "a search that ends this near the believed pose confirms it", unit="m", gt=0.0)
    same_pose_rad: float = param(0.3, "the same of the heading", unit="rad", gt=0.0)


class SearchingLocalizer(Localizer):
    """Tracks with another localizer (amcl), and supervises it.

    Every scan is compared with the map from the believed pose (`LostDetector`). While the robot is lost, and after a global
    start, hypotheses from searches over the whole map are tracked separately (`ScanMatcher`); the certain one is handed to
    the tracker. If it is the tracker's own pose, the alarm was false and nothing changes. `details` of the estimate: `lost`,
    `lost_since`, `explained`, `certain`.
    """

    Params: ClassVar[type[ParamModel]] = SearchingParams

    def __init__(self, tracker: Localizer, params: SearchingParams | None = None) -> None:
        self.params = params or SearchingParams()
        self.tracker = tracker
        matcher = {name: getattr(self.params, name) for name in ScanMatcherParams.model_fields}
        self._matcher = ScanMatcher(ScanMatcherParams(**matcher))
        self._detector: LostDetector | None = None
        self._searching = True
        self._globally = True
        self._estimate: PoseEstimate | None = None
        self.alarms: list[Agreement] = []
        """The results at which the robot began to count as lost."""
        self.jumps: list[tuple[float, Pose2D]] = []
        """Stamps and poses at which the tracker was set to a pose that a search found."""

    def set_map(self, grid: OccupancyGrid) -> None:
        """Use this map from now on; the estimate stays."""
        match_map = MatchMap(grid)
        self.tracker.set_map(grid)
        self._matcher.set_match_map(match_map)
        lost = {name: getattr(self.params, name) for name in LostParams.model_fields}
        self._detector = LostDetector(match_map, LostParams(**lost))

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Start from a pose of the base in the map."""
        self.tracker.set_pose(pose, covariance, stamp)
        self._require_map().reset()
        self._searching, self._globally, self._estimate = False, False, None

    def start_globally(self) -> None:
        """Start without knowledge of the pose."""
        self._require_map().reset()
        self._matcher.start_globally()
        self._searching, self._globally, self._estimate = True, True, None

    def request_update(self) -> None:
        """Let the next scan count even if the robot has not moved."""
        self.tracker.request_update()
        self._matcher.request_update()

    @property
    def estimate(self) -> PoseEstimate | None:
        """The last estimate."""
        return self._estimate

    @property
    def lost(self) -> bool:
        """True if the robot does not know where it is: it is lost, or has not found itself since a global start."""
        return self._globally or (self._detector is not None and self._detector.lost)

    @property
    def agreement(self) -> Agreement | None:
        """How the last scan agrees with the map."""
        return None if self._detector is None else self._detector.last

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Process a scan; None if it did not change the estimate."""
        detector = self._require_map()
        if self._globally:
            return self._find(detector, odometry, scan, sensor)
        found = self.tracker.update(odometry, scan, sensor)
        believed = self.tracker.estimate
        if believed is None:
            return None
        was_lost = detector.lost
        result = detector.update(_pose_of(believed.map_to_odom @ odometry), scan, sensor)
        if detector.lost and not was_lost and result is not None:
            self.alarms.append(result)
            self._matcher.start_globally()
            self._searching = True
        if self._searching:
            found = self._search(detector, odometry, scan, sensor) or found
        if found is None and detector.lost == was_lost:
            return None
        latest = found or dataclasses.replace(
            believed, pose=_pose_of(believed.map_to_odom @ odometry), stamp=scan.stamp
        )
        self._estimate = self._with_details(latest)
        return self._estimate

    # --- searching ----------------------------------------------------------------------------------------------------

    def _find(
        self, detector: LostDetector, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate | None:
        """Continue a global start; the best hypothesis is the estimate until one is certain."""
        guess = self._matcher.update(odometry, scan, sensor)
        if guess is not None and self._matcher.is_certain:
            guess = self._hand_over(guess, odometry, scan, sensor)
            self._globally = self._searching = False
            detector.reset()
        if guess is None:
            return None
        self._estimate = self._with_details(guess)
        return self._estimate

    def _search(
        self, detector: LostDetector, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate | None:
        """Continue the search of a lost robot."""
        if not detector.lost:  # the scans agree again
            self._searching = False
            return None
        guess = self._matcher.update(odometry, scan, sensor)
        if guess is None or not self._matcher.is_certain:
            return None
        self._searching = False
        detector.reset()
        believed = self.tracker.estimate
        if believed is not None:
            here = believed.map_to_odom @ odometry
            apart = math.hypot(here.x - guess.pose.x, here.y - guess.pose.y)
            turned = abs(math.remainder(here.yaw - guess.pose.yaw, 2.0 * math.pi))
            if apart < self.params.same_pose_m and turned < self.params.same_pose_rad:
                return None
        return self._hand_over(guess, odometry, scan, sensor)

    def _hand_over(
        self, guess: PoseEstimate, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate:
        """Set the tracker to the certain hypothesis."""
        spread = guess.covariance + np.diag([0.05**2, 0.05**2, 0.03**2])
        self.tracker.set_pose(guess.pose, spread, math.inf)
        self.jumps.append((scan.stamp, guess.pose))
        return self.tracker.update(odometry, scan, sensor) or guess

    def _with_details(self, estimate: PoseEstimate) -> PoseEstimate:
        details = dict(estimate.details)
        details |= {"lost": self.lost, "certain": not self.lost, "searching": self._searching}
        last = self.agreement
        if last is not None:
            details |= {"explained": last.explained, "through": last.through, "lost_since": last.since}
        return dataclasses.replace(estimate, details=details)

    def _require_map(self) -> LostDetector:
        if self._detector is None:
            raise InputError("the localizer has no map; call set_map first")
        return self._detector


def _pose_of(transform: Transform2D) -> Pose2D:
    return Pose2D(*transform)
