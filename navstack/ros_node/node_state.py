"""What a node does, how late its loop is and why, and how old its data are, as the parts of a DiagnosticArray."""

from __future__ import annotations

import time
from typing import Any, Final, NamedTuple

from navstack.move_base import MoveBase
from navstack.ros_node.loop_times import LoopTimes
from navstack.ros_node.robot import RosRobot

PERIOD_S: Final = 1.0
"""Time between two messages (s, wall)."""
OK, WARN, ERROR = 0, 1, 2
LATE_SHARE: Final = 0.05
"""Share of late cycles above which the control loop is a warning."""


class PartStatus(NamedTuple):
    """One part: a diagnostic_msgs/DiagnosticStatus."""

    level: int
    name: str
    text: str
    values: dict[str, Any]


class NodeState:
    """Tells once per second how a node is."""

    def __init__(self, name: str, robot: RosRobot, times: LoopTimes) -> None:
        self._name, self._robot, self._times = name, robot, times
        self._due = time.monotonic()

    def is_due(self) -> bool:
        """Return True once per second (wall)."""
        wall = time.monotonic()
        if wall < self._due:
            return False
        self._due = wall + PERIOD_S
        return True

    def parts(self, move_base: MoveBase, now: float) -> list[PartStatus]:
        """Return the state of the navigation, of the control loop and of the data at `now` (s)."""
        return [self._navigation(move_base), self._loop(), self._data(now)]

    def _navigation(self, move_base: MoveBase) -> PartStatus:
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

    def _loop(self) -> PartStatus:
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

    def _data(self, now: float) -> PartStatus:
        robot = self._robot
        values: dict[str, Any] = {
            f"age of {name} (s)": f"{now - at:.3f}" for name, at in sorted(robot.received.items())
        }
        if robot.odometry_stamp is not None:
            values["age of odom (s)"] = f"{now - robot.odometry_stamp:.3f}"
        values |= {f"ignored: {reason}": count for reason, count in robot.problems.items()}
        text = f"{sum(robot.problems.values())} messages were ignored" if robot.problems else "usable"
        return self._status("data", WARN if robot.problems else OK, text, values)

    def _status(self, part: str, level: int, text: str, values: dict[str, Any]) -> PartStatus:
        return PartStatus(level, f"{self._name}: {part}", text, values)


def _quantiles(numbers: Any) -> dict[str, float]:
    ordered = sorted(numbers)
    if not ordered:
        return {}
    last = len(ordered) - 1
    return {name: ordered[round(share * last)] for name, share in (("p50", 0.5), ("p95", 0.95), ("p99", 0.99))}
