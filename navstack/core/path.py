"""Paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.geometry import Pose2D, Transform2D


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Poses (n, 3) float64 = x, y (m), yaw (rad), in `frame`."""

    poses: NDArray[np.float64]
    frame: str = "map"

    def __post_init__(self) -> None:
        if self.poses.ndim != 2 or self.poses.shape[1] != 3:
            raise InputError(f"the poses of a path must be an array of shape (n, 3), not {self.poses.shape}")

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Pose2D:
        x, y, yaw = self.poses[index]
        return Pose2D(float(x), float(y), float(yaw))

    @property
    def length(self) -> float:
        """Sum of the distances between successive positions (m)."""
        if len(self.poses) < 2:
            return 0.0
        x, y = self.poses[:, 0], self.poses[:, 1]
        return float(np.hypot(x[1:] - x[:-1], y[1:] - y[:-1]).sum())

    @property
    def directions(self) -> NDArray[np.int8]:
        """(n,) direction of travel at each pose: 1 forward, -1 backward, 0 in place (or without motion).

        It is that of the step from the pose to the next one, against the heading; the last pose has that of the step before.
        A plan of a planner that ignores headings has meaningless directions.
        """
        if len(self.poses) < 2:
            return np.zeros(len(self.poses), np.int8)
        steps = np.diff(self.poses[:, :2], axis=0)
        yaw = self.poses[:-1, 2] + 0.5 * (np.remainder(np.diff(self.poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)
        along = steps[:, 0] * np.cos(yaw) + steps[:, 1] * np.sin(yaw)
        signs = np.where(np.hypot(steps[:, 0], steps[:, 1]) < 1e-9, 0, np.sign(along)).astype(np.int8)
        return np.append(signs, signs[-1])

    @property
    def cusps(self) -> int:
        """Number of changes between driving forward and backward, by `directions`."""
        signs = self.directions
        signs = signs[signs != 0]
        return int((signs[1:] != signs[:-1]).sum())

    def transformed(self, transform: Transform2D, frame: str) -> Path:
        """Return the path in `frame`; `transform` is the pose of this path's frame in it."""
        return Path(transform.apply_poses(self.poses), frame)

    def __repr__(self) -> str:
        return f"Path({len(self)} poses, {self.length:.2f} m, frame {self.frame!r})"
