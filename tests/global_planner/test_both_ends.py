"""Long searches over poses go on from the goal."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, Footprint, GridGeometry, NoValidPathError, Pose2D
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner, SmacLatticeParams, SmacLatticePlanner
from navstack.global_planner._lattice import MotionModel
from navstack.global_planner._lattice_file import write_lattice
from navstack.global_planner._lattice_generate import generate_lattice
from navstack.global_planner._se2 import both_ends
from navstack.global_planner._se2 import search as outcomes
from navstack.global_planner._se2.records import SEGMENT
from navstack.global_planner._se2.search import FOUND
from navstack.global_planner._se2.shape import shape_of
from tests.global_planner.pose_referee import Referee

LOPSIDED = Footprint(np.array([[0.5, 0.2], [0.5, -0.15], [-0.2, -0.2], [-0.2, 0.2]]))


def room() -> Costmap:
    """A room with a box that is open on its left, and an alcove on the right."""
    costs = np.zeros((60, 230), np.uint8)
    costs[14:46, 141] = costs[14:16, 100:142] = costs[44:46, 100:142] = 254
    costs[:, 190:] = 254
    costs[25:35, 190:220] = 0
    return Costmap(GridGeometry(230, 60, 0.1), costs)


START, GOAL = Pose2D(1.0, 3.0, 0.0), Pose2D(16.2, 3.0, 0.0)
IN_ALCOVE, SLANTED = Pose2D(20.5, 3.0, 0.0), Pose2D(20.7, 2.9, 1.2)


def hybrid(**values: Any) -> SmacHybridPlanner:
    return SmacHybridPlanner(SmacHybridParams(minimum_turning_radius=1.0, **values))


def poses(segments: np.ndarray, end: tuple[float, float, float]) -> np.ndarray:
    found = outcomes.Outcome(FOUND, segments, end, 0.0, 0, 0, (0.0, 0.0), False)
    return outcomes.poses_of(found, 0.5)


def test_a_path_turned_around_is_the_same_way_back() -> None:
    rows = [
        (1, 3.0, 5.0, 0.0, 0.0),
        (2, 2.0, 1.0, 0.0, 0.0),
        (3, -4.0, 7.0, 0.0, 0.0),
        (0, 1.1, 1.0, 0.0, 0.0),
        (-1, 2.0, 1.0, 0.4, 0.3),
    ]
    segments, pose = np.zeros(len(rows), SEGMENT), (10.0, 20.0, 0.7)
    for row, (kind, size, radius, sideways, turn) in zip(segments, rows, strict=True):
        row["x"], row["y"], row["yaw"] = pose
        row["kind_"], row["size"], row["radius"], row["sideways"], row["turn"] = kind, size, radius, sideways, turn
        x, y, yaw = outcomes.paths.segment_end(row)
        pose = float(x), float(y), float(yaw)
    back = outcomes.turned_around(segments, pose)
    there, again = poses(segments, pose), poses(back, (10.0, 20.0, 0.7 - np.pi))
    np.testing.assert_allclose(there[::-1, :2], again[:, :2], atol=1e-12)
    np.testing.assert_allclose(there[::-1, 2] - np.pi, again[:, 2], atol=1e-12)


def lattice(model: MotionModel, folder: Path, **values: Any) -> SmacLatticePlanner:
    file = write_lattice(generate_lattice(1.0, 0.1, motion_model=model), folder / f"{model}.json")
    return SmacLatticePlanner(SmacLatticeParams(lattice_filepath=str(file), **values))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["DUBIN", "REEDS_SHEPP", "ackermann", "diff", "omni"])
def test_a_path_found_from_the_goal(kind: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It ends exactly where it should, has no faults, and costs hardly more than one found from the start."""
    planner = hybrid(motion_model_for_search=kind) if kind.isupper() else lattice(kind, tmp_path)
    found: list[both_ends.FromGoal] = []
    outcome = both_ends.FromGoal.outcome

    def spied(self: both_ends.FromGoal, *args: Any, **values: Any) -> outcomes.Outcome:
        found.append(self)
        return outcome(self, *args, **values)

    monkeypatch.setattr(both_ends.FromGoal, "outcome", spied)
    monkeypatch.setattr(both_ends, "FIRST", 1 << 40)
    usual = planner.make_plan(room(), START, GOAL, footprint=LOPSIDED)
    monkeypatch.setattr(both_ends, "FIRST", 2)
    monkeypatch.setattr(both_ends, "SHARE", Fraction(1, 10**6))  # so many times as many from the goal
    planner.reset()
    plan = planner.make_plan(room(), START, GOAL, footprint=LOPSIDED)
    assert len(found) == 1
    assert plan.path[0] == START
    assert plan.path[-1] == GOAL
    assert plan.cost < 1.1 * usual.cost
    assert planner.make_plan(room(), plan.path[5], GOAL, footprint=LOPSIDED).cells_expanded == 0
    referee = Referee(room(), LOPSIDED, False, 1.0, kind == "REEDS_SHEPP")
    assert not referee.collisions(plan.path)
    assert kind in ("diff", "omni") or not referee.faults(plan, START, GOAL)


def test_without_curves_no_search_begins_at_the_goal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It would end in the cell of the start, not at its pose: the path would begin with a jump."""
    monkeypatch.setattr(both_ends, "FIRST", 2)
    monkeypatch.setattr(both_ends, "SHARE", Fraction(1, 10**6))
    planner = lattice("ackermann", tmp_path, analytic_expansion_max_length=0.0)
    path = planner.make_plan(room(), START._replace(x=1.04, yaw=0.1), GOAL, footprint=LOPSIDED).path
    assert not Referee(room(), LOPSIDED, False, 1.0, False).motion_faults(path)


@pytest.mark.slow
def test_a_goal_that_cannot_be_entered() -> None:
    """The robot would have to back into the alcove: the search does not fill the room, and the error says so."""
    with pytest.raises(NoValidPathError, match="no way leads to the goal: backward from it") as error:
        hybrid(tolerance=0.1).make_plan(room(), START, IN_ALCOVE._replace(yaw=3.1), footprint=LOPSIDED)
    assert error.value.data["enclosed_within_m"] < 3.0
    assert error.value.data["states_expanded"] < 1.5 * both_ends.ENCLOSED
    plan = hybrid(tolerance=0.1).make_plan(room(), START, IN_ALCOVE, footprint=LOPSIDED)
    assert plan.path[-1] == IN_ALCOVE


def test_a_pose_within_the_tolerance_of_a_goal_that_cannot_be_entered() -> None:
    """In the alcove, the robot cannot come to stand as slanted as the goal says."""
    plan = hybrid(tolerance=0.8).make_plan(room(), START, SLANTED, footprint=LOPSIDED)
    end = plan.path[-1]
    assert 0.0 < plan.goal_moved_m + abs(end.yaw - SLANTED.yaw) <= 0.8 + 1e-9
    assert not Referee(room(), LOPSIDED, False, 1.0, False).faults(plan, START, end)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["REEDS_SHEPP", "diff"])
def test_a_gap_narrower_than_the_robot(kind: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The search ends when it takes long, with the place of the gap, and not where the robot fits through."""
    monkeypatch.setattr(both_ends, "FIRST", 400)
    monkeypatch.setattr(both_ends, "PER_CELL", 0)
    box = Footprint(np.array([[0.5, 0.25], [0.5, -0.25], [-0.3, -0.25], [-0.3, 0.25]]))
    planner = hybrid(motion_model_for_search=kind) if kind.isupper() else lattice(kind, tmp_path)
    costs = np.zeros((60, 230), np.uint8)
    costs[:, 110:114] = costs[10:50, 70] = 254
    costs[30:34, 110:114] = 0
    costmap = Costmap(GridGeometry(230, 60, 0.1), costs)
    with pytest.raises(NoValidPathError, match=r"too narrow for the footprint at \(11.\d+, 3.20\)") as error:
        planner.make_plan(costmap, START, GOAL, footprint=box)
    assert error.value.data["states_expanded"] == 400
    costs[34, 110:114] = 0  # as wide as the robot, and then wider
    assert tried(planner, costmap, box)
    costs[35, 110:114] = 0
    plan = planner.make_plan(costmap, START, GOAL, footprint=box)
    assert plan.path[-1] == GOAL
    assert tried(planner, costmap, box)


def tried(planner: Any, costmap: Costmap, footprint: Footprint) -> bool:
    """Whether a search may find a path, as far as is known before it."""
    engine = planner._engine(0.1)
    engine.place(costmap.data, shape_of(footprint, 0.1))
    start, goal = (10.0, 30.0, 0.0), (162.0, 30.0)
    engine.set_goal(*goal, start[:2], keep=False)
    engine.settings["goal_x"], engine.settings["goal_y"] = goal
    return engine.may_connect(start)
