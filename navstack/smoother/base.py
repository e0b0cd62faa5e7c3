"""The frame of smoothers that move points: pieces of one direction, headings, and the check of the result."""

from __future__ import annotations

import math
from abc import abstractmethod
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, Costmap, Footprint, Path, Pose2D
from navstack.core.collision import footprint_cost
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Smoother

_SAME_M: Final = 1e-4
"""Steps shorter than this in both axes have no direction (as in Nav2)."""


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
        out = self.unchecked(path, costmap)
        for first, last in self.pieces(path.poses):
            piece = slice(first, last + 1)
            if not is_good(path.poses[piece], out[piece], costmap, footprint, self.params.minimum_turning_radius):
                out[piece] = path.poses[piece]
        return Path(out, path.frame)

    def unchecked(self, path: Path, costmap: Costmap) -> NDArray[np.float64]:
        """Return the smoothed poses (n, 3) before they are checked, as Nav2's smoother returns them."""
        out = path.poses.copy()
        for first, last in self.pieces(path.poses):
            if last - first > self.shortest:
                piece = out[first : last + 1].copy()
                piece[:, :2] = self.move(piece[:, :2].copy(), costmap)
                set_headings(piece)
                out[first : last + 1] = piece
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
    """Whether a smoothed piece (m, 3) of a path (n, 3) is free and turns no more sharply than the radius, or than the piece did.

    A pose that collides no worse than the piece did is accepted if both have as many poses. `radius` (m): 0 = no limit.
    """
    if radius > 0.0:
        limit = max(1.0 / radius, curvatures(before).max(initial=0.0)) + 1e-6
        if curvatures(after).max(initial=0.0) > limit:
            return False
    if len(before) == len(after):
        return not any(
            not np.array_equal(old, new) and _is_worse(old, new, costmap, footprint)
            for old, new in zip(before, after, strict=True)
        )
    return all(_collision(new, costmap, footprint) == 0 for new in after)


def _is_worse(
    old: NDArray[np.float64], new: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None
) -> bool:
    level = _collision(new, costmap, footprint)
    return level > 0 and level > _collision(old, costmap, footprint)


def _collision(pose: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None) -> int:
    """Return 2 if the centre is in a blocked cell or outside, 1 if the footprint overlaps one, else 0."""
    x, y, yaw = (float(v) for v in pose)
    cost = costmap.cost_at(x, y)
    if cost is None or cost in (INSCRIBED, LETHAL):
        return 2
    if footprint is None or cost == 0:
        return 0
    return int(footprint_cost(costmap, footprint, Pose2D(x, y, yaw)) in (None, LETHAL))


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
