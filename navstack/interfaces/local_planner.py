"""Local planners, their critics, and the values they exchange in a control cycle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Footprint,
    Path,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
)
from navstack.core.parameters import ParamModel


class VelocityLimits(NamedTuple):
    """What a local planner allows the base (m/s, rad/s, m/s², rad/s²), for behaviours that drive it otherwise."""

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
    xy_goal_tolerance: float


@dataclass(frozen=True, slots=True, eq=False)
class ControlInput:
    """Everything a local planner looks at in one cycle."""

    state: RobotState
    """Pose in the costmap's frame, velocity in the robot's."""
    costmap: Costmap
    footprint: Footprint
    plan_to_costmap: Transform2D = field(default_factory=Transform2D)
    """Pose of the plan's frame in the costmap's frame at this time."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalPlan:
    """A command and how it was chosen. K samples, T points, C critics."""

    command: Twist2D
    mode: str = "follow"
    """follow, brake, rotate_to_goal, arrived, or escape: backing out where every sample was rejected."""
    samples: NDArray[np.float64] | None = None
    """(K, 3) velocities vx, vy, wz that were tried."""
    critics: tuple[str, ...] = ()
    costs: NDArray[np.float64] | None = None
    """(K, C) raw costs per critic; NaN where a sample was not scored by it."""
    scales: NDArray[np.float64] | None = None
    """(C,) weights."""
    totals: NDArray[np.float64] | None = None
    """(K,) weighted sums; negative: the code of the rejection."""
    rejected_by: NDArray[np.int8] | None = None
    """(K,) index of the critic that rejected the sample, -1 legal, -2 never a trajectory (too slow, too fast)."""
    best: int = -1
    """Index of the winner, -1 without samples."""
    trajectory: NDArray[np.float64] | None = None
    """(T, 3) the winner's poses in the costmap's frame."""
    local_plan: Path | None = None
    """The part of the global plan in sight, in the costmap's frame."""
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """A summary for JSON: the command, and how many samples were legal or rejected by which critic."""
        rejected: dict[str, int] = {}
        legal = 0
        if self.rejected_by is not None:
            legal = int((self.rejected_by == -1).sum())
            for index, name in ((-2, "limits"), *enumerate(self.critics)):
                number = int((self.rejected_by == index).sum())
                if number:
                    rejected[name] = number
        return {
            "mode": self.mode,
            "command": list(self.command),
            "samples": 0 if self.samples is None else len(self.samples),
            "legal": legal,
            "rejected": rejected,
            "best": None if self.best < 0 or self.samples is None else self.samples[self.best].tolist(),
            "total": None if self.best < 0 or self.totals is None else float(self.totals[self.best]),
            "notes": list(self.notes),
        }


class LocalPlanner(ABC):
    """Turns a plan, a pose and a local costmap into a velocity."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: Any) -> None:
        self.params = params

    @property
    @abstractmethod
    def limits(self) -> VelocityLimits:
        """The limits in force."""

    @abstractmethod
    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lowers the speed limits for a while (move_slow_and_clear, speed masks); None restores that of the parameters."""

    @abstractmethod
    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow this plan to this goal, both in the plan's frame.

        Same goal as before: a replan, and what was achieved (a latched position) holds. Oscillation flags are reset by every
        plan, as in C++.

        Raises InvalidPathError for a plan that is empty or not finite.
        """

    @abstractmethod
    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """The velocity to command now; raises a ControlError (NoValidControlError with the table of samples) if none."""

    @abstractmethod
    def goal_reached(self, inputs: ControlInput) -> bool:
        """True once the robot stands at the goal within the tolerances."""

    def explain(self, inputs: ControlInput) -> dict[str, Any]:
        """More about the last cycle than a command needs (grids, rollouts), computed on request only."""
        del inputs
        return {}


class Rollouts(NamedTuple):
    """K simulated trajectories of at most T points, in the costmap's frame; row k has `counts[k]` valid points."""

    samples: NDArray[np.float64]
    """(K, 3) the velocities vx, vy, wz of the first step, which would be commanded."""
    poses: NDArray[np.float64]
    """(K, T, 3) x, y, yaw; the first point is the present pose."""
    counts: NDArray[np.int64]
    """(K,) points per row; 0 = never a trajectory (too slow, too fast)."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoringContext:
    """What critics may look at in one cycle, all in the costmap's frame."""

    state: RobotState
    costmap: Costmap
    footprint: Footprint
    plan: NDArray[np.float64]
    """(n, 3) the part of the plan in sight."""
    goal: Pose2D
    """The final goal."""
    limits: VelocityLimits
    shared: dict[str, Any] = field(default_factory=dict[str, Any])
    """What one critic computed and others may use in this cycle, by name (`path_grid`)."""


class Critic(ABC):
    """Scores trajectories; a file each."""

    Params: ClassVar[type[ParamModel]]
    CODES: ClassVar[dict[int, str]] = {}
    """Negative score -> what it means, in words."""

    def __init__(self, name: str, params: Any) -> None:
        self.name = name
        self.params = params

    @property
    def scale(self) -> float:
        """Weight of this critic's scores in the sum; with 0 it is skipped."""
        return 1.0

    @abstractmethod
    def prepare(self, context: ScoringContext) -> None:
        """Called once per cycle, before scoring."""

    @abstractmethod
    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) raw costs of the rows that are `alive` (others: anything); negative = rejected, the code from `CODES`."""
