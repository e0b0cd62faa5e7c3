"""The active goal: its progress, its timers, and the error and the result with which it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from navstack.core import Pose2D
from navstack.core.errors import InternalError, NavError, PlanningError
from navstack.move_base.errors import GoalCanceledError, InvalidGoalError, ShutdownError
from navstack.move_base.goal import Goal, GoalHandle, GoalResult
from navstack.move_base.goal_statistics import GoalStatistics
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.progress import OscillationChecker
from navstack.move_base.stall_check import StallCheck
from navstack.move_base.states import Outcome


@dataclass(slots=True, eq=False)
class ActiveGoal:
    """State of the active goal."""

    handle: GoalHandle
    progress: OscillationChecker
    deadline: float = math.inf
    """Time at which its time limit ends (s)."""
    statistics: GoalStatistics = field(default_factory=GoalStatistics)
    pose: Pose2D | None = None
    """The goal in the global costmap's frame; None while the transform is not known."""
    frame: str = ""
    """The global costmap's frame when the goal was accepted or last transformed."""
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
    stall: StallCheck = field(default_factory=StallCheck)
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
                return GoalCanceledError(f"the goal was cancelled after {self.age(now):.1f} s")
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


def check_goal(goal: Goal) -> InvalidGoalError | None:
    """Return the error of a goal whose orientation has roll or pitch or whose position is not finite; None for a valid one."""
    if not goal.has_valid_orientation:
        return InvalidGoalError(
            f"the goal's orientation {goal.orientation or goal.pose.yaw} is not a rotation about z; give a unit quaternion "
            "about z, or a finite yaw",
            orientation=goal.orientation,
            yaw=goal.pose.yaw,
        )
    if not goal.pose.is_finite():
        return InvalidGoalError(
            f"the goal's position ({goal.pose.x}, {goal.pose.y}) is not finite; give metres in a frame",
            pose=goal.pose,
        )
    return None
