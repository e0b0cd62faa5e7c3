"""What a newcomer does wrong with the Python of the README: one clear message each, before anything is driven."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest
import shapely

import navstack as nav
from navstack.core import InputError, MapError

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


def test_a_packaged_map_is_loaded_by_its_name() -> None:
    assert np.array_equal(nav.load_map("office").data, nav.load_map(nav.map_path("office")).data)
    with pytest.raises(MapError, match="offise"):
        nav.load_map("offise")


WALL = np.zeros((60, 120), bool)
WALL[15:, 60] = True
BOX = [(0.6, 0.35), (-0.6, 0.35), (-0.6, -0.35), (0.6, -0.35)]


def plan_past_wall(**arguments: Any) -> nav.Path:
    return nav.plan(WALL, 0.05, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), planner="smac_hybrid", **arguments).path


@pytest.mark.slow
def test_plan_on_an_array_for_a_shape_and_a_turning_radius() -> None:
    """A wall of cells at x = 3.0 to 3.05 m, open below y = 0.75 m."""
    bent, straight = (
        plan_past_wall(
            footprint=BOX, parameters={"minimum_turning_radius": r, "motion_model_for_search": "REEDS_SHEPP"}
        )
        for r in (0.4, 0.2)
    )
    wall = shapely.box(3.0, 0.75, 3.05, 3.0)
    for path in (bent, straight):
        assert tuple(path.poses[-1]) == pytest.approx((5.0, 2.0, 0.0), abs=1e-9)
        assert not any(wall.intersects(shapely.Polygon(nav.Footprint(np.array(BOX)).at(p))) for p in path)
    assert straight.length < bent.length


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            {"parameters": {"minimum_turning_radus": 0.4}},
            'no parameter "minimum_turning_radus"; did you mean "minimum_turning_radius"',
        ),
        ({"parameters": {"minimum_turning_radius": -1.0}}, "minimum_turning_radius = -1 is out of range"),
        ({"parameters": {"minimum_turning_radius": "0.4"}}, 'minimum_turning_radius = "0.4" is text; write a number'),
        ({"parameters": [1]}, "not a dictionary"),
        ({"footprint": [(0.1, 0.1)]}, "at least three points"),
        ({"footprint": "1.2x0.7"}, "not a list of corners"),
        ({"footprint": BOX, "robot_radius": 0.2}, "exclude each other"),
    ],
)
def test_wrong_shapes_and_parameters_of_a_plan(arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        plan_past_wall(**arguments)


def test_every_kind_of_plugin_has_its_registry_in_the_package() -> None:
    assert {"simple", "constrained"} <= {entry.name for entry in nav.SMOOTHERS}
    assert "amcl" in {entry.name for entry in nav.LOCALIZERS}
