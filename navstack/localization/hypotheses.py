"""Several possible poses of the robot, distinguished by its scans while it moves."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D
from navstack.localization._match_kernels import AGREE, MATCH, agreement, refine, search_window
from navstack.localization.beams import Beams
from navstack.localization.match_map import MatchMap

_LOG, _EXPLAINED, _THROUGH = 0, 1, 3
_SAME_M: Final = 0.3
_SAME_RAD: Final = 0.2
_LARGE_STEP: Final = 0.1
"""Uncertainty of a step (m or rad) from which a refinement may end in a wrong maximum."""
_PRIOR_M: Final = 0.05
_PRIOR_RAD: Final = 0.03
"""Uncertainty of the odometry over the shortest step."""
_FEW: Final = 3
"""Up to this number of poses, the grid around each is fine at once."""
_LARGEST_WINDOW_M: Final = 1.5
_LARGEST_WINDOW_RAD: Final = 0.8


class Frame(NamedTuple):
    """A scan that counted, with the odometry at its stamp."""

    odometry: Transform2D
    beams: Beams


@dataclass(frozen=True, slots=True)
class MatchSettings:
    """How scans are compared with the map (m, rad); see the fields of MATCH and AGREE."""

    sigma: float = 0.15
    explained: float = 0.3
    slack: float = 0.3
    unexpected: float = 0.1
    through: float = 0.03
    missing: float = 0.2
    evidence: float = 10.0
    beams: int = 60

    def match(self, resolution: float, prior_xy: float, prior_yaw: float) -> NDArray[np.void]:
        """Return the settings of `refine`."""
        return np.array([(resolution, self.sigma, 6, prior_xy, prior_yaw)], MATCH)

    def agree(self, resolution: float) -> NDArray[np.void]:
        """Return the settings of `agreement`."""
        row = (resolution, self.sigma, self.explained, self.slack, self.unexpected, self.through, self.missing)
        return np.array([(*row, self.evidence)], AGREE)


class Hypotheses:
    """Poses that could be the robot's (grid frame), each with how well it explains the last `window` frames."""

    def __init__(self, match_map: MatchMap, settings: MatchSettings, *, window: int) -> None:
        self.map = match_map
        self._settings = settings
        self._agree = settings.agree(match_map.resolution)
        self.frames: deque[Frame] = deque(maxlen=window)
        self.poses: NDArray[np.float64] = np.empty((0, 3))
        """(n, 3) at the last frame."""
        self.information: NDArray[np.float64] = np.empty((0, 3, 3))
        self.scores: NDArray[np.float64] = np.empty((0, window, 4))
        """(n, window, 4) columns of `agreement` for each frame, the last frame last; NaN where a pose was not known yet."""

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def logs(self) -> NDArray[np.float64]:
        """(n,) logarithm of the likelihood of the frames in the window."""
        return np.nansum(self.scores[:, :, _LOG], axis=1)

    @property
    def weights(self) -> NDArray[np.float64]:
        """(n,) probabilities, if one of them is right."""
        if len(self) == 0:
            return np.empty(0)
        logs = self.logs
        likely = np.exp(logs - logs.max())
        return likely / likely.sum()

    @property
    def explained(self) -> NDArray[np.float64]:
        """(n,) mean share of the beams that the pose explains, over the window."""
        return _mean(self.scores[:, :, _EXPLAINED])

    @property
    def through(self) -> NDArray[np.float64]:
        """(n,) mean share of the beams that pass through an obstacle, over the window."""
        return _mean(self.scores[:, :, _THROUGH])

    def clear(self) -> None:
        """Clear all poses, keep the frames."""
        self._select(np.empty(0, np.intp))

    def start(self, pose: Pose2D, covariance: NDArray[np.float64]) -> None:
        """Replace all poses by one (map frame) with its (3, 3) covariance."""
        self.poses = self.map.to_grid(np.array([pose]))
        self.information = np.asarray(np.linalg.inv(covariance + 1e-9 * np.eye(3)), np.float64)[None]
        self.scores = np.full((1, self.scores.shape[1], 4), np.nan)

    def forget_frames(self) -> None:
        """Clear the frames, keep the poses."""
        self.frames.clear()
        self.scores[:] = np.nan

    def advance(self, frame: Frame) -> None:
        """Move all poses by the odometry, refine them on the new scan, and rate them with it."""
        if self.frames:
            step = self.frames[-1].odometry.inverse() @ frame.odometry
            self.poses = _moved(self.poses, step)
            prior = self._prior(step)
        else:
            prior = (_SAME_M, _SAME_RAD)
        self.frames.append(frame)
        self.scores = np.roll(self.scores, -1, axis=1)
        if len(self):
            self._look_around(self.poses, frame, prior)
            self.information, self.scores[:, -1] = self._fit(self.poses, frame, prior)

    def add(self, poses: NDArray[np.float64], *, margin: float) -> None:
        """Add poses (n, 3) at the last frame; rate them with all frames of the window, backward.

        Those whose likelihood falls behind the best one by `margin` (natural logarithm) are dropped on the way.
        """
        if len(poses) == 0 or not self.frames:
            return
        window = self.scores.shape[1]
        now = np.ascontiguousarray(poses, np.float64).copy()
        scores = np.full((len(now), window, 4), np.nan)
        information, scores[:, -1] = self._fit(now, self.frames[-1], (0.15, 0.05))
        best = np.argsort(-scores[:, -1, _LOG], kind="stable")
        best = best[_distinct(now[best])]
        now, information, scores = now[best], information[best], scores[best]
        back = now.copy()
        for k in range(1, len(self.frames)):
            later, frame = self.frames[-k], self.frames[-k - 1]
            step = later.odometry.inverse() @ frame.odometry
            back, prior = _moved(back, step), self._prior(step)
            self._look_around(back, frame, prior)
            _, scores[:, -k - 1] = self._fit(back, frame, prior)
            logs = np.nansum(scores[:, :, _LOG], axis=1)
            rivals = logs >= logs.max() - margin
            now, back, information, scores = now[rivals], back[rivals], information[rivals], scores[rivals]
        self.poses = np.concatenate((self.poses, now))
        self.information = np.concatenate((self.information, information))
        self.scores = np.concatenate((self.scores, scores))

    def prune(self, *, margin: float, keep: int) -> None:
        """Keep at most `keep` distinct poses, those within `margin` (natural logarithm) of the best one; best first."""
        order = np.argsort(-self.logs, kind="stable")
        logs = self.logs[order]
        order = order[logs >= logs[0] - margin] if len(order) else order
        self._select(order[_distinct(self.poses[order])][:keep])

    def covariance(self, i: int) -> NDArray[np.float64]:
        """Return the (3, 3) covariance of a pose from the last scan (m, rad); beams count as in `evidence`."""
        share = min(1.0, self._settings.evidence / max(1, len(self.frames[-1].beams.ends))) if self.frames else 1.0
        weak = np.diag([1.0 / 0.5**2, 1.0 / 0.5**2, 1.0 / 0.3**2])
        return np.linalg.inv(self.information[i] * share + weak)

    def _select(self, index: NDArray[np.intp]) -> None:
        self.poses, self.information, self.scores = self.poses[index], self.information[index], self.scores[index]

    def _prior(self, step: Transform2D) -> tuple[float, float]:
        length, turn = float(np.hypot(step.x, step.y)), abs(step.yaw)
        return _PRIOR_M + 0.2 * length, _PRIOR_RAD + 0.15 * length + 0.2 * turn

    def _look_around(self, poses: NDArray[np.float64], frame: Frame, prior: tuple[float, float]) -> None:
        """Move the poses, after a large step, to the best ones within three standard deviations of the odometry; in place."""
        sigma, sigma_yaw = prior
        if max(sigma - _PRIOR_M, sigma_yaw - _PRIOR_RAD) <= _LARGE_STEP:
            return
        step = 1.0 if len(poses) <= _FEW else 2.0
        window = np.array(
            [
                self.map.resolution,
                min(3.0 * sigma, _LARGEST_WINDOW_M),
                0.1 * step,
                min(3.0 * sigma_yaw, _LARGEST_WINDOW_RAD),
                0.035 * step,
                sigma,
                sigma_yaw,
                2.0 * self._settings.evidence,
                step,
            ]
        )
        search_window(poses, frame.beams.points, self.map.likely, window)

    def _fit(
        self, poses: NDArray[np.float64], frame: Frame, prior: tuple[float, float]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Refine `poses` in place; return information (n, 3, 3) and agreement (n, 4)."""
        information, scores = np.zeros((len(poses), 3, 3)), np.zeros((len(poses), 4))
        field, beams = self.map.field, frame.beams
        settings = self._settings.match(self.map.resolution, *prior)
        refine(poses, beams.points, field, settings, information)
        agreement(poses, beams.ends, beams.eye, field, self._agree, scores)
        return information, scores


def _moved(poses: NDArray[np.float64], step: Transform2D) -> NDArray[np.float64]:
    """Return poses (n, 3) after a motion `step` in their own frames."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * step.x - s * step.y
    y = poses[:, 1] + s * step.x + c * step.y
    yaw = np.remainder(poses[:, 2] + step.yaw + np.pi, 2.0 * np.pi) - np.pi
    return np.column_stack((x, y, yaw))


def _distinct(poses: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of the poses that are not close to an earlier one."""
    chosen: list[int] = []
    for i in range(len(poses)):
        near = poses[chosen]
        close = np.hypot(near[:, 0] - poses[i, 0], near[:, 1] - poses[i, 1]) < _SAME_M
        turned = np.abs(np.remainder(near[:, 2] - poses[i, 2] + np.pi, 2.0 * np.pi) - np.pi) < _SAME_RAD
        if not bool((close & turned).any()):
            chosen.append(i)
    return np.array(chosen, np.intp)


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    known = ~np.isnan(values)
    return np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
