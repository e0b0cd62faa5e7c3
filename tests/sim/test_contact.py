"""A robot that touches an obstacle its lidar sees does not push against it, and backs away if it may reverse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import GridGeometry, OccupancyGrid, Pose2D, Twist2D
from navstack.parameters import load_configuration

CORNERS = [[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]]
FRONT, RADIUS, GAP = 0.3, 0.1, 0.004
CONTROL_PERIOD = 0.2


@pytest.mark.slow
@pytest.mark.parametrize("reverses", [True, False])
@pytest.mark.parametrize("beside", [0.0, 0.1, -0.15])
def test_a_box_does_not_push(beside: float, reverses: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disc appears 4 mm in front of the moving robot, which cannot stop in time."""
    costmaps = {"footprint": CORNERS, "footprint_padding": 0.01}
    all_round = {"navstack": {"sim": {"laser": {"fov": 2.0 * math.pi, "range_min": 0.02, "x": 0.0}}}}
    configuration = load_configuration(
        [
            "turtlebot",
            {"global_costmap": costmaps, "local_costmap": costmaps},
            {"DWAPlannerROS": {"min_vel_x": -0.2 if reverses else 0.0}},
            all_round,
        ]
    )
    grid = OccupancyGrid(np.zeros((120, 200), np.int8), GridGeometry(200, 120, 0.05, -1.0, -3.0))
    robot = simulated_robot(configuration, grid, Pose2D(0.0, 0.0, 0.0))
    move_base = build_move_base(configuration, robot, static_map=grid)
    handle = move_base.send_goal(Pose2D(6.0, 0.0, 0.0))
    commanded = [Twist2D()]
    drive = robot.command

    def command(twist: Twist2D) -> None:
        commanded.append(twist)
        drive(twist)

    monkeypatch.setattr(robot, "command", command)
    appeared, pushing = False, 0.0
    while not handle.is_done:
        begin, pose = robot.time, robot.pose
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
        if robot.in_collision and robot.pose == pose and commanded[-1] != Twist2D():
            pushing += robot.time - begin
        if not appeared and pose.x > 2.0:
            appeared, pose = True, robot.pose
            ahead = FRONT + RADIUS + GAP
            x = pose.x + ahead * math.cos(pose.yaw) - beside * math.sin(pose.yaw)
            y = pose.y + ahead * math.sin(pose.yaw) + beside * math.cos(pose.yaw)
            robot.world.put_discs([[x, y, RADIUS]])
    assert len(robot.collisions) == 1
    assert pushing <= 2.0 * CONTROL_PERIOD
    if reverses:
        assert handle.status.name == "SUCCEEDED"
    else:
        assert handle.result.error_name == "NO_VALID_CONTROL"
