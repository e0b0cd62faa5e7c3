"""Generated suites on larger maps: a wide robot fits where a small one did."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from navstack.core import Footprint, OccupancyGrid, Pose2D
from navstack.parameters import load_configuration
from navstack.scenario import ScenarioSpec, load_suite, scaled, suite_scale
from navstack.studies.setup import SearchOptions, prepare

WIDE = Footprint(np.array([[0.6, 0.5], [0.6, -0.5], [-0.6, -0.5], [-0.6, 0.5]]))
WIDE_TEXT = "[[0.6, 0.5], [0.6, -0.5], [-0.6, -0.5], [-0.6, 0.5]]"
GENERATED = ("crowd", "narrow", "office", "warehouse")


def clearances(grid: OccupancyGrid) -> np.ndarray:
    """Distance (m) of each cell to the nearest cell that is not free."""
    return np.asarray(ndimage.distance_transform_edt(grid.data == 0)) * grid.geometry.resolution


def cell(grid: OccupancyGrid, pose: Pose2D) -> tuple[int, int]:
    g = grid.geometry
    return int((pose.y - g.origin_y) / g.resolution), int((pose.x - g.origin_x) / g.resolution)


def fits(spec: ScenarioSpec, footprint: Footprint) -> bool:
    """True if the robot can turn at both ends and its inscribed circle can move from one to the other."""
    grid = spec.map()
    free = clearances(grid)
    assert spec.start is not None
    ends = [cell(grid, spec.start), cell(grid, spec.goals[0])]
    found: Any = ndimage.label(free >= footprint.inscribed_radius, np.ones((3, 3)))
    labels: np.ndarray = found[0]
    return all(free[at] >= footprint.circumscribed_radius for at in ends) and labels[ends[0]] == labels[ends[1]] != 0


@pytest.mark.parametrize("name", GENERATED)
def test_a_robot_of_one_meter_fits_on_the_scaled_maps(name: str) -> None:
    specs = load_suite(name, count=4)
    assert name == "crowd" or not all(fits(spec, WIDE) for spec in specs)  # the corridor is wide enough
    factor = suite_scale(name, WIDE)
    assert factor > 1.5
    larger = scaled(specs, factor)
    assert all(fits(spec, WIDE) for spec in larger)
    for small, large in zip(specs, larger, strict=True):
        assert small.start is not None
        assert large.start is not None
        assert math.isclose(large.start.x, factor * small.start.x)
        assert large.start.yaw == small.start.yaw
        assert large.map().geometry.resolution == small.map().geometry.resolution
        assert [s.radius for s in large.shapes] == [s.radius for s in small.shapes]
        assert large.values["time_limit_s"] == factor * small.values["time_limit_s"]


@pytest.mark.parametrize("name", GENERATED)
def test_the_maps_of_the_packaged_robots_stay_as_they_are(name: str) -> None:
    for robot in ("turtlebot", "jackal_dwa", "omni_dwa"):
        assert suite_scale(name, load_configuration([robot]).global_costmap.footprint) == 1.0


def test_scenario_files_are_never_scaled() -> None:
    assert suite_scale("shipped", WIDE) == 1.0


def test_tuning_says_that_the_maps_are_larger() -> None:
    parts = tuple(f"{costmap}/footprint={WIDE_TEXT}" for costmap in ("global_costmap", "local_costmap"))
    setup = prepare(SearchOptions(("turtlebot",), "office", overrides=parts, count=2))
    assert setup.suite.scale > 1.5
    assert f"are {setup.suite.scale:g} times as large as usual" in setup.scale_text
    assert setup.described()["scale"] == setup.suite.scale
    assert setup.evaluation().cases
    assert prepare(SearchOptions(("turtlebot",), "office", count=2)).scale_text == ""
