"""The navigator with Nav2's own parameter file, with costmap filters by topic, and without nav2_msgs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from navstack.core import data_folder
from tests.conftest import SHARED
from tests.ros1.conftest import paced
from tests.ros2.conftest import FASTEST, Graph

NAV2 = """
from geometry_msgs.msg import Pose
from rcl_interfaces.msg import Log
from builtin_interfaces.msg import Duration
from nav_msgs.msg import OccupancyGrid, Odometry
from nav2_msgs.action import ComputePathToPose, NavigateToPose, Spin
from nav2_msgs.msg import CostmapFilterInfo
from nav2_msgs.srv import GetCosts
from std_msgs.msg import Bool

def costs(*poses):
    request = GetCosts.Request(use_footprint=False, poses=[stamped(*pose) for pose in poses])
    return list(call(GetCosts, "global_costmap/get_cost_global_costmap", request).costs)

def mask(topic, kind, value, multiplier=1.0):
    info = node.create_publisher(CostmapFilterInfo, topic + "_info", qos(latched=True))
    grid = node.create_publisher(OccupancyGrid, topic + "_mask", qos(latched=True))
    info.publish(CostmapFilterInfo(type=kind, filter_mask_topic=topic + "_mask", base=0.0, multiplier=multiplier))
    message = OccupancyGrid()
    message.header.frame_id = "map"
    message.info.resolution, message.info.width, message.info.height = 0.5, 4, 8
    message.info.origin = Pose()
    message.info.origin.position.x, message.info.origin.position.y = 5.0, 5.5
    message.data = [value] * 32
    grid.publish(message)
    return info, grid

found["free"] = costs((6.0, 7.45), (3.0, 7.45))
states = []
node.create_subscription(Bool, "binary_state", lambda m: states.append(m.data), qos(latched=True))
go = Action(NavigateToPose, "navigate_to_pose")
found["go"] = go.run(NavigateToPose.Goal(pose=stamped(4.6, 7.45)))
said = []
node.create_subscription(Log, "/rosout", lambda m: said.append(m.msg), qos(1000, latched=True))
wrong = mask("light", 1, 100)
spin(lambda: any("/light_info is of type 1" in text for text in said), "the refusal")  # the newest message counts
binary = mask("light", 3, 100)
found["through"] = go.run(NavigateToPose.Goal(pose=stamped(5.5, 7.45)))
spin(lambda: states and states[-1], "the state in the mask of the binary filter")
found["back"] = go.run(NavigateToPose.Goal(pose=stamped(4.6, 7.45)))
spin(lambda: not states[-1], "the state outside of the mask")
keepout = mask("keepout", 0, 100)
spin(lambda: costs((6.0, 7.45))[0] >= 254.0, "the keepout mask in the costmap")
found["beside"] = costs((3.0, 7.45))
turns = []
node.create_subscription(Odometry, "odom", lambda m: turns.append(m.twist.twist.angular.z), 10)
found["spin"] = Action(Spin, "spin").run(Spin.Goal(target_yaw=0.5, time_allowance=Duration(sec=100)))[0]
found["turned at"] = max(turns)
plan = Action(ComputePathToPose, "compute_path_to_pose")
found["plan"] = plan.run(ComputePathToPose.Goal(goal=stamped(6.0, 7.45)))[:2]
"""
WITHOUT = """
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path

goals = node.create_publisher(PoseStamped, "goal_pose", 1)
spin(lambda: goals.get_subscription_count(), "a subscriber of goal_pose")
plans = []
node.create_subscription(Path, "plan", plans.append, 10)
goals.publish(stamped(2.5, 7.45))
spin(lambda: abs(robot()[0] - 2.5) < 0.3, "the goal")
found["plans"] = len(plans) > 0
found["costmap"] = 100 in first(OccupancyGrid, "global_costmap/costmap", latched=True).data
found["services"] = [name for name, _ in node.get_service_names_and_types_by_node("navigator", "/")]
"""


def with_filters(folder: Path) -> Path:
    """Return a copy of Nav2's parameters with a keepout and a binary filter by topic."""
    whole = SHARED / "data" / "nav2_params" / "nav2_bringup" / "nav2_bringup_jazzy.yaml"
    packaged = data_folder("params") / "nav2_turtlebot" / "nav2_params.yaml"
    content: dict[str, Any] = yaml.safe_load((whole if whole.is_file() else packaged).read_text())
    costmap = content["global_costmap"]["global_costmap"]["ros__parameters"]
    costmap["filters"] = ["keepout_filter", "binary_filter"]
    for name, topic in (("keepout", "/keepout_info"), ("binary", "/light_info")):
        plugin = f"nav2_costmap_2d::{name.capitalize()}Filter"
        costmap[f"{name}_filter"] = {"plugin": plugin, "enabled": True, "filter_info_topic": topic}
    content["behavior_server"]["ros__parameters"]["max_rotational_vel"] = 0.4
    file = folder / "nav2_params.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def test_nav2s_parameters_and_costmap_filters_by_topic(tmp_path: Path) -> None:
    graph = Graph(tmp_path)
    try:
        params = str(with_filters(tmp_path))
        where = ("office", "--params", params, "--start", "3.8,7.45", "--clock", "--speed", paced(FASTEST))
        navigator = graph.start_robot(where, ("--params", params))[1]
        found = graph.ask(NAV2)
        assert max(found["free"]) < 253.0
        assert found["go"][:2] == found["through"][:2] == found["back"][:2] == [4, 0]
        assert "/light_info is of type 1, which is not for" in graph.log_of(navigator)
        assert found["spin"] == 4 and 0.2 < found["turned at"] < 0.45  # the max_rotational_vel of behavior_server
        assert found["beside"][0] < 253.0 and found["plan"] == [6, 208]
    finally:
        graph.close()


def test_without_nav2_msgs(tmp_path: Path) -> None:
    """One sentence says what works and what does not; the robot drives by goal_pose."""
    graph = Graph(tmp_path)
    hidden = tmp_path / "hidden" / "nav2_msgs"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").write_text("raise ImportError('hidden')\n")
    path = graph.environment.variables(0)["PYTHONPATH"]
    try:
        hiding = os.pathsep.join((str(hidden.parent), path))
        where = ("office", "--clock", "--speed", paced(FASTEST))
        navigator = graph.start_robot(where, ("--params", "turtlebot"), PYTHONPATH=hiding)[1]
        found = graph.ask(WITHOUT)
        assert found["plans"] and found["costmap"]
        assert not [name for name in found["services"] if "costmap" in name]
        log = graph.log_of(navigator)
        assert "nav2_msgs is missing, so there are no actions" in log
        assert "goal_pose, costmaps, plans, parameters and cmd_vel work" in log and "Traceback" not in log
    finally:
        graph.close()
