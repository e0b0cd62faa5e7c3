"""Unchanged clients of ROS against our move_base node and our simulated robot."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from navstack.record import Record
from tests.ros1.conftest import PATIENT, PYTHON, TIMEOUT_S, new_graph, paced, wait_for
from tests.ros1.rig import Rig

CLIENT = """
import json, sys, rospy, actionlib, tf, tf2_ros
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal, MoveBaseActionFeedback
from actionlib_msgs.msg import GoalStatusArray, GoalID
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetMap, GetPlan
from std_srvs.srv import Empty
rospy.init_node("client", disable_signals=True)
found = {"counts": {}, "statuses": []}
def heard(message, name):
    found["counts"][name] = found["counts"].get(name, 0) + 1
    if name == "status" and message.status_list:
        seen = (message.status_list[-1].status, message.status_list[-1].text)
        if not found["statuses"] or tuple(found["statuses"][-1]) != seen:
            found["statuses"].append(seen)
    if name == "costmap":
        found["costmap"] = [message.info.width, message.info.height, sorted(set(message.data))[-1]]
kept = [rospy.Subscriber(topic, kind, heard, callback_args=name) for topic, kind, name in (
    ("/move_base/status", GoalStatusArray, "status"), ("/move_base/feedback", MoveBaseActionFeedback, "feedback"),
    ("/move_base/NavfnROS/plan", Path, "plan"), ("/move_base/DWAPlannerROS/local_plan", Path, "local_plan"),
    ("/move_base/current_goal", PoseStamped, "goal"), ("/move_base/global_costmap/costmap", OccupancyGrid, "costmap"))]
def goal(x, y, w=1.0, frame="map"):
    message = MoveBaseGoal()
    message.target_pose.header.frame_id, message.target_pose.header.stamp = frame, rospy.Time.now()
    message.target_pose.pose.position.x, message.target_pose.pose.position.y = x, y
    message.target_pose.pose.orientation.w = w
    return message
listener = tf.TransformListener()
buffer = tf2_ros.Buffer()
listener2 = tf2_ros.TransformListener(buffer)
client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
client.wait_for_server()
while not kept[4].get_num_connections():  # the first goal is published once
    rospy.rostime.wallsleep(0.05)
client.send_goal(goal(2.4, 7.45))
found["simple states"] = [client.simple_state]
client.wait_for_result()
found["simple states"].append(client.simple_state)
listener.waitForTransform("/map", "/base_footprint", rospy.Time(0), rospy.Duration(600))
found["tf"] = listener.lookupTransform("/map", "/base_footprint", rospy.Time(0))[0][:2]
found["tf2"] = buffer.lookup_transform("map", "base_laser_link", rospy.Time(0), rospy.Duration(600)).transform.translation.z
found["first"] = [client.get_state(), client.get_goal_status_text()]
plan = rospy.ServiceProxy("/move_base/make_plan", GetPlan)
start = goal(1.0, 7.45).target_pose
answer = plan(start, goal(6.0, 7.45).target_pose, 0.1).plan
found["plan"] = [len(answer.poses), answer.header.frame_id, answer.poses[0].header.frame_id]
rospy.ServiceProxy("/move_base/clear_costmaps", Empty)()
found["map"] = rospy.ServiceProxy("/static_map", GetMap)().map.info.width
client.send_goal(goal(8.0, 7.45))
while client.get_state() != actionlib.SimpleGoalState.ACTIVE and client.get_goal_status_text() == "":
    rospy.rostime.wallsleep(0.05)
client.cancel_goal()
client.wait_for_result()
found["canceled"] = [client.get_state(), client.get_goal_status_text()]
client.send_goal(goal(3.0, 7.45, w=0.0))
client.wait_for_result()
found["invalid"] = [client.get_state(), client.get_goal_status_text()]
with open(sys.argv[1], "w") as out:
    json.dump(found, out)
"""


GOAL = "{header: {frame_id: map}, pose: {position: {x: 1.6, y: 7.45}, orientation: {w: 1.0}}}"


@pytest.fixture(scope="module")
def nodes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """The simulated robot and the move_base node, without anything between them."""
    graph = new_graph(tmp_path_factory.mktemp("graph"))
    rig = Rig(graph)
    try:
        rig.start_sim("office", "--clock", "--speed", paced(2), relayed=False)
        graph.run("/usr/bin/rosparam", "set", "/move_base/controller_frequency", "10.0")
        record = str(graph.folder / "record")
        rig.start_node("--params", "turtlebot", *PATIENT, "--set", "controller_frequency=10.0", "--record", record)
        yield rig
    finally:
        rig.close()
        graph.close()


def test_clients_of_move_base(nodes: Rig, tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    bag = tmp_path / "drive.bag"
    wanted = ("/cmd_vel", "/tf", "/scan", "/move_base/status", "/move_base/feedback", "/move_base/result")
    record = nodes.graph.start("/usr/bin/rosbag", "record", "-O", str(bag), *wanted)
    client = nodes.graph.start(PYTHON, "-c", CLIENT, str(out))
    assert client.wait(TIMEOUT_S) == 0, nodes.output()
    found = json.loads(out.read_text())
    record.send_signal(signal.SIGINT)
    assert record.wait(TIMEOUT_S) == 0
    info = nodes.graph.run("/usr/bin/rosbag", "info", str(bag))
    assert all(re.search(rf"{topic} +\d+ msgs", info) for topic in wanted), info
    assert found["simple states"] == [0, 2]  # SimpleGoalState.PENDING, DONE
    assert abs(found["tf"][0] - 2.4) < 0.2 and abs(found["tf"][1] - 7.45) < 0.2
    assert found["tf2"] == pytest.approx(0.3)
    assert found["first"] == [3, "Goal reached."]
    assert found["plan"][0] > 10 and found["plan"][1:] == ["", "map"]
    assert found["map"] > 100
    assert found["canceled"] == [2, ""]
    assert found["invalid"] == [4, "Aborting on goal because it was sent with an invalid quaternion"]
    assert found["costmap"][2] == 100
    counts = found["counts"]
    assert counts["plan"] >= 2 and counts["local_plan"] > 5 and counts["feedback"] > 10 and counts["goal"] >= 2
    texts = [text for _, text in found["statuses"]]
    assert "This goal has been accepted by the simple action server" in texts
    assert [3, "Goal reached."] in found["statuses"]


def test_the_record_of_the_running_node(nodes: Rig, tmp_path: Path) -> None:
    folder = nodes.graph.folder / "record"
    nodes.graph.run("/usr/bin/rostopic", "pub", "-1", "/move_base_simple/goal", "geometry_msgs/PoseStamped", GOAL)

    def recorded() -> list[Record]:
        pieces = sorted(file.parent for file in folder.glob("2*/run.npz"))
        return [piece for piece in map(Record.load, pieces) if len(piece.goals) > 0]

    wait_for(lambda: len(recorded()) >= 1, "the record of a goal")
    record = recorded()[-1]
    assert record.results[-1]["state"] in ("SUCCEEDED", "ABORTED", "PREEMPTED")
    assert len(record.samples) > 5 and len(record.plans) >= 1
    assert (folder / "latest").resolve() == sorted(folder.glob("2*/run.npz"))[-1].parent


def test_shell_tools(nodes: Rig) -> None:
    graph = nodes.graph
    topics = graph.run("/usr/bin/rostopic", "list").split()
    for name in ("goal", "cancel", "status", "feedback", "result", "current_goal", "recovery_status"):
        assert f"/move_base/{name}" in topics
    assert {"/cmd_vel", "/odom", "/scan", "/map", "/move_base_simple/goal", "/tf", "/clock"} <= set(topics)
    services = graph.run("/usr/bin/rosservice", "list").split()
    for name in ("make_plan", "clear_costmaps", "NavfnROS/make_plan"):
        assert f"/move_base/{name}" in services
    assert graph.run("/usr/bin/rosservice", "type", "/move_base/make_plan").strip() == "nav_msgs/GetPlan"
    graph.run("/usr/bin/rosservice", "call", "/move_base/clear_costmaps")
    assert float(graph.run("/usr/bin/rosparam", "get", "/move_base/DWAPlannerROS/max_vel_x")) == 0.5
    info = graph.run("/usr/bin/rosnode", "info", "/move_base")
    assert re.search(r"/move_base/local_costmap/costmap \[nav_msgs/OccupancyGrid\]", info)


def test_node_without_a_master(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from navstack.cli.app import run

    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert run(["ros1", "move_base"]) == 2
    message = " ".join(capfd.readouterr().err.split())
    assert "no ROS master at http://127.0.0.1:9" in message or "ROS 1 is not installed" in message


RECONFIGURE = """
import json, sys, rospy
from dynamic_reconfigure.client import Client
rospy.init_node("client", disable_signals=True)
found = {}
planner = Client("/move_base/DWAPlannerROS", timeout=30)
found["before"] = planner.get_configuration()["max_vel_x"]
found["after"] = planner.update_configuration({"max_vel_x": 0.25})["max_vel_x"]
found["clamped"] = planner.update_configuration({"path_distance_bias": -5.0})["path_distance_bias"]
found["server"] = rospy.get_param("/move_base/DWAPlannerROS/max_vel_x")
found["restored"] = planner.update_configuration({"restore_defaults": True})["max_vel_x"]
layer = Client("/move_base/local_costmap/inflation_layer", timeout=30)
found["layer"] = layer.update_configuration({"inflation_radius": 0.7})["inflation_radius"]
found["node"] = Client("/move_base", timeout=30).update_configuration({"planner_frequency": 2.0})["planner_frequency"]
found["types"] = sorted({p["type"] for p in planner.get_parameter_descriptions()})
with open(sys.argv[1], "w") as out:
    json.dump(found, out)
"""


def test_dynamic_reconfigure(nodes: Rig, tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    assert nodes.graph.start(PYTHON, "-c", RECONFIGURE, str(out)).wait(TIMEOUT_S) == 0, nodes.output()
    found = json.loads(out.read_text())
    assert found["after"] == found["server"] == 0.25 and found["before"] == found["restored"] != 0.25
    assert found["clamped"] == 0.0
    assert found["layer"] == 0.7 and found["node"] == 2.0
    assert {"bool", "double", "int"} <= set(found["types"])


GOODBYE = """
import sys, rospy, actionlib
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
rospy.init_node("client", disable_signals=True)
twists = []
kept = rospy.Subscriber("/cmd_vel", Twist, twists.append)
client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
client.wait_for_server()
goal = MoveBaseGoal()
goal.target_pose.header.frame_id = "map"
goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = 8.0, 7.45
goal.target_pose.pose.orientation.w = 1.0
client.send_goal(goal)
while not any(twist.linear.x > 0.05 for twist in twists):
    rospy.rostime.wallsleep(0.05)
open(sys.argv[1], "w").close()
client.wait_for_result()
while twists[-1].linear.x != 0.0:
    rospy.rostime.wallsleep(0.05)
with open(sys.argv[2], "w") as out:
    out.write("%d %s" % (client.get_state(), client.get_goal_status_text()))
"""


def test_end_of_the_node_stops_the_robot_and_aborts_the_goal(nodes: Rig, tmp_path: Path) -> None:
    driving, ended = tmp_path / "driving", tmp_path / "ended"
    client = nodes.graph.start(PYTHON, "-c", GOODBYE, str(driving), str(ended))
    wait_for(driving.exists, "the start of the robot")
    assert nodes.node is not None
    nodes.node.terminate()
    assert nodes.node.wait(TIMEOUT_S) == 0
    assert client.wait(TIMEOUT_S) == 0, nodes.output()
    assert ended.read_text() == "4 Aborting on the goal because the node has been killed"
