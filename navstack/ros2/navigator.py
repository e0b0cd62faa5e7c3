"""The navigator: a ROS 2 node in place of Nav2's servers, with their actions, topics, services and life cycle."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from navstack.core import Event, InputError, NavError, Path, Pose2D, Transform2D, Twist2D
from navstack.costmap import BinaryMaskLayer, MaskLayer
from navstack.docking import DockDatabase
from navstack.global_planner import SmoothedPlanner
from navstack.move_base import MoveBase, ThreadPlanning, TickResult, TreeMoveBase, full_speed, pose_cost
from navstack.parameters import Configuration
from navstack.plugins import SMOOTHERS, Smoother, limits_of
from navstack.replay import sensor_topics
from navstack.ros2 import docking, ros, tasks
from navstack.ros2.actions import Server, Tasks
from navstack.ros2.lifecycle import BOND, Bond, offer_manager, offer_state
from navstack.ros2.parameters import LiveParameters
from navstack.ros2.ros import RosNode, value_of
from navstack.ros2.routes import ComputeRouteTask, RouteTopics, TrackRouteTask
from navstack.ros2.services import LETHAL, UNKNOWN, Services
from navstack.ros2.tasks import Task
from navstack.ros2.topics import BinaryState, CostmapTopics, Diagnostics, FilterTopics, PlanTopics
from navstack.ros_messages import messages as msg
from navstack.ros_node import (
    MOST_ODOMETRY,
    MOST_SENSOR_DATA,
    MOST_TRANSFORMS,
    RECEIVERS,
    NodeClock,
    PlannerCopy,
    RecordFolder,
    StackNode,
    layered_costmaps,
)

STANDS_IN_FOR: Final = (
    *("bt_navigator", "controller_server", "planner_server", "behavior_server", "smoother_server"),
    *("waypoint_follower", "docking_server", "route_server"),
)
"""Nodes of Nav2 whose state clients ask for."""
INACTIVE: Final = (2, "inactive")
KILLED: Final = "node has been killed"


class Navigator(StackNode):
    """The node. Parameters of its own: `autostart` (true), `enable_stamped_cmd_vel` (as Nav2 of the distribution),
    `stop_on_failure` of FollowWaypoints (true), `odom_topic` (odom).
    """

    name = "ros2"
    trees_by_goal = True

    def __init__(self, configuration: Configuration, node: RosNode, record: RecordFolder | None = None) -> None:
        """`node` has been started. Raises InputError for wrong parameters."""
        self.node, handle = node, node.handle
        self._wanted: bool | None = None
        """What the last transition of the life cycle says; None before the first one."""
        self._autostart = value_of(handle, "autostart", True, "true or false")
        self._stop_on_failure = value_of(handle, "stop_on_failure", True, "true or false")
        odometry = value_of(handle, "odom_topic", "odom", "a text")
        self._stamped = value_of(handle, "enable_stamped_cmd_vel", ros.is_at_least("kilted"), "true or false")
        is_simulated = node.wait_for_clock()
        kind = "geometry_msgs/msg/TwistStamped" if self._stamped else "geometry_msgs/msg/Twist"
        self._cmd_vel = node.publisher("cmd_vel", kind, important=True)
        super().__init__(configuration, node.log, NodeClock(node.now_ns), is_simulated=is_simulated, record=record)
        self.tasks = Tasks(node, self.inbox, self.clock)
        self._costmaps: list[CostmapTopics] = []
        self._filters: list[FilterTopics] = []
        self._states: list[BinaryState] = []
        self._plans: PlanTopics | None = None
        self._diagnostics: Diagnostics | None = None
        self._base = configuration.local_costmap.params.robot_base_frame
        self._docks: DockDatabase | None = None
        self._bond = Bond(node) if ros.has_message(BOND) else None
        self._subscribe(odometry)

    # --- messages -----------------------------------------------------------------------------------------------------

    def _subscribe(self, odometry: str) -> None:
        node, robot, later = self.node, self.robot, self.inbox.poster
        if self._is_simulated:
            # every step of the clock wakes the node
            node.subscribe("/clock", "rosgraph_msgs/msg/Clock", later(self.wake, most=1), reliable=False)
        tf = msg.TRANSFORMS[0]
        node.subscribe("/tf_static", tf, later(robot.receive_transforms, static=True), depth=100, latched=True)
        node.subscribe("/tf", tf, later(robot.receive_transforms, static=False, most=MOST_TRANSFORMS), depth=100)
        node.subscribe(odometry, msg.ODOMETRY, later(robot.receive_odometry, most=MOST_ODOMETRY), depth=10)
        sensors = sensor_topics(self.configuration).values()
        self.sensor_topics = sorted(sensor.name for sensor in sensors)
        for sensor in sensors:
            receive = later(
                self.receive_data, getattr(robot, RECEIVERS[sensor.type][1]), sensor.name, most=MOST_SENSOR_DATA
            )
            node.subscribe(sensor.name, sensor.type, receive, depth=MOST_SENSOR_DATA, reliable=False)
        node.subscribe(self.map_topic(), msg.MAP, later(self._on_map, most=1), latched=True)

        if ros.has_module("nav2_msgs"):
            docking.subscribe(node, self.inbox, robot, docking.detection_topics(self.configuration.docking))

    def _on_map(self, message: Any) -> None:
        self.use_map(msg.map_of(message, self.node.resolved(self.map_topic()), self.node.log.logwarn))

    def publish_command(self, twist: Twist2D) -> None:
        """Publish a velocity: a Twist, or a TwistStamped in the frame of the base."""
        build = self.node.build
        self._cmd_vel.publish(
            build.twist_stamped(self.node.now_ns(), self._base, twist) if self._stamped else build.twist(twist)
        )

    def _on_teleop(self, message: Any) -> None:
        """Take a velocity of a person, while assisted_teleop runs: a Twist or a TwistStamped."""
        move_base = self.move_base
        if move_base is not None and move_base.motions.assisted is not None:
            move_base.motions.drive(msg.twist_of(getattr(message, "twist", message)))

    def _on_preempt_teleop(self, message: Any) -> None:
        """End assisted_teleop with success."""
        assisted = None if self.move_base is None else self.move_base.motions.assisted
        if assisted is not None:
            assisted.preempt()

    def _on_speed_limit(self, message: Any) -> None:
        """Limit the speed (m/s, or percent of the full speed); 0 is no limit."""
        limit = float(message.speed_limit)
        move_base = self.move_base
        if move_base is not None:
            move_base.limit_speed(0.01 * limit * self._full_speed if message.percentage else limit)

    # --- start --------------------------------------------------------------------------------------------------------

    def connect(self, move_base: MoveBase, planning: ThreadPlanning) -> None:
        """Create topics, services and actions of the goal manager."""
        node, inbox = self.node, self.inbox
        self._full_speed = full_speed(limits_of(move_base.local_planner))
        self._plans = PlanTopics(node, self.clock)
        if ros.has_module("diagnostic_msgs"):
            self._diagnostics = Diagnostics(node, self.clock, self.robot, self.times)
        self._costmaps = [CostmapTopics(costmap, node, self.clock, inbox) for costmap in layered_costmaps(move_base)]
        Services(node, move_base, self.clock, inbox)
        self.parameters = LiveParameters(node, self.configuration, move_base, inbox)
        self.tasks.connect(move_base)
        # a client may find an action before the transitions are through: its goal is not rejected
        self.tasks.is_active = self._autostart if self._wanted is None else self._wanted
        goal_pose = inbox.poster(self._on_goal_pose, most=1)
        if ros.has_module("nav2_msgs"):
            assert isinstance(move_base, TreeMoveBase)  # by `trees_by_goal`
            self._serve_actions(move_base)
            self._connect_filters(move_base)
            node.subscribe(
                "speed_limit", "nav2_msgs/msg/SpeedLimit", inbox.poster(self._on_speed_limit, most=1), depth=10
            )
        else:
            node.log.logwarn(
                "nav2_msgs is missing, so there are no actions, no services of costmaps, no costmap_raw and no speed_limit; "
                "goal_pose, costmaps, plans, parameters and cmd_vel work; sudo apt install ros-$ROS_DISTRO-nav2-msgs"
            )
        node.subscribe("goal_pose", msg.POSE, goal_pose)
        for name in STANDS_IN_FOR:
            if name != node.handle.get_name():
                offer_state(node, inbox, name, self._state)
        self._warn_of_namesake()
        if self._autostart:
            offer_manager(node, "lifecycle_manager_navigation", lambda: self.tasks.is_active, self._transit)
            node.later(self._activate)

    def _warn_of_namesake(self) -> None:
        handle = self.node.handle
        own = handle.get_name(), handle.get_namespace()
        if handle.get_node_names_and_namespaces().count(own) > 1:
            self.node.log.logwarn(
                "another node is called %s, or was killed less than 20 s ago: two of them would take the same goals and drive "
                "the same robot; end one, or give it another namespace (-r __ns:=/robot2)",
                handle.get_fully_qualified_name(),
            )

    def _connect_filters(self, move_base: MoveBase) -> None:
        layers = [layer for costmap in layered_costmaps(move_base) for layer in costmap.layers]
        for layer in layers:
            if isinstance(layer, MaskLayer) and layer.params.filter_info_topic:
                self._filters.append(FilterTopics(layer, self.node, self.inbox, move_base.costmaps_changed))
        self._states = [BinaryState(layer, self.node) for layer in layers if isinstance(layer, BinaryMaskLayer)]

    def _state(self) -> tuple[int, str]:
        return (3, "active") if self.tasks.is_active else INACTIVE

    def _activate(self) -> None:
        """Configure and activate this node, unless a manager has done so; in the thread of rclpy."""
        handle = self.node.handle
        if self._wanted is None:
            handle.trigger_configure()
            handle.trigger_activate()

    def _transit(self, transition: str) -> bool:
        """Take a transition of the life cycle, in the thread of rclpy; return False if the state does not allow it."""
        success = ros.load("rclpy.lifecycle").TransitionCallbackReturn.SUCCESS
        try:
            return bool(getattr(self.node.handle, f"trigger_{transition}")() == success)
        except Exception as exc:  # a class of rclpy that is not public
            self.node.log.logwarn("%s is not possible now: %s", transition, exc)
            return False

    def change_state(self, transition: str) -> None:
        """Take a transition of the life cycle, in the thread of rclpy."""
        if self._bond is not None:
            if transition == "activate":
                self._bond.begin()
            else:
                self._bond.end()
        if transition == "activate":
            self._wanted = self.tasks.is_active = True
        elif transition == "configure":
            self._wanted = False  # a manager has taken over, or the node activates itself next
        elif transition in ("deactivate", "cleanup", "shutdown"):
            self._wanted = self.tasks.is_active = False
            self.inbox.post(lambda: self._stop_all("the navigator was deactivated"))
        if transition == "shutdown":
            self.node.stop.set()

    def _stop_all(self, text: str) -> None:
        self.tasks.cancel_all(text)
        if self.move_base is not None:
            self.move_base.cancel_all_goals()

    def _read_docks(self) -> DockDatabase:
        """Return the docks, read once. Raises InputError."""
        if self._docks is None:
            self._docks = DockDatabase.of(self.configuration)
        return self._docks

    def _serve_actions(self, move_base: TreeMoveBase) -> None:
        build, node = self.node.build, self.node

        def server(name: str, kind: str, task: type[Task], **settings: Any) -> None:
            def make(goal: Any) -> Task:
                made = task(goal, move_base, build)
                for key, value in settings.items():
                    setattr(made, key, value)
                return made

            self._servers.append(Server(self.tasks, name, f"nav2_msgs/action/{kind}", make))

        self._servers: list[Server] = []
        controller = self.configuration.local_planner
        controllers = ("", controller.namespace or controller.name, controller.name, "FollowPath")
        waypoints = {
            "stop_on_failure": self._stop_on_failure,
            "codes_are_statuses": ros.has_message("nav2_msgs/msg/WaypointStatus"),
        }
        works = {
            "copy": PlannerCopy(move_base, self.inbox),
            "navigator": self,
            "submit": self._submit,
            "stamp_ns": self.clock.ns,
        }
        default_tree = {"default_tree": self.configuration.navstack.behavior_tree}
        choices = (*self.configuration.behaviors, *self.configuration.recoveries)
        motion = {"configured": {choice.cls: choice.params for choice in choices}}
        server("navigate_to_pose", "NavigateToPose", tasks.DriveTask, **default_tree)
        server("navigate_through_poses", "NavigateThroughPoses", tasks.ThroughTask, **default_tree)
        server("follow_waypoints", "FollowWaypoints", tasks.WaypointsTask, **waypoints, **default_tree)
        server("follow_path", "FollowPath", tasks.FollowPathTask, controllers=controllers)
        server("spin", "Spin", tasks.SpinTask, **motion)
        server("backup", "BackUp", tasks.BackUpTask, **motion)
        server("drive_on_heading", "DriveOnHeading", tasks.DriveOnHeadingTask, **motion)
        server("assisted_teleop", "AssistedTeleop", tasks.AssistedTeleopTask, **motion)
        server("wait", "Wait", tasks.WaitTask)
        server("compute_path_to_pose", "ComputePathToPose", PlanTask, **works)
        server("compute_path_through_poses", "ComputePathThroughPoses", PlanThroughTask, **works)
        server("smooth_path", "SmoothPath", SmoothTask, **works)
        self._serve_docking(server, default_tree)
        routes = self._routes = RouteTopics(node, move_base, self.clock, self.inbox)
        both = {"server": routes.server, "tracker": routes.tracker, "clock": self.clock}
        server("compute_route", "ComputeRoute", ComputeRouteTask, **both)
        server("compute_and_track_route", "ComputeAndTrackRoute", TrackRouteTask, **both)
        kind = "geometry_msgs/msg/TwistStamped" if self._stamped else "geometry_msgs/msg/Twist"
        node.subscribe("cmd_vel_teleop", kind, self.inbox.poster(self._on_teleop, most=1), depth=10)
        node.subscribe("preempt_teleop", "std_msgs/msg/Empty", self.inbox.poster(self._on_preempt_teleop, most=1))
        client, kind = ros.load("rclpy.action").ActionClient, ros.message("nav2_msgs/action/NavigateToPose")
        self._own_goals = self.node.create(lambda: client(self.node.handle, kind, "navigate_to_pose"))

    def _serve_docking(self, server: Callable[..., None], default_tree: dict[str, Any]) -> None:
        given = {"docks": self._read_docks, **default_tree}
        try:
            self._read_docks()
        except NavError as exc:
            self.node.log.logerr("docking_server: %s", exc.message)
        server("dock_robot", "DockRobot", docking.DockRobotTask, **given)
        server("undock_robot", "UndockRobot", docking.UndockRobotTask, **given)

    def _submit(self, work: Callable[[], Any]) -> Any:
        future = self.tasks.pool.submit(work)
        future.add_done_callback(lambda done: self.inbox.wake())
        return future

    def _on_goal_pose(self, message: Any) -> None:
        """Drive to a pose of RViz: a goal of the own action, as bt_navigator does."""
        if hasattr(self, "_own_goals"):
            goal = ros.message("nav2_msgs/action/NavigateToPose").Goal()
            goal.pose = message
            self.node.later(lambda: self._own_goals.send_goal_async(goal))
        elif self.move_base is not None and self.tasks.is_active:
            pose, frame, orientation = tasks.target_of(message)
            self.move_base.send_goal(pose, frame, orientation=orientation)

    # --- in the loop --------------------------------------------------------------------------------------------------

    def publish_tick(self, move_base: MoveBase, tick: TickResult) -> None:
        """Publish costmaps and plans."""
        for topics, window in zip(self._costmaps, (tick.global_window, tick.local_window), strict=False):
            topics.publish(tick.time, window)
        for state in self._states:
            state.publish()
        if self._plans is not None:
            self._plans.publish(move_base, tick)

    def publish_state(self, move_base: MoveBase, now: float) -> None:
        """Publish feedback and results."""
        self.tasks.update(now)

    def publish_rest(self, move_base: MoveBase, now: float) -> None:
        """Publish the diagnostics."""
        if self._diagnostics is not None:
            self._diagnostics.publish(move_base, now)

    def on_event(self, event: Event) -> None:
        """Log events; every attempt to plan is published, one without a plan as an empty path."""
        super().on_event(event)
        if event.kind == "plan_failed" and self._plans is not None and self.move_base is not None:
            self._plans.publish_plan(self.clock.ns(event.time), self.move_base.global_costmap.frame, np.empty((0, 3)))

    def is_stopping(self) -> bool:
        """Return True if the node must end."""
        return self.node.is_stopping()

    def shut_down(self, last: Callable[[], None]) -> None:
        """Call `last`, end the goals, and disconnect."""

        def end() -> None:
            try:
                last()
            finally:
                self.tasks.is_active = False
                self.tasks.cancel_all(KILLED)
                if self._bond is not None:
                    self._bond.end()
                self.tasks.pool.shutdown(wait=False, cancel_futures=True)

        self.node.shut_down(end)

    def plan_publisher(self, path: Path) -> None:
        """Publish a plan that a client has asked for."""
        if self._plans is not None:
            self._plans.publish_plan(self.clock.ns(self.clock.now()), path.frame, path.poses)


# --- plans and smoothing on request -----------------------------------------------------------------------------------


class PlanTask(tasks.WorkTask):
    """ComputePathToPose."""

    codes = tasks.PLANNER
    copy: PlannerCopy
    navigator: Navigator

    def goals(self) -> list[Any]:
        """Return the poses to plan to, in order."""
        return [self.goal.goal]

    def begin(self, now: float) -> None:
        """Check the names, and hand the work over."""
        planner = self.navigator.configuration.global_planner
        known = ("", planner.namespace or planner.name, planner.name, "GridBased")
        if str(self.goal.planner_id) not in known:
            text = f'there is no planner "{self.goal.planner_id}"; there is {known[1]}'
            raise tasks.InvalidChoiceError(text, code=self.codes.first + 1)
        super().begin(now)

    def work(self) -> Path:
        """Plan from pose to pose."""
        goals = self.goals()
        if not goals:
            raise tasks.InvalidChoiceError("the list of goals is empty; give at least one", code=self.codes.first + 9)
        model, costmap, footprint = self.copy.snapshot()
        start = self._pose(self.goal.start, costmap.frame) if self.goal.use_start else self._robot()
        poses = [start, *(self._pose(goal, costmap.frame) for goal in goals)]
        legs = [self.copy.plan(model, costmap, footprint, a, b).path.poses for a, b in itertools.pairwise(poses)]
        return Path(np.concatenate(legs), costmap.frame)

    def update(self, now: float) -> tasks.Outcome | None:
        """Return the end; publish the plan."""
        outcome = super().update(now)
        if outcome is not None and self.found is not None:
            self.navigator.plan_publisher(self.found)
        return outcome

    def _robot(self) -> Pose2D:
        navigator = self.navigator

        def pose() -> Pose2D:
            return self.move_base.global_costmap.robot_pose(navigator.clock.now())

        return navigator.inbox.call(pose)

    def _pose(self, message: Any, frame: str) -> Pose2D:
        given, navigator = msg.frame_of(message), self.navigator
        pose = msg.pose_of(message.pose)
        if given in ("", frame):
            return pose

        def lookup() -> Transform2D:
            return navigator.robot.frames.lookup(frame, given)

        return navigator.inbox.call(lookup).apply(pose)


class PlanThroughTask(PlanTask):
    """ComputePathThroughPoses."""

    codes = tasks.PLANNER_THROUGH

    def goals(self) -> list[Any]:
        """Return the poses: a list, or nav_msgs/Goals."""
        return list(getattr(self.goal.goals, "goals", self.goal.goals))


class SmoothTask(tasks.WorkTask):
    """SmoothPath."""

    codes = tasks.SMOOTHER
    copy: PlannerCopy
    navigator: Navigator

    def work(self) -> Path:
        """Smooth the path by a smoother of the parameters, or by one of another name."""
        path = tasks.path_of(self.goal.path)
        if not len(path):
            raise tasks.InvalidChoiceError("the path to smooth is empty", code=self.codes.first + 5)
        smoother = self._smoother(str(self.goal.smoother_id))
        _, costmap, footprint = self.copy.snapshot()
        if path.frame not in ("", costmap.frame):
            path = Path(self._between(costmap.frame, path.frame).apply_poses(path.poses), costmap.frame)
        found = smoother.smooth(path, costmap, footprint=footprint)
        hit = self.navigator.inbox.call(lambda: self._collision(found)) if self.goal.check_for_collisions else None
        if hit is not None:
            text = f"the smoothed path collides at ({hit.x:.2f}, {hit.y:.2f}, {hit.yaw:.2f})"
            raise tasks.InvalidChoiceError(text, code=self.codes.first + 3)
        return found

    def _collision(self, path: Path) -> Pose2D | None:
        """Return the first pose at which the footprint hits an obstacle, or that is outside; in the thread of the node."""
        for pose in (Pose2D(*row) for row in path.poses.tolist()):
            cost = pose_cost(self.move_base.global_costmap, pose, use_footprint=True)
            if cost is None or LETHAL <= cost < UNKNOWN:
                return pose
        return None

    def _smoother(self, name: str) -> Smoother:
        """Return a new smoother, for this thread: one of smoother_plugins, that of the planner, or one by its plugin."""
        configured = self.navigator.configuration.smoothers
        planner = self.move_base.global_planner
        own = planner.smoother if isinstance(planner, SmoothedPlanner) else None
        for choice in configured:
            if name == choice.name or (not name and own is None):
                return choice.cls(choice.params)
        if own is not None and name in ("", "simple_smoother"):
            return type(own)(own.params)
        try:
            cls = SMOOTHERS.get(name if name not in ("", "simple_smoother") else "simple").cls
        except InputError as exc:
            known = ", ".join(choice.name for choice in configured)
            text = f"{exc.message}; smoother_plugins has {known}" if known else exc.message
            raise tasks.InvalidChoiceError(text, code=self.codes.first + 1) from exc
        return cls(cls.Params())

    def _between(self, to: str, frame: str) -> Transform2D:
        return self.navigator.inbox.call(lambda: self.navigator.robot.frames.lookup(to, frame))
