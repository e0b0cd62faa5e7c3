"""Docking as servers of behavior trees: the nodes DockRobot and UndockRobot drive into a dock and out of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from navstack.behavior_trees import StampedPose
from navstack.core import NavError, SensorData
from navstack.docking.behavior import Approach, DockingLog, DockMotion, DockSensing, Leave
from navstack.docking.database import Dock, DockDatabase
from navstack.docking.errors import DockingError, FailedToStageError
from navstack.docking.task import MAX_UNDOCKING_TIME_S, docking_robot, is_staged, undocked_dock
from navstack.move_base import BehaviorServer, MoveBase
from navstack.plugins import Behavior


class _Server:
    """What both servers share: the docks, and the sensors since the last step."""

    def __init__(self, move_base: MoveBase, docks: Callable[[], DockDatabase]) -> None:
        self._move_base, self._docks = move_base, docks
        self._sensing = DockSensing(move_base.robot.frames)

    @cached_property
    def database(self) -> DockDatabase:
        """The docks, read with the first goal."""
        return self._docks()

    def observe(self, scans: Sequence[SensorData]) -> None:
        """Add scans, the detections of docks and the state of the battery."""
        robot = docking_robot(self._move_base.robot)
        detections = [] if robot is None else robot.dock_detections()
        self._sensing.add([*scans, *detections], None if robot is None else robot.battery_state)

    def code_of(self, error: NavError) -> int:
        """Return the code of DockRobot and UndockRobot."""
        return error.code if 900 <= error.code <= 999 else DockingError.code


class DockServer(_Server):
    """The server `dock_robot`.

    # Nav2 differs: there, the node drives to the staging pose by a goal of its own, which replaces the goal of the tree that it
    is in. Here the tree drives to the staging pose before.
    """

    def make(self, goal: Mapping[str, object]) -> Behavior:
        """Return the approach to a dock by its name, or to the pose of the goal. Raises NavError."""
        database, move_base = self.database, self._move_base
        pose, kind = goal.get("dock_pose"), str(goal.get("dock_type") or "")
        if not goal.get("use_dock_id", True) and isinstance(pose, StampedPose):
            dock = Dock("dock_pose", kind, pose.pose, pose.frame or move_base.global_costmap.frame)
        else:
            dock = database.dock(str(goal.get("dock_id") or ""))
        dock_type = database.type_of(dock)
        staging = dock_type.staging_pose(dock.pose)
        here = move_base.global_costmap.robot_pose(move_base.last_tick.time)
        if goal.get("navigate_to_staging_pose", True) and not is_staged(here, staging, database.params):
            raise FailedToStageError(
                f"{dock.name}: the robot is {here.distance_to(staging):.2f} m from the staging pose ({staging.x:.2f}, "
                f"{staging.y:.2f}, {staging.yaw:.2f}), and a tree drives there itself: follow a path to it before DockRobot, or "
                'write navigate_to_staging_pose="false" to dock from where the robot is',
                distance_m=here.distance_to(staging),
            )
        self.observe(())
        self._sensing.take()  # what was measured before counts for nothing
        return Approach("dock_robot", database.params, dock, dock_type, self._sensing, DockingLog(dock.name))

    def result(self, behavior: Behavior) -> Mapping[str, object]:
        """Return the number of retries."""
        return {"success": True, "num_retries": behavior.log.retries if isinstance(behavior, DockMotion) else 0}


class UndockServer(_Server):
    """The server `undock_robot`."""

    def make(self, goal: Mapping[str, object]) -> Behavior:
        """Return the way out of the nearest dock. Raises NavError."""
        database, limit = self.database, goal.get("max_undocking_time", MAX_UNDOCKING_TIME_S)
        dock = undocked_dock(self._move_base, database, str(goal.get("dock_type") or ""))
        return Leave(
            "undock_robot",
            database.params,
            dock,
            database.type_named(dock.type),
            self._sensing,
            DockingLog(dock.name),
            max_time_s=float(limit) if isinstance(limit, (int, float)) else MAX_UNDOCKING_TIME_S,
        )

    def result(self, behavior: Behavior) -> Mapping[str, object]:
        """Return success."""
        del behavior
        return {"success": True}


def docking_servers(move_base: MoveBase, docks: Callable[[], DockDatabase]) -> dict[str, BehaviorServer]:
    """Return the servers of docking for the trees of a goal manager; `docks` reads the database."""
    return {"dock_robot": DockServer(move_base, docks), "undock_robot": UndockServer(move_base, docks)}
