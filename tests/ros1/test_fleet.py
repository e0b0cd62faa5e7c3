"""A fleet in one program: topics by namespace, frames by prefix, one world, one clock; a move_base node drives one of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.ros1.conftest import PYTHON, TIMEOUT_S, Graph, paced, wait_for
from tests.ros1.rig import Rig

FLEET = """
map: office
robots:
  - {name: east, start: [1.5, 7.45, 0.0]}
  - {name: west, start: [4.5, 7.45, 3.1416]}
"""
SCRIPT = """
import json, math, sys
import actionlib, rosgraph, rospy, tf
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from sensor_msgs.msg import LaserScan
rospy.init_node("client", disable_signals=True)
listener = tf.TransformListener()

def ahead():
    scan = rospy.wait_for_message("/west/scan", LaserScan)
    return scan.header.frame_id, scan.ranges[len(scan.ranges) // 2]

found = {"before": ahead()}
client = actionlib.SimpleActionClient("/east/move_base", MoveBaseAction)
client.wait_for_server()
goal = MoveBaseGoal()
goal.target_pose.header.frame_id = "map"
goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = 2.5, 7.45
goal.target_pose.pose.orientation.w = 1.0
found["end"] = client.send_goal_and_wait(goal)
found["after"] = ahead()
for name in ("east", "west"):
    listener.waitForTransform("map", name + "/base_laser_link", rospy.Time(0), rospy.Duration(100))
    found[name] = listener.lookupTransform("map", name + "/base_footprint", rospy.Time(0))[0][0]
publishers = dict(rosgraph.Master("/client").getSystemState()[0])
found["topics"] = sorted(publishers)
found["clocks"] = publishers["/clock"]
with open(sys.argv[1], "w") as out:
    json.dump(found, out)
rospy.signal_shutdown("done")
"""


def test_a_fleet_in_one_world(graph: Graph) -> None:
    """West's lidar, 0.1 m ahead of its center, sees how east's move_base drives it 1 m nearer."""
    rig, file, out = Rig(graph), graph.folder / "fleet.yaml", Path(graph.folder) / "found.json"
    file.write_text(FLEET)
    sim = rig.navstack("sim", str(file), "--clock", "--speed", paced(4.0))
    frames = {
        "global_costmap.robot_base_frame": "east/base_footprint",
        "local_costmap.global_frame": "east/odom",
        "local_costmap.robot_base_frame": "east/base_footprint",
    }
    wait_for(lambda: "/use_sim_time" in graph.run("/usr/bin/rosparam", "list") or sim.poll() is not None, "the clock")
    sets = (part for name, frame in frames.items() for part in ("--set", f"{name}={frame}"))
    rig.start_node("--params", "turtlebot", *sets, "__ns:=/east")
    script = graph.start(PYTHON, "-c", SCRIPT, str(out))
    assert script.wait(TIMEOUT_S) == 0, graph.log_of(script).read_text() + graph.log_of(sim).read_text()
    found = json.loads(out.read_text())
    assert found["end"] == 3 and found["clocks"] == ["/navstack_sim"]
    assert found["before"][0] == "west/base_laser_link"
    assert found["before"][1] == pytest.approx(3.0 - 0.1 - 0.2, abs=0.1)
    assert found["before"][1] - found["after"][1] == pytest.approx(1.0, abs=0.2)  # the tolerance of a goal
    assert found["east"] == pytest.approx(2.5, abs=0.2) and found["west"] == pytest.approx(4.5, abs=0.01)
    assert {"/east/scan", "/west/scan", "/west/map", "/tf", "/tf_static", "/west/amcl_pose"} <= set(found["topics"])
    assert not {"/scan", "/map", "/odom", "/amcl_pose"} & set(found["topics"])
