"""The node that maps, with gmapping's interface, next to a simulated robot that is driven by cmd_vel."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from navstack.core import Transform2D
from navstack.map_io import load_map
from tests.ros1.conftest import PYTHON, TIMEOUT_S, paced
from tests.ros1.module_graph import module_graph
from tests.ros1.test_localization import COMMON

CLIENT = (
    COMMON
    + """
from nav_msgs.msg import MapMetaData
from nav_msgs.srv import GetMap
from std_msgs.msg import Float64
kept += [rospy.Subscriber(topic, kind, heard, callback_args=topic) for topic, kind in (
    ("map", OccupancyGrid), ("map_metadata", MapMetaData), ("slam_gmapping/entropy", Float64))]
wait(lambda: {"map", "map_metadata", "base_pose_ground_truth"} <= set(latest), "the first map")
found["first known"] = sum(value >= 0 for value in latest["map"].data)
found["start"] = [truth(), in_map("/base_link")]
for v, w, seconds in ((0.4, 0.0, 5.0), (0.0, 0.6, 5.0), (0.0, -0.6, 10.0), (0.4, 0.0, 3.0)):
    drive(v, w, seconds)
rospy.sleep(1.0)
found["end"] = [truth(), in_map("/base_link")]
answer = rospy.ServiceProxy("dynamic_map", GetMap)().map
found["frame"] = answer.header.frame_id
found["known"] = sum(value >= 0 for value in answer.data)
found["size"] = [answer.info.width, answer.info.height, answer.info.resolution, len(answer.data)]
wait(lambda: latest["map_metadata"].width == answer.info.width, "the metadata of the last map")
wait(lambda: "slam_gmapping/entropy" in latest, "the entropy")
found["entropy"] = latest["slam_gmapping/entropy"].data
set_pose(1.0, 2.0, 0.5)
json.dump(found, open(sys.argv[1], "w"))
"""
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a client has found, and the map that map_saver wrote."""
    folder: Path = tmp_path_factory.mktemp("mapping")
    with module_graph(folder) as graph:
        sim = ("office", "--clock", "--speed", paced(4), "_localization:=false", "map:=world", "--params", "omni_dwa")
        graph.node("sim", *sim)
        graph.run("/usr/bin/rosparam", "set", "/use_sim_time", "true")
        node = graph.node("mapping", "_map_update_interval:=1.0", "_particles:=80", "_delta:=0.05")
        out = folder / "found.json"
        client = graph.start(PYTHON, "-c", CLIENT, str(out))
        assert client.wait(TIMEOUT_S) == 0, graph.output_of(client) + graph.output_of(node)
        graph.run_node("map_saver", "-f", str(folder / "saved"))
        graph.wait_for_text(node, "an initial pose is ignored")
        node.terminate()
        assert node.wait(TIMEOUT_S) == 0, graph.output_of(node)
        return {**json.loads(out.read_text()), "map": load_map(folder / "saved.yaml"), "log": graph.output_of(node)}


def test_the_map_is_that_of_the_world(made: dict[str, Any]) -> None:
    truth, believed = (Transform2D(*pose) for pose in made["start"])
    to_world = truth @ believed.inverse()
    world, grid = load_map("office"), made["map"]
    iy, ix = np.nonzero(grid.data == 100)
    g, w = grid.geometry, world.geometry
    walls = to_world.apply_points(np.column_stack((ix + 0.5, iy + 0.5)) * g.resolution + (g.origin_x, g.origin_y))
    cells = np.floor((walls - (w.origin_x, w.origin_y)) / w.resolution).astype(int)
    away = np.asarray(distance_transform_edt(world.data != 100))[cells[:, 1], cells[:, 0]]
    assert len(walls) > 300
    assert (away <= 2.0).mean() > 0.95  # two cells: the first pose of the comparison is one of a moving clock
    assert made["known"] > 1.2 * made["first known"]
    assert made["size"][3] == made["size"][0] * made["size"][1] and made["size"][2] == pytest.approx(0.05)


def test_the_transform_and_the_topics_are_gmappings(made: dict[str, Any]) -> None:
    assert made["frame"] == "map"
    starts, ends = ([Transform2D(*pose) for pose in made[name]] for name in ("start", "end"))
    driven = [before.inverse() @ after for before, after in zip(starts, ends, strict=True)]
    assert abs(driven[0].yaw) > 1.0 and math.hypot(driven[0].x, driven[0].y) > 0.5
    assert math.hypot(driven[0].x - driven[1].x, driven[0].y - driven[1].y) < 0.15
    assert math.isfinite(made["entropy"])
    assert "have no effect" in made["log"] and "particles" in made["log"]
    assert "Traceback" not in made["log"]
