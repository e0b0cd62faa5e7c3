"""Docking in the simulator: states, records, explanations, steps of scenarios, the low battery, Nav2's methods."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.bringup import BasicNavigator, TaskResult
from navstack.core import InputError, NavError, Pose2D, Twist2D
from navstack.docking import DockDatabase, Docking, DockingFeedback, DockingState, Undocking
from navstack.docking.dock_types import PoseFilter, SimpleChargingDock, SimpleChargingDockParams
from navstack.docking.errors import DockNotInDatabaseError, DockNotValidError
from navstack.explain import explain_goals
from navstack.local_planner import SmoothControlLaw
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.scenario import Run, Scenario, load_scenario, read_step, run_scenario, write_scenario
from tools.docking_runs import CAMERA, REFLECTOR, Bench, Case, cases, configuration, room, run, run_random

QUIET: dict[str, Any] = {
    "dock_camera": {"noise": 0.0, "yaw_noise": 0.0},
    "localization_noise": 0.0,
    "localization_yaw_noise": 0.0,
}
NEAR = Pose2D(1.8, 0.42, 0.02)
"""At the staging pose."""

pytestmark = pytest.mark.slow


# --- the runs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("detector", "count"), [(CAMERA, 12), (REFLECTOR, 6)])
def test_the_robot_docks_within_a_centimeter_and_a_degree(detector: str, count: int) -> None:
    outcomes = [run_random(detector, 10_000 + seed) for seed in range(count)]
    assert [one.code for one in outcomes] == [0] * count
    assert all(one.good and one.collisions == 0 for one in outcomes)


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_hostile_cases_end_with_their_codes(case: Case) -> None:
    outcome = run(case, 0)
    assert outcome.code == case.code, outcome.message
    if 900 < case.code < 999:
        assert outcome.message.startswith("home: ")
    # each retry adds one state RETRY
    assert outcome.states.count("RETRY") == outcome.retries


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_detections_with_3_cm_and_3_degrees_of_noise(seed: int) -> None:
    noisy = {"noise": 0.03, "yaw_noise": 0.052}
    outcome = run(Case("noisy", sim={"dock_camera": noisy}, start=NEAR), seed)
    assert outcome.code == 0 and outcome.retries <= 2, outcome.message


def test_a_robot_short_of_the_contacts_drives_on_to_them() -> None:
    # Nav2's threshold is farther than the springs of the contacts reach
    outcome = run(Case("short", sim=QUIET, dock_type={"docking_threshold": 0.05}, start=NEAR), 0)
    assert (outcome.code, outcome.retries) == (0, 0), outcome.message


def test_states_of_a_docking_in_order() -> None:
    outcome = run(Case("quiet", sim=QUIET), 0)
    assert outcome.states == ("NAV_TO_STAGING_POSE", "INITIAL_PERCEPTION", "CONTROLLING", "WAIT_FOR_CHARGE")
    near = run(Case("near", sim=QUIET, start=NEAR), 0)
    assert near.states == ("INITIAL_PERCEPTION", "CONTROLLING", "WAIT_FOR_CHARGE")


def test_a_run_is_a_function_of_its_seed() -> None:
    case = Case("again", start=NEAR)
    assert run(case, 5) == run(case, 5)
    assert run(case, 5) != run(case, 6)


def test_a_cancel_stops_the_robot_within_a_cycle() -> None:
    bench = Bench(Case("cancel", sim=QUIET, start=NEAR), 0)
    task = Docking(bench.move_base, bench.database, "home")
    task.start()
    while bench.robot.time < 1.5:
        bench.robot.advance_to(bench.move_base.next_due(bench.robot.time))
        bench.move_base.tick(bench.robot.time)
        task.advance()
    assert task.state is DockingState.CONTROLLING
    assert bench.move_base.command.vx > 0.05
    task.cancel()
    assert task.is_done
    assert bench.move_base.command == Twist2D()
    task.cancel()
    assert task.result.error_name == "CANCELED"


def test_docking_backward_after_a_turn_and_undocking() -> None:
    case = Case(
        "backward",
        sim=QUIET,
        dock={"contact_side": "back"},
        # the errors of the turn need some way to vanish
        dock_type={"dock_direction": "backward", "rotate_to_dock": True, "staging_x_offset": -1.2},
        start=NEAR,
    )
    bench = Bench(case, 0)
    task = bench.dock()
    assert task.succeeded, task.text
    assert bench.robot.pose.distance_to(bench.database.dock("home").pose) < 0.01
    assert abs(abs(bench.robot.pose.yaw) - np.pi) < 0.03
    leave = Undocking(bench.move_base, bench.database)
    leave.start()
    while not leave.is_done and bench.robot.time < 100.0:
        bench.robot.advance_to(bench.move_base.next_due(bench.robot.time))
        bench.move_base.tick(bench.robot.time)
        leave.advance()
    assert leave.succeeded, leave.text
    assert bench.robot.pose.distance_to(Pose2D(1.4, 0.4)) < 0.1
    assert abs(bench.robot.pose.yaw) < 0.1
    assert bench.robot.collisions == []


def test_undocking_has_a_time_limit() -> None:
    bench = Bench(Case("undock", sim=QUIET, start=Pose2D(2.6, 0.4, 0.0)), 0)
    leave = Undocking(bench.move_base, bench.database, max_undocking_time_s=0.5)
    leave.start()
    while not leave.is_done:
        bench.robot.advance_to(bench.move_base.next_due(bench.robot.time))
        bench.move_base.tick(bench.robot.time)
        leave.advance()
    assert (leave.result.error_code, leave.result.error_name) == (907, "TIMEOUT")


def test_a_dock_without_a_charger_and_without_a_detector() -> None:
    kind = {"plugin": "opennav_docking::SimpleNonChargingDock", "use_external_detection_pose": False}
    outcome = run(Case("shelf", sim=QUIET, dock_type=kind, dock={"powered": False}, start=NEAR), 0)
    assert outcome.code == 0
    assert outcome.error_m < 0.01
    assert outcome.states[-1] == "CONTROLLING"


def test_docks_in_unknown_frames_are_refused() -> None:
    for docking, code in (
        ({"fixed_frame": "earth"}, 9001),
        ({"home": {"pose": [2.6, 0.4, 0.0], "frame": "moon"}}, 902),
    ):
        outcome = run(Case("frame", sim=QUIET, docking=docking, start=NEAR), 0)
        assert outcome.code == code, outcome.message


# --- parts ------------------------------------------------------------------------------------------------------------


def test_the_filter_averages_first_and_follows_later() -> None:
    noise = np.random.default_rng(0).standard_normal(400) * 0.02
    filtered = PoseFilter(0.02)
    for value in noise[:50]:
        filtered.update(Pose2D(float(value), 0.0, 3.14))
    assert filtered.pose is not None
    assert filtered.pose.x == pytest.approx(noise[:50].mean())
    for value in noise[50:]:
        filtered.update(Pose2D(1.0 + float(value), 0.0, -3.14))
    assert abs(filtered.pose.x - 1.0) < 0.01
    # the mean of headings on both sides of pi is not 0
    assert abs(abs(filtered.pose.yaw) - np.pi) < 0.1


def test_the_law_drives_into_the_target_from_many_poses() -> None:
    law = SmoothControlLaw(
        k_phi=3.0,
        k_delta=2.0,
        beta=0.4,
        exponent=2.0,
        v_min=0.1,
        v_max=0.25,
        w_max=0.75,
        slowdown_radius=0.25,
        deceleration=2.5,
    )
    for backward in (False, True):
        for y in (-0.2, 0.0, 0.2):
            target = Pose2D(1.0, 0.0, np.pi if backward else 0.0)
            start = Pose2D(0.0, y, target.yaw + y)
            way = law.trajectory(start, target, backward=backward, seconds=30.0, step=0.02)
            assert np.hypot(*(way[-1, :2] - [1.0, 0.0])) < 0.02
            assert abs(np.sin(way[-1, 2] - target.yaw)) < 0.12
            v, w = law.command(start, target, backward=backward)
            assert (v < 0.0) is backward
            assert abs(w) <= 0.75


def test_staging_poses_follow_the_offsets() -> None:
    dock = SimpleChargingDock("d", SimpleChargingDockParams(staging_x_offset=-1.0, staging_yaw_offset=0.5))
    assert dock.staging_pose(Pose2D(2.0, 1.0, np.pi / 2)) == pytest.approx((2.0, 0.0, np.pi / 2 + 0.5))


# --- scenarios --------------------------------------------------------------------------------------------------------


def scenario(**values: Any) -> Scenario:
    made = configuration(Case("scenario", sim={**QUIET, **values.pop("sim", {})}, **values.pop("case", {})))
    goals = values.pop("goals", ())
    steps = tuple(read_step(step) for step in values.pop("steps", ()))
    return Scenario(room(), made, NEAR, goals, steps=steps, **values)


def test_steps_of_a_scenario_dock_and_undock(tmp_path: Path) -> None:
    wanted = scenario(steps=[{"dock": "home"}, {"undock": True}, {"goto": [0.5, 0.0, 0.0]}])
    result = run_scenario(wanted)
    assert [goal.state for goal in result.goals] == ["SUCCEEDED"] * 3, [goal.message for goal in result.goals]
    assert [goal.step for goal in result.goals] == ["dock at home", "undock", ""]
    assert result.goals[0].figures["docking"]["states"][-1]["state"] == "WAIT_FOR_CHARGE"
    assert result.recorder is not None
    result.recorder.save(tmp_path / "run.npz")
    record = Record.load(tmp_path / "run.npz")
    assert Scenario.from_record(record).steps == wanted.steps
    reports = explain_goals(record)
    assert len(reports) == 3
    texts = [line.text for line in reports[0].timeline if line.kind == "docking"]
    assert [text.partition(",")[0] for text in texts] == ["INITIAL_PERCEPTION", "CONTROLLING", "WAIT_FOR_CHARGE"]
    assert "1 detection, the last at" in texts[0]
    assert reports[0].duration == pytest.approx(result.goals[0].time_s, abs=0.05)
    again = write_scenario(wanted, tmp_path / "again.yaml")
    assert again.steps == wanted.steps


def test_a_low_battery_interrupts_the_goal_which_is_resumed(tmp_path: Path) -> None:
    battery = {"capacity": 0.05, "charge": 0.32}
    wanted = scenario(
        goals=(Pose2D(-3.0, -1.0, 0.0), Pose2D(-3.0, 1.5, 0.0)),
        sim={"battery": battery},
        low_battery=_rule(threshold=0.3, resume=0.6),
    )
    result = run_scenario(wanted)
    assert [goal.state for goal in result.goals] == ["SUCCEEDED"] * 2, [goal.message for goal in result.goals]
    assert result.recorder is not None
    result.recorder.save(tmp_path / "run.npz")
    record = Record.load(tmp_path / "run.npz")
    said = [event.text for event in record.events if event.kind == "docking"]
    assert "goal-1 is interrupted to charge" in said[0]
    assert any("docked at home" in text for text in said)
    reports = explain_goals(record)
    assert [report.status for report in reports] == ["SUCCEEDED"] * 2
    assert any("interrupted to charge" in line.text for line in reports[0].timeline)
    restored = Scenario.from_record(record)
    assert restored.low_battery == wanted.low_battery
    assert run_scenario(restored).goals == result.goals


def test_a_charger_without_power_ends_the_goal_with_its_code() -> None:
    wanted = scenario(
        goals=(Pose2D(-3.0, -1.0, 0.0),),
        sim={"battery": {"capacity": 0.5, "charge": 0.29}},
        case={"dock": {"powered": False}, "docking": {"max_retries": 0}},
        low_battery=_rule(threshold=0.3, resume=0.6),
    )
    (goal,) = run_scenario(wanted).goals
    assert (goal.state, goal.error_code) == ("ABORTED", 906)


def _rule(**values: float):  # type: ignore[no-untyped-def]
    from navstack.scenario.low_battery import LowBattery

    return LowBattery(**values)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"steps": [{"dock": "hom"}]}, 'no dock is called "hom"; did you mean "home"'),
        ({"goals": (NEAR,), "low_battery": {"dock": "away"}}, 'no dock is called "away"'),
        ({"goals": (NEAR,), "low_battery": {"threshold": 0.9, "resume": 0.5}}, "resume 0.5 is not above threshold 0.9"),
        ({"goals": (NEAR,), "low_battery": {}}, "set navstack/sim/battery/capacity"),
    ],
)
def test_what_cannot_work_is_said_before_the_robot_drives(values: dict[str, Any], said: str) -> None:
    if "low_battery" in values:
        values = {**values, "low_battery": _rule(**values["low_battery"])}
    with pytest.raises(NavError) as caught:
        Run(scenario(**values))
    assert said in caught.value.message


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ({"dock": "a", "undock": True}, "is not one step"),
        ({"dock": "a", "move": 1.0}, "is not one step"),
        ({"dock": 3}, "dock of the step dock is 3"),
        ({"dock": "a", "til": 0.9}, "known keys: dock, navigate_to_staging_pose, until_charge"),
        ({"dock": "a", "until_charge": 1.5}, "until_charge of the step dock is 1.5"),
    ],
)
def test_wrong_steps(step: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as caught:
        read_step(step)
    assert said in caught.value.message


def test_a_scenario_file_with_a_low_battery(tmp_path: Path) -> None:
    file = tmp_path / "charge.yaml"
    text = "map: office\nstart: [2.0, 7.45, 0.0]\ngoals: [{dock: home, until_charge: 0.9}]\nlow_battery: {threshold: 0.3}\n"
    file.write_text(text)
    made = load_scenario(file)
    assert made.low_battery is not None
    assert (made.low_battery.threshold, made.low_battery.resume) == (0.3, 0.9)
    file.write_text(text.replace("threshold", "thresholds"))
    with pytest.raises(InputError, match=r"charge.yaml:4:\d+.*thresholds"):
        load_scenario(file)


# --- Nav2's methods ---------------------------------------------------------------------------------------------------


def navigator(start: Pose2D = NEAR) -> BasicNavigator:
    return BasicNavigator.simulated(configuration(Case("navigator", sim=QUIET)), room(), start)


def test_the_navigator_docks_and_undocks_by_nav2s_names() -> None:
    nav = navigator()
    assert nav.dockRobotByID("home")
    states: list[DockingState] = []
    while not nav.isTaskComplete():
        feedback = nav.getFeedback()
        assert isinstance(feedback, DockingFeedback)
        states.append(feedback.state)
    assert nav.getResult() is TaskResult.SUCCEEDED, nav.getTaskError()
    assert states[0] in (DockingState.INITIAL_PERCEPTION, DockingState.CONTROLLING)
    assert states[-1] is DockingState.WAIT_FOR_CHARGE
    assert nav.undockRobot()
    while not nav.isTaskComplete():
        pass
    assert nav.getResult() is TaskResult.SUCCEEDED, nav.getTaskError()
    assert nav.dockRobotByPose(Pose2D(2.6, 0.4, 0.0), "simple_charging_dock", nav_to_dock=False)
    nav.isTaskComplete()
    nav.cancelTask()
    assert nav.getResult() is TaskResult.CANCELED
    assert nav.goToPose(Pose2D(0.5, 0.0, 0.0))
    while not nav.isTaskComplete():
        pass
    assert nav.getResult() is TaskResult.SUCCEEDED


def test_another_task_cancels_the_docking() -> None:
    nav = navigator(Pose2D(-1.0, 0.0, 0.0))
    nav.dockRobotByID("home")
    for _ in range(5):
        nav.isTaskComplete()
    feedback = nav.getFeedback()
    assert isinstance(feedback, DockingFeedback)
    assert feedback.state is DockingState.NAV_TO_STAGING_POSE
    nav.goToPose(Pose2D(-2.0, 0.0, 3.0))
    while not nav.isTaskComplete():
        pass
    assert nav.getResult() is TaskResult.SUCCEEDED


def test_the_navigator_refuses_unknown_docks() -> None:
    nav = navigator()
    with pytest.raises(DockNotInDatabaseError):
        nav.dockRobotByID("hme")
    with pytest.raises(DockNotValidError):
        nav.dockRobotByPose(Pose2D(2.6, 0.4, 0.0), "shelf")
    with pytest.raises(InputError):
        DockDatabase.of(load_configuration(["turtlebot", {"docking_server": {"dock_database": "nowhere.yaml"}}]))
