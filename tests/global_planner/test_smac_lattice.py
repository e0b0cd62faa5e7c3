"""smac_lattice: an independent referee, robots of all three kinds, exact ends, errors, reproducibility."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, Footprint, GridGeometry, InputError, NoValidPathError, Pose2D
from navstack.global_planner import SmacLatticeParams, SmacLatticePlanner
from navstack.global_planner._lattice_file import write_lattice
from navstack.global_planner._lattice_generate import generate_lattice
from navstack.parameters import load_configuration
from tests.global_planner.fuzz_poses import run
from tests.global_planner.pose_referee import Referee, inflated, random_queries, shortest_word, weighted_length
from tests.global_planner.test_smac_hybrid import BOX, RESOLUTION, ROUND, empty, rooms

FILE = "5cm_resolution/0.5m_turning_radius/{}/output.json"


def planner(model: str = "ackermann", **values: Any) -> SmacLatticePlanner:
    return SmacLatticePlanner(SmacLatticeParams(lattice_filepath=FILE.format(model), **values))


@pytest.mark.slow
@pytest.mark.parametrize(("footprint", "reverse"), [(BOX, True), (BOX, False), (ROUND, True)])
def test_an_independent_referee(footprint: Footprint, reverse: bool) -> None:
    costmap = inflated(rooms(), RESOLUTION, footprint.inscribed_radius)
    referee = Referee(costmap, footprint, footprint is ROUND, 0.5, reverse)
    search = planner(allow_reverse_expansion=reverse, max_iterations=100_000)
    found, _, faults = random_queries(search, referee, np.random.default_rng(3), 20, 6.0)
    assert faults == []
    assert found >= 12


@pytest.mark.slow
@pytest.mark.parametrize("model", ["diff", "omni"])
def test_robots_that_turn_in_place(model: str) -> None:
    """Every start and goal with room to turn is found; the swept footprint is free, and steps are those of the robot."""
    costmap = inflated(rooms(), RESOLUTION, BOX.inscribed_radius)
    referee = Referee(costmap, BOX, False, 0.0, True)
    search = planner(model, max_iterations=100_000)
    rng = np.random.default_rng(8)
    for _ in range(12):
        start, goal = (
            Pose2D(float(rng.uniform(0.8, 3.2)) + side, float(rng.uniform(2.4, 3.9)), float(rng.uniform(-3.1, 3.1)))
            for side in rng.permutation([0.0, 4.0]).tolist()
        )
        plan = search.make_plan(costmap, start, goal, footprint=BOX)
        poses = plan.path.poses
        assert plan.path[0] == start and plan.path[-1] == goal
        assert referee.collisions(plan.path) == []
        step, turn = np.hypot(*np.diff(poses[:, :2], axis=0).T), np.diff(np.unwrap(poses[:, 2]))
        assert step.max() <= RESOLUTION * 1.01 and np.abs(turn).max() < 0.2
        if model == "diff":
            moving = step > 1e-6
            course = np.arctan2(np.diff(poses[:, 1]), np.diff(poses[:, 0])) - np.unwrap(poses[:, 2])[:-1] - 0.5 * turn
            assert np.abs(np.sin(course[moving])).max() < 1e-3
            assert (np.cos(course[moving]) > 0.0).all()
            assert (np.abs(turn[moving]) <= step[moving] / 0.5 + 1e-3).all()


def test_an_omnidirectional_robot_ends_exactly_at_the_goal() -> None:
    """Also where a state in the goal's cell is reached before a line to the goal is tried."""
    search = planner("omni", tolerance=0.0, analytic_expansion_ratio=1000.0)
    goal = Pose2D(7.02, 3.03, 0.0)
    assert search.make_plan(empty(), Pose2D(3.0, 3.0, 0.0), goal).path[-1] == goal


def test_an_omnidirectional_robot_slides() -> None:
    """Sideways for 2 m, and a turn on the way."""
    for yaw, length in ((0.0, 2.0), (1.0, 2.0)):
        plan = planner("omni").make_plan(empty(), Pose2D(3.0, 3.0, 0.0), Pose2D(3.0, 5.0, yaw))
        assert plan.length_m == pytest.approx(length, abs=1e-6)
        assert np.abs(np.diff(plan.path.poses[:, 2])).max() < 0.1


@pytest.mark.slow
def test_length_in_empty_space() -> None:
    """The shortest curve of the turning radius, from any heading to any heading."""
    rng = np.random.default_rng(6)
    searches = {penalty: planner(allow_reverse_expansion=True, reverse_penalty=penalty) for penalty in (1.0, 2.0)}
    for _ in range(20):
        start, goal = (Pose2D(*(float(v) for v in rng.uniform((2.5, 2.5, -3.1), (5.5, 5.5, 3.1)))) for _ in range(2))
        least = shortest_word(start, goal, 0.5, 1.0)
        for penalty, search in searches.items():
            length = weighted_length(search.make_plan(empty(), start, goal).path, penalty)
            assert 0.997 * least - 1e-9 <= length <= 1.03 * shortest_word(start, goal, 0.5, penalty) + 1e-9


@pytest.mark.slow
def test_primitive_files(tmp_path: Path) -> None:
    """A file and what is generated for its name give the same plan; one for other cells is refused."""
    costmap = inflated(rooms(), RESOLUTION, 0.22)
    start, goal = Pose2D(1.0, 5.5, 0.3), Pose2D(6.5, 1.0, 0.0)
    file = write_lattice(generate_lattice(0.5, 0.05), tmp_path / "car.json")
    plans = [
        SmacLatticePlanner(SmacLatticeParams(lattice_filepath=path)).make_plan(costmap, start, goal)
        for path in ("", str(file), "$(find-pkg-share nav2_smac_planner)/sample_primitives/" + FILE.format("ackermann"))
    ]
    assert plans[0].path.poses.tobytes() == plans[1].path.poses.tobytes() == plans[2].path.poses.tobytes()
    coarse = Costmap(GridGeometry(80, 60, 0.1), np.zeros((60, 80), np.uint8))
    with pytest.raises(
        InputError, match=r"for cells of 0.05 m, but the costmap has cells of 0.1 m; .*--resolution 0.1 "
    ):
        planner().make_plan(coarse, Pose2D(1.0, 1.0, 0.0), Pose2D(4.0, 4.0, 0.0))
    default = SmacLatticePlanner().make_plan(coarse, Pose2D(1.0, 1.0, 0.0), Pose2D(4.0, 4.0, 0.0))
    assert default.length_m < 4.6


def test_a_passage_that_is_too_narrow() -> None:
    lethal = np.zeros((80, 160), np.bool_)
    lethal[:40, 60:100] = lethal[51:, 60:100] = True
    costmap = Costmap(GridGeometry(160, 80, RESOLUTION), np.where(lethal, 254, 0).astype(np.uint8))
    with pytest.raises(NoValidPathError, match="too narrow for the footprint at"):
        planner().make_plan(costmap, Pose2D(1.0, 2.275, 0.0), Pose2D(7.0, 2.275, 0.0), footprint=BOX)


def test_paths_without_curves_to_the_goal_end_at_the_lattice() -> None:
    plan = planner(analytic_expansion_max_length=0.0).make_plan(empty(), Pose2D(2.0, 2.0, 0.1), Pose2D(5.0, 4.0, 0.5))
    assert plan.goal_moved_m <= 0.05 * math.sqrt(2.0)
    assert abs(plan.goal.yaw - 0.4636) < 1e-3


def test_nav2_names_and_files_in_yaml(tmp_path: Path) -> None:
    values = ["base_global_planner=nav2_smac_planner::SmacPlannerLattice", "smac_lattice.rotation_penalty=3.0"]
    configuration = load_configuration(["turtlebot"], overrides=values)
    assert configuration.global_planner.cls is SmacLatticePlanner
    file = tmp_path / "broken.json"
    file.write_text("{}")
    from navstack.core import NavError

    with pytest.raises(NavError, match=r"broken\.json:1: the key lattice_metadata is missing"):
        load_configuration(["turtlebot"], overrides=[*values, f"smac_lattice.lattice_filepath={file}"])


@pytest.mark.slow
def test_random_input() -> None:
    """`python -m tests.global_planner.fuzz_poses lattice 2000` runs more cases."""
    ends, faults = run("lattice", 12, 5)
    assert faults == []
    assert ends["plan"] >= 3
