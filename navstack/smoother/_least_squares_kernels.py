# pyright: basic
"""The residuals of the constrained smoother with their derivatives, and the normal equations."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel, plain_kernel

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
    """Return the cost at a point (m), cubic splines through the centres of cells, and its gradient per metre.

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
