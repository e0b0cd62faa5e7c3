"""What a robot does apart from driving to goals: recoveries and motions, one kind, stepwise.

Recovery behaviors run if planning or control fails, or without progress; motions drive without a global plan.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.behaviors.assisted_teleop import AssistedTeleop as AssistedTeleop
    from navstack.behaviors.assisted_teleop import AssistedTeleopParams as AssistedTeleopParams
    from navstack.behaviors.base import Motion as Motion
    from navstack.behaviors.base import TimedBehavior as TimedBehavior
    from navstack.behaviors.clear_costmap import ClearCostmapRecovery as ClearCostmapRecovery
    from navstack.behaviors.clear_costmap import ClearCostmapRecoveryParams as ClearCostmapRecoveryParams
    from navstack.behaviors.drive_to_pose import DriveToPose as DriveToPose
    from navstack.behaviors.errors import InfeasibleTrajectoryError as InfeasibleTrajectoryError
    from navstack.behaviors.errors import InvalidMotionError as InvalidMotionError
    from navstack.behaviors.errors import InvalidTrajectoryError as InvalidTrajectoryError
    from navstack.behaviors.errors import MotionCollisionError as MotionCollisionError
    from navstack.behaviors.errors import MotionTimeoutError as MotionTimeoutError
    from navstack.behaviors.errors import TrackingLostError as TrackingLostError
    from navstack.behaviors.follow import FollowPath as FollowPath
    from navstack.behaviors.follow import FollowTrajectory as FollowTrajectory
    from navstack.behaviors.keyboard import HELP as HELP
    from navstack.behaviors.keyboard import MOVE_KEYS as MOVE_KEYS
    from navstack.behaviors.keyboard import SPEED_KEYS as SPEED_KEYS
    from navstack.behaviors.keyboard import START_SPEED as START_SPEED
    from navstack.behaviors.keyboard import START_TURN as START_TURN
    from navstack.behaviors.keyboard import KeyboardTeleop as KeyboardTeleop
    from navstack.behaviors.move_slow_and_clear import MoveSlowAndClear as MoveSlowAndClear
    from navstack.behaviors.move_slow_and_clear import MoveSlowAndClearParams as MoveSlowAndClearParams
    from navstack.behaviors.runner import BehaviorEnd as BehaviorEnd
    from navstack.behaviors.runner import BehaviorRunner as BehaviorRunner
    from navstack.behaviors.steps import EXAMPLES as EXAMPLES
    from navstack.behaviors.steps import FollowStep as FollowStep
    from navstack.behaviors.steps import GoToStep as GoToStep
    from navstack.behaviors.steps import RouteStep as RouteStep
    from navstack.behaviors.steps import Step as Step
    from navstack.behaviors.steps import is_step as is_step
    from navstack.behaviors.steps import motion_of as motion_of
    from navstack.behaviors.steps import parse_angle as parse_angle
    from navstack.behaviors.steps import parse_length as parse_length
    from navstack.behaviors.steps import read_step as read_step
    from navstack.behaviors.steps import step_data as step_data
    from navstack.behaviors.steps import step_text as step_text
    from navstack.behaviors.steps import trajectory_of as trajectory_of
    from navstack.behaviors.straight import BackUp as BackUp
    from navstack.behaviors.straight import BackUpParams as BackUpParams
    from navstack.behaviors.straight import DriveOnHeading as DriveOnHeading
    from navstack.behaviors.straight import DriveOnHeadingParams as DriveOnHeadingParams
    from navstack.behaviors.straight import Move as Move
    from navstack.behaviors.timing import Demands as Demands
    from navstack.behaviors.timing import MotionLimits as MotionLimits
    from navstack.behaviors.timing import Violation as Violation
    from navstack.behaviors.timing import demands_of as demands_of
    from navstack.behaviors.timing import from_path as from_path
    from navstack.behaviors.timing import require_feasible as require_feasible
    from navstack.behaviors.timing import slowest_factor as slowest_factor
    from navstack.behaviors.timing import violations as violations
    from navstack.behaviors.timing import with_rest as with_rest
    from navstack.behaviors.trajectory import Reference as Reference
    from navstack.behaviors.trajectory import Trajectory as Trajectory
    from navstack.behaviors.trajectory import as_message as as_message
    from navstack.behaviors.trajectory import figure_eight as figure_eight
    from navstack.behaviors.trajectory import heart as heart
    from navstack.behaviors.trajectory import load_trajectory as load_trajectory
    from navstack.behaviors.trajectory import poly_path as poly_path
    from navstack.behaviors.trajectory import save_trajectory as save_trajectory
    from navstack.behaviors.turn import RotateRecovery as RotateRecovery
    from navstack.behaviors.turn import RotateRecoveryParams as RotateRecoveryParams
    from navstack.behaviors.turn import Spin as Spin
    from navstack.behaviors.turn import SpinParams as SpinParams
    from navstack.behaviors.turn import SpinToLocalize as SpinToLocalize
    from navstack.behaviors.turn import SpinToLocalizeParams as SpinToLocalizeParams
    from navstack.behaviors.turn import Turn as Turn
    from navstack.behaviors.wait import Pause as Pause
    from navstack.behaviors.wait import Wait as Wait
    from navstack.behaviors.wait import WaitParams as WaitParams
    from navstack.behaviors.waypoints import NO_EXECUTOR as NO_EXECUTOR
    from navstack.behaviors.waypoints import ExecutorFailedError as ExecutorFailedError
    from navstack.behaviors.waypoints import InputAtWaypoint as InputAtWaypoint
    from navstack.behaviors.waypoints import MissedWaypointError as MissedWaypointError
    from navstack.behaviors.waypoints import NoWaypointsError as NoWaypointsError
    from navstack.behaviors.waypoints import PhotoAtWaypoint as PhotoAtWaypoint
    from navstack.behaviors.waypoints import WaitAtWaypoint as WaitAtWaypoint
    from navstack.behaviors.waypoints import WaypointExecutor as WaypointExecutor
    from navstack.behaviors.waypoints import WaypointReport as WaypointReport
    from navstack.behaviors.waypoints import WaypointStatus as WaypointStatus
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
