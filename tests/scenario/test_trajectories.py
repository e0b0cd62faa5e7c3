"""Replayed people: their files, positions, absence, and what sees and touches them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from navstack.core import Footprint, InputError, Pose2D, ScenarioError
from navstack.scenario import read_scenario, run_scenario
from navstack.scenario.trajectories import read_trajectories
from navstack.sim import Lidar, LidarParams, ReplayMotion, Shape, SimParams, SimulatedRobot, World

ROWS = "0.0, 1, 1.0, 2.0\n0.4, 1, 1.4, 2.0\n0.4, 2, 5.0, 5.0\n1.2, 1, 1.4, 2.8\n2.4, 2, 5.0, 3.0\n"
SCENARIO = """
map: office
start: [0.8, 7.45, 0.0]
goals: [[3.0, 7.45, 0.0]]
shapes:
  - {radius: 0.25, motion: {kind: replay, file: people.csv%s}}
"""


def written(folder: Path, text: str, name: str = "people.csv") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    "text",
    [
        ROWS,
        "t,id,x,y\n" + ROWS,
        "# from a video\n" + ROWS.replace(", ", "\t"),
        ROWS.replace(", ", ";"),
        "x y id t\n1.0 2.0 1 0.0\n1.4 2.0 1 0.4\n1.4 2.8 1 1.2\n5.0 3.0 2 2.4\n5.0 5.0 2 0.4\n",
        ROWS.replace(" 1,", " 1.0,").replace(" 2,", " 2.0,"),
    ],
    ids=["plain", "header", "tabs", "semicolons", "other order", "ids as floats"],
)
def test_reads_the_common_forms(tmp_path: Path, text: str) -> None:
    assert read_trajectories(written(tmp_path, text)) == {
        "1": [[0.0, 1.0, 2.0], [0.4, 1.4, 2.0], [1.2, 1.4, 2.8]],
        "2": [[0.4, 5.0, 5.0], [2.4, 5.0, 3.0]],
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.0,1,1.0\n", r"people.csv:1:1: \"0.0,1,1.0\" is not t, id, x, y; write four numbers"),
        (ROWS + "1.6,1,nan,2.0\n", r"people.csv:6:1: .* is not t, id, x, y"),
        (
            ROWS + "0.4,2,1.0,1.0\n",
            r"people.csv:6:1: person 2 is at two positions at 0.4 s \(lines 3 and 6\); remove one of the rows",
        ),
        ("", r"people.csv has no rows t, id, x, y; name a file"),
    ],
)
def test_names_what_is_wrong_in_a_file(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_trajectories(written(tmp_path, text))


def test_a_scenario_has_a_shape_for_each_person(tmp_path: Path) -> None:
    written(tmp_path, ROWS)
    spec = read_scenario(written(tmp_path, SCENARIO % "", "run.yaml"))
    assert [(shape.name, shape.pose[:2]) for shape in spec.shapes] == [
        ("person 1", [1.0, 2.0]),
        ("person 2", [5.0, 5.0]),
    ]
    one = read_scenario(written(tmp_path, SCENARIO % ", person: 2", "run.yaml"))
    assert [shape.name for shape in one.shapes] == ["person 2"]
    motion = one.shapes[0].motion
    assert isinstance(motion, ReplayMotion)
    assert Shape.model_validate(one.shapes[0].model_dump(mode="json")) == one.shapes[0]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (", person: 7", r"run.yaml:6:\d+: people.csv has no person \"7\"; it has 1, 2"),
        (", speed: 2", r"run.yaml:6:\d+: a motion of kind replay with a file has no key \"speed\""),
    ],
)
def test_names_what_is_wrong_in_a_scenario(tmp_path: Path, more: str, message: str) -> None:
    written(tmp_path, ROWS)
    with pytest.raises(ScenarioError, match=message):
        read_scenario(written(tmp_path, SCENARIO % more, "run.yaml"))
    with pytest.raises(ScenarioError, match=r"none.csv: No such file"):
        read_scenario(written(tmp_path, (SCENARIO % "").replace("people.csv", "none.csv"), "run.yaml"))


def test_positions_times_of_absence_and_order() -> None:
    with pytest.raises(ValueError, match=r"time 1 s after 1 s; sort them"):
        ReplayMotion(points=[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    world = World(None, shapes=[person([[1.0, 0.0, 0.0], [2.0, 1.0, 2.0], [4.0, 1.0, 0.0]]), person([[3.0, 5.0, 5.0]])])
    assert world.moves
    for t, x, y in ((1.0, 0.0, 0.0), (1.5, 0.5, 1.0), (2.0, 1.0, 2.0), (3.0, 1.0, 1.0), (4.0, 1.0, 0.0)):
        assert world.discs_at(t)[0].tolist() == pytest.approx([x, y, 0.25])
    for t in (0.0, 0.999, 4.001):
        assert np.isnan(world.discs_at(t)[0, :2]).all()
    assert [bool(np.isnan(world.discs_at(t)[1, 0])) for t in (2.9, 3.0, 3.1)] == [True, False, True]


def person(points: list[list[float]]) -> Shape:
    return Shape(radius=0.25, pose=[*points[0][1:]], motion=ReplayMotion(points=points))


def test_nothing_sees_or_touches_an_absent_person() -> None:
    """A person stands at x = 1 from 2 s to 4 s; the robot drives there before, and is met there."""
    world = World(None, shapes=[person([[2.0, 1.0, 0.0], [4.0, 1.0, 0.0]])])
    lidar = Lidar(LidarParams(beams=36, fov=2 * math.pi, range_max=5.0), seed=0, number=0)
    at = Pose2D(0.0, 0.0, 0.0)
    assert not np.isfinite(lidar.scan(world, at, 0, 1.0).ranges).any()
    assert float(np.min(lidar.scan(world, at, 0, 3.0).ranges)) == pytest.approx(0.75, abs=0.2)
    foot = Footprint.from_radius(0.2)
    assert world.clearance(at, foot, 1.0) == math.inf
    assert world.clearance(at, foot, 3.0) == pytest.approx(0.55, abs=1e-3)
    assert world.is_free(foot, Pose2D(1.0, 0.0, 0.0), 1.0)
    assert not world.is_free(foot, Pose2D(1.0, 0.0, 0.0), 3.0)
    assert not world.near_obstacle(np.array([[1.0, 0.0]]), 0.5, world.solids_at(1.0)).any()
    robot = SimulatedRobot(SimParams(bumpers=[]), world, foot, Pose2D(1.0, 0.0, 0.0))
    robot.advance_to(1.9)
    robot.scans()
    assert not robot.collisions
    before = robot.camera(width=32).rgb.copy()
    robot.advance_to(2.2)
    assert [c.kind for c in robot.collisions] == ["disc"]
    assert (robot.camera(width=32).rgb != before).any()


@pytest.mark.slow
def test_a_run_records_who_is_there(tmp_path: Path) -> None:
    """Absent people are NaN in the record, and a walking crowd goes around present ones."""
    written(tmp_path, "0,1,3.0,7.9\n2,1,6.0,7.9\n1,2,6,6.9\n60,2,6,6.9\n")
    spec = read_scenario(written(tmp_path, SCENARIO % "", "run.yaml"))
    result = run_scenario(spec.build())
    assert result.recorder is not None
    record = result.recorder.record()
    assert len(record.solids_at(0.5)[0]) == 1
    assert len(record.solids_at(1.5)[0]) == 2
    assert len(record.solids_at(2.5)[0]) == 1
    assert np.isnan(record.solids_at(0.5, absent=True)[0][1, :2]).all()
