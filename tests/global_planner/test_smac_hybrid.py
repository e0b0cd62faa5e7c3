"""smac_hybrid: closed forms in empty space, an independent referee, narrow places, goals, errors, reproducibility."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.core import (
    Costmap,
    Footprint,
    GoalOccupiedError,
    GridGeometry,
    NoValidPathError,
    PlanningError,
    PlanningTimeoutError,
    Pose2D,
    StartOccupiedError,
)
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner
from tests.global_planner.fuzz_poses import run
from tests.global_planner.pose_referee import Referee, inflated, random_queries, shortest_word, weighted_length

BOX = Footprint(np.array([[0.45, 0.3], [0.45, -0.3], [-0.25, -0.3], [-0.25, 0.3]]))
ROUND = Footprint.from_radius(0.22)
RESOLUTION = 0.05


def planner(**values: Any) -> SmacHybridPlanner:
    return SmacHybridPlanner(SmacHybridParams(**values))


def empty(size_m: float = 8.0) -> Costmap:
    n = round(size_m / RESOLUTION)
    return Costmap(GridGeometry(n, n, RESOLUTION), np.zeros((n, n), np.uint8))


def rooms() -> np.ndarray:
    """Two rooms with a door of 1.1 m, pillars and a shelf."""
    lethal = np.zeros((120, 160), np.bool_)
    lethal[[0, -1]] = lethal[:, [0, -1]] = True
    lethal[:, 78:80] = True
    lethal[50:72, 78:80] = False
    lethal[30:36, 30:36] = lethal[84:90, 110:118] = True
    lethal[96:100, 12:60] = True
    return lethal


@pytest.mark.slow
@pytest.mark.parametrize(("model", "penalty"), [("DUBIN", 2.0), ("REEDS_SHEPP", 1.0), ("REEDS_SHEPP", 2.0)])
@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_length_in_empty_space(model: str, penalty: float, resolution: float) -> None:
    """Within 3 % of the shortest word, in which driving backward counts `reverse_penalty` times.

    It is never shorter than the shortest curve: the chords of poses are 1 % shorter at most (R 0.2 m).
    """
    rng = np.random.default_rng(5)
    n = round(40.0 / resolution)
    costmap = Costmap(GridGeometry(n, n, resolution), np.zeros((n, n), np.uint8))
    for _ in range(50):
        radius, half, way = (
            float(rng.uniform(0.2, 2.0)),
            float(rng.uniform(0.0, 10.0)),
            float(rng.uniform(-math.pi, math.pi)),
        )
        start, goal = (
            Pose2D(20.0 + d * math.cos(way), 20.0 + d * math.sin(way), float(rng.uniform(-math.pi, math.pi)))
            for d in (-half, half)
        )
        search = planner(motion_model_for_search=model, reverse_penalty=penalty, minimum_turning_radius=radius)
        length = weighted_length(search.make_plan(costmap, start, goal).path, penalty)
        penalties = (math.inf, math.inf) if model == "DUBIN" else (1.0, penalty)
        least, most = (shortest_word(start, goal, radius, p) for p in penalties)
        assert 0.99 * least - 1e-9 <= length <= 1.03 * most + 1e-9


def test_a_reverse_penalty_counts_in_empty_space() -> None:
    """Straight back, or forward all the way."""
    start, goal = Pose2D(5.0, 4.0, 0.0), Pose2D(3.5, 4.0, 0.0)
    plans = [
        planner(motion_model_for_search="REEDS_SHEPP", reverse_penalty=p).make_plan(empty(), start, goal)
        for p in (1.0, 20.0)
    ]
    assert plans[0].length_m == pytest.approx(1.5)
    assert (plans[1].path.directions == 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(("footprint", "model"), [(BOX, "REEDS_SHEPP"), (BOX, "DUBIN"), (ROUND, "DUBIN")])
def test_an_independent_referee(footprint: Footprint, model: str) -> None:
    """`python -m tests.global_planner.check_plans 10000` checks more, on the shipped and foreign maps."""
    referee = Referee(
        inflated(rooms(), RESOLUTION, footprint.inscribed_radius),
        footprint,
        footprint is ROUND,
        0.4,
        model == "REEDS_SHEPP",
    )
    search = planner(motion_model_for_search=model, max_iterations=100_000)
    found, _, faults = random_queries(search, referee, np.random.default_rng(3), 25, 6.0)
    assert faults == []
    assert found >= 15


def test_cusps_are_stated() -> None:
    """The three-point turn: three arcs, two changes of direction."""
    plan = planner(motion_model_for_search="REEDS_SHEPP", reverse_penalty=1.0).make_plan(
        empty(), Pose2D(4.0, 4.0, 0.0), Pose2D(4.0, 4.0, math.pi)
    )
    assert plan.length_m == pytest.approx(0.4 * math.pi, rel=0.03)
    signs = plan.path.directions
    assert int((signs[1:] != signs[:-1]).sum()) == 2
    assert any("2 changes between driving forward and backward" in note for note in plan.notes)


def test_a_cost_of_cusps_decides_between_words() -> None:
    """On the spot: 0.4 pi m with two cusps, or 0.4 * 7 pi / 3 m without; the costs of cusps are in the plan's cost."""
    start, goal = Pose2D(4.0, 4.0, 0.0), Pose2D(4.0, 4.0, math.pi)
    plans = [
        planner(
            motion_model_for_search="REEDS_SHEPP", reverse_penalty=1.0, non_straight_penalty=1.0, cusp_penalty=cost
        ).make_plan(empty(), start, goal)
        for cost in (0.1, 2.0)
    ]
    assert [p.length_m for p in plans] == pytest.approx([0.4 * math.pi, 0.4 * 7.0 * math.pi / 3.0], rel=0.03)
    assert [p.path.cusps for p in plans] == [2, 0]
    assert plans[0].cost == pytest.approx(plans[0].length_m + 0.2, rel=0.03)


@pytest.mark.slow
def test_a_cost_of_cusps_prevents_zigzags() -> None:
    """A car turns round in an aisle of 1.2 m: without the cost, it shuttles by single cells."""
    lethal = np.zeros((36, 200), np.bool_)
    lethal[[0, -1]] = lethal[:, [0, -1]] = True
    lethal[:6] = lethal[30:] = True
    lethal[:, 140:196] = False  # a crossing
    car = Footprint(np.array([[-0.15, -0.25], [-0.15, 0.25], [0.65, 0.25], [0.65, -0.25]]))
    referee = Referee(inflated(lethal, RESOLUTION, car.inscribed_radius), car, False, 0.85, True)
    start, goal = Pose2D(5.0, 0.9, 0.0), Pose2D(1.0, 0.9, math.pi)
    pieces: list[list[float]] = []
    for cost in (0.0, 0.5):
        search = planner(motion_model_for_search="REEDS_SHEPP", minimum_turning_radius=0.85, cusp_penalty=cost)
        plan = search.make_plan(referee.costmap, start, goal, footprint=car)
        assert referee.faults(plan, start, goal) == []
        assert plan.goal_moved_m == 0.0
        poses = plan.path.poses
        step = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        turns = np.flatnonzero(np.diff(plan.path.directions[:-1])) + 1
        pieces.append([float(part.sum()) for part in np.split(step, turns)])
    assert len(pieces[0]) > 12 and min(pieces[0]) < 0.1
    assert len(pieces[1]) <= 6 and min(pieces[1]) > 0.15


@pytest.mark.parametrize(("cells", "fits"), [(14, True), (11, False)])
def test_a_straight_passage(cells: int, fits: bool) -> None:
    """A box 0.6 m wide passes 0.7 m, and not 0.55 m."""
    lethal = np.zeros((80, 160), np.bool_)
    lethal[:40, 60:100] = lethal[40 + cells :, 60:100] = True
    costmap = Costmap(GridGeometry(160, 80, RESOLUTION), np.where(lethal, 254, 0).astype(np.uint8))
    y = (40 + 0.5 * cells) * RESOLUTION
    start, goal = Pose2D(1.0, y, 0.0), Pose2D(7.0, y, 0.0)
    if fits:
        plan = planner().make_plan(costmap, start, goal, footprint=BOX)
        assert plan.length_m == pytest.approx(6.0, abs=0.05)
        return
    with pytest.raises(NoValidPathError, match="too narrow for the footprint at") as error:
        planner().make_plan(costmap, start, goal, footprint=BOX)
    (spot,) = error.value.data["narrow"]
    assert (spot["x"], spot["y"]) == pytest.approx((4.0, y), abs=0.1)  # the middle of the passage
    assert spot["heading"] == pytest.approx(0.0, abs=0.05)
    assert spot["width_m"] == pytest.approx(0.55)
    assert 2.0 <= spot["length_m"] <= 2.7  # up to half the box longer at both ends


def test_goal_headings() -> None:
    costmap = empty()
    start, goal = Pose2D(4.0, 4.0, 0.0), Pose2D(6.0, 4.0, math.pi)
    lengths = {
        mode: planner(goal_heading_mode=mode, coarse_search_resolution=n).make_plan(costmap, start, goal)
        for mode, n in (("DEFAULT", 1), ("BIDIRECTIONAL", 1), ("ALL_DIRECTION", 4))
    }
    assert lengths["DEFAULT"].goal == goal
    assert lengths["BIDIRECTIONAL"].length_m == pytest.approx(2.0, abs=0.01)
    assert lengths["ALL_DIRECTION"].length_m <= lengths["DEFAULT"].length_m
    assert abs(lengths["BIDIRECTIONAL"].goal.yaw) < 1e-9


def test_a_goal_in_an_obstacle() -> None:
    costmap = inflated(rooms(), RESOLUTION, 0.3)
    goal = Pose2D(1.65, 1.85, 0.0)
    with pytest.raises(GoalOccupiedError, match="does not fit at the goal") as error:
        planner(tolerance=0.0).make_plan(costmap, Pose2D(1.0, 4.0, 0.0), goal, footprint=BOX)
    assert "blocked_by" in error.value.data or error.value.data["cost"] >= 253
    near = Pose2D(1.65, 2.05, 0.0)
    plan = planner(tolerance=0.5).make_plan(costmap, Pose2D(1.0, 3.5, 0.0), near, footprint=BOX)
    assert 0.0 < plan.goal_moved_m <= 0.5
    assert any("tolerance" in note for note in plan.notes)
    with pytest.raises(
        PlanningTimeoutError, match=r"no path .* nor to \(1\.985, 2\.045\) within the tolerance, found within"
    ):
        beside = Pose2D(1.985, 1.995, 0.3)
        planner(max_iterations=1000).make_plan(costmap, Pose2D(1.0, 4.0, 0.0), beside)


def test_a_blocked_goal_names_the_headings_that_fit() -> None:
    """Next to a wall, those along it; in unknown space, that the map is unknown there."""
    lethal = np.zeros((120, 120), bool)
    lethal[:, 60:] = True
    costmap = inflated(lethal, 0.05, 0.2)
    slim = Footprint(np.array([[0.5, 0.2], [-0.5, 0.2], [-0.5, -0.2], [0.5, -0.2]]))
    start, goal = Pose2D(1.0, 1.0, 0.0), Pose2D(2.72, 3.0, 0.0)
    # 0.28 m to the wall: the corners of the box, turned by 10 degrees, are 0.284 m to its side
    headings = r"it fits there at other headings: 1\.57 rad, -1\.57 rad"
    with pytest.raises(GoalOccupiedError, match=headings):
        planner(tolerance=0.0).make_plan(costmap, start, goal, footprint=slim)
    costmap.data[40:80, 20:50] = 255
    unknown = planner(tolerance=0.0, allow_unknown=False)
    with pytest.raises(GoalOccupiedError, match="the map is unknown there; choose a goal in known space"):
        unknown.make_plan(costmap, start, Pose2D(1.8, 3.0, 0.0), footprint=slim)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.0, 0.15])
def test_without_curves_paths_end_within_the_tolerance(tolerance: float) -> None:
    """Of the goal itself, also where a blocked one was moved: a state in the cell of the other goal may be farther away."""
    costmap, rng, found = inflated(rooms(), RESOLUTION, 0.3), np.random.default_rng(4), 0
    search = planner(tolerance=tolerance, analytic_expansion_max_length=0.0, max_iterations=20_000)
    for _ in range(40):
        goal = Pose2D(float(rng.uniform(1.2, 2.1)), float(rng.uniform(2.05 - tolerance, 2.15)), 0.3)
        try:
            plan = search.make_plan(costmap, Pose2D(1.0, 4.0, 0.0), goal)
        except PlanningError:
            continue
        found += 1
        end = plan.path[-1]
        assert plan.goal_moved_m == pytest.approx(end.distance_to(goal), abs=1e-9)
        assert plan.goal_moved_m + search.params.minimum_turning_radius * abs(end.yaw - 0.3) <= tolerance + 1e-9
    assert found >= 16


def test_a_goal_that_obstacles_enclose() -> None:
    """Of a goal that is free but enclosed, the plan ends within the tolerance, next to the walls; when they open, at the goal."""
    costmap = empty()
    costmap.data[80:101, 80:101] = 254
    costmap.data[82:99, 82:99] = 0
    search, goal = planner(tolerance=0.6), Pose2D(4.4, 4.525, 0.0)
    plan = search.make_plan(costmap, Pose2D(1.0, 4.5, 0.0), goal)
    assert 0.3 < plan.goal_moved_m <= 0.6
    with pytest.raises(NoValidPathError, match="no path connects the start"):
        planner(tolerance=0.3).make_plan(costmap, Pose2D(1.0, 4.5, 0.0), goal)
    costmap.data[88:94, 80:82] = 0
    assert search.make_plan(costmap, Pose2D(1.0, 4.5, 0.0), goal).path[-1] == goal


def test_limits() -> None:
    costmap = inflated(rooms(), RESOLUTION, 0.3)
    start, goal = Pose2D(1.0, 1.0, 0.0), Pose2D(6.0, 1.0, 0.0)
    with pytest.raises(PlanningTimeoutError, match="max_iterations = 20"):
        planner(max_iterations=20).make_plan(costmap, start, goal, footprint=BOX)
    with pytest.raises(PlanningTimeoutError, match="max_planning_time"):
        planner(max_planning_time=1e-9, terminal_checking_interval=10).make_plan(costmap, start, goal, footprint=BOX)


def test_start_in_an_obstacle() -> None:
    costmap = empty()
    start, goal = Pose2D(2.0, 2.0, 0.0), Pose2D(5.0, 3.0, 0.0)
    costmap.data[38:40, 36:38] = 254  # next to the rear wheels
    with pytest.raises(StartOccupiedError, match="start_policy is refuse"):
        planner(start_policy="refuse").make_plan(costmap, start, goal, footprint=BOX)
    plan = planner().make_plan(costmap, start, goal, footprint=BOX)
    assert any("treated as free" in note for note in plan.notes)


@pytest.mark.parametrize("gap", [0.1, 0.03, 0.004, 0.0])
def test_ends_close_to_obstacles(gap: float) -> None:
    """A robot a fraction of a cell from an obstacle fits there, and the obstacle counts; only an overlap is cleared."""
    costmap = empty()
    costmap.data[46, 40:48] = costmap.data[113, 100:112] = 254  # left of the start; right of the goal
    y = 46 * RESOLUTION - 0.3 - gap * RESOLUTION
    start, goal = Pose2D(2.0, y, 0.0), Pose2D(5.3, 114 * RESOLUTION + 0.3 + gap * RESOLUTION, 0.0)
    referee = Referee(costmap, BOX, False, 0.4, False)
    plan = planner().make_plan(costmap, start, goal, footprint=BOX)
    assert referee.faults(plan, start, goal) == []
    assert plan.goal_moved_m == 0.0
    assert not any("treated as free" in note for note in plan.notes)


def test_only_an_overlap_is_cleared() -> None:
    """The robot overlaps one obstacle at its start, and another is 0.1 cells away: that one still counts."""
    costmap = empty()
    costmap.data[46, 40:48] = 254
    start, goal = Pose2D(2.0, 46 * RESOLUTION - 0.305, 0.0), Pose2D(4.0, 5.0, math.pi / 2)
    costmap.data[36, 36] = 254  # under the rear right corner
    plan = planner().make_plan(costmap, start, goal, footprint=BOX)
    assert any("treated as free" in note for note in plan.notes)
    costmap.data[36, 36] = 0
    assert Referee(costmap, BOX, False, 0.4, False).faults(plan, start, goal) == []


def test_a_heuristic_that_is_kept_changes_nothing() -> None:
    """The plan for the second query is the same with the heuristic of the first one, and without."""
    costmap = inflated(rooms(), RESOLUTION, 0.22)
    goal = Pose2D(6.5, 1.0, 0.0)
    kept = planner()
    first = kept.make_plan(costmap, Pose2D(1.0, 5.5, 0.0), goal)
    there = first.path[len(first.path) // 3]
    second, fresh = kept.make_plan(costmap, there, goal), planner().make_plan(costmap, there, goal)
    assert second.cost == pytest.approx(fresh.cost, rel=0.01)
    kept.reset()
    assert kept.make_plan(costmap, there, goal).path.poses.tobytes() == fresh.path.poses.tobytes()


def test_downsampling_keeps_to_free_cells() -> None:
    costmap = inflated(rooms(), RESOLUTION, 0.22)
    plan = planner(downsample_costmap=True, downsampling_factor=2).make_plan(
        costmap, Pose2D(1.0, 5.5, 0.0), Pose2D(6.5, 1.0, 0.0)
    )
    assert max(costmap.cost_at(float(x), float(y)) or 0 for x, y in plan.path.poses[:, :2]) < 253


def test_bytes_per_visited_state() -> None:
    """60 bytes where arrays are full; at most four times as much after they have grown."""
    search = planner()
    search.make_plan(inflated(rooms(), RESOLUTION, 0.22), Pose2D(1.0, 5.5, 0.0), Pose2D(6.5, 1.0, 2.0))
    assert search.memory


@pytest.mark.slow
def test_random_input() -> None:
    """`python -m tests.global_planner.fuzz_poses hybrid 2000` runs more cases."""
    ends, faults = run("hybrid", 12, 5)
    assert faults == []
    assert ends["plan"] >= 3


def test_unknown_cells_hide_no_obstacles_in_downsampled_blocks() -> None:
    """A wall of lethal cells with unknown ones next to them, in the same blocks."""
    costmap = empty(4.0)
    costmap.data[:, 40], costmap.data[:, 41] = 254, 255
    search = planner(downsample_costmap=True, downsampling_factor=2, allow_unknown=True)
    with pytest.raises(NoValidPathError):
        search.make_plan(costmap, Pose2D(1.0, 2.0, 0.0), Pose2D(3.0, 2.0, 0.0), footprint=BOX)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number"), [(8, 4), (17, 1), (27, 6), (51, 4)])
def test_the_cost_is_finite(seed: int, number: int) -> None:
    """A piece of a path may have a sample in the corner of an inscribed cell that the checks of the whole curve stepped over."""
    rng = np.random.default_rng(seed)
    lethal = rng.random((60, 60)) < 0.02
    lethal[5:10, 5:10] = lethal[50:55, 50:55] = False
    for _ in range(number + 1):
        start, goal = (Pose2D(*rng.uniform(0.3, 5.7, 2), float(rng.uniform(-3.0, 3.0))) for _ in range(2))
    plan = planner(minimum_turning_radius=0.5, cost_penalty=0.0).make_plan(inflated(lethal, 0.1, 0.25), start, goal)
    assert plan.length_m <= plan.cost < math.inf
