"""A localizer that notices when it is lost, searches the whole map, and goes on from the pose it finds."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel
from navstack.interfaces import LocalizationStatus, Localizer, PoseEstimate
from navstack.localization.inputs import InputCheck
from navstack.localization.lost import Agreement, LostDetector
from navstack.localization.match_map import MatchMap
from navstack.localization.scan_matcher import ScanMatcher
from navstack.parameters.models.supervision import LostParams, ScanMatcherParams, SearchingParams

_GAIN = 0.1
"""An estimate that jumps must explain this much more of the scan than the pose by the odometry."""
_HANDED = np.diag([0.05**2, 0.05**2, 0.03**2])
"""Added to the covariance of a hypothesis that is handed to the tracker (m², rad²)."""


class SearchingLocalizer(Localizer):
    """Tracks with another localizer (amcl), and supervises it.

    Every scan is compared with the map from the believed pose (`LostDetector`). While the robot is lost, and after a global
    start, hypotheses from searches over the whole map are tracked separately (`ScanMatcher`). Once few remain, the tracker
    gets all of them, with their probabilities; once one is certain, only that one. If it is the tracker's own pose, the alarm
    was false and the pose does not change. `details` of the estimate: `lost`, `lost_since`, `explained`, `certain`, `searching`.
    """

    Params: ClassVar[type[ParamModel]] = SearchingParams

    def __init__(self, tracker: Localizer, params: SearchingParams | None = None) -> None:
        self.params = params or SearchingParams()
        self.tracker = tracker
        matcher = {name: getattr(self.params, name) for name in ScanMatcherParams.model_fields}
        self._matcher = ScanMatcher(ScanMatcherParams(**matcher))
        self._inputs = InputCheck()
        self.rejections = self._inputs.rejections
        """Inputs that were not used, with the reason."""
        self._detector: LostDetector | None = None
        self._searching = True
        self._globally = True
        self._handed = 0
        """Hypotheses that the tracker has; 0 for a pose of its own."""
        self._since: float | None = None
        """Stamp of the first scan of a global start."""
        self._before: Transform2D | None = None
        """map -> odom before the search of a lost robot."""
        self._estimate: PoseEstimate | None = None
        self._accepted: PoseEstimate | None = None
        """The tracker's last estimate that was accepted."""
        self.alarms: list[Agreement] = []
        """The results at which the robot began to count as lost."""
        self.jumps: list[tuple[float, Pose2D]] = []
        """Stamps and poses at which the tracker was set to a pose that a search found."""
        self.rejected: deque[tuple[float, Pose2D]] = deque(maxlen=100)
        """Stamps and poses of the tracker's estimates that were rejected: they jumped and explained the scan no better."""

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
        self._inputs.stamps.clear()
        self._searching = self._globally = False
        self._handed, self._estimate, self._accepted = 0, None, None

    def start_globally(self) -> None:
        """Start without knowledge of the pose."""
        self._require_map().reset()
        if not self.params.search:
            self.tracker.start_globally()
        self._matcher.start_globally()
        self._inputs.stamps.clear()
        self._searching = self._globally = self.params.search
        self._handed, self._estimate, self._accepted, self._since = 0, None, None, None

    def request_update(self) -> None:
        """Let the next scan count even if the robot has not moved."""
        self.tracker.request_update()
        self._matcher.request_update()

    @property
    def estimate(self) -> PoseEstimate | None:
        """The last estimate."""
        return self._estimate

    def possible_poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the hypotheses of a global start, else the poses of the tracker."""
        return (self._matcher if self._globally else self.tracker).possible_poses()

    @property
    def lost(self) -> bool:
        """True if the robot does not know where it is: it is lost, or has not found itself since a global start."""
        return self._globally or self._handed > 0 or (self._detector is not None and self._detector.lost)

    @property
    def agreement(self) -> Agreement | None:
        """How the last scan agrees with the map."""
        return None if self._detector is None else self._detector.last

    @property
    def status(self) -> LocalizationStatus:
        """Whether the robot is lost, and what the last scan says."""
        last = self.agreement
        count = self._matcher.count
        possible = f"{count} pose{'' if count == 1 else 's'} in the map explain{'s' if count == 1 else ''} its scans"
        if self._globally:
            text = "the robot does not know yet where it started" + (f"; {possible}" if self._since is not None else "")
            return LocalizationStatus(True, self._since, None, text)
        if self._handed and self.alarms:
            alarm = self.alarms[-1]
            return LocalizationStatus(True, alarm.since, alarm.explained, f"{alarm.text()}; {possible}")
        if last is None:
            return LocalizationStatus()
        return LocalizationStatus(last.lost, last.since, last.explained, last.text())

    @property
    def hypotheses(self) -> list[tuple[Pose2D, NDArray[np.float64], float]]:
        """The poses of the search, best first: pose, (3, 3) covariance, probability; empty while it does not search."""
        return self._matcher.hypotheses() if self._searching else []

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Process a scan; None if it did not change the estimate. A defective one is rejected with a reason in `rejections`."""
        detector = self._require_map()
        if not self._inputs.accept(odometry, scan, sensor):
            return None
        if self._globally:
            return self._find(detector, odometry, scan, sensor)
        found = self.tracker.update(odometry, scan, sensor)
        if found is not None and self._accepted is not None and not self.lost:
            found = self._plausible(detector, self._accepted, found, odometry, scan, sensor)
        believed = self._accepted = found or self._accepted or self.tracker.estimate
        if believed is None:
            return None
        was_lost = detector.lost
        result = detector.update(_pose_of(believed.map_to_odom @ odometry), scan, sensor, odometry)
        if detector.lost and not was_lost and result is not None and not self._handed:
            self.alarms.append(result)
            self._begin_search(believed, odometry)
        if self._searching:
            found = self._search(detector, odometry, scan, sensor) or found
        if found is None and detector.lost == was_lost:
            return None
        latest = found or dataclasses.replace(
            believed, pose=_pose_of(believed.map_to_odom @ odometry), stamp=scan.stamp
        )
        self._estimate = self._with_details(latest)
        return self._estimate

    def _plausible(
        self,
        detector: LostDetector,
        before: PoseEstimate,
        found: PoseEstimate,
        odometry: Transform2D,
        scan: LaserScan,
        sensor: Transform2D,
    ) -> PoseEstimate:
        """Return the tracker's new estimate; if it jumps to a pose that explains the scan no better, the one by the odometry.

        Random particles of amcl that happen to gather outweigh the true cluster for some scans, for example.
        """
        expected = _pose_of(before.map_to_odom @ odometry)
        if self._same(found.map_to_odom @ odometry, expected):
            return found
        gain = detector.explained_at(found.pose, scan, sensor) - detector.explained_at(expected, scan, sensor)
        if gain > _GAIN:
            return found
        self.rejected.append((scan.stamp, found.pose))
        self.tracker.set_pose(expected, _HANDED, math.inf)
        return dataclasses.replace(found, pose=expected, covariance=_HANDED, map_to_odom=before.map_to_odom)

    # --- searching ----------------------------------------------------------------------------------------------------

    def _begin_search(self, believed: PoseEstimate, odometry: Transform2D) -> None:
        """Search the map for the pose of a lost robot; the believed one is a hypothesis like the others."""
        if not self.params.search:
            return
        self._matcher.start_globally()
        self._matcher.suggest(_pose_of(believed.map_to_odom @ odometry), believed.covariance)
        self._searching, self._before = True, believed.map_to_odom

    def _find(
        self, detector: LostDetector, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate | None:
        """Continue a global start; the best hypothesis is the estimate until one is certain."""
        self._since = scan.stamp if self._since is None else self._since
        guess = self._matcher.update(odometry, scan, sensor)
        if guess is not None and self._matcher.is_certain:
            guess = self._hand_over(guess, odometry, scan, sensor)
            self._globally = self._searching = False
            detector.reset()
        else:
            if guess is not None:
                self._share()
            if self._handed:
                self.tracker.update(odometry, scan, sensor)
        if guess is None:
            return None
        self._estimate = self._with_details(guess)
        return self._estimate

    def _search(
        self, detector: LostDetector, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate | None:
        """Continue the search of a lost robot."""
        if not detector.lost and (not self._handed or self._is_confirmed(odometry)):
            self._searching, self._handed = False, 0  # the scans agree again with the pose before
            return None
        guess = self._matcher.update(odometry, scan, sensor)
        if guess is None:
            return None
        if not self._matcher.is_certain:
            self._share()
            return None
        self._searching = False
        detector.reset()
        believed = self._accepted or self.tracker.estimate
        if believed is not None and self._same(believed.map_to_odom @ odometry, guess.pose):
            self._handed = 0
            return None
        return self._hand_over(guess, odometry, scan, sensor)

    def _is_confirmed(self, odometry: Transform2D) -> bool:
        """Return True if the tracker is back at the pose from before the search."""
        now, before = self.tracker.estimate, self._before
        if now is None or before is None:
            return False
        return self._same(now.map_to_odom @ odometry, _pose_of(before @ odometry))

    def _same(self, one: Transform2D, other: Pose2D) -> bool:
        apart = math.hypot(one.x - other.x, one.y - other.y)
        turned = abs(math.remainder(one.yaw - other.yaw, 2.0 * math.pi))
        return apart < self.params.same_pose_m and turned < self.params.same_pose_rad

    def _share(self) -> None:
        """Hand all possible poses to the tracker if there are few, and others than those that it has."""
        count = self._matcher.count
        if count == 0:
            self._handed = 0
        if count == self._handed or not 1 < count <= self.params.handed_hypotheses:
            return
        poses, covariances, weights = zip(*self._matcher.hypotheses(), strict=True)
        self.tracker.set_hypotheses(list(poses), np.array(covariances) + _HANDED, np.array(weights))
        self._handed, self._accepted = count, None

    def _hand_over(
        self, guess: PoseEstimate, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate:
        """Set the tracker to the certain hypothesis."""
        self.tracker.set_pose(guess.pose, guess.covariance + _HANDED, math.inf)
        self._handed = 0
        self.jumps.append((scan.stamp, guess.pose))
        self._accepted = self.tracker.update(odometry, scan, sensor) or guess
        return self._accepted

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
