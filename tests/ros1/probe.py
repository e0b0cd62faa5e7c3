"""A ROS node for tests: it passes the robot's topics on to the node, breaks them on request, and reports what it hears.

Commands arrive as JSON lines on stdin, events leave as JSON lines on stdout; the key `t` is `time.monotonic` (s).
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from typing import Any

from navstack.ros1 import ros

SCAN, ODOMETRY, TF, MAP = "sensor_msgs/LaserScan", "nav_msgs/Odometry", "tf2_msgs/TFMessage", "nav_msgs/OccupancyGrid"
CLOCK = "rosgraph_msgs/Clock"


class Probe:
    """Relays `raw/scan`, `raw/odom`, `raw/tf`, `raw/clock`; `modes` says how."""

    def __init__(self, *, relays: bool) -> None:
        """Without `relays`, only goals are sent, and their results, log lines and diagnostics reported."""
        rospy = self.rospy = ros.rospy()
        rospy.init_node("probe", disable_signals=True)
        self.modes = {"scan": "pass", "odom": "pass", "tf": "pass", "clock": "pass"}
        self._lock = threading.Lock()
        self._shift = 0.0
        self._back = rospy.Duration(0)
        self.out = {
            "scan": rospy.Publisher("scan", ros.message(SCAN), queue_size=10, tcp_nodelay=True),
            "odom": rospy.Publisher("odom", ros.message(ODOMETRY), queue_size=10, tcp_nodelay=True),
            "tf": rospy.Publisher("/tf", ros.message(TF), queue_size=50, tcp_nodelay=True),
            "clock": rospy.Publisher("/clock", ros.message(CLOCK), queue_size=10, tcp_nodelay=True),
            "map": rospy.Publisher("map", ros.message(MAP), queue_size=1, latch=True),
            "goal": rospy.Publisher("move_base/goal", ros.message("move_base_msgs/MoveBaseActionGoal"), queue_size=10),
            "cancel": rospy.Publisher("move_base/cancel", ros.message("actionlib_msgs/GoalID"), queue_size=10),
        }
        self._map: Any = None
        listen = rospy.Subscriber
        listen("move_base/status", ros.message("actionlib_msgs/GoalStatusArray"), self._status, queue_size=50)
        listen("move_base/result", ros.message("move_base_msgs/MoveBaseActionResult"), self._result, queue_size=50)
        listen("/rosout", ros.message("rosgraph_msgs/Log"), self._log, queue_size=100)
        listen("/diagnostics", ros.message("diagnostic_msgs/DiagnosticArray"), self._diagnostics, queue_size=5)
        if relays:
            self._listen_to_all()
        self.report("ready")

    def _listen_to_all(self) -> None:
        listen = self.rospy.Subscriber
        listen("raw/scan", ros.message(SCAN), self._scan, queue_size=10, tcp_nodelay=True)
        listen("raw/odom", ros.message(ODOMETRY), self._odometry, queue_size=10, tcp_nodelay=True)
        listen("/raw/tf", ros.message(TF), self._transforms, queue_size=50, tcp_nodelay=True)
        listen("/raw/clock", ros.message(CLOCK), self._clock, queue_size=10, tcp_nodelay=True)
        listen("raw/map", ros.message(MAP), self._on_map, queue_size=1)
        listen("cmd_vel", ros.message("geometry_msgs/Twist"), self._command, queue_size=50, tcp_nodelay=True)
        listen("base_pose_ground_truth", ros.message(ODOMETRY), self._truth, queue_size=50, tcp_nodelay=True)
        feedback = ros.message("move_base_msgs/MoveBaseActionFeedback")
        listen("move_base/feedback", feedback, self._feedback, queue_size=50)
        recovery = ros.message("move_base_msgs/RecoveryStatus")
        listen("move_base/recovery_status", recovery, self._recovery, queue_size=50)
        stamped = ros.message("geometry_msgs/PoseStamped")
        listen("move_base/current_goal", stamped, self._current_goal, queue_size=50)
        listen("move_base/NavfnROS/plan", ros.message("nav_msgs/Path"), self._plan, queue_size=50)

    def report(self, what: str, **data: Any) -> None:
        """Write an event: what was heard or done, and when."""
        line = json.dumps({"t": time.monotonic(), "what": what, **data})
        with self._lock:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

    # --- relays -------------------------------------------------------------------------------------------------------

    def _scan(self, message: Any) -> None:
        mode = self.modes["scan"]
        if mode == "stop":
            return
        if mode == "nan":
            message.ranges = [math.nan] * len(message.ranges)
        elif mode == "some nan":
            message.ranges = [math.nan if i % 3 == 0 else value for i, value in enumerate(message.ranges)]
        message.header.stamp -= self._back
        self.out["scan"].publish(message)

    def _odometry(self, message: Any) -> None:
        mode = self.modes["odom"]
        if mode == "stop":
            return
        if mode == "nan":
            message.twist.twist.linear.x = math.nan
        message.header.stamp -= self._back
        message.pose.pose.position.x += self._shift
        self.out["odom"].publish(message)

    def _transforms(self, message: Any) -> None:
        mode = self.modes["tf"]
        if mode == "stop":
            return
        for item in message.transforms:
            item.header.stamp -= self._back
            if mode == "nan":
                item.transform.translation.x = math.nan
            elif mode == "zero":
                item.transform.rotation.z = item.transform.rotation.w = 0.0
            if item.header.frame_id == "odom":
                item.transform.translation.x += self._shift
        self.out["tf"].publish(message)

    def _clock(self, message: Any) -> None:
        if self.modes["clock"] != "stop":
            message.clock -= self._back
            self.out["clock"].publish(message)

    def _on_map(self, message: Any) -> None:
        self._map = message
        self.out["map"].publish(message)

    # --- reports ------------------------------------------------------------------------------------------------------

    def _command(self, message: Any) -> None:
        self.report("cmd", v=message.linear.x, w=message.angular.z, now=self.rospy.Time.now().to_sec())

    def _truth(self, message: Any) -> None:
        twist, pose = message.twist.twist, message.pose.pose.position
        self.report("truth", v=twist.linear.x, w=twist.angular.z, x=pose.x, y=pose.y)

    def _status(self, message: Any) -> None:
        goals = [(item.goal_id.id, item.status, item.text) for item in message.status_list]
        self.report("status", goals=goals, stamp=message.header.stamp.to_sec())

    def _result(self, message: Any) -> None:
        status = message.status
        self.report(
            "result", id=status.goal_id.id, status=status.status, text=status.text, stamp=message.header.stamp.to_sec()
        )

    def _feedback(self, message: Any) -> None:
        position = message.feedback.base_position
        goal = message.status.goal_id.id
        at = position.pose.position
        self.report(
            "feedback",
            id=goal,
            frame=position.header.frame_id,
            x=at.x,
            y=at.y,
            stamp=message.header.stamp.to_sec(),
        )

    def _recovery(self, message: Any) -> None:
        index, total = message.current_recovery_number, message.total_number_of_recoveries
        stamp = message.pose_stamped.header.stamp.to_sec()
        self.report("recovery", name=message.recovery_behavior_name, index=index, total=total, stamp=stamp)

    def _current_goal(self, message: Any) -> None:
        at = message.pose.position
        self.report("current_goal", frame=message.header.frame_id, x=at.x, y=at.y)

    def _plan(self, message: Any) -> None:
        self.report("plan", poses=len(message.poses), frame=message.header.frame_id)

    def _log(self, message: Any) -> None:
        self.report("log", level=int(message.level), name=message.name, text=message.msg)

    def _diagnostics(self, message: Any) -> None:
        found = {
            s.name: {"level": s.level, "message": s.message, **{v.key: v.value for v in s.values}}
            for s in message.status
        }
        if any(name.startswith("move_base") for name in found):
            self.report("diagnostics", found=found)

    # --- commands -----------------------------------------------------------------------------------------------------

    def obey(self, command: dict[str, Any]) -> None:
        """Do what a command says, at the time `at` (s, ROS) if it is given."""
        what = command["do"]
        while self.rospy.Time.now().to_sec() < command.get("at", 0.0):
            time.sleep(0.001)
        if what == "mode":
            self.modes[command["topic"]] = command["mode"]
        elif what == "jump":
            self._shift += float(command["by"])
        elif what == "clock back":
            self._back += self.rospy.Duration.from_sec(command["by"])
        elif what == "goal":
            self.out["goal"].publish(self._goal(command))
        elif what == "cancel":
            stamp = self.rospy.Time.from_sec(command.get("stamp", 0.0))
            self.out["cancel"].publish(ros.message("actionlib_msgs/GoalID")(id=command.get("id", ""), stamp=stamp))
        elif what == "map":
            self.out["map"].publish(self._padded(int(command["pad"])))
        elif what == "listeners":
            self.report("listeners", **{name: out.get_num_connections() for name, out in self.out.items()})
        self.report("done", do=what, now=self.rospy.Time.now().to_sec())

    def _goal(self, command: dict[str, Any]) -> Any:
        goal = ros.message("move_base_msgs/MoveBaseActionGoal")()
        now = self.rospy.Time.now()
        goal.header.stamp = now
        goal.goal_id.id = command.get("id", "")
        stamp = command.get("stamp")
        goal.goal_id.stamp = now if stamp is None else self.rospy.Time.from_sec(stamp)
        target = goal.goal.target_pose
        target.header.frame_id, target.header.stamp = command.get("frame", "map"), now
        target.pose.position.x, target.pose.position.y = command["x"], command["y"]
        o = target.pose.orientation
        o.x, o.y, o.z, o.w = command.get("q", (0.0, 0.0, 0.0, 1.0))
        return goal

    def _padded(self, pad: int) -> Any:
        """Return the map with a free border of `pad` cells: another size and origin."""
        old = self._map
        width, height = old.info.width + 2 * pad, old.info.height + 2 * pad
        rows = [[0] * width for _ in range(height)]
        for iy in range(old.info.height):
            rows[iy + pad][pad : pad + old.info.width] = old.data[iy * old.info.width : (iy + 1) * old.info.width]
        new = ros.message(MAP)(header=old.header)
        new.info.resolution, new.info.width, new.info.height = old.info.resolution, width, height
        new.info.origin.position.x = old.info.origin.position.x - pad * old.info.resolution
        new.info.origin.position.y = old.info.origin.position.y - pad * old.info.resolution
        new.info.origin.orientation.w = 1.0
        new.data = [value for row in rows for value in row]
        return new


def main() -> None:
    """Obey until stdin ends."""
    probe = Probe(relays="--results" not in sys.argv)
    for line in sys.stdin:
        probe.obey(json.loads(line))
    probe.rospy.signal_shutdown("end")


if __name__ == "__main__":
    main()
