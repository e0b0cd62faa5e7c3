"""The services of move_base: make_plan, clear_costmaps, and make_plan of the global planner."""

from __future__ import annotations

from typing import Any

from navstack.core import Pose2D
from navstack.core.errors import InputError, NavError, PlanningError
from navstack.logs import messages as msg
from navstack.logs.builder import MessageBuilder
from navstack.move_base import MoveBase
from navstack.parameters.configuration import Configuration
from navstack.ros1 import ros
from navstack.ros1.clock import NodeClock
from navstack.ros1.inbox import Inbox


class Services:
    """Offers the services; they run in the thread of the node."""

    def __init__(
        self,
        configuration: Configuration,
        move_base: MoveBase,
        clock: NodeClock,
        build: MessageBuilder,
        inbox: Inbox,
    ) -> None:
        rospy = ros.rospy()
        self._move_base, self._clock, self._build = move_base, clock, build
        get_plan, empty = ros.message("nav_msgs/srv/GetPlan"), ros.message("std_srvs/srv/Empty")
        planner = configuration.global_planner
        name = planner.namespace or planner.name

        self._kept = [
            rospy.Service("~make_plan", get_plan, inbox.caller(self._make_plan)),
            rospy.Service("~clear_costmaps", empty, inbox.caller(self._clear)),
            rospy.Service(f"~{name}/make_plan", get_plan, inbox.caller(self._planner_plan)),
        ]

    def _clear(self, request: Any) -> Any:
        del request
        self._move_base.clear_costmaps()
        return ros.message("std_srvs/srv/EmptyResponse")()

    def _make_plan(self, request: Any) -> Any:
        """Plan as move_base's service. None, an error for the client, while a goal is active."""
        start = request.start if request.start.header.frame_id else None
        response = ros.message("nav_msgs/srv/GetPlanResponse")()
        try:
            poses = self._plan(request.goal, start, float(request.tolerance))
        except PlanningError as exc:
            ros.rospy().logwarn("make_plan: %s", exc.message)
            return response
        except InputError as exc:
            ros.rospy().logerr("make_plan: %s", exc.message)
            return None
        except NavError as exc:
            ros.rospy().logerr("make_plan: %s", exc.message)
            return None
        response.plan = poses
        # ROS leaves the header of this plan empty
        response.plan.header.frame_id = ""
        response.plan.header.stamp = ros.rospy().Time(0)
        return response

    def _planner_plan(self, request: Any) -> Any:
        """Plan as the planner's own service: any time, always with an answer."""
        response = ros.message("nav_msgs/srv/GetPlanResponse")()
        try:
            response.plan = self._plan(request.goal, request.start, 0.0)
        except NavError as exc:
            ros.rospy().logwarn("make_plan: %s", exc.message)
        return response

    def _plan(self, goal: Any, start: Any, tolerance: float) -> Any:
        """Return a plan as a nav_msgs/Path. Poses in another frame than the global costmap's have none."""
        frame = self._move_base.global_costmap.frame
        for pose in (goal, start):
            given = "" if pose is None else msg.frame_of(pose)
            if given and given != frame:
                raise PlanningError(f'the pose is in "{given}", and plans are made in "{frame}"', frame=given)
        at = None if start is None else msg.pose_of(start.pose)
        found = self._move_base.make_plan(_pose(goal), at, tolerance=tolerance)
        return self._build.path(self._clock.ns(self._clock.now()), frame, found.path.poses)


def _pose(message: Any) -> Pose2D:
    return msg.pose_of(message.pose)
