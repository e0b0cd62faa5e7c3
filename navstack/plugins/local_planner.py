"""Local planners, and the input and output of a control cycle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic

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
from navstack.plugins.costmap import Inflation
from navstack.plugins.critic import RejectionDetail
from navstack.plugins.parameters import P, ParamModel
from navstack.plugins.rollouts import Rollouts, VelocityLimits


@dataclass(frozen=True, slots=True, eq=False)
class ControlInput:
    """Input of a local planner in one control cycle."""

    state: RobotState
    """Pose in the costmap's frame, velocity in the robot's frame."""
    costmap: Costmap
    footprint: Footprint
    plan_to_costmap: Transform2D = field(default_factory=Transform2D)
    """Pose of the plan's frame in the costmap's frame."""
    inflation: Inflation | None = None
    """The costs around obstacles in the costmap; None if they are not inflated."""
    track_unknown_space: bool = False
    """True if unknown cells of the costmap are unknown, not obstacles."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalPlan:
    """A command and how it was selected. K velocity samples, T points, C critics."""

    command: Twist2D
    mode: str = "follow"
    """follow, brake, rotate_to_goal, arrived, or escape (every sample was rejected: backs up, or leaves an obstacle)."""
    samples: NDArray[np.float64] | None = None
    """(K, 3) velocity samples vx, vy, wz."""
    critics: tuple[str, ...] = ()
    costs: NDArray[np.float64] | None = None
    """(K, C) raw costs by critic; NaN where a critic did not score a sample."""
    scales: NDArray[np.float64] | None = None
    """(C,) weights of the critics."""
    totals: NDArray[np.float64] | None = None
    """(K,) weighted sums; negative: code of the rejection."""
    rejected_by: NDArray[np.int8] | None = None
    """(K,) index of the critic that rejected the sample; -1: legal; -2: outside the speed limits, not simulated."""
    best: int = -1
    """Index of the selected sample, -1 without one."""
    trajectory: NDArray[np.float64] | None = None
    """(T, 3) poses of the selected rollout in the costmap's frame."""
    local_plan: Path | None = None
    """The part of the global plan inside the local costmap, in the costmap's frame."""
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Summary for JSON: the command, the number of legal samples and of rejected ones by critic."""
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

    def __repr__(self) -> str:
        count = 0 if self.samples is None else len(self.samples)
        return f"LocalPlan({self.command}, mode {self.mode!r}, {count} samples)"


@dataclass(frozen=True, slots=True, eq=False)
class ControlDiagnostics:
    """How the last command was selected, legal or not. K velocity samples."""

    plan: LocalPlan
    rollouts: Rollouts
    costmap: Costmap
    """The costmap the critics used."""
    footprint: Footprint
    """The footprint the critics used, padding included."""
    rejections: str
    """How many samples were rejected, by which critic, and where first."""
    samples: tuple[tuple[str | None, RejectionDetail], ...]
    """For each sample the critic that rejected it (`limits`: not simulated, None: legal) and why."""
    rule: str = ""
    """How the planner selects a sample, if not simply by the lowest total."""
    averages: bool = False
    """True if the command is no sample but an average: `plan.best` is then the row of the average, the last one."""
    grids: dict[str, NDArray[np.float64]] = field(default_factory=dict[str, NDArray[np.float64]])
    """(ny, nx) grid of each critic that has one."""
    critic_states: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    """State that critics keep between cycles."""


class LocalPlanner(ABC, Generic[P]):
    """Computes velocity commands from a plan, a pose and a local costmap."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: P) -> None:
        self.params = params

    @property
    @abstractmethod
    def limits(self) -> VelocityLimits:
        """The limits in force."""

    @abstractmethod
    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits temporarily (move_slow_and_clear, speed masks); None restores the parameter's value."""

    def reset(self) -> None:
        """Reset the previous goal: the next plan is the first one of a new goal, even if that is at the same pose."""

    @abstractmethod
    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow this plan to this goal, both in the plan's frame.

        With the same goal as before it is a replan, and a latched position remains latched. Every plan resets the critics,
        as in C++.

        Raises InvalidPathError for a plan that is empty or not finite.
        """

    @abstractmethod
    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Compute the velocity command.

        Raises a ControlError; a NoValidControlError with the table of samples if every sample is rejected.
        """

    def brake(self, inputs: ControlInput) -> LocalPlan | None:
        """The next command after a cancel, to brake; None, the default, to command a stop at once.

        Called once per control cycle until it returns None, which it must within a few seconds. The goal remains PREEMPTING
        until then; a new goal ends the braking.
        """
        del inputs
        return None

    @abstractmethod
    def goal_reached(self, inputs: ControlInput) -> bool:
        """True if the robot is at the goal within the tolerances."""

    def diagnostics(self) -> ControlDiagnostics | None:
        """How the last command was selected, computed on request; None before the first or if not supported."""
        return None
