"""The costmaps on their topics: equal to those of the same robot in this process, and complete after updates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Costmap, LaserScan, SensorData
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.ros_messages import published_costs
from navstack.scenario import Scenario, load_places
from tests.ros1.conftest import PATIENT, PYTHON, TIMEOUT_S, Graph, paced, wait_for
from tests.ros1.rig import Rig

NAMES = ("global_costmap", "local_costmap")
GRAB = """
import sys, numpy, rospy
from nav_msgs.msg import OccupancyGrid
rospy.init_node("grab", anonymous=True, disable_signals=True)
for name, file in zip(sys.argv[1::2], sys.argv[2::2]):
    grid = rospy.wait_for_message("/move_base/%s/costmap" % name, OccupancyGrid, 60)
    origin = grid.info.origin.position
    numpy.savez(file, data=numpy.array(grid.data, numpy.int8).reshape(grid.info.height, grid.info.width),
                place=[origin.x, origin.y, grid.info.resolution])
"""
WATCH = """
import os, sys, numpy, rospy
from nav_msgs.msg import OccupancyGrid
from map_msgs.msg import OccupancyGridUpdate
rospy.init_node("watch", disable_signals=True)
seen = {"updates": 0}
def full(message):
    seen["grid"] = numpy.array(message.data, numpy.int8).reshape(message.info.height, message.info.width)
def update(message):
    seen["updates"] += 1
    piece = numpy.array(message.data, numpy.int8).reshape(message.height, message.width)
    seen["grid"][message.y : message.y + message.height, message.x : message.x + message.width] = piece
kept = [rospy.Subscriber("/move_base/global_costmap/costmap", OccupancyGrid, full),
        rospy.Subscriber("/move_base/global_costmap/costmap_updates", OccupancyGridUpdate, update)]
while "grid" not in seen:
    rospy.rostime.wallsleep(0.02)
open(sys.argv[1], "w").close()
while not os.path.exists(sys.argv[2]):
    rospy.rostime.wallsleep(0.02)
numpy.savez(sys.argv[3], data=seen["grid"], updates=seen["updates"])
"""


def grab(graph: Graph, folder: Path) -> dict[str, tuple[NDArray[np.int8], NDArray[np.float64]]]:
    """Return grid and place (origin, resolution) of both costmaps, as a new subscriber gets them."""
    files = {name: folder / f"{name}.npz" for name in NAMES}
    graph.run(PYTHON, "-c", GRAB, *(text for name, file in files.items() for text in (name, str(file))))
    found: dict[str, tuple[NDArray[np.int8], NDArray[np.float64]]] = {}
    for name, file in files.items():
        with np.load(file) as data:
            found[name] = data["data"], data["place"]
    return found


def in_this_process() -> dict[str, Costmap]:
    """Return the costmaps of the same robot, which stands at the same place, in this process."""
    places = load_places("office")
    assert places.start is not None
    configuration = load_configuration(["turtlebot"])
    scenario = Scenario(load_map(map_path("office")), configuration, places.start, ())
    robot = simulated_robot(configuration, scenario.world(), scenario.start)
    scans = robot.scans

    def as_messages() -> Sequence[SensorData]:
        """The fields of a LaserScan message are float32."""
        names = ("angle_min", "angle_increment", "range_min", "range_max")
        return [
            replace(scan, **{name: float(np.float32(getattr(scan, name))) for name in names})
            if isinstance(scan, LaserScan)
            else scan
            for scan in scans()
        ]

    robot.scans = as_messages  # type: ignore[method-assign]
    move_base = build_move_base(configuration, robot, static_map=scenario.map)
    while robot.time < 3.0:
        robot.advance_to(robot.time + 0.1)
        move_base.tick(robot.time)
    return {"global_costmap": move_base.global_costmap.master, "local_costmap": move_base.local_costmap.master}


def test_costmap_topics(graph: Graph, tmp_path: Path) -> None:
    rig = Rig(graph)
    try:
        rig.start_sim("office", "--clock", "--speed", paced(8), relayed=False)
        rig.start_probe("--results")
        rig.start_node("--params", "turtlebot", *PATIENT)
        rig.do("nothing", at=rig.now() + 3.0)
        values = published_costs()
        ours = in_this_process()
        for name, (data, place) in grab(graph, tmp_path).items():
            master = ours[name]
            geometry = master.geometry
            assert place.tolist() == [geometry.origin_x, geometry.origin_y, np.float32(geometry.resolution)]
            assert np.array_equal(data, values[master.data]), name
            assert (data == 100).any()
        # what a viewer puts together from updates is the whole grid
        ready, stop, seen = tmp_path / "ready", tmp_path / "stop", tmp_path / "seen.npz"
        watch = graph.start(PYTHON, "-c", WATCH, str(ready), str(stop), str(seen))
        wait_for(ready.exists, "the first grid")
        mark = len(rig.take())
        rig.send_goal(4.0, 7.45)
        found = rig.wait(lambda e: e["what"] == "result", "the end of the goal", since=mark)
        assert found["status"] == 3
        status = rig.wait(lambda e: e["what"] == "diagnostics", "diagnostics", since=mark)["found"]
        assert set(status) == {"move_base: navigation", "move_base: control loop", "move_base: data"}
        assert "age of scan (s)" in status["move_base: data"] and int(status["move_base: control loop"]["cycles"]) > 0
        rig.do("nothing", at=rig.now() + 5.0)
        after = grab(graph, tmp_path)
        stop.touch()
        assert watch.wait(TIMEOUT_S) == 0
        with np.load(seen) as data:
            assert data["updates"] >= 3
            assert np.array_equal(data["data"], after["global_costmap"][0])
        assert not np.array_equal(after["global_costmap"][0], values[ours["global_costmap"].data])
    finally:
        rig.close()
