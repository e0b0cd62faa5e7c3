# pyright: basic
"""Matching a scan with the surfaces that other scans have seen: a search by branch and bound, then point to line.

Surfaces are means of points and normals by cell (as in the normal distributions transform), so that the noise of many scans
averages out. Sources: Olson (Real-Time Correlative Scan Matching, ICRA 2009) and Hess et al. (Real-Time Loop Closure in 2D
LIDAR SLAM, ICRA 2016) for the search, Censi (An ICP variant using a point-to-line metric, ICRA 2008) for the refinement.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Transform2D, kernel, line_next, line_start
from navstack.localization import solve3

CELL: Final = 0.1
"""Side of a cell (m): several beams of each scan fall into one within 10 m, and a search step is small enough to refine."""
LEVELS: Final = 4
"""Blocks of the search have 1, 2, 4 and 8 cells per side."""
MARGIN: Final = 9
"""Empty cells around the surfaces: a block that begins outside the field then is empty."""
SMEAR: Final = 0.1
"""Standard deviation of the likelihood around a surface (m), as Karto's correlation_search_space_smear_deviation."""
SPACING: Final = 0.05
"""Points of a scan nearer to each other than this (m) are thinned: near walls would outweigh far ones."""
INLIER_M: Final = 0.12
"""A point within this distance of a surface is explained."""
SIGMA_M: Final = 0.03
"""Noise of a point across its surface (m): range noise of common lidars, and of the surface."""
INDEPENDENT: Final = 0.3
"""Share of the points that count as independent: neighbors share the errors of walls, sensor and pose."""


@kernel
def surface_points(points, eye, spacing):
    """Return (n, 4) x, y and unit normal of the points (m, 2) of a scan, in their order, thinned to `spacing` (m).

    The normal is that of a line through the neighbors within two points and 0.1 m + 10 % of the range, toward the sensor at
    `eye`; (0, 0) for a point with fewer than two of them or off any line.
    """
    m = points.shape[0]
    out = np.empty((m, 4))
    n = 0
    for i in range(m):
        x, y = points[i, 0], points[i, 1]
        if n > 0 and math.hypot(x - out[n - 1, 0], y - out[n - 1, 1]) < spacing:
            continue
        gap = 0.1 + 0.1 * math.hypot(x - eye[0], y - eye[1])
        count, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for side in (-1, 1):
            reach = 0.0
            k = i if side > 0 else i - 1
            px, py = x, y
            while 0 <= k < m and abs(k - i) <= 8:
                step = math.hypot(points[k, 0] - px, points[k, 1] - py)
                reach = math.hypot(points[k, 0] - x, points[k, 1] - y)
                if step > gap or (abs(k - i) > 2 and reach > 0.15):
                    break
                px, py = points[k, 0], points[k, 1]
                dx, dy = px - x, py - y
                count += 1
                sx, sy, sxx, sxy, syy = sx + dx, sy + dy, sxx + dx * dx, sxy + dx * dy, syy + dy * dy
                k += side
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = x, y, 0.0, 0.0
        if count >= 3:
            cxx, cxy, cyy = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
            half = 0.5 * (cxx + cyy)
            root = math.sqrt(max(0.25 * (cxx - cyy) ** 2 + cxy * cxy, 0.0))
            if half + root > 1e-6 and (half - root) < 0.1 * (half + root):
                angle = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
                nx, ny = -math.sin(angle), math.cos(angle)
                if nx * (eye[0] - x) + ny * (eye[1] - y) < 0.0:
                    nx, ny = -nx, -ny
                out[n, 2], out[n, 3] = nx, ny
        n += 1
    return out[:n]


@kernel
def add_surface(sums, surface, pose, corner, cell):
    """Add the points (n, 4) of a scan at `pose` to the `sums` (ny, nx, 5) of count, x, y (cells, in the cell), normal."""
    ny, nx = sums.shape[:2]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(surface.shape[0]):
        px, py, ux, uy = surface[i, 0], surface[i, 1], surface[i, 2], surface[i, 3]
        x = (pose[0] + c * px - s * py - corner[0]) / cell
        y = (pose[1] + s * px + c * py - corner[1]) / cell
        ix, iy = math.floor(x), math.floor(y)
        if 0 <= ix < nx and 0 <= iy < ny:
            entry = sums[iy, ix]
            entry[0] += 1.0
            entry[1] += x - ix
            entry[2] += y - iy
            entry[3] += c * ux - s * uy
            entry[4] += s * ux + c * uy


@kernel
def likelihood_pyramid(sums, cell, smear, levels):
    """Return (levels, ny, nx) uint8: 255 times the likelihood of a point in each cell, and its maxima over 2^h x 2^h cells.

    Element [h, y, x] covers the cells from (y, x) on.
    """
    ny, nx = sums.shape[:2]
    pyramid = np.zeros((levels, ny, nx), np.uint8)
    reach = math.ceil(2.5 * smear / cell)
    for iy in range(ny):
        for ix in range(nx):
            n = sums[iy, ix, 0]
            if n == 0.0:
                continue
            mx, my = ix + sums[iy, ix, 1] / n, iy + sums[iy, ix, 2] / n
            for v in range(max(iy - reach, 0), min(iy + reach + 1, ny)):
                for u in range(max(ix - reach, 0), min(ix + reach + 1, nx)):
                    d = ((u + 0.5 - mx) ** 2 + (v + 0.5 - my) ** 2) * cell * cell
                    value = np.uint8(255.0 * math.exp(-0.5 * d / (smear * smear)))
                    if value > pyramid[0, v, u]:
                        pyramid[0, v, u] = value
    for h in range(1, levels):
        step = 1 << (h - 1)
        low, high = pyramid[h - 1], pyramid[h]
        for iy in range(ny):
            below = min(iy + step, ny - 1)
            for ix in range(nx):
                right = min(ix + step, nx - 1)
                high[iy, ix] = max(max(low[iy, ix], low[iy, right]), max(low[below, ix], low[below, right]))
    return pyramid


@kernel
def block_score(level, xs, ys, u, v):
    """Return the sum of a level of the pyramid at the cells (xs, ys) of the points, moved by (u, v) cells."""
    ny, nx = level.shape
    total = 0
    for j in range(xs.shape[0]):
        x, y = xs[j] + u, ys[j] + v
        if 0 <= x < nx and 0 <= y < ny:
            total += level[y, x]
    return total


@kernel
def search_poses(pyramid, points, guess, corner, window, other):
    """Return (x, y, yaw, score, mean likelihood) of the best pose in a window around `guess`, by branch and bound.

    `window` = [cell (m), half width (m), half angle (rad), angular step (rad), standard deviation of the guess (m), (rad),
    evidence]: the score is the mean likelihood of the `points` (n, 2) times the evidence, plus the logarithm of the prior.
    Poses within `other` = [x, y, yaw, distance (m), angle (rad)] do not count: for the runner-up (distance 0: all count).
    """
    levels = pyramid.shape[0]
    cell, evidence = window[0], window[6]
    n = points.shape[0]
    half, turns = math.ceil(window[1] / cell), math.ceil(window[2] / window[3])
    block = 1 << (levels - 1)
    across = (2 * half + block) // block
    xs, ys = np.empty((2 * turns + 1, n), np.int64), np.empty((2 * turns + 1, n), np.int64)
    scale = evidence / (255.0 * max(n, 1))
    per_cell = -0.5 * (cell / window[4]) ** 2
    bounds = np.empty((2 * turns + 1) * across * across)
    for k in range(2 * turns + 1):
        a = guess[2] + (k - turns) * window[3]
        c, s = math.cos(a), math.sin(a)
        for j in range(n):
            xs[k, j] = math.floor((guess[0] + c * points[j, 0] - s * points[j, 1] - corner[0]) / cell)
            ys[k, j] = math.floor((guess[1] + s * points[j, 0] + c * points[j, 1] - corner[1]) / cell)
        turned = -0.5 * ((k - turns) * window[3] / window[5]) ** 2
        for b in range(across * across):
            u, v = (b % across) * block - half, (b // across) * block - half
            near_u, near_v = max(0, u, -(u + block - 1)), max(0, v, -(v + block - 1))
            prior = turned + per_cell * (near_u * near_u + near_v * near_v)
            bounds[k * across * across + b] = prior + scale * block_score(pyramid[levels - 1], xs[k], ys[k], u, v)
    order = np.argsort(-bounds, kind="mergesort")
    best, best_u, best_v, best_k, raw = -1e300, 0, 0, turns, 0.0
    stack = np.empty((4 * levels, 3), np.int64)
    for i in range(order.shape[0]):
        if bounds[order[i]] <= best:
            break
        k, b = order[i] // (across * across), order[i] % (across * across)
        turned = -0.5 * ((k - turns) * window[3] / window[5]) ** 2
        stack[0, 0], stack[0, 1], stack[0, 2] = levels - 1, (b % across) * block - half, (b // across) * block - half
        top = 1
        while top > 0:
            top -= 1
            h, u, v = stack[top, 0], stack[top, 1], stack[top, 2]
            size = 1 << h
            near_u, near_v = max(0, u, -(u + size - 1)), max(0, v, -(v + size - 1))
            prior = turned + per_cell * (near_u * near_u + near_v * near_v)
            if prior + evidence <= best:
                continue
            total = block_score(pyramid[h], xs[k], ys[k], u, v)
            value = prior + scale * total
            if value <= best:
                continue
            if h > 0:
                step = size // 2
                for q in range(4):
                    stack[top, 0], stack[top, 1], stack[top, 2] = h - 1, u + (q % 2) * step, v + (q // 2) * step
                    top += 1
                continue
            if abs(u) > half or abs(v) > half:
                continue
            if other[3] > 0.0:
                away = math.hypot(guess[0] + u * cell - other[0], guess[1] + v * cell - other[1])
                turn = abs(guess[2] + (k - turns) * window[3] - other[2]) % (2.0 * math.pi)
                if away < other[3] and min(turn, 2.0 * math.pi - turn) < other[4]:
                    continue
            best, best_u, best_v, best_k, raw = value, u, v, k, total / (255.0 * max(n, 1))
    x, y = guess[0] + best_u * cell, guess[1] + best_v * cell
    return x, y, guess[2] + (best_k - turns) * window[3], best, raw


@kernel
def align_surface(pose, surface, sums, corner, settings, prior):
    """Return pose (3,), Hessian (3, 3), and [response, explained share, rms (m)] of a scan on surfaces (point to line).

    `surface` (n, 4): the scan; `sums` (ny, nx, 5); `settings` = [cell, sigma, greatest distance (m), iterations, share of the
    points that are independent]; `prior` = [x, y, yaw, then the upper triangle of its information]. Errors have the weight of
    Cauchy. The response is the mean likelihood of all points, 1 for points on surfaces.
    """
    ny, nx = sums.shape[:2]
    cell, sigma, farthest, share = settings[0], settings[1], settings[2], settings[4]
    n = surface.shape[0]
    found = pose.copy()
    hessian, quality = np.zeros((3, 3)), np.zeros(3)
    rounds = int(settings[3])
    for r in range(rounds + 1):
        c, s = math.cos(found[2]), math.sin(found[2])
        d = np.array([found[0] - prior[0], found[1] - prior[1], found[2] - prior[2]])
        d[2] -= 2.0 * math.pi * math.floor((d[2] + math.pi) / (2.0 * math.pi))
        hessian[0, 0], hessian[0, 1], hessian[0, 2] = prior[3], prior[4], prior[5]
        hessian[1, 1], hessian[1, 2], hessian[2, 2] = prior[6], prior[7], prior[8]
        hessian[1, 0], hessian[2, 0], hessian[2, 1] = prior[4], prior[5], prior[7]
        g = np.zeros(3)
        for a in range(3):
            g[a] = hessian[a, 0] * d[0] + hessian[a, 1] * d[1] + hessian[a, 2] * d[2]
        limit = farthest * max(1.0, 2.0 - 0.25 * r)  # wide at first
        response, explained, squares = 0.0, 0, 0.0
        for i in range(n):
            rx, ry = c * surface[i, 0] - s * surface[i, 1], s * surface[i, 0] + c * surface[i, 1]
            x, y = (found[0] + rx - corner[0]) / cell, (found[1] + ry - corner[1]) / cell
            ix, iy = math.floor(x), math.floor(y)
            ux = c * surface[i, 2] - s * surface[i, 3]
            uy = s * surface[i, 2] + c * surface[i, 3]
            near, qx, qy, mx, my = 1e9, 0.0, 0.0, 0.0, 0.0
            for v in range(max(iy - 2, 0), min(iy + 3, ny)):
                for u in range(max(ix - 2, 0), min(ix + 3, nx)):
                    count = sums[v, u, 0]
                    if count == 0.0:
                        continue
                    ex, ey = u + sums[v, u, 1] / count, v + sums[v, u, 2] / count
                    away = (ex - x) ** 2 + (ey - y) ** 2
                    # two sides of a thin wall are different surfaces
                    if away < near and ux * sums[v, u, 3] + uy * sums[v, u, 4] >= 0.0:
                        near, qx, qy, mx, my = away, ex, ey, sums[v, u, 3], sums[v, u, 4]
            distance = math.sqrt(near) * cell
            if distance > limit:
                continue
            norm = math.hypot(mx, my)
            if norm > 1e-9:
                mx, my = mx / norm, my / norm
                error = ((x - qx) * mx + (y - qy) * my) * cell
            else:
                error = distance
            response += math.exp(-0.5 * (error / 0.1) ** 2)
            if abs(error) < 0.12:
                explained += 1
                squares += error * error
            if norm <= 1e-9:
                continue
            weight = share / (sigma * sigma * (1.0 + (error / (2.0 * sigma)) ** 2))
            # a surface beside a corner explains a point of the corner, or of its other side, but must not pull at it
            weight *= (ux * mx + uy * my) ** 4
            turn = mx * -ry + my * rx
            hessian[0, 0] += weight * mx * mx
            hessian[0, 1] += weight * mx * my
            hessian[0, 2] += weight * mx * turn
            hessian[1, 1] += weight * my * my
            hessian[1, 2] += weight * my * turn
            hessian[2, 2] += weight * turn * turn
            g[0] += weight * mx * error
            g[1] += weight * my * error
            g[2] += weight * turn * error
        hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
        quality[0], quality[1] = response / max(n, 1), explained / max(n, 1)
        quality[2] = math.sqrt(squares / max(explained, 1))
        if r == rounds:
            break
        for a in range(3):
            hessian[a, a] += 1e-6
        step = solve3(hessian, g)
        for a in range(3):
            found[a] -= step[a]
        if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-6 and r < rounds - 1 and limit <= farthest:
            rounds = r + 1
    return found, hessian, quality


@kernel
def trace_free(free, eye, ends, corner, cell):
    """Set `free` (ny, nx) to 1 in the cells that the beams from `eye` (2,) to `ends` (n, 2) pass, but the last 3 of each."""
    ny, nx = free.shape
    x0, y0 = math.floor((eye[0] - corner[0]) / cell), math.floor((eye[1] - corner[1]) / cell)
    flat = free.ravel()
    if not (0 <= x0 < nx and 0 <= y0 < ny):
        return
    for i in range(ends.shape[0]):
        x, y = math.floor((ends[i, 0] - corner[0]) / cell), math.floor((ends[i, 1] - corner[1]) / cell)
        if not (0 <= x < nx and 0 <= y < ny):
            continue
        line = line_start(x0, y0, x, y, nx)
        at, error = y0 * nx + x0, line[0] // 2
        for _ in range(line[0] - 3):
            flat[at] = 1
            at, error = line_next(at, error, line)


WEAK: Final = 1.0 / 0.4**2
"""Information of the weak prior (1/m^2, 1/rad^2)."""


class Match(NamedTuple):
    """Where a scan fits on surfaces."""

    pose: NDArray[np.float64]
    """(3,) x, y (m), yaw (rad)."""
    hessian: NDArray[np.float64]
    """(3, 3) information about the pose, in the frame of the surfaces; without the prior if that was zero."""
    response: float
    """Mean likelihood of the points, 0 to 1."""
    explained: float
    """Share of the points on a surface."""
    rms: float
    """Of their distances from the surfaces (m)."""


class Surfaces:
    """The surfaces that some scans have seen, prepared for matching."""

    def __init__(self, scans: list[tuple[NDArray[np.float64], Transform2D]], *, searchable: bool = True) -> None:
        """`scans`: points with normals (n, 4) in the base frame, and the pose of the base, of each scan."""
        world = [pose.apply_points(np.ascontiguousarray(points[:, :2])) for points, pose in scans if len(points)]
        low = np.min([points.min(axis=0) for points in world], axis=0) if world else np.zeros(2)
        high = np.max([points.max(axis=0) for points in world], axis=0) if world else np.zeros(2)
        self.corner: NDArray[np.float64] = (np.floor(low / CELL) - MARGIN) * CELL
        nx, ny = (np.ceil((high - self.corner) / CELL).astype(int) + MARGIN).tolist()
        self.sums: NDArray[np.float32] = np.zeros((ny, nx, 5), np.float32)
        for points, pose in scans:
            if len(points):
                add_surface(self.sums, points, np.array(pose), self.corner, CELL)
        self.pyramid: NDArray[np.uint8] | None = (
            likelihood_pyramid(self.sums, CELL, SMEAR, LEVELS) if searchable else None
        )

    def search(
        self,
        points: NDArray[np.float64],
        guess: Transform2D,
        *,
        half_m: float,
        half_rad: float,
        sigma: tuple[float, float] = (1e3, 1e3),
        other: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
        step_rad: float = 0.015,
    ) -> tuple[Transform2D, float]:
        """Return the best pose around `guess` for points (n, 2 or more) and its mean likelihood; see `search_poses`."""
        if self.pyramid is None:
            self.pyramid = likelihood_pyramid(self.sums, CELL, SMEAR, LEVELS)
        every = max(1, len(points) // 100)
        thin = np.ascontiguousarray(points[::every, :2])
        window = np.array([CELL, half_m, half_rad, step_rad, *sigma, 20.0])
        x, y, yaw, _, mean = search_poses(self.pyramid, thin, np.array(guess), self.corner, window, np.array(other))
        return Transform2D(x, y, yaw), mean

    def align(
        self,
        surface: NDArray[np.float64],
        guess: Transform2D,
        prior: tuple[Transform2D, NDArray[np.float64]] | None = None,
        *,
        rounds: int = 20,
    ) -> Match:
        """Return the pose near `guess` at which the scan fits best; `prior`: a pose and its information (3, 3).

        Without one, a weak prior around the guess keeps a scan from sliding along a corridor. `rounds`: most iterations.
        """
        settings = np.array([CELL, SIGMA_M, INLIER_M, float(rounds), INDEPENDENT])
        row = np.zeros(9)
        row[:3] = guess
        row[[3, 6, 8]] = WEAK
        if prior is not None:
            row[:3] = prior[0]
            row[3:] = prior[1][np.triu_indices(3)]
        pose, hessian, quality = align_surface(np.array(guess), surface, self.sums, self.corner, settings, row)
        return Match(pose, hessian, *quality.tolist())

    def agreement(
        self, scans: list[tuple[NDArray[np.float64], NDArray[np.float64]]], points: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Return the shares of points (n, 2) near a surface, and in space that `scans` (eye, ends (m, 2)) have seen free.

        The rest is in space that nobody has seen, which says nothing about a pose.
        """
        ny, nx = self.sums.shape[:2]
        free = np.zeros((ny, nx), np.uint8)
        for eye, ends in scans:
            trace_free(free, eye, ends, self.corner, CELL)
        cells = np.floor((points - self.corner) / CELL).astype(np.int64)
        inside = ((cells >= 2) & (cells < np.array([nx - 2, ny - 2]))).all(axis=1)
        ix, iy = cells[inside].T
        near = np.zeros(len(ix), np.bool_)
        for v in range(-2, 3):
            for u in range(-2, 3):
                near |= self.sums[iy + v, ix + u, 0] > 0.0
        n = max(len(points), 1)
        return float(near.sum()) / n, float(((free[iy, ix] > 0) & ~near).sum()) / n
