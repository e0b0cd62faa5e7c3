"""From a configuration to a running MoveBase, a single plan, or Nav2's BasicNavigator."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.bringup.basic_navigator import BasicNavigator as BasicNavigator
    from navstack.bringup.basic_navigator import FollowPath as FollowPath
    from navstack.bringup.basic_navigator import TaskFeedback as TaskFeedback
    from navstack.bringup.build import build_chain as build_chain
    from navstack.bringup.build import build_move_base as build_move_base
    from navstack.bringup.build import odometry_frame as odometry_frame
    from navstack.bringup.build import reconfigure as reconfigure
    from navstack.bringup.build import simulated_robot as simulated_robot
    from navstack.bringup.build import true_footprint as true_footprint
    from navstack.bringup.build import true_frame as true_frame
    from navstack.bringup.pose_sequence import PASSED_RADIUS_M as PASSED_RADIUS_M
    from navstack.bringup.pose_sequence import PoseSequence as PoseSequence
    from navstack.bringup.pose_sequence import TargetPose as TargetPose
    from navstack.bringup.pose_sequence import TaskResult as TaskResult
    from navstack.bringup.single_plan import PlannedPath as PlannedPath
    from navstack.bringup.single_plan import build_costmap as build_costmap
    from navstack.bringup.single_plan import costmap_on_map as costmap_on_map
    from navstack.bringup.single_plan import make_global_planner as make_global_planner
    from navstack.bringup.single_plan import plan as plan
    from navstack.bringup.single_plan import plan_on_map as plan_on_map
    from navstack.bringup.single_plan import pose_of as pose_of
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
