"""Tours: the file of places, order, pauses, failures, output, and Ctrl-C."""

from __future__ import annotations

import itertools
import json
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import navstack as nav
from navstack.cli.app import run as command
from navstack.core import InputError, Pose2D, Twist2D
from navstack.map_io import map_names, map_path
from navstack.parameters import Finding, load_configuration
from navstack.record import Record
from navstack.scenario import Run, Scenario, advice_of, drive_tour, run_scenario
from navstack.scenario.outcome import MUCH_TURNING, MUCH_TURNING_S, advice_for
from navstack.scenario.places import load_places, visit_order
from navstack.scenario.run import WARM_UP_S, blind_motion
from navstack.scenario.tour import TourState


def file_of(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "places.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", map_names())
def test_the_packaged_maps_places(name: str) -> None:
    read = load_places(map_path(name).with_name(f"{name}.places.yaml"))
    known = load_places(name)
    assert read == known
    assert known.start == known.start_pose
    assert known.goals == tuple(known.places[goal] for goal in known.goal_names)


@pytest.mark.parametrize("head", ["locations:\n  ", "places:\n  ", ""])
def test_a_pose_by_yaw_or_by_quaternion(tmp_path: Path, head: str) -> None:
    rows = (
        "a: [1, 2, 1.5]",
        "b: {x: 1.0, y: 2.0, yaw: 1.5}",
        "c: {position: {x: 1.0, y: 2.0, z: 0.0}, orientation: {x: 0.0, y: 0.0, z: 0.6816387600, w: 0.7316888689}}",
        "d: {pose: {position: {x: 1.0, y: 2.0}, orientation: {z: 1.3632775200, w: 1.4633777378}}}",
        "e: {x: 1, y: 2, orientation: {z: 0.6816387600, w: 0.7316888689}}",
    )
    indent = "\n  " if head else "\n"
    read = load_places(file_of(tmp_path, head + indent.join(rows)))
    assert read.goal_names == ("a", "b", "c", "d", "e")
    assert read.start_pose is None
    for pose in read.places.values():
        assert tuple(pose) == pytest.approx((1.0, 2.0, 1.5))


def test_start_and_goals_by_name(tmp_path: Path) -> None:
    read = load_places(file_of(tmp_path, "places: {a: [1, 2], b: [3, 4, 1]}\nstart: b\ngoals: [b, a, [5, 6]]"))
    assert read.start == Pose2D(3.0, 4.0, 1.0)
    assert read.goal_names == ("b", "a", "goal 3")
    assert read.places["goal 3"] == Pose2D(5.0, 6.0, 0.0)


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("places: {a: [1, x]}", "1:17", 'y of "a" must be a finite number'),
        ("places:\n  a: [1]\n", "2:6", "has 1 number"),
        ("places:\n  a: {x: 1, yaw: 2}\n", "2:6", "has no y"),
        ("places:\n  a: {x: 1, y: .inf}\n", "2:16", "finite"),
        ("places:\n  a: {x: 1, y: 2, theta: 2}\n", "2:19", '"theta"'),
        ("places:\n  a: 7\n", "2:6", "is not a pose"),
        ("places:\n  a: {x: 1, y: 1, yaw: 0, orientation: {w: 1}}\n", "2:19", "both"),
        ("a: {x: 1, y: 1, orientation: {z: 0, w: 0}}\n", "1:30", "not a rotation about z"),
        ("a: {x: 1, y: 1, orientation: {x: 1, w: 0}}\n", "1:30", "not a rotation about z"),
        ("a: {x: 1, y: 1, orientation: {z: 1}}\n", "1:30", "has no w"),
        ("places: {a: [1, 2]}\nstart: b\n", "2:8", '"b" is not a place'),
        ("places: {a: [1, 2]}\ngoals: [a, c]\n", "2:12", '"c" is not a place'),
        ("places: {a: [1, 2]}\ngoals: []\n", "2:8", "goals must be a list"),
        ("places: {a: [1, 2]}\ngaols: [a]\n", "2:1", '"gaols"'),
        ("places: {a: [1, 2]}\nlocations: {a: [1, 2]}\n", "2:1", "both"),
        ("places: {}\n", "1:9", "no places"),
        ("places: {a: [1, 2], a: [3, 4]}\n", "1:21", "a"),
        ("places: [\n", "2:1", ""),
        ("", "1:1", "no places"),
    ],
)
def test_errors_in_places_files_have_line_and_column(tmp_path: Path, text: str, where: str, what: str) -> None:
    path = file_of(tmp_path, text)
    with pytest.raises(InputError) as failed:
        load_places(path)
    assert failed.value.message.startswith(f"{path}:{where}: ")
    assert what in failed.value.message


def test_the_order() -> None:
    names = ("c", "a", "b")
    assert visit_order(names, "given", loops=2) == names * 2
    assert visit_order(names, "sorted") == ("a", "b", "c")
    tour = visit_order(names, "random", loops=50, seed=3)
    assert tour == visit_order(names, "random", loops=50, seed=3)
    assert tour != visit_order(names, "random", loops=50, seed=4)
    assert all(a != b for a, b in itertools.pairwise(tour))
    assert all(set(tour[i : i + 3]) == set(names) for i in range(0, 150, 3))
    assert visit_order(("a",), "random", loops=2) == ("a", "a")


START = Pose2D(2.0, 7.45, 0.0)
NEAR, FAR, WALL = Pose2D(2.8, 7.45, 0.0), Pose2D(3.4, 7.45, 0.0), Pose2D(2.0, 50.0, 0.0)


def scenario_of(*goals: Pose2D, **more: object) -> Scenario:
    return Scenario(
        map=nav.load_map(nav.map_path("office")),
        configuration=load_configuration(["turtlebot"], overrides=["recovery_behavior_enabled=false"]),
        start=START,
        goals=goals,
        **more,  # type: ignore[arg-type]
    )


def test_a_tour_pauses_between_goals_and_reports_its_state() -> None:
    reported: list[tuple[str, float]] = []
    scenario = scenario_of(NEAR, FAR, pause_s=3.0)
    result = drive_tour(scenario, ("near", "far"), on_goal=lambda n, o, s: reported.append((n, s.running_s)))
    assert result.succeeded
    assert not result.interrupted
    state = result.state
    assert (state.total, state.done, state.succeeded, state.success_rate, state.place) == (2, 2, 2, 1.0, None)
    assert [name for name, _ in reported] == ["near", "far"]
    driving = sum(goal.time_s for goal in result.run.goals)
    assert state.running_s == pytest.approx(driving + 3.0, abs=1e-6)
    assert state.distance_m == pytest.approx(sum(g.path_length_m for g in result.run.goals), abs=0.05)
    document = result.as_dict()
    assert [g["place"] for g in document["goals"]] == ["near", "far"]
    assert (document["success_rate"], document["left_out"]) == (1.0, [])


@pytest.mark.parametrize(
    ("total", "done", "succeeded", "text"),
    [
        (4, 1, 1, "1 of 4 goals reached, 3 to go; 9.0 s, 2.0 m"),
        (3, 2, 1, "1 of 3 goals reached, 1 failed, 1 to go; 9.0 s, 2.0 m"),
        (3, 3, 3, "3 of 3 goals reached; 9.0 s, 2.0 m"),
        (2, 0, 0, "0 of 2 goals reached, 2 to go; 9.0 s, 2.0 m"),
    ],
)
def test_the_state_of_a_tour_counts_all_its_goals(total: int, done: int, succeeded: int, text: str) -> None:
    assert str(TourState(total, done, succeeded, 9.0, 2.0, None)) == text


@pytest.mark.parametrize("stop", [False, True])
def test_a_failure_ends_the_tour_only_with_stop_on_failure(stop: bool) -> None:
    result = drive_tour(scenario_of(WALL, NEAR, stop_on_failure=stop), ("wall", "near"))
    assert [g.state for g in result.run.goals] == ["ABORTED"] if stop else ["ABORTED", "SUCCEEDED"]
    assert result.state.success_rate == (0.0 if stop else 0.5)
    assert result.as_dict()["left_out"] == (["near"] if stop else [])
    assert not result.succeeded


def test_a_goal_that_takes_too_long_ends_with_its_time_limit() -> None:
    result = drive_tour(scenario_of(FAR, NEAR, time_limit_s=1.0), ("far", "near"))
    first = result.run.goals[0]
    assert (first.state, first.error_code, first.error_name) == ("ABORTED", 9016, "GOAL_TIME_LIMIT")
    assert first.message == "the goal was not reached within its time limit of 1 s"
    assert "cancel" not in first.text + first.message
    assert result.run.goals[0].time_s == pytest.approx(1.2, abs=0.2)
    assert len(result.run.goals) == 2


def test_a_stopped_tour_stops_the_robot_and_has_a_complete_record() -> None:
    run = Run(scenario_of(FAR, NEAR))
    while run.move_base.command.vx == 0.0:
        assert run.step()
    before = run.robot.time
    run.stop()
    assert run.robot.time <= before + 0.2 + 1e-6
    assert run.move_base.command == Twist2D()
    assert [o.state for o in run.outcomes] == ["PREEMPTED"]
    assert not run.step()
    assert run.recorder is not None
    record = run.recorder.record()
    assert len(record.results) == 1
    again = Scenario.from_record(record)
    assert (again.pause_s, again.stop_on_failure) == (0.0, False)


@pytest.mark.slow
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    file = file_of(tmp_path, "places: {near: [2.8, 7.45], far: [3.4, 7.45]}\nstart: [2, 7.45]\n")
    assert command(["tour", file.name, "office", "--order", "sorted", "--json", "--rest", "0.5"]) == 0
    captured = capfd.readouterr()
    document = json.loads(captured.out)
    assert [g["place"] for g in document["goals"]] == ["far", "near"]
    assert document["success_rate"] == 1.0
    for name in document["files"].values():
        assert Path(name).is_file()
    assert json.loads(Path("navstack_tour/summary.json").read_text()) == document


@pytest.mark.slow
def test_ctrl_c_stops_the_robot_and_keeps_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    step, interrupted = Run.step, False

    def interrupting(self: Run) -> bool:
        nonlocal interrupted
        if self.robot.time > 2.0 * WARM_UP_S and not interrupted:
            interrupted = True
            signal.raise_signal(signal.SIGINT)
        return step(self)

    monkeypatch.setattr(Run, "step", interrupting)
    before = signal.getsignal(signal.SIGINT)
    assert command(["tour", "office", "--out", "out"]) == 130
    assert signal.getsignal(signal.SIGINT) is before
    printed = capfd.readouterr()
    assert "interrupted" in printed.out
    assert "2 goals skipped" in printed.out
    assert "PREEMPTED" in Path("out/run.log").read_text()
    record = Record.load(Path("out/run.npz"))
    assert [r["state"] for r in record.results] == ["PREEMPTED"]


def test_wrong_input_is_one_message(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = file_of(tmp_path, "places: {near: [2.8, 7.45]}\n")
    for arguments, what in (
        ([str(file)], "no map is given"),
        ([str(file), "office"], "--start"),
        ([str(file), "office", "--place", "fra"], "is not in places.yaml; its places: near"),
        ([str(tmp_path / "nowhere.yaml"), "office"], "cannot be read"),
        ([str(file), "atlantis", "--start", "2,7"], "atlantis"),
    ):
        assert command(["tour", *arguments]) == 2
        err = capfd.readouterr().err
        assert what in err, err
        assert err.count("error:") == 1


def test_long_turns_in_place_are_a_possible_cause_even_if_every_goal_was_reached() -> None:
    metrics = run_scenario(scenario_of(NEAR)).metrics
    assert advice_for(metrics, ()) == ()
    turning = replace(metrics, time_s=135.0, turning_s=48.0)
    (advice,) = advice_for(turning, ())
    assert advice.startswith("the robot turned in place for 48 s of 135 s; navstack doctor ")
    assert advice_for(replace(turning, turning_s=14.0), ()) == ()
    at_most = max(MUCH_TURNING_S, MUCH_TURNING * 135.0)
    assert advice_for(replace(turning, turning_s=at_most), ()) == ()
    assert advice_for(replace(turning, turning_s=np.nextafter(at_most, 99.0)), ())
    assert advice_for(replace(turning, state_s={"MOTION": 50.0}), ()) == ()
    # recovery behaviors turn on purpose
    assert advice_for(replace(turning, state_s={"CLEARING": 40.0}), ()) == ()
    late = Finding("warning", "updates-too-slow", "a.yaml", 3, 1, "local_costmap/update_frequency", "too low")
    assert advice_for(metrics, (late,)) == ()
    assert advice_for(metrics, (late,), collisions=1) == ("a.yaml:3:1: too low",)


def test_no_sensor_explains_a_collision_with_what_the_local_costmap_had() -> None:
    scenario = scenario_of(NEAR)
    metrics = run_scenario(scenario).metrics
    sensor = Finding("info", "assumed-lidar", "a.yaml", 4, 1, "local_costmap/scan/topic", "it is assumed")
    assert advice_for(metrics, (sensor,), collisions=1) == ("a.yaml:4:1: it is assumed",)
    (advice,) = advice_for(metrics, (sensor,), collisions=1, marked=(7.5,))
    assert "the local costmap had the obstacle of the collision, so no sensor is the cause" in advice
    assert "--time 7.0 shows" in advice
    assert len(advice_for(metrics, (sensor,), collisions=2, marked=(7.5,))) == 2
    lines = advice_for(metrics, (), collisions=3, marked=(7.5,), backward=(1.0, 7.5), turning=(2.0,))
    assert sum("drove backward into the obstacle of 1 of 3 collisions" in line for line in lines) == 1
    assert sum("turned in place into the obstacle of 1 of 3 collisions" in line for line in lines) == 1
    assert [blind_motion(*v) for v in ((-0.5, 1.0), (0.0, 1.0), (0.0, 0.0), (0.5, 1.0))] == [
        "backward",
        "turning",
        "",
        "",
    ]
    # the text of a record's parameters has no file
    assert advice_for(metrics, (replace(sensor, file="(a Python mapping)", line=0, column=0),), collisions=1) == (
        "it is assumed",
    )


@pytest.mark.slow
@pytest.mark.parametrize(("start", "speed", "had"), [(START, -0.5, False), (Pose2D(1.6, 7.45, 3.14159), 0.5, True)])
def test_a_run_and_its_record_know_whether_the_costmap_had_what_the_robot_touched(
    start: Pose2D, speed: float, had: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(replace(scenario_of(NEAR), start=start))
    run.step()
    obey = run.robot.command

    def disobey(twist: Twist2D) -> None:
        """Drive something else: backward, where the camera does not see, or ahead."""
        del twist
        obey(Twist2D(speed, 0.0, 0.0))

    monkeypatch.setattr(run.robot, "command", disobey)
    while not run.robot.collisions and run.robot.time < 20.0:
        run.step()
    run.step()
    result = run.result(0.0)
    assert result.collisions == 1
    assert any("the local costmap had the obstacle" in line for line in result.advice) == had
    assert any("the robot drove backward into the obstacle" in line for line in result.advice) == (speed < 0.0)
    run.stop()
    assert run.recorder is not None
    record = run.recorder.record()
    assert advice_of(record) == result.advice
