"""Robots with the whole stack that drive as the traffic control grants them, with faults and lost messages."""

from __future__ import annotations

from typing import Any

import pytest

from navstack.fleet import FleetRun
from navstack.fleet.drive import EXPIRED
from navstack.fleet.fleet import FAULT
from tests.fleet.stage import ROAD, guided

ENDS = {"a": 0, "b": 4}
SWAP = {"a": [4], "b": [0]}


def drive(routes: dict[str, list[int]], *faults: dict[str, Any], rule: str = "reservation", **traffic: Any) -> FleetRun:
    """Drive two robots from the ends of the road."""
    values = [FAULT.validate_python({"robot": "a", **fault}) for fault in faults]
    run = FleetRun(guided(ENDS, routes, faults=values, traffic={"rule": rule, **traffic}))
    while run.step():
        pass
    return run


def states(run: FleetRun) -> dict[str, list[str]]:
    """Return how the goals of the robots ended."""
    return {robot.name: [goal.state for goal in robot.run.goals] for robot in run.result(1.0).robots}


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["reservation", "pibt"])
def test_two_robots_pass_each_other_by_the_bay(rule: str) -> None:
    run = drive(SWAP, rule=rule)
    result = run.result(1.0)
    assert states(run) == {"a": ["SUCCEEDED"], "b": ["SUCCEEDED"]}
    assert result.contacts == ()
    assert result.min_distance_m > 0.1
    for robot, node in (("a", 4), ("b", 0)):
        x, y = ROAD.xy[ROAD.node(node)].tolist()
        pose = run.runs[robot].robot.pose
        assert abs(pose.x - x) + abs(pose.y - y) < 0.5
        assert any("held by" in wait.reason for wait in result.robot(robot).waits)
    assert any(event.kind == "dissolved" for event in result.events)


@pytest.mark.slow
def test_lost_and_late_messages_cost_time_only() -> None:
    run = drive(SWAP, delay=0.5, dropout=0.3)
    assert states(run) == {"a": ["SUCCEEDED"], "b": ["SUCCEEDED"]}
    assert run.result(1.0).contacts == ()


@pytest.mark.slow
def test_a_robot_that_is_silent_for_good_stops_and_the_others_go_on() -> None:
    # a may drive 0.25 m/s x 2 s on: not past node 1
    run = drive({"a": [4], "b": [5]}, {"kind": "silent", "time": 0.5, "until": 1e6}, params={"silence": 2.0})
    assert states(run)["b"] == ["SUCCEEDED"]
    assert 1.1 < run.runs["a"].robot.pose.x < 2.5
    assert run.runs["a"].robot.state().velocity.vx == 0.0
    recorder = run.runs["a"].recorder
    assert recorder is not None
    assert any(EXPIRED in event.text for event in recorder.record().events)
    assert run.traffic is not None
    assert run.traffic.rule.held()["a"][-1] == "node 1"  # type: ignore[attr-defined]
    assert run.result(1.0).contacts == ()


@pytest.mark.slow
def test_a_robot_that_was_silent_for_a_while_drives_on() -> None:
    run = drive(SWAP, {"kind": "silent", "time": 2.0, "until": 12.0})
    assert states(run) == {"a": ["SUCCEEDED"], "b": ["SUCCEEDED"]}
    assert run.result(1.0).contacts == ()
    assert any(event.kind == "silent" for event in run.result(1.0).events)


@pytest.mark.slow
def test_a_dead_robot_holds_where_it_stands_only() -> None:
    run = drive({"a": [4], "b": [5]}, {"kind": "dies", "time": 0.5}, params={"silence": 2.0})
    assert states(run) == {"a": ["PREEMPTED"], "b": ["SUCCEEDED"]}
    assert run.traffic is not None
    assert run.traffic.rule.held()["a"][-1] == "node 1"  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [{"kind": "lost", "time": 2.0, "offset": [0.3, 0.1, 0.0]}, {"kind": "pushed", "time": 2.0, "by": [0.0, 0.5, 0.5]}],
    ids=lambda fault: fault["kind"],
)
def test_robots_pass_although_one_is_pushed_or_believes_to_be_elsewhere(fault: dict[str, Any]) -> None:
    run = drive(SWAP, fault)
    assert states(run) == {"a": ["SUCCEEDED"], "b": ["SUCCEEDED"]}
    assert run.result(1.0).contacts == ()
