"""Where a smoothed piece of a path may not take the place of the piece: collisions, sharp turns, headings off the path, folds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint
from navstack.smoother import _smoother_kernels as kernels

Array = NDArray[np.float64]
SAME_M: Final = 1e-4
"""Steps shorter than this in both axes have no direction (as in Nav2)."""
_SHARP: Final = 0.25 * math.pi + 1e-6
"""Radians: a result turns by more than this between two poses only if the path did."""
_OFF: Final = 0.15
"""Radians: a heading of a result is further off its steps only if one of the path was."""
_DISCRETE: Final = 0.02
"""Share by which the curvature by headings may exceed the limit, because each is that of a step, not of a point."""


def smooth_where_good(
    before: Array,
    smoothed: Callable[[NDArray[np.bool_]], Array],
    costmap: Costmap,
    footprint: Footprint | None,
    radius: float,
) -> Array:
    """Return a piece (n, 3) smoothed except where the result is not good, with as few poses as possible that stay.

    `smoothed` returns the piece (n, 3) with the given poses (n,) free to move. Where there are `bad_poses`, they stay with those
    around them, and the rest is smoothed again, until none is left.
    """
    free = np.ones(len(before), np.bool_)
    free[[0, -1]] = False
    margin = 0
    while free.any():
        after = smoothed(free)
        bad = bad_poses(before, after, costmap, footprint, radius)
        if not bad.any():
            return after
        for k in np.flatnonzero(bad).tolist():
            free[max(0, k - margin) : k + margin + 1] = False
        margin = max(1, 2 * margin)
    return before


def is_good(before: Array, after: Array, costmap: Costmap, footprint: Footprint | None, radius: float) -> bool:
    """Whether no pose of a smoothed piece (m, 3) of a path (n, 3) is one of `bad_poses`."""
    return not (bend_faults(before, after, radius).any() or _collisions(before, after, costmap, footprint).any())


def bad_poses(
    before: Array, after: Array, costmap: Costmap, footprint: Footprint | None, radius: float
) -> NDArray[np.bool_]:
    """Return (m,) the poses of a smoothed piece (m, 3) of a path (n, 3) with `bend_faults`, or with a collision beside them.

    A motion that collides no worse than that of the piece is accepted if both have as many poses.
    """
    bad = bend_faults(before, after, radius)
    _mark_motions(bad, _collisions(before, after, costmap, footprint)[: len(after) - 1])
    return bad


def bend_faults(before: Array, after: Array, radius: float) -> NDArray[np.bool_]:
    """Return (m,) the poses of a smoothed piece (m, 3) that turn more sharply than the radius, and than the piece (n, 3) did.

    `radius` (m): 0 = no limit; then 45 degrees between two poses are allowed. Headings follow the steps, and there are no more
    folds than the piece had. Where an end of the piece was off its path or turned more sharply, that end may do so again.
    """
    bad = np.zeros(len(after), np.bool_)
    if len(after) < 2:
        return bad
    folded, folds_after = folds(before), folds(after)
    if folds_after.sum() > folded.sum():
        bad[1:-1] |= folds_after
    bad |= _exceeds(heading_errors(before), heading_errors(after), _OFF)
    motions = _exceeds(turns(before), turns(after), _SHARP)
    if radius > 0.0:
        bad[1:-1] |= ~folds_after & (
            curvatures(after) > max(1.0 / radius, curvatures(before)[~folded].max(initial=0.0)) + 1e-6
        )
        bad[[0, -1]] |= _end_curvatures(after) > np.maximum(1.0 / radius, _end_curvatures(before)) * (1.0 + _DISCRETE)
        motions |= _exceeds(heading_rates(before), heading_rates(after), 1.0 / radius, 1.0 + _DISCRETE)
    _mark_motions(bad, motions)
    return bad


def _exceeds(before: Array, after: Array, least: float, slack: float = 1.0) -> NDArray[np.bool_]:
    """Return which values (m,) exceed a limit, `before` (n,) between its ends, and, at an end, `before` there."""
    limits = np.full(len(after), max(least, before[1:-1].max(initial=0.0)))
    limits[[0, -1]] = np.maximum(limits[[0, -1]], before[[0, -1]])
    return after > limits * slack + 1e-6


def _mark_motions(bad: NDArray[np.bool_], motions: NDArray[np.bool_]) -> None:
    """Mark both poses of each motion."""
    bad[:-1] |= motions
    bad[1:] |= motions


def _collisions(before: Array, after: Array, costmap: Costmap, footprint: Footprint | None) -> NDArray[np.bool_]:
    """Return the motions of `after` that collide worse than those of `before`; of a single pose, whether it does."""
    g = costmap.geometry
    grid = np.array([g.origin_x, g.origin_y, g.resolution])
    exact, padded = _corners(footprint, 0.0), _corners(footprint, kernels.PADDING * g.resolution)
    worse = np.zeros(max(1, len(after) - 1), np.bool_)
    kernels.collides_worse(costmap.data, grid, exact, padded, before, after, worse)
    return worse


@lru_cache(maxsize=32)
def _corners(footprint: Footprint | None, padding: float) -> Array:
    """Corners (2, n) of a footprint that is padded on all sides (m); none without a footprint."""
    if footprint is None:
        return np.empty((2, 0))
    padded = (
        footprint.polygon.buffer(padding, join_style="mitre", mitre_limit=3.0) if padding > 0.0 else footprint.polygon
    )
    return np.ascontiguousarray(np.asarray(padded.exterior.coords)[:-1].T)


def turns(poses: Array) -> Array:
    """Return the angles (rad) between the headings of successive poses."""
    return np.abs(np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)


def heading_errors(poses: Array) -> Array:
    """Return (n,) how far (rad) each heading, or its opposite, is outside those between the steps to and from the pose."""
    steps = np.diff(poses[:, :2], axis=0)
    moves = (np.abs(steps) >= SAME_M).any(axis=1)
    course = np.arctan2(steps[:, 1], steps[:, 0])
    off = np.remainder(np.stack((poses[1:, 2], poses[:-1, 2])) - course + 0.5 * np.pi, np.pi) - 0.5 * np.pi
    to, onward = np.where(moves, off, 0.0)
    errors = np.abs(np.concatenate((onward[:1], to)))
    between = to[:-1] * onward[1:] <= 0.0
    errors[1:-1] = np.where(between, 0.0, np.minimum(errors[1:-1], np.abs(onward[1:])))
    return errors


def _end_curvatures(poses: Array) -> Array:
    """The curvatures (1/m) of the circles that leave the first pose, and reach the last one, with its heading."""
    chords = np.hypot(*np.diff(poses[:, :2], axis=0)[[0, -1]].T)
    return np.where(chords > SAME_M, 2.0 * np.sin(heading_errors(poses)[[0, -1]]) / np.maximum(chords, SAME_M), 0.0)


def folds(poses: Array) -> NDArray[np.bool_]:
    """Return the inner poses at which the direction of the steps turns by more than a right angle."""
    steps = np.diff(poses[:, :2], axis=0)
    return np.einsum("ij,ij->i", steps[:-1], steps[1:]) < 0.0


def heading_rates(poses: Array) -> Array:
    """Return the curvature (1/m) by the headings of successive poses.

    A heading is that of the next step, or that at the pose; so the turn counts over the longer of the step and the mean of the
    step and the next one.
    """
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    length = np.maximum(length, 0.5 * (length + np.append(length[1:], 0.0)))
    return np.where(length > SAME_M, 2.0 * np.sin(0.5 * turns(poses)) / np.maximum(length, SAME_M), 0.0)


def curvatures(poses: Array) -> Array:
    """Return the curvature (1/m) of the circle through each three successive points."""
    a, b = np.diff(poses[:-1, :2], axis=0), np.diff(poses[1:, :2], axis=0)
    cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    product = np.hypot(*a.T) * np.hypot(*b.T) * np.hypot(*(a + b).T)
    return np.where(product > 1e-15, 2.0 * cross / np.maximum(product, 1e-15), 0.0)
