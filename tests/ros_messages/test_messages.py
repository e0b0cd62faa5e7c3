"""ROS messages become navstack's types and back without loss."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from navstack.core import (
    Costmap,
    GridGeometry,
    LogError,
    OccupancyGrid,
    PointCloud,
    Pose2D,
    RangeReading,
    Twist2D,
    Window,
)
from navstack.logs.writer import typestore
from navstack.parameters import load_configuration
from navstack.replay import sensor_topics
from navstack.ros_messages import messages as ros
from navstack.ros_messages.builder import MessageBuilder, published_costs
from navstack.ros_messages.messages import Clock

START_NS = 1_700_000_000_000_000_000
CLOCK = Clock(START_NS)


@pytest.fixture(scope="module", params=[True, False], ids=["ros1", "ros2"])
def build(request: pytest.FixtureRequest) -> MessageBuilder:
    return MessageBuilder(typestore(ros1=request.param), ros1=request.param)


def test_odometry(build: MessageBuilder) -> None:
    message = build.odometry(START_NS + 70_000_000, "odom", "base_link", Pose2D(1.0, 2.0, 3.0), Twist2D(0.1, 0.2, 0.3))
    found = ros.odometry_of(message, CLOCK)
    assert found == (0.07, "odom", "base_link", Pose2D(1.0, 2.0, 3.0), Twist2D(0.1, 0.2, 0.3))


def test_map(build: MessageBuilder) -> None:
    data = np.array([[0, 100, -1], [50, 0, 100]], np.int8)
    grid = OccupancyGrid(data, GridGeometry(3, 2, 0.05, -1.0, 2.5), 0.3, "map", raw=True)
    found = ros.map_of(build.map(START_NS, grid))
    assert found.geometry == grid.geometry and found.origin_yaw == 0.3 and found.frame == "map"
    assert np.array_equal(found.data, data)


def test_cloud(build: MessageBuilder) -> None:
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    assert np.array_equal(ros.points_of(build.cloud(START_NS, PointCloud(points))), points)
    assert ros.points_of(build.cloud(START_NS, PointCloud(np.empty((0, 3), np.float32)))).shape == (0, 3)


def test_cloud_of_the_older_kind() -> None:
    """A sensor_msgs/PointCloud has a list of points, in place of fields."""
    points = [SimpleNamespace(x=0.5 * k, y=-1.0, z=0.1) for k in range(3)]
    found = ros.points_of(SimpleNamespace(points=points, channels=[]))
    assert found.dtype == np.float32
    assert np.array_equal(found, np.array([(0.0, -1.0, 0.1), (0.5, -1.0, 0.1), (1.0, -1.0, 0.1)], np.float32))
    assert ros.points_of(SimpleNamespace(points=[])).shape == (0, 3)
    assert sensor_topics(
        load_configuration(["turtlebot"], overrides=["local_costmap/obstacle_layer/bump/data_type=PointCloud"])
    )["/mobile_base/sensors/bumper_pointcloud"].types == (ros.CLOUD, ros.OLD_CLOUD)


def test_cloud_with_padding_and_doubles(build: MessageBuilder) -> None:
    layout = np.dtype({"names": ["x", "y", "z"], "formats": ["<f8"] * 3, "offsets": [8, 16, 24], "itemsize": 40})
    points = np.zeros(6, layout)
    points["x"], points["z"] = np.arange(6), 0.5
    message = build.cloud(START_NS, PointCloud(np.zeros((6, 3), np.float32)))
    for i, field in enumerate(message.fields):
        field.datatype, field.offset = 8, 8 + 8 * i
    message.point_step, message.row_step, message.width, message.height = 40, 120, 3, 2
    message.data = np.frombuffer(points.tobytes(), np.uint8)
    assert np.array_equal(ros.points_of(message)[:, 0], np.arange(6))
    message.width = 4
    with pytest.raises(LogError, match="a point cloud is not valid"):
        ros.points_of(message)


def test_range(build: MessageBuilder) -> None:
    reading = RangeReading(0.75, 0.5, 0.25, 2.0, 0.07, "sonar_link", "sonar")
    assert ros.range_of(build.range(START_NS, reading), "sonar", 0.07) == reading


def test_costmap_values_are_those_of_costmap_2d(build: MessageBuilder) -> None:
    # costmap_2d_publisher.cpp: 0, 1 .. 98 for 1 .. 252, 99 inscribed, 100 lethal, -1 unknown
    values = published_costs()
    assert [int(values[cost]) for cost in (0, 1, 128, 252, 253, 254, 255)] == [0, 1, 50, 98, 99, 100, -1]
    assert (np.diff(values[:255].astype(int)) >= 0).all()
    costs = np.array([[0, 254], [253, 255]], np.uint8)
    costmap = Costmap(GridGeometry(2, 2, 0.1, 0.0, 0.0), costs, "odom")
    assert build.costmap(START_NS, costmap).data.tolist() == [0, 100, 99, -1]
    update = build.costmap_update(START_NS, costmap, Window(1, 0, 2, 2))
    assert (update.x, update.y, update.width, update.height, update.data.tolist()) == (1, 0, 1, 2, [100, -1])


def test_invalid_messages(build: MessageBuilder) -> None:
    message = build.odometry(START_NS, "odom", "base_link", Pose2D(0.0, 0.0), Twist2D())
    message.pose.pose.orientation.w = 0.0
    with pytest.raises(LogError, match="is not a rotation"):
        ros.odometry_of(message, CLOCK)
    grid = OccupancyGrid(np.zeros((2, 2), np.int8), GridGeometry(2, 2, 0.05, 0.0, 0.0), raw=True)
    broken = build.map(START_NS, grid)
    broken.info.width = 3
    with pytest.raises(LogError, match="a map of 3 x 2 cells has 4 values"):
        ros.map_of(broken)


def test_types_have_the_checksums_of_ros() -> None:
    # md5 sums of Debian's packages (map_msgs 1.14.1, move_base_msgs 1.14.1, tf2_msgs 0.7.6)
    store = typestore(ros1=True)
    for name, md5 in (
        ("map_msgs/msg/OccupancyGridUpdate", "b295be292b335c34718bd939deebe1c9"),
        ("move_base_msgs/msg/MoveBaseActionGoal", "660d6895a1b9a16dce51fbdd9a64a56b"),
        ("move_base_msgs/msg/MoveBaseActionResult", "1eb06eeff08fa7ea874431638cb52332"),
        ("tf2_msgs/msg/TFMessage", "94810edda583a504dfda3829e70d7eec"),
    ):
        assert store.generate_msgdef(name)[1] == md5


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", np.arange(24, dtype=np.uint8).reshape(2, 4, 3)),
        ("32FC1", np.array([[0.5, np.inf], [-np.inf, 1.25]], np.float32)),
        ("16UC1", np.array([[0, 65535, 258]], np.uint16)),
    ],
)
def test_image(build: MessageBuilder, encoding: str, pixels: np.ndarray[Any, Any]) -> None:
    message = build.image(START_NS, "optical", encoding, pixels)
    assert (message.height, message.width, message.encoding) == (*pixels.shape[:2], encoding)
    assert not message.is_bigendian and message.step * message.height == len(message.data) == pixels.nbytes
    assert np.array_equal(np.frombuffer(message.data.tobytes(), pixels.dtype).reshape(pixels.shape), pixels)


@pytest.mark.parametrize("ros1", [True, False])
def test_calibration(ros1: bool) -> None:
    store = typestore(ros1=ros1)
    message = MessageBuilder(store, ros1=ros1).camera_info(START_NS, "optical", 640, 480, 554.25, (319.5, 239.5))
    kind = "sensor_msgs/msg/CameraInfo"
    raw = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
    read = store.deserialize_ros1(raw, kind) if ros1 else store.deserialize_cdr(raw, kind)
    k, d, r, p = (getattr(read, name if ros1 else name.lower()) for name in "KDRP")
    assert (read.width, read.height, read.distortion_model, read.header.frame_id) == (640, 480, "plumb_bob", "optical")
    assert k.reshape(3, 3).tolist() == [[554.25, 0.0, 319.5], [0.0, 554.25, 239.5], [0.0, 0.0, 1.0]]
    assert np.array_equal(p.reshape(3, 4)[:, :3], k.reshape(3, 3)) and not p.reshape(3, 4)[:, 3].any()
    assert not d.any() and len(d) == 5 and np.array_equal(r.reshape(3, 3), np.eye(3))
