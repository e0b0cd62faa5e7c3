"""Topics and services of move_base other than the action: clouds, voxels, footprints, map updates, plans during a goal."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ros1.conftest import PATIENT, PYTHON, TIMEOUT_S, new_graph, paced, wait_for
from tests.ros1.rig import Rig

CLIENT = """
import json, math, struct, sys, rospy, actionlib, genpy.dynamic
from geometry_msgs.msg import Point32, Polygon, PolygonStamped, PoseStamped
from map_msgs.msg import OccupancyGridUpdate
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetPlan
from sensor_msgs.msg import PointCloud, PointCloud2
rospy.init_node("client", disable_signals=True)
latest, counts = {}, {}

def heard(message, name):
    latest[name], counts[name] = message, counts.get(name, 0) + 1

def listen(topic, kind):
    return rospy.Subscriber(topic, kind, heard, callback_args=topic)

def wait(condition, what):
    end = rospy.Time.now() + rospy.Duration(1200)
    while not condition():
        assert rospy.Time.now() < end, what
        rospy.rostime.wallsleep(0.02)

def pose(x, y, frame="map"):
    message = PoseStamped()
    message.header.frame_id, message.pose.position.x, message.pose.position.y = frame, x, y
    message.pose.orientation.w = 1.0
    return message

DWA, NAVFN = "/move_base/DWAPlannerROS", "/move_base/NavfnROS"
VOXELS = "/move_base/local_costmap/obstacle_layer/voxel_grid"
ENDS = "/move_base/local_costmap/obstacle_layer/clearing_endpoints"
FOOTPRINT = "/move_base/local_costmap/footprint"
kept = [listen(*of) for of in (
    (DWA + "/trajectory_cloud", PointCloud2), (DWA + "/cost_cloud", PointCloud2), (NAVFN + "/potential", PointCloud2),
    (NAVFN + "/plan", Path), (VOXELS, rospy.AnyMsg), (ENDS, PointCloud), (FOOTPRINT, PolygonStamped),
    ("/move_base/global_costmap/costmap", OccupancyGrid))]
found = {}
client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
client.wait_for_server()

def points(topic):
    message = latest[topic]
    names = [field.name for field in message.fields]
    rows = list(struct.iter_unpack("<%df" % len(names), message.data))
    assert message.point_step == 4 * len(names) and message.width == len(rows)
    return names, rows, message.header.frame_id

# a plan of the planner before, and another one during a goal
planner = rospy.ServiceProxy(NAVFN + "/make_plan", GetPlan)
planner.wait_for_service()
goal = MoveBaseGoal(target_pose=pose(6.0, 7.45))
before = planner(pose(1.0, 7.45), pose(6.0, 7.45), 0.0).plan
client.send_goal(goal)
wait(lambda: client.get_state() == actionlib.GoalStatus.ACTIVE, "a goal")
during = planner(pose(1.0, 7.45), pose(6.0, 7.45), 0.0).plan
found["plans"] = [len(plan.poses) for plan in (before, during)] + [during.header.frame_id, during.header.stamp > rospy.Time(0)]
elsewhere = planner(pose(1.0, 7.45, "odom"), pose(6.0, 7.45), 0.0).plan
found["other frame"] = [len(elsewhere.poses), elsewhere.header.frame_id]
try:
    rospy.ServiceProxy("/move_base/make_plan", GetPlan)(pose(1.0, 7.45), pose(6.0, 7.45), 0.0)
    found["busy"] = False
except rospy.ServiceException:
    found["busy"] = True
wait(lambda: all(counts.get(name, 0) >= 2 for name in (DWA + "/trajectory_cloud", DWA + "/cost_cloud", NAVFN + "/potential",
                                                       VOXELS, ENDS, FOOTPRINT)), "topics: %s" % counts)
client.cancel_all_goals()
client.wait_for_result()

names, rows, frame = points(DWA + "/trajectory_cloud")
found["trajectories"] = [names, frame, len(rows) > 50, min(row[4] for row in rows) >= 0.0, len({row[4] for row in rows}) > 3]
names, rows, frame = points(DWA + "/cost_cloud")
found["costs"] = [names, frame, len(rows) > 500, all(row[6] >= 0.0 for row in rows), max(row[5] for row in rows) < 253]
names, rows, frame = points(NAVFN + "/potential")
highest = max(rows, key=lambda row: row[2])
found["potential"] = [names, frame, len(rows) > 1000, min(row[3] for row in rows), highest[2] >= 19.9]

header = latest[VOXELS]._connection_header
voxels = genpy.dynamic.generate_dynamic(header["type"], header["message_definition"])[header["type"]]()
voxels.deserialize(latest[VOXELS]._buff)
marked = sum(1 for word in voxels.data if word >> 16)
free = sum(1 for word in voxels.data if (word & 2) == 0)
found["voxels"] = [header["type"], header["md5sum"], voxels.header.frame_id, voxels.size_x, voxels.size_y, voxels.size_z,
                   len(voxels.data), round(voxels.resolutions.x, 6), round(voxels.resolutions.z, 6), marked > 20, free > 100,
                   all((word >> 16) & ~word == 0 for word in voxels.data)]
ends = latest[ENDS]
found["ends"] = [ends.header.frame_id, len(ends.points) > 50]

# a cloud of the older kind marks a ring around the robot, which is in the middle of the local costmap
rim = [(0.8 * math.cos(math.radians(5 * k)), 0.8 * math.sin(math.radians(5 * k))) for k in range(72)]
clouds = rospy.Publisher("/old_cloud", PointCloud, queue_size=1)
wait(lambda: clouds.get_num_connections() > 0, "a subscriber of clouds")

def marked_points():
    grid = rospy.wait_for_message("/move_base/local_costmap/costmap", OccupancyGrid)
    n, size = grid.info.width, grid.info.resolution
    near = lambda x, y: any(grid.data[(n // 2 + round(y / size) + j) * n + n // 2 + round(x / size) + i] == 100
                            for i in (-1, 0, 1) for j in (-1, 0, 1))
    return sum(near(x, y) for x, y in rim)

def publish_and_count():
    message = PointCloud(points=[Point32(x, y, 0.1) for x, y in rim])
    message.header.frame_id, message.header.stamp = "base_link", rospy.Time.now()
    clouds.publish(message)
    return marked_points() >= 65

found["ring before"] = marked_points()
wait(publish_and_count, "the marks of a cloud")

# another footprint
setter = rospy.Publisher("/move_base/local_costmap/footprint", Polygon, queue_size=1)
wait(lambda: setter.get_num_connections() > 0, "a subscriber of footprints")
first = len(latest[FOOTPRINT].polygon.points)
setter.publish(Polygon(points=[Point32(x, y, 0.0) for x, y in ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))]))
wait(lambda: len(latest[FOOTPRINT].polygon.points) == 4, "the new footprint")
corners = [(p.x, p.y) for p in latest[FOOTPRINT].polygon.points]
found["footprint"] = [first > 4, latest[FOOTPRINT].header.frame_id,
                      [round(max(c[k] for c in corners) - min(c[k] for c in corners), 2) for k in (0, 1)]]

# an update of the map; one beyond it is refused
grid = latest["/move_base/global_costmap/costmap"]
updates = rospy.Publisher("/map_updates", OccupancyGridUpdate, queue_size=5)
wait(lambda: updates.get_num_connections() > 0, "a subscriber of updates")
corner = grid.info.origin.position
column, row = int((8.0 - corner.x) / grid.info.resolution), int((7.45 - corner.y) / grid.info.resolution)
found["free before"] = grid.data[row * grid.info.width + column] < 100
updates.publish(OccupancyGridUpdate(x=grid.info.width - 1, y=0, width=5, height=1, data=[100] * 5))
updates.publish(OccupancyGridUpdate(x=column, y=row, width=3, height=3, data=[100] * 9))

def is_marked():
    fresh = rospy.wait_for_message("/move_base/global_costmap/costmap", OccupancyGrid)
    return [fresh.data[(row + k) * grid.info.width + column + k] for k in range(3)] == [100, 100, 100]

kept[-1].unregister()
wait(is_marked, "the update of the map")
found["load time"] = grid.info.map_load_time.to_sec()
with open(sys.argv[1], "w") as out:
    json.dump(found, out)
"""
SETTINGS = (
    "local_costmap.obstacle_layer.publish_voxel_map=true",
    "global_costmap.static_layer.subscribe_to_updates=true",
    "NavfnROS.visualize_potential=true",
    "local_costmap.obstacle_layer.bump.data_type=PointCloud",
    "local_costmap.obstacle_layer.bump.topic=old_cloud",
)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the client has found."""
    graph = new_graph(tmp_path_factory.mktemp("interface"))
    rig = Rig(graph)
    try:
        rig.start_sim("office", "--clock", "--speed", paced(4), relayed=False)
        rig.start_node("--params", "turtlebot", *PATIENT, *(part for text in SETTINGS for part in ("--set", text)))
        out = Path(graph.folder) / "found.json"
        assert graph.start(PYTHON, "-c", CLIENT, str(out)).wait(TIMEOUT_S) == 0, rig.output()[-6000:]
        wait_for(lambda: "an update of 5 x 1 cells" in rig.output(), "the refusal of an update")
        yield {**json.loads(out.read_text()), "log": rig.output()}
    finally:
        rig.close()
        graph.close()


def test_plans_of_the_planner_during_a_goal(found: dict[str, Any]) -> None:
    before, during, frame, is_stamped = found["plans"]
    assert before == during > 50 and frame == "map" and is_stamped
    assert found["other frame"] == [0, "map"]
    assert found["busy"]


def test_a_cloud_of_the_older_kind_marks(found: dict[str, Any]) -> None:
    """`data_type: PointCloud` is a sensor_msgs/PointCloud; the client has waited for its marks."""
    assert found["ring before"] < 65


def test_clouds(found: dict[str, Any]) -> None:
    assert found["trajectories"] == [["x", "y", "z", "theta", "cost"], "odom", True, True, True]
    names = ["x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost"]
    assert found["costs"] == [names, "odom", True, True, True]
    assert found["potential"] == [["x", "y", "z", "pot"], "map", True, 0.0, True]


def test_voxels(found: dict[str, Any]) -> None:
    """The message is that of costmap_2d, as another node makes it of its definition."""
    size = [80, 80, 2, 6400, 0.05, 0.2]
    start = ["costmap_2d/VoxelGrid", "48a040827e1322073d78ece5a497029c", "odom"]
    assert found["voxels"] == [*start, *size, True, True, True]
    assert found["ends"] == ["odom", True]


def test_inputs_of_costmaps(found: dict[str, Any]) -> None:
    assert found["footprint"][:2] == [True, "odom"]
    assert found["footprint"][2] == pytest.approx([0.62, 0.42], abs=0.15)
    assert found["free before"] and found["load time"] == 0.0
    # the node neither connects to its own topic of another type nor warns of it
    assert "'callerid': '/move_base'" not in found["log"].split("navstack is ready")[0]
