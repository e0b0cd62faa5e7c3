"""The rules of BARN on small fields: success, collision, timeout, and scores."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from navstack.core import InputError
from navstack.scenario import BarnWorld, load_worlds
from navstack.studies.barn import (
    BarnOutcome,
    BarnTask,
    barn_configuration,
    read_cpp_results,
    run_world,
    totals_table,
)
from navstack.studies.evaluation import BarnEvaluation
from navstack.studies.inputs import for_workers
from navstack.studies.jobs import SerialExecutor
from navstack.studies.task import run_jobs


@pytest.fixture(scope="module")
def jackal(data_dir: Path) -> Path:
    folder = data_dir / "params" / "jackal_barn"
    if not folder.is_dir():
        pytest.skip("the parameters of the Jackal are not available")
    return folder


def field(*discs: tuple[float, float, float]) -> BarnWorld:
    return BarnWorld(7, np.array(discs, np.float64).reshape(-1, 3), 10.0)


def test_totals_count_what_became_of_each_run() -> None:
    ends = [("success", 10.0), ("success", 20.0), ("collision", 3.0), ("timeout", 100.0), ("aborted", 50.0)]
    outcomes = [
        BarnOutcome(n, end, time, 5.0, 0.1, 0.25 * (end == "success"), 0.0) for n, (end, time) in enumerate(ends)
    ]
    (row,) = totals_table(outcomes, {}).rows
    assert row["runs"] == 5
    means = {key: row[key].value for key in ("success", "collision", "other", "time_s", "score")}
    assert means == pytest.approx({"success": 0.4, "collision": 0.2, "other": 0.4, "time_s": 15.0, "score": 0.1})


@pytest.mark.slow
def test_an_open_field_is_crossed_at_full_speed_and_reproducibly(jackal: Path) -> None:
    configuration = barn_configuration(jackal)
    world = field((3.0, 5.0, 0.1))
    first, recorder = run_world(world, configuration)
    assert recorder is None
    assert first.outcome == "success" and first.world == 7
    # the first 0.1 m are not timed and the last meter is not driven
    assert first.time_s == pytest.approx((10.0 - 1.0 - 0.1) / 0.5, abs=0.5)
    assert first.length_m == pytest.approx(9.0, abs=0.1)
    assert first.score == pytest.approx(5.0 / first.time_s)
    assert 2.0 < first.clearance_m < 3.0
    assert first.jerk_rms_m_s3 > 0.0 and first.recoveries == 0
    assert run_world(world, configuration)[0] == first


@pytest.mark.slow
def test_an_enclosed_robot_does_not_succeed(jackal: Path) -> None:
    ring = [(0.8 * np.cos(a), 0.8 * np.sin(a), 0.06) for a in np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)]
    outcome, recorder = run_world(
        field(*ring),
        barn_configuration(jackal, overrides=["planner_patience=1.0", "controller_patience=1.0"]),
        record=True,
    )
    assert outcome.outcome == "aborted" and outcome.score == 0.0 and outcome.text
    assert outcome.time_s < 60.0 and outcome.length_m < 3.0
    assert recorder is not None and len(recorder.record().times) > 10


def test_the_score_is_clipped() -> None:
    world = field()
    assert world.optimal_time_s == 5.0
    assert world.score(1.0) == 0.5
    assert world.score(20.0) == 0.25
    assert world.score(99.0) == 0.125


def test_invalid_world_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="BARN"):
        load_worlds(tmp_path / "worlds.npz")
    good = {
        "world": [1],
        "cyl_xy": np.zeros((2, 2)),
        "cyl_offset": [0, 2],
        "cyl_radius": 0.1,
        "optimal_length_m": [9.0],
    }
    np.savez(tmp_path / "good.npz", **good)
    assert [w.number for w in load_worlds(tmp_path / "good.npz")] == [1]
    (tmp_path / "empty.npz").touch()
    (tmp_path / "cut.npz").write_bytes((tmp_path / "good.npz").read_bytes()[:300])
    (tmp_path / "text.npz").write_text("world,x,y")
    np.save(tmp_path / "one.npy", np.arange(3))
    np.savez(tmp_path / "few.npz", world=np.arange(3))
    np.savez(tmp_path / "uneven.npz", **{**good, "world": [1, 2, 3]})
    np.savez(tmp_path / "flat.npz", **{**good, "cyl_xy": np.zeros(5)})
    for name in ("empty.npz", "cut.npz", "text.npz", "one.npy", "few.npz", "uneven.npz", "flat.npz"):
        with pytest.raises(InputError, match=f"{name} is not a file of BARN worlds"):
            load_worlds(tmp_path / name)


@pytest.mark.slow
def test_a_world_without_cylinders(jackal: Path, tmp_path: Path) -> None:
    """Its clearance is infinite, which JSON cannot represent."""
    empty = {"world": [5], "cyl_xy": np.zeros((0, 2)), "cyl_offset": [0, 0], "cyl_radius": 0.1}
    np.savez(tmp_path / "worlds.npz", **empty, optimal_length_m=[10.0])
    task = BarnTask(tmp_path, (str(jackal),), seeds=2)
    document = task.report(run_jobs(task, task.jobs(), executor=SerialExecutor(task))).document
    assert [run["outcome"] for run in document["runs"]] == ["success", "success"]
    assert [run["clearance_m"] for run in document["runs"]] == [np.inf, np.inf]
    assert document["worlds"].rows[0]["clearance_m"] == np.inf
    evaluation = BarnEvaluation(load_worlds(tmp_path / "worlds.npz"), [0])
    outcome = evaluation.drive(evaluation.cases[0], task.configuration)[0]
    assert outcome.clearance_m == 0.0 and outcome.jerk > 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("world,outcome\n", "cpp.csv:1: column AT is missing; the table needs world, outcome, AT"),
        ("", "cpp.csv:1: column world is missing"),
        (
            "world,outcome,AT,length,clearance,score\n1,success,9,9,1,0.5\n2,success,nine,9,1,0.5\n",
            "cpp.csv:3: could not convert string to float: 'nine'; a line holds world",
        ),
        ("world,outcome,AT,length,clearance,score\n1,success,9\n", "cpp.csv:2: the line has too few columns"),
    ],
)
def test_an_invalid_table_is_reported_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "cpp.csv").write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        read_cpp_results(tmp_path / "cpp.csv")
    assert read_cpp_results(tmp_path / "absent.csv") == {}


def test_sources_for_workers_have_absolute_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "me@home").mkdir()
    (tmp_path / "me@home" / "a.yaml").touch()
    assert for_workers("turtlebot") == "turtlebot"
    assert for_workers("me@home/a.yaml") == str(tmp_path / "me@home" / "a.yaml")
    assert for_workers("me@home/a.yaml@local_costmap") == f"{tmp_path / 'me@home' / 'a.yaml'}@local_costmap"
    assert for_workers("me@home") == str(tmp_path / "me@home")


@pytest.mark.slow
def test_one_world_as_in_the_cpp_results(jackal: Path, data_dir: Path) -> None:
    """World 31: C++ needed 19.2 s for 9.25 m."""
    worlds = {world.number: world for world in load_worlds(data_dir / "barn" / "worlds.npz")}
    assert len(worlds) == 50
    outcome, _ = run_world(worlds[31], barn_configuration(jackal))
    assert outcome.succeeded
    assert outcome.time_s == pytest.approx(19.22, rel=0.1)
    assert outcome.length_m == pytest.approx(9.25, rel=0.03)
