"""`/diagnostics`: what the node does, how late its loop is and why, and how old its data are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from navstack.move_base import MoveBase
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import LoopTimes, NodeClock, NodeState, RosRobot


class Diagnostics:
    """Publishes a diagnostic_msgs/DiagnosticArray once per second."""

    def __init__(self, robot: RosRobot, times: LoopTimes, clock: NodeClock, build: MessageBuilder) -> None:
        rospy = ros.rospy()
        self._clock, self._build = clock, build
        self._state = NodeState(str(rospy.get_name()).removeprefix("/"), robot, times)
        self._out = rospy.Publisher("/diagnostics", ros.message("diagnostic_msgs/DiagnosticArray"), queue_size=1)

    def publish(self, move_base: MoveBase, now: float) -> None:
        """Publish if it is due."""
        if not self._state.is_due() or not self._out.get_num_connections():
            return
        message = ros.message("diagnostic_msgs/DiagnosticArray")()
        message.header.stamp = self._build.time(self._clock.ns(now))
        message.status = [diagnostic_status(*part) for part in self._state.parts(move_base, now)]
        self._out.publish(message)


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
