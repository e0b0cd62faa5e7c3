"""scan_matching: localization by matching scans with the map, from a pose or without one.

Without a pose, a search over the whole map gives hypotheses; the robot's motion and further scans distinguish them, until one
explains what was seen and no other does.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization.global_search import MatchMap, scan_beams, search_scan
from navstack.localization.hypotheses import Frame, Hypotheses, MatchSettings
from navstack.localization.inputs import InputCheck, require_covariance
from navstack.parameters import ScanMatcherParams
from navstack.plugins import LOCALIZERS, Localizer, PoseEstimate

_MARGIN: Final = 15.0
"""Hypotheses whose likelihood is smaller than the best one's by this much (natural logarithm) are dropped."""


@LOCALIZERS.register("scan_matching")
class ScanMatcher(Localizer):
    """Multi-hypothesis scan matching."""

    Params = ScanMatcherParams

    def __init__(
        self, params: ScanMatcherParams | None = None, settings: MatchSettings | None = None, *, seed: int = 0
    ) -> None:
        """`seed` is not used: it draws no random numbers."""
        self.params = params or ScanMatcherParams()
        self._settings = settings or MatchSettings(beams=self.params.match_beams)
        self._inputs = InputCheck()
        self.rejections = self._inputs.rejections
        """Inputs that were not used, with the reason."""
        self._hypotheses: Hypotheses | None = None
        self._estimate: PoseEstimate | None = None
        self._globally = True
        self._forced = False
        self._certain = False
        self._streak = 0
        self._moved = 0.0
        self._turned = 0.0
        self._searched_at = -math.inf, -math.inf
        self._given: tuple[Pose2D, NDArray[np.float64]] | None = None

    # --- the interface of localizers ----------------------------------------------------------------------------------

    def set_map(self, grid: OccupancyGrid) -> None:
        """Use this map from now on; the current estimate stays, other hypotheses are dropped."""
        self.set_match_map(MatchMap(grid))

    def set_match_map(self, match_map: MatchMap) -> None:
        """Use a map that is already prepared; see `set_map`."""
        before = self._hypotheses
        self._hypotheses = Hypotheses(match_map, self._settings, window=self.params.window)
        if before is not None and len(before) and self._certain:
            self._given = (Pose2D(*before.map.to_map(before.poses[:1])[0].tolist()), before.covariance(0))
            self._globally = False

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Start from a pose of the base in the map; its covariance is that of the estimate until the first scan."""
        matrix = require_covariance(pose, covariance)
        self._restart(globally=False)
        self._given = pose, matrix

    def start_globally(self) -> None:
        """Start without knowledge of the pose: the next scan is searched for in the whole map."""
        self._restart(globally=True)

    def suggest(self, pose: Pose2D, covariance: NDArray[np.float64]) -> None:
        """Compare this pose of the base with those of the search; to be called after `start_globally`."""
        if pose.is_finite() and np.isfinite(covariance).all():
            self._given = (pose, np.asarray(covariance, np.float64))

    def request_update(self) -> None:
        """Let the next scan count even if the robot has not moved."""
        self._forced = True

    @property
    def estimate(self) -> PoseEstimate | None:
        """The last estimate; `details["certain"]` states whether the robot is localized."""
        return self._estimate

    @property
    def is_certain(self) -> bool:
        """True if one pose explains what was seen and no other does."""
        return self._certain

    @property
    def count(self) -> int:
        """Number of possible poses."""
        return 0 if self._hypotheses is None else len(self._hypotheses)

    def possible_poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the hypotheses (n, 3), best first, and their probabilities (n,)."""
        h = self._hypotheses
        if h is None or not len(h):
            return np.empty((0, 3)), np.empty(0)
        return np.asarray(h.map.to_map(h.poses), np.float64), np.asarray(h.weights, np.float64)

    def hypotheses(self) -> list[tuple[Pose2D, NDArray[np.float64], float]]:
        """Return the possible poses in the map, best first: pose, (3, 3) covariance, probability."""
        h = self._hypotheses
        if h is None:
            return []
        poses = h.map.to_map(h.poses)
        weights = h.weights
        return [(Pose2D(*poses[i].tolist()), h.covariance(i), float(weights[i])) for i in range(len(h))]

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        """Process a scan; None if the robot has hardly moved since the last one that counted, or no pose explains it.

        A defective input is rejected with a reason in `rejections`.
        """
        h = self._require_map()
        if not self._inputs.accept(odometry, scan, sensor) or not self._is_due(h, odometry):
            return None
        beams = scan_beams(scan, sensor, h.map.reach)
        if len(beams.points) == 0:
            return None
        self._forced = False
        self._take_given(h)
        if h.frames:
            step = h.frames[-1].odometry.inverse() @ odometry
            self._moved += math.hypot(step.x, step.y)
            self._turned += abs(step.yaw)
        h.advance(Frame(odometry, beams.thinned(self._settings.beams)))
        if self._globally and not self._certain and self._is_search_due():
            self._searched_at = self._moved, self._turned
            found = search_scan(h.map, beams, keep=self.params.max_hypotheses, beam_count=self.params.search_beams)
            h.add(found.poses, margin=_MARGIN)
        h.prune(margin=_MARGIN, keep=self.params.max_hypotheses)
        self._judge(h)
        return self._publish(h, odometry, scan.stamp)

    # --- parts --------------------------------------------------------------------------------------------------------

    def _restart(self, *, globally: bool) -> None:
        h = self._require_map()
        h.clear()
        h.forget_frames()
        self._inputs.stamps.clear()
        self._globally, self._certain, self._streak = globally, False, 0
        self._moved, self._turned, self._searched_at = 0.0, 0.0, (-math.inf, -math.inf)
        self._estimate, self._given = None, None

    def _require_map(self) -> Hypotheses:
        if self._hypotheses is None:
            raise InputError("the localizer has no map; call set_map first")
        return self._hypotheses

    def _is_due(self, h: Hypotheses, odometry: Transform2D) -> bool:
        if self._forced or not h.frames:
            return True
        step = h.frames[-1].odometry.inverse() @ odometry
        return math.hypot(step.x, step.y) >= self.params.update_min_d or abs(step.yaw) >= self.params.update_min_a

    def _is_search_due(self) -> bool:
        """Return True if the robot sees other things than at the last search of the whole map."""
        p, (moved, turned) = self.params, self._searched_at
        return self._moved - moved >= p.search_distance or self._turned - turned >= p.search_turn

    def _take_given(self, h: Hypotheses) -> None:
        if self._given is None:
            return
        h.start(*self._given)
        self._given = None

    def _judge(self, h: Hypotheses) -> None:
        """Decide whether the best hypothesis is certain."""
        p = self.params
        if len(h) == 0:
            self._certain, self._streak = False, 0
            return
        good = h.weights[0] >= p.certain_probability and h.explained[0] >= p.certain_explained
        self._streak = self._streak + 1 if good else 0
        if not self._globally:
            self._certain = bool(h.explained[0] >= p.certain_explained)
        elif not self._certain:
            enough = self._moved >= p.certain_distance * (1.0 - self._turned / p.certain_turn)
            self._certain = self._streak >= 3 and enough

    def _publish(self, h: Hypotheses, odometry: Transform2D, stamp: float) -> PoseEstimate | None:
        if len(h) == 0:
            return None
        pose = Pose2D(*h.map.to_map(h.poses[:1])[0].tolist())
        details: dict[str, Any] = {
            "certain": self._certain,
            "hypotheses": len(h),
            "probability": float(h.weights[0]),
            "explained": float(h.scores[0, -1, 1]),
            "through": float(h.scores[0, -1, 3]),
        }
        self._estimate = PoseEstimate(pose, h.covariance(0), Transform2D(*pose) @ odometry.inverse(), stamp, details)
        return self._estimate
