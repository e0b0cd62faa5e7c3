"""Docking over ROS 2: the actions DockRobot and UndockRobot, and what the robot's detector and battery report."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

from navstack.core import NavError
from navstack.docking import Dock, DockDatabase, Docking, DockTask, Undocking
from navstack.move_base import GoalStatus, TickResult, TreeMoveBase
from navstack.parameters import DockingParams
from navstack.ros2.ros import RosNode
from navstack.ros2.tasks import Codes, Outcome, Task, duration, outcome_of
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, RosRobot

TOPIC: Final = "detected_dock_pose"
BATTERY: Final = "sensor_msgs/msg/BatteryState"


class DockingCodes(Codes):
    """The numbers of the errors of docking, which are those of Nav2 already."""

    def of(self, error: NavError) -> int:
        """Return the number of an error."""
        return error.code if 900 <= error.code <= self.first else self.first


DOCKING: Final = DockingCodes(999)


def detection_topics(params: DockingParams | None) -> list[str]:
    """Return the topics of detected docks that the types of docks listen to."""
    types: list[Any] = [] if params is None else list(params.dock_types.values())
    seen = [kind for kind in types if getattr(kind, "use_external_detection_pose", False)]
    detectors = [getattr(kind, "sections", {}).get("detector") for kind in seen]
    return sorted({str(getattr(detector, "topic", "") or TOPIC) for detector in detectors})


def subscribe(node: RosNode, inbox: Inbox, robot: RosRobot, topics: Iterable[str]) -> None:
    """Receive the detections of docks and the state of the battery."""
    for topic in topics:
        node.subscribe(topic, msg.POSE, inbox.poster(robot.receive_detection, topic, most=10), depth=10)
    node.subscribe("battery_state", BATTERY, inbox.poster(robot.receive_battery, most=1))


class DockRobotTask(Task):
    """DockRobot: to the staging pose by a goal, then the approach."""

    codes = DOCKING
    docks: Callable[[], DockDatabase]
    """Returns the docks. Raises InputError."""
    default_tree = ""
    """The behavior tree that drives to the staging pose; empty: the states of move_base."""
    task: DockTask | None = None
    _tick: TickResult | None = None

    @property
    def drives(self) -> bool:
        """True on the way to the staging pose."""
        return self.task is not None and not self.task.is_done and self.task.is_staging

    def make(self) -> DockTask:
        """Return what to do. Raises a NavError for a dock that is not known."""
        goal, docks = self.goal, self.docks()
        dock: Dock | str = str(goal.dock_id)
        if not goal.use_dock_id:
            frame = msg.frame_of(goal.dock_pose) or self.move_base.global_costmap.frame
            dock = Dock("dock_pose", str(goal.dock_type), msg.pose_of(goal.dock_pose.pose), frame)
        return Docking(
            self.move_base,
            docks,
            dock,
            navigate_to_staging_pose=bool(goal.navigate_to_staging_pose),
            max_staging_time_s=float(goal.max_staging_time),
        )

    def begin(self, now: float) -> None:
        """Start."""
        if isinstance(self.move_base, TreeMoveBase):
            self.move_base.drive_by(self.default_tree)
        self.task = self.make()
        self.task.start()

    def update(self, now: float) -> Outcome | None:
        """Go on after each tick; return the end."""
        task, tick = self.task, self.move_base.last_tick
        assert task is not None
        if tick is not self._tick:
            self._tick = tick
            task.advance()
        if not task.is_done:
            return None
        code = 0 if task.error is None else self.codes.of(task.error)
        found = outcome_of(task.status, code, task.text if task.status is GoalStatus.ABORTED else "")
        return found._replace(code=0) if task.status is not GoalStatus.ABORTED else found

    def cancel(self) -> None:
        """Stop the robot."""
        if self.task is not None:
            self.task.cancel()

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the state, the time and the retries."""
        if self.task is None:
            return False
        seen = self.task.feedback
        message.state, message.num_retries = int(seen.state), seen.num_retries
        message.docking_time = duration(self.build, seen.docking_time)
        return True

    def fill(self, result: Any, now: float) -> None:
        """Fill the retries."""
        if self.task is not None:
            result.num_retries = self.task.log.retries


class UndockRobotTask(DockRobotTask):
    """UndockRobot: out of the dock to its staging pose."""

    def make(self) -> DockTask:
        """Return the way out. Raises a NavError for a type that is not known."""
        limit = float(self.goal.max_undocking_time)
        return Undocking(self.move_base, self.docks(), str(self.goal.dock_type), max_undocking_time_s=limit)

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Nothing: the action has none."""
        return False

    def fill(self, result: Any, now: float) -> None:
        """Nothing besides the success."""
