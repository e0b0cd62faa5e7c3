"""Which poses of a path the constrained smoother optimizes, and the path through the result."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.smoother._least_squares import tangents
from navstack.smoother._least_squares_kernels import STRAIGHT_M2

Array = NDArray[np.float64]
_SHORTEST: Final = 1e-4


_HANDLE: Final = 0.4
"""Control points of a Bezier curve between two poses, as a share of their distance (as Nav2)."""


@dataclass(frozen=True)
class Chain:
    """The poses that are optimized (m of them)."""

    kept: list[int]
    """Their numbers in the path."""
    direction: Array
    """(m,) 1 or -1: of the step after each."""
    ratio: Array
    """(m,) length of the step before a pose over that after it; negative at a cusp."""
    cost_weight: Array
    """(m,) root of the weight of the cost."""
    cusp: NDArray[np.bool_]
    """(m,)"""

    @property
    def backward(self) -> NDArray[np.bool_]:
        """(m,) poses that are left backward."""
        return self.direction < 0.0

    def part(self, first: int, last: int) -> Chain:
        """The chain of the poses `first` to `last`, where all poses are kept."""
        at = slice(first, last + 1)
        kept = list(range(last + 1 - first))
        return Chain(kept, self.direction[at], self.ratio[at], self.cost_weight[at], self.cusp[at])

    @property
    def bounds(self) -> list[int]:
        """Numbers of the first pose of the path, its cusps, and the last one."""
        return [0, *(k for k, cusp in zip(self.kept, self.cusp, strict=True) if cusp), self.kept[-1]]


def kept_poses(poses: Array, p: Any, factor: int) -> Chain:
    """Return which poses (n, 3) are optimized: every `factor`-th one; `p`: parameters of the smoother."""
    n = len(poses)
    steps = np.diff(poses[:, :2], axis=0)
    ahead = np.cos(poses[:-1, 2]) * steps[:, 0] + np.sin(poses[:-1, 2]) * steps[:, 1]
    direction = np.ones(n)
    if p.reversing_enabled:
        direction[:-1] = np.where(ahead < 0.0, -1.0, 1.0)
    direction[-1] = direction[-2]
    if not p.keep_start_orientation and n > 2:
        direction[0] = direction[1]
    kept, cusps = [0], [False]
    first, last = (1 if p.keep_start_orientation else 0), n - (2 if p.keep_goal_orientation else 1)
    for i in range(1, n):
        cusp = i < n - 1 and direction[i] * direction[i - 1] < 0.0
        if cusp or i <= first or i >= last or i == n - 1 or i - kept[-1] >= factor:
            kept.append(i)
            cusps.append(bool(cusp))
    cusp_mask = np.array(cusps)
    length = np.hypot(*np.diff(poses[kept, :2], axis=0).T)
    ratio = np.ones(len(kept))
    ratio[1:-1] = (
        np.where(cusp_mask[1:-1], -1.0, 1.0) * np.maximum(length[:-1], _SHORTEST) / np.maximum(length[1:], 1e-9)
    )
    return Chain(kept, direction[kept], ratio, _cost_weights(length, cusp_mask, p), cusp_mask)


def _cost_weights(length: Array, cusp: NDArray[np.bool_], p: Any) -> Array:
    """Roots of the cost's weights: greater near cusps. As in Nav2, a pose counts as if it were one step nearer to a cusp behind
    the next pose, and one further from the cusp before it.
    """
    half = 0.5 * p.cusp_zone_length
    plain = math.sqrt(p.w_cost)
    peak = plain * math.sqrt(p.w_cost_cusp_multiplier)
    weights = np.full(len(cusp), plain)

    def at(distance: float) -> float:
        return peak * (1.0 - distance / half) + plain * distance / half

    recent: deque[tuple[float, int]] = deque()
    behind, since = 0.0, math.inf
    for k in range(1, len(cusp)):
        step = float(length[k - 1])
        behind += step
        while recent and behind > half:
            behind -= recent.popleft()[0]
        if cusp[k]:
            ahead = step
            for size, j in reversed(recent):
                weight = at(ahead)
                if abs(weight - peak) < abs(weights[j] - peak):
                    weights[j] = weight
                ahead += size
            recent.clear()
            behind = since = 0.0
        if k >= 2:
            if since <= half:
                weights[k - 1] = at(since)
            recent.append((step, k - 1))
        since += step
    return weights


def headings(poses: Array, points: Array, chain: Chain, p: Any, straight_m2: float) -> Array:
    """Return the headings at the optimized points (m, 2) as unit vectors (m, 2): tangents of circles through three points.

    At the ends: those of the path (n, 3), or of the steps. `straight_m2`: see `kernels.tangent`.
    """
    out = np.column_stack((np.cos(poses[chain.kept, 2]), np.sin(poses[chain.kept, 2])))
    if len(points) > 2:
        turns = chain.direction[:-2] * chain.direction[1:-1] < 0.0
        inner = tangents(np.ascontiguousarray(points), turns, straight_m2)
        out[1:-1] = _units_along(inner, (points[2:] - points[1:-1]) * chain.direction[1:-1, None])
    steps = np.diff(points, axis=0) * chain.direction[:-1, None]
    if not p.keep_start_orientation:
        out[:1] = _units_along(steps[:1], steps[:1])
    if not p.keep_goal_orientation:
        out[-1:] = _units_along(steps[-1:], steps[-1:])
    return out


def with_yaws(points: Array, heading: Array) -> Array:
    """Return poses (m, 3) of points and unit vectors (m, 2)."""
    yaws = np.arctan2(heading[:, 1], heading[:, 0])
    return np.column_stack((points, np.where(yaws <= -np.pi, np.pi, yaws)))


def upsampled(poses: Array, points: Array, chain: Chain, p: Any) -> tuple[Array, dict[int, int]]:
    """Return the path through the optimized points (m, 2), and the row of each kept pose in it.

    Poses between them are on cubic Bezier curves.
    """
    heading = headings(poses, points, chain, p, STRAIGHT_M2)
    kept = with_yaws(points, heading)
    out, rows, count = [kept[:1]], {chain.kept[0]: 0}, 1
    for k in range(1, len(points)):
        between = (chain.kept[k] - chain.kept[k - 1]) * p.path_upsampling_factor - 1
        if between > 0:
            ends = slice(k - 1, k + 1)
            out.append(_bezier(points[ends], heading[ends], float(chain.direction[k - 1]), between))
            count += between
        out.append(kept[k : k + 1])
        rows[chain.kept[k]] = count
        count += 1
    return with_kept_ends(np.concatenate(out), poses, p), rows


def with_kept_ends(path: Array, poses: Array, p: Any) -> Array:
    """Set the ends of a path whose headings are kept to those of the path before it, to the bit."""
    if p.keep_start_orientation:
        path[0] = poses[0]
    if p.keep_goal_orientation:
        path[-1] = poses[-1]
    return path


def _units_along(directions: Array, ahead: Array) -> Array:
    """Unit vectors of directions (k, 2) of any sign and length that look ahead, not back."""
    signs = np.where((directions * ahead).sum(axis=1) >= 0.0, 1.0, -1.0)
    return directions * (signs / np.maximum(np.hypot(*directions.T), 1e-12))[:, None]


def _bezier(ends: Array, heading: Array, direction: float, count: int) -> Array:
    """`count` poses between two points (2, 2) with headings (2, 2); `direction`: 1 forward, -1 backward."""
    reach = _HANDLE * direction * float(np.hypot(*(ends[1] - ends[0])))
    a, b, c, d = ends[0], ends[0] + reach * heading[0], ends[1] - reach * heading[1], ends[1]
    t = (np.arange(1, count + 1) / (count + 1))[:, None]
    points = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t * t * (1 - t) * c + t**3 * d
    chain = np.concatenate([a[None], points, d[None]])
    inner = tangents(chain, np.zeros(count, np.bool_), STRAIGHT_M2)
    return with_yaws(points, _units_along(inner, (chain[2:] - chain[1:-1]) * direction))
