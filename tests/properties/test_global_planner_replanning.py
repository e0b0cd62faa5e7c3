"""Replanning to the same goal is as good as planning from scratch, after any change of the costmap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Costmap, GridGeometry, PlanningError, Pose2D
from navstack.global_planner import GlobalPlannerParams, GlobalPlannerROS, NavfnParams, NavfnROS
from navstack.global_planner._search import wave_search as goal_potential

COST_TOLERANCE = 0.005
KINDS = ["navfn", "navfn astar", "navfn known", "global_planner", "global_planner linear", "global_planner astar"]


def build(kind: str) -> NavfnROS | GlobalPlannerROS:
    if kind.startswith("navfn"):
        return NavfnROS(NavfnParams(use_astar="astar" in kind, allow_unknown="known" not in kind))
    return GlobalPlannerROS(GlobalPlannerParams(use_quadratic="linear" not in kind, use_dijkstra="astar" not in kind))


def scene(rng: np.random.Generator, ny: int, nx: int, kind: str) -> np.ndarray:
    data = np.zeros((ny, nx), np.uint8)
    if kind == "rooms":
        for x in range(12, nx, 16):
            data[:, x] = 254
            for y in rng.integers(1, ny - 1, 2):
                data[max(1, y - 1) : y + 2, x] = 0
    elif kind == "noise":
        data[:] = rng.integers(0, 253, (ny, nx))
    data[rng.random((ny, nx)) < 0.04] = 254
    return data


def edit(rng: np.random.Generator, data: np.ndarray, original: np.ndarray) -> None:
    """Block a window, raise its cost, free it, fill it with noise, or restore it."""
    ny, nx = data.shape
    h, w = int(rng.integers(1, 12)), int(rng.integers(1, 12))
    y, x = int(rng.integers(0, ny)), int(rng.integers(0, nx))
    part = data[y : y + h, x : x + w]
    what = int(rng.integers(0, 5))
    if what == 0:
        part[:] = 254
    elif what == 1:
        part[:] = np.maximum(part, 150)
    elif what == 2:
        part[:] = 0
    elif what == 3:
        part[:] = rng.integers(0, 256, part.shape)
    else:
        part[:] = original[y : y + h, x : x + w]


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.integers(8, 64), st.integers(8, 64)),
    kind=st.sampled_from(KINDS),
    scenery=st.sampled_from(["rooms", "noise", "open"]),
    edits=st.integers(0, 4),
)
def test_as_good_as_from_scratch(seed: int, size: tuple[int, int], kind: str, scenery: str, edits: int) -> None:
    rng = np.random.default_rng(seed)
    ny, nx = size
    original = scene(rng, ny, nx, scenery)
    costmap = Costmap(GridGeometry(nx, ny, 0.05, -1.0, 3.0), original.copy())
    goal = Pose2D(*costmap.geometry.cell_to_world(int(rng.integers(1, nx - 1)), int(rng.integers(1, ny - 1))), 0.5)
    planner = build(kind)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(goal_potential, "WORTHWHILE_CELLS", 10)  # so that it is used on small grids too
        for _ in range(8):
            start = Pose2D(
                *costmap.geometry.cell_to_world(int(rng.integers(1, nx - 1)), int(rng.integers(1, ny - 1))), 1.0
            )
            compare(planner, build(kind), costmap, start, goal)
            for _ in range(edits):
                edit(rng, costmap.data, original)


def compare(
    planner: NavfnROS | GlobalPlannerROS,
    fresh: NavfnROS | GlobalPlannerROS,
    costmap: Costmap,
    start: Pose2D,
    goal: Pose2D,
) -> None:
    try:
        expected = fresh.make_plan(costmap, start, goal)
    except PlanningError as error:
        with pytest.raises(type(error)):
            planner.make_plan(costmap, start, goal)
        return
    plan = planner.make_plan(costmap, start, goal)
    assert plan.cost <= expected.cost * (1.0 + COST_TOLERANCE)
    # points of navfn are corners of their cells
    shift = 0.5 * costmap.geometry.resolution if isinstance(planner, NavfnROS) else 0.0
    own = costmap.geometry.world_to_cell(start.x, start.y)
    epsilon = 1e-6  # half steps may end on the edge of a cell
    for x, y, _ in plan.path.poses[1:-1]:
        touched = [(x + shift + i * epsilon, y + shift + j * epsilon) for i in (-1, 1) for j in (-1, 1)]
        assert any(costmap.geometry.world_to_cell(*p) == own or costmap.cost_at(*p) not in (253, 254) for p in touched)
    assert plan.goal == expected.goal
    again = planner.make_plan(costmap, start, goal)
    assert again.path.poses.tobytes() == plan.path.poses.tobytes()
    assert again.cost == plan.cost


def big_room() -> Costmap:
    data = np.zeros((300, 300), np.uint8)
    data[100, :250] = 254
    data[200, 50:] = 254
    return Costmap(GridGeometry(300, 300, 0.05), data)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_drive_with_changing_obstacles(kind: str) -> None:
    costmap = big_room()
    original = costmap.data.copy()
    g = costmap.geometry
    goal = Pose2D(*g.cell_to_world(280, 280))
    planner = build(kind)
    rng = np.random.default_rng(3)
    expanded: list[int] = []
    scratch: list[int] = []
    for step in range(30):
        start = Pose2D(*g.cell_to_world(20 + 4 * step, 20 + step))
        fresh = build(kind).make_plan(costmap, start, goal)
        plan = planner.make_plan(costmap, start, goal)
        assert plan.cost <= fresh.cost * (1.0 + COST_TOLERANCE)
        expanded.append(plan.cells_expanded)
        scratch.append(fresh.cells_expanded)
        x, y = 20 + 4 * step + int(rng.integers(-20, 20)), 20 + step + int(rng.integers(-10, 20))
        window = (slice(max(0, y), max(0, y) + 8), slice(max(0, x), max(0, x) + 8))
        costmap.data[window] = 254 if step % 2 else original[window]
        costmap.data[18 + step : 25 + step, 20 + 4 * step : 30 + 4 * step] = 0  # the robot is there
    if "astar" not in kind:
        # with a linear potential every monotonic staircase is an optimal path
        assert sum(expanded[3:]) < (0.75 if "linear" in kind else 0.5) * sum(scratch[3:])


@pytest.mark.parametrize("kind", KINDS)
def test_a_changed_cost_invalidates_the_cached_plan(kind: str) -> None:
    """A blocked cell on the path leads to another plan; after it is freed the cost is the first one again."""
    costmap = big_room()
    g = costmap.geometry
    start, goal = Pose2D(*g.cell_to_world(20, 20)), Pose2D(*g.cell_to_world(280, 280))
    planner = build(kind)
    first = planner.make_plan(costmap, start, goal)
    assert planner.make_plan(costmap, start, goal) is first
    middle = first.path.poses[len(first.path) // 2]
    cell = g.world_to_cell(float(middle[0]) + 0.01, float(middle[1]) + 0.01)
    assert cell is not None
    costmap.data[cell[1] - 2 : cell[1] + 3, cell[0] - 2 : cell[0] + 3] = 254
    second = planner.make_plan(costmap, start, goal)
    shift = 0.5 * g.resolution if kind.startswith("navfn") else 0.0  # points of navfn are corners of their cells
    for x, y, _ in second.path.poses[1:-1]:
        assert costmap.cost_at(x + shift, y + shift) != 254
    assert second.path.poses.tobytes() != first.path.poses.tobytes()
    costmap.data[cell[1] - 2 : cell[1] + 3, cell[0] - 2 : cell[0] + 3] = 0
    third = planner.make_plan(costmap, start, goal)
    assert third.cost == pytest.approx(first.cost, rel=COST_TOLERANCE)
