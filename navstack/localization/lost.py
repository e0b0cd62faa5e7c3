"""Lost or not: how well the scans agree with the map from the believed pose, summed until it cannot be chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization._match_kernels import agreement, refine
from navstack.localization.beams import scan_beams
from navstack.localization.hypotheses import MatchSettings
from navstack.localization.match_map import MatchMap
from navstack.parameters.models.supervision import LostParams


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
    evidence: float
    """Sum of the missing shares (CUSUM); the robot is lost from `lost_evidence` on."""
    lost: bool
    since: float | None
    """Stamp of the scan at which the sum began to grow, if the robot is lost."""

    def text(self) -> str:
        """Return one sentence for a log."""
        if not self.lost:
            return f"the map explains {self.explained:.0%} of the scan"
        began = "" if self.since is None else f" since {self.since:.1f} s"
        return (
            f"lost{began}: from the believed pose the map explains {self.explained:.0%} of the scan, {self.through:.0%} passes "
            f"through walls, {self.unexpected:.0%} ends in free space"
        )


class LostDetector:
    """Sums evidence against the believed pose (CUSUM: Page, Continuous Inspection Schemes, Biometrika 1954).

    Each scan adds `lost_explained` minus its explained share; the sum never falls below 0. Chance and people raise it for a few
    scans, a wrong pose with every scan.
    """

    def __init__(self, match_map: MatchMap | OccupancyGrid, params: LostParams | None = None) -> None:
        self.params = params or LostParams()
        self.map = match_map if isinstance(match_map, MatchMap) else MatchMap(match_map)
        settings = MatchSettings()
        self._match = settings.match(self.map.resolution, 0.2, 0.1)
        self._agree = settings.agree(self.map.resolution)
        self._last: Agreement | None = None
        self._began: float | None = None

    @property
    def last(self) -> Agreement | None:
        """The last result; None before the first scan."""
        return self._last

    @property
    def lost(self) -> bool:
        """True if the robot is lost."""
        return self._last is not None and self._last.lost

    def reset(self) -> None:
        """Reset the evidence, for example after a new pose."""
        self._last, self._began = None, None

    def update(self, pose: Pose2D, scan: LaserScan, sensor: Transform2D) -> Agreement | None:
        """Compare a scan with the map from the believed `pose` of the base (map frame) at its stamp.

        Returns the last result for a scan that does not count: too soon, or with hardly a return.
        """
        p, last = self.params, self._last
        if last is not None and 0.0 <= scan.stamp - last.stamp < p.lost_interval - 1e-6:
            return last
        beams = scan_beams(scan, sensor, self.map.reach).thinned(p.lost_beams)
        points = beams.points
        if not pose.is_finite() or len(points) < p.lost_beams // 6:
            return last
        poses = self.map.to_grid(np.array([pose]))
        believed = poses[0].copy()
        refine(poses, points, self.map.field, self._match, np.zeros((1, 3, 3)))
        both, found = np.vstack((believed, poses[0])), np.zeros((2, 4))
        agreement(both, beams.ends, beams.eye, self.map.field, self._agree, found)
        best = int(found[1, 1] > found[0, 1])
        explained, unexpected, through = found[best, 1:].tolist()
        before = 0.0 if last is None else last.evidence
        # no more than one threshold above the alarm, so that a pose that is right again is believed soon
        evidence = min(max(0.0, before + p.lost_explained - explained), 2.0 * p.lost_evidence)
        if evidence == 0.0:
            self._began = None
        elif self._began is None:
            self._began = scan.stamp
        lost = evidence >= p.lost_evidence or (last is not None and last.lost and evidence > 0.0)
        moved = float(np.hypot(*(both[best, :2] - believed[:2]))) if best else 0.0
        self._last = Agreement(
            scan.stamp, explained, through, unexpected, moved, evidence, lost, self._began if lost else None
        )
        return self._last
