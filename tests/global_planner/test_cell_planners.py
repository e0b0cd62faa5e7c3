"""astar and theta_star: cells read, start policies, tolerance; gaps in errors; clearance of plans."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import (
    Costmap,
    Footprint,
    GridGeometry,
    NoValidPathError,
    Pose2D,
    StartOccupiedError,
    clearance_along,
)
from navstack.global_planner import AStarParams, AStarPlanner, ThetaStarParams, ThetaStarPlanner
from navstack.global_planner._search.cell_search import CellPlanner
from navstack.plugins import GLOBAL_PLANNERS, GlobalPlanner

BOTH: list[tuple[type[CellPlanner], type[AStarParams] | type[ThetaStarParams]]] = [
    (AStarPlanner, AStarParams),
    (ThetaStarPlanner, ThetaStarParams),
]
each = pytest.mark.parametrize(("planner", "params"), BOTH, ids=["astar", "theta_star"])


def empty(nx: int, ny: int, resolution: float = 0.05) -> Costmap:
    return Costmap(GridGeometry(nx, ny, resolution))


def at(costmap: Costmap, ix: int, iy: int) -> Pose2D:
    return Pose2D(*costmap.geometry.cell_to_world(ix, iy))


@each
def test_a_short_query_reads_a_corner_of_a_huge_map(planner: type[CellPlanner], params: type[AStarParams]) -> None:
    costmap = empty(4000, 4000)
    built = planner(params())
    plan = built.make_plan(costmap, at(costmap, 100, 100), at(costmap, 130, 110))
    assert plan.cells_expanded < 200
    x0, y0, x1, y1 = built._search.best_first.window  # pyright: ignore
    assert (x1 - x0) * (y1 - y0) < 2000
    # changes outside do not affect the plan: the cached one is returned
    costmap.data[2000:, :] = 254
    assert built.make_plan(costmap, at(costmap, 100, 100), at(costmap, 130, 110)) is plan
    costmap.data[105, 115] = 254
    assert built.make_plan(costmap, at(costmap, 100, 100), at(costmap, 130, 110)) is not plan


def test_a_path_over_neighbors_leads_from_the_start_straight_to_the_next_center() -> None:
    """Not back to the center of the start's own cell first, nor past the goal to that of its cell."""
    costmap = empty(40, 40)
    start, goal = Pose2D(0.54, 0.52, 0.0), Pose2D(1.02, 0.53, 0.0)
    plan = AStarPlanner(AStarParams()).make_plan(costmap, start, goal)
    points = plan.path.poses[:, :2]
    assert points[0].tolist() == [0.54, 0.52] and points[-1].tolist() == [1.02, 0.53]
    assert points[1:-1] == pytest.approx(np.array([(x, 0.525) for x in np.arange(0.575, 1.0, 0.05)]))
    across = AStarPlanner(AStarParams(cut_corners=True)).make_plan(costmap, start, goal).path.poses[:, :2]
    assert across[1] == pytest.approx((0.525, 0.525)) and across[-2] == pytest.approx((1.025, 0.525))


def test_astar_in_free_space_expands_little_more_than_the_path() -> None:
    costmap = empty(500, 500)
    plan = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=0.0)).make_plan(
        costmap, at(costmap, 10, 10), at(costmap, 480, 250)
    )
    assert plan.cost == pytest.approx(470 - 240 + 240 * math.sqrt(2.0))
    assert plan.cells_expanded < 3 * 470


def test_theta_star_is_straight_in_free_space() -> None:
    costmap = empty(300, 300)
    start, goal = at(costmap, 10, 10), at(costmap, 280, 97)
    plan = ThetaStarPlanner().make_plan(costmap, start, goal)
    assert plan.length_m == pytest.approx(start.distance_to(goal))
    yaw = math.atan2(goal.y - start.y, goal.x - start.x)
    assert np.abs(plan.path.poses[:-1, 2] - yaw).max() < 1e-6


def test_corners_are_cut_only_where_allowed() -> None:
    costmap = empty(5, 5)
    costmap.data[2, 1] = 254  # next to the diagonal from (1, 1) to (2, 2)
    start, goal = at(costmap, 1, 1), at(costmap, 2, 2)
    exact = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=0.0)).make_plan(costmap, start, goal)
    cut = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=0.0, cut_corners=True)).make_plan(costmap, start, goal)
    assert (exact.cost, cut.cost) == (2.0, pytest.approx(math.sqrt(2.0)))
    costmap.data[1, 2] = 254  # on both sides: not allowed in any case
    other = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=0.0, cut_corners=True)).make_plan(
        costmap, start, goal
    )
    assert other.cost > 4.0


@each
def test_a_blocked_start_by_policy(planner: type[CellPlanner], params: type[AStarParams]) -> None:
    costmap = empty(60, 40)
    costmap.data[12:29, 12:29] = 253
    costmap.data[20, 20] = 254
    start, goal = at(costmap, 18, 20), at(costmap, 50, 20)
    with pytest.raises(StartOccupiedError, match="start_policy is refuse") as refused:
        planner(params(start_policy="refuse")).make_plan(costmap, start, goal)
    assert refused.value.data["nearest_free_distance_m"] == pytest.approx(7 * 0.05)
    nearest = planner(params(start_policy="nearest_free")).make_plan(costmap, start, goal)
    assert tuple(nearest.path.poses[0])[:2] == (start.x, start.y)
    assert any("nearest free" in note for note in nearest.notes)
    assert np.hypot(*np.diff(nearest.path.poses[:, :2], axis=0).T).max() < 0.1
    # the cells under the footprint are treated as free: the path is straight
    before = costmap.data.copy()
    cleared = planner(params()).make_plan(costmap, start, goal, footprint=Footprint.from_radius(0.6))
    assert cleared.length_m == pytest.approx(start.distance_to(goal))
    assert (costmap.data == before).all()
    # without a footprint only its cell is, and inscribed cells surround it
    with pytest.raises(StartOccupiedError):
        planner(params()).make_plan(costmap, start, goal)


@each
def test_tolerance_takes_the_nearest_reachable_point(planner: type[CellPlanner], params: type[AStarParams]) -> None:
    costmap = empty(40, 20)
    costmap.data[:, 20] = 254
    start, goal = at(costmap, 5, 10), at(costmap, 23, 10)
    with pytest.raises(NoValidPathError):
        planner(params(default_tolerance=0.15)).make_plan(costmap, start, goal)
    plan = planner(params(default_tolerance=0.25)).make_plan(costmap, start, goal)
    assert costmap.geometry.world_to_cell(plan.goal.x, plan.goal.y) == (19, 10)
    assert plan.goal_moved_m == pytest.approx(0.2, abs=0.05)


def searching() -> list[GlobalPlanner]:
    return [
        e.cls(e.cls.Params()) for e in GLOBAL_PLANNERS if e.name in ("navfn", "global_planner", "astar", "theta_star")
    ]


def closed_door() -> Costmap:
    """Two rooms, separated by a wall of 3 cells with a door of 6 cells that inflation (4 cells) closes."""
    costmap = empty(60, 40)
    costmap.data[:, 29:32] = 254
    costmap.data[20:26, 29:32] = 0
    ys, xs = np.mgrid[:40, :60]
    lethal = costmap.data == 254
    ly, lx = np.nonzero(lethal)
    near = ((xs[..., None] - lx) ** 2 + (ys[..., None] - ly) ** 2).min(axis=-1) <= 16
    costmap.data[near & ~lethal] = 253
    return costmap


@pytest.mark.parametrize("planner", searching(), ids=lambda p: type(p).__name__)
def test_the_error_names_what_blocks_the_route(planner: GlobalPlanner) -> None:
    costmap = closed_door()
    with pytest.raises(NoValidPathError, match=r"a gap of about 0\.\d+ m at .* too narrow") as error:
        planner.make_plan(costmap, at(costmap, 8, 8), at(costmap, 50, 30))
    (gap,) = error.value.data["blocked_by"]
    assert gap["kind"] == "too narrow"
    door = costmap.geometry.cell_to_world(30, 23)
    assert math.hypot(gap["x"] - door[0], gap["y"] - door[1]) <= 0.11
    assert gap["gap_m"] == pytest.approx(0.3)  # six cells of 5 cm
    costmap.data[20:26, 30] = 254
    with pytest.raises(NoValidPathError, match="an obstacle at") as error:
        planner.make_plan(costmap, at(costmap, 8, 8), at(costmap, 50, 30))
    (wall,) = error.value.data["blocked_by"]
    assert wall["kind"] == "obstacle"
    assert 20 <= (wall["y"] - costmap.geometry.origin_y) / 0.05 <= 26  # where it is thinnest


def test_clearance_is_the_distance_to_the_nearest_square() -> None:
    costmap = Costmap(GridGeometry(400, 400, 0.05, -2.0, 1.0))
    line = np.array([[-1.0, 2.0], [3.0, 2.0]])
    assert clearance_along(costmap, line) == math.inf
    costmap.data[350, 200] = 254  # far away: found in a larger window
    left, bottom = -2.0 + 200 * 0.05, 1.0 + 350 * 0.05
    assert clearance_along(costmap, line) == pytest.approx(math.hypot(left - 3.0, bottom - 2.0))
    costmap.data[30, 40] = 254  # y 2.5 .. 2.55, x 0 .. 0.05
    assert clearance_along(costmap, line) == pytest.approx(0.5)
    costmap.data[20, 60] = 254
    assert clearance_along(costmap, line) == pytest.approx(0.0, abs=1e-9)
    rng = np.random.default_rng(5)
    costmap.data[:] = np.where(rng.random((400, 400)) < 0.002, 254, 0)
    points = rng.uniform((-1.5, 1.5), (17.5, 20.5), (6, 2))
    ly, lx = np.nonzero(costmap.data)
    x0, y0 = -2.0 + lx * 0.05, 1.0 + ly * 0.05
    for p in points:
        gap = np.hypot(
            np.maximum(np.maximum(x0 - p[0], p[0] - x0 - 0.05), 0),
            np.maximum(np.maximum(y0 - p[1], p[1] - y0 - 0.05), 0),
        )
        assert clearance_along(costmap, p[None]) == pytest.approx(gap.min())
