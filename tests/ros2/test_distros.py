"""Clients and servers of different distributions, several robots, and parameters of ROS.

Spin, BackUp and NavigateThroughPoses have other fields from Kilted on: their clients and servers must be of one distribution.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.ros1.conftest import paced
from tests.ros2.conftest import FASTEST, Graph, new_environment

GO = """
from nav2_msgs.action import NavigateToPose
from nav2_msgs.srv import ClearEntireCostmap
go = Action(NavigateToPose, "navigate_to_pose")
handle = go.send(NavigateToPose.Goal(pose=stamped(float(sys.argv[2]), 7.45)))
status, result = go.end(handle)
found["go"] = [status, result.error_code]
found["feedback"] = len(go.feedback) > 3
found["bad"] = go.run(NavigateToPose.Goal(pose=stamped(600.0, 7.45)))[:2]
handle = go.send(NavigateToPose.Goal(pose=stamped(11.0, 7.4)))
spin(lambda: go.feedback, "feedback")
wait(handle.cancel_goal_async(), "cancel")
found["canceled"] = go.end(handle)[0]
call(ClearEntireCostmap, "local_costmap/clear_entirely_local_costmap", ClearEntireCostmap.Request())
found["cleared"] = True
found["cmd_vel"] = node.get_publishers_info_by_topic("/cmd_vel")[0].topic_type
"""
TWO = """
from nav2_msgs.action import NavigateToPose
robots = [Action(NavigateToPose, f"{name}/navigate_to_pose") for name in ("robot1", "robot2")]
goals = [stamped(2.0, 7.45), stamped(9.0, 7.4)]
handles = [robot.send(NavigateToPose.Goal(pose=goal)) for robot, goal in zip(robots, goals)]
found["ends"] = [robot.end(handle)[0] for robot, handle in zip(robots, handles)]
found["nodes"] = sorted(f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces() if name != "client")
found["topics"] = [bool(node.get_publishers_info_by_topic(f"/{name}/cmd_vel")) for name in ("robot1", "robot2")]
"""

FLEET = """
map: office
robots:
  - {name: east, start: [1.5, 7.45, 0.0]}
  - {name: west, start: [4.5, 7.45, 3.1416]}
"""
OF_FLEET = """
from nav2_msgs.action import NavigateToPose
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage
from std_srvs.srv import Empty
def ahead():
    scan = first(LaserScan, "west/scan", reliable=False)
    return scan.ranges[len(scan.ranges) // 2]
found["before"] = ahead()
go = Action(NavigateToPose, "east/navigate_to_pose")
found["end"] = go.run(NavigateToPose.Goal(pose=stamped(2.5, 7.45)))[0]
found["after"] = ahead()
found["frames"] = sorted({t.child_frame_id for t in first(TFMessage, "west/tf", depth=10).transforms})
topics = dict(node.get_topic_names_and_types())
found["topics"] = sorted(topics)
found["clocks"] = len(node.get_publishers_info_by_topic("/clock"))
found["nodes"] = sorted(f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces() if name != "client")
call(Empty, "east/reset_positions", Empty.Request())
spin(lambda: abs(ahead() - found["before"]) < 0.05, "the robot at its start")
"""


def test_a_client_of_jazzy_and_a_server_of_kilted(office: Graph) -> None:
    found = office.ask(GO, "3.0", of=new_environment("jazzy"))
    assert found["go"] == [4, 0] and found["feedback"]
    assert found["bad"] == [6, 204] and found["canceled"] == 5 and found["cleared"]


def test_jazzy(tmp_path: Path) -> None:
    """The nodes run with Jazzy: Twist, poses in a list; a client of Kilted drives them. A misspelt parameter is reported."""
    graph = Graph(tmp_path, "jazzy")
    try:
        where = ("office", "--clock", "--speed", paced(FASTEST))
        misspelt = ("--params", "turtlebot", "--ros-args", "-p", "DWAPlannerROS.sim_tme:=2.0")
        navigator = graph.start_robot(where, misspelt)[1]
        found = graph.ask(GO, "2.0", of=new_environment("kilted"))
        assert found["cmd_vel"] == "geometry_msgs/msg/Twist"
        assert "did you mean sim_time" in " ".join(graph.log_of(navigator).split())
        assert found["go"] == [4, 0] and found["bad"] == [6, 204] and found["canceled"] == 5 and found["cleared"]
    finally:
        graph.close()


def test_two_robots(tmp_path: Path) -> None:
    """Each robot in a namespace, with the frames and the tf of its own, on one clock."""
    graph = Graph(tmp_path)
    try:
        tf = ("-r", "/tf:=tf", "-r", "/tf_static:=tf_static")
        first, second = ("--ros-args", "-r", "__ns:=/robot1", *tf), ("--ros-args", "-r", "__ns:=/robot2", *tf)
        other = graph.navstack("sim", "office", "--start", "8.0,7.4", *second, "-p", "use_sim_time:=true")
        params = ("--params", "turtlebot")
        where = ("office", "--clock", "--start", "1.0,7.45", "--speed", paced(2.0))
        graph.start_robot((*where, *first), (*params, *first), (*params, *second))
        graph.wait_for_text(other, "the simulated robot is ready")
        found = graph.ask(TWO)
        assert found["ends"] == [4, 4] and found["topics"] == [True, True]
        assert "another node is called" not in graph.output()
        assert {"/robot1/navigator", "/robot2/navigator", "/robot1/navstack_sim", "/robot2/navstack_sim"} <= set(
            found["nodes"]
        )
    finally:
        graph.close()


def test_a_fleet_in_one_world(tmp_path: Path) -> None:
    """One program simulates both: west's lidar, 0.1 m ahead of its center, sees how east's navigator drives it 1 m nearer."""
    graph, file = Graph(tmp_path), tmp_path / "fleet.yaml"
    file.write_text(FLEET)
    try:
        east = ("--ros-args", "-r", "__ns:=/east", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static")
        where = (str(file), "--clock", "--speed", paced(FASTEST))
        graph.start_robot(where, ("--params", "turtlebot", *east), ready="the simulated robots east, west are ready")
        found = graph.ask(OF_FLEET)
    finally:
        graph.close()
    assert found["end"] == 4 and found["clocks"] == 1
    assert found["before"] == pytest.approx(3.0 - 0.1 - 0.2, abs=0.1)
    assert found["before"] - found["after"] == pytest.approx(1.0, abs=0.2)  # the tolerance of a goal
    assert {"/east/scan", "/west/scan", "/west/map", "/east/tf_static", "/west/amcl_pose", "/clock"} <= set(
        found["topics"]
    )
    assert not {"/scan", "/tf", "/map", "/odom"} & set(found["topics"])
    assert found["frames"] == ["base_footprint", "odom"]
    assert found["nodes"] == ["/east/navigator", "/navstack_sim"]
