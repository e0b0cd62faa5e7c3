# pyright: basic
"""Refining poses on a distance field, and how well a scan agrees with the map from a pose."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

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
    """Return (d, dd/dx, dd/dy) of the field (ny, nx) at (fx, fy) (cells, centre of cell i at i + 0.5), bilinear.

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
