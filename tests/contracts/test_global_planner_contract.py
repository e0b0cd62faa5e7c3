"""The contract of every registered global planner, on small maps.

The tests include third-party planners that are registered by entry point, with their default parameters, and require that
their paths avoid cells of cost 253 and 254.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Footprint,
    GoalOccupiedError,
    GoalOutsideMapError,
    GridGeometry,
    InputError,
    NoValidPathError,
    PlanningError,
    PlanningTimeoutError,
    Pose2D,
    StartOccupiedError,
    StartOutsideMapError,
)
from navstack.plugins import GLOBAL_PLANNERS, GlobalPlanner, Plan

RESOLUTION = 0.1
LEGEND = {".": 0, "-": 60, "+": 200, "i": 253, "#": 254, "?": 255}
# every combination that changes how a built-in planner searches; other planners use their defaults
VARIANTS: dict[str, list[dict[str, object]]] = {
    "navfn": [{}, {"use_astar": True}, {"allow_unknown": False}],
    "global_planner": [
        {"use_dijkstra": d, "use_quadratic": q, "use_grid_path": g}
        for d in (True, False)
        for q in (True, False)
        for g in (True, False)
    ]
    + [{"old_navfn_behavior": True}, {"outline_map": False}, {"allow_unknown": False}],
    "astar": [{}, {"heuristic_weight": 2.0, "cut_corners": True}, {"allow_unknown": False}],
    "smac_2d": [
        {"tolerance": 0.0},
        {"tolerance": 0.0, "use_quadratic_cost_penalty": True, "cost_travel_multiplier": 3.0},
        {"tolerance": 0.0, "allow_unknown": False},
    ],
    "theta_star": [{}, {"cost_factor": 0.0}, {"allow_unknown": False}],
}
STEERED = {"smac_hybrid", "smac_lattice"}
"""Planners for robots that cannot turn in place: corridors one cell wide have no room for their turns. tests/global_planner has
their tests."""
BESIDE = {"nav2_navfn"}
"""Planners whose cells lie half a cell beside those of the costmap, as in Nav2: the center of a cell is the corner of another.
Golden data and tests/global_planner have their tests."""
STRAIGHT_ONLY = {"carrot_planner"}
"""Planners that do not search: their paths are straight and may end before the goal."""
GIVEN = {"given_path"}
"""Planners of a path in their parameters: their own tests check them."""


def planners() -> list[tuple[str, dict[str, object]]]:
    return [
        (e.name, v)
        for e in GLOBAL_PLANNERS
        if e.name not in GIVEN | STEERED | BESIDE
        for v in VARIANTS.get(e.name, [{}])
    ]


def name_of(planner: tuple[str, dict[str, object]]) -> str:
    return "-".join([planner[0], *(f"{k}={v}" for k, v in planner[1].items())])


def build(planner: tuple[str, dict[str, object]], **more: object) -> GlobalPlanner:
    cls = GLOBAL_PLANNERS.get(planner[0]).cls
    return cls(cls.Params(**planner[1], **more))


def has_parameter(planner: tuple[str, dict[str, object]], name: str) -> bool:
    """Whether a planner has a parameter; third-party planners may have others."""
    return name in GLOBAL_PLANNERS.get(planner[0]).cls.Params.model_fields


def ascii_map(text: str, origin: tuple[float, float] = (-1.0, 2.0)) -> Costmap:
    """A costmap from a drawing; the first line is the top row."""
    rows = [line.strip() for line in text.strip().splitlines()][::-1]
    data = np.array([[LEGEND[c] for c in row] for row in rows], np.uint8)
    return Costmap(GridGeometry(data.shape[1], data.shape[0], RESOLUTION, *origin), data)


def at(costmap: Costmap, ix: int, iy: int, yaw: float = 0.0) -> Pose2D:
    return Pose2D(*costmap.geometry.cell_to_world(ix, iy), yaw)


def cells_on(plan: Plan, costmap: Costmap, corners: bool) -> NDArray[np.int64]:
    """Cells (n, 2) that contain the path's points; points of navfn are the lower left corners of their cells."""
    g = costmap.geometry
    shift = 0.5 if corners else 0.0
    xy = (plan.path.poses[:-1, :2] - (g.origin_x, g.origin_y)) / g.resolution + shift
    return np.floor(xy + 1e-6).astype(np.int64)


ROOM = """
    ####################
    #..................#
    #..................#
    #.......#######....#
    #.......#...--#....#
    #.......#...--+....#
    #.......#...--#....#
    #.......#######....#
    #..................#
    #..................#
    ####################
"""
CLOSED = """
    ############
    #....#.....#
    #....#.....#
    #....#.....#
    ############
"""
UNKNOWN_DOOR = """
    ############
    #....#.....#
    #....?.....#
    #....#.....#
    ############
"""
SERPENTINE = """
    ####################
    #..................#
    ##################.#
    #..................#
    #.##################
    #..................#
    ##################.#
    #..................#
    ####################
"""

each_planner = pytest.mark.parametrize("planner", planners(), ids=name_of)
searching = pytest.mark.parametrize("planner", [p for p in planners() if p[0] not in STRAIGHT_ONLY], ids=name_of)


def searching_with(parameter: str) -> pytest.MarkDecorator:
    which = [p for p in planners() if p[0] not in STRAIGHT_ONLY and has_parameter(p, parameter)]
    return pytest.mark.parametrize("planner", which, ids=name_of)


def assert_contract(
    plan: Plan, costmap: Costmap, start: Pose2D, goal: Pose2D, planner: tuple[str, dict[str, object]]
) -> None:
    poses = plan.path.poses
    assert poses.dtype == np.float64
    assert np.isfinite(poses).all()
    assert len(poses) >= 1
    assert plan.path.frame == costmap.frame
    assert ((-math.pi < poses[:, 2]) & (poses[:, 2] <= math.pi)).all()
    assert np.hypot(*(poses[0, :2] - start[:2])) <= RESOLUTION  # in its cell or on its corner
    assert tuple(poses[-1]) == pytest.approx(tuple(plan.goal))
    assert plan.goal_moved_m == pytest.approx(plan.goal.distance_to(goal), abs=1e-9)
    assert np.isfinite(plan.cost)
    assert plan.cost >= 0.0
    assert plan.cells_expanded >= 0
    assert plan.took_s is None or plan.took_s >= 0.0
    assert plan.length_m == pytest.approx(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()))
    assert plan.clearance_m(costmap) >= 0.0
    if planner[0] in STRAIGHT_ONLY:
        return
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert (steps <= 2.0 * RESOLUTION).all()  # continuous
    corners = planner[0] == "navfn" or planner[1].get("old_navfn_behavior") is True
    cells = cells_on(plan, costmap, corners)
    start_cell = costmap.geometry.world_to_cell(start.x, start.y)
    for ix, iy in cells:
        assert costmap.geometry.contains_cell(int(ix), int(iy))
        if (ix, iy) != start_cell:
            assert costmap.data[iy, ix] not in (253, 254)


@searching
@pytest.mark.parametrize("drawing", [ROOM, SERPENTINE], ids=["room", "serpentine"])
def test_a_path_from_start_to_goal(planner: tuple[str, dict[str, object]], drawing: str) -> None:
    costmap = ascii_map(drawing)
    ny, nx = costmap.data.shape
    start, goal = at(costmap, 1, ny - 2, 0.3), at(costmap, nx - 2, 1, -2.0)
    before = costmap.data.copy()
    plan = build(planner).make_plan(costmap, start, goal, keep_potential=True)
    assert_contract(plan, costmap, start, goal, planner)
    assert (costmap.data == before).all()
    assert plan.goal == goal
    assert plan.goal_moved_m == 0.0
    if plan.potential is not None:
        assert plan.potential.shape == costmap.data.shape
        assert plan.potential.dtype == np.float32
        assert not np.isnan(plan.potential).any()


@searching
def test_into_a_room_behind_an_expensive_door(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(ROOM)
    start, goal = at(costmap, 1, 1), at(costmap, 10, 5)
    plan = build(planner).make_plan(costmap, start, goal)
    assert_contract(plan, costmap, start, goal, planner)
    cells = {
        tuple(c) for c in cells_on(plan, costmap, planner[0] == "navfn" or "old_navfn_behavior" in planner[1]).tolist()
    }
    assert (14, 5) in cells or any(abs(x - 14) <= 1 and abs(y - 5) <= 1 for x, y in cells)


@each_planner
def test_same_input_same_plan(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(ROOM)
    start, goal = at(costmap, 2, 2), at(costmap, 17, 8, 1.0)
    one, other = build(planner), build(planner)
    first = one.make_plan(costmap, start, goal)
    one.make_plan(costmap, at(costmap, 5, 8), at(costmap, 3, 1))
    one.make_plan(ascii_map(SERPENTINE), at(costmap, 1, 7), at(costmap, 5, 1)) if planner[
        0
    ] not in STRAIGHT_ONLY else None
    again = one.make_plan(costmap, start, goal)
    fresh = other.make_plan(costmap.copy(), start, goal)
    for plan in (again, fresh):
        assert plan.path.poses.tobytes() == first.path.poses.tobytes()
        assert plan.cost == first.cost


@each_planner
def test_frame_and_origin_of_the_costmap(planner: tuple[str, dict[str, object]]) -> None:
    near, far = ascii_map(ROOM, (0.0, 0.0)), ascii_map(ROOM, (-100.0, 50.0))
    far.frame = "odom"
    a = build(planner).make_plan(near, at(near, 2, 2), at(near, 17, 2))
    b = build(planner).make_plan(far, at(far, 2, 2), at(far, 17, 2))
    assert b.path.frame == "odom"
    # rounding may put the poses of nav2_theta_star at other places along the path
    moved = shapely.LineString(b.path.poses[:, :2] - (-100.0, 50.0))
    assert shapely.hausdorff_distance(moved, shapely.LineString(a.path.poses[:, :2])) < 1e-6
    if planner[0] != "nav2_theta_star":
        assert len(a.path) == len(b.path)


@each_planner
def test_start_is_goal(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(ROOM)
    pose = at(costmap, 3, 3, 0.5)
    plan = build(planner).make_plan(costmap, pose, pose)
    assert_contract(plan, costmap, pose, pose, planner)
    assert plan.path.length <= 2.0 * RESOLUTION


@each_planner
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["x", "y", "yaw"])
def test_poses_that_are_not_finite(planner: tuple[str, dict[str, object]], bad: float, field: str) -> None:
    costmap = ascii_map(ROOM)
    good = at(costmap, 3, 3)
    wrong = good._replace(**{field: bad})
    for start, goal, what in ((wrong, good, "start"), (good, wrong, "goal")):
        with pytest.raises(InputError, match=what):
            build(planner).make_plan(costmap, start, goal)


@each_planner
@pytest.mark.parametrize(("dx", "dy"), [(-5.0, 0.0), (5.0, 0.0), (0.0, -5.0), (0.0, 5.0)])
def test_outside_the_map(planner: tuple[str, dict[str, object]], dx: float, dy: float) -> None:
    costmap = ascii_map(ROOM)
    good = at(costmap, 3, 3)
    wrong = Pose2D(good.x + dx, good.y + dy)
    with pytest.raises(StartOutsideMapError, match="start") as start_error:
        build(planner).make_plan(costmap, wrong, good)
    assert start_error.value.code == 203
    assert start_error.value.data["extent"] == list(costmap.geometry.extent)
    if planner[0] == "carrot_planner":  # as in C++, it steps back from a goal outside, and keeps a point inside
        plan = build(planner).make_plan(costmap, good, wrong)
        assert costmap.geometry.world_to_cell(plan.goal.x, plan.goal.y) is not None
        assert plan.goal_moved_m == pytest.approx(wrong.distance_to(plan.goal))
        assert "outside the costmap" in plan.notes[0]
        return
    with pytest.raises(GoalOutsideMapError, match="goal") as goal_error:
        build(planner).make_plan(costmap, good, wrong)
    assert goal_error.value.code == 204


@searching
def test_goal_in_an_obstacle(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(ROOM)
    with pytest.raises(GoalOccupiedError, match=r"lethal \(254\)") as error:
        build(planner).make_plan(costmap, at(costmap, 2, 2), at(costmap, 8, 5))
    assert error.value.code == 206
    assert error.value.data["cost"] == 254
    assert error.value.data["nearest_free_distance_m"] == pytest.approx(RESOLUTION)


@searching
def test_unreachable_goal(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(CLOSED)
    goal = at(costmap, 8, 2)
    with pytest.raises(NoValidPathError, match="nearest to the goal") as error:
        build(planner).make_plan(costmap, at(costmap, 2, 2), goal)
    assert error.value.code == 208
    assert error.value.data["nearest_reachable"] == pytest.approx(costmap.geometry.cell_to_world(4, 2))
    assert error.value.data["nearest_reachable_distance_m"] == pytest.approx(0.4)
    assert error.value.data["cells_expanded"] >= 0
    (blockage,) = error.value.data["blocked_by"]
    assert blockage["kind"] == "obstacle"
    assert blockage["x"] == pytest.approx(costmap.geometry.cell_to_world(5, 2)[0])


@searching
def test_the_error_names_the_gap_that_is_too_narrow(planner: tuple[str, dict[str, object]]) -> None:
    """Of two blocked routes, the one where the robot nearly fits."""
    costmap = ascii_map(CLOSED)
    costmap.data[2, 5] = 253
    with pytest.raises(NoValidPathError, match="too narrow for the robot") as error:
        build(planner).make_plan(costmap, at(costmap, 2, 2), at(costmap, 8, 2))
    (blockage,) = error.value.data["blocked_by"]
    assert blockage["kind"] == "too narrow"
    assert blockage["gap_m"] == pytest.approx(
        RESOLUTION
    )  # two cells between the centers of the walls, less half a cell each
    assert (blockage["x"], blockage["y"]) == pytest.approx(costmap.geometry.cell_to_world(5, 2))


@pytest.mark.parametrize("name", ["navfn", "global_planner", "astar", "theta_star"])
def test_unknown_space(name: str) -> None:
    costmap = ascii_map(UNKNOWN_DOOR)
    start, goal = at(costmap, 2, 2), at(costmap, 8, 2)
    assert len(build((name, {})).make_plan(costmap, start, goal).path) > 2
    closed = build((name, {"allow_unknown": False}))
    with pytest.raises(NoValidPathError):
        closed.make_plan(costmap, start, goal)
    with pytest.raises(GoalOccupiedError, match="unknown"):
        closed.make_plan(costmap, start, at(costmap, 5, 2))


@searching_with("default_tolerance")
def test_tolerance(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(CLOSED)
    start, goal = at(costmap, 2, 2), at(costmap, 7, 2, 0.7)
    with pytest.raises(NoValidPathError):
        build(planner, default_tolerance=0.25).make_plan(costmap, start, goal)
    plan = build(planner, default_tolerance=0.35).make_plan(costmap, start, goal)
    assert_contract(plan, costmap, start, goal, planner)
    assert 0.2 < plan.goal_moved_m < 0.5
    assert plan.goal.yaw == 0.7
    assert costmap.cost_at(plan.goal.x, plan.goal.y) == 0
    assert any("default_tolerance" in note for note in plan.notes)
    # also for a goal in an obstacle; without a free cell within the tolerance the goal is occupied
    assert build(planner, default_tolerance=0.15).make_plan(costmap, start, at(costmap, 5, 2)).goal_moved_m > 0.0
    block = ascii_map(ROOM)
    block.data[2:9, 8:15] = 254
    with pytest.raises(GoalOccupiedError, match="default_tolerance"):
        build(planner, default_tolerance=0.15).make_plan(block, at(block, 2, 2), at(block, 11, 5))


@searching_with("max_expansions")
def test_max_expansions_ends_the_search(planner: tuple[str, dict[str, object]]) -> None:
    costmap = Costmap(GridGeometry(60, 60, RESOLUTION), np.zeros((60, 60), np.uint8))
    costmap.data[30, 5:55] = 254
    start, goal = at(costmap, 30, 5), at(costmap, 30, 54)
    with pytest.raises(PlanningTimeoutError, match="max_expansions") as error:
        build(planner, max_expansions=60).make_plan(costmap, start, goal)
    assert error.value.code == 207
    data = error.value.data
    assert data["max_expansions"] == 60
    assert 60 <= data["cells_expanded"] < 200  # a wave ends with its list
    x, y = data["nearest_reachable"]
    assert data["nearest_reachable_distance_m"] == pytest.approx(math.hypot(x - goal.x, y - goal.y))
    assert 0.0 < data["nearest_reachable_distance_m"] < goal.distance_to(start)
    again = build(planner, max_expansions=60)
    for _ in range(2):
        with pytest.raises(PlanningTimeoutError) as other:
            again.make_plan(costmap, start, goal)
        assert other.value.as_dict() == error.value.as_dict()
    free = build(planner).make_plan(costmap, start, goal)
    allowed = build(planner, max_expansions=4 * free.cells_expanded).make_plan(costmap, start, goal)
    assert allowed.path.poses.tobytes() == free.path.poses.tobytes()


@searching_with("start_policy")
def test_start_policies(planner: tuple[str, dict[str, object]]) -> None:
    costmap = Costmap(GridGeometry(40, 40, RESOLUTION), np.zeros((40, 40), np.uint8))
    costmap.data[8:13, 8:13] = 253
    costmap.data[10, 10] = 254
    start, goal = at(costmap, 11, 10, 0.4), at(costmap, 30, 30)
    footprint = Footprint.from_radius(0.4)
    with pytest.raises(StartOccupiedError, match="start_policy is refuse") as error:
        build(planner, start_policy="refuse").make_plan(costmap, start, goal, footprint=footprint)
    assert error.value.code == 205
    assert error.value.data["cost"] == 253
    assert error.value.data["nearest_free_distance_m"] == pytest.approx(2 * RESOLUTION)
    # clearing its cell is not enough: the cells around it are blocked too
    with pytest.raises(StartOccupiedError, match="no free cell next to it"):
        build(planner, start_policy="clear_cell").make_plan(costmap, start, goal, footprint=footprint)
    plan = build(planner, start_policy="clear_footprint").make_plan(costmap, start, goal, footprint=footprint)
    assert any("under the footprint" in note for note in plan.notes)
    assert np.hypot(*(plan.path.poses[0, :2] - start[:2])) <= RESOLUTION
    plan = build(planner, start_policy="nearest_free").make_plan(costmap, start, goal, footprint=footprint)
    assert any("nearest free" in note for note in plan.notes)
    poses = plan.path.poses
    assert tuple(poses[0, :2]) == tuple(start[:2])
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 2.0 * RESOLUTION
    beyond = np.hypot(*(poses[:, :2] - start[:2]).T) > 2.5 * RESOLUTION
    assert all(costmap.cost_at(x, y) == 0 for x, y, _ in poses[beyond])
    # policies do not affect a free start
    free = at(costmap, 20, 5)
    plans = [
        build(planner, start_policy=p).make_plan(costmap, free, goal, footprint=footprint)
        for p in ("refuse", "clear_cell", "clear_footprint", "nearest_free")
    ]
    assert len({p.path.poses.tobytes() for p in plans}) == 1
    assert (costmap.data[8:13, 8:13] != 0).all()


@each_planner
def test_yaws_are_normalized(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(ROOM)
    plan = build(planner).make_plan(costmap, at(costmap, 2, 2, -7.0), at(costmap, 17, 2, 9.0))
    assert ((-math.pi < plan.path.poses[:, 2]) & (plan.path.poses[:, 2] <= math.pi)).all()
    assert plan.goal.yaw == pytest.approx(9.0 - 2.0 * math.pi)


@searching
def test_blocked_start_is_treated_as_free(planner: tuple[str, dict[str, object]]) -> None:
    costmap = ascii_map(ROOM)
    costmap.data[5, 4] = 254
    start, goal = at(costmap, 4, 5), at(costmap, 2, 2)
    plan = build(planner).make_plan(costmap, start, goal)
    assert_contract(plan, costmap, start, goal, planner)
    assert any("start" in note for note in plan.notes)


@each_planner
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 3)])
@pytest.mark.parametrize("cost", [0, 252, 254, 255])
def test_tiny_and_uniform_maps(planner: tuple[str, dict[str, object]], shape: tuple[int, int], cost: int) -> None:
    costmap = Costmap(GridGeometry(shape[1], shape[0], RESOLUTION), np.full(shape, cost, np.uint8))
    start, goal = at(costmap, 0, 0), at(costmap, shape[1] - 1, shape[0] - 1)
    try:
        plan = build(planner).make_plan(costmap, start, goal, keep_potential=True)
    except PlanningError as error:
        assert 203 <= error.code <= 208
        assert len(str(error)) > 20
    else:
        assert np.isfinite(plan.path.poses).all()
        assert tuple(plan.path.poses[-1]) == pytest.approx(tuple(plan.goal))
    assert (costmap.data == cost).all()


@pytest.mark.parametrize("name", ["carrot_planner"])
def test_carrot_moves_the_goal_back(name: str) -> None:
    costmap = ascii_map(ROOM)
    footprint = Footprint.from_radius(0.12)
    start, goal = at(costmap, 2, 5), at(costmap, 9, 5)
    plan = build((name, {})).make_plan(costmap, start, goal, footprint=footprint)
    assert len(plan.path) == 2
    assert plan.goal_moved_m > 0.0
    assert 0.3 < plan.goal.x - start.x < 0.5  # 0.12 m and a cell before the wall at 0.55 m
    alone = build((name, {})).make_plan(costmap, start, at(costmap, 8, 5))
    assert alone.goal.x - start.x < 0.6
    costmap.data[:] = 254
    with pytest.raises(GoalOccupiedError, match="does not fit anywhere"):
        build((name, {})).make_plan(costmap, start, goal, footprint=footprint)


def test_non_contiguous_costmap() -> None:
    """The plan on a view of a larger array equals the plan on a contiguous copy."""
    base = ascii_map(ROOM)
    larger = np.full((base.data.shape[0] + 4, base.data.shape[1] + 6), 254, np.uint8)
    view = larger[2:-2, 3:-3]
    view[:] = base.data
    start, goal = at(base, 2, 2), at(base, 17, 8)
    for planner in planners():
        a = build(planner).make_plan(base, start, goal)
        b = build(planner).make_plan(Costmap(base.geometry, view), start, goal)
        assert a.path.poses.tobytes() == b.path.poses.tobytes()
