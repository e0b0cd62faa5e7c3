"""Smoothness, curvature, distance and cost of a path as nonlinear least squares, and their minimum.

Each residual depends on three successive points, so the normal equations are banded: Levenberg-Marquardt (with the trust region
of Ceres, http://ceres-solver.org/nnls_solving.html) around LAPACK's banded Cholesky solver takes time linear in the points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from navstack.core import Costmap
from navstack.smoother import _least_squares_kernels as kernels

Array = NDArray[np.float64]
_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 1e4, 1e16, 1e-32
_LEAST_DECREASE: Final = 1e-3
(_solve,) = get_lapack_funcs(("pbsv",), dtype=np.float64)


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
    """(k, 3) points of the robot at which the cost counts (x, y, share); none: its centre."""

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
        settings = np.array([(*roots, g.origin_x, g.origin_y, g.resolution)], kernels.SETTINGS)
        return cls(costmap.data, settings, np.column_stack(given), free, backward, checks)

    def evaluate(self, points: Array) -> tuple[float, Array, Array]:
        """Return half of the sum of squares, the residuals (m, 6), and their derivatives (m, 6, 3, 2) by the point before, the
        point, and the one after.
        """
        m = len(points) - 2
        r, j = np.empty((m, 6)), np.empty((m, 6, 3, 2))
        given = self.costs, self.settings, self.given, self.free, self.backward, self.checks
        return kernels.evaluate(*given, points, r, j), r, j


def tangents(points: Array, cusp: NDArray[np.bool_], straight_m2: float) -> Array:
    """Directions (n - 2, 2) of the circles through three points (n, 2) at the middle one: `kernels.tangents`."""
    out = np.empty((len(points) - 2, 2))
    kernels.tangents(points, cusp, straight_m2, out)
    return out


def minimize(problem: Problem, points: Array, stops: Stops) -> Array | None:
    """Return the points (n, 2) of least squares, None if the residuals are not finite or no step lowers them."""
    x = np.ascontiguousarray(points)
    cost, r, j = problem.evaluate(x)
    if not np.isfinite(cost):
        return None
    radius, shrink = _RADIUS, 2.0
    gradient, band = np.empty_like(x), np.empty((kernels.BAND + 1, x.size))
    kernels.normal_equations(r, j, gradient, band)
    fixed = np.repeat(~problem.free, 2)
    for _ in range(stops.max_iterations):
        if np.abs(gradient).max() <= stops.gradient_tol or radius < _SMALLEST_RADIUS:
            break
        damped = band.copy()
        damped[-1] += np.clip(band[-1], 1e-6, 1e32) / radius
        damped[-1, fixed] = 1.0
        _, solved, info = _solve(damped, -gradient.ravel())
        if info != 0:
            radius, shrink = radius / shrink, shrink * 2.0
            continue
        step = solved.reshape(-1, 2)
        if float(np.hypot(*step.T).max()) <= stops.param_tol:
            break
        expected = kernels.expected_decrease(r, j, step)
        new, r_new, j_new = problem.evaluate(x + step)
        if abs(cost - new) <= stops.fn_tol * cost:
            break
        quality = (cost - new) / expected if expected > 0.0 else -1.0
        if np.isfinite(new) and quality > _LEAST_DECREASE:
            x, r, j, cost = x + step, r_new, j_new, new
            kernels.normal_equations(r, j, gradient, band)
            radius = min(radius / max(1.0 / 3.0, 1.0 - (2.0 * quality - 1.0) ** 3), _LARGEST_RADIUS)
            shrink = 2.0
        else:
            radius, shrink = radius / shrink, shrink * 2.0
    return x if np.isfinite(x).all() else None
