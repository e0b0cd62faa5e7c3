"""The frame of smoothers that move points: pieces of one direction, headings, and the check of the result."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Smoother
from navstack.smoother import _smoother_kernels as kernels

_SAME_M: Final = 1e-4
"""Steps shorter than this in both axes have no direction (as in Nav2)."""
_SHARP: Final = 0.25 * math.pi + 1e-6
"""Radians: a result turns by more than this between two poses, or moves by more beside its headings, only if the path did."""
_DISCRETE: Final = 0.02
"""Share by which the curvature by headings may exceed the limit, because each is that of a step, not of a point."""


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
    def move(self, points: NDArray[np.float64], costmap: Costmap) -> NDArray[np.float64]:
        """Return smoother points (n, 2) with the same ends."""

    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path; pieces whose result collides or turns too sharply stay as they are.

        Raises InputError for a path that is not finite.
        """
        if not np.isfinite(path.poses).all():
            raise InputError("the path to be smoothed has poses that are not finite; give x, y (m) and yaw (rad)")
        poses = path.poses
        out = poses.copy()
        for first, last in self.pieces(poses):
            out[first : last + 1] = self._smoothed(poses[first : last + 1], costmap, footprint)
        return Path(out, path.frame)

    def _smoothed(
        self, before: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Return a piece (n, 3), smoothed where the result is good; both ends stay with their headings.

        Where it is not, both halves are smoothed on their own, so that a narrow place leaves the rest of the piece smooth.
        """
        if len(before) - 1 <= self.shortest:
            return before
        radius = self.params.minimum_turning_radius
        after = self._moved(before, costmap)
        after[[0, -1], 2] = before[[0, -1], 2]
        moved = not np.array_equal(before[:, :2], after[:, :2])  # simple moves nothing if its first step collides
        if moved and is_good(before, after, costmap, footprint, radius):
            return after
        middle = len(before) // 2
        halves = [self._smoothed(part, costmap, footprint) for part in (before[: middle + 1], before[middle:])]
        after = np.concatenate((halves[0][:-1], halves[1]))
        return after if is_smooth(before, after, radius) else before

    def _moved(self, poses: NDArray[np.float64], costmap: Costmap) -> NDArray[np.float64]:
        """Return a piece (n, 3) with its points moved and its headings set."""
        out = poses.copy()
        out[:, :2] = self.move(out[:, :2].copy(), costmap)
        set_headings(out)
        return out

    def unchecked(self, path: Path, costmap: Costmap) -> NDArray[np.float64]:
        """Return the smoothed poses (n, 3) before they are checked, as Nav2's smoother returns them."""
        out = path.poses.copy()
        for first, last in self.pieces(path.poses):
            if last - first > self.shortest:
                out[first : last + 1] = self._moved(out[first : last + 1], costmap)
        return out

    def pieces(self, poses: NDArray[np.float64]) -> list[tuple[int, int]]:
        """Return first and last index of each piece; neighbors share the pose where the direction changes."""
        if len(poses) < 2:
            return []
        cuts = cusp_indices(poses) if self.params.enforce_path_inversion else []
        bounds = [0, *cuts, len(poses) - 1]
        return [(a, b) for a, b in pairwise(bounds) if b > a]


def is_good(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    costmap: Costmap,
    footprint: Footprint | None,
    radius: float,
) -> bool:
    """Whether a smoothed piece (m, 3) of a path (n, 3) may take its place: `is_smooth`, and free between its poses, too.

    A motion that collides no worse than that of the piece is accepted if both have as many poses.
    """
    if not is_smooth(before, after, radius):
        return False
    g = costmap.geometry
    grid = np.array([g.origin_x, g.origin_y, g.resolution])
    exact, padded = _corners(footprint, 0.0), _corners(footprint, kernels.PADDING * g.resolution)
    return not kernels.collides_worse(costmap.data, grid, exact, padded, before, after)


def is_smooth(before: NDArray[np.float64], after: NDArray[np.float64], radius: float) -> bool:
    """Whether a smoothed piece (m, 3) turns no more sharply than the radius, or than the piece (n, 3) did, along its headings.

    `radius` (m): 0 = no limit. Without one, 45 degrees between two poses are allowed, and no more folds than the piece had.
    """
    if _folds(after) > _folds(before):
        return False
    for angles in (_turns, _slips):
        if angles(after).max(initial=0.0) > max(_SHARP, angles(before).max(initial=0.0)):
            return False
    for rates, slack in ((curvatures, 0.0), (heading_rates, _DISCRETE)) if radius > 0.0 else ():
        limit = max(1.0 / radius, rates(before).max(initial=0.0)) * (1.0 + slack) + 1e-6
        if rates(after).max(initial=0.0) > limit:
            return False
    return True


@lru_cache(maxsize=32)
def _corners(footprint: Footprint | None, padding: float) -> NDArray[np.float64]:
    """Corners (2, n) of a footprint that is padded on all sides (m); none without a footprint."""
    if footprint is None:
        return np.empty((2, 0))
    padded = (
        footprint.polygon.buffer(padding, join_style="mitre", mitre_limit=3.0) if padding > 0.0 else footprint.polygon
    )
    return np.ascontiguousarray(np.asarray(padded.exterior.coords)[:-1].T)


def _turns(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angles (rad) between the headings of successive poses."""
    return np.abs(np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)


def _slips(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angles (rad) between the steps of a length and the mean headings, or their opposites."""
    steps = np.diff(poses[:, :2], axis=0)
    moves = (np.abs(steps) >= _SAME_M).any(axis=1)
    yaws = poses[:-1, 2] + 0.5 * (np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)
    off = np.arctan2(steps[:, 1], steps[:, 0]) - yaws
    return np.arcsin(np.minimum(np.abs(np.sin(off[moves])), 1.0))


def _folds(poses: NDArray[np.float64]) -> int:
    """How often the direction of the steps turns by more than a right angle."""
    steps = np.diff(poses[:, :2], axis=0)
    return int((np.einsum("ij,ij->i", steps[:-1], steps[1:]) < 0.0).sum())


def heading_rates(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the curvature (1/m) by the headings of successive poses.

    A heading is that of the next step, or that at the pose; so the turn counts over the longer of the step and the mean of the
    step and the next one.
    """
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    length = np.maximum(length, 0.5 * (length + np.append(length[1:], 0.0)))
    return np.where(length > _SAME_M, 2.0 * np.sin(0.5 * _turns(poses)) / np.maximum(length, _SAME_M), 0.0)


def cusp_indices(poses: NDArray[np.float64]) -> list[int]:
    """Return the poses at which the direction of the steps turns by more than a right angle, or the robot turns in place."""
    found: list[int] = []
    steps = np.diff(poses[:, :2], axis=0)
    for i in range(1, len(poses) - 1):
        turn = abs(math.remainder(poses[i, 2] - poses[i - 1, 2], 2.0 * math.pi))
        in_place = (np.abs(steps[i - 1]) < _SAME_M).all() and turn > _SAME_M
        if float(steps[i - 1] @ steps[i]) < 0.0 or in_place:
            found.append(i)
    return found


def set_headings(poses: NDArray[np.float64]) -> None:
    """Set the headings to the directions of the steps, reversed where the piece is driven backward; the last one stays."""
    if len(poses) < 3:
        return
    dx, dy = poses[2, :2] - poses[1, :2]
    backward = abs(math.remainder(math.atan2(dy, dx) - poses[1, 2], 2.0 * math.pi)) > 0.5 * math.pi
    steps = np.diff(poses[:, :2], axis=0)
    moves = (np.abs(steps) >= _SAME_M).any(axis=1)
    yaws = np.arctan2(steps[:, 1], steps[:, 0]) + (math.pi if backward else 0.0)
    yaws = np.pi - np.remainder(np.pi - yaws, 2.0 * np.pi)
    poses[:-1][moves, 2] = yaws[moves]


def curvatures(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the curvature (1/m) of the circle through each three successive points."""
    a, b = np.diff(poses[:-1, :2], axis=0), np.diff(poses[1:, :2], axis=0)
    cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    product = np.hypot(*a.T) * np.hypot(*b.T) * np.hypot(*(a + b).T)
    return np.where(product > 1e-15, 2.0 * cross / np.maximum(product, 1e-15), 0.0)
