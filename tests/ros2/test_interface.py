"""Topics with types and quality of service, services, late joiners, parameters and life cycle of the nodes."""

from __future__ import annotations

from typing import Any

import pytest

from tests.ros2.conftest import Graph

GRAPH = """
from nav_msgs.msg import OccupancyGrid, Path
from nav2_msgs.msg import Costmap, ParticleCloud
from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
from sensor_msgs.msg import BatteryState, Imu, LaserScan
from nav2_msgs.action import NavigateToPose

Action(NavigateToPose, "navigate_to_pose")
spin(lambda: {"navigator", "navstack_sim"} <= set(node.get_node_names()), "both nodes")

def quality(topic):
    infos = node.get_publishers_info_by_topic(topic)
    profile = infos[0].qos_profile
    return [infos[0].topic_type, "R" if profile.reliability == ReliabilityPolicy.RELIABLE else "B",
            "T" if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL else "V"]

names = ["/map", "/scan", "/odom", "/tf", "/tf_static", "/clock", "/cmd_vel", "/plan", "/local_plan", "/imu", "/battery_state",
         "/local_costmap/costmap", "/global_costmap/costmap", "/global_costmap/costmap_raw", "/global_costmap/costmap_updates",
         "/local_costmap/published_footprint", "/amcl_pose", "/particle_cloud", "/global_costmap/costmap_raw_updates",
         "/route_graph", "/marker", "/transformed_global_plan", "/bond"]
spin(lambda: all(node.get_publishers_info_by_topic(name) for name in names), "publishers")
found["topics"] = {name: quality(name) for name in names}
inputs = ("/goal_pose", "/speed_limit", "/initialpose", "/cmd_vel", "/local_costmap/footprint", "/cmd_vel_teleop",
          "/preempt_teleop", "/battery_state")
spin(lambda: all(node.get_subscriptions_info_by_topic(name) for name in inputs), "subscribers")
def services(of):
    return {name for name, _ in node.get_service_names_and_types_by_node(of, "/")}

wanted = {"navigator": {"/global_costmap/clear_entirely_global_costmap", "/is_path_valid", "/navigator/change_state",
                        "/bt_navigator/get_state"},
          "navstack_sim": {"/map_server/load_map", "/amcl/get_state"}}
for of, names in wanted.items():
    spin(lambda: names <= services(of), "services of " + of)
found["subscribed"] = {name: len(node.get_subscriptions_info_by_topic(name)) for name in inputs}

# a late subscriber gets the map and both costmaps
grid = first(OccupancyGrid, "map", latched=True)
found["map"] = [grid.info.width, grid.info.height, grid.header.frame_id, 100 in grid.data]
costmap = first(OccupancyGrid, "global_costmap/costmap", latched=True)
found["costmap"] = [costmap.info.width == grid.info.width, costmap.header.frame_id, 100 in costmap.data, max(costmap.data)]
raw = first(Costmap, "global_costmap/costmap_raw", latched=True)
found["raw"] = [raw.metadata.size_x == grid.info.width, max(raw.data) >= 254, len(raw.data) == len(costmap.data)]
local = first(OccupancyGrid, "local_costmap/costmap", latched=True)
found["local"] = [local.header.frame_id, local.info.width > 10]
found["footprint"] = len(first(PolygonStamped, "local_costmap/published_footprint").polygon.points)
scan = first(LaserScan, "scan", depth=5, reliable=False)
found["scan"] = [len(scan.ranges) > 50, scan.header.frame_id]
found["battery"] = first(BatteryState, "battery_state", depth=5).present
found["imu"] = first(Imu, "imu", depth=5).linear_acceleration.z
found["pose"] = first(PoseWithCovarianceStamped, "amcl_pose", latched=True).header.frame_id
found["particles"] = len(first(ParticleCloud, "particle_cloud", reliable=False).particles)
"""
SERVICES = """
from geometry_msgs.msg import Point32, Polygon, PoseWithCovarianceStamped
from nav_msgs.srv import GetMap
from nav2_msgs.msg import SpeedLimit
from nav2_msgs.srv import ClearCostmapAroundRobot, ClearCostmapExceptRegion, ClearEntireCostmap, GetCostmap, GetCosts
from nav2_msgs.srv import IsPathValid, LoadMap, SetInitialPose
from nav2_msgs.action import ComputePathToPose, NavigateToPose
from nav_msgs.msg import Odometry, Path

for name in ("local_costmap", "global_costmap"):
    call(ClearEntireCostmap, f"{name}/clear_entirely_{name}", ClearEntireCostmap.Request())
    call(ClearCostmapAroundRobot, f"{name}/clear_around_{name}", ClearCostmapAroundRobot.Request(reset_distance=1.0))
    call(ClearCostmapExceptRegion, f"{name}/clear_except_{name}", ClearCostmapExceptRegion.Request(reset_distance=1.0))
costmap = call(GetCostmap, "global_costmap/get_costmap", GetCostmap.Request()).map
found["costmap"] = [costmap.header.frame_id, len(costmap.data) == costmap.metadata.size_x * costmap.metadata.size_y]
costs = call(GetCosts, "global_costmap/get_cost_global_costmap",
             GetCosts.Request(use_footprint=False, poses=[stamped(3.0, 7.45), stamped(600.0, 0.0)]))
found["costs"] = [list(costs.costs), costs.success]
plan = Action(ComputePathToPose, "compute_path_to_pose")
_, result = plan.end(plan.send(ComputePathToPose.Goal(goal=stamped(6.0, 7.45))))
found["valid"] = call(IsPathValid, "is_path_valid", IsPathValid.Request(path=result.path, max_cost=254)).is_valid
wall = Path()
wall.header.frame_id = "map"
wall.poses = [stamped(3.0, 7.45 + 0.1 * i) for i in range(60)]
answer = call(IsPathValid, "is_path_valid", IsPathValid.Request(path=wall, max_cost=254))
found["through a wall"] = [answer.is_valid, len(answer.invalid_pose_indices)]
grid = call(GetMap, "map_server/map", GetMap.Request()).map
answer = call(LoadMap, "map_server/load_map", LoadMap.Request(map_url=sys.argv[2]))
found["load map"] = [answer.result, answer.map.info.width == grid.info.width]
found["load nothing"] = call(LoadMap, "map_server/load_map", LoadMap.Request(map_url="/nowhere/map.yaml")).result

request = ClearCostmapAroundRobot.Request(reset_distance=float("nan"))
call(ClearCostmapAroundRobot, "local_costmap/clear_around_local_costmap", request)
place = PoseWithCovarianceStamped()
place.header.frame_id = "map"
place.pose.pose = stamped(1.4, 7.45).pose
call(SetInitialPose, "set_initial_pose", SetInitialPose.Request(pose=place))
spin(lambda: abs(robot()[0] - 1.4) < 0.05, "the pose of the service")

# poses and goals of RViz
poses = node.create_publisher(PoseWithCovarianceStamped, "initialpose", 1)
spin(lambda: poses.get_subscription_count(), "a subscriber of initialpose")
message = PoseWithCovarianceStamped()
message.header.frame_id = "map"
message.pose.pose = stamped(1.0, 7.45).pose
poses.publish(message)
spin(lambda: abs(robot()[0] - 1.0) < 0.05, "the initial pose")
goals = node.create_publisher(type(stamped(0.0, 0.0)), "goal_pose", 1)
spin(lambda: goals.get_subscription_count(), "a subscriber of goal_pose")
goals.publish(stamped(2.0, 7.45))
spin(lambda: abs(robot()[0] - 2.0) < 0.25, "the goal of RViz")

# the speed is limited by a topic, in percent
limits = node.create_publisher(SpeedLimit, "speed_limit", 10)
spin(lambda: limits.get_subscription_count(), "a subscriber of speed limits")
go = Action(NavigateToPose, "navigate_to_pose")

def fastest(x):
    speeds = []
    listening = node.create_subscription(Odometry, "odom", lambda m: speeds.append(m.twist.twist.linear.x), 10)
    go.run(NavigateToPose.Goal(pose=stamped(x, 7.45)))
    node.destroy_subscription(listening)
    return max(speeds)

free = fastest(3.2)
limits.publish(SpeedLimit(percentage=True, speed_limit=50.0))
slow = fastest(4.2)
limits.publish(SpeedLimit(percentage=False, speed_limit=0.0))
found["speeds"] = [free, slow, fastest(5.4)]
found["placed"] = True
"""
PARAMETERS = """
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rcl_interfaces.msg import Parameter as Message, ParameterValue, ParameterType

def double(name, value):
    return Message(name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value))

RADIUS, SIM = "local_costmap.inflation_layer.inflation_radius", "DWAPlannerROS.sim_time"
listed = call(ListParameters, "navigator/list_parameters", ListParameters.Request()).result.names
found["listed"] = [len(listed) > 100, RADIUS in listed, SIM in listed, "use_sim_time" in listed]

def value(name):
    return call(GetParameters, "navigator/get_parameters", GetParameters.Request(names=[name])).values[0].double_value

def change(*items):
    answer = call(SetParameters, "navigator/set_parameters", SetParameters.Request(parameters=list(items)))
    return [[one.successful, one.reason] for one in answer.results]

text = call(DescribeParameters, "navigator/describe_parameters", DescribeParameters.Request(names=[RADIUS])).descriptors[0]
found["described"] = bool(text.description)
found["change"] = change(double(RADIUS, 0.44))
found["changed"] = value(RADIUS)
found["out of range"] = change(double(SIM, -1.0))
found["kept"] = value(SIM)
found["fixed"] = change(Message(name="local_costmap.global_frame",
                                value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="other")))
found["other type"] = change(Message(name=SIM, value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="x")))
found["of the node"] = change(Message(name="odom_topic", value=ParameterValue(type=ParameterType.PARAMETER_STRING,
                                                                              string_value="other")))
found["unknown"] = change(double("DWAPlannerROS.sim_tme", 2.0))
both = SetParametersAtomically.Request(parameters=[double(RADIUS, 0.5), double(SIM, -1.0)])
answer = call(SetParametersAtomically, "navigator/set_parameters_atomically", both).result
found["atomic"] = [answer.successful, value(RADIUS)]
"""
LIFE_CYCLE = """
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from nav2_msgs.srv import ManageLifecycleNodes
from std_srvs.srv import Trigger
from nav2_msgs.action import NavigateToPose

def state(name="navigator"):
    return call(GetState, f"{name}/get_state", GetState.Request()).current_state.label

def change(number):
    request = ChangeState.Request(transition=Transition(id=number))
    return call(ChangeState, "navigator/change_state", request).success

go = Action(NavigateToPose, "navigate_to_pose")
goal = NavigateToPose.Goal(pose=stamped(11.0, 7.4))
spin(lambda: state() == "active", "the active state")
found["parts"] = [state(name) for name in ("bt_navigator", "planner_server", "controller_server", "amcl", "map_server")]
states = call(GetAvailableStates, "navigator/get_available_states", GetAvailableStates.Request()).available_states
found["states"] = {"unconfigured", "inactive", "active", "finalized"} <= {one.label for one in states}
moves = call(GetAvailableTransitions, "navigator/get_available_transitions", GetAvailableTransitions.Request())
found["transitions"] = sorted(one.transition.label for one in moves.available_transitions)

# as RViz's panel of Nav2
def manage(command):
    name = "lifecycle_manager_navigation/manage_nodes"
    return call(ManageLifecycleNodes, name, ManageLifecycleNodes.Request(command=command)).success

def is_active(name):
    return call(Trigger, f"lifecycle_manager_{name}/is_active", Trigger.Request()).success

found["managed"] = [is_active("navigation"), is_active("localization"), manage(ManageLifecycleNodes.Request.STARTUP)]
found["paused"] = [manage(ManageLifecycleNodes.Request.PAUSE), is_active("navigation"), state()]
found["reset"] = [manage(ManageLifecycleNodes.Request.RESUME), manage(ManageLifecycleNodes.Request.RESET), state()]
found["started"] = [manage(ManageLifecycleNodes.Request.STARTUP), is_active("navigation"), manage(77)]
handle = go.send(goal)
spin(lambda: go.feedback, "feedback")
found["deactivate"] = [change(Transition.TRANSITION_DEACTIVATE), state(), state("bt_navigator")]
found["goal"] = go.end(handle)[0]
found["rejected"] = go.run(goal)
found["cleanup"] = [change(Transition.TRANSITION_CLEANUP), state()]
found["not allowed"] = change(Transition.TRANSITION_ACTIVATE)
found["again"] = [change(Transition.TRANSITION_CONFIGURE), change(Transition.TRANSITION_ACTIVATE), state()]
found["accepted"] = go.run(NavigateToPose.Goal(pose=stamped(robot()[0], 7.45)))[:2]
"""
BOND = """
from bond.msg import Status
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

# as bondcpp does for lifecycle_manager with a bond_timeout of 4 s
out = node.create_publisher(Status, "bond", qos(5))
heard = []
node.create_subscription(Status, "bond", lambda m: heard.append((time.monotonic(), m)), qos(100))
spin(lambda: out.get_subscription_count() > 1 and node.count_publishers("bond") > 1, "the other side")

def change(number):
    request = ChangeState.Request(transition=Transition(id=number))
    return call(ChangeState, "navigator/change_state", request).success

def alive(begin):
    return [m for t, m in heard if t >= begin and m.id == "navigator" and m.instance_id != "manager" and m.active]

def ended(begin):
    return [m for t, m in heard if t >= begin and m.instance_id != "manager" and not m.active]

def say(active, begin=0.0):
    out.publish(Status(id="navigator", instance_id="manager", active=active, heartbeat_timeout=4.0, heartbeat_period=0.1))

change(Transition.TRANSITION_DEACTIVATE)
begin = time.monotonic()
change(Transition.TRANSITION_ACTIVATE)
activated = time.monotonic()
spin(lambda: alive(begin), "a heartbeat")
found["formed after"] = time.monotonic() - activated
say(True)

def of_newest():  # the last heartbeats of the bond of before may arrive late
    newest = alive(begin)[-1].instance_id
    first = next(n for n, (_, m) in enumerate(heard) if m.instance_id == newest)
    return [(t, m) for t, m in heard[first:] if m.instance_id != "manager"]

spin(lambda: len(of_newest()) > 20, "heartbeats")
beats = of_newest()
found["beats"] = [len({m.instance_id for _, m in beats}), len(beats), beats[-1][0] - beats[0][0]]
found["message"] = [beats[0][1].heartbeat_timeout, beats[0][1].heartbeat_period]
now = time.monotonic()
say(False)
spin(lambda: ended(now), "the answer to the end of the manager")
count = len(heard)
end = time.monotonic() + 0.5
spin(lambda: time.monotonic() > end, "half a second")
found["after the end"] = len(heard) - count
change(Transition.TRANSITION_DEACTIVATE)
begin = time.monotonic()
found["again"] = change(Transition.TRANSITION_ACTIVATE)
spin(lambda: alive(begin), "another bond")
found["others"] = len({m.instance_id for _, m in heard if m.instance_id != "manager"})
now = time.monotonic()
change(Transition.TRANSITION_DEACTIVATE)
spin(lambda: ended(now), "the end of the node's side")
change(Transition.TRANSITION_ACTIVATE)
"""


def test_topics_and_late_joiners(office: Graph) -> None:
    found = office.ask(GRAPH)
    topics = found["topics"]
    assert topics["/map"] == ["nav_msgs/msg/OccupancyGrid", "R", "T"]
    assert topics["/scan"] == ["sensor_msgs/msg/LaserScan", "B", "V"]
    assert topics["/odom"] == ["nav_msgs/msg/Odometry", "R", "V"]
    assert topics["/tf"] == ["tf2_msgs/msg/TFMessage", "R", "V"] and topics["/tf_static"][1:] == ["R", "T"]
    assert topics["/clock"] == ["rosgraph_msgs/msg/Clock", "R", "V"]
    assert topics["/cmd_vel"] == ["geometry_msgs/msg/TwistStamped", "R", "V"]
    assert topics["/plan"] == topics["/local_plan"] == ["nav_msgs/msg/Path", "R", "V"]
    for name in ("/local_costmap/costmap", "/global_costmap/costmap"):
        assert topics[name] == ["nav_msgs/msg/OccupancyGrid", "R", "T"]
    assert topics["/global_costmap/costmap_raw"] == ["nav2_msgs/msg/Costmap", "R", "T"]
    assert topics["/global_costmap/costmap_updates"] == ["map_msgs/msg/OccupancyGridUpdate", "R", "T"]
    assert topics["/local_costmap/published_footprint"] == ["geometry_msgs/msg/PolygonStamped", "R", "V"]
    assert topics["/global_costmap/costmap_raw_updates"] == ["nav2_msgs/msg/CostmapUpdate", "R", "T"]
    assert topics["/route_graph"] == ["visualization_msgs/msg/MarkerArray", "R", "T"]
    assert topics["/marker"] == ["visualization_msgs/msg/MarkerArray", "R", "V"]
    assert topics["/transformed_global_plan"][1:] == ["R", "V"] and topics["/bond"] == ["bond/msg/Status", "R", "V"]
    assert topics["/amcl_pose"] == ["geometry_msgs/msg/PoseWithCovarianceStamped", "R", "T"]
    assert topics["/particle_cloud"] == ["nav2_msgs/msg/ParticleCloud", "B", "V"]
    assert all(count == 1 for count in found["subscribed"].values()), found["subscribed"]
    assert found["map"][2:] == ["map", True] and found["costmap"] == [True, "map", True, 100]
    assert found["raw"] == [True, True, True] and found["local"] == ["odom", True]
    assert found["footprint"] > 4 and found["scan"][0] and found["battery"] and found["particles"] == 1
    assert found["imu"] == pytest.approx(9.81) and found["pose"] == "map"


def test_services_and_messages_in(office: Graph) -> None:
    from navstack.map_io import map_path

    found = office.ask(SERVICES, str(map_path("office")))
    assert found["costmap"] == ["map", True]
    assert found["costs"][0][1] == -1.0 and 0.0 <= found["costs"][0][0] < 253.0 and not found["costs"][1]
    assert found["valid"] and found["through a wall"] == [False, 1]
    assert found["load map"] == [0, True] and found["load nothing"] == 1
    assert "reset_distance must be 0 m or more, not nan" in office.output()
    free, slow, again = found["speeds"]
    assert slow <= 0.55 * free and again == pytest.approx(free, rel=0.1)
    assert found["placed"]


def test_parameters(office: Graph) -> None:
    found: dict[str, Any] = office.ask(PARAMETERS)
    assert found["listed"] == [True, True, True, True] and found["described"]
    assert found["change"] == [[True, ""]] and found["changed"] == 0.44
    ((done, reason),) = found["out of range"]
    assert not done and reason.startswith("sim_time = -1") and "\n" not in reason and found["kept"] > 0.0
    ((done, reason),) = found["fixed"]
    assert not done and "global_frame" in reason
    ((done, reason),) = found["of the node"]
    assert not done and "odom_topic cannot change while the node runs" in reason
    assert not found["other type"][0][0] and not found["unknown"][0][0]
    assert found["atomic"] == [False, 0.44]


def test_life_cycle(office: Graph) -> None:
    """As a lifecycle_manager drives it."""
    found = office.ask(LIFE_CYCLE)
    assert found["parts"] == ["active"] * 5 and found["states"]
    assert "deactivate" in found["transitions"]
    assert found["managed"] == [True, True, False] and found["paused"] == [True, False, "inactive"]
    assert found["reset"] == [True, True, "unconfigured"] and found["started"] == [True, True, False]
    assert found["deactivate"] == [True, "inactive", "inactive"] and found["goal"] == 6
    assert found["rejected"] == ["rejected"]
    assert found["cleanup"] == [True, "unconfigured"] and not found["not allowed"]
    assert found["again"] == [True, True, "active"] and found["accepted"] == [4, 0]


def test_bond(office: Graph) -> None:
    """As the two sides of lifecycle_manager and its nodes."""
    found = office.ask(BOND)
    assert found["formed after"] < 2.0  # the manager gives up after half of its bond_timeout
    instances, beats, seconds = found["beats"]
    assert instances == 1 and beats > 20 and seconds == pytest.approx(0.1 * (beats - 1), rel=0.5)
    assert found["message"] == pytest.approx([4.0, 0.1])
    assert found["after the end"] <= 1 and found["again"] and found["others"] >= 2
