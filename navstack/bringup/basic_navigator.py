"""`BasicNavigator`: names and semantics of nav2_simple_commander (robot_navigator.py), on a `MoveBase`."""

from __future__ import annotations

import itertools
import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NoReturn

import numpy as np

from navstack.behaviors import (
    NO_EXECUTOR,
    BackUp,
    BackUpParams,
    BehaviorRunner,
    DriveOnHeading,
    DriveOnHeadingParams,
    NoWaypointsError,
    Spin,
    SpinParams,
    WaypointExecutor,
    WaypointReport,
)
from navstack.bringup.build import build_move_base, simulated_robot
from navstack.bringup.pose_sequence import NO_ERROR, PASSED_RADIUS_M, PoseSequence, TargetPose, TaskResult
from navstack.core import (
    Bounds,
    Costmap,
    InputError,
    InvalidPathError,
    Listener,
    NavError,
    NotSupportedError,
    OccupancyGrid,
    Path,
    Pose2D,
    RobotState,
    Twist2D,
)
from navstack.costmap import LayeredCostmap
from navstack.coverage import CoverageDrive, CoveragePlan, Field, field_of_corners, plan_coverage, read_params
from navstack.docking import Dock, DockDatabase, Docking, DockingFeedback, DockTask, Undocking
from navstack.map_io import load_map
from navstack.move_base import (
    EPSILON_S,
    BusyError,
    GoalCanceledError,
    GoalStatus,
    MoveBase,
    NoProgressError,
    OscillationChecker,
    Progress,
    Schedule,
    SpeedLimiter,
    TreeMoveBase,
    call,
    checked_flag,
    checked_local_plan,
    checked_pose,
    stale_sensors,
)
from navstack.parameters import Configuration, DockingParams
from navstack.plugins import (
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    ControlInput,
    CostmapServer,
    Plan,
)
from navstack.routes import (
    FollowRoute,
    PlannedRoute,
    RouteFeedback,
    RouteGraph,
    RouteOperation,
    RoutePlanner,
    load_graph,
    read_operations,
    read_scorers,
)

_LOG = logging.getLogger("navstack.basic_navigator")

POLL_S: Final = 0.1
"""Time that `isTaskComplete` advances (s), as in Nav2."""


@dataclass(frozen=True, slots=True)
class TaskFeedback:
    """Progress of a task."""

    current_pose: Pose2D | None
    """In the global costmap's frame; None if unknown."""
    distance_remaining: float
    """m along the plan, then straight from pose to pose; for a behavior its remaining distance or angle (m, rad)."""
    navigation_time: float
    """s since the task started."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None if that is unknown."""
    number_of_recoveries: int
    number_of_poses_remaining: int
    """Including the current one."""
    current_waypoint: int
    """Index of the current pose."""


class FollowPath(Behavior):
    """Follows `path` to its last pose.

    Fails with the error of the local planner after `controller_patience` without a command, and with NoProgressError after
    `oscillation_timeout` without a motion of `oscillation_distance`.
    """

    def __init__(self, move_base: MoveBase, path: Path) -> None:
        """Raises InvalidPathError for a path that is empty or not finite."""
        super().__init__("follow_path", None)
        if not len(path) or not np.isfinite(path.poses).all():
            raise InvalidPathError("the path to follow needs at least one pose, and finite ones")
        self._move_base = move_base
        self._plan = Plan(path, 0.0, path[-1])
        self._limiter = SpeedLimiter((move_base.local_costmap, move_base.global_costmap), move_base.local_planner)
        self._progress = OscillationChecker(move_base.params.oscillation_distance)
        self._last_command = 0.0
        self._last_progress = 0.0

    def start(self, context: BehaviorContext, now: float) -> None:
        """Pass the path to the local planner. Raises its error if it rejects the path."""
        planner = context.local_planner
        call(planner, planner.reset)
        call(planner, planner.set_plan, self._plan.path, self._plan.goal)
        self._last_command = self._last_progress = now

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Return the command of the local planner. Raises a ControlError, or FrameError for an unknown frame of the path."""
        params = self._move_base.params
        planner = self._move_base.local_planner
        inputs = self._move_base.control_input(self._plan, now)
        data = {"left_m": self._remaining(inputs)}
        if call(planner, planner.goal_reached, inputs, check=checked_flag):
            return BehaviorStep(BehaviorStatus.DONE, data=data)
        if self._progress.update(state.pose) is not Progress.NONE:
            self._last_progress = now
        elif 0.0 < params.oscillation_timeout <= now - self._last_progress + EPSILON_S:
            distance, timeout = params.oscillation_distance, params.oscillation_timeout
            raise NoProgressError(f"the robot moved less than {distance:g} m in {timeout:g} s", pose=state.pose)
        try:
            self._limiter.external = self._move_base.speed_limit
            if self._limiter.is_needed:
                self._limiter.apply(now, slowed=False)
            command = call(planner, planner.compute_command, inputs, check=checked_local_plan).command
        except NavError:
            if now - self._last_command >= params.controller_patience - EPSILON_S:
                raise
            return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(), data=data)
        self._last_command = now
        return BehaviorStep(BehaviorStatus.RUNNING, command, data=data)

    def _remaining(self, inputs: ControlInput) -> float:
        """Length of the path from its point nearest to the robot (m)."""
        points = inputs.plan_to_costmap.apply_poses(self._plan.path.poses)[:, :2]
        nearest = int(np.hypot(*(points - inputs.state.pose[:2]).T).argmin())
        return float(np.hypot(*np.diff(points[nearest:], axis=0).T).sum())


def not_supported(name: str, alternative: str) -> NoReturn:
    """Raise NotSupportedError: navstack has no part that could do what `name` does."""
    raise NotSupportedError(f"{name} is not supported: {alternative}", method=name)


class NavigatorServices(ABC):
    """Everything of the simple commander that is no task."""

    move_base: MoveBase
    _now: float
    _error: tuple[int, str]
    _router: RoutePlanner | None
    _route_operations: list[RouteOperation]
    _place: Callable[[Pose2D], None] | None
    """Initializes the localization, if it can be initialized."""

    @abstractmethod
    def cancelTask(self) -> None:
        """Cancel the current task and wait for its end."""

    @abstractmethod
    def _tick(self, end: float) -> None:
        """Advance to the next due time, at most to `end` (s)."""

    # --- plans --------------------------------------------------------------------------------------------------------

    def getPath(self, start: Pose2D, goal: Pose2D, planner_id: str = "", use_start: bool = False) -> Path | None:
        """Plan without driving, from the robot unless `use_start`; None without a plan, with the reason in `getTaskError`."""
        if planner_id:
            not_supported(
                f'planner_id "{planner_id}"', "there is one global planner; choose it with base_global_planner"
            )
        self._error = NO_ERROR
        try:
            return self.move_base.make_plan(goal, start if use_start else None).path
        except NavError as exc:
            self._error = (exc.code, exc.message)
            return None

    def getPathThroughPoses(
        self, start: Pose2D, goals: Sequence[Pose2D], planner_id: str = "", use_start: bool = False
    ) -> Path | None:
        """Plan through all `goals` in order; None if a leg has no plan, with the reason in `getTaskError`."""
        if not goals:
            raise InputError("the list of goals is empty; give at least one")
        legs = [self.getPath(start, goals[0], planner_id, use_start)]
        for a, b in itertools.pairwise(goals):
            if legs[-1] is None:
                break
            legs.append(self.getPath(a, b, planner_id, True))
        found = [leg for leg in legs if leg is not None]
        return Path(np.concatenate([leg.poses for leg in found]), found[0].frame) if len(found) == len(legs) else None

    def getTaskError(self) -> tuple[int, str]:
        """Return code and reason of the last task's failure; (0, "") without a failure."""
        return self._error

    def setTaskError(self, error_code: int, error_msg: str) -> None:
        """Replace code and reason of the last task's failure."""
        self._error = (error_code, error_msg)

    def clearTaskError(self) -> None:
        """Clear the failure of the last task."""
        self._error = NO_ERROR

    # --- maps and poses -----------------------------------------------------------------------------------------------

    def changeMap(self, map_filepath: str | os.PathLike[str] | OccupancyGrid) -> bool:
        """Replace the static map of both costmaps; False if no layer accepts it. Raises MapError for an unreadable file."""
        grid = map_filepath if isinstance(map_filepath, OccupancyGrid) else load_map(os.fspath(map_filepath))
        costmaps = (self.move_base.global_costmap, self.move_base.local_costmap)
        taken = [isinstance(c, LayeredCostmap) and c.set_static_map(grid) for c in costmaps]
        self.move_base.costmaps_changed()
        return any(taken)

    def setInitialPose(self, initial_pose: Pose2D) -> None:
        """Set the robot's pose (global frame).

        A simulated robot is put there, if no time has passed since its start. Otherwise the localization is initialized by the
        function `place` of the constructor. Without it, the pose must be where the robot is localized, to PASSED_RADIUS_M.
        Raises InputError if it is not, and the errors of `navstack.simulated_robot`.
        """
        if self._place is not None:
            self._place(initial_pose)
            return
        self.waitUntilNav2Active()
        away = self.move_base.global_costmap.robot_pose(self._now).distance_to(initial_pose)
        if away > PASSED_RADIUS_M:
            raise InputError(
                f"the initial pose ({initial_pose.x:g}, {initial_pose.y:g}) is {away:.2f} m from where the robot is localized; "
                "set the pose of a simulated robot before it drives, and give BasicNavigator(place=..) a function that "
                "initializes the localization of your robot",
                distance_m=away,
            )

    # --- costmaps -----------------------------------------------------------------------------------------------------

    def clearAllCostmaps(self) -> None:
        """Reset every layer of both costmaps."""
        self.move_base.clear_costmaps()

    def clearLocalCostmap(self) -> None:
        """Reset every layer of the local costmap."""
        self.move_base.local_costmap.reset()

    def clearGlobalCostmap(self) -> None:
        """Reset every layer of the global costmap."""
        self.move_base.global_costmap.reset()

    def clearCostmapAroundRobot(self, reset_distance: float) -> None:
        """Clear the observations of both costmaps in a square of side `reset_distance` (m) around the robot."""
        for costmap in self._costmaps:
            self._clear(costmap, costmap.robot_pose(self._now), reset_distance)

    def clearCostmapExceptRegion(self, reset_distance: float) -> None:
        """Clear the observations of both costmaps outside a square of side `reset_distance` (m) around the robot."""
        for costmap in self._costmaps:
            self._clear(costmap, costmap.robot_pose(self._now), reset_distance, invert=True)

    def clearLocalCostmapAroundPose(self, pose: Pose2D, reset_distance: float) -> None:
        """Clear the local costmap's observations in a square of side `reset_distance` (m) around `pose`, in its frame."""
        self._clear(self.move_base.local_costmap, pose, reset_distance)

    def clearGlobalCostmapAroundPose(self, pose: Pose2D, reset_distance: float) -> None:
        """Clear the global costmap's observations in a square of side `reset_distance` (m) around `pose`, in its frame."""
        self._clear(self.move_base.global_costmap, pose, reset_distance)

    def getGlobalCostmap(self) -> Costmap:
        """Return the global master grid, which later updates change; copy it to keep it."""
        return self.move_base.global_costmap.master

    def getLocalCostmap(self) -> Costmap:
        """Return the local master grid, which later updates change; copy it to keep it."""
        return self.move_base.local_costmap.master

    @property
    def _costmaps(self) -> tuple[CostmapServer, CostmapServer]:
        return self.move_base.local_costmap, self.move_base.global_costmap

    def _clear(self, costmap: CostmapServer, pose: Pose2D, side: float, *, invert: bool = False) -> None:
        """Clear inside the square, or outside with `invert`; the master grid follows at its next update."""
        if not side >= 0.0:
            raise InputError(f"reset_distance must be 0 m or more, not {side}", reset_distance=side)
        square = Bounds(pose.x, pose.y, pose.x, pose.y).grown(0.5 * side)
        for layer in costmap.layers:
            call(layer, lambda layer=layer: layer.reset(square, invert=invert))

    # --- routes ---------------------------------------------------------------------------------------------------------

    def setRouteGraph(
        self,
        graph_filepath: str | os.PathLike[str] | RouteGraph,
        parameters: Mapping[str, Any] | None = None,
        operations: Sequence[RouteOperation] | None = None,
    ) -> bool:
        """Use this route graph (Nav2's service set_route_graph), with parameters of Nav2's route_server.

        `operations` replace those of the parameters, such as a TriggerEvent with your functions. Raises InvalidGraphError for the
        file, ParameterError.
        """
        graph = graph_filepath if isinstance(graph_filepath, RouteGraph) else load_graph(graph_filepath)
        params, scorers = read_scorers(parameters or {})
        self._route_operations = read_operations(parameters or {}) if operations is None else list(operations)
        self._router = RoutePlanner(graph, params, scorers)
        return True

    @property
    def router(self) -> RoutePlanner:
        """The planner of routes, whose `dynamic_edges` close and open edges. Raises InputError before `setRouteGraph`."""
        if self._router is None:
            raise InputError("there is no route graph yet; call setRouteGraph with a GeoJSON file first")
        return self._router

    def getRoute(
        self, start: Pose2D | int, goal: Pose2D | int, use_start: bool = False
    ) -> tuple[Path, PlannedRoute] | None:
        """Return path and route between poses or node ids, from the robot's pose unless `use_start`, or `start` is an id.

        None without a route, with code (400 to 407) and reason in `getTaskError`.
        """
        self._error = NO_ERROR
        costmap = self.move_base.global_costmap
        try:
            self.router.costmap = costmap.master
            begin = start if use_start or isinstance(start, int) else costmap.robot_pose(self._now)
            found = self.router.plan(begin, goal)
        except NavError as exc:
            if self._router is None:
                raise
            self._error = (exc.code, exc.message)
            return None
        return found.path, found

    # --- life cycle and log -------------------------------------------------------------------------------------------

    def waitUntilNav2Active(self, navigator: str = "bt_navigator", localizer: str = "amcl") -> None:
        """Update both costmaps once, so that plans can be requested. The names of Nav2's nodes have no effect."""
        del navigator, localizer
        self._tick(self._now)

    def lifecycleStartup(self) -> None:  # noqa: B027
        """Do nothing: every part is active from the start."""

    def lifecycleShutdown(self) -> None:
        """End every task, stop the robot and reject later tasks."""
        self.cancelTask()
        self.move_base.shutdown()

    def destroyNode(self) -> None:
        """End the current task: there is no ROS node to destroy."""
        self.cancelTask()

    def destroy_node(self) -> None:
        """End the current task: there is no ROS node to destroy."""
        self.cancelTask()

    def info(self, msg: str) -> None:
        """Log a message with the logger `navstack.basic_navigator` of Python's `logging`."""
        _LOG.info(msg)

    def warn(self, msg: str) -> None:
        """Log a warning."""
        _LOG.warning(msg)

    def error(self, msg: str) -> None:
        """Log an error."""
        _LOG.error(msg)

    def debug(self, msg: str) -> None:
        """Log a message for debugging."""
        _LOG.debug(msg)

    # --- what navstack cannot do --------------------------------------------------------------------------------------

    def smoothPath(self, path: Path, smoother_id: str = "", *_: Any, **__: Any) -> Path:
        """Return a smoother path over the global costmap; `smoother_id`: simple, savitzky_golay, constrained or another plugin.

        Without one, the smoother of the parameters (`base_smoother`), or simple. The smoother of the parameters keeps its own;
        others have defaults. Raises UnknownPluginError.
        """
        from navstack.global_planner import SmoothedPlanner
        from navstack.plugins import SMOOTHERS

        planner = self.move_base.global_planner
        smoother = planner.smoother if isinstance(planner, SmoothedPlanner) else None
        cls = SMOOTHERS.get(smoother_id or "simple").cls
        if smoother is None or (smoother_id and type(smoother) is not cls):
            smoother = cls(cls.Params())
        costmap = self.move_base.global_costmap
        return smoother.smooth(path, costmap.master, footprint=costmap.footprint)

    def assistedTeleop(self, time_allowance: float = 30.0) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("assistedTeleop", "driveOnHeading, backup and spin check for obstacles while they move")

    def followGpsWaypoints(self, gps_poses: Sequence[Any]) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("followGpsWaypoints", "convert the positions to the map's frame, then followWaypoints")


class BasicNavigator(NavigatorServices):
    """Executes one task at a time: a pose, poses to drive through, waypoints to stop at, a path, a dock, a behavior (spin, ..).

        navigator.goToPose(goal)
        while not navigator.isTaskComplete():
            print(navigator.getFeedback())
        print(navigator.getResult())

    Every `isTaskComplete` advances the robot and the goal manager by `POLL_S`; nothing moves in between.
    """

    def __init__(
        self,
        move_base: MoveBase,
        advance: Callable[[float], float],
        *,
        place: Callable[[Pose2D], None] | None = None,
        docks: DockDatabase | None = None,
    ) -> None:
        """Create a navigator. `advance(t)` runs the robot until `t` (s) and returns the time.

        In a simulation that is `advance_to`; for a real robot it sleeps. It returns at once if `t` is in the past.
        `place` initializes the robot's localization with a pose (global frame), for `setInitialPose`. `docks` are the docks that
        the robot knows (`DockDatabase.of(configuration)`).
        """
        self.move_base = move_base
        self.docks = docks or DockDatabase(DockingParams())
        """The docks that the robot knows."""
        self._task: DockTask | None = None
        self.coverage: CoverageDrive | None = None
        """The last coverage task, with its plan and its figures."""
        self._default_tree = ""
        if isinstance(move_base, TreeMoveBase) and move_base.tree_source is not None:
            self._default_tree = os.fspath(move_base.tree_source)
        self._advance = advance
        self._place = place
        self._now = advance(0.0)
        self._started_at = self._now
        self._drive: PoseSequence | None = None
        """The current or last drive; None for a behavior."""
        self._runner = BehaviorRunner(Schedule, call)
        self._remaining = 0.0
        self._router = None
        self._route_operations = []
        self._result: TaskResult | None = TaskResult.UNKNOWN
        self._error: tuple[int, str] = NO_ERROR

    @classmethod
    def simulated(
        cls,
        configuration: Configuration,
        static_map: OccupancyGrid,
        start: Pose2D,
        *,
        obstacles: Sequence[tuple[float, float, float]] = (),
        seed: int = 0,
        listeners: Sequence[Listener] = (),
    ) -> BasicNavigator:
        """Create a navigator of a simulated robot at `start`. Raises as `navstack.simulated_robot` does."""

        def built(at: Pose2D) -> tuple[MoveBase, Callable[[float], float]]:
            robot = simulated_robot(configuration, static_map, at, obstacles=obstacles, seed=seed)

            def advance(until: float) -> float:
                if until > robot.time:
                    robot.advance_to(until)
                return robot.time

            move_base = build_move_base(
                configuration, robot, static_map=static_map, listeners=listeners, trees_by_goal=True
            )
            return move_base, advance

        navigator = cls(*built(start), docks=DockDatabase.of(configuration))

        def place(pose: Pose2D) -> None:
            if navigator._now > 0.0:
                navigator._place = None
                navigator.setInitialPose(pose)
            elif pose != navigator.move_base.global_costmap.robot_pose():
                navigator.move_base, navigator._advance = built(pose)

        navigator._place = place
        return navigator

    # --- tasks --------------------------------------------------------------------------------------------------------

    def goToPose(self, pose: Pose2D, frame: str | None = None, behavior_tree: str = "") -> bool:
        """Drive to `pose` (default frame: the global costmap's) and end the previous task. Returns True: accepted.

        `behavior_tree`: the file, or the name of a packaged one, of the tree that drives; default: that of the parameters, else
        the states of move_base. Raises BehaviorTreeError, and the previous task goes on; NotSupportedError for a goal manager
        without trees (`build_move_base(.., trees_by_goal=True)`).
        """
        self._choose_tree(behavior_tree)
        return self._drive_to((pose,), frame, through=False, stop_on_failure=True)

    def goThroughPoses(self, poses: Sequence[Pose2D], frame: str | None = None, behavior_tree: str = "") -> bool:
        """Drive to the last pose through the others, which the robot passes within PASSED_RADIUS_M without a stop.

        `behavior_tree`: see `goToPose`.
        """
        if not poses:
            raise InputError("the list of poses is empty; give at least one")
        self._choose_tree(behavior_tree)
        return self._drive_to(tuple(poses), frame, through=True, stop_on_failure=True)

    def followWaypoints(
        self,
        poses: Sequence[Pose2D],
        frame: str | None = None,
        *,
        stop_on_failure: bool = False,
        number_of_loops: int = 0,
        goal_index: int = 0,
        executor: WaypointExecutor | None = None,
    ) -> bool:
        """Drive to every pose in order, stop there, and do a task: `executor`, such as WaitAtWaypoint or any function.

        `number_of_loops` more times, the first time from `goal_index`. A waypoint that cannot be reached, or whose task fails,
        is missed (`missed_waypoints`, `waypoint_report`), or ends the task with `stop_on_failure` (codes 603 and 601). Nav2
        differs: there a task with missed waypoints has SUCCEEDED. Raises NoWaypointsError (602).
        """
        if not poses:
            raise NoWaypointsError("the list of waypoints is empty; give at least one")
        if not 0 <= goal_index < len(poses) or number_of_loops < 0:
            wrong = f"goal_index {goal_index} or number_of_loops {number_of_loops} is wrong"
            raise NoWaypointsError(f"{wrong}: waypoints are 0 to {len(poses) - 1}, loops 0 or more")
        self._choose_tree()
        return self._drive_to(
            tuple(poses),
            frame,
            through=False,
            stop_on_failure=stop_on_failure,
            first=goal_index,
            loops=number_of_loops,
            executor=executor or NO_EXECUTOR,
        )

    def getAndTrackRoute(self, start: Pose2D | int, goal: Pose2D | int, use_start: bool = False) -> bool:
        """Drive along a route on the graph of `setRouteGraph`; `getRouteFeedback` has nodes and edges. Arguments of `getRoute`.

        ROS differs: Nav2 only tracks, and a client follows the path; here the task drives, and plans another route when the way
        is blocked. Fails with the codes 400 to 407.
        """
        begin = start if use_start or isinstance(start, int) else None
        drive = FollowRoute(self.router, goal, start=begin, operations=self._route_operations)
        return self._run_behavior(drive)

    followRoute = getAndTrackRoute

    def getRouteFeedback(self) -> RouteFeedback | None:
        """Return the progress on the route; None without one."""
        running = self._runner.running
        return running.feedback() if isinstance(running, FollowRoute) else None

    def adjustEdges(
        self, closed: Sequence[int] = (), opened: Sequence[int] = (), costs: Mapping[int, float] | None = None
    ) -> None:
        """Close, open or weight edges (ids) of the route graph; a route that is being driven is planned again if need be.

        Raises InvalidGraphError for an edge that is not there, InputError for a cost below 0.
        """
        running = self._runner.running
        if isinstance(running, FollowRoute):
            running.adjust_edges(closed, opened, costs)
            return
        for edge in (*closed, *opened, *(costs or {})):
            self.router.graph.edge(edge)
        self.router.dynamic_edges.adjust(closed, opened, costs)

    def followPath(self, path: Path, controller_id: str = "", goal_checker_id: str = "") -> bool:
        """Follow `path` with the local planner, without the global planner and without recoveries, to its last pose.

        Fails after `controller_patience` without a command and after `oscillation_timeout` without progress. Raises
        InvalidPathError for a path that is empty or not finite.
        """
        if controller_id or goal_checker_id:
            not_supported(
                "controller_id or goal_checker_id",
                "there is one local planner with one goal checker; choose it with base_local_planner",
            )
        return self._run_behavior(FollowPath(self.move_base, path))

    def navigateCoverage(self, field: Sequence[Any] | None = None, **modes: Any) -> bool:
        """Drive a tool over all of `field`, or of what can be reached; the name is that of opennav_coverage's demo.

        `field`: corners (x, y) (m, frame of the global costmap), or polygons: the border, then holes. `modes`: fields of
        ComputeCoveragePath by their names, such as `operation_width=0.3`. The task has its figures in `coverage`. Raises
        InvalidCoverageRequestError and InvalidModeError.
        """
        self.coverage = CoverageDrive(read_params(modes), field=_field(field), name="navigate_coverage")
        return self._run_behavior(self.coverage)

    def getCoveragePath(self, field: Sequence[Any] | None = None, **modes: Any) -> CoveragePlan | None:
        """Plan what `navigateCoverage` drives; None without a plan, with the reason in `getTaskError`."""
        costmap = self.move_base.global_costmap
        self._error = NO_ERROR
        self._tick(self._now)
        try:
            pose = costmap.robot_pose(self._now)
            return plan_coverage(costmap.master, costmap.footprint, pose, read_params(modes), polygon=_field(field))
        except NavError as exc:
            self._error = (exc.code, exc.message)
            return None

    def spin(
        self, spin_dist: float = 1.57, time_allowance: float = 10.0, disable_collision_checks: bool = False
    ) -> bool:
        """Turn in place by `spin_dist` (rad, clockwise if negative)."""
        params = SpinParams(
            spin_dist=spin_dist, time_allowance=time_allowance, disable_collision_checks=disable_collision_checks
        )
        return self._run_behavior(Spin("spin", params))

    def backup(
        self,
        backup_dist: float = 0.15,
        backup_speed: float = 0.025,
        time_allowance: float = 10.0,
        disable_collision_checks: bool = False,
    ) -> bool:
        """Reverse by `backup_dist` (m) at `backup_speed` (m/s)."""
        params = BackUpParams(
            backup_dist=backup_dist,
            backup_speed=backup_speed,
            time_allowance=time_allowance,
            disable_collision_checks=disable_collision_checks,
        )
        return self._run_behavior(BackUp("backup", params))

    def driveOnHeading(
        self,
        dist: float = 0.15,
        speed: float = 0.025,
        time_allowance: float = 10.0,
        disable_collision_checks: bool = False,
    ) -> bool:
        """Drive straight by `dist` (m, backwards if it and `speed` are negative)."""
        params = DriveOnHeadingParams(
            dist_to_travel=dist,
            speed=speed,
            time_allowance=time_allowance,
            disable_collision_checks=disable_collision_checks,
        )
        return self._run_behavior(DriveOnHeading("drive_on_heading", params))

    # --- docks --------------------------------------------------------------------------------------------------------

    def dockRobotByID(self, dock_id: str, nav_to_dock: bool = True) -> bool:
        """Dock at a dock of the database; without `nav_to_dock`, from where the robot is, near the staging pose.

        Returns True: accepted. Raises DockNotInDatabaseError (901) and DockNotValidError (902).
        """
        return self._run_task(Docking(self.move_base, self.docks, dock_id, navigate_to_staging_pose=nav_to_dock))

    def dockRobotByPose(self, dock_pose: Pose2D, dock_type: str = "", nav_to_dock: bool = True) -> bool:
        """Dock at a dock at `dock_pose` (global frame; the x axis points into the dock), of a type of `dock_plugins`.

        Raises DockNotValidError (902).
        """
        dock = Dock("dock", dock_type, checked_pose(dock_pose), self.move_base.global_costmap.frame)
        return self._run_task(Docking(self.move_base, self.docks, dock, navigate_to_staging_pose=nav_to_dock))

    def undockRobot(self, dock_type: str = "", max_undocking_time: float = 30.0) -> bool:
        """Drive out of the dock; `dock_type`: default that of the nearest dock. Raises DockNotValidError (902)."""
        self.waitUntilNav2Active()
        return self._run_task(Undocking(self.move_base, self.docks, dock_type, max_undocking_time_s=max_undocking_time))

    def cancelTask(self) -> None:
        """Cancel the current task and wait for its end, at most one control cycle."""
        task = self._task
        if task is not None and not task.is_done:
            task.cancel()
            self._end_task(task)
            while self.move_base.goal_handle is not None and not self.move_base.goal_handle.is_done:
                self._tick(self._now + POLL_S)
        elif self._runner.running is not None:
            self._end_behavior(TaskResult.CANCELED, GoalCanceledError("the behavior was canceled"))
        elif self._drive is not None and not self._drive.handle.is_done:
            handle = self._drive.handle
            self._drive.cancel()
            self._result = TaskResult.CANCELED
            while not handle.is_done:
                self._tick(self._now + POLL_S)
            self._error = (handle.result.error_code, handle.result.message)

    # --- progress -----------------------------------------------------------------------------------------------------

    @property
    def missed_waypoints(self) -> list[int]:
        """Indices of the waypoints that the last followWaypoints did not reach."""
        return [] if self._drive is None else [missed.waypoint_index for missed in self._drive.missed]

    @property
    def waypoint_report(self) -> list[WaypointReport]:
        """How the waypoints of the last followWaypoints went, in the order in which they were driven to."""
        return [] if self._drive is None else self._drive.reports

    def isTaskComplete(self) -> bool:
        """Advance by POLL_S or until the task ends; return True after its end, and without a task."""
        end = self._now + POLL_S
        while self._result is None and self._now < end - EPSILON_S:
            self._tick(end)
        return self._result is not None

    def idle(self) -> None:
        """Advance by POLL_S without a task: the robot stands, its costmaps and localization go on."""
        end = self._now + POLL_S
        while self._now < end - EPSILON_S:
            self._tick(end)

    def getFeedback(self) -> TaskFeedback | DockingFeedback | None:
        """Return the progress; None without a task."""
        if self._result is not None:
            return None
        if self._task is not None:
            return self._task.feedback
        spent = self._now - self._started_at
        drive = self._drive
        if drive is None:
            return TaskFeedback(self._robot_pose(), self._remaining, spent, None, 0, 0, 0)
        now, (left, time_left) = self.move_base.feedback, drive.remaining()
        recoveries = drive.past_recoveries + now.recoveries
        return TaskFeedback(now.pose, left, spent, time_left, recoveries, len(drive.targets) - drive.index, drive.index)

    def getResult(self) -> TaskResult:
        """Return the result of the last task; UNKNOWN before its end and before the first task."""
        return self._result or TaskResult.UNKNOWN

    # --- execution ----------------------------------------------------------------------------------------------------

    def _drive_to(
        self,
        poses: tuple[Pose2D, ...],
        frame: str | None,
        *,
        through: bool,
        stop_on_failure: bool,
        first: int = 0,
        loops: int = 0,
        executor: WaypointExecutor = NO_EXECUTOR,
    ) -> bool:
        if self._runner.running is not None or self._task is not None:
            self.cancelTask()
        self._start_task()
        self._drive = PoseSequence(
            self.move_base,
            [TargetPose(pose, frame) for pose in poses],
            through=through,
            stop_on_failure=stop_on_failure,
            first=first,
            loops=loops,
            executor=executor,
            now=self._now,
        )
        return True

    def _choose_tree(self, tree: str = "") -> None:
        """Let a behavior tree drive the next goals; a task that another one drives is canceled."""
        move_base = self.move_base
        if not isinstance(move_base, TreeMoveBase):
            if tree:
                not_supported("behavior_tree", "build the goal manager by build_move_base(.., trees_by_goal=True)")
            return
        try:
            move_base.drive_by(tree or self._default_tree)
        except BusyError:
            self.cancelTask()
            move_base.drive_by(tree or self._default_tree)

    def _robot_pose(self) -> Pose2D | None:
        costmap = self.move_base.global_costmap
        try:
            return call(costmap, costmap.robot_pose, self._now, check=checked_pose)
        except NavError:
            return None

    def _start_task(self) -> None:
        self._started_at = self._now
        self._result = None
        self._error = NO_ERROR

    def _tick(self, end: float) -> None:
        """Advance to the next due time, at most to `end` (s), and execute what is due."""
        due = min(end, self.move_base.next_due(self._now), self._runner.due)
        self._now = self._advance(due)
        self.move_base.tick(self._now)
        if self._task is not None:
            self._task.advance()
            if self._task.is_done:
                self._end_task(self._task)
        elif self._runner.running is not None:
            if self._runner.is_due(self._now):
                self._step()
        elif self._result is None and self._drive is not None:
            self._check_goal()

    def _check_goal(self) -> None:
        """Go on to the next pose, start the task of this one, or note the end."""
        drive = self._drive
        assert drive is not None
        drive.update(self._now)
        if drive.task is not None:
            end = self._runner.start(
                drive.task, self.move_base.recovery_context, self._now, self.move_base.params.controller_frequency
            )
            if end is not None:
                self._end_task_at_waypoint(end.error or NavError(end.text))
        self._note_drive(drive)

    def _note_drive(self, drive: PoseSequence) -> None:
        self._result = drive.result
        if drive.error is not NO_ERROR:
            self._error = drive.error

    def _run_task(self, task: DockTask) -> bool:
        self.cancelTask()
        self._choose_tree()
        self._drive = None
        self._tick(self._now)
        self._start_task()
        self._task = task
        task.start()
        if task.is_done:
            self._end_task(task)
        return True

    def _end_task(self, task: DockTask) -> None:
        result = task.result
        ends = {GoalStatus.SUCCEEDED: TaskResult.SUCCEEDED, GoalStatus.PREEMPTED: TaskResult.CANCELED}
        self._result = ends.get(result.status, TaskResult.FAILED)
        self._error = (result.error_code, result.message)
        self._task = None

    def _run_behavior(self, behavior: Behavior) -> bool:
        self.cancelTask()
        self._choose_tree()
        self._drive = None
        context = self.move_base.recovery_context
        call(behavior, behavior.check, context)
        # update the costmaps, which may be as old as the last task
        self._tick(self._now)
        end = self._runner.start(behavior, context, self._now, context.controller_frequency)
        if end is not None:
            self._runner.drop(self._now)
            raise end.error or NavError(end.text)
        self._start_task()
        return True

    def _step(self) -> None:
        move_base, now = self.move_base, self._now
        costmap, robot = move_base.local_costmap, move_base.robot
        self._runner.advance(now)
        try:
            if not call(costmap, costmap.is_current, now, check=checked_flag):
                raise stale_sensors(costmap, "is stale, so the robot must not move")
        except NavError as exc:
            if self._drive is not None:
                self._end_task_at_waypoint(exc)
            else:
                self._end_behavior(TaskResult.FAILED, exc)
            return
        found = self._runner.step(move_base.local_state, now)
        step = found if isinstance(found, BehaviorStep) else found.step
        if step is not None:
            self._remaining = float(step.data.get("left_m", step.data.get("left_rad", 0.0)))
        if isinstance(found, BehaviorStep):
            call(robot, robot.command, found.twist)
        elif self._drive is not None:
            self._end_task_at_waypoint(found.error)
        elif found.error is None:
            self._end_behavior(TaskResult.SUCCEEDED, None)
        else:
            self._end_behavior(TaskResult.FAILED, found.error)

    def _end_task_at_waypoint(self, error: NavError | None) -> None:
        """Go on after the behavior at a waypoint."""
        self._runner.drop(self._now)
        robot = self.move_base.robot
        call(robot, robot.command, Twist2D())
        drive = self._drive
        assert drive is not None
        drive.end_task(error, self._now)
        self._note_drive(drive)

    def _end_behavior(self, result: TaskResult, error: NavError | None) -> None:
        self._runner.drop(self._now)
        self._result = result
        self._error = NO_ERROR if error is None else (error.code, error.message)
        robot = self.move_base.robot
        call(robot, robot.command, Twist2D())


def _field(corners: Sequence[Any] | None) -> Field | None:
    """Return the field of the corners of a border, or of a border and holes."""
    if corners is None:
        return None
    first = corners[0] if len(corners) else None
    is_ring = isinstance(first, (list, tuple, np.ndarray)) and len(first) > 0 and isinstance(first[0], (int, float))
    return field_of_corners([corners] if is_ring else corners)
