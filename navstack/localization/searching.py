"""A localizer that notices when it is lost, searches the whole map, and goes on from the pose it finds."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization.global_search import Beams, MatchMap, continuity, scan_beams
from navstack.localization.hypotheses import Frame, Hypotheses, MatchSettings, agreement, refine
from navstack.localization.inputs import InputCheck
from navstack.localization.scan_matcher import ScanMatcher
from navstack.parameters import LostParams, ScanMatcherParams, SearchingParams
from navstack.plugins import LocalizationStatus, Localizer, ParamModel, PoseEstimate

# ----------------------------------------------------------------------------------------------------------------------
# Lost or not: how well the scans agree with the map from the believed pose, summed until it cannot be chance.


_PROFILE: Final = 180
"""Beams of the scan before."""
_LARGEST_STEP_M: Final = 0.5
"""After a larger step, scans are not compared with each other: too much that was hidden is seen."""
_LARGEST_STEP_RAD: Final = 0.8


@dataclass(frozen=True, slots=True)
class Agreement:
    """How the last scan agrees with the map, and what all scans say."""

    stamp: float
    explained: float
    """Share of the returns that end at an obstacle of the map, with nothing before it, from the believed pose or next to it."""
    through: float
    """Share of the returns behind an obstacle of the map."""
    unexpected: float
    """Share of the returns in free space: people, changed furniture, or a wrong pose."""
    correction: float
    """Distance to the pose next to the believed one that explains the scan best (m)."""
    continuous: float | None
    """Share of the beams that agree with the scan before; None if they cannot be compared."""
    evidence: float
    """Sum of the missing shares (CUSUM); the robot is lost from `lost_evidence` on."""
    lost: bool
    carried: bool
    """A scan did not follow from the one before, and the believed pose has not been confirmed since."""
    since: float | None
    """Stamp of the scan at which the sum began to grow, if the robot is lost."""

    def text(self) -> str:
        """Return one sentence for a log."""
        if not self.lost:
            return f"the map explains {self.explained:.0%} of the scan"
        began = "" if self.since is None else f" since {self.since:.1f} s"
        jump = ", after a scan that does not follow from the one before" if self.carried else ""
        return (
            f"lost{began}: from the believed pose the map explains {self.explained:.0%} of the scan, {self.through:.0%} passes "
            f"through walls, {self.unexpected:.0%} ends in free space{jump}"
        )


class Match(NamedTuple):
    """The pose around a believed one that explains a scan best."""

    pose: Pose2D
    covariance: NDArray[np.float64]
    """(3, 3), m and rad."""
    explained: float
    """Share of the returns that the map explains."""
    gain: float
    """Logarithm of the likelihood, less that of the believed pose."""


class LostDetector:
    """Sums evidence against the believed pose (CUSUM: Page, Continuous Inspection Schemes, Biometrika 1954).

    Each scan adds `lost_explained` minus its explained share; the sum never falls below 0. Chance and people raise it for a few
    scans, a wrong pose with every scan.

    Each scan is also compared with the one before, moved by the odometry. If they do not fit together, the robot may have been
    carried away: from then on, a sequential test decides between the believed pose and another one. It starts at 0.8 of the
    threshold, its scans count against `lost_explained_then`, and it ends at the threshold (lost) or at 0 (confirmed).
    """

    def __init__(self, match_map: MatchMap | OccupancyGrid, params: LostParams | None = None) -> None:
        self.params = params or LostParams()
        self.map = match_map if isinstance(match_map, MatchMap) else MatchMap(match_map)
        self._settings = MatchSettings()
        self._match = self._settings.match(self.map.resolution, 0.2, 0.1)
        self._agree = self._settings.agree(self.map.resolution)
        self._last: Agreement | None = None
        self._began: float | None = None
        self._before: tuple[Beams, Transform2D] | None = None

    @property
    def last(self) -> Agreement | None:
        """The last result; None before the first scan."""
        return self._last

    @property
    def lost(self) -> bool:
        """True if the robot is lost."""
        return self._last is not None and self._last.lost

    def reset(self) -> None:
        """Forget the evidence, for example after a new pose."""
        self._last, self._began, self._before = None, None, None

    def update(
        self, pose: Pose2D, scan: LaserScan, sensor: Transform2D, odometry: Transform2D | None = None
    ) -> Agreement | None:
        """Compare a scan with the map from the believed `pose` of the base (map frame) at its stamp.

        With `odometry`, the pose of the base in the odometry frame, it is compared with the scan before as well. Returns the last
        result for a scan that does not count: too soon without a large step, or with hardly a return.
        """
        p, last = self.params, self._last
        soon = last is not None and 0.0 <= scan.stamp - last.stamp < p.lost_interval - 1e-6
        if soon and not self.has_stepped(odometry):
            return last
        every = scan_beams(scan, sensor, self.map.reach)
        beams = every.thinned(p.lost_beams)
        if not pose.is_finite() or len(beams.points) < p.lost_beams // 6:
            return last
        continuous = self._continuity(every, beams, odometry)
        (explained, unexpected, through), moved = self._explained(pose, beams)
        evidence = 0.0 if last is None else last.evidence
        carried = last is not None and last.carried
        if continuous is not None and continuous < p.lost_continuous:
            carried, evidence = True, max(evidence, 0.8 * p.lost_evidence)
        reference = p.lost_explained_then if carried else p.lost_explained
        # no more than one threshold above the alarm, so that a pose that is right again is believed soon
        evidence = min(max(0.0, evidence + reference - explained), 2.0 * p.lost_evidence)
        if evidence == 0.0:
            self._began, carried = None, False
        elif self._began is None:
            self._began = scan.stamp
        lost = evidence >= p.lost_evidence or (last is not None and last.lost and evidence > 0.0)
        since = self._began if lost else None
        self._last = Agreement(
            scan.stamp, explained, through, unexpected, moved, continuous, evidence, lost, carried, since
        )
        return self._last

    def explained_at(self, pose: Pose2D, scan: LaserScan, sensor: Transform2D) -> float:
        """Return the share of the scan's returns that the map explains from a pose or one next to it; 0 without returns."""
        beams = scan_beams(scan, sensor, self.map.reach).thinned(self.params.lost_beams)
        if not pose.is_finite() or len(beams.points) == 0:
            return 0.0
        return self._explained(pose, beams)[0][0]

    def matched(self, pose: Pose2D, scan: LaserScan, sensor: Transform2D) -> Match | None:
        """Return the pose within 0.9 m and 0.6 rad of the believed `pose` that explains the scan best; None without returns."""
        beams = scan_beams(scan, sensor, self.map.reach).thinned(self.params.lost_beams)
        if not pose.is_finite() or len(beams.points) == 0:
            return None
        around = Hypotheses(self.map, self._settings, window=2)
        around.start(pose, np.eye(3))
        believed = np.zeros((1, 4))
        agreement(around.poses, beams.ends, beams.eye, self.map.field, self._agree, believed)
        around.advance(Frame(Transform2D(), beams))
        best = Pose2D(*self.map.to_map(around.poses)[0].tolist())
        gain = float(around.logs[0] - believed[0, 0])
        return Match(best, around.covariance(0), float(around.explained[0]), gain)

    def _continuity(self, every: Beams, beams: Beams, odometry: Transform2D | None) -> float | None:
        """Compare the beams with the scan before; None without odometry, and after a step too large for a comparison."""
        before, self._before = self._before, None if odometry is None else (every.thinned(_PROFILE), odometry)
        if before is None or odometry is None:
            return None
        step = before[1].inverse() @ odometry
        return None if _is_large(step) else continuity(before[0], beams, step)

    def has_stepped(self, odometry: Transform2D | None) -> bool:
        """Return True if the robot has moved so far since the last scan that counted that the two are not comparable."""
        return odometry is not None and self._before is not None and _is_large(self._before[1].inverse() @ odometry)

    def _explained(self, pose: Pose2D, beams: Beams) -> tuple[list[float], float]:
        """Return the shares (explained, unexpected, through) from the pose or one next to it, and the distance to that (m)."""
        poses = self.map.to_grid(np.array([pose]))
        believed = poses[0].copy()
        refine(poses, beams.points, self.map.field, self._match, np.zeros((1, 3, 3)))
        both, found = np.vstack((believed, poses[0])), np.zeros((2, 4))
        agreement(both, beams.ends, beams.eye, self.map.field, self._agree, found)
        best = int(found[1, 1] > found[0, 1])
        return found[best, 1:].tolist(), float(np.hypot(*(both[best, :2] - believed[:2]))) if best else 0.0


def _is_large(step: Transform2D) -> bool:
    return math.hypot(step.x, step.y) > _LARGEST_STEP_M or abs(step.yaw) > _LARGEST_STEP_RAD


SURE_M: Final = 0.5
"""A localizer that does not say whether it is lost counts as sure below this standard deviation of the position (m)."""


def is_sure(estimate: PoseEstimate) -> bool:
    """Return whether the robot is localized: as the localizer reports, or else by the spread of its position."""
    details = estimate.details
    if "lost" in details or "certain" in details:
        return bool(details.get("certain", not details.get("lost", False)))
    spread = math.sqrt(max(float(estimate.covariance[0, 0] + estimate.covariance[1, 1]), 0.0))
    return spread < SURE_M


_GAIN = 0.1
"""An estimate that jumps must explain this much more of the scan than the pose by the odometry."""
_DOUBT = 0.25
"""Share of `lost_evidence` from which an estimate is not certain any more: driving with a right pose does not reach it."""
_FAR_M = 0.3
"""Distance to the pose next to the estimate that explains the scan better, from which it is not certain either (m)."""
_OFF_M = 0.2
"""The same from which the scan is matched around the estimate (m)."""
_NATS = 1.0
"""The estimate is moved to a matched pose whose likelihood is greater by this much (natural logarithm)."""
_HANDED = np.diag([0.05**2, 0.05**2, 0.03**2])
"""Added to the covariance of a hypothesis that is handed to the tracker (m², rad²)."""


class SearchingLocalizer(Localizer):
    """Tracks with another localizer (amcl), and supervises it.

    Every scan is compared with the map from the believed pose (`LostDetector`). While the robot is lost, and after a global
    start, hypotheses from searches over the whole map are tracked separately (`ScanMatcher`). Once few remain, the tracker
    gets all of them, with their probabilities; once one is certain, only that one. If it is the tracker's own pose, the alarm
    was false and the pose does not change. `details` of the estimate: `lost`, `lost_since`, `explained`, `searching`,
    and `certain`: neither lost nor contradicted by the last scans.

    With `search: false` it only watches: the tracker's estimates do not change, and `lost` says when they contradict the scans.
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
        self._unconfirmed = False
        """The tracker started without a pose, by itself, and has not been sure of one since."""
        self._handed = 0
        """Hypotheses that the tracker has; 0 for a pose of its own."""
        self._since: float | None = None
        """Stamp of the first scan of a global start."""
        self._before: Transform2D | None = None
        """map -> odom before the search of a lost robot."""
        self._estimate: PoseEstimate | None = None
        self._corrected_explained: float | None = None
        """Share of the last scan that the estimate explains, if the scan corrected it."""
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
        self._searching = self._globally = self._unconfirmed = False
        self._handed, self._estimate, self._accepted, self._corrected_explained = 0, None, None, None

    def start_globally(self) -> None:
        """Start without knowledge of the pose."""
        self._require_map().reset()
        if not self.params.search:
            self.tracker.start_globally()
        self._matcher.start_globally()
        self._inputs.stamps.clear()
        self._searching = self._globally = self.params.search
        self._unconfirmed = not self.params.search
        self._handed, self._estimate, self._accepted, self._since = 0, None, None, None
        self._corrected_explained = None

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
        unknown = self._globally or self._unconfirmed or self._handed > 0
        return unknown or (self._detector is not None and self._detector.lost)

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
        if self._globally or self._unconfirmed:
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
        if found is not None and self._accepted is not None and not self.lost and self.params.search:
            found = self._plausible(detector, self._accepted, found, odometry, scan, sensor)
        believed = self._accepted = found or self._accepted or self.tracker.estimate
        if believed is None:
            return None
        if found is not None and self._unconfirmed:
            self._unconfirmed = not is_sure(found)
        was_lost, before, stepped = detector.lost, detector.last, detector.has_stepped(odometry)
        result = detector.update(_pose_of(believed.map_to_odom @ odometry), scan, sensor, odometry)
        counted = None if result is before else result
        if counted is not None:
            self._corrected_explained = None
        if detector.lost and not was_lost and result is not None and not self._handed:
            self.alarms.append(result)
            self._begin_search(believed, odometry)
        if self._searching:
            found = self._search(detector, odometry, scan, sensor) or found
        elif counted is not None and not counted.carried and (stepped or self._is_off(counted)):
            found = self._corrected(detector, believed, odometry, scan, sensor) or found
        if found is None and detector.lost == was_lost:
            if self._estimate is not None:
                self._estimate = self._with_details(
                    self._estimate
                )  # the pose stays, but what the scans say of it does not
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
        kept = dataclasses.replace(found, pose=expected, covariance=_HANDED, map_to_odom=before.map_to_odom)
        return self._set_tracker(kept, odometry, scan, sensor)

    def _is_contradicted(self, last: Agreement) -> bool:
        """Return True if the last scan contradicts the estimate; one that this scan corrected must explain more of it."""
        if self._corrected_explained is not None:
            return self._corrected_explained < self.params.lost_explained_then
        return last.explained < self.params.certain_explained or last.correction > _FAR_M

    def _is_off(self, last: Agreement) -> bool:
        """Return True if the last scan suggests a pose next to the believed one."""
        return last.explained < self.params.certain_explained or last.correction > _OFF_M

    def _corrected(
        self,
        detector: LostDetector,
        believed: PoseEstimate,
        odometry: Transform2D,
        scan: LaserScan,
        sensor: Transform2D,
    ) -> PoseEstimate | None:
        """Set the tracker to the pose around the believed one that the scan matches, if it matches clearly better.

        Particles that are drawn for small steps do not reach the right pose after a large one, for example.
        """
        pose = _pose_of(believed.map_to_odom @ odometry)
        match = detector.matched(pose, scan, sensor) if self.params.search else None
        if match is None or match.gain < _NATS:
            return None
        moved = dataclasses.replace(
            believed,
            pose=match.pose,
            covariance=match.covariance + _HANDED,
            map_to_odom=Transform2D(*match.pose) @ odometry.inverse(),
            stamp=scan.stamp,
        )
        self._corrected_explained = match.explained
        self._accepted = self._set_tracker(moved, odometry, scan, sensor)
        return self._accepted

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
        self._handed = 0
        self.jumps.append((scan.stamp, guess.pose))
        handed = dataclasses.replace(guess, covariance=guess.covariance + _HANDED)
        self._accepted = self._set_tracker(handed, odometry, scan, sensor)
        return self._accepted

    def _set_tracker(
        self, at: PoseEstimate, odometry: Transform2D, scan: LaserScan, sensor: Transform2D
    ) -> PoseEstimate:
        """Set the tracker to a pose at this scan, and give it the scan: its odometry is where the next motion begins."""
        self.tracker.set_pose(at.pose, at.covariance, math.inf)
        return self.tracker.update(odometry, scan, sensor) or at

    def _with_details(self, estimate: PoseEstimate) -> PoseEstimate:
        details = dict(estimate.details)
        last = self.agreement
        doubtful = last is not None and (
            last.evidence > _DOUBT * self.params.lost_evidence or self._is_contradicted(last)
        )
        details |= {"lost": self.lost, "certain": not (self.lost or doubtful), "searching": self._searching}
        if last is not None:
            details |= {"explained": last.explained, "through": last.through, "lost_since": last.since}
        return dataclasses.replace(estimate, details=details)

    def _require_map(self) -> LostDetector:
        if self._detector is None:
            raise InputError("the localizer has no map; call set_map first")
        return self._detector


def _pose_of(transform: Transform2D) -> Pose2D:
    return Pose2D(*transform)
