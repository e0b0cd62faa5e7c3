"""The frame of smoothers that move points: pieces of one direction, and their headings."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, InputError, Path, kernel, overlaps_lethal, place_footprint
from navstack.global_planner._curves import centered
from navstack.plugins import ParamModel, Smoother, param

# ----------------------------------------------------------------------------------------------------------------------
# Relaxation of paths toward their smooth form.


# pyright: basic


STEP = 0.1
"""Cells: largest motion of a point of the footprint between two checks of a motion."""
PADDING = 0.5 * STEP
"""Cells: a footprint with this padding that is free at the checks is free between them."""


@kernel
def relax(costs, grid, data, free, points, previous, weights, limits):
    """Move the `points` (n, 2) that are `free` (n,) toward the mean of their neighbors and toward `data` (n, 2), in sweeps.

    The ends stay. `costs` without cells: no point collides. `grid`: x and y of the origin, resolution. `weights`: of the data, of
    smoothness. `limits`: tolerance of a sweep (m), number of sweeps. `previous` is scratch. Returns whether it converged; if not,
    `points` are those of the last sweep without collision.
    """
    ny, nx = costs.shape
    n = len(points)
    previous[:] = points
    change = limits[0]
    sweeps = 0
    while change >= limits[0]:
        change = 0.0
        sweeps += 1
        if sweeps >= limits[1]:
            points[:] = previous
            return False
        for i in range(1, n - 1):
            if not free[i]:
                continue
            for j in range(2):
                old = points[i, j]
                points[i, j] = (
                    old
                    + weights[0] * (data[i, j] - old)
                    + weights[1] * (points[i + 1, j] + points[i - 1, j] - 2.0 * old)
                )
                change += abs(points[i, j] - old)
            if costs.size == 0:
                continue
            fx, fy = (points[i, 0] - grid[0]) / grid[2], (points[i, 1] - grid[1]) / grid[2]
            inside = fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny
            cost = np.int64(costs[np.int64(fy), np.int64(fx)]) if inside else 254
            if cost > 252 and cost != 255:
                points[:] = previous
                return False
        previous[:] = points
    return True


@kernel
def center_blocked(costs, x, y):
    """Return True if the robot's center, in cells, is in an inscribed or lethal cell, or outside the grid."""
    ny, nx = costs.shape
    if not (x >= 0.0 and y >= 0.0 and x < nx and y < ny):
        return True
    cost = costs[np.int64(y), np.int64(x)]
    return cost == 253 or cost == 254


@kernel
def pose_collision(costs, grid, corners, placed, padding, pose):
    """Return 2 if the center at a pose (3,), or a point `padding` cells next to it, is blocked, 1 if the footprint is, else 0.

    `corners` (2, n): of the footprint (m), n = 0 for none. `placed` (2, n) is scratch.
    """
    x, y = (pose[0] - grid[0]) / grid[2], (pose[1] - grid[1]) / grid[2]
    for dx in (-padding, padding):
        for dy in (-padding, padding):
            if center_blocked(costs, x + dx, y + dy):
                return 2
    if corners.shape[1] == 0:
        return 0
    inside = place_footprint(costs, grid[0], grid[1], grid[2], corners, pose[0], pose[1], pose[2], placed)
    return 1 if not inside or overlaps_lethal(costs, placed) else 0


@kernel
def is_empty(costs, grid, reach, a, b):
    """Return True if no cell within `reach` (m) of the box around two poses is inscribed, lethal or outside the grid."""
    ny, nx = costs.shape
    x0 = math.floor((min(a[0], b[0]) - reach - grid[0]) / grid[2])
    y0 = math.floor((min(a[1], b[1]) - reach - grid[1]) / grid[2])
    x1 = math.floor((max(a[0], b[0]) + reach - grid[0]) / grid[2])
    y1 = math.floor((max(a[1], b[1]) + reach - grid[1]) / grid[2])
    if x0 < 0 or y0 < 0 or x1 >= nx or y1 >= ny:
        return False
    for iy in range(y0, y1 + 1):
        for ix in range(x0, x1 + 1):
            if costs[iy, ix] == 253 or costs[iy, ix] == 254:
                return False
    return True


@kernel
def motion_collision(costs, grid, corners, padding, a, b):
    """Return the greatest `pose_collision` between the poses `a` and `b` (3,): on an arc, on a line where it turns by 0.5 rad."""
    reach = 2.0 * STEP * grid[2]
    for j in range(corners.shape[1]):
        reach = max(reach, math.hypot(corners[0, j], corners[1, j]))
    dx, dy = b[0] - a[0], b[1] - a[1]
    chord, turn = math.hypot(dx, dy), centered(b[2] - a[2])
    bend = math.sin(0.5 * turn) if abs(turn) < 0.5 else 0.0
    # an arc of less than 0.5 rad is at most a tenth longer than its chord and stays within an eighth of it
    if is_empty(costs, grid, reach + 0.13 * chord, a, b):
        return 0
    placed, pose = np.empty(corners.shape), np.empty(3)
    count = max(1, math.ceil((1.1 * chord + reach * abs(turn)) / (STEP * grid[2])))
    worst = 0
    for k in range(count):
        share = (k + 0.5) / count
        along, aside = share, 0.0
        if abs(bend) > 1e-6:
            # the chord of a part of the arc is turned from the whole chord by half of the rest of the turn
            part, angle = math.sin(0.5 * turn * share) / bend, 0.5 * turn * (1.0 - share)
            along, aside = part * math.cos(angle), -part * math.sin(angle)
        pose[0], pose[1] = a[0] + along * dx - aside * dy, a[1] + along * dy + aside * dx
        pose[2] = a[2] + share * turn
        worst = max(worst, pose_collision(costs, grid, corners, placed, padding, pose))
    return worst


@kernel
def collides_worse(costs, grid, exact, padded, before, after, worse):
    """Write which motions between successive poses of `after` (n, 3) collide worse than the same motions of `before` (m, 3).

    With m != n, any collision counts. `exact` and `padded`: corners of the footprint, and of that with PADDING. `worse` (n - 1,),
    or (1,) of a single pose.
    """
    same = len(before) == len(after)
    for i in range(len(worse)):
        j = min(i + 1, len(after) - 1)
        if same and (before[i] == after[i]).all() and (before[j] == after[j]).all():
            continue
        level = motion_collision(costs, grid, padded, PADDING, after[i], after[j])
        worse[i] = level > 0 and (not same or level > motion_collision(costs, grid, exact, 0.0, before[i], before[j]))


# ----------------------------------------------------------------------------------------------------------------------
# Where a smoothed piece of a path may not take the place of the piece: collisions, sharp turns, headings off the path, folds.


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
    """Return (m,) the poses of a smoothed piece (m, 3) of a path (n, 3) with `bend_faults`, or with a collision next to them.

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
    exact, padded = _corners(footprint, 0.0), _corners(footprint, PADDING * g.resolution)
    worse = np.zeros(max(1, len(after) - 1), np.bool_)
    collides_worse(costmap.data, grid, exact, padded, before, after, worse)
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


class PointSmootherParams(ParamModel):
    """Parameters of the smoothers that move points."""

    do_refinement: bool = param(True, "whether the result is smoothed again")
    refinement_num: int = param(2, "how many times it is smoothed again", ge=0, le=100)
    enforce_path_inversion: bool = param(
        True, "whether poses at which the direction of travel changes stay where they are"
    )
    minimum_turning_radius: float = param(
        0.0,
        "pieces whose result would turn more sharply than this, and more sharply than the path, stay as they are; 0 = no limit",
        unit="m",
        ge=0.0,
        ros_differs="Nav2's smoothers may break the turning radius",
    )


class PointSmoother(Smoother):
    """A smoother that moves the points of each piece between two cusps; subclasses say how."""

    params: Any

    @property
    @abstractmethod
    def shortest(self) -> int:
        """Pieces with at most this many steps stay as they are."""

    @abstractmethod
    def move(
        self, points: NDArray[np.float64], free: NDArray[np.bool_], costmap: Costmap | None
    ) -> NDArray[np.float64]:
        """Return smoother points (n, 2), of which only those that are `free` (n,) moved: never the ends.

        `costmap`: where Nav2 stops at obstacles, so does the result; None: it does not look at them.
        """

    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path; pieces whose result collides or turns too sharply stay as they are.

        Raises InputError for a path that is not finite.
        """
        require_finite(path)
        poses = path.poses
        out = poses.copy()
        for first, last in self.pieces(poses):
            out[first : last + 1] = self._smoothed(poses[first : last + 1], costmap, footprint)
        return Path(out, path.frame)

    def _smoothed(
        self, before: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Return a piece (n, 3), smoothed where the result is good; both ends stay with their headings."""
        if len(before) - 1 <= self.shortest:
            return before

        def smoothed(free: NDArray[np.bool_]) -> NDArray[np.float64]:
            after = self._moved(before, free, None)
            stay = ~(free | np.append(free[1:], False))
            stay[0] = True
            after[stay, 2] = before[stay, 2]
            return after

        return smooth_where_good(before, smoothed, costmap, footprint, self.params.minimum_turning_radius)

    def _moved(
        self, poses: NDArray[np.float64], free: NDArray[np.bool_], costmap: Costmap | None
    ) -> NDArray[np.float64]:
        """Return a piece (n, 3) with its free points moved and its headings set."""
        out = poses.copy()
        out[:, :2] = self.move(out[:, :2].copy(), free, costmap)
        set_headings(out)
        return out

    def unchecked(self, path: Path, costmap: Costmap) -> NDArray[np.float64]:
        """Return the smoothed poses (n, 3) before they are checked, as Nav2's smoother returns them."""
        out = path.poses.copy()
        for first, last in self.pieces(path.poses):
            if last - first > self.shortest:
                free = np.ones(last - first + 1, np.bool_)
                free[[0, -1]] = False
                out[first : last + 1] = self._moved(out[first : last + 1], free, costmap)
        return out

    def pieces(self, poses: NDArray[np.float64]) -> list[tuple[int, int]]:
        """Return first and last index of each piece; neighbors share the pose where the direction changes."""
        if len(poses) < 2:
            return []
        cuts = cusp_indices(poses) if self.params.enforce_path_inversion else []
        bounds = [0, *cuts, len(poses) - 1]
        return [(a, b) for a, b in pairwise(bounds) if b > a]


def require_finite(path: Path) -> None:
    """Raise InputError if a pose is not finite."""
    if not np.isfinite(path.poses).all():
        raise InputError("the path to be smoothed has poses that are not finite; give x, y (m) and yaw (rad)")


def cusp_indices(poses: NDArray[np.float64]) -> list[int]:
    """Return the poses at which the direction of the steps turns by more than a right angle, or the robot turns in place."""
    still = (np.abs(np.diff(poses[:, :2], axis=0)) < SAME_M).all(axis=1)
    in_place = still & (turns(poses) > SAME_M)
    return (np.flatnonzero(folds(poses) | in_place[:-1]) + 1).tolist()


def set_headings(poses: NDArray[np.float64]) -> None:
    """Set the headings to the directions of the steps, reversed where the piece is driven backward; the last one stays."""
    if len(poses) < 3:
        return
    dx, dy = poses[2, :2] - poses[1, :2]
    backward = abs(math.remainder(math.atan2(dy, dx) - poses[1, 2], 2.0 * math.pi)) > 0.5 * math.pi
    steps = np.diff(poses[:, :2], axis=0)
    moves = (np.abs(steps) >= SAME_M).any(axis=1)
    yaws = np.arctan2(steps[:, 1], steps[:, 0]) + (math.pi if backward else 0.0)
    yaws = np.pi - np.remainder(np.pi - yaws, 2.0 * np.pi)
    poses[:-1][moves, 2] = yaws[moves]
