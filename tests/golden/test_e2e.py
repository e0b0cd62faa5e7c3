"""The whole stack against the real C++ move_base, on the real map, with the turtlebot's own YAML.

Tolerances: path lengths within 5 %, times within 15 %. C++ ran on a wall clock with threads: the phase of its plans and
costmap updates relative to the control cycle varies from run to run, which shifts each command by up to one cycle (0.2 s)
and the rotation at the goal by a few.
"""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import Pose2D
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.scenario import RunResult, Scenario, load_places, run_scenario

WILLOW = "maps/turtlebot_apps__willow-2010-02-18-0.10/willow-2010-02-18-0.10.yaml"
START = Pose2D(29.75, 7.95, 0.0)


def golden(folder: Path, name: str) -> list[dict[str, Any]]:
    with gzip.open(folder / "e2e" / f"{name}.json.gz") as file:
        return json.load(file)


def drive(data: Path, goals: tuple[Pose2D, ...], **settings: Any) -> RunResult:
    scenario = Scenario(
        map=load_map(data / WILLOW),
        configuration=load_configuration([data / "params/turtlebot2/param"], **settings),
        start=START,
        goals=goals,
    )
    return run_scenario(scenario)


@pytest.fixture(scope="module")
def three_goals(golden_dir: Path, data_dir: Path) -> tuple[list[dict[str, Any]], RunResult]:
    theirs = golden(golden_dir, "three_goals_intended")
    return theirs, drive(data_dir, tuple(Pose2D(*case["goal"][:3]) for case in theirs))


@pytest.mark.slow
def test_three_goals_are_reached_as_in_cpp(three_goals: tuple[list[dict[str, Any]], RunResult]) -> None:
    theirs, ours = three_goals
    for case, goal in zip(theirs, ours.goals, strict=True):
        assert goal.state == case["final_state"] == "SUCCEEDED"
        assert goal.text == case["final_text"]
        assert goal.path_length_m == pytest.approx(case["path_length"], rel=0.05)
        assert goal.recoveries == 0
    for case, goal in zip(theirs[:2], ours.goals[:2], strict=True):
        assert goal.time_s == pytest.approx(case["time"], rel=0.15)
    assert ours.collisions == 0


@pytest.mark.slow
def test_the_third_goal_takes_as_long_as_in_cpp_with_or_without_its_full_turn(golden_dir: Path, data_dir: Path) -> None:
    """At (34.0, 14.3) noetic's scale gives a wall so much weight that every motion costs more than turning (parity 31).

    In its one recorded run C++ turned a full circle there, for 7 of its 41 s. Centimeters decide whether a run does: of the
    starts within about 1 cm of C++'s start some turn and take 41 s, the others 34 s. Both are checked here: with the turn
    within 5 % of C++'s time, without it within 15 % of C++'s time less the turn.
    """
    case = golden(golden_dir, "three_goals_intended")[2]
    odometry = np.array(case["odom"])
    still = odometry[(odometry[:, 0] > 3.0) & (odometry[:, 0] < 14.0) & (np.abs(odometry[:, 4]) < 1e-6)]
    circle_s = still[-1, 0] - still[0, 0]
    assert 6.0 < circle_s < 9.0
    rng = np.random.default_rng(1)
    grid = load_map(data_dir / WILLOW)
    configuration = load_configuration([data_dir / "params/turtlebot2/param"])
    goal = Pose2D(*case["goal"][:3])
    turned: list[float] = []
    straight: list[float] = []
    for offset in rng.normal(0.0, (0.01, 0.01, 0.02), (24, 3)):
        start = Pose2D(*(odometry[0, 1:4] + offset))
        (outcome,) = run_scenario(Scenario(grid, configuration, start, (goal,)), record=False).goals
        assert outcome.succeeded
        assert outcome.path_length_m == pytest.approx(case["path_length"], rel=0.05)
        (turned if outcome.time_s > case["time"] - 0.5 * circle_s else straight).append(outcome.time_s)
    assert turned, "no start led to the full turn of C++"
    assert straight
    assert turned == pytest.approx([case["time"]] * len(turned), rel=0.05)
    assert straight == pytest.approx([case["time"] - circle_s] * len(straight), rel=0.15)


@pytest.mark.slow
def test_a_goal_inside_a_wall_is_aborted_with_the_reason(golden_dir: Path, data_dir: Path) -> None:
    (case,) = golden(golden_dir, "unreachable_asloaded")
    (goal,) = drive(data_dir, (Pose2D(*case["goal"][:3]),)).goals
    assert goal.state == case["final_state"] == "ABORTED"
    assert goal.text == case["final_text"]
    assert (goal.error_code, goal.error_name) == (206, "GOAL_OCCUPIED")
    assert "lethal" in goal.message
    assert goal.path_length_m == 0.0
    # four recoveries as in C++ (conservative reset, turn, aggressive reset, turn), which took 38.5 s
    assert goal.recoveries == 4
    assert goal.time_s == pytest.approx(case["time"], rel=0.15)


OFFICE_CODE = """
import hashlib, sys
from pathlib import Path
from navstack.parameters.configuration import load_configuration
from navstack.map_io import load_map
from navstack.map_io import map_path
from navstack.scenario.places import load_places
from navstack.scenario import Scenario, run_scenario
office = load_places("office")
scenario = Scenario(load_map(map_path("office")), load_configuration(["turtlebot"]), office.start, office.goals[:1],
                    obstacles=((office.start.x + 50.0, 0.0, 0.1),), seed=5)
out = Path(sys.argv[1])
out.mkdir()
run_scenario(scenario).recorder.save(out)
"""


@pytest.mark.slow
def test_a_run_is_identical_in_any_process(tmp_path: Path) -> None:
    for name in ("first", "second"):
        subprocess.run([sys.executable, "-c", OFFICE_CODE, str(tmp_path / name)], check=True)
    arguments = sys.argv
    sys.argv = ["-c", str(tmp_path / "third")]
    try:
        exec(OFFICE_CODE, {})
    finally:
        sys.argv = arguments
    for file in ("run.npz", "run.log"):
        first = (tmp_path / "first" / file).read_bytes()
        assert first == (tmp_path / "second" / file).read_bytes()
        assert first == (tmp_path / "third" / file).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("source", ["turtlebot", "published"])
def test_indigo_scoring_drives_through_the_doors_of_the_office(source: str, request: pytest.FixtureRequest) -> None:
    if source == "published":
        params = [request.getfixturevalue("data_dir") / "params/turtlebot2/param"]
    else:
        params = ["turtlebot"]
    office = load_places("office")
    scenario = Scenario(
        load_map(map_path("office")), load_configuration(params, distro="indigo"), office.start, office.goals
    )
    result = run_scenario(scenario, record=False)
    assert [goal.state for goal in result.goals] == ["SUCCEEDED"] * 3
    assert [goal.recoveries for goal in result.goals] == [0, 0, 0]
    assert result.collisions == 0
