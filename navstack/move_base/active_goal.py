"""A goal being worked on: what is known about it, and with which reason and result it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from navstack.core import Pose2D
from navstack.core.errors import InternalError, NavError, PlanningError
from navstack.move_base.errors import GoalCanceledError, InvalidGoalError, ShutdownError
from navstack.move_base.goal import Goal, GoalHandle, GoalResult
from navstack.move_base.goal_statistics import GoalStatistics
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.state_machine import Outcome


@dataclass(slots=True)
class ActiveGoal:
    """Everything that belongs to the goal being worked on."""

    handle: GoalHandle
    deadline: float = math.inf
    """When its time limit is over, s."""
    statistics: GoalStatistics = field(default_factory=GoalStatistics)
    pose: Pose2D | None = None
    """The goal in the global costmap's frame; None while it cannot be transformed."""
    error: NavError | None = None
    """Why the goal is to end, where the outcome alone does not say."""
    driven_m: float = 0.0
    rounds: int = 0
    """Recoveries since the robot last moved oscillation_distance."""

    def age(self, now: float) -> float:
        """S since the goal was accepted."""
        begun = self.handle.accepted_at
        return now - begun if begun is not None else 0.0

    def reason(self, outcome: Outcome, now: float) -> NavError:
        """The error behind an outcome other than REACHED."""
        statistics = self.statistics
        match outcome:
            case Outcome.CANCELED:
                return GoalCanceledError(f"the goal was cancelled after {self.age(now):.1f} s")
            case Outcome.NO_PLAN:
                return statistics.last_planning or PlanningError("the global planner found no plan")
            case Outcome.NO_CONTROL:
                return statistics.last_control or NavError("the local planner found no command")
            case Outcome.KILLED:
                return ShutdownError("the goal manager was shut down")
            case _:
                return self.error or statistics.last or InternalError("nobody said why; please report this")

    def result(self, status: GoalStatus, text: str, error: NavError | None, now: float) -> GoalResult:
        """The result the goal ends with at `now` (s); `error` is None for success."""
        statistics = self.statistics
        data = statistics.as_data()
        message = ""
        code, name = 0, "NONE"
        if error is not None:
            code, name = error.code, error.name
            data["error"] = error.as_dict()
            counted = statistics.by_name.get(name, 0)
            message = error.message
            if counted > 1:
                message += f" ({counted} times"
                message += f"; recoveries tried: {', '.join(statistics.recoveries)})" if statistics.recoveries else ")"
        return GoalResult(
            status,
            text,
            code,
            name,
            message,
            data,
            tuple(statistics.recoveries),
            self.handle.goal.stamp,
            self.handle.accepted_at,
            now,
        )


def check_goal(goal: Goal) -> InvalidGoalError | None:
    """What is wrong with the goal itself: an orientation that is no heading, a position that is not finite."""
    if not goal.has_valid_orientation:
        return InvalidGoalError(
            f"the goal's orientation {goal.orientation or goal.pose.yaw} is no heading in the plane; give a unit "
            "quaternion about z, or a finite yaw",
            orientation=goal.orientation,
            yaw=goal.pose.yaw,
        )
    if not goal.pose.is_finite():
        return InvalidGoalError(
            f"the goal's position ({goal.pose.x}, {goal.pose.y}) is not finite; give metres in a frame",
            pose=goal.pose,
        )
    return None
