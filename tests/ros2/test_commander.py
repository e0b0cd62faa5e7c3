"""Nav2's own client, nav2_simple_commander, drives the navigator unmodified.

Its source is not in this repository: NAVSTACK_NAV2_COMMANDER is a folder with robot_navigator.py of Nav2's Kilted.
"""

from __future__ import annotations

import os

import pytest

from tests.ros2.conftest import Graph

FOLDER = os.environ.get("NAVSTACK_NAV2_COMMANDER", "")
SCRIPT = """
sys.path.insert(0, sys.argv[2])
from robot_navigator import BasicNavigator, TaskResult
from rclpy.parameter import Parameter
from nav_msgs.msg import Goals

Goals.__len__ = lambda self: len(self.goals)  # robot_navigator.py of 1.4.2 takes Goals and logs their len

rclpy.try_shutdown()
rclpy.init()
navigator = BasicNavigator()
navigator.set_parameters([Parameter("use_sim_time", value=True)])
navigator.setInitialPose(stamped(1.0, 7.45))
navigator.waitUntilNav2Active()
found["active"] = True

def done():
    while not navigator.isTaskComplete():
        feedback = navigator.getFeedback()
    return navigator.getResult().name

found["path"] = len(navigator.getPath(stamped(1.0, 7.45), stamped(4.0, 7.45), use_start=True).poses)
found["smooth"] = len(navigator.smoothPath(navigator.getPath(stamped(1.0, 7.45), stamped(4.0, 7.45))).poses)
navigator.goToPose(stamped(3.0, 7.45)); found["go"] = done()
navigator.goThroughPoses(Goals(goals=[stamped(4.0, 7.45), stamped(5.0, 7.45)])); found["through"] = done()
navigator.followWaypoints([stamped(4.0, 7.45), stamped(3.5, 7.45)]); found["waypoints"] = done()
navigator.spin(0.5); found["spin"] = done()
navigator.spin(-0.5); found["spin back"] = done()
navigator.backup(0.2, 0.1); found["backup"] = done()
navigator.driveOnHeading(0.2, 0.1); found["drive"] = done()
navigator.followPath(navigator.getPath(stamped(0.0, 0.0), stamped(2.5, 7.45))); found["follow"] = done()
navigator.goToPose(stamped(11.0, 7.4)); navigator.cancelTask(); found["cancel"] = done()
navigator.goToPose(stamped(600.0, 7.4)); found["fail"] = [done(), *navigator.getTaskError()]
navigator.clearAllCostmaps()
found["costmaps"] = [len(navigator.getGlobalCostmap().data), len(navigator.getLocalCostmap().data)]
navigator.changeMap(sys.argv[3]); found["map"] = True
navigator.destroyNode()
"""


@pytest.mark.skipif(not FOLDER, reason="set NAVSTACK_NAV2_COMMANDER to a folder with Nav2's robot_navigator.py")
def test_simple_commander(office: Graph) -> None:
    from navstack.map_io import map_path

    found = office.ask(SCRIPT, FOLDER, str(map_path("office")))
    assert found["active"] and found["path"] > 20 and found["smooth"] > 10
    for task in ("go", "through", "waypoints", "spin", "spin back", "backup", "drive", "follow"):
        assert found[task] == "SUCCEEDED", task
    assert found["cancel"] == "CANCELED"
    result, code, text = found["fail"]
    assert result == "FAILED" and code == 204 and text
    assert min(found["costmaps"]) > 1000
