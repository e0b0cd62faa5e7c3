"""The goal manager: goal states, action server, state machine, MoveBase."""

from navstack.move_base.action_client import SimpleActionClient
from navstack.move_base.action_server import SimpleActionServer
from navstack.move_base.comm_state import CommState
from navstack.move_base.feedback import Feedback
from navstack.move_base.goal import Goal, GoalHandle, GoalResult
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.motion_runner import MotionHandle, MotionRunner
from navstack.move_base.move_base import MoveBase
from navstack.move_base.planning import InlinePlanning, PlanAnswer, Planning, PlanRequest
from navstack.move_base.states import Mode, Trigger
from navstack.move_base.thread_planning import ThreadPlanning
from navstack.move_base.tick_result import TickResult
from navstack.parameters.models.move_base import MoveBaseParams, builtin_recoveries

__all__ = [
    "CommState",
    "Feedback",
    "Goal",
    "GoalHandle",
    "GoalResult",
    "GoalStatus",
    "InlinePlanning",
    "Mode",
    "MotionHandle",
    "MotionRunner",
    "MoveBase",
    "MoveBaseParams",
    "PlanAnswer",
    "PlanRequest",
    "Planning",
    "SimpleActionClient",
    "SimpleActionServer",
    "ThreadPlanning",
    "TickResult",
    "Trigger",
    "builtin_recoveries",
]
