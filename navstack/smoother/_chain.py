"""Which poses of a path the constrained smoother optimizes, and the path through the result."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.smoother._least_squares import tangents
from navstack.smoother._least_squares_kernels import STRAIGHT_M2

Array = NDArray[np.float64]
_SHORTEST: Final = 1e-4


class Fit(NamedTuple):
    """How headings and poses between the optimized points are found."""

    handle: float
    """Control points of a Bezier curve between two poses, as a share of their distance."""
    straight_m2: float
    """See `tangents`."""


NAV2_FIT: Final = Fit(0.4, STRAIGHT_M2)
ARC_FIT: Final = Fit(1.0 / 3.0, 1e-12)
"""Headings and curves close to arcs, however short the steps are."""


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


def upsampled(poses: Array, points: Array, chain: Chain, p: Any, fit: Fit) -> tuple[Array, dict[int, int]]:
    """Return the path through the optimized points (m, 2), and the row of each kept pose in it.

    Headings are tangents of circles through three points; poses between are on cubic Bezier curves.
    """
    m = len(points)
    heading = np.zeros((m, 2))
    heading[0] = math.cos(poses[0, 2]), math.sin(poses[0, 2])
    heading[-1] = math.cos(poses[-1, 2]), math.sin(poses[-1, 2])
    if m > 2:
        turns = chain.direction[:-2] * chain.direction[1:-1] < 0.0
        inner = tangents(np.ascontiguousarray(points), turns, fit.straight_m2)
        ahead = (points[2:] - points[1:-1]) * chain.direction[1:-1, None]
        inner *= np.where((inner * ahead).sum(axis=1) >= 0.0, 1.0, -1.0)[:, None]
        heading[1:-1] = inner / np.maximum(np.hypot(*inner.T), 1e-12)[:, None]
    if not p.keep_start_orientation:
        heading[0] = _unit((points[1] - points[0]) * chain.direction[0])
    if not p.keep_goal_orientation:
        heading[-1] = _unit((points[-1] - points[-2]) * chain.direction[-1])
    yaws = np.arctan2(heading[:, 1], heading[:, 0])
    out = [np.array([[*points[0], yaws[0]]])]
    rows = {chain.kept[0]: 0}
    count = 1
    for k in range(1, m):
        between = (chain.kept[k] - chain.kept[k - 1]) * p.path_upsampling_factor - 1
        if between > 0:
            ends = slice(k - 1, k + 1)
            out.append(_bezier(points[ends], heading[ends], float(chain.direction[k - 1]), fit, between))
            count += between
        out.append(np.array([[*points[k], yaws[k]]]))
        rows[chain.kept[k]] = count
        count += 1
    path = np.concatenate(out)
    path[:, 2] = np.where(path[:, 2] <= -np.pi, np.pi, path[:, 2])
    if p.keep_start_orientation:
        path[0] = poses[0]
    if p.keep_goal_orientation:
        path[-1] = poses[-1]
    return path, rows


def _unit(v: Array) -> Array:
    return v / max(1e-12, float(np.hypot(*v)))


def _bezier(ends: Array, headings: Array, direction: float, fit: Fit, count: int) -> Array:
    """`count` poses between two points (2, 2) with headings (2, 2); `direction`: 1 forward, -1 backward."""
    reach = fit.handle * direction * float(np.hypot(*(ends[1] - ends[0])))
    a, b, c, d = ends[0], ends[0] + reach * headings[0], ends[1] - reach * headings[1], ends[1]
    t = (np.arange(1, count + 1) / (count + 1))[:, None]
    points = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t * t * (1 - t) * c + t**3 * d
    chain = np.concatenate([a[None], points, d[None]])
    inner = tangents(chain, np.zeros(count, np.bool_), fit.straight_m2)
    ahead = (chain[2:] - chain[1:-1]) * direction
    inner *= np.where((inner * ahead).sum(axis=1) >= 0.0, 1.0, -1.0)[:, None]
    return np.column_stack((points, np.arctan2(inner[:, 1], inner[:, 0])))
