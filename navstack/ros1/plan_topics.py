"""Topics of goals, plans and recovery behaviors."""

from __future__ import annotations

from typing import Any

import numpy as np

from navstack.core import Event, Pose2D
from navstack.interfaces import RecoveryStatus
from navstack.logs.builder import MessageBuilder
from navstack.move_base import MoveBase
from navstack.move_base.tick_result import TickResult
from navstack.parameters.configuration import Configuration
from navstack.ros1 import ros
from navstack.ros1.clock import NodeClock


class PlanTopics:
    """Publishes plans, the current goal and the status of recovery behaviors under the names of move_base."""

    def __init__(self, configuration: Configuration, clock: NodeClock, build: MessageBuilder) -> None:
        rospy = ros.rospy()
        self._clock, self._build = clock, build
        self._accepted = ""
        """Id of a goal that is to be published."""
        self._recovers = False
        path = ros.message("nav_msgs/Path")
        planner, controller = configuration.global_planner, configuration.local_planner
        global_name, local_name = planner.namespace or planner.name, controller.namespace or controller.name
        self._plan = rospy.Publisher(f"~{global_name}/plan", path, queue_size=1)
        self._global_plan = rospy.Publisher(f"~{local_name}/global_plan", path, queue_size=1)
        self._local_plan = rospy.Publisher(f"~{local_name}/local_plan", path, queue_size=1)
        self._goal = rospy.Publisher("~current_goal", ros.message("geometry_msgs/PoseStamped"), queue_size=10)
        self._recovery = rospy.Publisher(
            "move_base/recovery_status", ros.message("move_base_msgs/RecoveryStatus"), queue_size=1
        )

    def publish(self, move_base: MoveBase, tick: TickResult) -> None:
        """Publish the plans of a cycle."""
        stamp = self._clock.ns(tick.time)
        if self._accepted:
            self._publish_goal(move_base, stamp)
        if tick.plan is not None and self._plan.get_num_connections():
            path = tick.plan.path
            self.publish_plan(self._build.path(stamp, path.frame, path.poses))
        local = tick.local_plan
        if local is None:
            return
        frame = move_base.local_costmap.frame
        if local.trajectory is not None and self._local_plan.get_num_connections():
            self._local_plan.publish(self._build.path(stamp, frame, np.asarray(local.trajectory, np.float64)))
        if local.local_plan is not None and self._global_plan.get_num_connections():
            self._global_plan.publish(self._build.path(stamp, local.local_plan.frame, local.local_plan.poses))

    def publish_plan(self, path: Any) -> None:
        """Publish a nav_msgs/Path of the global planner; a service may call this in its thread."""
        self._plan.publish(path)

    def on_event(self, event: Event, move_base: MoveBase | None) -> None:
        """Publish a goal that was accepted, an attempt to plan that failed, and the start of a recovery behavior."""
        if move_base is None:
            return
        stamp, frame = self._clock.ns(event.time), move_base.global_costmap.frame
        if event.kind == "plan_failed":
            # as navfn: every attempt is published, one without a plan as an empty path
            self.publish_plan(self._build.path(stamp, frame, np.empty((0, 3))))
        elif event.kind == "goal":
            self._accepted = str(event.data["id"])
        elif event.kind == "recovery":
            running = event.data["status"] == RecoveryStatus.RUNNING.value
            # a behavior of one step has no event of its beginning
            if not self._recovers:
                self._publish_recovery(event.data, stamp, frame, move_base.robot_pose)
            self._recovers = running

    def _publish_goal(self, move_base: MoveBase, stamp: int) -> None:
        """Publish a goal that was accepted in the last cycle, in the global frame; in its own if there is no transform."""
        name, self._accepted = self._accepted, ""
        handle = move_base.goal_handle
        if handle is None or handle.id != name:
            return
        goal = handle.goal
        frame, pose = (move_base.global_costmap.frame, move_base.goal_pose or goal.pose)
        if move_base.goal_pose is None:
            frame = goal.frame
        self._goal.publish(self._build.pose_stamped(stamp, frame, pose))

    def _publish_recovery(self, data: dict[str, Any], stamp: int, frame: str, pose: Pose2D | None) -> None:
        message = ros.message("move_base_msgs/RecoveryStatus")()
        message.pose_stamped = self._build.pose_stamped(stamp, frame, pose or Pose2D(0.0, 0.0))
        message.current_recovery_number = int(data["index"])
        message.total_number_of_recoveries = int(data["total"])
        message.recovery_behavior_name = str(data["name"])
        self._recovery.publish(message)
