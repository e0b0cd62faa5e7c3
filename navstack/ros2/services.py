"""Services of the navigator under the names of Nav2: clearing and reading costmaps, the validity of a path."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from navstack.core import Bounds, FrameError, InputError, Pose2D, Transform2D
from navstack.costmap import LayeredCostmap
from navstack.move_base import MoveBase, call, pose_cost
from navstack.ros2 import ros
from navstack.ros2.ros import RosNode
from navstack.ros2.topics import raw_costmap
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, NodeClock, layered_costmaps

LETHAL, UNKNOWN = 254, 255
CLEARING: Final = {
    "clear_entirely_": "nav2_msgs/srv/ClearEntireCostmap",
    "clear_around_": "nav2_msgs/srv/ClearCostmapAroundRobot",
    "clear_except_": "nav2_msgs/srv/ClearCostmapExceptRegion",
    "clear_around_pose_": "nav2_msgs/srv/ClearCostmapAroundPose",
}
"""Services of each costmap, by the beginning of their names."""


class Services:
    """Offers the services; they run in the thread of the node."""

    def __init__(self, node: RosNode, move_base: MoveBase, clock: NodeClock, inbox: Inbox) -> None:
        self._move_base, self._clock, self._build = move_base, clock, node.build
        if not ros.has_module("nav2_msgs"):
            return
        for costmap in layered_costmaps(move_base):
            name = costmap.name
            for begin, kind in CLEARING.items():
                if ros.has_message(kind):
                    node.serve(f"{name}/{begin}{name}", kind, inbox, partial(self._clear, costmap, begin))
            node.serve(f"{name}/get_costmap", "nav2_msgs/srv/GetCostmap", inbox, partial(self._get, costmap))
            if ros.has_message("nav2_msgs/srv/GetCosts"):
                node.serve(f"{name}/get_cost_{name}", "nav2_msgs/srv/GetCosts", inbox, partial(self._costs, costmap))
            else:
                node.serve(f"{name}/get_cost_{name}", "nav2_msgs/srv/GetCost", inbox, partial(self._cost, costmap))
        node.serve("is_path_valid", "nav2_msgs/srv/IsPathValid", inbox, self._validate)

    def _clear(self, costmap: LayeredCostmap, begin: str, request: Any, response: Any) -> None:
        side = float(getattr(request, "reset_distance", 0.0))
        if not side >= 0.0:
            raise InputError(f"reset_distance must be 0 m or more, not {side:g}", reset_distance=side)
        names = [str(name) for name in getattr(request, "plugins", ())]
        if begin == "clear_entirely_" and not names:
            call(costmap, costmap.reset)
        else:
            at = costmap.robot_pose(self._clock.now())
            if hasattr(request, "pose"):
                at = self._in_frame(costmap, request.pose)
            square = Bounds(at.x, at.y, at.x, at.y).grown(0.5 * side)
            for layer in costmap.layers:
                wanted = layer.name.rsplit("/", 1)[-1] in names if names else layer.clearable
                if wanted and begin == "clear_entirely_":
                    call(layer, layer.reset)
                elif wanted:
                    call(layer, partial(layer.reset, square, invert=begin == "clear_except_"))
        call(costmap, costmap.update, max(self._move_base.now, self._clock.now()))
        if hasattr(response, "success"):
            response.success = True

    def _get(self, costmap: LayeredCostmap, request: Any, response: Any) -> None:
        del request
        response.map = raw_costmap(self._build, self._clock.ns(self._clock.now()), costmap.master)

    def _cost(self, costmap: LayeredCostmap, request: Any, response: Any) -> None:
        pose = Pose2D(float(request.x), float(request.y), float(request.theta))
        cost = pose_cost(costmap, pose, use_footprint=bool(request.use_footprint))
        response.cost = -1.0 if cost is None else float(cost)

    def _costs(self, costmap: LayeredCostmap, request: Any, response: Any) -> None:
        poses = [self._in_frame(costmap, pose) for pose in request.poses]
        found = [pose_cost(costmap, pose, use_footprint=bool(request.use_footprint)) for pose in poses]
        response.costs = [-1.0 if cost is None else float(cost) for cost in found]
        response.success = None not in found

    def _in_frame(self, costmap: LayeredCostmap, pose: Any) -> Pose2D:
        return self._to(costmap, msg.frame_of(pose)).apply(msg.pose_of(pose.pose))

    def _to(self, costmap: LayeredCostmap, frame: str) -> Transform2D:
        if frame in ("", costmap.frame):
            return Transform2D()
        return self._move_base.robot.frames.lookup(costmap.frame, frame)

    def _validate(self, request: Any, response: Any) -> None:
        """Check the poses of a path from the one nearest to the robot."""
        costmap = self._move_base.global_costmap
        frame, poses = msg.path_of(request.path)
        response.is_valid = False
        if not len(poses) or not isinstance(costmap, LayeredCostmap):
            return
        try:
            poses = self._to(costmap, frame).apply_poses(poses)
            robot = costmap.robot_pose(self._clock.now())
        except FrameError:
            return
        limit = int(getattr(request, "max_cost", LETHAL)) or LETHAL
        unknown = bool(getattr(request, "consider_unknown_as_obstacle", False))
        first = int(np.argmin(np.hypot(poses[:, 0] - robot.x, poses[:, 1] - robot.y)))
        for index in range(first, len(poses)):
            cost = pose_cost(costmap, Pose2D(*map(float, poses[index])), use_footprint=True)
            if cost is None or (unknown if cost == UNKNOWN else cost >= limit):
                response.invalid_pose_indices = [index]
                return
        response.is_valid = True
