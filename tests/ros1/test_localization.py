"""The nodes amcl and fake_localization next to a simulated robot that does not localize itself."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.map_io import load_map, map_path
from tests.ros1.conftest import PYTHON, TIMEOUT_S, paced
from tests.ros1.module_graph import module_graph

COMMON = """
import json, math, sys, rospy, tf
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from tf.transformations import euler_from_quaternion, quaternion_from_euler
rospy.init_node("client", disable_signals=True)
latest, counts = {}, {}

def heard(message, name):
    latest[name], counts[name] = message, counts.get(name, 0) + 1

kept = [rospy.Subscriber(topic, kind, heard, callback_args=topic) for topic, kind in (
    ("amcl_pose", PoseWithCovarianceStamped), ("particlecloud", PoseArray), ("base_pose_ground_truth", Odometry))]
initial = rospy.Publisher("initialpose", PoseWithCovarianceStamped, queue_size=2)
velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1)
listener = tf.TransformListener()

def wait(condition, what):
    end = rospy.Time.now() + rospy.Duration(1200)
    while not condition():
        assert rospy.Time.now() < end, what
        rospy.rostime.wallsleep(0.02)

def flat(pose):
    q = pose.orientation
    return [pose.position.x, pose.position.y, euler_from_quaternion((q.x, q.y, q.z, q.w))[2]]

def in_map(base):
    # the newest pose of the base in the map, as every client of tf asks for it, with slashes
    listener.waitForTransform("/map", base, rospy.Time(0), rospy.Duration(600))
    (x, y, _), q = listener.lookupTransform("/map", base, rospy.Time(0))
    return [x, y, euler_from_quaternion(q)[2]]

def truth():
    return flat(latest["base_pose_ground_truth"].pose.pose)

def off(found):
    return max(abs(math.remainder(a - b, 2 * math.pi) if k == 2 else a - b) for k, (a, b) in enumerate(zip(found, truth())))

def set_pose(x, y, yaw, frame="map", stamped=True):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    if stamped:
        message.header.stamp = rospy.Time.now()
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    q = quaternion_from_euler(0, 0, yaw)
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = q[2], q[3]
    message.pose.covariance[0] = message.pose.covariance[7] = 0.25
    message.pose.covariance[35] = 0.06853891945200942
    wait(lambda: initial.get_num_connections() > 0, "a subscriber of initialpose")
    initial.publish(message)

def drive(v, w, seconds):
    end = rospy.Time.now() + rospy.Duration(seconds)
    command = Twist()
    command.linear.x, command.angular.z = v, w
    while rospy.Time.now() < end:
        velocity.publish(command)
        rospy.rostime.wallsleep(0.02)
    velocity.publish(Twist())

found = {}
"""
FAKE = (
    COMMON
    + """
wait(lambda: {"amcl_pose", "particlecloud", "base_pose_ground_truth"} <= set(latest), "amcl_pose")
found["at first"] = off(in_map("/base_link"))
message = latest["amcl_pose"]
found["pose"] = [message.header.frame_id, sum(map(abs, message.pose.covariance)), len(latest["particlecloud"].poses)]
found["ahead"] = (listener.getLatestCommonTime("map", "odom") - message.header.stamp).to_sec() > 0.0
set_pose(1.0, 2.0, 0.5)
wait(lambda: abs(in_map("/base_link")[1] - 2.0) < 0.02, "the given pose")
found["given"] = in_map("/base_footprint")
drive(0.3, 0.0, 2.0)
rospy.sleep(0.5)
moved = in_map("/base_link")
found["moved"] = [math.hypot(moved[0] - 1.0, moved[1] - 2.0), math.atan2(moved[1] - 2.0, moved[0] - 1.0)]
from std_srvs.srv import Empty
rospy.ServiceProxy("reset_positions", Empty)()  # amcl begins where the robot began
json.dump(found, open(sys.argv[1], "w"))
"""
)
AMCL = (
    COMMON
    + """
from dynamic_reconfigure.client import Client
from nav_msgs.srv import GetMap, SetMap
from std_srvs.srv import Empty
wait(lambda: {"amcl_pose", "particlecloud", "base_pose_ground_truth"} <= set(latest), "the first pose")
first = latest["amcl_pose"]
found["first"] = [first.header.frame_id, off(flat(first.pose.pose)), first.pose.covariance[0] > 0.0]
found["particles"] = len(latest["particlecloud"].poses)
server = Client("/amcl", timeout=60)
found["before"] = [server.get_configuration()[name] for name in ("min_particles", "update_min_d", "transform_tolerance")]
before = counts["amcl_pose"]
for v, w, seconds in ((0.3, 0.0, 3.0), (0.0, 0.6, 2.0), (0.3, 0.0, 2.0), (0.0, -0.6, 4.0)):
    drive(v, w, seconds)
wait(lambda: counts["amcl_pose"] > before + 2, "later poses")
rospy.sleep(1.0)
found["after a drive"] = off(in_map("/base_link"))
# a standing robot: only on request
rospy.sleep(2.0)
standing = counts["particlecloud"]
request = rospy.ServiceProxy("request_nomotion_update", Empty)
for k in range(2):
    request()
    wait(lambda: counts["particlecloud"] > standing + k, "an update without motion")
found["standing"] = counts["particlecloud"] - standing
# a pose in another frame is ignored; one without a stamp counts
rospy.sleep(1.0)
known = latest["amcl_pose"]
set_pose(0.0, 0.0, 0.0, frame="odom")
rospy.sleep(1.0)
found["ignored"] = latest["amcl_pose"].header.seq == known.header.seq
now = truth()
set_pose(now[0] + 0.2, now[1] - 0.1, now[2], stamped=False)
wait(lambda: latest["amcl_pose"].header.seq != known.header.seq, "a new start")
found["given"] = off(flat(latest["amcl_pose"].pose.pose))
# parameters at run time: the pose stays
found["changed"] = server.update_configuration({"max_particles": 900})["max_particles"]
found["kept"] = off(in_map("/base_link"))
grid = rospy.ServiceProxy("static_map", GetMap)().map
pose = PoseWithCovarianceStamped()
pose.header.frame_id, pose.pose.pose = "map", latest["base_pose_ground_truth"].pose.pose
pose.pose.covariance[0] = pose.pose.covariance[7] = pose.pose.covariance[35] = 0.01
found["set_map"] = rospy.ServiceProxy("set_map", SetMap)(grid, pose).success
seen = counts["amcl_pose"]
wait(lambda: counts["amcl_pose"] > seen, "a pose on the new map")
found["on the new map"] = off(flat(latest["amcl_pose"].pose.pose))
rospy.sleep(3.0)
found["saved"] = [rospy.get_param("/amcl/initial_pose_x"), rospy.get_param("/amcl/initial_pose_y")]
found["saved at"] = truth()[:2]
rospy.ServiceProxy("global_localization", Empty)()
seen = counts["particlecloud"]
wait(lambda: counts["particlecloud"] > seen, "particles everywhere")
xs = [p.position.x for p in latest["particlecloud"].poses]
found["global"] = [len(xs), max(xs) - min(xs)]
json.dump(found, open(sys.argv[1], "w"))
"""
)

WAIT_FOR_MAP = """
import rospy
from nav_msgs.msg import OccupancyGrid
rospy.init_node("waits", disable_signals=True)
rospy.wait_for_message("another", OccupancyGrid)
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, dict[str, Any]]]:
    """What the clients have found, by node."""
    folder: Path = tmp_path_factory.mktemp("localization")
    with module_graph(folder) as graph:
        graph.node("sim", "office", "--clock", "--speed", paced(4), "_localization:=false")
        graph.run("/usr/bin/rosparam", "set", "/use_sim_time", "true")
        answers: dict[str, dict[str, Any]] = {}
        fake = graph.node("fake_localization", "_transform_tolerance:=0.2")
        amcl_params = ("_initial_pose_x:=0.8", "_initial_pose_y:=7.45", "_max_particles:=2000", "_update_min_d:=0.1")
        spread = tuple(f"_initial_cov_{axis}:=0.01" for axis in ("xx", "yy", "aa"))
        for name, node, script in (("fake_localization", fake, FAKE), ("amcl", None, AMCL)):
            node = node or graph.node("amcl", *amcl_params, *spread, "_odom_model_type:=diff-corrected")
            out = folder / f"{name}.json"
            client = graph.start(PYTHON, "-c", script, str(out))
            assert client.wait(TIMEOUT_S) == 0, graph.output_of(client) + graph.output_of(node)
            node.terminate()
            assert node.wait(TIMEOUT_S) == 0, graph.output_of(node)
            answers[name] = {**json.loads(out.read_text()), "log": graph.output_of(node)}
        saved = graph.run_node("map_saver", "-f", str(folder / "saved"))
        first = graph.node("map_server", "maze", "map:=another", "static_map:=another_map")
        graph.run("/usr/bin/python3", "-c", WAIT_FOR_MAP)
        second = graph.node("map_server", "maze", "map:=another", "static_map:=another_map")
        assert first.wait(TIMEOUT_S) == 0
        graph.wait_for_text(second, "takes its place")
        answers["map"] = {"saved": saved, "file": str(folder / "saved.yaml"), "log": graph.output_of(second)}
        yield answers


def test_fake_localization(found: dict[str, dict[str, Any]]) -> None:
    fake = found["fake_localization"]
    assert fake["at first"] < 0.02
    assert fake["pose"] == ["map", 0.0, 1] and fake["ahead"]
    assert fake["given"] == pytest.approx([1.0, 2.0, 0.5], abs=0.02)
    distance, direction = fake["moved"]
    assert 0.3 < distance < 0.9 and direction == pytest.approx(0.5, abs=0.1)
    assert "Traceback" not in fake["log"]


def test_amcl(found: dict[str, dict[str, Any]]) -> None:
    """Tolerances: three times the spread of the pose at the start, several times that of a tracked pose; twice that of RViz's."""
    amcl = found["amcl"]
    assert amcl["first"][0] == "map" and amcl["first"][1] < 0.3 and amcl["first"][2]
    assert 100 <= amcl["particles"] <= 2000 and amcl["before"] == [100, 0.1, 0.1]
    assert amcl["after a drive"] < 0.3 and amcl["standing"] >= 2
    assert amcl["ignored"] and amcl["given"] < 1.0
    assert amcl["changed"] == 900 and amcl["kept"] < 1.0
    assert amcl["set_map"] and amcl["on the new map"] < 0.3
    assert math.dist(amcl["saved"], amcl["saved at"]) < 0.3
    assert amcl["global"][0] == 900 and amcl["global"][1] > 10.0
    assert 'an initial pose is in "odom", not in "map"; it is ignored' in amcl["log"]
    assert "Traceback" not in amcl["log"]


def test_map_saver_and_a_second_node_of_a_name(found: dict[str, dict[str, Any]]) -> None:
    saved, office = load_map(found["map"]["file"]), load_map(map_path("office"))
    assert np.array_equal(saved.data, office.data) and saved.geometry == office.geometry
    assert "saved.yaml" in found["map"]["saved"] and "saved.pgm" in found["map"]["saved"]
    assert "a node named /map_server was running" in " ".join(found["map"]["log"].split())
