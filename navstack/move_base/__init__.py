"""The goal manager: MoveBase, its goals and their server, its states, and what it plans with."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.move_base.action_client import CommState as CommState
    from navstack.move_base.action_client import SimpleActionClient as SimpleActionClient
    from navstack.move_base.active_goal import Feedback as Feedback
    from navstack.move_base.checks import OscillationChecker as OscillationChecker
    from navstack.move_base.checks import Progress as Progress
    from navstack.move_base.checks import stale_sensors as stale_sensors
    from navstack.move_base.control import SpeedLimiter as SpeedLimiter
    from navstack.move_base.control import full_speed as full_speed
    from navstack.move_base.errors import BusyError as BusyError
    from navstack.move_base.errors import GoalCanceledError as GoalCanceledError
    from navstack.move_base.errors import GoalTimeLimitError as GoalTimeLimitError
    from navstack.move_base.errors import NoProgressError as NoProgressError
    from navstack.move_base.errors import StaleOdometryError as StaleOdometryError
    from navstack.move_base.errors import StaleSensorsError as StaleSensorsError
    from navstack.move_base.events import TickResult as TickResult
    from navstack.move_base.goals import REPLACED as REPLACED
    from navstack.move_base.goals import STATUS_LIST_TIMEOUT_S as STATUS_LIST_TIMEOUT_S
    from navstack.move_base.goals import Goal as Goal
    from navstack.move_base.goals import GoalHandle as GoalHandle
    from navstack.move_base.goals import GoalResult as GoalResult
    from navstack.move_base.goals import GoalStatus as GoalStatus
    from navstack.move_base.goals import SimpleActionServer as SimpleActionServer
    from navstack.move_base.goals import is_planar as is_planar
    from navstack.move_base.goals import yaw_of as yaw_of
    from navstack.move_base.motions import MotionHandle as MotionHandle
    from navstack.move_base.motions import MotionRunner as MotionRunner
    from navstack.move_base.move_base import MoveBase as MoveBase
    from navstack.move_base.planning import InlinePlanning as InlinePlanning
    from navstack.move_base.planning import PlanAnswer as PlanAnswer
    from navstack.move_base.planning import Planning as Planning
    from navstack.move_base.planning import PlanRequest as PlanRequest
    from navstack.move_base.planning import ThreadPlanning as ThreadPlanning
    from navstack.move_base.planning import add_layer as add_layer
    from navstack.move_base.plugin_calls import call as call
    from navstack.move_base.plugin_calls import checked_flag as checked_flag
    from navstack.move_base.plugin_calls import checked_local_plan as checked_local_plan
    from navstack.move_base.plugin_calls import checked_pose as checked_pose
    from navstack.move_base.plugin_calls import make_plan as make_plan
    from navstack.move_base.schedule import EPSILON_S as EPSILON_S
    from navstack.move_base.schedule import Schedule as Schedule
    from navstack.move_base.states import ROWS as ROWS
    from navstack.move_base.states import Mode as Mode
    from navstack.move_base.states import Trigger as Trigger
    from navstack.move_base.states import document_markdown as document_markdown
    from navstack.move_base.tree_move_base import TreeFailedError as TreeFailedError
    from navstack.move_base.tree_move_base import TreeMoveBase as TreeMoveBase
    from navstack.move_base.tree_servers import BehaviorServer as BehaviorServer
    from navstack.move_base.tree_servers import pose_cost as pose_cost
    from navstack.move_base.tree_tasks import RouteServer as RouteServer
    from navstack.move_base.tree_tasks import RouteTrackingServer as RouteTrackingServer
    from navstack.move_base.tree_tasks import path_servers as path_servers
    from navstack.parameters import MoveBaseParams as MoveBaseParams
    from navstack.parameters import builtin_recoveries as builtin_recoveries
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
