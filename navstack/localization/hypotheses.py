"""Several possible poses of the robot, distinguished by its scans while it moves."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D, kernel
from navstack.localization.global_search import Beams, MatchMap

# ----------------------------------------------------------------------------------------------------------------------
# Refining poses on a distance field, and how well a scan agrees with the map from a pose.


# pyright: basic


MATCH = np.dtype(
    [
        ("resolution", "f8"),  # of the field, m
        ("sigma", "f8"),  # of the distance between the end of a beam and the nearest obstacle, m
        ("iterations", "i8"),
        ("prior_xy", "f8"),  # standard deviation of the given positions, m
        ("prior_yaw", "f8"),  # of the given headings, rad
    ]
)
"""Element type of the settings of `refine`."""

AGREE = np.dtype(
    [
        ("cell", "f8"),  # resolution of the field, m
        (
            "width",
            "f8",
        ),  # of the distance of an explained beam's end from the nearest obstacle: its standard deviation, m
        ("explained", "f8"),  # largest such distance, m
        ("slack", "f8"),  # a beam may end this far behind an obstacle, m
        ("unexpected", "f8"),  # likelihood of an end in free space, relative to one on an obstacle
        ("through", "f8"),  # the same of a beam that passes through an obstacle
        ("missing", "f8"),  # the same of a beam without a return whose ray meets an obstacle
        ("evidence", "f8"),  # number of independent beams that a scan counts for
    ]
)
"""Element type of the settings of `agreement`."""


@kernel
def field_at(field, fx, fy):
    """Return (d, dd/dx, dd/dy) of the field (ny, nx) at (fx, fy) (cells, center of cell i at i + 0.5), bilinear.

    Off the map, the value at the nearest border and no slope.
    """
    ny, nx = field.shape
    x, y = fx - 0.5, fy - 0.5
    if not (x >= 0.0 and y >= 0.0 and x < nx - 1 and y < ny - 1):
        ix = 0 if not x > 0.0 else min(int(x), nx - 1)
        iy = 0 if not y > 0.0 else min(int(y), ny - 1)
        return np.float64(field[iy, ix]), 0.0, 0.0
    ix, iy = int(x), int(y)
    u, v = x - ix, y - iy
    a, b = np.float64(field[iy, ix]), np.float64(field[iy, ix + 1])
    c, d = np.float64(field[iy + 1, ix]), np.float64(field[iy + 1, ix + 1])
    low, high = a + u * (b - a), c + u * (d - c)
    return low + v * (high - low), (1.0 - v) * (b - a) + v * (d - c), high - low


@kernel
def solve3(h, g):
    """Return the solution (x, y, z) of the symmetric positive definite system h (3, 3) * s = g (3,)."""
    a, b, c, d, e, f = h[0, 0], h[0, 1], h[0, 2], h[1, 1], h[1, 2], h[2, 2]
    l1 = b / a
    l2 = c / a
    d1 = d - l1 * b
    e1 = e - l1 * c
    f1 = f - l2 * c - e1 * e1 / d1
    z = (g[2] - l2 * g[0] - e1 / d1 * (g[1] - l1 * g[0])) / f1
    y = (g[1] - l1 * g[0] - e1 * z) / d1
    return (g[0] - b * y - c * z) / a, y, z


@kernel
def refine(poses, points, field, settings, information):
    """Move the `poses` (n, 3) to the nearest maximum of the likelihood of the scan, in place.

    Gauss-Newton on the distances of the `points` (m, 2) (ends of the beams, base frame, m) in the `field` (ny, nx) (m), each
    weighted by its likelihood exp(-d^2 / 2 sigma^2), with the given pose as prior. `settings` (1,): MATCH. `information`
    (n, 3, 3): filled with the information matrix at the result, without the prior.
    """
    s = settings[0]
    per = 1.0 / s.resolution
    variance = s.sigma * s.sigma
    prior_xy, prior_yaw = 1.0 / (s.prior_xy * s.prior_xy), 1.0 / (s.prior_yaw * s.prior_yaw)
    h, g = np.empty((3, 3)), np.empty(3)
    for i in range(poses.shape[0]):
        x0, y0, a0 = poses[i, 0], poses[i, 1], poses[i, 2]
        x, y, a = x0, y0, a0
        for k in range(s.iterations + 1):
            h[:] = 0.0
            g[:] = 0.0
            c, sn = math.cos(a), math.sin(a)
            for j in range(points.shape[0]):
                px, py = c * points[j, 0] - sn * points[j, 1], sn * points[j, 0] + c * points[j, 1]
                d, gx, gy = field_at(field, (x + px) * per, (y + py) * per)
                w = math.exp(-0.5 * d * d / variance) / variance
                gx *= per
                gy *= per
                ga = gy * px - gx * py
                h[0, 0] += w * gx * gx
                h[0, 1] += w * gx * gy
                h[0, 2] += w * gx * ga
                h[1, 1] += w * gy * gy
                h[1, 2] += w * gy * ga
                h[2, 2] += w * ga * ga
                g[0] -= w * d * gx
                g[1] -= w * d * gy
                g[2] -= w * d * ga
            if k == s.iterations:
                break
            h[0, 0] += prior_xy
            h[1, 1] += prior_xy
            h[2, 2] += prior_yaw
            g[0] -= prior_xy * (x - x0)
            g[1] -= prior_xy * (y - y0)
            g[2] -= prior_yaw * (a - a0)
            dx, dy, da = solve3(h, g)
            x, y, a = x + dx, y + dy, a + da
            if dx * dx + dy * dy < 1e-8 and da * da < 1e-8:
                break
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        information[i] = h
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, a


@kernel
def ray_is_blocked(field, cell, x, y, dx, dy, length):
    """Return True if the ray from (x, y) (m) along the unit vector (dx, dy) meets an obstacle within `length` (m).

    Steps by the distance to the nearest obstacle: an obstacle's cell is never stepped over by more than its corner.
    """
    ny, nx = field.shape
    t = 0.0
    per = 1.0 / cell
    while t < length:
        fx, fy = (x + t * dx) * per, (y + t * dy) * per
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            return False
        d = np.float64(field[int(fy), int(fx)])
        if d == 0.0:
            return True
        t += max(d - 1.4143 * cell, 0.5 * cell)
    return False


@kernel
def agreement(poses, ends, eye, field, settings, out):
    """Write into `out` (n, 4) how well a scan agrees with the map from each of the `poses` (n, 3).

    `ends` (m, 3): ends of the beams in the base frame (m) and 1 for a return, 0 for a beam without return (its end is where
    the range ends); `eye` (2,): the sensor in the base frame; `field` (ny, nx): distance to the nearest obstacle (m);
    `settings` (1,): AGREE. Columns: logarithm of the likelihood relative to that of a perfect scan; shares of the returns
    that are explained (end at an obstacle, nothing before), unexpected (end in free space) and through an obstacle.
    """
    s = settings[0]
    m = ends.shape[0]
    per = 1.0 / s.cell
    for i in range(poses.shape[0]):
        x, y, a = poses[i, 0], poses[i, 1], poses[i, 2]
        c, sn = math.cos(a), math.sin(a)
        sx, sy = x + c * eye[0] - sn * eye[1], y + sn * eye[0] + c * eye[1]
        total, returns, explained, through = 0.0, 0, 0, 0
        for j in range(m):
            ex, ey = x + c * ends[j, 0] - sn * ends[j, 1], y + sn * ends[j, 0] + c * ends[j, 1]
            length = math.sqrt((ex - sx) * (ex - sx) + (ey - sy) * (ey - sy))
            if length == 0.0:
                continue
            dx, dy = (ex - sx) / length, (ey - sy) / length
            blocked = ray_is_blocked(field, s.cell, sx, sy, dx, dy, length - s.slack)
            if ends[j, 2] == 0.0:
                total += math.log(s.missing) if blocked else 0.0
                continue
            returns += 1
            if blocked:
                through += 1
                total += math.log(s.through)
                continue
            d, _, _ = field_at(field, ex * per, ey * per)
            # off the map there is nothing: a wall at its border must not explain what is seen from beyond it
            beyond_x = max(0.0, -ex, ex - field.shape[1] * s.cell)
            beyond_y = max(0.0, -ey, ey - field.shape[0] * s.cell)
            d += math.sqrt(beyond_x * beyond_x + beyond_y * beyond_y)
            if d < s.explained:
                explained += 1
            total += math.log(s.unexpected + (1.0 - s.unexpected) * math.exp(-0.5 * d * d / (s.width * s.width)))
        out[i, 0] = total * min(1.0, s.evidence / max(m, 1))
        out[i, 1] = explained / max(returns, 1)
        out[i, 2] = (returns - explained - through) / max(returns, 1)
        out[i, 3] = through / max(returns, 1)


@kernel
def search_grid(pose, points, likely, window, every):
    """Return the best pose (x, y, yaw) on a grid around `pose`, using every `every`-th point; see `search_window`."""
    per, half, step = 1.0 / window[0], window[1], window[2]
    turn, turn_step = window[3], window[4]
    ny, nx = likely.shape
    n_xy, n_yaw = math.ceil(half / step), math.ceil(turn / turn_step)
    m = (points.shape[0] + every - 1) // every
    xs, ys = np.empty(m), np.empty(m)
    x0, y0, a0 = pose
    best, bx, by, ba = -math.inf, x0, y0, a0
    for k in range(-n_yaw, n_yaw + 1):
        a = a0 + k * turn_step
        c, s = math.cos(a), math.sin(a)
        for j in range(m):
            px, py = points[j * every, 0], points[j * every, 1]
            xs[j] = (x0 + c * px - s * py) * per
            ys[j] = (y0 + s * px + c * py) * per
        turned = (k * turn_step / window[6]) ** 2
        for v in range(-n_xy, n_xy + 1):
            for u in range(-n_xy, n_xy + 1):
                prior = -0.5 * (turned + (u * u + v * v) * (step / window[5]) ** 2)
                if prior + window[7] <= best:
                    continue
                total = 0.0
                for j in range(m):
                    fx, fy = xs[j] + u * step * per, ys[j] + v * step * per
                    if fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny:
                        total += likely[int(fy), int(fx)]
                score = total / m * window[7] + prior
                if score > best:
                    best, bx, by, ba = score, x0 + u * step, y0 + v * step, a
    return bx, by, ba


@kernel
def search_window(poses, points, likely, window):
    """Move each of the `poses` (n, 3) to the best pose around it, in place, by trying poses on a grid, then on a finer one.

    `window` = [resolution (m), half width (m), step (m), half angle (rad), step (rad), standard deviation of the position (m),
    of the heading (rad), evidence, n: the first grid uses every n-th point]. The score is the mean of `likely` (ny, nx) at the
    cells of the `points` (m, 2), times the evidence, plus the logarithm of the prior around the given pose.
    """
    fine = window.copy()
    fine[1], fine[3] = window[2], window[4]
    fine[2], fine[4] = 0.5 * window[2], 0.5 * window[4]
    fine[5], fine[6] = 1e3, 1e3  # the prior has done its part
    for i in range(poses.shape[0]):
        pose = search_grid((poses[i, 0], poses[i, 1], poses[i, 2]), points, likely, window, int(window[8]))
        x, y, a = search_grid(pose, points, likely, fine, 1)
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, a


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
