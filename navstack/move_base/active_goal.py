"""The active goal: its plans, its progress, its timers, and the error and the result with which it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navstack.core import InternalError, NavError, Path, PlanningError, Pose2D
from navstack.move_base.errors import GoalCanceledError, ShutdownError
from navstack.move_base.goals import GoalHandle, GoalResult, GoalStatus
from navstack.move_base.states import Mode, Outcome
from navstack.plugins import Plan


class GoalStatistics:
    """Counters of one goal, and its last failures."""

    def __init__(self) -> None:
        self.plans = 0
        """Plans found."""
        self.failed_plans = 0
        self.commands = 0
        """Commands computed."""
        self.failed_commands = 0
        self.stale_cycles = 0
        """Control cycles with a stale local costmap."""
        self.recoveries: list[str] = []
        """Names of the recovery behaviors that ran, in order."""
        self.by_name: dict[str, int] = {}
        """Number of failures by the name of the error."""
        self.last_planning: NavError | None = None
        self.last_control: NavError | None = None
        self.last: NavError | None = None
        self.last_at: float | None = None
        """Time of the last failure (s)."""
        self.pose: Pose2D | None = None
        """Last known pose of the robot, in the global costmap's frame."""

    def add_failure(self, error: NavError, now: float) -> None:
        """Count a failure at `now` (s)."""
        self.last = error
        self.last_at = now
        self.by_name[error.name] = self.by_name.get(error.name, 0) + 1

    def add_failed_plan(self, error: NavError, now: float) -> None:
        """Count a failed plan request at `now` (s)."""
        self.failed_plans += 1
        self.last_planning = error
        self.add_failure(error, now)

    def add_failed_command(self, error: NavError, now: float) -> None:
        """Count a failed command at `now` (s)."""
        self.failed_commands += 1
        self.last_control = error
        self.add_failure(error, now)

    def as_data(self) -> dict[str, Any]:
        """Return the statistics for `GoalResult.data`."""
        return {
            "plans": self.plans,
            "failed_plans": self.failed_plans,
            "commands": self.commands,
            "failed_commands": self.failed_commands,
            "stale_cycles": self.stale_cycles,
            "failures": dict(self.by_name),
            "last_failure": None if self.last is None else {**self.last.as_dict(), "time": self.last_at},
            "robot": None if self.pose is None else list(self.pose),
        }


@dataclass(slots=True, eq=False)
class ActiveGoal:
    """State of the active goal."""

    handle: GoalHandle
    deadline: float = math.inf
    """Time at which its time limit ends (s)."""
    statistics: GoalStatistics = field(default_factory=GoalStatistics)
    pose: Pose2D | None = None
    """The goal in the global costmap's frame; None while the transform is not known."""
    frame: str = ""
    """The global costmap's frame when the goal was accepted or last transformed."""
    plan: Plan | None = None
    """The last plan."""
    new_plan: Plan | None = None
    """That plan, until the local planner receives it."""
    error: NavError | None = None
    """Reason for the end, unless the outcome has one of its own."""
    has_plan: bool = False
    """True from the first plan that the local planner received for this goal."""
    driven_m: float = 0.0
    rounds: int = 0
    """Recoveries since the robot last moved oscillation_distance."""
    last_valid_control: float = 0.0
    """Time at which controller_patience started (s)."""
    last_progress: float = 0.0
    """Time at which oscillation_timeout started (s)."""
    stale_since: float | None = None
    """Time since which the local costmap is stale (s); None while it is current."""
    lost: NavError | None = None
    """Why the robot counted as lost, last."""
    braking_since: float | None = None
    """Time at which the local planner began to brake after a cancel (s)."""

    def age(self, now: float) -> float:
        """Return the time since acceptance (s)."""
        accepted_at = self.handle.accepted_at
        return now - accepted_at if accepted_at is not None else 0.0

    def reason(self, outcome: Outcome, now: float) -> NavError:
        """Return the error behind an outcome other than REACHED."""
        statistics = self.statistics
        match outcome:
            case Outcome.CANCELED:
                return GoalCanceledError(f"the goal was canceled after {self.age(now):.1f} s")
            case Outcome.NO_PLAN:
                return statistics.last_planning or PlanningError("the global planner found no plan")
            case Outcome.NO_CONTROL:
                return statistics.last_control or NavError("the local planner found no command")
            case Outcome.LOST:
                return self.lost or NavError("the robot does not know where it is")
            case Outcome.KILLED:
                return ShutdownError("the goal manager was shut down")
            case _:
                return (
                    self.error
                    or statistics.last
                    or InternalError("the goal ended without a reason; please report this")
                )

    def result(self, status: GoalStatus, text: str, error: NavError | None, now: float) -> GoalResult:
        """Return the result of a goal that ends at `now` (s); `error` is None for success."""
        statistics = self.statistics
        data = statistics.as_data()
        message = ""
        code, name = 0, "NONE"
        if error is not None:
            code, name = error.code, error.name
            data["error"] = error.as_dict()
            message = error.message + self._repetitions(name)
        recoveries = tuple(statistics.recoveries)
        handle = self.handle
        return GoalResult(
            status, text, code, name, message, data, recoveries, handle.goal.stamp, handle.accepted_at, now
        )

    def _repetitions(self, name: str) -> str:
        count = self.statistics.by_name.get(name, 0)
        if count <= 1:
            return ""
        recoveries = self.statistics.recoveries
        return f" ({count} times" + (f"; recoveries tried: {', '.join(recoveries)})" if recoveries else ")")

    def feedback(self, pose: Pose2D | None, mode: Mode, now: float) -> Feedback:
        """Return the feedback at `now` (s), with the robot at `pose` (global costmap's frame)."""
        elapsed = self.age(now)
        remaining = distance_remaining(pose, None if self.plan is None else self.plan.path, self.pose)
        speed = self.driven_m / elapsed if elapsed > 0.0 else 0.0
        time_remaining = remaining / speed if speed > 0.01 else None
        return Feedback(pose, mode, remaining, elapsed, time_remaining, len(self.statistics.recoveries))


@dataclass(frozen=True, slots=True)
class Feedback:
    """Progress of the active goal."""

    pose: Pose2D | None
    """The robot in the global costmap's frame; None if unknown."""
    mode: Mode
    distance_remaining: float
    """m along the plan, from its point nearest to the robot; the straight distance to the goal without a plan."""
    navigation_time: float
    """s since the goal was accepted."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None for a mean speed of at most 0.01 m/s."""
    recoveries: int
    """Recovery behaviors that ran for this goal."""


def distance_remaining(pose: Pose2D | None, path: Path | None, goal: Pose2D | None) -> float:
    """Return the length (m) of `path` from its point nearest to `pose`.

    Without a path this is the straight distance to `goal`; without pose or goal it is inf.
    """
    if pose is None:
        return math.inf
    if path is None:
        return pose.distance_to(goal) if goal is not None else math.inf
    points = path.poses[:, :2]
    distances = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y)
    nearest = int(np.argmin(distances))
    segments = np.diff(points[nearest:], axis=0)
    return float(distances[nearest] + np.hypot(segments[:, 0], segments[:, 1]).sum())
