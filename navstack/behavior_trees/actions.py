"""Action nodes of Nav2: goals of action servers, calls of services, and what is computed in the tree itself.

Source of the rules: nav2_behavior_tree/plugins/action, bt_action_node.hpp and bt_service_node.hpp. Error codes are those of
nav2_msgs.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from navstack.behavior_trees.blackboard import Port, StampedPose, inputs, outputs
from navstack.behavior_trees.conditions import NearestPose, TrackingFeedback, end_within
from navstack.behavior_trees.nodes import FAILURE, IDLE, RUNNING, SUCCESS, Action, Status, node
from navstack.behavior_trees.servers import ActionState, ActionTicket
from navstack.core import Path

NANO: Final = 1_000_000_000
GOAL_REJECTED: Final = 1
_MOTION: Final = inputs(time_allowance=("double", "10.0"), disable_collision_checks=("bool", "false"))
_START: Final = inputs(start="pose")


def empty_path() -> Path:
    """Return a path without poses."""
    return Path(np.empty((0, 3)))


def _poses(value: object) -> list[StampedPose]:
    return value if isinstance(value, list) else []


# --- goals of action servers -------------------------------------------------------------------------------------------


class ServerAction(Action):
    """Sends a goal to an action server in the first tick, and returns its result."""

    PORTS = (
        *inputs(server_name="string", server_timeout="unsigned"),
        *outputs(error_code_id="unsigned", error_msg="string"),
    )

    SERVER: ClassVar[str]
    """Default of `server_name`."""
    RESULTS: ClassVar[tuple[str, ...]] = ()
    """Output ports that have the result's value of that name."""
    RECOVERY: ClassVar[bool | None] = False
    """Whether it counts in the entry `number_recoveries`; None: as the port `is_recovery` says."""

    __slots__ = ("goal", "server", "ticket")

    def __init__(self) -> None:
        super().__init__()
        self.ticket: ActionTicket | None = None
        self.goal: dict[str, object] = {}
        self.server = ""

    def setup(self) -> None:
        """Read the name of the server."""
        self.server = self.text("server_name") or self.SERVER

    def make_goal(self) -> dict[str, object]:
        """Return the goal: the values of all input ports that have one."""
        common = ("server_name", "server_timeout")
        return {name: port.get() for name, port in self.inputs.items() if name not in common and port.get() is not None}

    def while_running(self, ticket: ActionTicket) -> ActionTicket | None:
        """Read the feedback, replace the goal if an input has changed; called in each tick. None if it is rejected."""
        return ticket

    def clear_results(self) -> None:
        """Write empty results after a failure or a cancel."""

    def tick(self) -> Status:
        """Send the goal, or see what became of it."""
        servers = self.tree.servers
        if self.status is IDLE:
            self.goal = self.make_goal()
            if self.RECOVERY is True or (self.RECOVERY is None and self.flag("is_recovery")):
                count_recovery(self)
            self.status = RUNNING
            self.ticket = servers.send(self.server, self.goal)
        elif self.ticket is not None:
            self.ticket = self.while_running(self.ticket)
        ticket = self.ticket
        if ticket is None:
            return self.failed(GOAL_REJECTED, f'the server "{self.server}" rejected the goal')
        state = servers.poll(ticket)
        if state is ActionState.ACTIVE:
            return RUNNING
        self.ticket = None
        if state is ActionState.ABORTED:
            self.clear_results()
            return self.failed(ticket.code, ticket.message)
        if state is ActionState.CANCELED:
            self.clear_results()
        else:
            for name in self.RESULTS:
                self.outputs[name].set(ticket.result.get(name))
        self.code, self.message = 0, ""
        self._write_error()
        return SUCCESS

    def failed(self, code: int, message: str) -> Status:
        """Write the error; return FAILURE."""
        self.code, self.message = code, message
        self._write_error()
        return FAILURE

    def _write_error(self) -> None:
        self.outputs["error_code_id"].set(self.code)
        self.outputs["error_msg"].set(self.message)

    def halted(self) -> None:
        """Cancel the goal."""
        ticket, self.ticket = self.ticket, None
        if ticket is not None:
            servers = self.tree.servers
            if servers.poll(ticket) is ActionState.ACTIVE:
                servers.cancel(ticket)
                self.clear_results()
                self.code, self.message = 0, ""
                self._write_error()


def count_recovery(item: Action) -> None:
    """Add 1 to the entry `number_recoveries`, and tell the servers."""
    entry = item.entry("number_recoveries")
    entry.set((entry.value if isinstance(entry.value, int) else 0) + 1)
    item.tree.servers.recovers()


class _PathAction(ServerAction):
    """An action whose path is empty after a failure and after any halt."""

    RESULTS = ("path",)

    def clear_results(self) -> None:
        """Write an empty path."""
        self.outputs["path"].set(empty_path())

    def halt(self) -> None:
        """Cancel, and write an empty path."""
        self.clear_results()
        super().halt()


@node(
    "ComputePathToPose",
    ports=(
        *_START,
        *inputs(use_start="bool", goal="pose!", viapoints="poses", planner_id=("string", "")),
        *outputs(path="path"),
    ),
)
class ComputePathToPose(_PathAction):
    """Plans a path to `goal`, from the robot or from `start`."""

    SERVER = "compute_path_to_pose"

    def make_goal(self) -> dict[str, object]:
        """Return the goal; `start` counts unless `use_start` is false."""
        goal = super().make_goal()
        goal["use_start"] = bool(goal.get("use_start", "start" in goal)) and "start" in goal
        return goal


@node(
    "ComputePathThroughPoses",
    ports=(
        *_START,
        *inputs(goals="poses!", planner_id=("string", "")),
        *outputs(path="path", last_reached_index="int"),
    ),
)
class ComputePathThroughPoses(_PathAction):
    """Plans a path through `goals`."""

    SERVER = "compute_path_through_poses"
    RESULTS = ("path", "last_reached_index")

    def clear_results(self) -> None:
        """Write an empty path."""
        super().clear_results()
        self.outputs["last_reached_index"].set(-1)


_ROUTE: Final = (
    *_START,
    *inputs(
        goal="pose", start_id="unsigned", goal_id="unsigned", use_start=("bool", "false"), use_poses=("bool", "false")
    ),
    *outputs(route="route", path="path"),
)


@node("ComputeRoute", ports=(*_ROUTE, *outputs(planning_time="duration")))
class ComputeRoute(_PathAction):
    """Asks the route server for a route and its path."""

    SERVER = "compute_route"
    RESULTS = ("path", "route", "planning_time")

    def clear_results(self) -> None:
        """Write an empty path and an empty route."""
        super().clear_results()
        self.outputs["route"].set(None)


@node(
    "ComputeAndTrackRoute",
    ports=(
        *_ROUTE,
        *outputs(
            execution_duration="duration",
            last_node_id="unsigned",
            next_node_id="unsigned",
            current_edge_id="unsigned",
            rerouted="bool",
        ),
    ),
)
class ComputeAndTrackRoute(ServerAction):
    """Asks the route server for a route, and tracks the progress on it until its end."""

    SERVER = "compute_and_track_route"
    RESULTS = ("execution_duration",)
    FEEDBACK = ("last_node_id", "next_node_id", "current_edge_id", "route", "path", "rerouted")

    def while_running(self, ticket: ActionTicket) -> ActionTicket | None:
        """Write the feedback."""
        for name in self.FEEDBACK:
            if name in ticket.feedback:
                self.outputs[name].set(ticket.feedback[name])
        return ticket

    def clear_results(self) -> None:
        """Write an empty path and an empty route."""
        self.outputs["path"].set(empty_path())
        self.outputs["route"].set(None)


@node(
    "SmoothPath",
    ports=(
        *inputs(
            unsmoothed_path="path!",
            max_smoothing_duration=("double", "3.0"),
            check_for_collisions=("bool", "false"),
            smoother_id="string",
        ),
        *outputs(smoothed_path="path", smoothing_duration="double", was_completed="bool"),
    ),
)
class SmoothPath(ServerAction):
    """Smooths a path."""

    SERVER = "smooth_path"
    RESULTS = ("smoothed_path", "smoothing_duration", "was_completed")


@node(
    "FollowPath",
    ports=(
        *inputs(
            path="path!",
            controller_id="string",
            goal_checker_id="string",
            progress_checker_id="string",
            path_handler_id="string",
        ),
        *outputs(tracking_feedback="tracking_feedback"),
    ),
)
class FollowPath(ServerAction):
    """Follows a path; a new path, controller or checker replaces the goal of the server without a halt."""

    SERVER = "follow_path"
    IDS = ("controller_id", "goal_checker_id", "progress_checker_id", "path_handler_id")

    def while_running(self, ticket: ActionTicket) -> ActionTicket | None:
        """Send the goal again if an input has changed."""
        goal, changed = self.goal, False
        path = self.inputs["path"].get()
        if path is not goal.get("path") and isinstance(path, Path) and len(path):
            goal["path"] = path
            changed = True
        for name in self.IDS:
            value = self.inputs[name].get()
            if value is not None and value != goal.get(name):
                goal[name] = value
                changed = True
        feedback = ticket.feedback.get("tracking_feedback")
        if feedback is not None:
            self.outputs["tracking_feedback"].set(feedback)
        if changed and ticket.state is ActionState.ACTIVE:
            return self.tree.servers.send(self.server, goal)
        return ticket

    def clear_results(self) -> None:
        """Write an empty feedback."""
        self.outputs["tracking_feedback"].set(TrackingFeedback())


@node("Spin", ports=(*inputs(spin_dist=("double", "1.57"), is_recovery=("bool", "true")), *_MOTION))
class Spin(ServerAction):
    """Turns in place."""

    SERVER = "spin"
    RECOVERY = None


@node("BackUp", ports=(*inputs(backup_dist=("double", "0.15"), backup_speed=("double", "0.025")), *_MOTION))
class BackUp(ServerAction):
    """Drives backward."""

    SERVER = "backup"
    RECOVERY = True


@node("DriveOnHeading", ports=(*inputs(dist_to_travel=("double", "0.15"), speed=("double", "0.025")), *_MOTION))
class DriveOnHeading(ServerAction):
    """Drives straight ahead."""

    SERVER = "drive_on_heading"


@node("Wait", ports=inputs(wait_duration=("double", "1.0")))
class Wait(ServerAction):
    """Waits."""

    SERVER = "wait"
    RECOVERY = True

    def make_goal(self) -> dict[str, object]:
        """Return the goal; a negative time is made positive, as in Nav2."""
        return {"wait_duration": abs(self.number("wait_duration", 1.0))}


@node("AssistedTeleop", ports=inputs(is_recovery=("bool", "false"), time_allowance=("double", "10.0")))
class AssistedTeleop(ServerAction):
    """Lets a person drive, with checks for collisions. Unless it is a recovery, its failure counts as SUCCESS, as in Nav2."""

    SERVER = "assisted_teleop"
    RECOVERY = None

    def failed(self, code: int, message: str) -> Status:
        """Write the error; return FAILURE if it is a recovery."""
        return (
            super().failed(code, message) if self.flag("is_recovery") else (super().failed(code, message), SUCCESS)[1]
        )


@node("NavigateToPose", ports=inputs(goal="pose!", behavior_tree="string"))
class NavigateToPose(ServerAction):
    """Navigates to a pose with a tree of its own."""

    SERVER = "navigate_to_pose"


@node("NavigateThroughPoses", ports=inputs(goals="poses!", behavior_tree="string"))
class NavigateThroughPoses(ServerAction):
    """Navigates through poses with a tree of its own."""

    SERVER = "navigate_through_poses"


@node(
    "DockRobot",
    ports=(
        *inputs(
            use_dock_id=("bool", "true"),
            dock_id="string",
            dock_pose="pose",
            dock_type="string",
            max_staging_time=("double", "1000.0"),
            navigate_to_staging_pose=("bool", "true"),
        ),
        *outputs(success="bool", num_retries="unsigned"),
    ),
)
class DockRobot(ServerAction):
    """Docks the robot."""

    SERVER = "dock_robot"
    RESULTS = ("success", "num_retries")

    def clear_results(self) -> None:
        """Write that it has not docked."""
        self.outputs["success"].set(False)


@node(
    "UndockRobot", ports=(*inputs(dock_type="string", max_undocking_time=("double", "30.0")), *outputs(success="bool"))
)
class UndockRobot(ServerAction):
    """Undocks the robot."""

    SERVER = "undock_robot"
    RESULTS = ("success",)

    def clear_results(self) -> None:
        """Write that it is not undocked."""
        self.outputs["success"].set(False)


@node(
    "FollowObject",
    ports=(
        *inputs(pose_topic=("string", "dynamic_pose"), max_duration=("double", "0.0"), tracked_frame="string"),
        *outputs(total_elapsed_time="duration"),
    ),
)
class FollowObject(ServerAction):
    """Follows an object."""

    SERVER = "follow_object"
    RESULTS = ("total_elapsed_time",)


class _Cancel(Action):
    """Cancels every goal of a server."""

    PORTS = inputs(server_name="string", server_timeout="unsigned")
    SERVER: ClassVar[str]

    def tick(self) -> Status:
        """Cancel the goals."""
        name = self.text("server_name") or self.SERVER
        if self.tree.servers.cancel_all(name):
            return SUCCESS
        self.message = f'there is no server "{name}"'
        return FAILURE

    def halt(self) -> None:
        """Do nothing: a cancel cannot be taken back."""
        self.status = IDLE


for _name, _server in (
    ("CancelControl", "follow_path"),
    ("CancelBackUp", "backup"),
    ("CancelDriveOnHeading", "drive_on_heading"),
    ("CancelSpin", "spin"),
    ("CancelAssistedTeleop", "assisted_teleop"),
    ("CancelWait", "wait"),
    ("CancelComputeAndTrackRoute", "compute_and_track_route"),
    ("CancelFollowObject", "follow_object"),
    ("CancelDockRobot", "dock_robot"),
    ("CancelUndockRobot", "undock_robot"),
):
    _old = {"CancelControl": ("ControllerCancel",)}.get(_name, ())
    node(_name, *_old)(type(_name, (_Cancel,), {"SERVER": _server, "__slots__": (), "__doc__": _Cancel.__doc__}))


# --- services ----------------------------------------------------------------------------------------------------------


class ServiceAction(Action):
    """Calls a service; SUCCESS if the service succeeds."""

    PORTS = inputs(service_name="string", server_timeout="unsigned")

    SERVICE: ClassVar[str] = ""
    """Default of `service_name`."""
    RECOVERY: ClassVar[bool] = False

    def request(self) -> dict[str, object] | None:
        """Return the request; None to fail without a call."""
        common = ("service_name", "server_timeout")
        return {name: port.get() for name, port in self.inputs.items() if name not in common and port.get() is not None}

    def tick(self) -> Status:
        """Call the service."""
        request = self.request()
        if self.RECOVERY:
            count_recovery(self)
        if request is None:
            return FAILURE
        service = self.text("service_name") or self.SERVICE
        response = self.tree.servers.call(service, self.type, request)
        if response is None:
            self.message = f'there is no service "{service}"'
            return FAILURE
        self.message = ""
        return self.completed(request, dict(response))

    def completed(self, request: dict[str, object], response: dict[str, object]) -> Status:
        """Return the status for a response."""
        del request
        if response.get("success", True):
            return SUCCESS
        message = response.get("message")
        self.message = message if isinstance(message, str) else ""
        return FAILURE


class _Clear(ServiceAction):
    PORTS = (*ServiceAction.PORTS, *inputs(plugins="strings"))
    RECOVERY = True


_RESET: Final = inputs(reset_distance=("double", "1.0"))


@node("ClearEntireCostmap")
class ClearEntireCostmap(_Clear):
    """Clears a costmap."""


@node("ClearCostmapExceptRegion", ports=_RESET)
class ClearCostmapExceptRegion(_Clear):
    """Clears a costmap outside a square around the robot."""


@node("ClearCostmapAroundRobot", ports=_RESET)
class ClearCostmapAroundRobot(_Clear):
    """Clears a costmap in a square around the robot."""


@node("ClearCostmapAroundPose", ports=(*inputs(pose="pose!"), *_RESET))
class ClearCostmapAroundPose(_Clear):
    """Clears a costmap around a pose."""


@node("ReinitializeGlobalLocalization")
class ReinitializeGlobalLocalization(ServiceAction):
    """Lets the localization search the whole map."""

    SERVICE = "reinitialize_global_localization"


@node("ToggleCollisionMonitor", ports=inputs(enable=("bool", "true")))
class ToggleCollisionMonitor(ServiceAction):
    """Turns the collision monitor on or off."""

    SERVICE = "collision_monitor/toggle"


@node(
    "ValidatePath",
    "IsPathValid",
    ports=(
        *inputs(
            path="path!",
            max_cost=("unsigned", "254"),
            consider_unknown_as_obstacle=("bool", "false"),
            layer_name=("string", ""),
            footprint=("string", ""),
            stop_at_first_collision=("bool", "true"),
            max_lookahead_distance=("double", "-1.0"),
        ),
        *outputs(collision_poses="poses"),
    ),
)
class ValidatePath(ServiceAction):
    """SUCCESS if no pose of the path collides. The condition IsPathValid of iron to kilted is the same."""

    SERVICE = "is_path_valid"

    def request(self) -> dict[str, object]:
        """Return the request; a path that has not been planned yet is empty."""
        request = super().request() or {}
        request.setdefault("path", empty_path())
        return request

    def completed(self, request: dict[str, object], response: dict[str, object]) -> Status:
        """Write the poses that collide."""
        if not response.get("success", True):
            return FAILURE
        path, found = request.get("path"), response.get("invalid_pose_indices")
        poses: list[StampedPose] = []
        if isinstance(path, Path) and isinstance(found, list):
            indices: list[int] = found
            poses = [StampedPose(*path[index], path.frame) for index in indices if 0 <= index < len(path)]
        self.outputs["collision_poses"].set(poses)
        return SUCCESS if response.get("is_valid") else FAILURE


_OCCUPANCY: Final = inputs(
    cost_threshold=("double", "254.0"), use_footprint=("bool", "true"), consider_unknown_as_obstacle=("bool", "false")
)


class _Costs(ServiceAction):
    SERVICE = "/global_costmap/get_cost_global_costmap"

    def is_free(self, cost: float) -> bool:
        """Return True for a cost below the threshold, and for an unknown one unless it counts as an obstacle."""
        if cost == 255.0 and not self.flag("consider_unknown_as_obstacle"):
            return True
        return cost < self.number("cost_threshold", 254.0)


def _costs(response: dict[str, object]) -> list[float] | None:
    found = response.get("costs")
    if not response.get("success", True) or not isinstance(found, list):
        return None
    costs: list[float] = found
    return costs


@node("CheckPoseOccupancy", ports=(*inputs(pose="pose!"), *_OCCUPANCY))
class CheckPoseOccupancy(_Costs):
    """SUCCESS if a pose is occupied."""

    def request(self) -> dict[str, object]:
        """Return the request."""
        return {"poses": [self.get("pose")], "use_footprint": self.flag("use_footprint")}

    def completed(self, request: dict[str, object], response: dict[str, object]) -> Status:
        """Compare the cost."""
        del request
        costs = _costs(response)
        return SUCCESS if costs and not self.is_free(costs[0]) else FAILURE


class _Goals(Action):
    """Reads `input_goals` and writes `output_goals`, which may be the same entry."""

    PORTS = (*inputs(input_goals="poses!"), *outputs(output_goals="poses"))


_STATUSES: Final = (
    *inputs(input_waypoint_statuses="waypoint_statuses"),
    *outputs(output_waypoint_statuses="waypoint_statuses"),
)


@node("RemoveInCollisionGoals", ports=(*_Goals.PORTS, *_OCCUPANCY, *_STATUSES))
class RemoveInCollisionGoals(_Costs):
    """Removes the goals that are occupied."""

    def request(self) -> dict[str, object] | None:
        """Return the request; None without goals."""
        goals = _poses(self.get("input_goals"))
        if not goals:
            self.outputs["output_goals"].set(goals)
            return None
        return {"poses": goals, "use_footprint": self.flag("use_footprint")}

    def completed(self, request: dict[str, object], response: dict[str, object]) -> Status:
        """Write the free goals."""
        goals, costs = _poses(request["poses"]), _costs(response)
        if costs is None:
            self.outputs["output_goals"].set(goals)
            return FAILURE
        self.outputs["output_goals"].set([goal for goal, cost in zip(goals, costs, strict=False) if self.is_free(cost)])
        return SUCCESS


# --- in the tree itself ------------------------------------------------------------------------------------------------


@node("RemovePassedGoals", ports=(*inputs(radius=("double", "0.5"), robot_base_frame="string"), *_STATUSES))
class RemovePassedGoals(_Goals):
    """Removes the first goals while the robot is within `radius` (m) of them; the last goal stays."""

    def tick(self) -> Status:
        """Compare the poses."""
        goals = _poses(self.get("input_goals"))
        if goals:
            pose = self.tree.robot_pose(goals[0].frame, self.text("robot_base_frame"))
            if pose is None:
                return FAILURE
            radius, passed = self.number("radius", 0.5), 0
            while passed < len(goals) - 1 and math.hypot(goals[passed].x - pose.x, goals[passed].y - pose.y) <= radius:
                passed += 1
            goals = goals[passed:] if passed else goals
        self.outputs["output_goals"].set(goals)
        return SUCCESS


@node("AppendGoalPoseToGoals", ports=inputs(goal_pose="pose!"))
class AppendGoalPoseToGoals(_Goals):
    """Appends a goal."""

    def tick(self) -> Status:
        """Append."""
        self.outputs["output_goals"].set([*_poses(self.get("input_goals")), self.get("goal_pose")])
        return SUCCESS


@node("GetNextFewGoals", ports=inputs(num_goals="unsigned!"))
class GetNextFewGoals(_Goals):
    """Takes the first goals."""

    def tick(self) -> Status:
        """Take."""
        goals = _poses(self.get("input_goals"))
        if not goals:
            return FAILURE
        self.outputs["output_goals"].set(goals[: self.integer("num_goals")])
        return SUCCESS


@node("ExtractRouteNodesAsGoals", ports=(*inputs(route="route!"), *outputs(goals="poses")))
class ExtractRouteNodesAsGoals(Action):
    """Makes goals of the nodes of a route: an object with `nodes`, pairs of x and y (m)."""

    def tick(self) -> Status:
        """Make goals."""
        nodes: list[tuple[float, float]] = list(getattr(self.get("route"), "nodes", ()))
        if not nodes:
            return FAILURE
        self.outputs["goals"].set([StampedPose(float(x), float(y)) for x, y in nodes])
        return SUCCESS


@node(
    "GetCurrentPose", ports=(*inputs(robot_base_frame="string", global_frame="string"), *outputs(current_pose="pose"))
)
class GetCurrentPose(Action):
    """Writes the robot's pose."""

    def tick(self) -> Status:
        """Write the pose."""
        pose = self.tree.robot_pose(self.text("global_frame"), self.text("robot_base_frame"))
        if pose is None:
            return FAILURE
        self.outputs["current_pose"].set(pose)
        return SUCCESS


@node("GetPoseFromPath", ports=(*inputs(path="path!", index=("int", "0")), *outputs(pose="pose")))
class GetPoseFromPath(Action):
    """Writes a pose of a path; a negative index counts from the end."""

    def tick(self) -> Status:
        """Write the pose."""
        path, index = self.get("path"), self.integer("index")
        if not isinstance(path, Path) or not -len(path) <= index < len(path):
            return FAILURE
        self.outputs["pose"].set(StampedPose(*path[index], path.frame))
        return SUCCESS


@node("ConcatenatePaths", ports=(*inputs(input_path1="path!", input_path2="path!"), *outputs(output_path="path")))
class ConcatenatePaths(Action):
    """Writes two paths as one."""

    def tick(self) -> Status:
        """Join the paths."""
        paths = [
            path for name in ("input_path1", "input_path2") if isinstance(path := self.get(name), Path) and len(path)
        ]
        if not paths:
            return FAILURE
        self.outputs["output_path"].set(Path(np.vstack([path.poses for path in paths]), paths[0].frame))
        return SUCCESS


@node("TruncatePath", ports=(*inputs(input_path="path!", distance=("double", "1.0")), *outputs(output_path="path")))
class TruncatePath(Action):
    """Removes the last `distance` (m) of a path; the last pose that is left looks at the removed end."""

    def tick(self) -> Status:
        """Shorten the path."""
        path, distance = self.get("input_path"), self.number("distance", 1.0)
        if not isinstance(path, Path) or not len(path):
            self.outputs["output_path"].set(path if isinstance(path, Path) else empty_path())
            return SUCCESS
        poses = path.poses
        end = poses[-1]
        far = np.flatnonzero(np.hypot(poses[:, 0] - end[0], poses[:, 1] - end[1]) >= distance)
        last = max(int(far[-1]) if len(far) else 0, min(1, len(poses) - 1)) if distance > 0.0 else len(poses) - 1
        kept = poses[: last + 1].copy()
        kept[-1, 2] = math.atan2(end[1] - kept[-1, 1], end[0] - kept[-1, 0])
        self.outputs["output_path"].set(Path(kept, path.frame))
        return SUCCESS


@node(
    "TruncatePathLocal",
    ports=(
        *inputs(
            input_path="path!",
            distance_forward=("double", "8.0"),
            distance_backward=("double", "4.0"),
            robot_base_frame="string",
            transform_tolerance=("double", "0.2"),
            pose="pose",
            angular_distance_weight=("double", "0.0"),
            max_robot_pose_search_dist=("double", "inf"),
        ),
        *outputs(output_path="path"),
    ),
)
class TruncatePathLocal(Action):
    """Takes the part of a path around the robot, or around `pose`."""

    __slots__ = ("nearest",)

    def __init__(self) -> None:
        super().__init__()
        self.nearest = NearestPose()

    def tick(self) -> Status:
        """Find the nearest pose and cut."""
        found = self.get("input_path")
        path = found if isinstance(found, Path) else empty_path()
        at = self.get("pose")
        pose = at if isinstance(at, StampedPose) else self.tree.robot_pose(path.frame, self.text("robot_base_frame"))
        if pose is None:
            return FAILURE
        if not len(path):
            self.outputs["output_path"].set(path)
            return SUCCESS
        forward, backward = self.number("distance_forward", 8.0), self.number("distance_backward", 4.0)
        search = self.number("max_robot_pose_search_dist", math.inf)
        weight = self.number("angular_distance_weight")
        nearest = self.nearest.find(path, pose, search if math.isfinite(search) else None, weight)
        last = end_within(path, nearest, forward) if forward >= 0.0 else len(path)
        behind = Path(path.poses[: nearest + 1][::-1], path.frame)
        first = nearest + 1 - end_within(behind, 0, backward)
        self.outputs["output_path"].set(Path(path.poses[first:last], path.frame))
        return SUCCESS


@node("CheckStopStatus", ports=inputs(velocity_threshold=("double", "0.01"), duration_stopped=("unsigned", "1000")))
class CheckStopStatus(Action):
    """SUCCESS once the robot has stood for `duration_stopped` (ms), FAILURE while it moves."""

    __slots__ = ("since",)

    def __init__(self) -> None:
        super().__init__()
        self.since: int | None = None

    def tick(self) -> Status:
        """Compare velocity and time."""
        velocity, limit = self.tree.servers.velocity(), self.number("velocity_threshold", 0.01)
        if max(abs(velocity.vx), abs(velocity.vy), abs(velocity.wz)) >= limit:
            self.since = None
            return FAILURE
        now = self.tree.now_ns
        if self.since is None:
            self.since = now
        if now - self.since <= 1_000_000 * self.integer("duration_stopped", 1000):
            return RUNNING
        self.since = None
        return SUCCESS


class _Selector(Action):
    """Writes the last name of a topic, or the default."""

    KIND: ClassVar[str]

    __slots__ = ("_default", "_selected", "_topic", "chosen")

    def setup(self) -> None:
        """Read the ports."""
        self.chosen = ""
        self._topic = self.text("topic_name")
        self._default = self.inputs[f"default_{self.KIND}"]
        self._selected = self.outputs[f"selected_{self.KIND}"]

    def tick(self) -> Status:
        """Write the name."""
        message = self.tree.topics.get(self._topic)
        if message is not None:
            self.chosen = str(message)
        if not self.chosen:
            default = self._default.get()
            if not default:
                self.message = f'nothing has been sent on "{self._topic}", and there is no default_{self.KIND}'
                return FAILURE
            self.chosen = str(default)
        self._selected.set(self.chosen)
        return SUCCESS


for _name, _kind in (
    ("PlannerSelector", "planner"),
    ("ControllerSelector", "controller"),
    ("SmootherSelector", "smoother"),
    ("GoalCheckerSelector", "goal_checker"),
    ("ProgressCheckerSelector", "progress_checker"),
    ("PathHandlerSelector", "path_handler"),
):
    _ports = (
        Port("topic_name", "string", f"{_kind}_selector"),
        Port(f"default_{_kind}", "string"),
        Port(f"selected_{_kind}", "string", direction="out"),
    )
    node(_name, ports=_ports)(type(_name, (_Selector,), {"KIND": _kind, "__slots__": (), "__doc__": _Selector.__doc__}))
