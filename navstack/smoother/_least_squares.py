"""Smoothness, curvature, distance and cost of a path as nonlinear least squares, and their minimum.

Each residual depends on three successive points, so the normal equations are banded: Levenberg-Marquardt (with the trust region
of Ceres, http://ceres-solver.org/nnls_solving.html) around scipy's banded Cholesky solver takes time linear in the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded

Array = NDArray[np.float64]
_BAND: Final = 5
"""Diagonals above the main one: x and y of three points."""
_EPSILON: Final = 1e-4
_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 1e4, 1e16, 1e-32
_LEAST_DECREASE: Final = 1e-3


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
class Grid:
    """Costs as a smooth function: cubic splines through the centres of the cells."""

    costs: NDArray[np.uint8]
    origin: Array
    resolution: float

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return the cost at points (n, 2), and its gradient (n, 2) per metre. Outside the map its border continues."""
        ny, nx = self.costs.shape
        cells = np.clip((points - self.origin) / self.resolution - 0.5, -4.0, [nx + 3.0, ny + 3.0])
        corner = np.floor(cells)
        share = cells - corner
        near = corner.astype(np.int64)[:, :, None] + np.arange(-1, 3)
        ix, iy = np.clip(near[:, 0], 0, nx - 1), np.clip(near[:, 1], 0, ny - 1)
        values = self.costs[iy[:, :, None], ix[:, None, :]].astype(np.float64)  # (n, 4 rows, 4 columns)
        wx, dx = _spline(share[:, 0])
        wy, dy = _spline(share[:, 1])
        along, slope = np.einsum("nij,nj->ni", values, wx), np.einsum("nij,nj->ni", values, dx)
        value = np.einsum("ni,ni->n", along, wy)
        gradient = np.column_stack((np.einsum("ni,ni->n", slope, wy), np.einsum("ni,ni->n", along, dy)))
        return value, gradient / self.resolution


def _spline(t: Array) -> tuple[Array, Array]:
    """Weights (n, 4) of four neighbors in a Catmull-Rom spline, and of its derivative."""
    t2, t3 = t * t, t * t * t
    weights = np.column_stack((-t + 2 * t2 - t3, 2 - 5 * t2 + 3 * t3, t + 4 * t2 - 3 * t3, t3 - t2))
    slopes = np.column_stack((-1 + 4 * t - 3 * t2, -10 * t + 9 * t2, 1 + 8 * t - 9 * t2, 3 * t2 - 2 * t))
    return 0.5 * weights, 0.5 * slopes


@dataclass(frozen=True)
class Problem:
    """The residuals of a path: six for each inner point."""

    grid: Grid
    original: Array
    """(n, 2) points of the path."""
    ratio: Array
    """(n,) length of the step before a point over that after it; negative at a cusp."""
    cost_weight: Array
    """(n,) roots of the weights of the cost."""
    free: NDArray[np.bool_]
    """(n,) points that may move."""
    weights: Weights
    limit: Array
    """(n,) curvature (1/m) above which it counts."""
    checks: Array
    """(k, 3) points of the robot at which the cost counts (x, y, share); none: its centre."""
    backward: NDArray[np.bool_]
    """(n,) points that are left backward."""

    def evaluate(self, points: Array) -> tuple[Array, Array]:
        """Return the residuals (m, 6) and their derivatives (m, 6, 3, 2) by the point before, the point, and the one after."""
        before, at, after = points[:-2], points[1:-1], points[2:]
        m = len(at)
        r, j = np.zeros((m, 6)), np.zeros((m, 6, 3, 2))
        ratio = self.ratio[1:-1]
        root = np.sqrt(self.weights.smooth)
        r[:, :2] = root * (ratio[:, None] * (after - at) - (at - before))
        for k in (0, 1):
            j[:, k, 0, k], j[:, k, 1, k], j[:, k, 2, k] = root, -root * (ratio + 1.0), root * ratio
        self._curvature(before, at, after, r, j)
        root = np.sqrt(self.weights.dist)
        r[:, 3:5] = root * (at - self.original[1:-1])
        j[:, 3, 1, 0] = j[:, 4, 1, 1] = root
        value, gradient = self._cost(before, at, after)
        weight = self.cost_weight[1:-1]
        r[:, 5] = weight * value
        j[:, 5, 1] = weight[:, None] * gradient
        fixed = ~self.free
        j[fixed[:-2], :, 0] = 0.0
        j[fixed[1:-1], :, 1] = 0.0
        j[fixed[2:], :, 2] = 0.0
        return r, j

    def _curvature(self, before: Array, at: Array, after: Array, r: Array, j: Array) -> None:
        """Write residual 2: the curvature of the circle through three points, above the limit."""
        sign = np.where(self.ratio[1:-1] < 0.0, -1.0, 1.0)[:, None]
        a, b = at - before, sign * (after - at)
        c = a + b
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        aa, bb, cc = (np.maximum((v * v).sum(axis=1), 1e-12) for v in (a, b, c))
        curvature = 2.0 * np.abs(cross) / np.sqrt(aa * bb * cc)
        excess = curvature - self.limit[1:-1]
        sharp = (excess > _EPSILON) & (np.abs(cross) > 1e-12)
        if not sharp.any():
            return
        root = np.sqrt(self.weights.curve)
        r[sharp, 2] = root * excess[sharp]
        safe = np.where(sharp, cross, 1.0)[:, None]
        pull = c / cc[:, None]
        by_a = np.column_stack((b[:, 1], -b[:, 0])) / safe - a / aa[:, None] - pull
        by_b = np.column_stack((-a[:, 1], a[:, 0])) / safe - b / bb[:, None] - pull
        scale = (root * curvature * sharp)[:, None]
        j[:, 2, 0] = -scale * by_a
        j[:, 2, 1] = scale * (by_a - sign * by_b)
        j[:, 2, 2] = scale * sign * by_b

    def _cost(self, before: Array, at: Array, after: Array) -> tuple[Array, Array]:
        """Cost at the robot's points; its heading counts as constant in the gradient."""
        if len(self.checks) == 0:
            return self.grid.at(at)
        sign = np.where(self.ratio[1:-1] < 0.0, -1.0, 1.0)
        heading = tangents(before, at, after, sign < 0.0)
        heading /= np.maximum(np.hypot(*heading.T), 1e-12)[:, None]
        wrong = (((after - at) * heading).sum(axis=1) < 0.0) != self.backward[1:-1]
        heading[wrong] *= -1.0
        value, gradient = np.zeros(len(at)), np.zeros((len(at), 2))
        for x, y, share in self.checks:
            aside = np.column_stack((-heading[:, 1], heading[:, 0]))
            v, g = self.grid.at(at + x * heading + y * aside)
            value += share * v
            gradient += share * g
        return value, gradient


def tangents(before: Array, at: Array, after: Array, cusp: NDArray[np.bool_], straight_m2: float = _EPSILON) -> Array:
    """Directions (n, 2) of the circles through three points at the middle one, of any sign and length; of the chord where it is
    nearly straight: where the cross product of both steps is below `straight_m2`.
    """
    a, b = at - before, np.where(cusp, -1.0, 1.0)[:, None] * (after - at)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    straight = np.abs(cross) < straight_m2
    safe = np.where(straight, 1.0, cross)
    # centre - at, for the circle through -a, 0 and b
    aa, bb = (a * a).sum(axis=1), (b * b).sum(axis=1)
    cx = (-aa * b[:, 1] - bb * a[:, 1]) / (2.0 * safe)
    cy = (aa * b[:, 0] + bb * a[:, 0]) / (2.0 * safe)
    chord = a + b
    turned = np.column_stack((a[:, 1], -a[:, 0]))
    chord = np.where((chord == 0.0).all(axis=1)[:, None], turned, chord)
    return np.where(straight[:, None], chord, np.column_stack((cy, -cx)))


def minimize(problem: Problem, points: Array, stops: Stops) -> Array | None:
    """Return the points (n, 2) of least squares, None if the residuals are not finite or no step lowers them."""
    x = points.copy()
    r, j = problem.evaluate(x)
    cost = 0.5 * float((r * r).sum())
    if not np.isfinite(cost):
        return None
    radius, shrink = _RADIUS, 2.0
    gradient, band = _normal(r, j, len(x))
    for _ in range(stops.max_iterations):
        if np.abs(gradient).max() <= stops.gradient_tol or radius < _SMALLEST_RADIUS:
            break
        damped = band.copy()
        damped[-1] += np.clip(band[-1], 1e-6, 1e32) / radius
        damped[-1, np.repeat(~problem.free, 2)] = 1.0
        try:
            step = -solveh_banded(damped, gradient, check_finite=False).reshape(-1, 2)
        except (LinAlgError, ValueError):
            radius, shrink = radius / shrink, shrink * 2.0
            continue
        moved = np.einsum("mrpk,mpk->mr", j, np.stack((step[:-2], step[1:-1], step[2:]), axis=1))
        expected = -float((moved * (r + 0.5 * moved)).sum())
        if float(np.hypot(*step.T).max()) <= stops.param_tol:
            break
        r_new, j_new = problem.evaluate(x + step)
        new = 0.5 * float((r_new * r_new).sum())
        if abs(cost - new) <= stops.fn_tol * cost:
            break
        quality = (cost - new) / expected if expected > 0.0 else -1.0
        if np.isfinite(new) and quality > _LEAST_DECREASE:
            x, r, j, cost = x + step, r_new, j_new, new
            gradient, band = _normal(r, j, len(x))
            radius = min(radius / max(1.0 / 3.0, 1.0 - (2.0 * quality - 1.0) ** 3), _LARGEST_RADIUS)
            shrink = 2.0
        else:
            radius, shrink = radius / shrink, shrink * 2.0
    return x if np.isfinite(x).all() else None


def _normal(r: Array, j: Array, n: int) -> tuple[Array, Array]:
    """The gradient (2 n,), and the normal matrix as upper bands (_BAND + 1, 2 n)."""
    m = len(r)
    gradient = np.zeros((n, 2))
    band = np.zeros((_BAND + 1, 2 * n))
    by_point = np.einsum("mrpk,mr->mpk", j, r)
    products = np.einsum("mrpk,mrql->mpkql", j, j)
    first = np.arange(m)
    for p in range(3):
        gradient[p : p + m] += by_point[:, p]
        for q in range(p, 3):
            for k in (0, 1):
                for i in (0, 1):
                    above = 2 * (q - p) + i - k
                    if above >= 0:
                        band[_BAND - above, 2 * (first + q) + i] += products[:, p, k, q, i]
    return gradient.ravel(), band
