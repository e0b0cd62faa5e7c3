"""`/diagnostics`: what the node does, how late its loop is and why, and how old its data are."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Final

from navstack.move_base import MoveBase
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import LoopTimes, NodeClock, RosRobot

PERIOD_S: Final = 1.0
"""Time between two messages (s, wall)."""
OK, WARN, ERROR = 0, 1, 2
LATE_SHARE: Final = 0.05
"""Share of late cycles above which the control loop is a warning."""


class Diagnostics:
    """Publishes a diagnostic_msgs/DiagnosticArray once per second."""

    def __init__(self, robot: RosRobot, times: LoopTimes, clock: NodeClock, build: MessageBuilder) -> None:
        rospy = ros.rospy()
        self._robot, self._times, self._clock, self._build = robot, times, clock, build
        self._name = str(rospy.get_name()).removeprefix("/")
        self._out = rospy.Publisher("/diagnostics", ros.message("diagnostic_msgs/DiagnosticArray"), queue_size=1)
        self._due = time.monotonic()

    def publish(self, move_base: MoveBase, now: float) -> None:
        """Publish if it is due."""
        wall = time.monotonic()
        if wall < self._due:
            return
        self._due = wall + PERIOD_S
        if not self._out.get_num_connections():
            return
        message = ros.message("diagnostic_msgs/DiagnosticArray")()
        message.header.stamp = self._build.time(self._clock.ns(now))
        message.status = [self._navigation(move_base), self._loop(), self._data(now)]
        self._out.publish(message)

    def _navigation(self, move_base: MoveBase) -> Any:
        handle = move_base.server.current
        failed = handle is not None and handle.status.name == "ABORTED"
        values = {
            "state": move_base.activity,
            "goal": "" if handle is None else handle.id,
            "status": "" if handle is None else handle.status.name,
            "text": "" if handle is None else handle.text,
            "recovery": move_base.recovery or "",
            "recovery index": move_base.recovery_index,
        }
        text = f"the last goal was aborted: {handle.text}" if failed and handle is not None else move_base.activity
        return self._status("navigation", WARN if failed else OK, text, values)

    def _loop(self) -> Any:
        times = self._times
        late = sum(times.late.values())
        is_late = late > LATE_SHARE * max(times.cycles, 1)
        worst = times.take_worst()
        values: dict[str, Any] = {"cycles": times.cycles, "late cycles": late}
        values |= {f"late because of {cause}": count for cause, count in times.late.items()}
        if worst is not None:
            values["latest"] = str(worst)
        for name, numbers in (("control period", times.periods), ("scan to command", times.delays)):
            values |= {f"{name} {share} (s)": f"{value:.4f}" for share, value in _quantiles(numbers).items()}
        text = f"{late} of {times.cycles} cycles were late" if is_late else "on time"
        return self._status("control loop", WARN if is_late else OK, text, values)

    def _data(self, now: float) -> Any:
        robot = self._robot
        values: dict[str, Any] = {
            f"age of {name} (s)": f"{now - at:.3f}" for name, at in sorted(robot.received.items())
        }
        if robot.odometry_stamp is not None:
            values["age of odom (s)"] = f"{now - robot.odometry_stamp:.3f}"
        values |= {f"ignored: {reason}": count for reason, count in robot.problems.items()}
        text = f"{sum(robot.problems.values())} messages were ignored" if robot.problems else "usable"
        return self._status("data", WARN if robot.problems else OK, text, values)

    def _status(self, part: str, level: int, text: str, values: Mapping[str, Any]) -> Any:
        return diagnostic_status(level, f"{self._name}: {part}", text, values)


def diagnostic_status(level: int, name: str, text: str, values: Mapping[str, Any]) -> Any:
    """Return a diagnostic_msgs/DiagnosticStatus."""
    pair = ros.message("diagnostic_msgs/KeyValue")
    return ros.message("diagnostic_msgs/DiagnosticStatus")(
        level=level,
        name=name,
        message=text,
        hardware_id="navstack",
        values=[pair(key=key, value=str(value)) for key, value in values.items()],
    )


def _quantiles(numbers: Any) -> dict[str, float]:
    ordered = sorted(numbers)
    if not ordered:
        return {}
    last = len(ordered) - 1
    return {name: ordered[round(share * last)] for name, share in (("p50", 0.5), ("p95", 0.95), ("p99", 0.99))}
