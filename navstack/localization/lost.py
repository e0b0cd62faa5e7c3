"""Lost or not: how well the scans agree with the map from the believed pose, summed until it cannot be chance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization._match_kernels import agreement, refine
from navstack.localization.beams import Beams, continuity, scan_beams
from navstack.localization.hypotheses import MatchSettings
from navstack.localization.match_map import MatchMap
from navstack.parameters.models.supervision import LostParams

_PROFILE: Final = 180
"""Beams of the scan before."""
_LARGEST_STEP_M: Final = 0.5
"""After a larger step, scans are not compared: too much that was hidden is seen."""
_LARGEST_STEP_RAD: Final = 0.8


@dataclass(frozen=True, slots=True)
class Agreement:
    """How the last scan agrees with the map, and what all scans say."""

    stamp: float
    explained: float
    """Share of the returns that end at an obstacle of the map, with nothing before it, from the believed pose or beside it."""
    through: float
    """Share of the returns behind an obstacle of the map."""
    unexpected: float
    """Share of the returns in free space: people, changed furniture, or a wrong pose."""
    correction: float
    """Distance to the pose beside the believed one that explains the scan best (m)."""
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
        settings = MatchSettings()
        self._match = settings.match(self.map.resolution, 0.2, 0.1)
        self._agree = settings.agree(self.map.resolution)
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
        result for a scan that does not count: too soon, or with hardly a return.
        """
        p, last = self.params, self._last
        if last is not None and 0.0 <= scan.stamp - last.stamp < p.lost_interval - 1e-6:
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
        """Return the share of the scan's returns that the map explains from a pose or one beside it; 0 without returns."""
        beams = scan_beams(scan, sensor, self.map.reach).thinned(self.params.lost_beams)
        if not pose.is_finite() or len(beams.points) == 0:
            return 0.0
        return self._explained(pose, beams)[0][0]

    def _continuity(self, every: Beams, beams: Beams, odometry: Transform2D | None) -> float | None:
        """Compare the beams with the scan before; None without odometry, and after a step too large for a comparison."""
        before, self._before = self._before, None if odometry is None else (every.thinned(_PROFILE), odometry)
        if before is None or odometry is None:
            return None
        step = before[1].inverse() @ odometry
        if math.hypot(step.x, step.y) > _LARGEST_STEP_M or abs(step.yaw) > _LARGEST_STEP_RAD:
            return None
        return continuity(before[0], beams, step)

    def _explained(self, pose: Pose2D, beams: Beams) -> tuple[list[float], float]:
        """Return the shares (explained, unexpected, through) from the pose or one beside it, and the distance to that (m)."""
        poses = self.map.to_grid(np.array([pose]))
        believed = poses[0].copy()
        refine(poses, beams.points, self.map.field, self._match, np.zeros((1, 3, 3)))
        both, found = np.vstack((believed, poses[0])), np.zeros((2, 4))
        agreement(both, beams.ends, beams.eye, self.map.field, self._agree, found)
        best = int(found[1, 1] > found[0, 1])
        return found[best, 1:].tolist(), float(np.hypot(*(both[best, :2] - believed[:2]))) if best else 0.0
