"""Steps of a run: motions between goals, recorded, replayed and explained; what interrupts them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.behaviors import (
    FollowStep,
    InvalidMotionError,
    MotionLimits,
    from_path,
    parse_angle,
    parse_length,
    read_step,
    save_trajectory,
    step_data,
    step_text,
)
from navstack.core import InputError, Pose2D, RecordError, ScenarioError
from navstack.explain import explain_command, explain_goal, explain_tracking
from navstack.move_base import BusyError, GoalStatus
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.scenario import Run, Scenario, load_scenario, run_scenario
from navstack.scenario.file_writer import write_scenario

PLACES = nav.load_places("office")
ROOM = Pose2D(2.4, 11.6, 0.5)
"""A place of the office with room for a figure of eight."""


def scenario(
    *steps: dict[str, Any], start: Pose2D = PLACES.start, overrides: tuple[str, ...] = (), **values: Any
) -> Scenario:
    return Scenario(
        map=nav.load_map(nav.map_path("office")),
        configuration=load_configuration(["turtlebot"], overrides=list(overrides)),
        start=start,
        goals=(),
        steps=tuple(read_step(step, places=PLACES.places) for step in steps),
        **values,
    )


TOUR = (
    {"move": 0.5},
    {"turn": "90 deg"},
    {"wait": 1},
    {"turn": "-90deg"},
    {"goto": [2.3, 7.45, 0.0]},
    {"drive_to": [1.8, 7.45, 3.1]},
    {"move": -0.2},
    {"follow": "figure_eight", "size": 0.5},
)


@pytest.fixture(scope="module")
def tour(tmp_path_factory: pytest.TempPathFactory) -> Record:
    result = run_scenario(scenario(*TOUR))
    assert result.succeeded, [goal.message for goal in result.goals]
    assert result.recorder is not None
    folder = tmp_path_factory.mktemp("tour")
    result.recorder.save(folder)
    return Record.load(folder)


@pytest.mark.slow
def test_every_step_has_its_outcome(tour: Record) -> None:
    steps = [result.get("step", "") for result in tour.results]
    motions = ["move 0.5 m", "turn 90 deg", "wait 1 s", "turn -90 deg", "drive to 1.8, 7.45, 3.1", "move -0.2 m"]
    assert steps == [*motions[:4], "", *motions[4:], "follow figure_eight"]
    assert [result["state"] for result in tour.results] == ["SUCCEEDED"] * len(TOUR)
    start = PLACES.start
    targets = tour.goals
    assert len(targets) == len(TOUR)
    assert targets[0] == pytest.approx([start.x + 0.5, start.y, start.yaw], abs=1e-9)
    assert targets[1][2] == pytest.approx(math.pi / 2, abs=1e-9)
    assert tour.results[0]["figures"]["driven_m"] == pytest.approx(0.5, abs=0.01)
    assert tour.results[2]["time_s"] == pytest.approx(1.0, abs=0.03)
    assert tour.results[-1]["figures"]["error_max_m"] < 0.005
    assert set(tour.states.tolist()) >= {"MOTION", "CONTROLLING"}


def test_a_motion_is_explained_as_a_goal_is(tour: Record) -> None:
    report = explain_goal(tour, 1)
    assert (report.id, report.status, report.error_code) == ("move-1", "SUCCEEDED", 0)
    assert report.seconds("MOTION") == pytest.approx(report.duration)
    assert report.pose is not None
    command = explain_command(tour, 1.5)
    assert (command.planner, command.state, command.plan.mode) == ("motion move", "MOTION", "move")
    assert command.summary.startswith("cruising: ")
    assert command.plan.command.vx == pytest.approx(0.2)
    assert not command.samples


def test_tracking_is_explained_from_the_record(tour: Record) -> None:
    (report,) = explain_tracking(tour)
    assert report.name == "figure_eight"
    assert report.t[-1] == pytest.approx(report.duration, abs=0.06)
    found = report.statistics()["distance_m"]
    assert found["max"] < 0.005
    assert report.believed == pytest.approx(report.distance, abs=1e-9)  # localization is perfect
    rows = report.table().splitlines()
    assert rows[0].startswith("t,ref_x,ref_y,ref_yaw,x,y,yaw,along,across,heading,believed")
    assert len(rows) == len(report.t) + 1
    with pytest.raises(RecordError, match="contains no trajectory"):
        explain_tracking(run_record(scenario({"wait": 0.1})))


def run_record(made: Scenario) -> Record:
    recorder = run_scenario(made).recorder
    assert recorder is not None
    return recorder.record()


@pytest.mark.slow
def test_the_same_steps_give_the_same_bytes_and_survive_file_and_record(tour: Record, tmp_path: Path) -> None:
    again = Scenario.from_record(tour)
    assert again.steps == scenario(*TOUR).steps
    written = write_scenario(again, tmp_path / "tour.yaml")
    recorder = run_scenario(replace(written, names=again.names, name="")).recorder
    assert recorder is not None
    repeated = recorder.record()
    for name in ("samples", "goals", "local_plans"):
        assert np.array_equal(repeated.arrays[name], tour.arrays[name])


@pytest.mark.slow
def test_a_plan_of_the_office_is_followed(tmp_path: Path) -> None:
    """The path of navfn from the corridor to the first goal, timed for 0.4 m/s, from a file; perfect motion: below 2 cm."""
    base = scenario({"wait": 1})
    start, goal = base.start, PLACES.places["office_2"]
    path = nav.plan_on_map(base.configuration, base.map, start, goal).plan.path
    planned = from_path(path, MotionLimits(0.4, 1.5, 0.5, 2.0), smoothing_m=0.03)
    file = save_trajectory(planned, tmp_path / "plan.yaml")
    perfect = run_record(scenario({"follow": str(file)}))
    assert perfect.results[0]["state"] == "SUCCEEDED", perfect.results[0]["message"]
    (report,) = explain_tracking(perfect)
    assert report.statistics()["distance_m"]["max"] < 0.02
    assert report.statistics()["distance_m"]["mean"] < 0.005
    assert report.speed.max() == pytest.approx(0.4, abs=0.03)
    noise = ("wheel_slip", "odometry_noise", "wheel_slip_turn", "odometry_noise_turn")
    values = dict(zip(noise, (0.05, 0.05, 0.02, 0.02)))
    overrides = tuple(f"navstack/sim/{name}={value}" for name, value in values.items())
    (noisy,) = explain_tracking(run_record(scenario({"follow": str(file)}, overrides=overrides)))
    assert noisy.statistics()["distance_m"]["max"] < 0.06
    assert noisy.statistics()["distance_m"]["mean"] < 0.015


@pytest.mark.slow
def test_by_odometry_the_record_tells_truth_from_belief() -> None:
    drift = ("navstack/sim/odometry_scale=0.05", "navstack/sim/odometry_turn=0.02")
    record = run_record(scenario({"follow": "figure_eight", "size": 1.0, "frame": "odom"}, start=ROOM, overrides=drift))
    (report,) = explain_tracking(record)
    assert report.believed.max() < 0.01
    assert report.distance.max() > 0.02


@pytest.mark.slow
def test_motions_pass_through_multiplexer_and_smoother() -> None:
    """With the smoother's limits below those of the planner, the robot accelerates by the smoother's, and still arrives."""
    smoother = {"max_accel": [0.3, 0.0, 0.5], "max_decel": [-0.3, 0.0, -0.5]}
    base = scenario({"move": 0.6}, {"turn": 0.8})
    parts = load_configuration(["turtlebot", {"twist_mux": {}, "velocity_smoother": smoother}])
    record = run_record(replace(base, configuration=parts))
    assert [result["state"] for result in record.results] == ["SUCCEEDED", "SUCCEEDED"]
    assert record.results[0]["figures"]["driven_m"] == pytest.approx(0.6, abs=0.015)
    # the smoother's 20 Hz are 3 physics steps of 0.02 s at most: 0.3 m/s² and 0.5 rad/s² over that time
    change = np.abs(np.diff(record.velocities, axis=0))
    assert change[:, 0].max() <= 0.3 * 0.06 + 1e-6
    assert change[:, 2].max() <= 0.5 * 0.06 + 1e-6


# --- what interrupts a motion -----------------------------------------------------------------------------------------


def running(*steps: dict[str, Any], until: float = 0.5, **values: Any) -> Run:
    run = Run(scenario(*steps, **values))
    while run.robot.time < until:
        assert run.step()
    return run


def test_a_stopped_run_cancels_the_motion_and_stands() -> None:
    run = running({"move": 2.0}, {"wait": 1})
    run.stop()
    (outcome,) = run.outcomes
    assert (outcome.state, outcome.error_name) == ("PREEMPTED", "CANCELED")
    assert run.move_base.command == (0.0, 0.0, 0.0)
    assert run.done


def test_a_goal_that_is_sent_cancels_the_motion() -> None:
    run = running({"move": 2.0})
    handle = run.move_base.motions.running
    assert handle is not None
    with pytest.raises(InputError, match="not finite"):
        run.move_base.motions.drive(nav.Twist2D(math.nan))
    run.move_base.send_goal(PLACES.places["corridor_middle"])
    run.step()
    assert handle.status is GoalStatus.PREEMPTED
    assert run.move_base.motions.running is None
    with pytest.raises(BusyError, match="a goal is active"):
        run.move_base.motions.start(handle.motion)
    with pytest.raises(BusyError, match="a goal is active"):
        run.move_base.motions.drive(nav.Twist2D(0.1))


def test_a_failed_step_ends_the_run_only_if_asked_to() -> None:
    steps: tuple[dict[str, Any], ...] = ({"move": 30.0}, {"wait": 0.2})
    result = run_scenario(scenario(*steps))
    assert [goal.state for goal in result.goals] == ["ABORTED", "SUCCEEDED"]
    assert result.goals[0].error_name == "COLLISION_AHEAD"
    assert not result.succeeded
    assert len(run_scenario(scenario(*steps, stop_on_failure=True)).goals) == 1


def test_a_step_that_takes_too_long_ends_with_the_time_limit() -> None:
    result = run_scenario(scenario({"wait": 100.0}, time_limit_s=1.0))
    outcome = result.goals[0]
    assert (outcome.state, outcome.error_code, outcome.error_name) == ("ABORTED", 9016, "GOAL_TIME_LIMIT")
    assert outcome.message == "wait 100 s did not end within the time limit of 1 s"
    assert result.simulated_s < 2.0


def test_a_car_is_told_that_it_cannot_turn_in_place() -> None:
    car = ("navstack/sim/kinematics=ackermann",)
    for step in ({"turn": 1.0}, {"drive_to": [1.0, 7.45, 0.0]}):
        with pytest.raises(
            InvalidMotionError, match=r"a base with a turning radius of .+ cannot turn in place; use goto"
        ):
            Run(scenario(step, overrides=car))


@pytest.mark.slow
def test_a_trajectory_keeps_the_limit_of_the_wheels() -> None:
    """Wheels of 0.2 m/s at the rim: a shape is fitted to them, and the fastest wheel comes close to its limit."""
    wheels = ("navstack/sim/wheels/drive=differential", f"navstack/sim/wheels/max_speed={0.2 / 0.035:.6f}")
    record = run_record(scenario({"follow": "figure_eight", "size": 1.0}, start=ROOM, overrides=wheels))
    assert record.results[0]["state"] == "SUCCEEDED"
    vx, wz = record.velocities[:, 0], record.velocities[:, 2]
    assert (np.abs(vx) + 0.5 * 0.23 * np.abs(wz)).max() == pytest.approx(0.2, abs=0.01)
    assert record.results[0]["figures"]["error_max_m"] < 0.01


def test_a_car_cannot_follow_the_notch_of_a_heart() -> None:
    result = run_scenario(scenario({"follow": "heart"}, start=ROOM, overrides=("navstack/sim/kinematics=ackermann",)))
    assert result.goals[0].error_name == "INFEASIBLE_TRAJECTORY"
    assert "curvature" in result.goals[0].message


# --- steps as text ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "angle"),
    [
        ("270deg", 1.5 * math.pi),
        ("-90 deg", -0.5 * math.pi),
        ("1.57", 1.57),
        ("1.57 rad", 1.57),
        ("1000°", math.radians(1000.0)),
    ],
)
def test_angles(text: str, angle: float) -> None:
    assert parse_angle(text) == pytest.approx(angle)


@pytest.mark.parametrize("text", ["", "deg", "90 grad", "1e", "nan", "inf", "90deg deg"])
def test_wrong_angles(text: str) -> None:
    with pytest.raises(InvalidMotionError):
        parse_angle(text)
    with pytest.raises(InvalidMotionError):
        parse_length(text)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"move": 1.0, "turn": 1.0}, "is not one step"),
        ({"jump": 1.0}, "is not one step"),
        ({"move": "far"}, "move of the step move is 'far'"),
        ({"move": math.nan}, "move of the step move is nan"),
        ({"move": 1.0, "sped": 2.0}, "sped of the step move is 2.0: known keys: "),
        ({"turn": "90 gon"}, "neither rad nor deg"),
        ({"wait": -1.0}, "wait of the step wait is -1.0"),
        ({"goto": "nowhere"}, 'goto "nowhere" is not a place; known places: corridor_west'),
        ({"drive_to": [1.0]}, "drive_to of the step drive_to"),
    ],
)
def test_wrong_steps(step: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidMotionError) as error:
        read_step(step, places=PLACES.places)
    assert message in error.value.message


def test_a_record_cannot_make_a_step_read_files() -> None:
    with pytest.raises(InvalidMotionError, match="has no trajectory"):
        read_step({"follow": "/etc/passwd.csv"}, folder=None)


def test_steps_are_data() -> None:
    step = read_step({"goto": "office_2"}, places=PLACES.places)
    assert step_text(step) == "office_2"
    assert read_step(step_data(step)) == step
    follow = read_step({"follow": "heart", "size": 3.0})
    assert isinstance(follow, FollowStep)
    assert step_data(follow) == {"follow": "heart", "size": 3.0}


# --- files ------------------------------------------------------------------------------------------------------------

STEPS = """
places:
  desk: [2.0, 7.45, 0]
start: [0.8, 7.45, 0]
goals:
  - {move: 0.5, speed: 0.3}
  - desk
  - {turn: 90 deg}
  - [2.2, 7.45, 0]
"""


def test_a_file_of_places_has_steps(tmp_path: Path) -> None:
    file = tmp_path / "office.places.yaml"
    file.write_text(STEPS)
    places = nav.load_places(file)
    assert [step_text(step) for step in places.steps] == ["move 0.5 m", "desk", "turn 90 deg", "2.2, 7.45, 0"]
    assert places.goal_names == ("desk", "")
    file.write_text(STEPS.replace("90 deg", "90 gon"))
    with pytest.raises(
        InputError, match=r"office\.places\.yaml:8:5: step 3: the angle .90 gon. is neither rad nor deg"
    ):
        nav.load_places(file)


def test_a_scenario_file_has_steps(tmp_path: Path) -> None:
    file = tmp_path / "steps.yaml"
    text = "map: office\nparams: turtlebot\nstart: [0.8, 7.45, 0]\n"
    file.write_text(text + "goals: [{move: 0.5}, office_2, {turn: -1.5}]\nsuccess: {goals: [SUCCEEDED, any, any]}\n")
    made = load_scenario(file)
    assert [step_text(step) for step in made.steps] == ["move 0.5 m", "office_2", "turn -85.9437 deg"]
    assert made.goals == ()
    assert load_scenario(file, goals=[ROOM]).steps == ()
    file.write_text(text + "tour: [{move: 0.5}, {goto: kitchn}]\n")
    with pytest.raises(ScenarioError, match=r'steps\.yaml:4:21: step 2: goto "kitchn" is not a place'):
        load_scenario(file)
