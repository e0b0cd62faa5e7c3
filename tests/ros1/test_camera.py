"""The camera of the simulated robot on its topics, as scripts of tutorials use it: CvBridge, CameraInfo and tf."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from navstack.bringup import simulated_robot
from navstack.logs.writer import typestore
from navstack.parameters import CameraParams
from navstack.ros1.camera_topics import CameraTopics
from navstack.ros_messages import MessageBuilder
from navstack.scenario import load_scenario
from tests.ros1.conftest import PYTHON, TIMEOUT_S, Graph, paced
from tests.ros1.rig import Rig

SCENARIO = """\
map: office
start: [0.8, 7.45, 0.0]
goals: [[4.8, 7.45, 0.0]]
shapes:
  - {name: box, box: [0.4, 0.3], pose: [2.5, 7.2, 0.4], height: 0.2}
  - {name: disc, radius: 0.2, pose: [3.0, 7.8]}
"""
SCRIPT = """
import json, sys, numpy, rospy, tf
from cv_bridge import CvBridge
from sensor_msgs.msg import CameraInfo, Image
rospy.init_node("viewer")
bridge, found, stamps = CvBridge(), {}, []
wait = lambda topic, kind: rospy.wait_for_message("/camera/" + topic, kind, timeout=600)
rgb, depth = wait("rgb/image_raw", Image), wait("depth/image_raw", Image)
bgr = bridge.imgmsg_to_cv2(rgb, "bgr8")
meters = bridge.imgmsg_to_cv2(depth, "32FC1")
numpy.savez(sys.argv[1], bgr=bgr, meters=meters)
found["images"] = [[m.encoding, m.width, m.height, m.step, m.is_bigendian, m.header.frame_id] for m in (rgb, depth)]
for name in ("rgb", "depth"):
    info = wait(name + "/camera_info", CameraInfo)
    found[name] = [info.header.frame_id, info.width, info.height, info.distortion_model, info.K, info.P, info.R, info.D]
subscriber = rospy.Subscriber("/camera/rgb/image_raw", Image, lambda m: stamps.append(m.header.stamp.to_nsec()))
while len(stamps) < 6:
    rospy.rostime.wallsleep(0.02)
found["periods"] = [(b - a) / 1e6 for a, b in zip(stamps, stamps[1:])]
listener = tf.TransformListener()
for frame in ("camera_link", "camera_rgb_optical_frame", "camera_depth_optical_frame"):
    listener.waitForTransform("base_link", frame, rospy.Time(0), rospy.Duration(600))
    found[frame] = [list(part) for part in listener.lookupTransform("base_link", frame, rospy.Time(0))]
with open(sys.argv[2], "w") as out:
    json.dump(found, out)
"""


def test_a_script_sees_what_the_robot_sees(graph: Graph, tmp_path: Path) -> None:
    scenario_file = tmp_path / "scenario.yaml"
    scenario_file.write_text(SCENARIO, encoding="utf-8")
    rig = Rig(graph)
    rig.start_sim(str(scenario_file), "--clock", "--speed", paced(2), relayed=False)
    images, out = tmp_path / "images.npz", tmp_path / "found.json"
    assert graph.start(PYTHON, "-c", SCRIPT, str(images), str(out)).wait(TIMEOUT_S) == 0, rig.output()[-4000:]
    found, seen = json.loads(out.read_text()), np.load(images)

    scenario = load_scenario(scenario_file)
    robot = simulated_robot(scenario.configuration, scenario.world(), scenario.start, seed=scenario.seed)
    expected = robot.camera()
    assert np.array_equal(seen["bgr"], expected.rgb[:, :, ::-1])
    assert np.array_equal(seen["meters"], expected.depth)

    assert found["images"] == [
        ["rgb8", 640, 480, 1920, 0, "camera_rgb_optical_frame"],
        ["32FC1", 640, 480, 2560, 0, "camera_depth_optical_frame"],
    ]
    focal = 320.0 / np.tan(np.pi / 6.0)
    for name in ("rgb", "depth"):
        frame, width, height, model, k, p, r, d = found[name]
        assert (frame, width, height, model) == (f"camera_{name}_optical_frame", 640, 480, "plumb_bob")
        assert k == pytest.approx([focal, 0.0, 319.5, 0.0, focal, 239.5, 0.0, 0.0, 1.0])
        assert p == pytest.approx([*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0])
        assert r == np.eye(3).ravel().tolist() and d == [0.0] * 5
    assert found["periods"] == pytest.approx([100.0] * 5)
    assert found["camera_link"] == [pytest.approx([0.1, 0.0, 0.3]), pytest.approx([0.0, 0.0, 0.0, 1.0])]
    for name in ("rgb", "depth"):
        position, (x, y, z, w) = found[f"camera_{name}_optical_frame"]
        assert position == pytest.approx([0.1, 0.0, 0.3])
        # the third axis of the optical frame is the robot's x axis, the first one its right
        ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
        right = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
        assert ahead == pytest.approx([1.0, 0.0, 0.0]) and right == pytest.approx([0.0, -1.0, 0.0])


# --- without a ROS graph ----------------------------------------------------------------------------------------------


class Publisher:
    """A publisher with a number of subscribers."""

    def __init__(self) -> None:
        self.subscribers = 0
        self.messages: list[Any] = []

    def get_num_connections(self) -> int:
        return self.subscribers

    def publish(self, message: Any) -> None:
        self.messages.append(message)


class Rendering:
    """A robot that counts its pictures."""

    def __init__(self, params: CameraParams) -> None:
        self.time = 0.0
        self.pictures = 0
        self._params = params

    def camera(self, name: str) -> Any:
        assert name == "front"
        self.pictures += 1
        shape = (self._params.height, self._params.width)
        return SimpleNamespace(
            rgb=np.zeros((*shape, 3), np.uint8), depth=np.zeros(shape, np.float32), depth_mm=np.zeros(shape, np.uint16)
        )


def topics_of(params: CameraParams) -> tuple[CameraTopics, dict[str, Publisher]]:
    made: dict[str, Publisher] = {}

    def publisher(topic: str, kind: str, queue: int) -> Publisher:
        assert kind in ("sensor_msgs/Image", "sensor_msgs/CameraInfo") and queue <= 2
        return made.setdefault(topic, Publisher())

    build = MessageBuilder(typestore(ros1=True), ros1=True)
    return CameraTopics("front", params, build, publisher, lambda frame: f"robot1/{frame}"), made


def run_for(topics: CameraTopics, robot: Rendering, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        robot.time = round(robot.time + 0.02, 6)
        topics.publish(robot, round(robot.time * 1e9))  # type: ignore[arg-type]


def test_nothing_is_rendered_without_a_subscriber_of_an_image() -> None:
    params = CameraParams(width=4, height=3, topic="cams/front/")
    topics, made = topics_of(params)
    robot = Rendering(params)
    assert set(made) == {
        f"cams/front/{part}/{end}" for part in ("rgb", "depth") for end in ("image_raw", "camera_info")
    }
    made["cams/front/rgb/camera_info"].subscribers = 1
    run_for(topics, robot, 1.0)
    assert robot.pictures == 0 and not made["cams/front/rgb/image_raw"].messages
    assert len(made["cams/front/rgb/camera_info"].messages) == 10
    for part in ("rgb", "depth"):
        made[f"cams/front/{part}/image_raw"].subscribers = 1
    run_for(topics, robot, 1.0)
    assert robot.pictures == 10  # one for both images
    made["cams/front/rgb/image_raw"].subscribers = made["cams/front/depth/image_raw"].subscribers = 0
    run_for(topics, robot, 1.0)
    assert robot.pictures == 10
    stamps = [m.header.stamp for m in made["cams/front/depth/image_raw"].messages]
    assert stamps == [m.header.stamp for m in made["cams/front/rgb/camera_info"].messages[10:20]]
    assert made["cams/front/depth/image_raw"].messages[0].header.frame_id == "robot1/camera_depth_optical_frame"


def test_the_depth_in_millimeters() -> None:
    params = CameraParams(width=4, height=3, depth_encoding="16UC1", frequency=50.0)
    topics, made = topics_of(params)
    made["camera/depth/image_raw"].subscribers = 1
    run_for(topics, Rendering(params), 0.1)
    message = made["camera/depth/image_raw"].messages[0]
    assert len(made["camera/depth/image_raw"].messages) == 5
    assert (message.encoding, message.step, len(message.data)) == ("16UC1", 8, 24)


def test_frames_of_other_sensors_stay_where_they_are() -> None:
    """A lidar made of the depth image is often in camera_depth_frame."""
    topics, _ = topics_of(CameraParams(yaw=0.5))
    frames = {t.child_frame_id for t in topics.frames(0, "base", {"robot1/camera_depth_frame"})}
    assert frames == {
        f"robot1/camera_{end}" for end in ("link", "rgb_frame", "rgb_optical_frame", "depth_optical_frame")
    }
