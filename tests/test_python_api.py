"""What a newcomer does wrong with the Python of the README: one clear message each, before anything is driven."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest

import navstack as nav
from navstack.core.errors import InputError, MapError

TUPLE: Any = (6.2, 12.0)


@pytest.fixture(scope="module")
def office() -> tuple[nav.Configuration, nav.OccupancyGrid]:
    return nav.load_configuration(["turtlebot"]), nav.load_map(nav.map_path("office"))


def test_poses_that_are_tuples(office: tuple[nav.Configuration, nav.OccupancyGrid]) -> None:
    params, grid = office
    start = nav.load_places("office").start
    robot = nav.simulated_robot(params, grid, start)
    move_base = nav.build_move_base(params, robot, static_map=grid)
    wrong: list[tuple[str, Callable[[], object]]] = [
        ("start", lambda: nav.simulated_robot(params, grid, TUPLE)),
        ("start", lambda: nav.plan_on_map(params, grid, TUPLE, start)),
        ("goal", lambda: nav.plan_on_map(params, grid, start, TUPLE)),
        ("goal", lambda: move_base.send_goal(TUPLE)),
        ("goal", lambda: move_base.send_goal(cast("nav.Pose2D", "kitchen"))),
    ]
    for what, call in wrong:
        with pytest.raises(InputError, match=rf"the {what} .+ is not a Pose2D; pass navstack\.Pose2D\(x, y, yaw\)"):
            call()
    assert move_base.send_goal(nav.Pose2D(*TUPLE)).id == "goal-1"  # what was refused left nothing behind


def test_the_name_of_a_packaged_map_is_no_file() -> None:
    with pytest.raises(MapError, match=r'navstack\.map_path\("office"\)'):
        nav.load_map("office")
