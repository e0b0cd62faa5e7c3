"""A global costmap in another frame than the map's: the map is used, or the robot does not drive."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.bringup import build_move_base, plan_on_map, simulated_robot
from navstack.core import Event, GridGeometry, OccupancyGrid, Pose2D, Transform2D
from navstack.move_base import GoalStatus
from navstack.parameters import load_configuration

START, GOAL = Pose2D(1.0, 1.0, 0.0), Pose2D(5.0, 1.0, 0.0)
GEOMETRY = GridGeometry(120, 100, 0.05)
FRAME = "global_costmap/global_frame=robot_map"


def walled_map() -> OccupancyGrid:
    """A wall at x = 3 m with a gap above y = 4 m."""
    data = np.zeros(GEOMETRY.shape, np.int8)
    data[:80, 60] = 100
    return OccupancyGrid(data, GEOMETRY)


def crosses_wall(poses: NDArray[np.float64]) -> bool:
    cells = [GEOMETRY.world_to_cell(x, y) for x, y in poses[:, :2].tolist()]
    return any(cell is None or walled_map().data[cell[1], cell[0]] == 100 for cell in cells)


class Events:
    def __init__(self) -> None:
        self.events: list[Event] = []

    def on_event(self, event: Event) -> None:
        self.events.append(event)


def test_the_map_is_used_in_the_global_frame() -> None:
    configuration = load_configuration(["turtlebot"], overrides=[FRAME])
    robot = simulated_robot(configuration, walled_map(), START)
    robot.scans = lambda: ()  # type: ignore[method-assign]  # only the map shows the wall
    listener = Events()
    move_base = build_move_base(configuration, robot, static_map=walled_map(), listeners=[listener])
    (warning,) = [e for e in listener.events if e.kind == "warning"]
    assert 'the frame "map" of the map' in warning.text
    assert 'frame_id of map_server to "robot_map"' in warning.text
    move_base.send_goal(GOAL)
    move_base.tick(robot.time)
    assert int((move_base.global_costmap.master.data == 254).sum()) == 80
    assert move_base.plan is not None
    assert move_base.plan.path.frame == "robot_map"
    assert move_base.plan.path.length > 6.0
    assert not crosses_wall(move_base.plan.path.poses)


def test_costmaps_with_two_frames_of_the_robot() -> None:
    """base_link and base_footprint are one pose in the plane: the simulated robot has both, as robot_state_publisher gives."""
    other = "global_costmap/robot_base_frame=base_link"
    configuration = load_configuration(["turtlebot"], overrides=[other])
    assert configuration.local_costmap.params.robot_base_frame == "base_footprint"
    robot = simulated_robot(configuration, walled_map(), START)
    move_base = build_move_base(configuration, robot, static_map=walled_map())
    move_base.send_goal(GOAL)
    move_base.tick(robot.time)
    assert move_base.plan is not None
    assert robot.frames.lookup("base_footprint", "base_link") == Transform2D()


def test_no_plan_without_the_map() -> None:
    configuration = load_configuration(["turtlebot"], overrides=[FRAME])
    robot = simulated_robot(configuration, walled_map(), START)
    # known to the robot, but not connected
    robot.frames.set_static("map", "somewhere", Transform2D())
    move_base = build_move_base(configuration, robot, static_map=walled_map())
    handle = move_base.send_goal(GOAL)
    while not handle.is_done:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "TF_ERROR")
    assert '"robot_map"' in handle.result.message
    assert robot.pose.distance_to(START) < 0.01


@pytest.mark.parametrize("frame", ["map", "robot_map", "/robot_map"])
def test_plans_on_the_map(frame: str) -> None:
    configuration = load_configuration(["turtlebot"], overrides=[f"global_costmap/global_frame={frame}"])
    found = plan_on_map(configuration, walled_map(), START, GOAL)
    assert not crosses_wall(found.plan.path.poses)
    assert found.plan.path.length > 6.0
