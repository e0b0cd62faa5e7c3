"""constrained: the path of least smoothness, curvature, distance and cost terms (Nav2's ConstrainedSmoother)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path, kernel, plain_kernel
from navstack.global_planner.smoothers.base import SAME_M, curvatures, is_good, require_finite, smooth_where_good
from navstack.plugins import SMOOTHERS, CheckContext, Issue, ParamModel, Smoother, param

# ----------------------------------------------------------------------------------------------------------------------
# The residuals of the constrained smoother with their derivatives, and the normal equations.


# pyright: basic


SETTINGS = np.dtype(
    [
        ("smooth", np.float64),
        ("curve", np.float64),
        ("dist", np.float64),
        ("origin_x", np.float64),
        ("origin_y", np.float64),
        ("resolution", np.float64),
    ]
)
"""Roots of the weights; origin (m) and resolution (m) of the costs."""
GIVEN = 5
"""Columns of what is given at each point: x and y of the path, ratio, root of the weight of the cost, limit of the curvature."""
BAND = 5
"""Diagonals of the normal matrix above the main one: x and y of three points."""
STRAIGHT_M2 = 1e-4
"""Nav2's smoother takes three points for straight if the cross product of both steps is below this."""
_LEAST_EXCESS = 1e-4


@plain_kernel
def tangent(ax, ay, bx, by, straight_m2):
    """Return the direction at 0 of the circle through -a, 0 and b, of any sign and length; of the chord where it is nearly
    straight: where the cross product of both steps is below `straight_m2`.
    """
    cross = ax * by - ay * bx
    if abs(cross) < straight_m2:
        if ax + bx == 0.0 and ay + by == 0.0:
            return ay, -ax
        return ax + bx, ay + by
    aa, bb = ax * ax + ay * ay, bx * bx + by * by
    return (aa * bx + bb * ax) / (2.0 * cross), (aa * by + bb * ay) / (2.0 * cross)


@kernel
def tangents(points, cusp, straight_m2, out):
    """Write `tangent` (n - 2, 2) at each inner one of the points (n, 2); at a `cusp` (n - 2,), the next step counts backward."""
    for i in range(len(points) - 2):
        sign = -1.0 if cusp[i] else 1.0
        ax, ay = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        bx, by = sign * (points[i + 2, 0] - points[i + 1, 0]), sign * (points[i + 2, 1] - points[i + 1, 1])
        out[i, 0], out[i, 1] = tangent(ax, ay, bx, by, straight_m2)


@plain_kernel
def spline(t, k):
    """Return the weight of neighbor k (0 to 3) in a Catmull-Rom spline at t (0 to 1), and its derivative."""
    if k == 0:
        return 0.5 * (-t + 2 * t * t - t * t * t), 0.5 * (-1 + 4 * t - 3 * t * t)
    if k == 1:
        return 0.5 * (2 - 5 * t * t + 3 * t * t * t), 0.5 * (-10 * t + 9 * t * t)
    if k == 2:
        return 0.5 * (t + 4 * t * t - 3 * t * t * t), 0.5 * (1 + 8 * t - 9 * t * t)
    return 0.5 * (t * t * t - t * t), 0.5 * (3 * t * t - 2 * t)


@plain_kernel
def cost_at(costs, settings, x, y):
    """Return the cost at a point (m), cubic splines through the centers of cells, and its gradient per meter.

    Outside the map, its border continues.
    """
    ny, nx = costs.shape
    s = settings[0]
    fx = min(max((x - s.origin_x) / s.resolution - 0.5, -4.0), nx + 3.0)
    fy = min(max((y - s.origin_y) / s.resolution - 0.5, -4.0), ny + 3.0)
    x0, y0 = math.floor(fx), math.floor(fy)
    value, gx, gy = 0.0, 0.0, 0.0
    for i in range(4):
        iy = min(max(np.int64(y0) + i - 1, 0), ny - 1)
        along, slope = 0.0, 0.0
        for k in range(4):
            ix = min(max(np.int64(x0) + k - 1, 0), nx - 1)
            weight, change = spline(fx - x0, k)
            along += weight * costs[iy, ix]
            slope += change * costs[iy, ix]
        weight, change = spline(fy - y0, i)
        value += weight * along
        gx += weight * slope
        gy += change * along
    return value, gx / s.resolution, gy / s.resolution


@plain_kernel
def cost_of_robot(costs, settings, checks, at, step, heading):
    """Return the cost of the robot's points `checks` (k, 3: x, y, share) at a point (x, y), and its gradient by the point.

    `heading`: of the robot, of any length; reversed if it does not look along `step`. Without checks, the cost at the point.
    """
    if len(checks) == 0:
        return cost_at(costs, settings, at[0], at[1])
    length = max(math.hypot(heading[0], heading[1]), 1e-12)
    if step[0] * heading[0] + step[1] * heading[1] < 0.0:
        length = -length
    c, s = heading[0] / length, heading[1] / length
    value, gx, gy = 0.0, 0.0, 0.0
    for k in range(len(checks)):
        x, y, share = checks[k, 0], checks[k, 1], checks[k, 2]
        v, dx, dy = cost_at(costs, settings, at[0] + x * c - y * s, at[1] + x * s + y * c)
        value += share * v
        gx += share * dx
        gy += share * dy
    return value, gx, gy


@plain_kernel
def curvature_excess(ax, ay, bx, by, limit):
    """Return by how much the curvature (1/m) of the circle through -a, 0 and b exceeds a limit, and its derivatives by a and b.

    0 where it does not, or where the three points are on a line.
    """
    cx, cy = ax + bx, ay + by
    cross = ax * by - ay * bx
    aa, bb = max(ax * ax + ay * ay, 1e-12), max(bx * bx + by * by, 1e-12)
    cc = max(cx * cx + cy * cy, 1e-12)
    curvature = 2.0 * abs(cross) / math.sqrt(aa * bb * cc)
    if curvature - limit <= _LEAST_EXCESS or abs(cross) <= 1e-12:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    return (
        curvature - limit,
        curvature * (by / cross - ax / aa - cx / cc),
        curvature * (-bx / cross - ay / aa - cy / cc),
        curvature * (-ay / cross - bx / bb - cx / cc),
        curvature * (ax / cross - by / bb - cy / cc),
    )


@kernel
def evaluate(costs, settings, given, free, backward, checks, points, r, j):
    """Write the residuals (n - 2, 6) of points (n, 2), and their derivatives (n - 2, 6, 3, 2) by the point before, the point, and
    the one after: smoothness (2), curvature, distance (2), cost. Returns half of the sum of squares.

    `given` (n, GIVEN). `free` (n,): points that may move. `backward` (n,): points that are left backward. `checks`: see
    `cost_of_robot`; the heading of the robot counts as constant.
    """
    w = settings[0]
    total = 0.0
    j[:] = 0.0
    for i in range(len(points) - 2):
        before, at, after = points[i], points[i + 1], points[i + 2]
        ratio, cost_weight, limit = given[i + 1, 2], given[i + 1, 3], given[i + 1, 4]
        sign = -1.0 if ratio < 0.0 else 1.0
        ax, ay = at[0] - before[0], at[1] - before[1]
        bx, by = after[0] - at[0], after[1] - at[1]
        r[i, 0], r[i, 1] = w.smooth * (ratio * bx - ax), w.smooth * (ratio * by - ay)
        r[i, 3], r[i, 4] = w.dist * (at[0] - given[i + 1, 0]), w.dist * (at[1] - given[i + 1, 1])
        for k in range(2):
            j[i, k, 0, k], j[i, k, 1, k], j[i, k, 2, k] = w.smooth, -w.smooth * (ratio + 1.0), w.smooth * ratio
            j[i, 3 + k, 1, k] = w.dist
        excess, da_x, da_y, db_x, db_y = curvature_excess(ax, ay, sign * bx, sign * by, limit)
        r[i, 2] = w.curve * excess
        j[i, 2, 0, 0], j[i, 2, 0, 1] = -w.curve * da_x, -w.curve * da_y
        j[i, 2, 1, 0], j[i, 2, 1, 1] = w.curve * (da_x - sign * db_x), w.curve * (da_y - sign * db_y)
        j[i, 2, 2, 0], j[i, 2, 2, 1] = w.curve * sign * db_x, w.curve * sign * db_y
        heading = tangent(ax, ay, sign * bx, sign * by, STRAIGHT_M2)
        ahead = (-bx, -by) if backward[i + 1] else (bx, by)
        value, gx, gy = cost_of_robot(costs, settings, checks, (at[0], at[1]), ahead, heading)
        r[i, 5] = cost_weight * value
        j[i, 5, 1, 0], j[i, 5, 1, 1] = cost_weight * gx, cost_weight * gy
        for p in range(3):
            if not free[i + p]:
                j[i, :, p] = 0.0
        for k in range(6):
            total += r[i, k] * r[i, k]
    return 0.5 * total


@kernel
def normal_equations(r, j, gradient, band):
    """Write the gradient (n, 2) and the normal matrix as upper bands (BAND + 1, 2 n) of residuals r and derivatives j."""
    gradient[:] = 0.0
    band[:] = 0.0
    for i in range(len(r)):
        for p in range(3):
            for k in range(2):
                for row in range(6):
                    gradient[i + p, k] += j[i, row, p, k] * r[i, row]
                for q in range(p, 3):
                    for m in range(2):
                        above = 2 * (q - p) + m - k
                        if above < 0:
                            continue
                        for row in range(6):
                            band[BAND - above, 2 * (i + q) + m] += j[i, row, p, k] * j[i, row, q, m]


@kernel
def expected_decrease(r, j, step):
    """Return by how much half of the sum of squares falls with a step (n, 2) if the residuals are linear."""
    total = 0.0
    for i in range(len(r)):
        for row in range(6):
            moved = 0.0
            for p in range(3):
                for k in range(2):
                    moved += j[i, row, p, k] * step[i + p, k]
            total -= moved * (r[i, row] + 0.5 * moved)
    return total


# ----------------------------------------------------------------------------------------------------------------------
# Smoothness, curvature, distance and cost of a path as nonlinear least squares, and their minimum.
#
# Each residual depends on three successive points, so the normal equations are banded: Levenberg-Marquardt (with the trust region
# of Ceres, http://ceres-solver.org/nnls_solving.html) around LAPACK's banded Cholesky solver takes time linear in the points.


Array = NDArray[np.float64]
_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 1e4, 1e16, 1e-32
_LEAST_DECREASE: Final = 1e-3


@cache
def _banded_solver() -> Any:
    """Return LAPACK's banded Cholesky solver; scipy.linalg takes 0.2 s to import."""
    from scipy.linalg import get_lapack_funcs

    return get_lapack_funcs(("pbsv",), dtype=np.float64)[0]


class Weights(NamedTuple):
    """Weights of the terms."""

    smooth: float
    curve: float
    dist: float


class Stops(NamedTuple):
    """When the minimization ends."""

    max_iterations: int
    param_tol: float
    fn_tol: float
    gradient_tol: float


@dataclass(frozen=True)
class Problem:
    """The residuals of a path: six for each inner point."""

    costs: NDArray[np.uint8]
    settings: NDArray[np.void]
    """(1,) SETTINGS."""
    given: Array
    """(n, GIVEN) per point: see there. The ratio is the length of the step before it over that after it, negative at a cusp."""
    free: NDArray[np.bool_]
    """(n,) points that may move."""
    backward: NDArray[np.bool_]
    """(n,) points that are left backward."""
    checks: Array
    """(k, 3) points of the robot at which the cost counts (x, y, share); none: its center."""

    @classmethod
    def of(
        cls,
        costmap: Costmap,
        weights: Weights,
        given: tuple[Array, Array, Array, Array],
        free: NDArray[np.bool_],
        backward: NDArray[np.bool_],
        checks: Array,
    ) -> Problem:
        """The problem on a costmap; `given`: points of the path (n, 2), ratios, roots of the cost's weights, limits (n,)."""
        g = costmap.geometry
        roots = (math.sqrt(w) for w in weights)
        settings = np.array([(*roots, g.origin_x, g.origin_y, g.resolution)], SETTINGS)
        return cls(costmap.data, settings, np.column_stack(given), free, backward, checks)

    def evaluate(self, points: Array) -> tuple[float, Array, Array]:
        """Return half of the sum of squares, the residuals (m, 6), and their derivatives (m, 6, 3, 2) by the point before, the
        point, and the one after.
        """
        m = len(points) - 2
        r, j = np.empty((m, 6)), np.empty((m, 6, 3, 2))
        given = self.costs, self.settings, self.given, self.free, self.backward, self.checks
        return evaluate(*given, points, r, j), r, j


def path_tangents(points: Array, cusp: NDArray[np.bool_], straight_m2: float) -> Array:
    """Directions (n - 2, 2) of the circles through three points (n, 2) at the middle one: `kernels.tangents`."""
    out = np.empty((len(points) - 2, 2))
    tangents(points, cusp, straight_m2, out)
    return out


def minimize(problem: Problem, points: Array, stops: Stops) -> Array | None:
    """Return the points (n, 2) of least squares, None if the residuals are not finite or no step lowers them."""
    x = np.ascontiguousarray(points)
    cost, r, j = problem.evaluate(x)
    if not np.isfinite(cost):
        return None
    radius, shrink = _RADIUS, 2.0
    gradient, band = np.empty_like(x), np.empty((BAND + 1, x.size))
    normal_equations(r, j, gradient, band)
    fixed = np.repeat(~problem.free, 2)
    for _ in range(stops.max_iterations):
        if np.abs(gradient).max() <= stops.gradient_tol or radius < _SMALLEST_RADIUS:
            break
        damped = band.copy()
        damped[-1] += np.clip(band[-1], 1e-6, 1e32) / radius
        damped[-1, fixed] = 1.0
        _, solved, info = _banded_solver()(damped, -gradient.ravel())
        if info != 0:
            radius, shrink = radius / shrink, shrink * 2.0
            continue
        step = solved.reshape(-1, 2)
        if float(np.hypot(*step.T).max()) <= stops.param_tol:
            break
        expected = expected_decrease(r, j, step)
        new, r_new, j_new = problem.evaluate(x + step)
        if abs(cost - new) <= stops.fn_tol * cost:
            break
        quality = (cost - new) / expected if expected > 0.0 else -1.0
        if np.isfinite(new) and quality > _LEAST_DECREASE:
            x, r, j, cost = x + step, r_new, j_new, new
            normal_equations(r, j, gradient, band)
            radius = min(radius / max(1.0 / 3.0, 1.0 - (2.0 * quality - 1.0) ** 3), _LARGEST_RADIUS)
            shrink = 2.0
        else:
            radius, shrink = radius / shrink, shrink * 2.0
    return x if np.isfinite(x).all() else None


# ----------------------------------------------------------------------------------------------------------------------
# Which poses of a path the constrained smoother optimizes, and the path through the result.


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
        inner = path_tangents(np.ascontiguousarray(points), turns, straight_m2)
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
    inner = path_tangents(chain, np.zeros(count, np.bool_), STRAIGHT_M2)
    return with_yaws(points, _units_along(inner, (chain[2:] - chain[1:-1]) * direction))


_STIFF: Final = 1e4
"""Factor on w_curve where the turning radius is a bound."""
_ROUNDS: Final = 8
"""Limit on the minimizations until it is kept."""
_SHARE: Final = 0.999
"""Share of the curvature that it aims at, so that rounds end."""
_STRAIGHT_M2: Final = 1e-12
"""See `headings`: exact ones, however short the steps are."""


class ConstrainedOptimizerParams(ParamModel):
    """The section `optimizer:` of Nav2's smoother."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "linear_solver_type": "the normal equations are banded, and solved by a banded Cholesky decomposition",
        "debug_optimizer": "nothing is printed",
    }

    max_iterations: int = param(100, "limit on the iterations", ge=1, le=10_000)
    param_tol: float = param(1e-15, "a step shorter than this is the last one", unit="m", ge=0.0)
    fn_tol: float = param(1e-7, "a relative change of the sum smaller than this ends the iterations", ge=0.0)
    gradient_tol: float = param(1e-10, "a gradient smaller than this ends the iterations", ge=0.0)


class ConstrainedSmootherParams(ParamModel):
    """Parameters of constrained, under Nav2's names."""

    minimum_turning_radius: float = param(
        0.4,
        "turning radius of the robot: sharper turns are penalized, and results that turn more sharply, and more sharply than the "
        "path, are dropped; 0 = no limit",
        unit="m",
        ge=0.0,
        ros_differs="Nav2's result may turn more sharply",
    )
    w_smooth: float = param(2_000_000.0, "weight of even steps", ge=0.0)
    w_curve: float = param(30.0, "weight of curvature above 1 / minimum_turning_radius", ge=0.0)
    w_dist: float = param(0.0, "weight of the distance from the path", ge=0.0)
    w_cost: float = param(0.015, "weight of the costs of cells", ge=0.0)
    w_cost_cusp_multiplier: float = param(3.0, "factor on w_cost at a change of direction", ge=0.0)
    cusp_zone_length: float = param(
        2.5, "length of the path around a change of direction in which that factor decreases to 1", unit="m", gt=0.0
    )
    cost_check_points: list[float] = param(
        [], "points of the robot at which costs count, [x, y, weight, x, y, weight, ..]; none = its center", unit="m"
    )
    path_downsampling_factor: int = param(1, "every n-th pose of the path is optimized", ge=1, le=1000)
    path_upsampling_factor: int = param(
        1, "poses of the result per pose of the path; 0 = only those that were optimized", ge=0, le=100
    )
    reversing_enabled: bool = param(True, "whether poses that look away from the next one are driven backward")
    keep_start_orientation: bool = param(True, "whether the second pose stays, and so the first heading")
    keep_goal_orientation: bool = param(True, "whether the last pose but one stays, and so the last heading")
    sections: dict[str, Any] = param({}, "Nav2's section `optimizer:`")

    CHILD_FIELD: ClassVar[str | None] = "sections"

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the section `optimizer`."""
        del values
        return {"optimizer": ConstrainedOptimizerParams}

    @property
    def optimizer(self) -> ConstrainedOptimizerParams:
        """The section `optimizer`."""
        section = self.sections.get("optimizer", {})
        return section if isinstance(section, ConstrainedOptimizerParams) else ConstrainedOptimizerParams(**section)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue for cost_check_points that are no triples, or have no weight."""
        del context
        points = self.cost_check_points
        if len(points) % 3 != 0 or any(w < 0.0 for w in points[2::3]) or (points and sum(points[2::3]) == 0.0):
            message = (
                f"cost_check_points has {len(points)} values; write [x, y, weight, x, y, weight, ..] with weights of at least 0, "
                "not all 0"
            )
            yield Issue("error", "cost-check-points", ("cost_check_points",), message)

    def checks(self) -> NDArray[np.float64]:
        """(k, 3) x, y and share of the points of cost_check_points; roots of their weights, with the sum 1 (as Nav2)."""
        points = np.array(self.cost_check_points, np.float64).reshape(-1, 3)
        shares = np.sqrt(points[:, 2])
        return np.column_stack((points[:, :2], shares / shares.sum())) if len(points) else np.zeros((0, 3))


@SMOOTHERS.register("constrained", aliases=("nav2_constrained_smoother/ConstrainedSmoother", "constrained_smoother"))
class ConstrainedSmoother(Smoother):
    """constrained: nonlinear least squares over the positions (Levenberg-Marquardt), away from costs, with a turning radius.

    Cusps move with the path. `unchecked` is Nav2's result. `smooth` checks it: where it collides or turns too sharply, the pieces
    between cusps are optimized on their own, with all poses and with the turning radius as a bound; poses where the result is
    still not good stay as they were.
    """

    Params = ConstrainedSmootherParams
    params: ConstrainedSmootherParams

    def __init__(self, params: ConstrainedSmootherParams | None = None) -> None:
        super().__init__(params or ConstrainedSmootherParams())

    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path that is free, and turns no more sharply than the turning radius, or than the path did.

        Raises InputError for a path that is not finite.
        """
        require_finite(path)
        poses = path.poses
        if len(poses) < 2:
            return path
        last = len(poses) - 1
        out = [
            self._within(a > 0, b < last)._stretch(poses[a : b + 1], costmap, footprint) for a, b in stretches(poses)
        ]
        return Path(joined(out), path.frame)

    def unchecked(self, path: Path, costmap: Costmap) -> NDArray[np.float64]:
        """Return the smoothed poses before they are checked, as Nav2's smoother returns them."""
        return joined([self._as_nav2(path.poses[a : b + 1], costmap)[0] for a, b in stretches(path.poses)])

    def _within(self, after: bool, before: bool) -> ConstrainedSmoother:
        """The smoother of a part of a path: after or before another one, it keeps its heading there."""
        p = self.params
        kept = {"keep_start_orientation": p.keep_start_orientation or after}
        kept["keep_goal_orientation"] = p.keep_goal_orientation or before
        return ConstrainedSmoother(p.model_copy(update=kept))

    def _stretch(
        self, poses: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Smooth a stretch without turns in place: as Nav2, or each piece between its cusps where that is not good."""
        if len(poses) < 3:
            return poses
        out, starts, chain = self._as_nav2(poses, costmap)
        pieces = list(pairwise(chain.bounds))
        radius, last = self.params.minimum_turning_radius, len(poses) - 1
        if all(
            is_good(poses[a : b + 1], out[starts[a] : starts[b] + 1], costmap, footprint, radius) for a, b in pieces
        ):
            return out
        chain = kept_poses(poses, self.params, 1)
        return joined(
            [
                self._within(a > 0, b < last)._piece(poses[a : b + 1], chain.part(a, b), costmap, footprint)
                for a, b in pieces
            ]
        )

    def _as_nav2(
        self, poses: NDArray[np.float64], costmap: Costmap
    ) -> tuple[NDArray[np.float64], dict[int, int], Chain]:
        """Optimize a stretch as Nav2 does; return it, the new numbers of its kept poses, and what was kept."""
        p = self.params
        chain = kept_poses(poses, p, p.path_downsampling_factor)
        points = poses[chain.kept, :2]
        limit = np.full(len(points), 1.0 / p.minimum_turning_radius if p.minimum_turning_radius > 0.0 else math.inf)
        problem = self._problem(points, chain, costmap, self._free(len(points)), p.w_curve, limit)
        return *upsampled(poses, self._minimum(problem, points), chain, p), chain

    def _piece(
        self, poses: NDArray[np.float64], chain: Chain, costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Smooth a piece between two cusps, where the result is good."""
        inner = self._free(len(poses))
        return smooth_where_good(
            poses,
            lambda free: self._bounded(poses, chain, costmap, free & inner),
            costmap,
            footprint,
            self.params.minimum_turning_radius,
        )

    def _bounded(
        self, poses: NDArray[np.float64], chain: Chain, costmap: Costmap, free: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Optimize the free poses of a piece (n, 3) within the turning radius.

        The bound is kept by the method of multipliers (M. Hestenes, 1969): where the curvature exceeds it, it counts from a lower
        limit on, and the sum is minimized again.
        """
        p = self.params
        points = poses[:, :2]
        radius = p.minimum_turning_radius
        bound = _SHARE / radius if radius > 0.0 else math.inf
        limit = np.full(len(points), bound)
        for _ in range(_ROUNDS if radius > 0.0 and p.w_curve > 0.0 else 1):
            problem = self._problem(poses[:, :2], chain, costmap, free, _STIFF * p.w_curve, limit)
            points = self._minimum(problem, points)
            over = np.zeros(len(points))
            over[1:-1] = curvatures(points) - bound
            over[~free] = 0.0
            if over.max() * radius <= 1.0 - _SHARE:
                break
            limit = np.minimum(bound, limit - over)
        out = with_yaws(points, headings(poses, points, chain, p, _STRAIGHT_M2))
        stay = np.flatnonzero(~(free[:-2] | free[1:-1] | free[2:])) + 1
        out[stay, 2] = poses[stay, 2]
        return with_kept_ends(out, poses, p)

    def _free(self, count: int) -> NDArray[np.bool_]:
        """Which of the poses may move: not the ends, nor the poses next to them if the headings there stay."""
        free = np.ones(count, np.bool_)
        first, last = 1 + self.params.keep_start_orientation, 1 + self.params.keep_goal_orientation
        free[:first] = free[max(0, count - last) :] = False
        return free

    def _problem(
        self,
        original: NDArray[np.float64],
        chain: Chain,
        costmap: Costmap,
        free: NDArray[np.bool_],
        w_curve: float,
        limit: NDArray[np.float64],
    ) -> Problem:
        """The least squares of points (n, 2), with curvature above `limit` (n,)."""
        weights = Weights(self.params.w_smooth, w_curve, self.params.w_dist)
        given = original, chain.ratio, chain.cost_weight, limit
        return Problem.of(costmap, weights, given, free, chain.backward, self.params.checks())

    def _minimum(self, problem: Problem, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (n, 2) of least squares, or those given where nothing is free or no step helps."""
        if not problem.free.any():
            return points
        o = self.params.optimizer
        found = minimize(problem, points, Stops(o.max_iterations, o.param_tol, o.fn_tol, o.gradient_tol))
        return points if found is None else found


def joined(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the poses of successive parts, which share their ends."""
    return np.concatenate([*(part[:-1] for part in parts), parts[-1][-1:]])


def stretches(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return first and last pose of each stretch; steps without a distance, as in turns in place, are stretches of their own."""
    if len(poses) < 2:
        return []
    still = (np.abs(np.diff(poses[:, :2], axis=0)) < SAME_M).all(axis=1)
    cuts = {0, len(poses) - 1}
    for i in np.flatnonzero(still).tolist():
        cuts |= {i, i + 1}
    return list(pairwise(sorted(cuts)))
