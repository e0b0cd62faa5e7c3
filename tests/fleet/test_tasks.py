"""Tasks of fleets: auctions, robots that die or run empty, goals without a way, more tasks than robots, and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navstack.core import Pose2D, ScenarioError
from navstack.fleet import FleetResult, Task, TaskParams, TaskPlan, load_fleet, make_fleet, run_fleet
from navstack.fleet.assignment import Bidder, Ways, assign_nearest, auction
from navstack.fleet.fleet import FAULT
from navstack.fleet.tasks import fairness
from tests.fleet.stage import MAP, scenario

A = scenario((1.0, 1.0, 0.0))
B = scenario((7.0, 2.0, 3.14))
WAYS = Ways(MAP)


def task(name: str, *places: tuple[float, float], **values: Any) -> Task:
    return Task(name, tuple(Pose2D(x, y, 0.0) for x, y in places), **values)


def drive(*tasks: Task, faults: tuple[Any, ...] = (), turned: bool = False, **params: Any) -> FleetResult:
    robots = {"b": B, "a": A} if turned else {"a": A, "b": B}
    plan = TaskPlan(tasks, TaskParams.model_validate({"idle": "stay", "silence": 1.0, **params}))
    return run_fleet(make_fleet(robots, tasks=plan, faults=[FAULT.validate_python(f) for f in faults]))


def test_ways_lead_over_free_cells_and_not_through_walls() -> None:
    length = WAYS.length(Pose2D(1.0, 1.0, 0.0), Pose2D(6.0, 1.0, 0.0), 0.2)
    assert length == pytest.approx(5.0, abs=0.2)
    assert WAYS.length(Pose2D(1.0, 1.0, 0.0), Pose2D(20.0, 1.0, 0.0), 0.2) == float("inf")


def test_an_auction_inserts_tasks_where_they_cost_least() -> None:
    robots = [Bidder("b", Pose2D(7.0, 1.5, 0.0), 0.2), Bidder("a", Pose2D(1.0, 1.5, 0.0), 0.2)]
    tasks = [task("far", (4.0, 1.5)), task("near", (2.0, 1.5)), task("right", (6.5, 1.5))]
    found = auction(tasks, robots, WAYS, "sum")
    assert {name: [t.name for t in queue] for name, queue in found.queues.items()} == {
        "a": ["near", "far"],
        "b": ["right"],
    }
    assert found.bids["right"]["b"] == pytest.approx(0.5, abs=0.15)
    assert auction(tasks[::-1], robots[::-1], WAYS, "sum") == found
    urgent = [*tasks, task("urgent", (4.5, 1.5), priority=1.0)]
    queues = auction(urgent, [robots[1]], WAYS, "average").queues
    assert queues["a"][0].name == "urgent"


def test_the_nearest_robot_gets_one_task() -> None:
    robots = [Bidder("a", Pose2D(1.0, 1.5, 0.0), 0.2, barred=frozenset({"x"})), Bidder("b", Pose2D(7.0, 1.5, 0.0), 0.2)]
    found = assign_nearest([task("x", (1.5, 1.5)), task("y", (1.5, 2.0)), task("z", (2.0, 2.0))], robots, WAYS)
    assert {name: [t.name for t in queue] for name, queue in found.queues.items()} == {"a": ["y"], "b": ["x"]}


def test_fairness_is_that_of_jain() -> None:
    assert fairness([2.0, 2.0, 2.0]) == 1.0
    assert fairness([3.0, 0.0, 0.0]) == pytest.approx(1.0 / 3.0)
    assert fairness([0.0, 0.0]) == 1.0


@pytest.mark.slow
def test_the_task_of_a_robot_that_dies_is_done_by_another_in_any_order_of_the_robots() -> None:
    died = {"kind": "dies", "robot": "a", "time": 1.0}
    results = [drive(task("t", (3.0, 1.0)), faults=(died,), turned=turned) for turned in (False, True)]
    for result in results:
        assert result.tasks is not None
        (done,) = result.tasks.tasks
        assert (done.state, done.robot) == ("done", "b")
        assert done.returns == ["a has not reported for 1 s"]
    assert results[0].as_dict()["tasks"] == results[1].as_dict()["tasks"]


@pytest.mark.slow
def test_a_task_without_a_way_fails_and_the_others_are_done() -> None:
    result = drive(
        task("off", (20.0, 1.0)), task("one", (2.0, 1.0)), task("two", (2.0, 1.8)), task("three", (6.0, 2.0))
    )
    assert result.tasks is not None
    assert [t.state for t in result.tasks.tasks] == ["failed", "done", "done", "done"]
    assert result.tasks.tasks[0].reason == "no robot has a way to it on the map"
    assert not result.succeeded
    assert sum(robot.tasks for robot in result.tasks.robots) == 3


def test_robots_that_are_empty_are_named_and_their_tasks_fail() -> None:
    empty = ("navstack/sim/battery/capacity=0.001", "navstack/sim/battery/charge=0.2")
    plan = TaskPlan((task("t", (6.0, 1.0)),))
    result = run_fleet(make_fleet({"a": scenario((1.0, 1.0, 0.0), overrides=empty)}, tasks=plan))
    assert result.tasks is not None
    assert result.robot("a").fault.startswith("ran empty at ")
    assert result.tasks.tasks[0].reason.startswith("no robot is left that could do it; a ran empty at ")
    assert result.simulated_s < 20.0


def test_a_fleet_without_a_task_ends_at_once() -> None:
    result = run_fleet(make_fleet({"a": A}, tasks=TaskPlan(())))
    assert result.succeeded
    assert result.simulated_s == 0.0


@pytest.mark.slow
def test_a_robot_with_little_charge_charges_before_its_next_task(tmp_path: Path) -> None:
    file = tmp_path / "fleet.yaml"
    file.write_text(
        "map: office\nsim: {battery: {capacity: 0.04, charge: 0.5}}\nrobots: [{name: a, start: [4.0, 7.4, 0.0]}]\n"
        "tasks:\n  list: [{goal: [6.0, 7.4, 0.0]}, {goal: [8.0, 7.4, 0.0], release: 6.0}]\n"
        "  charging: {threshold: 0.48, resume: 0.7, places: [[7.0, 7.4, 0.0]]}\n"
    )
    result = run_fleet(load_fleet(file))
    assert result.tasks is not None
    assert result.tasks.all_done
    assert result.tasks.robots[0].charges == 1
    second = result.tasks.tasks[1].started
    assert second is not None
    assert second >= 6.0 + 3600.0 * 0.04 * 0.2 / 4.0  # no charger gives more than 4 A


GOOD = """\
map: office
robots: [{name: a, start: corridor_west}]
tasks:
  list: [{stops: [office_1, office_2], handling: 2.0}]
  generate: {count: 3, interval: 4.0, pickup: [kitchen], dropoff: [lounge, manager]}
"""


def test_tasks_are_read_and_drawn_by_the_seed(tmp_path: Path) -> None:
    file = tmp_path / "fleet.yaml"
    file.write_text(GOOD.replace("list: [{", "list: [{name: first, "))
    one, same, other = (load_fleet(file, seed=seed).tasks for seed in (1, 1, 2))
    assert one is not None and other is not None
    assert one == same
    assert [t.name for t in one.tasks] == ["first", "task_1", "task_2", "task_3"]
    assert [t.release for t in one.tasks] != [t.release for t in other.tasks]
    assert TaskPlan.from_dict(one.as_dict()) == one


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("handling", "handlingg", '4:40: task 1 has no key "handlingg"; did you mean handling?'),
        ("office_2", "offic_2", '4:29: stop 2 of task 1 "offic_2" is not a known place; did you mean office_2?'),
        ("generate:", "generates:", '5:3: tasks has no key "generates"; did you mean generate?'),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path: Path, wrong: str, right: str, message: str) -> None:
    file = tmp_path / "fleet.yaml"
    file.write_text(GOOD.replace(wrong, right))
    with pytest.raises(ScenarioError) as caught:
        load_fleet(file)
    assert message in str(caught.value)
