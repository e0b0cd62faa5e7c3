"""Faults: the robot that has one, what its record says, and that the others go on."""

from __future__ import annotations

import pytest

from navstack.core import InputError, Pose2D
from navstack.fleet import FleetRun, make_fleet, run_fleet
from navstack.fleet.fleet import FAULT
from navstack.record import Record
from tests.fleet.stage import EAST, WEST, scenario

LEFT = scenario((1.0, 1.5, 0.0), (3.0, 1.5, 0.0))
AWAY = scenario((7.0, 2.0, 3.14), (6.0, 2.0, 3.14))


def fault(**values: object) -> object:
    return FAULT.validate_python(values)


def record_of(run: FleetRun, name: str) -> Record:
    recorder = run.runs[name].recorder
    assert recorder is not None
    return recorder.record()


def test_a_robot_that_dies_stands_and_the_others_go_on() -> None:
    run = FleetRun(make_fleet({"a": LEFT, "b": AWAY}, faults=[fault(kind="dies", robot="a", time=2.0)]))
    while run.step():
        pass
    result = run.result(1.0)
    dead, other = result.robots
    assert [goal.state for goal in dead.run.goals] == ["PREEMPTED"]
    assert dead.fault == "died at 2 s"
    assert 2.0 <= dead.finished_s <= 2.0 + 0.2  # the cancel takes effect at the next control cycle
    # it rolls out as fast as it brakes, and stands then
    assert 1.3 < run.runs["a"].robot.pose.x < 2.2
    assert run.runs["a"].robot.state().velocity.vx == 0.0
    assert [goal.state for goal in other.run.goals] == ["SUCCEEDED"]
    assert any(event.text == "a dies" for event in record_of(run, "a").events)
    with pytest.raises(InputError, match="a has died"):
        run.send("a", Pose2D(1.0, 1.0, 0.0))


def test_a_robot_that_is_pushed_goes_as_far_as_it_is_free() -> None:
    pushes = [fault(kind="pushed", robot="a", time=0.5, by=[0.0, 5.0, 0.0])]
    run = FleetRun(make_fleet({"a": LEFT, "b": scenario((1.0, 2.4, 0.0))}, faults=pushes))
    while run.time < 0.6 and run.step():
        pass
    pose = run.runs["a"].robot.pose
    # the other robot stands at y = 2.4 m; both have a radius of 0.2 m
    assert 2.0 - 0.05 < pose.y < 2.0 + 1e-9
    assert run.runs["a"].robot.collisions == []
    while run.step():
        pass
    assert [goal.state for goal in run.result(1.0).robots[0].run.goals] == ["SUCCEEDED"]


def test_a_robot_that_loses_its_localization_believes_to_be_elsewhere() -> None:
    lost = [fault(kind="lost", robot="a", time=1.0, offset=[0.0, 0.4, 0.0])]
    result = run_fleet(make_fleet({"a": LEFT, "b": AWAY}, faults=lost))
    a, b = result.robots
    assert b.run.succeeded
    assert [goal.state for goal in a.run.goals] == ["SUCCEEDED"]  # as it believes
    assert a.run.recorder is not None
    record = a.run.recorder.record()
    assert record.poses[-1, 1] == pytest.approx(1.5 - 0.4, abs=0.16)  # xy_goal_tolerance is 0.15 m


def test_faults_are_part_of_what_is_run_again() -> None:
    from navstack.fleet import replay_member

    push = [fault(kind="pushed", robot="east", time=1.0, by=[0.0, 0.2, 0.1])]
    fleet = make_fleet({"east": EAST, "west": WEST}, faults=push, seed=2)
    run = FleetRun(fleet)
    while run.time < 4.0 and run.step():
        pass
    record = record_of(run, "west")
    again = replay_member(record)
    assert again.name == "west"
    for time, pose in zip(record.times.tolist(), record.poses.tolist(), strict=True):
        assert again.step()
        assert again.robot.time == time
        assert list(again.robot.pose) == pose
