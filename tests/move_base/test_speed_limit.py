"""A speed limit from outside, as Nav2's topic speed_limit sets it."""

from __future__ import annotations

import math

import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import InputError, Pose2D
from navstack.map_io import load_map, map_path
from navstack.move_base import GoalStatus
from navstack.parameters import load_configuration


@pytest.mark.slow
def test_a_limit_from_outside() -> None:
    configuration, grid = load_configuration(["turtlebot"]), load_map(map_path("office"))
    robot = simulated_robot(configuration, grid, Pose2D(1.0, 7.45))
    move_base = build_move_base(configuration, robot, static_map=grid)
    fastest: list[float] = []
    for limit, x in ((0.2, 2.5), (None, 4.0), (0.0, 2.5)):
        move_base.limit_speed(limit)
        handle = move_base.send_goal(Pose2D(x, 7.45))
        speeds: list[float] = []
        while not handle.is_done:
            now = move_base.next_due(move_base.now)
            robot.advance_to(now)
            move_base.tick(now)
            speeds.append(move_base.command.vx)
        assert handle.status is GoalStatus.SUCCEEDED
        fastest.append(max(speeds))
    assert fastest[0] <= 0.2 + 1e-6 and fastest[1] > 0.4 and fastest[2] > 0.4
    with pytest.raises(InputError, match="speed limit"):
        move_base.limit_speed(math.nan)
