"""A bag of the simulated robot, played in a loop under its own clock: the node goes on when time jumps back."""

from __future__ import annotations

import json
import signal
from pathlib import Path

from tests.ros1.conftest import PYTHON, TIMEOUT_S
from tests.ros1.module_graph import ROOT, module_graph

RECORDED = ("/tf", "/tf_static", "/scan", "/odom", "/map")
WAIT = """
import rospy
from rosgraph_msgs.msg import Clock
rospy.init_node("wait", disable_signals=True)
rospy.wait_for_message("/clock", Clock)
"""
DRIVE = """
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
rospy.init_node("drive", disable_signals=True)
out = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
rospy.wait_for_message("/odom", Odometry)
end, command = rospy.Time.now() + rospy.Duration(4), Twist()
command.linear.x = 0.3
while rospy.Time.now() < end:
    out.publish(command)
    rospy.rostime.wallsleep(0.05)
"""
CLIENT = """
import json, sys, rospy, actionlib
from actionlib_msgs.msg import GoalStatusArray
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Path
from rosgraph_msgs.msg import Clock
rospy.init_node("client", disable_signals=True)
found = {"loops": 0, "statuses": [], "plans": [], "grids": [], "results": []}
last = [0.0]
def on_clock(message):
    now = message.clock.to_sec()
    found["loops"] += now < last[0] - 1.0
    last[0] = now
def on(name):
    return lambda message: found[name].append(found["loops"])
kept = [rospy.Subscriber("/clock", Clock, on_clock), rospy.Subscriber("/move_base/status", GoalStatusArray, on("statuses")),
        rospy.Subscriber("/move_base/NavfnROS/plan", Path, on("plans")),
        rospy.Subscriber("/move_base/local_costmap/costmap", OccupancyGrid, on("grids"))]
client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
client.wait_for_server()
goal = MoveBaseGoal()
goal.target_pose.header.frame_id = "map"
goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = 6.0, 7.45
goal.target_pose.pose.orientation.w = 1.0
for loop in range(2):
    first = found["loops"]
    goal.target_pose.header.stamp = rospy.Time.now()
    client.send_goal(goal)
    while found["loops"] < first + 1 or found["plans"].count(found["loops"]) < 1 or found["grids"].count(found["loops"]) < 3:
        rospy.rostime.wallsleep(0.05)
    client.cancel_goal()
    while client.get_state() in (0, 1, 6, 7):
        rospy.rostime.wallsleep(0.05)
    found["results"].append(client.get_state())
json.dump(found, open(sys.argv[1], "w"))
"""


def test_a_bag_in_a_loop(tmp_path: Path) -> None:
    """In each loop plans, costmaps and statuses go on, and a goal can be canceled."""
    bag, out = tmp_path / "drive.bag", tmp_path / "found.json"
    with module_graph(tmp_path) as graph:
        sim = graph.node("sim", "office", "--clock", "--speed", "2")
        graph.run(PYTHON, "-c", WAIT)  # recorded times are those of the simulation only if that has begun
        drive = graph.start(PYTHON, "-c", DRIVE)
        record = graph.start("/usr/bin/rosbag", "record", "-O", str(bag), *RECORDED)
        assert drive.wait(TIMEOUT_S) == 0, graph.output_of(drive)
        for program in (record, sim):
            program.send_signal(signal.SIGINT)
            program.wait(TIMEOUT_S)
        player = graph.start("/usr/bin/rosbag", "play", "--quiet", "--clock", "--hz", "50", "-l", str(bag))
        params = str(ROOT / "params" / "turtlebot")
        node = graph.node("move_base", "--params", params)
        client = graph.start(PYTHON, "-c", CLIENT, str(out))
        assert client.wait(TIMEOUT_S) == 0, graph.output_of(client) + graph.output_of(node)
        found = json.loads(out.read_text())
        log = graph.output_of(node)
        assert player.poll() is None and node.poll() is None
    assert found["results"] == [2, 2] and found["loops"] >= 2
    assert len(set(found["statuses"])) >= 2 and len(set(found["plans"])) >= 2  # loops are counted from the first clock
    assert log.count("the clock jumped back") >= 2 and "error" not in log and "Traceback" not in log, log
