"""The frame of smoothers that move points: pieces of one direction, and their headings."""

from __future__ import annotations

import math
from abc import abstractmethod
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Smoother
from navstack.smoother._checks import SAME_M, folds, smooth_where_good, turns


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
