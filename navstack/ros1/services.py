"""The services of move_base: make_plan, clear_costmaps, and make_plan of the global planner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from navstack.core import NavError, PlanningError, Pose2D
from navstack.move_base import MoveBase
from navstack.parameters import Configuration
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, NodeClock, PlannerCopy


class Services:
    """Offers the services of the node; they run in its thread."""

    def __init__(
        self,
        configuration: Configuration,
        move_base: MoveBase,
        clock: NodeClock,
        build: MessageBuilder,
        inbox: Inbox,
        publish: Callable[[Any], None],
    ) -> None:
        """`publish` gets the nav_msgs/Path of each attempt to plan, an empty one after a failure."""
        rospy = ros.rospy()
        self._move_base, self._clock, self._build, self._publish = move_base, clock, build, publish
        get_plan, empty = ros.message("nav_msgs/srv/GetPlan"), ros.message("std_srvs/srv/Empty")
        planner = configuration.global_planner
        name = planner.namespace or planner.name
        own = PlannerService(move_base, clock, build, inbox, publish)
        self._kept = [
            rospy.Service("~make_plan", get_plan, inbox.caller(self._make_plan)),
            rospy.Service("~clear_costmaps", empty, inbox.caller(self._clear)),
            rospy.Service(f"~{name}/make_plan", get_plan, own.answer),
        ]

    def _clear(self, request: Any) -> Any:
        del request
        self._move_base.clear_costmaps()
        return ros.message("std_srvs/srv/EmptyResponse")()

    def _make_plan(self, request: Any) -> Any:
        """Plan as move_base's service. None, an error for the client, while a goal is active."""
        start = _pose(request.start) if request.start.header.frame_id else None
        response = ros.message("nav_msgs/srv/GetPlanResponse")()
        frame = self._move_base.global_costmap.frame
        try:
            _check_frames(frame, request.goal, *([] if start is None else [request.start]))
            plan = self._move_base.make_plan(_pose(request.goal), start, tolerance=float(request.tolerance))
        except PlanningError as exc:
            ros.rospy().logwarn("make_plan: %s", exc.message)
            stamp = self._clock.ns(self._clock.now())
            self._publish(self._build.path(stamp, frame, np.empty((0, 3))))
            return response
        except NavError as exc:
            ros.rospy().logerr("make_plan: %s", exc.message)
            return None
        path = self._build.path(self._clock.ns(self._clock.now()), frame, plan.path.poses)
        self._publish(path)
        # ROS leaves the header of this plan empty
        response.plan.poses = path.poses
        return response


class PlannerService:
    """`~<planner>/make_plan`: plans at any time, also while the robot drives, and always has an answer.

    It works in the thread of the service.
    """

    def __init__(
        self,
        move_base: MoveBase,
        clock: NodeClock,
        build: MessageBuilder,
        inbox: Inbox,
        publish: Callable[[Any], None],
    ) -> None:
        self._clock, self._build, self._publish = clock, build, publish
        self._inbox = inbox
        self._copy = PlannerCopy(move_base, inbox)

    def answer(self, request: Any) -> Any:
        """Return the plan, an empty one after a failure. The tolerance of the request is ignored, as in ROS."""
        model, costmap, footprint = self._copy.snapshot()
        time_ns = self._inbox.call(lambda: self._clock.ns(self._clock.now()))
        response = ros.message("nav_msgs/srv/GetPlanResponse")()
        response.plan.header = self._build.header(time_ns, costmap.frame)
        try:
            _check_frames(costmap.frame, request.goal, request.start)
            plan = self._copy.plan(model, costmap, footprint, _pose(request.start), _pose(request.goal))
            response.plan.poses = self._build.path(time_ns, costmap.frame, plan.path.poses).poses
        except NavError as exc:
            ros.rospy().logwarn("make_plan of the global planner: %s", exc.message)
        self._publish(response.plan)
        return response


def _pose(message: Any) -> Pose2D:
    return msg.pose_of(message.pose)


def _check_frames(frame: str, *poses: Any) -> None:
    """Raise PlanningError for a pose in another frame: neither start nor goal are transformed, as in ROS."""
    for pose in poses:
        given = msg.frame_of(pose)
        if given != frame:
            raise PlanningError(f'the pose is in "{given}", and plans are made in "{frame}"', frame=given)
