"""Scripts as tutorials have them, against navstack as Debian's roslaunch starts it from an ordinary launch file; two robots.

The scripts are our own. They use the interfaces on which published ones rely: the frames /odom, /base_link and /base_footprint
with tf's listener, private parameters, /cmd_vel, /odom, /scan, initialpose and amcl_pose, and the action move_base.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from navstack.cli.app import run
from tests.ros1.conftest import PYTHON, TIMEOUT_S, paced
from tests.ros1.module_graph import ROOT, module_graph

LAUNCH = """\
<launch>
  <arg name="folder"/>
  <include file="$(find navstack_ros1)/launch/sim.launch">
    <arg name="speed" value="SPEED"/>
  </include>
  <node pkg="move_base" type="move_base" respawn="false" name="move_base" output="screen">
    <param name="base_global_planner" value="navfn/NavfnROS"/>
    <rosparam file="$(arg folder)/costmap_common_params.yaml" command="load" ns="global_costmap"/>
    <rosparam file="$(arg folder)/costmap_common_params.yaml" command="load" ns="local_costmap"/>
    <rosparam file="$(arg folder)/global_costmap_params.yaml" command="load"/>
    <rosparam file="$(arg folder)/local_costmap_params.yaml" command="load"/>
    <rosparam file="$(arg folder)/move_base_params.yaml" command="load"/>
    <rosparam file="$(arg folder)/dwa_local_planner_params.yaml" command="load"/>
    <rosparam file="$(arg folder)/navstack.yaml" command="load"/>
    <param name="controller_frequency" value="5.0"/>
  </node>
  <include file="$(find navstack_ros1)/launch/robot.launch">
    <arg name="robot" value="robot2"/>
    <arg name="start" value="11.4,7.4,0"/>
  </include>
</launch>
"""
SCRIPTS = """
import json, math, sys, threading
import rospy, actionlib, tf
from geometry_msgs.msg import Point, Pose, PoseWithCovarianceStamped, Quaternion, Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from tf.transformations import euler_from_quaternion, quaternion_from_euler
while not rospy.get_param("/use_sim_time", False):  # roslaunch is not yet there
    rospy.rostime.wallsleep(0.05)
rospy.init_node("scripts")
found = {}
listener = tf.TransformListener()
velocity = rospy.Publisher("/cmd_vel", Twist, queue_size=5)
rate = rospy.Rate(20)

def goal_of(x, y, yaw, frame, stamp=True):
    goal = MoveBaseGoal()
    goal.target_pose.header.frame_id = frame
    if stamp:
        goal.target_pose.header.stamp = rospy.Time.now()
    goal.target_pose.pose = Pose(Point(x, y, 0.0), Quaternion(*quaternion_from_euler(0, 0, yaw)))
    return goal

def base():
    (x, y, _), q = listener.lookupTransform(odom_frame, base_frame, rospy.Time(0))
    return x, y, euler_from_quaternion(q)[2]

def wrapped(angle):
    return math.atan2(math.sin(angle), math.cos(angle))

other = actionlib.SimpleActionClient("/robot2/move_base", MoveBaseAction)
client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
assert client.wait_for_server(rospy.Duration(1e6)) and other.wait_for_server(rospy.Duration(1e6))
other.send_goal(goal_of(13.4, 7.4, 0.0, "map"))

# which of the two names has the base? both are tried, with a slash
odom_frame, base_frame = "/odom", ""
for name in ("/base_footprint", "/base_link"):
    listener.waitForTransform(odom_frame, name, rospy.Time(), rospy.Duration(600))
    base_frame = name
found["frames"] = listener.frameExists("base_link") and listener.frameExists("base_footprint")

# what is there before anything is driven
scan = rospy.wait_for_message("/scan", LaserScan, timeout=600)
found["scan"] = [len(scan.ranges), scan.header.frame_id]
odom = rospy.wait_for_message("odom", Odometry, timeout=600)
found["odom"] = [odom.header.frame_id, odom.child_frame_id, [odom.pose.covariance[k] > 0 for k in (0, 7, 35)]]
found["map"] = rospy.wait_for_message("/map", OccupancyGrid, timeout=600).header.frame_id
amcl = rospy.wait_for_message("/amcl_pose", PoseWithCovarianceStamped, timeout=600)
found["amcl_pose"] = [amcl.header.frame_id, round(amcl.pose.pose.position.x, 2), round(amcl.pose.pose.position.y, 2)]

# timed: a velocity for so many cycles, out and back
begin = base()
for direction in (0.2, -0.2):
    command = Twist()
    command.linear.x = direction
    for _ in range(20):
        velocity.publish(command)
        rate.sleep()
    velocity.publish(Twist())
    rospy.sleep(0.5)
found["timed"] = math.hypot(base()[0] - begin[0], base()[1] - begin[1])

# by odometry: until a distance is driven, then until an angle is turned
begin, command = base(), Twist()
command.linear.x = 0.3
while math.hypot(base()[0] - begin[0], base()[1] - begin[1]) < 0.4 and not rospy.is_shutdown():
    velocity.publish(command)
    rate.sleep()
velocity.publish(Twist())
rospy.sleep(0.5)
found["driven"] = math.hypot(base()[0] - begin[0], base()[1] - begin[1])
found["turned"] = []
for direction in (1.0, -1.0):
    command, last, turned = Twist(), base()[2], 0.0
    command.angular.z = 0.7 * direction
    while abs(turned) + math.radians(2.0) < math.pi / 2 and not rospy.is_shutdown():
        velocity.publish(command)
        rate.sleep()
        turned, last = turned + wrapped(base()[2] - last), base()[2]
    velocity.publish(Twist())
    rospy.sleep(0.5)
    found["turned"].append(turned + wrapped(base()[2] - last))

# calibration: towards a distance from the start, in both directions, by private parameters
wanted, tolerance = rospy.get_param("~test_distance", 1.0), rospy.get_param("~tolerance", 0.01)
speed = rospy.get_param("~speed", 0.15)
begin = base()
while not rospy.is_shutdown():
    error = math.hypot(base()[0] - begin[0], base()[1] - begin[1]) - wanted
    if abs(error) < tolerance:
        break
    command = Twist()
    command.linear.x = math.copysign(speed, -error)
    velocity.publish(command)
    rate.sleep()
velocity.publish(Twist())
found["calibrated"] = error

# a goal ahead of the robot, in its own frame
client.send_goal(goal_of(0.4, 0.0, 0.0, "base_link"))
found["ahead"] = [client.wait_for_result(rospy.Duration(600)), client.get_state()]

# places: feedback, a time limit, names of the states
names = ["PENDING", "ACTIVE", "PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "PREEMPTING", "RECALLING", "RECALLED", "LOST"]
fed = []
states = []
for x, y, yaw in ((1.8, 7.45, 0.0), (2.4, 7.45, math.pi / 2)):
    client.send_goal(goal_of(x, y, yaw, "map"), feedback_cb=lambda f: fed.append(f.base_position.header.frame_id))
    states.append([client.wait_for_result(rospy.Duration(600)), names[client.get_state()]])
found["places"], found["feedback"] = states, sorted(set(fed))

# too little time: canceled
client.send_goal(goal_of(20.6, 2.2, 0.0, "map"))
finished = client.wait_for_result(rospy.Duration(2.0))
client.cancel_goal()
client.wait_for_result(rospy.Duration(600))
found["late"] = [finished, names[client.get_state()]]

# waypoints that people set on initialpose (here on another topic), followed when they are complete; goals without a stamp
waypoints, complete = [], threading.Event()
def add(message):
    waypoints.append(message.pose.pose)
    if len(waypoints) == 2:
        complete.set()
kept = rospy.Subscriber("waypoint", PoseWithCovarianceStamped, add, queue_size=5)
setter = rospy.Publisher("waypoint", PoseWithCovarianceStamped, queue_size=5, latch=True)
for x in (3.0, 3.4):
    message = PoseWithCovarianceStamped()
    message.header.frame_id, message.pose.pose = "map", goal_of(x, 7.45, 0.0, "map").target_pose.pose
    while setter.get_num_connections() == 0:
        rospy.rostime.wallsleep(0.02)
    setter.publish(message)
complete.wait(300)
reached = []
for pose in waypoints:
    goal = goal_of(0, 0, 0, "map", stamp=False)
    goal.target_pose.pose = pose
    client.send_goal(goal)
    client.wait_for_result()
    reached.append(client.get_state())
found["waypoints"] = reached

# where the robot is set: initialpose moves it, and its localization knows
initial = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=1)
message = PoseWithCovarianceStamped()
message.header.frame_id, message.header.stamp = "map", rospy.Time.now()
message.pose.pose = goal_of(0.8, 7.45, 0.5, "map").target_pose.pose
while initial.get_num_connections() == 0:
    rospy.rostime.wallsleep(0.02)
initial.publish(message)
rospy.sleep(1.0)
(x, y, _), q = listener.lookupTransform("/map", "/base_link", rospy.Time(0))
found["set"] = [round(x, 3), round(y, 3), round(euler_from_quaternion(q)[2], 3)]
found["other"] = [other.wait_for_result(rospy.Duration(600)), other.get_state()]
(x, y, _), q = listener.lookupTransform("map", "robot2/base_link", rospy.Time(0))
found["other at"] = [x, y]
with open(sys.argv[1], "w") as out:
    json.dump(found, out)
rospy.signal_shutdown("done")
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the scripts have found."""
    folder = tmp_path_factory.mktemp("tutorials")
    with module_graph(folder) as graph:
        assert run(["ros1", "install", str(folder / "packages")]) == 0
        (folder / "robot.launch").write_text(LAUNCH.replace("SPEED", paced(3)))
        environment = {**graph.own, "ROS_PACKAGE_PATH": str(folder / "packages")}
        command = (
            "/usr/bin/roslaunch",
            str(folder / "robot.launch"),
            f"folder:={ROOT / 'params' / 'turtlebot'}",
        )
        launch = graph.launch(command, environment)
        out = folder / "found.json"
        scripts = graph.start(PYTHON, "-c", SCRIPTS, str(out), "_test_distance:=0.3", "_speed:=0.2")
        assert scripts.wait(TIMEOUT_S) == 0, graph.output_of(scripts) + graph.output_of(launch)
        (folder / "places.yaml").write_text("places:\n  near: [1.2, 7.45, 0]\n  far: [1.8, 7.45, 0]\n")
        tour = graph.run_node("tour", str(folder / "places.yaml"), "_rest_time:=0.5")
        yield {**json.loads(out.read_text()), "tour": tour}


def test_interfaces_that_scripts_rely_on(found: dict[str, Any]) -> None:
    assert found["frames"]
    assert found["scan"] == [640, "base_laser_link"]
    assert found["odom"] == ["odom", "base_footprint", [True, True, True]]
    assert found["map"] == "map"
    assert found["amcl_pose"][0] == "map" and found["amcl_pose"][1:] == pytest.approx([0.8, 7.45], abs=0.05)


def test_scripts_that_drive_by_odometry(found: dict[str, Any]) -> None:
    """Tolerances: the robot goes on for the cycles (0.05 s, four of them on a busy machine) that a script needs to notice."""
    assert found["timed"] == pytest.approx(0.0, abs=0.1)
    assert 0.4 <= found["driven"] <= 0.4 + 0.3 * 0.2 + 0.06
    assert found["turned"] == pytest.approx([1.5708, -1.5708], abs=0.035 + 0.7 * 0.2 + 0.07)
    assert abs(found["calibrated"]) < 0.01


def test_scripts_that_send_goals(found: dict[str, Any]) -> None:
    assert found["ahead"] == [True, 3]
    assert found["places"] == [[True, "SUCCEEDED"], [True, "SUCCEEDED"]]
    assert found["feedback"] == ["map"]
    assert found["late"] == [False, "PREEMPTED"]
    assert found["waypoints"] == [3, 3]
    assert found["set"] == [0.8, 7.45, 0.5]


def test_tour(found: dict[str, Any]) -> None:
    """MultiNav's lines; the way to the first place counts from where the robot was: 0.4 m, within the tolerance of a goal."""
    assert "Going to: near Goal succeeded! Success so far: 1/1 = 100.0%" in found["tour"]
    assert re.search(
        r"Going to: far Goal succeeded! Success so far: 2/2 = 100\.0% Running time: \d+\.\d min", found["tour"]
    )
    assert float(found["tour"].split("Distance: ")[-1].split()[0]) == pytest.approx(1.0, abs=0.11)


def test_a_second_robot_in_a_namespace(found: dict[str, Any]) -> None:
    """It follows the first one's clock, has frames with a prefix, and reaches its goal."""
    assert found["other"] == [True, 3]
    assert found["other at"] == pytest.approx([13.4, 7.4], abs=0.2)
