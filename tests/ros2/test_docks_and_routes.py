"""Docking, routes on a graph and assisted teleop over a real graph, with clients of rclpy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from navstack.routes import build_graph, save_graph
from tests.ros1.conftest import paced
from tests.ros2.conftest import FASTEST, Graph

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
DOCK = [7.6, 7.45, 0.0]
"""Beyond the lanes, which it would block."""
PARAMS: dict[str, Any] = {
    "docking_server": {
        "docks": ["home"],
        "home": {"pose": DOCK},
        "simple_charging_dock": {
            "use_external_detection_pose": True,
            "external_detection_translation_x": -0.25,
            "docking_threshold": 0.005,
            "filter_coef": 0.02,
        },
    },
    "navstack": {"sim": {"docks": ["home"], "home": {"pose": DOCK, "marker_x": 0.25}}},
}
DOCKING = """
from nav2_msgs.action import DockRobot, NavigateToPose, UndockRobot
from sensor_msgs.msg import BatteryState

dock, undock = Action(DockRobot, "dock_robot"), Action(UndockRobot, "undock_robot")
go = Action(NavigateToPose, "navigate_to_pose")
found["before"] = first(BatteryState, "battery_state", depth=5).current
status, result = dock.end(dock.send(DockRobot.Goal(use_dock_id=True, dock_id="home")))
found["docked"] = [status, result.success, result.error_code]
found["states"] = sorted({one.state for one in dock.feedback})
found["time"] = [dock.feedback[-1].docking_time.sec > 2, dock.feedback[-1].docking_time.sec < 200]
found["at"] = robot()
charging = []
node.create_subscription(BatteryState, "battery_state", lambda m: charging.append(m.current), qos(5))
spin(lambda: charging and charging[-1] > 0.5, "a charging current")
status, result = undock.end(undock.send(UndockRobot.Goal()))
found["undocked"] = [status, result.success, result.error_code]
found["out"] = robot()
found["unknown"] = dock.run(DockRobot.Goal(use_dock_id=True, dock_id="hom"))
_, result = dock.end(dock.send(DockRobot.Goal(use_dock_id=True, dock_id="hom")))
found["no success"] = result.success
found["type"] = undock.run(UndockRobot.Goal(dock_type="other"))

# a docking on the way to its staging pose is canceled, and replaced by a drive
handle = dock.send(DockRobot.Goal(use_dock_id=False, dock_pose=stamped(3.0, 7.45)))
spin(lambda: any(one.state == 1 for one in dock.feedback), "the way to the staging pose")
wait(handle.cancel_goal_async(), "cancel")
found["canceled"] = dock.end(handle)[0]
handle = dock.send(DockRobot.Goal(use_dock_id=False, dock_pose=stamped(3.0, 7.45)))
spin(lambda: any(one.state == 1 for one in dock.feedback), "the way to the staging pose")
answer = handle.get_result_async()
found["drive"] = go.run(NavigateToPose.Goal(pose=stamped(robot()[0], 7.45)))
replaced = wait(answer, "the end of the docking")
found["replaced"] = [replaced.status, replaced.result.error_msg, replaced.result.success]
"""
ROUTES = """
from nav2_msgs.action import ComputeAndTrackRoute, ComputeRoute, FollowPath
from nav2_msgs.msg import EdgeCost
from nav2_msgs.srv import DynamicEdges, SetRouteGraph
from visualization_msgs.msg import MarkerArray

edges, nodes = first(MarkerArray, "route_graph", latched=True).markers
found["markers"] = [len(edges.points), len(nodes.points), edges.header.frame_id]
route = Action(ComputeRoute, "compute_route")

def compute(goal):
    status, result = route.end(route.send(goal))
    nodes, edges = [n.nodeid for n in result.route.nodes], [e.edgeid for e in result.route.edges]
    return [status, result.error_code, nodes, edges, len(result.path.poses), result.error_msg]

found["by ids"] = compute(ComputeRoute.Goal(start_id=0, goal_id=3))
found["by poses"] = compute(ComputeRoute.Goal(use_poses=True, use_start=True, start=stamped(0.8, 7.4), goal=stamped(6.0, 7.4)))
found["no node"] = compute(ComputeRoute.Goal(start_id=0, goal_id=77))
found["no frame"] = compute(ComputeRoute.Goal(use_poses=True, goal=stamped(6.0, 7.4, frame="nowhere")))
found["nan"] = compute(ComputeRoute.Goal(use_poses=True, goal=stamped(float("nan"), 7.4)))
name = "route_server/DynamicEdgesScorer/adjust_edges"
found["close"] = call(DynamicEdges, name, DynamicEdges.Request(closed_edges=[5])).success
found["closed"] = compute(ComputeRoute.Goal(start_id=0, goal_id=3))[:2]
found["open"] = call(DynamicEdges, name, DynamicEdges.Request(opened_edges=[5])).success
found["no edge"] = call(DynamicEdges, name, DynamicEdges.Request(closed_edges=[9])).success

track = Action(ComputeAndTrackRoute, "compute_and_track_route")
follow = Action(FollowPath, "follow_path")
handle = track.send(ComputeAndTrackRoute.Goal(use_poses=True, goal=stamped(5.0, 7.4)))
tracked = handle.get_result_async()
spin(lambda: track.feedback, "the first feedback")
path = track.feedback[0].path
found["path"] = [len(path.poses) > 20, path.header.frame_id]
found["follow"] = follow.run(FollowPath.Goal(path=path))
answer = wait(tracked, "the end of the route")
found["tracked"] = [answer.status, answer.result.error_code, answer.result.execution_duration.sec > 2]
found["seen"] = [[one.last_node_id, one.next_node_id, one.current_edge_id] for one in track.feedback]
handle = track.send(ComputeAndTrackRoute.Goal(start_id=0, goal_id=3))
wait(handle.cancel_goal_async(), "cancel")
found["canceled"] = track.end(handle)[0]

service = "route_server/set_route_graph"
found["set nothing"] = call(SetRouteGraph, service, SetRouteGraph.Request(graph_filepath="/nowhere.geojson")).success
found["set high"] = call(SetRouteGraph, service, SetRouteGraph.Request(graph_filepath=sys.argv[3])).success
found["kept"] = compute(ComputeRoute.Goal(start_id=0, goal_id=3))[:2]
found["set"] = call(SetRouteGraph, service, SetRouteGraph.Request(graph_filepath=sys.argv[2])).success
found["other"] = compute(ComputeRoute.Goal(start_id=10, goal_id=11))[:3]
"""
TELEOP = """
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import TwistStamped
from nav2_msgs.action import AssistedTeleop
from std_msgs.msg import Empty

teleop = Action(AssistedTeleop, "assisted_teleop")
sticks = node.create_publisher(TwistStamped, "cmd_vel_teleop", 10)
ends = node.create_publisher(Empty, "preempt_teleop", 1)
spin(lambda: sticks.get_subscription_count() and ends.get_subscription_count(), "the subscribers")
push = TwistStamped()
push.twist.linear.x = -0.2
node.create_timer(0.02, lambda: sticks.publish(push))
at = robot()[0]
end = time.monotonic() + 1.0
spin(lambda: time.monotonic() > end, "a second")
found["alone"] = abs(robot()[0] - at)
handle = teleop.send(AssistedTeleop.Goal(time_allowance=Duration(sec=500)))
spin(lambda: robot()[0] < at - 0.3, "a drive by hand")
found["running"] = len(teleop.feedback) > 0
ends.publish(Empty())
found["end"] = teleop.end(handle)[0]
status, result = teleop.end(teleop.send(AssistedTeleop.Goal(time_allowance=Duration(sec=0, nanosec=200_000_000))))
found["too long"] = [status, result.error_code, result.error_msg]
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """A turtlebot in the office with a dock and a graph of routes."""
    folder = tmp_path_factory.mktemp("docks")
    points = {0: (1.0, 7.4), 1: (2.0, 7.4), 2: (4.0, 7.4), 3: (6.0, 7.4)}
    save_graph(build_graph(points, [(0, 1), (1, 2), (2, 3)]), folder / "lanes.geojson")
    save_graph(build_graph({10: (1.0, 7.4), 11: (4.0, 7.4)}, [(10, 11)]), folder / "other.geojson")
    save_graph(build_graph({70000: (1.0, 7.4), 1: (4.0, 7.4)}, [(70000, 1)]), folder / "high.geojson")
    more = folder / "more.yaml"
    more.write_text(yaml.safe_dump({**PARAMS, "route_server": {"graph_filepath": str(folder / "lanes.geojson")}}))
    graph = Graph(folder)
    try:
        params = ("--params", "turtlebot", "--params", str(more))
        graph.start_robot(("office", *params, "--start", "1.0,7.45", "--clock", "--speed", paced(FASTEST)), params)
        yield graph
    finally:
        graph.close()


def test_routes(robot: Graph) -> None:
    found = robot.ask(ROUTES, str(robot.folder / "other.geojson"), str(robot.folder / "high.geojson"))
    assert found["markers"] == [6, 4, "map"]
    status, code, nodes, edges, poses, _ = found["by ids"]
    assert [status, code, nodes, edges] == [SUCCEEDED, 0, [0, 1, 2, 3], [4, 5, 6]] and poses > 50
    assert found["by poses"][:3] == [SUCCEEDED, 0, [0, 1, 2, 3]]
    assert found["no node"][:2] == [ABORTED, 402] and "77" in found["no node"][5]
    assert found["no frame"][:2] == [ABORTED, 401] and "nowhere" in found["no frame"][5]
    assert found["nan"][0] == ABORTED and found["nan"][1] in (400, 403)
    assert found["close"] and found["closed"] == [ABORTED, 405] and found["open"] and not found["no edge"]
    assert found["path"] == [True, "map"] and found["follow"][:2] == [SUCCEEDED, 0]
    assert found["tracked"] == [SUCCEEDED, 0, True] and found["canceled"] == CANCELED
    assert 2 <= len(found["seen"]) < 12 and found["seen"][-1][0] >= 1  # at changes only
    assert not found["set nothing"] and not found["set high"] and found["kept"] == [SUCCEEDED, 0]
    assert found["set"] and found["other"] == [SUCCEEDED, 0, [10, 11]]
    assert "the graph has the id 70001" in robot.output()


def test_docking(robot: Graph) -> None:
    found = robot.ask(DOCKING)
    assert found["before"] <= 0.0
    assert found["docked"] == [SUCCEEDED, True, 0] and found["time"] == [True, True]
    assert {1, 3, 4} <= set(found["states"])  # the dock is detected between two messages of feedback
    assert found["at"] == pytest.approx(DOCK[:2], abs=0.03)
    assert found["undocked"] == [SUCCEEDED, True, 0]
    assert found["out"] == pytest.approx([DOCK[0] - 0.7, DOCK[1]], abs=0.1)
    assert found["unknown"][:2] == [ABORTED, 901] and 'did you mean "home"' in found["unknown"][2]
    assert not found["no success"]
    assert found["type"][:2] == [ABORTED, 902] and "other" in found["type"][2]
    assert found["canceled"] == CANCELED and found["drive"][:2] == [SUCCEEDED, 0]
    assert found["replaced"] == [ABORTED, "replaced by a goal of navigate_to_pose", False]


def test_assisted_teleop(robot: Graph) -> None:
    found = robot.ask(TELEOP)
    assert found["alone"] < 0.02  # without the action, nothing drives
    assert found["running"] and found["end"] == SUCCEEDED
    assert found["too long"][:2] == [ABORTED, 731] and "time_allowance" in found["too long"][2]
