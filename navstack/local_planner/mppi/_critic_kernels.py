# pyright: basic
"""Scores of a batch. `points` and `speeds` are (3, T, K) float32, see `Batch`; scores (K,) are added to or written."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

f32 = np.float32
TWO_PI = f32(2.0 * math.pi)


@kernel
def wrapped(angle):
    """Return the absolute value of an angle (rad) in (-pi, pi]."""
    return abs(angle - TWO_PI * np.floor(angle * f32(1.0 / (2.0 * math.pi)) + f32(0.5)))


@kernel
def add_outside(row, low, high, weight, out):
    """Add `weight` times how far the values of `row` (K,) are outside of low .. high to `out` (K,)."""
    for k in range(len(row)):
        out[k] += (max(row[k] - high, f32(0.0)) + max(low - row[k], f32(0.0))) * weight


@kernel
def constraint_scores(speeds, highest, lowest, radius, omni, dt, out):
    """Violations of the limits `lowest` .. `highest` (3,) of vx and vy, and of the turning radius (m), times their duration."""
    out[:] = f32(0.0)
    steps, number = speeds.shape[1], speeds.shape[2]
    for t in range(steps):
        add_outside(speeds[0, t], lowest[0], highest[0], dt, out)
        if omni:
            add_outside(speeds[1, t], lowest[1], highest[1], dt, out)
        if radius > f32(0.0):
            forward, turning = speeds[0, t], speeds[2, t]
            for k in range(number):
                out[k] += max(radius - abs(forward[k]) / max(abs(turning[k]), f32(1e-6)), f32(0.0)) * dt


@kernel
def backward_scores(speeds, dt, out):
    """Distance driven backward (m)."""
    out[:] = f32(0.0)
    for t in range(speeds.shape[1]):
        row = speeds[0, t]
        for k in range(len(out)):
            out[k] += max(-row[k], f32(0.0)) * dt


@kernel
def turning_scores(speeds, out):
    """Mean absolute turning speed (rad/s)."""
    out[:] = f32(0.0)
    scale = f32(1.0 / speeds.shape[1])
    for t in range(speeds.shape[1]):
        row = speeds[2, t]
        for k in range(len(out)):
            out[k] += abs(row[k]) * scale


@kernel
def deadband_scores(speeds, bands, omni, dt, out):
    """How far the speeds are below `bands` (3,), times the duration."""
    out[:] = f32(0.0)
    for t in range(speeds.shape[1]):
        for axis in range(3):
            if axis == 1 and not omni:
                continue
            row, band = speeds[axis, t], bands[axis]
            for k in range(len(out)):
                out[k] += max(band - abs(row[k]), f32(0.0)) * dt


@kernel
def distance_scores(points, x, y, out):
    """Mean distance of the points to (x, y)."""
    out[:] = f32(0.0)
    scale = f32(1.0 / points.shape[1])
    for t in range(points.shape[1]):
        px, py = points[0, t], points[1, t]
        for k in range(len(out)):
            dx, dy = px[k] - x, py[k] - y
            out[k] += np.sqrt(dx * dx + dy * dy) * scale


@kernel
def heading_scores(points, yaw, symmetric, out):
    """Mean angle between the headings and `yaw`; with `symmetric` also its opposite counts."""
    out[:] = f32(0.0)
    scale = f32(1.0 / points.shape[1])
    for t in range(points.shape[1]):
        row = points[2, t]
        for k in range(len(out)):
            error = wrapped(row[k] - yaw)
            if symmetric:
                error = min(error, f32(math.pi) - error)
            out[k] += error * scale


@kernel
def endpoint_scores(points, x, y, out):
    """Distance of the last point to (x, y)."""
    px, py = points[0, points.shape[1] - 1], points[1, points.shape[1] - 1]
    for k in range(len(out)):
        dx, dy = px[k] - x, py[k] - y
        out[k] = np.sqrt(dx * dx + dy * dy)


@kernel
def bearing_scores(points, x, y, path_yaw, mode, out):
    """Angle between the last heading and the bearing of (x, y) from the last point.

    `mode` 0: forward; 1: the bearing or its opposite, whichever is nearer to the heading; 2: the one nearer to `path_yaw`.
    """
    last = points.shape[1] - 1
    px, py, yaws = points[0, last], points[1, last], points[2, last]
    for k in range(len(out)):
        bearing = np.arctan2(y - py[k], x - px[k])
        error = wrapped(yaws[k] - bearing)
        opposite = f32(math.pi) - error
        if mode == 1:
            error = min(error, opposite)
        elif mode == 2 and wrapped(bearing - path_yaw) > f32(0.5 * math.pi):
            error = opposite
        out[k] = error


@kernel
def travelled(points, begin, out):
    """Length of the trajectories from point `begin` on (m)."""
    out[:] = f32(0.0)
    for t in range(begin + 1, points.shape[1]):
        x, y = points[0, t], points[1, t]
        before_x, before_y = points[0, t - 1], points[1, t - 1]
        for k in range(len(out)):
            dx, dy = x[k] - before_x[k], y[k] - before_y[k]
            out[k] += np.sqrt(dx * dx + dy * dy)


@kernel
def furthest_pose(points, number, path, length, nearest, scratch):
    """Return the largest index of the pose of `path` (4, n) that is the nearest to the last point of a trajectory.

    For each of the first `number` trajectories the poses up to the first one with an arc length (row 3) of at least its own
    `length` (K,) are considered. `nearest` (K,) int32 and `scratch` (K,) are work space.
    """
    last = points.shape[1] - 1
    px, py = points[0, last], points[1, last]
    for k in range(len(nearest)):
        nearest[k] = 0
        scratch[k] = f32(np.inf)
    for i in range(path.shape[1]):
        x, y = path[0, i], path[1, i]
        before = path[3, i - 1] if i > 0 else f32(-1.0)
        at = np.int32(i)
        for k in range(len(nearest)):
            dx, dy = px[k] - x, py[k] - y
            distance = dx * dx + dy * dy
            distance = distance if before < length[k] else f32(np.inf)
            nearer = distance < scratch[k]
            nearest[k] = at if nearer else nearest[k]
            scratch[k] = distance if nearer else scratch[k]
    furthest = np.int32(0)
    for k in range(number):
        furthest = max(furthest, nearest[k])
    return np.int64(furthest)


@kernel
def align_scores(points, path, valid, count, step, use_yaw, number, out):
    """Mean distance of every `step`-th point to the pose of `path` (4, n) at the arc length driven so far.

    Among the first `count` poses; points whose pose is not `valid` (n,) do not count. The trajectory's length is that of the
    polyline of these points; the search for its pose only moves forward.
    """
    lanes = len(out)
    driven = np.zeros(lanes, np.float32)
    total = np.zeros(lanes, np.float32)
    counted = np.zeros(lanes, np.float32)
    at = np.zeros(lanes, np.int32)
    arc = path[3]
    for t in range(step, points.shape[1], step):
        x, y, yaw = points[0, t], points[1, t], points[2, t]
        before_x, before_y = points[0, t - step], points[1, t - step]
        for k in range(lanes):
            dx, dy = x[k] - before_x[k], y[k] - before_y[k]
            driven[k] += np.sqrt(dx * dx + dy * dy)
        for k in range(number):
            i, distance = at[k], driven[k]
            while i + 1 < count and arc[i + 1] <= distance:
                i += np.int32(1)
            at[k] = i
            if i + 1 < count and not distance - arc[i] < arc[i + 1] - distance:
                i += np.int32(1)
            if valid[i]:
                dx, dy = path[0, i] - x[k], path[1, i] - y[k]
                squared = dx * dx + dy * dy
                if use_yaw:
                    turn = wrapped(path[2, i] - yaw[k])
                    squared += turn * turn
                total[k] += np.sqrt(squared)
                counted[k] += f32(1.0)
    for k in range(lanes):
        out[k] = total[k] / counted[k] if counted[k] > f32(0.0) else f32(0.0)


@kernel
def legacy_align_scores(points, path, valid, step, use_yaw, out):
    """Sum of the distances of every `step`-th point to the nearest pose of `path` (4, n), divided by their number.

    A point counts if that pose is `valid` and not the first one.
    """
    lanes = len(out)
    out[:] = f32(0.0)
    for t in range(step, points.shape[1], step):
        x, y, yaw = points[0, t], points[1, t], points[2, t]
        for k in range(lanes):
            best, nearest = f32(np.inf), 0
            for i in range(path.shape[1]):
                dx, dy = path[0, i] - x[k], path[1, i] - y[k]
                squared = dx * dx + dy * dy
                if use_yaw:
                    turn = wrapped(path[2, i] - yaw[k])
                    squared += turn * turn
                if squared < best:
                    best, nearest = squared, i
            if nearest > 0 and valid[nearest]:
                out[k] += np.sqrt(best)
    count = f32(points.shape[1] // step)
    for k in range(lanes):
        out[k] /= count


@kernel
def add_powered(scores, weight, power, totals):
    """Turn raw `scores` (K,) into (weight * score) ** power, and add them to `totals` (K,)."""
    for k in range(len(scores)):
        scores[k] = scores[k] * weight
    if power > 1:
        for k in range(len(scores)):
            value = scores[k]
            for _ in range(power - 1):
                value *= scores[k]
            scores[k] = value
    for k in range(len(scores)):
        totals[k] += scores[k]
