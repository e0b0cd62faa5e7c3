"""A node of ROS 2 for tests: it passes the robot's topics on, breaks them on request, and reports what it hears.

Commands arrive as JSON lines on stdin, events leave as JSON lines on stdout, as of the probe of ROS 1.
The key `t` is `time.monotonic` (s).
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from typing import Any

from navstack.ros2 import ros
from navstack.ros2.ros import RosNode
from navstack.ros_messages import NS_PER_S, time_ns
from navstack.ros_messages import messages as msg

TF, CLOCK, LOG = "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Clock", "rcl_interfaces/msg/Log"
LEVELS = {30: 4, 40: 8}
"""Levels of a log line in ROS 2 as those of ROS 1: warning, error."""


class Probe:
    """Relays `raw/scan`, `raw/odom`, `raw/tf`, `raw/clock` and `raw/map`; `modes` says how."""

    def __init__(self, *, relays: bool) -> None:
        """Without `relays`, only goals are sent, and their results, the clock, the truth and log lines reported."""
        self.node = node = RosNode("probe", [])
        self.modes = {"scan": "pass", "odom": "pass", "tf": "pass", "clock": "pass"}
        self._lock = threading.Lock()
        self._shift = 0.0
        self._back_ns = 0
        self._now_ns = 0
        self._map: Any = None
        self._handle: Any = None
        self.out: dict[str, Any] = {}
        if relays:
            self._relay()
        else:
            node.subscribe("/clock", CLOCK, self._note_clock, depth=10)
        node.subscribe("cmd_vel", msg.TWIST_STAMPED, self._command, depth=50)
        node.subscribe("base_pose_ground_truth", msg.ODOMETRY, self._truth, depth=50)
        node.subscribe("/rosout", LOG, self._log, depth=1000, latched=True)
        node.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", self._diagnostics, depth=5)
        kind = ros.message("nav2_msgs/action/NavigateToPose")
        self._kind = kind
        self._client = ros.load("rclpy.action").ActionClient(node.handle, kind, "navigate_to_pose")
        node.start()
        self.report("ready")

    def _relay(self) -> None:
        node = self.node
        self.out = {
            "scan": node.publisher("scan", msg.SCAN, depth=10, reliable=False),
            "odom": node.publisher("odom", msg.ODOMETRY, depth=10),
            "tf": node.publisher("/tf", TF, depth=100),
            "clock": node.publisher("/clock", CLOCK),
            "map": node.publisher("map", msg.MAP, latched=True),
        }
        node.subscribe("raw/scan", msg.SCAN, self._scan, depth=10, reliable=False)
        node.subscribe("raw/odom", msg.ODOMETRY, self._odometry, depth=10)
        node.subscribe("/raw/tf", TF, self._transforms, depth=100)
        node.subscribe("/raw/clock", CLOCK, self._clock, depth=10)
        node.subscribe("raw/map", msg.MAP, self._on_map, latched=True)

    def _note_clock(self, message: Any) -> None:
        self._now_ns = time_ns(message.clock)

    def report(self, what: str, **data: Any) -> None:
        """Write an event: what was heard or done, and when."""
        line = json.dumps({"t": time.monotonic(), "what": what, **data})
        with self._lock:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

    # --- relays -------------------------------------------------------------------------------------------------------

    def _earlier(self, stamp: Any) -> Any:
        return self.node.build.time(time_ns(stamp) - self._back_ns)

    def _scan(self, message: Any) -> None:
        mode = self.modes["scan"]
        if mode == "stop":
            return
        if mode == "nan":
            message.ranges = [math.nan] * len(message.ranges)
        elif mode == "some nan":
            message.ranges = [math.nan if i % 3 == 0 else value for i, value in enumerate(message.ranges)]
        message.header.stamp = self._earlier(message.header.stamp)
        self.out["scan"].publish(message)

    def _odometry(self, message: Any) -> None:
        mode = self.modes["odom"]
        if mode == "stop":
            return
        if mode == "nan":
            message.twist.twist.linear.x = math.nan
        message.header.stamp = self._earlier(message.header.stamp)
        message.pose.pose.position.x += self._shift
        self.out["odom"].publish(message)

    def _transforms(self, message: Any) -> None:
        mode = self.modes["tf"]
        if mode == "stop":
            return
        for item in message.transforms:
            item.header.stamp = self._earlier(item.header.stamp)
            if mode == "nan":
                item.transform.translation.x = math.nan
            elif mode == "zero":
                item.transform.rotation.z = item.transform.rotation.w = 0.0
            if item.header.frame_id == "odom":
                item.transform.translation.x += self._shift
        self.out["tf"].publish(message)

    def _clock(self, message: Any) -> None:
        if self.modes["clock"] != "stop":
            message.clock = self._earlier(message.clock)
            self._now_ns = time_ns(message.clock)
            self.out["clock"].publish(message)

    def _on_map(self, message: Any) -> None:
        self._map = message
        self.out["map"].publish(message)

    # --- reports ------------------------------------------------------------------------------------------------------

    def _command(self, message: Any) -> None:
        self.report("cmd", v=message.twist.linear.x, w=message.twist.angular.z, now=1e-9 * self._now_ns)

    def _truth(self, message: Any) -> None:
        twist, pose = message.twist.twist, message.pose.pose.position
        self.report("truth", v=twist.linear.x, w=twist.angular.z, x=pose.x, y=pose.y)

    def _log(self, message: Any) -> None:
        self.report("log", level=LEVELS.get(int(message.level), 1), name=f"/{message.name}", text=message.msg)

    def _diagnostics(self, message: Any) -> None:
        found = {
            part.name: {"level": ord(part.level), "message": part.message, **{v.key: v.value for v in part.values}}
            for part in message.status
        }
        self.report("diagnostics", found=found)

    # --- commands -----------------------------------------------------------------------------------------------------

    def obey(self, command: dict[str, Any]) -> None:
        """Do what a command says, at the time `at` (s, ROS) if it is given."""
        what = command["do"]
        while self._now_ns < command.get("at", 0.0) * NS_PER_S:
            time.sleep(0.001)
        if what == "mode":
            self.modes[command["topic"]] = command["mode"]
        elif what == "jump":
            self._shift += float(command["by"])
        elif what == "clock back":
            self._back_ns += round(command["by"] * NS_PER_S)
        elif what == "goal":
            self.node.later(lambda: self._send(command))
        elif what == "cancel":
            self.node.later(self._cancel)
        elif what == "map":
            self.node.later(lambda: self.out["map"].publish(self._padded(int(command["pad"]))))
        self.report("done", do=what, now=1e-9 * self._now_ns)

    def _send(self, command: dict[str, Any]) -> None:
        goal, name = self._kind.Goal(), command.get("id", "")
        goal.pose.header.frame_id = command.get("frame", "map")
        at, o = goal.pose.pose.position, goal.pose.pose.orientation
        at.x, at.y = float(command["x"]), float(command["y"])
        o.x, o.y, o.z, o.w = command.get("q", (0.0, 0.0, 0.0, 1.0))

        def accepted(future: Any) -> None:
            self._handle = handle = future.result()
            self.report("accepted", id=name, accepted=handle.accepted, stamp=1e-9 * self._now_ns)
            if handle.accepted:
                handle.get_result_async().add_done_callback(ended)

        def ended(future: Any) -> None:
            result = future.result()
            self.report(
                "result",
                id=name,
                status=result.status,
                code=result.result.error_code,
                text=result.result.error_msg,
                stamp=1e-9 * self._now_ns,
            )

        self._client.send_goal_async(goal).add_done_callback(accepted)

    def _cancel(self) -> None:
        if self._handle is not None:
            self._handle.cancel_goal_async()

    def _padded(self, pad: int) -> Any:
        """Return the map with a free border of `pad` cells: another size and origin."""
        grid = msg.map_of(self._map)
        import dataclasses

        import numpy as np

        geometry = dataclasses.replace(
            grid.geometry,
            nx=grid.geometry.nx + 2 * pad,
            ny=grid.geometry.ny + 2 * pad,
            origin_x=grid.geometry.origin_x - pad * grid.geometry.resolution,
            origin_y=grid.geometry.origin_y - pad * grid.geometry.resolution,
        )
        padded = dataclasses.replace(grid, data=np.pad(grid.data, pad), geometry=geometry)
        return self.node.build.map(self._now_ns, padded)


def main() -> None:
    """Obey until stdin ends."""
    probe = Probe(relays="--results" not in sys.argv)
    for line in sys.stdin:
        probe.obey(json.loads(line))
    probe.node.shut_down(lambda: None)


if __name__ == "__main__":
    main()
