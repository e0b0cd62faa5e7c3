"""Topics of goals, plans and recovery behaviors, and point clouds of what the planners compare."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, Costmap, Event, GridGeometry, Pose2D
from navstack.move_base import MoveBase, ThreadPlanning, TickResult
from navstack.parameters import Configuration
from navstack.plugins import ControlDiagnostics, LocalPlanner, Plan, RecoveryStatus
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import NodeClock


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


# --- point clouds of what the planners compare: trajectories, costs of cells, the potential of the global planner -----


TRAJECTORY: Final = ("x", "y", "z", "theta", "cost")
COSTS: Final = ("x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost")
POTENTIAL: Final = ("x", "y", "z", "pot")
HIGHEST_M: Final = 20.0
"""Height (m) of the potential's cloud at the goal."""
_SEARCHES: Final = ("follow", "escape")
"""Modes in which the local planner compares samples."""


class CloudTopics:
    """Publishes the clouds under the names of DWAPlannerROS, TrajectoryPlannerROS, NavfnROS and GlobalPlanner.

    They are computed only while a node subscribes.
    """

    def __init__(
        self, configuration: Configuration, planning: ThreadPlanning, clock: NodeClock, build: MessageBuilder
    ) -> None:
        rospy = ros.rospy()
        self._planning, self._clock, self._build = planning, clock, build
        cloud = ros.message("sensor_msgs/PointCloud2")
        local, planner = configuration.local_planner, configuration.global_planner
        local_name, global_name = local.namespace or local.name, planner.namespace or planner.name
        has_switches = hasattr(local.params, "publish_traj_pc")
        self._trajectories: Any = (
            rospy.Publisher(f"~{local_name}/trajectory_cloud", cloud, queue_size=1) if has_switches else None
        )
        # trajectory rollout always publishes its costs
        has_costs = has_switches or local.name == "trajectory_rollout"
        self._costs: Any = rospy.Publisher(f"~{local_name}/cost_cloud", cloud, queue_size=1) if has_costs else None
        self._potential: Any = None
        self._is_grid = hasattr(planner.params, "publish_potential")
        if self._is_grid or hasattr(planner.params, "visualize_potential"):
            kind = ros.message("nav_msgs/OccupancyGrid") if self._is_grid else cloud
            self._potential = rospy.Publisher(f"~{global_name}/potential", kind, queue_size=1)
        self._seen: Any = None

    def publish(self, move_base: MoveBase, tick: TickResult) -> None:
        """Publish what the planners compared in a cycle, the last one or the one before."""
        stamp = self._clock.ns(tick.time)
        self._publish_potential(move_base, tick, stamp)
        planner = move_base.local_planner
        trajectories = _wanted(self._trajectories, getattr(planner.params, "publish_traj_pc", False))
        costs = _wanted(self._costs, getattr(planner.params, "publish_cost_grid_pc", True))
        if not (trajectories or costs):
            return
        found = _new_search(planner, self._seen)
        if found is None:
            return
        self._seen = found.plan
        if trajectories:
            rows = legal_trajectories(found)
            self._trajectories.publish(self._build.points(stamp, planner.params.global_frame_id, TRAJECTORY, rows))
        table = cell_costs(found) if costs else None
        if table is not None:
            self._costs.publish(self._build.points(stamp, found.costmap.frame, COSTS, table))

    def _publish_potential(self, move_base: MoveBase, tick: TickResult, stamp: int) -> None:
        params = move_base.global_planner.params
        switch = getattr(params, "publish_potential", False) or getattr(params, "visualize_potential", False)
        self._planning.keep_potential = _wanted(self._potential, switch)
        plan = tick.plan
        if not self._planning.keep_potential or plan is None or plan.potential is None:
            return
        costmap = move_base.global_costmap.master
        if plan.potential.shape != costmap.geometry.shape:
            return  # planned on a map that has been replaced
        if self._is_grid:
            values = scaled_potential(plan.potential, int(getattr(params, "publish_scale", 100)))
            self._potential.publish(self._build.values(stamp, costmap, values))
        else:
            rows = potential_points(plan, costmap)
            self._potential.publish(self._build.points(stamp, costmap.frame, POTENTIAL, rows))


def _wanted(publisher: Any, switch: bool) -> bool:
    return publisher is not None and bool(switch) and publisher.get_num_connections() > 0


def _new_search(planner: LocalPlanner, seen: Any) -> ControlDiagnostics | None:
    found = planner.diagnostics()
    return None if found is None or found.plan is seen or found.plan.mode not in _SEARCHES else found


def legal_trajectories(found: ControlDiagnostics) -> NDArray[np.float64]:
    """Return every point of the legal samples, (n, 5): x, y, z, theta, and the cost of its sample."""
    plan, rollouts = found.plan, found.rollouts
    if plan.rejected_by is None or plan.totals is None:
        return np.empty((0, len(TRAJECTORY)))
    rows: list[NDArray[np.float64]] = []
    for sample in np.flatnonzero(plan.rejected_by == -1).tolist():
        poses = rollouts.poses[sample, : rollouts.counts[sample]]
        zeros = np.zeros(len(poses))
        rows.append(np.column_stack((poses[:, :2], zeros, poses[:, 2], zeros + plan.totals[sample])))
    return np.concatenate(rows) if rows else np.empty((0, len(TRAJECTORY)))


def cell_costs(found: ControlDiagnostics) -> NDArray[np.float64] | None:
    """Return the costs of the cells from which the plan can be reached, (n, 7), as `COSTS` names them; None without grids.

    Source: DWAPlanner::getCellCosts, TrajectoryPlanner::getCellCosts.
    """
    path, goal = found.grids.get("path"), found.grids.get("goal")
    plan = found.plan
    if path is None or goal is None or plan.scales is None:
        return None
    geometry, occupied = found.costmap.geometry, found.costmap.data
    iy, ix = np.nonzero((path < path.size) & (occupied < INSCRIBED))
    parts = np.column_stack((path[iy, ix], goal[iy, ix], occupied[iy, ix].astype(np.float64)))
    weights = [_weight(plan.critics, plan.scales, name) for name in ("path", "goal", "obstacle")]
    x, y = _centers(geometry, ix, iy)
    return np.column_stack((x, y, np.zeros(len(x)), parts, parts @ np.array(weights)))


def _weight(critics: Sequence[str], scales: NDArray[np.float64], name: str) -> float:
    return float(scales[critics.index(name)]) if name in critics else 0.0


def _centers(
    geometry: GridGeometry, ix: NDArray[np.intp], iy: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = ix.astype(np.float64) + 0.5, iy.astype(np.float64) + 0.5
    return geometry.origin_x + x * geometry.resolution, geometry.origin_y + y * geometry.resolution


def potential_points(plan: Plan, costmap: Costmap) -> NDArray[np.float64]:
    """Return the potential of the reached cells, (n, 4): x, y, a height in proportion to it (20 m at the goal), potential."""
    potential = plan.potential
    assert potential is not None
    iy, ix = np.nonzero(np.isfinite(potential))
    values = potential[iy, ix].astype(np.float64)
    highest = _potential_at(plan, costmap, potential) or float(values.max(initial=0.0)) or 1.0
    x, y = _centers(costmap.geometry, ix, iy)
    return np.column_stack((x, y, HIGHEST_M * values / highest, values))


def _potential_at(plan: Plan, costmap: Costmap, potential: NDArray[np.float32]) -> float:
    """Return the potential at the goal, 0 where it is not reached."""
    cell = costmap.geometry.world_to_cell(plan.goal.x, plan.goal.y)
    value = float(potential[cell[1], cell[0]]) if cell is not None else 0.0
    return value if np.isfinite(value) else 0.0


def scaled_potential(potential: NDArray[np.float32], scale: int) -> NDArray[np.int8]:
    """Return the potential as values of a grid: up to `scale` for the largest, -1 where it is not reached."""
    reached = np.isfinite(potential)
    largest = float(potential[reached].max(initial=0.0)) or 1.0
    values = np.full(potential.shape, -1, np.int8)
    values[reached] = np.clip(potential[reached] * scale / largest, 0, 127).astype(np.int8)
    return values
