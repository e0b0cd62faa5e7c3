"""Simulated trajectories, the limits they keep, and the interface of what generates them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import RobotState


class VelocityLimits(NamedTuple):
    """Limits of the base in m/s, rad/s, m/s² and rad/s²; recovery behaviors read them, too."""

    max_vel_x: float
    min_vel_x: float
    max_vel_y: float
    min_vel_y: float
    max_vel_trans: float
    min_vel_trans: float
    max_vel_theta: float
    min_vel_theta: float
    acc_lim_x: float
    acc_lim_y: float
    acc_lim_theta: float
    yaw_goal_tolerance: float
    min_turning_radius: float = 0.0
    """Radius (m) of the tightest curve that the base drives; 0: it can turn in place."""


_UNSET = np.empty(0, np.bool_)


@dataclass(slots=True, eq=False)
class Rollouts:
    """K simulated trajectories of at most T points in the costmap's frame; row k has `counts[k]` valid points."""

    commands: NDArray[np.float64]
    """(K, 3) velocities vx, vy, wz of the first step: what the robot is commanded if the row is selected."""
    poses: NDArray[np.float64]
    """(K, T, 3) x, y, yaw; the first point is the current pose."""
    counts: NDArray[np.int64]
    """(K,) points per row; 0: outside the speed limits, not simulated."""
    alive: NDArray[np.bool_] = field(default_factory=lambda: _UNSET)
    """(K,) rows that no critic has rejected in this cycle; a critic may skip the others. By default all rows with points."""
    seconds: NDArray[np.float64] | None = None
    """(K,) time between two points of a row (s); None if the generator does not say."""

    def __post_init__(self) -> None:
        if self.alive is _UNSET:
            self.alive = self.counts > 0


class RolloutCells(NamedTuple):
    """Costmap cells of the points of K rollouts of at most T points."""

    flat: NDArray[np.int32]
    """(K, T) `iy * nx + ix`; -1 off the map."""
    padded: NDArray[np.int32]
    """(K, T) the same in a grid with a border of one cell."""
    boxes: NDArray[np.int32]
    """(K + 1, 4) lowest ix, iy and highest ix, iy of each row's points; last row: half-open box around all points."""
    poses: NDArray[np.float64]
    """Poses of the rollouts that these are the cells of."""


class TrajectoryGenerator(ABC):
    """Samples velocities and simulates them."""

    @abstractmethod
    def samples(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(K, 3) velocity samples for following `plan` (n, 3)."""

    @abstractmethod
    def simulate(self, samples: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> Rollouts:
        """Rollouts of `samples` (K, 3) from `state`; they may be views of buffers that the next call overwrites."""
