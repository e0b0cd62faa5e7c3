"""Curves of a path that are tighter than a base can drive."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from navstack.core.geometry import Pose2D
from navstack.core.path import Path

STEP_SHARE = 0.25
"""Length of the chords at which a path is measured, as a share of the turning radius."""
SLACK = 0.1
"""Relative excess of the curvature that counts as noise of a path made of cells."""
MOST_CHORDS = 100_000


def reversals(poses: NDArray[np.float64]) -> list[int]:
    """Return the indices of the poses (n, 2 or more; m) at which the path changes its direction: where it turns back."""
    d = np.diff(poses[:, :2], axis=0)
    moving = np.flatnonzero(np.hypot(d[:, 0], d[:, 1]) > 1e-4)
    dots = (d[moving[:-1]] * d[moving[1:]]).sum(axis=1)
    return [int(moving[k + 1]) for k in np.flatnonzero(dots < 0.0)]


def tight_turn(path: Path, radius: float) -> tuple[float, Pose2D] | None:
    """Return radius (m) and place of the first curve of `path` below `radius` (m); None if a base can drive all of it.

    The path between two changes of direction is measured by chords of a quarter of the radius: two chords c of a circle meet at
    the angle 2 asin(c / 2R). Corners of cells are smaller than that, so that a path along cells is not all corners.
    """
    if radius <= 0.0 or len(path) < 3:
        return None
    ends = [0, *reversals(path.poses), len(path) - 1]
    for first, last in pairwise(ends):
        found = _tight_in(path.poses[first : last + 1], radius)
        if found is not None:
            return found
    return None


def _tight_in(poses: NDArray[np.float64], radius: float) -> tuple[float, Pose2D] | None:
    """The same for a piece without a change of direction."""
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
    count = min(int(way[-1] / (STEP_SHARE * radius)), MOST_CHORDS)
    if count < 2:
        return None
    at = np.linspace(0.0, way[-1], count + 1)
    x, y = np.interp(at, way, poses[:, 0]), np.interp(at, way, poses[:, 1])
    dx, dy = np.diff(x), np.diff(y)
    chords = np.hypot(dx, dy)
    turns = np.abs(np.arctan2(dx[:-1] * dy[1:] - dy[:-1] * dx[1:], dx[:-1] * dx[1:] + dy[:-1] * dy[1:]))
    curvatures = 2.0 * np.sin(0.5 * turns) / np.maximum(np.minimum(chords[:-1], chords[1:]), 1e-9)
    broken = np.flatnonzero(curvatures > (1.0 + SLACK) / radius)
    if not len(broken):
        return None
    k = int(broken[0])
    return 1.0 / float(curvatures[k]), Pose2D(float(x[k + 1]), float(y[k + 1]), math.atan2(dy[k], dx[k]))


def turn_note(path: Path, radius: float) -> str | None:
    """Return a sentence about the first curve of `path` that is tighter than `radius` (m), None without one."""
    found = tight_turn(path, radius)
    if found is None:
        return None
    tightest, at = found
    return (
        f"the path turns on {tightest:.2f} m at ({at.x:.2f}, {at.y:.2f}), but the base turns on {radius:g} m at least, so it "
        "leaves the path there; use a planner that keeps to the turning radius"
    )
