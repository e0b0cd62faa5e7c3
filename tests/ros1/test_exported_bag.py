"""An exported run is played by Debian's rosbag, received by rospy, and shown by RViz."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.replay import export_run
from navstack.scenario import Run, read_scenario, shipped_scenarios
from tests.ros1.conftest import PYTHON, TIMEOUT_S, Graph, wait_for

RVIZ = Path(__file__).parent / "exported.rviz"
LISTENER = """
import json, sys, rospy
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from map_msgs.msg import OccupancyGridUpdate
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage
rospy.init_node("listener", disable_signals=True)
counts, last = {}, {}
def heard(message, topic):
    counts[topic] = counts.get(topic, 0) + 1
    last[topic] = message
topics = [("/scan", LaserScan), ("/odom", Odometry), ("/tf", TFMessage), ("/tf_static", TFMessage), ("/map", OccupancyGrid),
          ("/move_base/NavfnROS/plan", Path), ("/move_base/local_costmap/costmap", OccupancyGrid),
          ("/move_base/global_costmap/costmap_updates", OccupancyGridUpdate), ("/move_base/goal", MoveBaseActionGoal),
          ("/move_base/result", MoveBaseActionResult)]
kept = [rospy.Subscriber(name, kind, heard, callback_args=name, queue_size=100000) for name, kind in topics]
open(sys.argv[1], "w").close()
while not rospy.is_shutdown() and "/move_base/result" not in last:
    rospy.rostime.wallsleep(0.05)
rospy.rostime.wallsleep(0.5)
text = {"counts": counts, "beams": len(last["/scan"].ranges), "text": last["/move_base/result"].status.text,
        "map": [last["/map"].info.width, last["/map"].info.height]}
with open(sys.argv[2], "w") as out:
    json.dump(text, out)
"""


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    run = Run(read_scenario(shipped_scenarios()["narrow_door"]).build())
    while run.step():
        pass
    assert run.recorder is not None
    return export_run(run.recorder.record(), tmp_path / "run.bag").path


def test_rosbag_reads_and_plays_it(graph: Graph, bag: Path, tmp_path: Path) -> None:
    info = graph.run("/usr/bin/rosbag", "info", str(bag))
    assert "move_base_msgs/MoveBaseActionGoal" in info and "[660d6895a1b9a16dce51fbdd9a64a56b]" in info
    assert "/move_base/global_costmap/costmap_updates" in info
    ready, heard = tmp_path / "ready", tmp_path / "heard.json"
    listener = graph.start(PYTHON, "-c", LISTENER, str(ready), str(heard))
    wait_for(ready.exists, "the start of the listener")
    # subscribers need a moment to connect, which rosbag's own delay gives them
    graph.run("/usr/bin/rosbag", "play", "-q", "-d", "2", "-r", "4", str(bag))
    assert listener.wait(TIMEOUT_S) == 0
    found = json.loads(heard.read_text())
    assert found["counts"]["/scan"] == 97 and found["beams"] == 640
    assert found["counts"]["/tf"] > 400 and found["counts"]["/tf_static"] == 1
    assert found["counts"]["/move_base/NavfnROS/plan"] > 5
    assert found["text"] == "Goal reached."
    assert found["map"][0] > 100


def test_rviz_shows_it(graph: Graph, bag: Path, tmp_path: Path) -> None:
    graph.run("/usr/bin/rosparam", "set", "use_sim_time", "true")
    screen = tmp_path / "Xvfb_screen0"
    display = f":{100 + graph.port % 500}"
    graph.start("Xvfb", display, "-screen", "0", "1000x700x24", "-fbdir", str(tmp_path))
    wait_for(screen.exists, "the start of the virtual display")
    graph.start("rviz", "-d", str(RVIZ), DISPLAY=display)
    wait_for(lambda: "/rviz" in graph.run("/usr/bin/rosnode", "list"), "the start of RViz")
    graph.start("/usr/bin/rosbag", "play", "-q", "-d", "2", "-r", "0.5", "--clock", "--hz", "50", str(bag))
    colors = {"scan": (255, 0, 0), "plan": (0, 220, 0), "footprint": (0, 0, 255), "lethal": (136, 8, 136)}

    def shows_all() -> bool:
        picture = framebuffer(screen)
        return all(_has(picture, color) for color in colors.values())

    wait_for(shows_all, f"a picture with {', '.join(colors)}")


def framebuffer(file: Path) -> NDArray[np.uint8]:
    """Return the picture (ny, nx, 3) of a virtual display, which Xvfb keeps in an XWD file."""
    data = file.read_bytes()
    header = struct.unpack(">25I", data[:100])
    offset, width, height, row, colors = header[0], header[4], header[5], header[12], header[19]
    pixels = np.frombuffer(data, np.uint8, row * height, offset + 12 * colors).reshape(height, row)
    return pixels[:, : 4 * width].reshape(height, width, 4)[:, :, [2, 1, 0]]


def _has(picture: NDArray[np.uint8], color: tuple[int, int, int]) -> bool:
    distance = np.abs(picture.astype(int) - color).max(axis=2)
    return int((distance < 40).sum()) >= 20
