"""Arrays as maps: what they mean is named or refused, and no plan crosses a wall of the array."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.core.errors import InputError, NavError, PlanningError, StartOutsideMapError

WALL: Any = np.zeros((40, 160), bool)
WALL[:, 80] = True
OPEN: Any = WALL.copy()
OPEN[:5, 80] = False
GEOMETRY = nav.GridGeometry(160, 40, 0.05)
START, GOAL = (1.0, 1.0), (7.0, 1.0)
NAMES = tuple(
    e.name for e in nav.GLOBAL_PLANNERS if e.name not in ("carrot_planner", "given_path")
)  # which check the end of their path only, or have none by default


def spellings(walls: Any) -> list[tuple[Any, str | None]]:
    """The same walls in every dtype and meaning."""
    same: list[tuple[Any, str | None]] = [(walls, None), (walls.tolist(), None), (~walls, "free")]
    for dtype in (np.int8, np.uint8, np.int16, np.int64, np.uint64):
        same += [((walls * 100).astype(dtype), None), (walls.astype(dtype), "occupied")]
    for dtype in (np.float16, np.float32, np.float64):
        same += [
            ((walls * 100).astype(dtype), "occupancy"),
            (walls.astype(dtype), "probability"),
            (walls.astype(dtype), "occupied"),
        ]
    same.append((np.asfortranarray(walls * 100), None))
    return same


@pytest.mark.slow
@pytest.mark.parametrize("planner", NAMES)
def test_no_plan_crosses_a_wall_in_any_dtype(planner: str) -> None:
    for array, values in spellings(WALL):
        with pytest.raises(PlanningError):
            nav.plan(array, 0.05, START, GOAL, planner=planner, values=values)  # type: ignore[arg-type]
        with pytest.raises(NavError):
            nav.OccupancyGrid(array, 0.05)  # type: ignore[arg-type]


def test_every_dtype_gives_the_same_plan() -> None:
    plans = [nav.plan(a, 0.05, START, GOAL, planner="astar", values=v).path.poses for a, v in spellings(OPEN)]  # type: ignore[arg-type]
    assert all(np.array_equal(p, plans[0]) for p in plans)
    cells = [GEOMETRY.world_to_cell(x, y) for x, y, _ in plans[0]]
    assert not any(OPEN[c[1], c[0]] for c in cells if c)


def test_the_robot_keeps_its_radius() -> None:
    centers = (np.argwhere(OPEN)[:, ::-1] + 0.5) * 0.05
    for radius in (0.0, 0.04, 0.1, 0.12):
        poses = nav.plan(OPEN, 0.05, START, GOAL, planner="astar", robot_radius=radius).path.poses[1:-1]
        gaps = np.hypot(*(centers[None] - poses[:, None, :2]).transpose(2, 0, 1))
        assert gaps.min() > radius
    with pytest.raises(PlanningError):
        nav.plan(OPEN, 0.05, START, GOAL, planner="astar", robot_radius=0.3)


def test_unknown_cells_count_as_occupied_unless_asked() -> None:
    fog = np.where(WALL, -1, 0)
    with pytest.raises(PlanningError):
        nav.plan(fog, 0.05, START, GOAL)
    assert nav.plan(fog, 0.05, START, GOAL, unknown="free").path.length == pytest.approx(6.0, abs=0.1)
    with pytest.raises(PlanningError):
        nav.plan(np.where(WALL, np.nan, 0.0), 0.05, START, GOAL, values="probability")


def test_thresholds_are_those_of_map_server() -> None:
    grid = nav.OccupancyGrid.from_array(np.array([[0, 19, 20, 64, 65, 100, -1]]), 0.05)
    assert grid.data.tolist() == [[0, 0, -1, -1, 100, 100, -1]] and grid.data.dtype == np.int8
    chance = np.array([[0.0, 0.196, 0.2, 0.649, 0.65, 1.0, np.nan]])
    assert nav.OccupancyGrid.from_array(chance, 0.05, values="probability").data.tolist() == grid.data.tolist()


@pytest.mark.parametrize(
    ("array", "values", "text"),
    [
        (WALL * 1, None, "ambiguous"),
        (WALL * 1.0, None, "float64 map have no default meaning"),
        (WALL * 2.0, "probability", r"2\.0 at \[iy=0, ix=80\], which is not in 0 \.\. 1"),
        (WALL * 254, None, r"254 at \[iy=0, ix=80\], which is not in -1 \.\. 100"),
        (WALL * np.uint8(255), None, "255 at"),
        (WALL * -2, None, "-2 at"),
        (WALL * 0.5, "occupancy", "not a whole number"),
        (np.where(WALL, np.inf, 0.0), "probability", "inf at"),
        (np.where(WALL, np.nan, 0.0), "occupied", "not finite"),
        (np.where(WALL, np.nan, 0.0), "occupancy", "not a whole number"),
        (WALL, "occupancy", "not bools"),
        (WALL, "blocked", "unknown; pass"),
        (WALL[0], None, "of shape"),
        (WALL[None], None, "of shape"),
        (np.zeros((0, 4), bool), None, "at least one cell"),
        (np.zeros((2, 2), complex), None, "complex128"),
        (np.array([["a"]]), None, "bools or numbers"),
        ([[1], [1, 2]], None, "not an array"),
        (None, None, "of shape"),
    ],
)
def test_arrays_without_a_clear_meaning_are_refused(array: Any, values: Any, text: str) -> None:
    with pytest.raises(InputError, match=text):
        nav.OccupancyGrid.from_array(array, 0.05, values=values)


@pytest.mark.parametrize("resolution", [0.0, -0.05, math.nan, math.inf, "0.05", None, True, (0.05, 0.05)])
def test_resolutions_are_checked(resolution: Any) -> None:
    with pytest.raises(InputError, match="resolution must be a positive number"):
        nav.plan(WALL, resolution, START, GOAL)


def test_the_constructor_takes_what_map_server_publishes_only() -> None:
    data = (WALL * 100).astype(np.int8)
    make: Any = nav.OccupancyGrid
    geometry_of: Any = nav.GridGeometry
    nav.OccupancyGrid(data, GEOMETRY)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"data": WALL}, "not bool"),
        ({"data": data * 1.0}, "not float64"),
        ({"data": data.astype(np.int64)}, "not int64"),
        ({"data": data.tolist()}, "not list"),
        ({"data": data.T}, "shape"),
        ({"data": data - np.int8(2)}, "-2 at"),
        ({"data": data + np.int8(1)}, "101 at"),
        ({"geometry": 0.05}, "GridGeometry, not 0.05"),
        ({"origin_yaw": math.nan}, "origin_yaw"),
        ({"frame": ""}, "frame"),
        ({"frame": 3}, "frame"),
    ]
    for change, text in wrong:
        with pytest.raises(InputError, match=text):
            make(**{"data": data, "geometry": GEOMETRY, **change})
    assert nav.OccupancyGrid(data - np.int8(2), GEOMETRY, raw=True).data.min() == -2
    for geometry in ((0, 4, 0.05), (4, 4, 0.0), (4, 4, 0.05, math.nan)):
        with pytest.raises(InputError):
            geometry_of(*geometry)
    for costs in (WALL, [[0]], np.zeros((3, 3), np.uint8)):
        with pytest.raises(InputError):
            nav.Costmap(GEOMETRY, costs)  # type: ignore[arg-type]


def test_the_other_arguments_of_plan() -> None:
    with pytest.raises(StartOutsideMapError):
        nav.plan(OPEN, 0.05, (-1.0, 1.0), GOAL)
    for change, text in (
        ({"start": (1.0,)}, "is not \\(x, y\\)"),
        ({"goal": 7.0}, "is not \\(x, y\\)"),
        ({"robot_radius": "0.1"}, "robot_radius"),
        ({"start": ("a", 1.0)}, "is not \\(x, y\\)"),
        ({"goal": (math.nan, 1.0)}, "not finite"),
        ({"planner": "atsar"}, 'did you mean "astar"'),
        ({"unknown": "maybe"}, "neither"),
        ({"robot_radius": -0.1}, "robot_radius"),
        ({"origin": (0.0,)}, "origin"),
    ):
        arguments: dict[str, Any] = {"array": OPEN, "resolution": 0.05, "start": START, "goal": GOAL, **change}
        with pytest.raises(NavError, match=text):
            nav.plan(**arguments)
    moved = nav.plan(OPEN, 0.05, nav.Pose2D(-9.0, 6.0), (-3.0, 6.0), origin=(-10.0, 5.0), planner="astar")
    assert np.allclose(
        moved.path.poses[:, :2] + (10.0, -5.0), nav.plan(OPEN, 0.05, START, GOAL, planner="astar").path.poses[:, :2]
    )
