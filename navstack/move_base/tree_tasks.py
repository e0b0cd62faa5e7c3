"""Servers of behavior trees that do not move the robot: the smoother server, and the two of the route server.

Error codes are those of nav2_msgs. Source of the rules: nav2_smoother (nav2_smoother.cpp), nav2_route (route_server.cpp,
route_tracker.cpp, goal_intent_extractor.cpp).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from navstack.behavior_trees import StampedPose
from navstack.core import FrameError, NavError, Path, Pose2D, Transform2D, UnknownPluginError
from navstack.global_planner import smooth_path
from navstack.move_base.costmaps import transform_tolerance
from navstack.move_base.plugin_calls import call, checked_pose, lookup_transform
from navstack.move_base.tree_servers import LETHAL_COST, UNKNOWN_COST, TaskServer, pose_cost
from navstack.plugins import SMOOTHERS, CostmapServer, LocalPlanner, Robot, Smoother

if TYPE_CHECKING:  # slow imports, for trees that ask for routes
    from navstack.routes import PlannedRoute, RoutePlanner, TrackedRoute
T = TypeVar("T")


class _Frames:
    """Where the robot is, in the frame that a server works in."""

    def __init__(self, robot: Robot, costmap: CostmapServer) -> None:
        self.robot, self.costmap = robot, costmap

    def between(self, target: str, source: str, now: float) -> Transform2D:
        """Return the transform between two frames. Raises FrameError."""
        return lookup_transform(self.robot, target, source, now, transform_tolerance(self.costmap))

    def pose(self, pose: StampedPose, frame: str, now: float) -> Pose2D:
        """Return a pose in a frame. Raises FrameError."""
        return pose.pose if pose.frame in ("", frame) else self.between(frame, pose.frame, now).apply(pose.pose)

    def robot_pose(self, frame: str, now: float) -> Pose2D:
        """Return the pose of the robot in a frame. Raises FrameError."""
        found = call(self.costmap, self.costmap.robot_pose, now, check=checked_pose)
        return found if self.costmap.frame == frame else self.between(frame, self.costmap.frame, now).apply(found)


# ----------------------------------------------------------------------------------------------------------------------
# smooth_path.


class InvalidSmootherError(NavError):
    """SmoothPath names a smoother that is not there."""

    code = 501
    name = "INVALID_SMOOTHER"


class SmoothedPathInCollisionError(NavError):
    """SmoothPath with `check_for_collisions` made a path on which the robot collides."""

    code = 503
    name = "SMOOTHED_PATH_IN_COLLISION"


class NoPathToSmoothError(NavError):
    """SmoothPath got no path."""

    code = 505
    name = "INVALID_PATH"


class SmootherServer:
    """The server `smooth_path`: smoothers by their ids, on the global costmap.

    # Nav2 differs: there, a smoother that ends early fails or returns what it has (FAILED_TO_SMOOTH_PATH, TIMEOUT,
    was_completed). Here, pieces of the path that it cannot make better stay as they are.
    """

    first_code = 500

    def __init__(self, robot: Robot, costmap: CostmapServer, smoothers: Mapping[str, Smoother]) -> None:
        self._frames, self._smoothers = _Frames(robot, costmap), dict(smoothers)

    def _smoother(self, id_: str) -> Smoother:
        """Return a smoother by its id, the only one for none; one that is not configured has its defaults."""
        known = self._smoothers
        if not id_ and len(known) <= 1:
            id_ = next(iter(known), "simple_smoother")
        if id_ not in known:
            try:
                cls = SMOOTHERS.get(id_).cls
            except UnknownPluginError:
                names = ", ".join(known) or ", ".join(entry.name for entry in SMOOTHERS)
                text = f'the tree asks for the smoother "{id_}", but smoother_server has {names}; add it to smoother_plugins'
                raise InvalidSmootherError(text, smoother=id_) from None
            known[id_] = cls(cls.Params())
        return known[id_]

    def prepare(self) -> None:
        """Do nothing: a tree may choose its smoother while it runs."""

    def start(self, goal: Mapping[str, object], now: float) -> Mapping[str, object]:
        """Return the smoothed path. Raises NavError."""
        costmap, path = self._frames.costmap, goal.get("unsmoothed_path")
        smoother = self._smoother(str(goal.get("smoother_id") or ""))
        if not isinstance(path, Path) or not len(path):
            raise NoPathToSmoothError("the tree asks to smooth an empty path; write the entry of unsmoothed_path first")
        if path.frame != costmap.frame:
            path = Path(self._frames.between(costmap.frame, path.frame, now).apply_poses(path.poses), costmap.frame)
        found = call(smoother, lambda: smooth_path(smoother, path, costmap.master, costmap.footprint))
        if goal.get("check_for_collisions", False):
            self._check(found)
        return {"smoothed_path": found, "smoothing_duration": 0.0, "was_completed": True}

    def _check(self, path: Path) -> None:
        for row in path.poses:
            pose = Pose2D(*map(float, row))
            cost = pose_cost(self._frames.costmap, pose, use_footprint=True)
            if cost is None or LETHAL_COST <= cost < UNKNOWN_COST:
                text = f"the smoothed path collides at ({pose.x:.2f}, {pose.y:.2f}, {pose.yaw:.2f})"
                raise SmoothedPathInCollisionError(text, pose=pose)

    def update(self, now: float) -> Mapping[str, object]:
        """Do nothing: a goal ends with its start."""
        del now
        return {}

    def feedback(self) -> Mapping[str, object]:
        """Return nothing."""
        return {}

    def stop(self) -> None:
        """Do nothing."""


# ----------------------------------------------------------------------------------------------------------------------
# compute_route and compute_and_track_route.


@dataclass(frozen=True, slots=True)
class TreeRoute:
    """A route on the blackboard of a tree."""

    planned: PlannedRoute
    nodes: tuple[tuple[float, float], ...]
    """x and y (m) of its nodes, in order."""


class RouteGraphServer:
    """What the two servers of routes share: the graph, its planner, and the ends of a goal."""

    def __init__(self, robot: Robot, costmap: CostmapServer, parameters: Mapping[str, Any]) -> None:
        """`parameters` of Nav2's route_server; a relative `graph_filepath` is relative to the working directory."""
        self._frames, self._parameters = _Frames(robot, costmap), parameters

    @property
    def has_file(self) -> bool:
        """True if a graph is named, by the parameters or by `use_graph`."""
        return "planner" in self.__dict__ or bool(self._parameters.get("graph_filepath"))

    @cached_property
    def planner(self) -> RoutePlanner:
        """The planner, made with the first goal. Raises RouteError for the graph, ParameterError."""
        from navstack.routes import InvalidGraphError

        file = str(self._parameters.get("graph_filepath") or "")
        if not file:
            raise InvalidGraphError(
                "a route is asked for, but there is no graph; write graph_filepath: FILE.geojson in route_server, or give it "
                "with --set route_server/graph_filepath=FILE.geojson"
            )
        return self._planner_of(file)

    def use_graph(self, file: str) -> None:
        """Use another graph (Nav2's service set_route_graph). Raises RouteError for the file, and the graph remains."""
        self.planner = self._planner_of(file)

    def _planner_of(self, file: str) -> RoutePlanner:
        from navstack.routes import RoutePlanner, load_graph, read_scorers

        return RoutePlanner(load_graph(FilePath(file).expanduser()), *read_scorers(self._parameters))

    def prepare(self) -> None:
        """Read everything. Raises RouteError, ParameterError."""
        from navstack.routes import read_operations

        _ = self.planner
        read_operations(self._parameters)

    def track(self, planned: PlannedRoute) -> TrackedRoute:
        """Return a route to track, with new operations. Raises ParameterError."""
        from navstack.routes import TrackedRoute, read_operations

        return TrackedRoute(self.planner, planned, read_operations(self._parameters))

    def robot_pose(self, now: float) -> Pose2D:
        """Return the pose of the robot in the frame of the graph. Raises RouteFrameError."""
        return self._in_frames(lambda: self._frames.robot_pose(self.planner.graph.frame, now))

    def transform_to(self, frame: str, now: float) -> Transform2D:
        """Return the transform from the frame of the graph. Raises RouteFrameError."""
        return self._in_frames(lambda: self._frames.between(frame, self.planner.graph.frame, now))

    @staticmethod
    def _in_frames(find: Callable[[], T]) -> T:
        from navstack.routes import RouteFrameError

        try:
            return find()
        except FrameError as exc:
            raise RouteFrameError(f"a route is asked for: {exc.message}", **exc.data) from exc

    def see(self) -> None:
        """Let the planner read the costmap, if it has the frame of the graph."""
        costmap = self._frames.costmap
        self.planner.costmap = costmap.master if costmap.frame == self.planner.graph.frame else None

    def plan(self, goal: Mapping[str, object], now: float) -> PlannedRoute:
        """Return the route of a goal: between nodes, or with `use_poses` from the robot, or `start`, to `goal`."""
        from navstack.routes import NoValidRouteError

        planner = self.planner
        self.see()
        if not goal.get("use_poses", False):
            ends = goal.get("start_id"), goal.get("goal_id")
            if not isinstance(ends[0], int) or not isinstance(ends[1], int):
                raise NoValidRouteError(
                    'the tree asks for a route without its ends; write start_id and goal_id, or use_poses="true" and goal'
                )
            return planner.plan(ends[0], ends[1])
        start, end = goal.get("start"), goal.get("goal")
        if not isinstance(end, StampedPose):
            raise NoValidRouteError("the tree asks for a route to no pose; write the entry of goal first")
        frame = planner.graph.frame
        begin = self.robot_pose(now)
        if goal.get("use_start", False) and isinstance(start, StampedPose):
            begin = self._in_frames(lambda: self._frames.pose(start, frame, now))
        return planner.plan(begin, self._in_frames(lambda: self._frames.pose(end, frame, now)))


def _values(planned: PlannedRoute) -> dict[str, object]:
    graph = planned.route.graph
    nodes = graph.xy[list(planned.route.nodes)].astype(np.float64).tolist()
    return {"route": TreeRoute(planned, tuple((x, y) for x, y in nodes)), "path": planned.path}


class RouteServer:
    """The server `compute_route`."""

    first_code = 400

    def __init__(self, graph: RouteGraphServer) -> None:
        self.graph = graph

    def prepare(self) -> None:
        """Read graph, edge scorers and operations. Raises RouteError, ParameterError."""
        self.graph.prepare()

    def start(self, goal: Mapping[str, object], now: float) -> Mapping[str, object]:
        """Return the route and its path. Raises NavError."""
        return {**_values(self.graph.plan(goal, now)), "planning_time": 0.0}

    def update(self, now: float) -> Mapping[str, object]:
        """Do nothing: a goal ends with its start."""
        del now
        return {}

    def feedback(self) -> Mapping[str, object]:
        """Return nothing."""
        return {}

    def stop(self) -> None:
        """Do nothing."""


class RouteTrackingServer:
    """The server `compute_and_track_route`: a route, the progress of the robot on it, its operations, and other routes."""

    first_code = 400

    def __init__(
        self, graph: RouteGraphServer, local_costmap: CostmapServer, local_planner: Callable[[], LocalPlanner]
    ) -> None:
        """`local_planner` returns the one in use, whose speed operations limit."""
        self._graph, self._local_costmap, self._local_planner = graph, local_costmap, local_planner
        self._tracked: TrackedRoute | None = None
        self._limited = local_planner()
        self._seen = 0
        self._begun = 0.0

    def prepare(self) -> None:
        """Read graph, edge scorers and operations. Raises RouteError, ParameterError."""
        self._graph.prepare()

    def start(self, goal: Mapping[str, object], now: float) -> None:
        """Plan the route. Raises NavError."""
        self.stop()
        tracked = self._graph.track(self._graph.plan(goal, now))
        self._limited = self._local_planner()
        tracked.begin(self._limited, now)
        self._tracked, self._seen, self._begun = tracked, 0, now

    def update(self, now: float) -> Mapping[str, object] | None:
        """Track the robot; plan another route if an operation wants one. Raises NavError."""
        tracked, costmap = self._tracked, self._local_costmap
        assert tracked is not None
        self._seen = tracked.rerouted
        self._graph.see()
        pose, to_costmap = self._graph.robot_pose(now), self._graph.transform_to(costmap.frame, now)
        if not tracked.update(pose, now, self._limited, costmap.master, to_costmap):
            return None
        return {"execution_duration": now - self._begun}

    def feedback(self) -> Mapping[str, object]:
        """Return the ids of last node, next node and edge (0 without one, as in Nav2), route and path."""
        tracked = self._tracked
        if tracked is None:
            return {}
        found = tracked.feedback()
        return {
            "last_node_id": found.last_node_id or 0,
            "next_node_id": found.next_node_id or 0,
            "current_edge_id": found.current_edge_id or 0,
            "operations_triggered": found.operations_triggered,
            "rerouted": found.rerouted > self._seen,
            **_values(tracked.planned),
        }

    def stop(self) -> None:
        """Undo what the operations did."""
        if self._tracked is not None:
            self._tracked.end(self._limited)
            self._tracked = None


def path_servers(
    robot: Robot,
    costmaps: tuple[CostmapServer, CostmapServer],
    local_planner: Callable[[], LocalPlanner],
    smoothers: Mapping[str, Smoother],
    routes: Mapping[str, Any],
) -> dict[str, TaskServer]:
    """Return the servers of smoothing and of routes by name.

    `costmaps`: the global one, the local one. `smoothers` by their ids; `routes`: parameters of Nav2's route_server.
    """
    global_costmap, local_costmap = costmaps
    graph = RouteGraphServer(robot, global_costmap, routes)
    return {
        "smooth_path": SmootherServer(robot, global_costmap, smoothers),
        "compute_route": RouteServer(graph),
        "compute_and_track_route": RouteTrackingServer(graph, local_costmap, local_planner),
    }
