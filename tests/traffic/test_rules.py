"""Traffic rules: what is held, who waits and why, deadlocks, losses, dead robots; properties in a world of discs."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import InputError, Pose2D
from navstack.routes import build_graph
from navstack.traffic import Communication, RobotReport, TrafficControl, TrafficParams, make_rule
from tools.fleet_runs import CASES, Case, drive, grid

ROAD = build_graph({i: (2.0 * i, 0.0) for i in range(5)}, [(i, i + 1) for i in range(4)], both_ways=True)


def report(
    name: str, x: float, goal: int | None, time: float = 0.0, *, active: bool = True, y: float = 0.0
) -> RobotReport:
    return RobotReport(name, Pose2D(x, y, 0.0), 0.3, goal, 0.0, active, time)


def test_no_rule_lets_every_robot_drive() -> None:
    grants = make_rule("none").update(1.0, [report("b", 0.0, 4), report("a", 8.0, 0)])
    assert list(grants) == ["a", "b"]
    assert all(grant.free and not grant.reason for grant in grants.values())


def test_a_reservation_goes_ahead_as_far_as_asked_for() -> None:
    rule = make_rule("reservation", ROAD, TrafficParams(ahead=3.0))
    grant = rule.update(0.0, [report("a", 0.0, 4)])["a"]
    assert grant.nodes == (0, 1, 2)
    assert grant.horizon == (3, 4)
    assert grant.up_to == 2


def test_what_is_behind_is_released_and_what_is_ahead_is_kept() -> None:
    rule = make_rule("reservation", ROAD, TrafficParams(ahead=3.0))
    rule.update(0.0, [report("a", 0.0, 4)])
    waiting = rule.update(1.0, [report("a", 0.5, 4, 1.0), report("b", -1.0, 4, 1.0)])["b"]
    assert waiting.nodes == (0,)
    assert waiting.waits_for == ("a",)
    followed = rule.update(5.0, [report("a", 3.0, 4, 5.0), report("b", 0.0, 4, 5.0)])
    assert followed["a"].nodes == (1, 2, 3)
    assert followed["b"].nodes == (0, 1)


def test_a_wait_names_the_chain() -> None:
    rule = make_rule("reservation", ROAD)
    grants = rule.update(0.0, [report("c", 8.0, None, active=False), report("b", 4.0, 4), report("a", 0.0, 4)])
    assert grants["a"].reason == "waits for node 2, held by b, which waits for node 4, held by c, which cannot drive"
    assert grants["a"].waits_for == ("b",)


def test_a_mutex_group_is_held_by_one_robot() -> None:
    graph = build_graph({0: (0.0, 0.0), 1: (2.0, 0.0), 2: (0.0, 9.0), 3: (2.0, 9.0)}, [(0, 1), (2, 3)])
    for edge in range(2):
        graph.edge_metadata[edge] = {"mutex": "lift"}
    rule = make_rule("reservation", graph)
    grants = rule.update(0.0, [report("a", 0.0, 1), report("b", 0.0, 3, y=9.0)])
    assert grants["a"].nodes == (0, 1)
    assert grants["b"].reason == 'waits for the group "lift", held by a, which drives'
    grants = rule.update(9.0, [report("a", 2.0, None, 9.0), report("b", 0.0, 3, 9.0, y=9.0)])
    assert grants["b"].nodes == (2, 3)


def test_footprints_that_do_not_fit_beside_each_other_exclude_edges() -> None:
    graph = build_graph({0: (0.0, 0.0), 1: (4.0, 0.0), 2: (0.0, 0.65), 3: (4.0, 0.65)}, [(0, 1), (2, 3)])
    # 0.65 m beside each other, footprints of 0.6 m
    narrow, wide = (
        make_rule("reservation", graph, TrafficParams(margin=margin)).update(
            0.0, [report("a", 0.0, 1), report("b", 4.0, 3, y=0.65)]
        )
        for margin in (0.1, 0.0)
    )
    assert narrow["a"].nodes == (0,)
    assert narrow["a"].reason == "waits for node 3, held by b, which drives"
    assert wide["a"].nodes == (0, 1)


def test_a_deadlock_is_found_when_it_closes_and_dissolved() -> None:
    graph = build_graph(
        {i: (2.0 * i, 0.0) for i in range(5)} | {9: (4.0, 2.0)},
        [*((i, i + 1) for i in range(4)), (2, 9)],
        both_ways=True,
    )
    result = drive(Case(graph, {"a": 0, "b": 4}, {"a": [4], "b": [0]}), "reservation")
    assert result.done
    assert not result.contacts
    deadlock = next(event for event in result.control.rule.events if event.kind == "deadlock")
    dissolved = next(event for event in result.control.rule.events if event.kind == "dissolved")
    assert set(deadlock.robots) == {"a", "b"}
    assert deadlock.time == dissolved.time < 4.0
    assert "held by" in deadlock.text


def test_a_robot_that_cannot_drive_keeps_only_its_place() -> None:
    rule = make_rule("reservation", ROAD)
    rule.update(0.0, [report("a", 0.0, 4)])
    assert rule.held()["a"] == ("edge 5", "edge 7", "node 2")  # type: ignore[attr-defined]
    rule.update(1.0, [report("a", 0.0, 4, 1.0, active=False)])
    assert rule.held()["a"] == ("node 2",)  # type: ignore[attr-defined]
    grants = rule.update(2.0, [report("a", 0.0, 4, 2.0, active=False), report("b", 8.0, 1, 2.0)])
    assert grants["b"].nodes == (4, 3, 2)


def test_a_silent_robot_keeps_what_it_can_have_reached() -> None:
    rule = make_rule("reservation", ROAD, TrafficParams(silence=4.0, ahead=8.0))
    grant = rule.update(0.0, [replace(report("a", 0.0, 4), speed=0.7)])["a"]
    assert grant.nodes == (0, 1, 2, 3, 4)
    assert grant.until == 3.0  # it stops a second before it becomes an obstacle
    held = rule.held()["a"]  # type: ignore[attr-defined]
    assert rule.update(4.0, [report("b", 8.0, 0, 4.0)])["b"].nodes == (4,)
    assert rule.held()["a"] == held  # type: ignore[attr-defined]
    grant = rule.update(4.5, [report("b", 8.0, 0, 4.5)])["b"]
    assert rule.held()["a"][-1] == "node 2"  # type: ignore[attr-defined]  # it drove 2.8 m at most
    assert grant.nodes == (4, 3)
    assert grant.reason.endswith("held by a, which does not report")
    # it is back: what it had been granted beyond node 2 is gone
    grants = rule.update(6.0, [report("a", 1.5, 4, 6.0), report("b", 7.0, 0, 6.0)])
    assert grants["a"].nodes == (0, 1, 2)
    assert grants["b"].nodes == (4, 3)


def test_a_robot_of_unknown_speed_keeps_its_whole_grant() -> None:
    rule = make_rule("reservation", ROAD)
    rule.update(0.0, [report("a", 0.0, 4)])
    held = rule.held()["a"]  # type: ignore[attr-defined]
    rule.update(60.0, [])
    assert rule.held()["a"] == held  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["reservation", "pibt"])
@pytest.mark.parametrize("until", [60.0, 1e6])
def test_the_others_go_on_beside_a_silent_robot(rule: str, until: float) -> None:
    case = Case(grid(3, 3), {"a": 0, "b": 8, "c": 2}, {"a": [5], "b": [6, 8], "c": [6, 2]})
    params = TrafficParams(reach=0.05, silence=1.5)  # it drives to the first node at most
    result = drive(case, rule, silences={"a": (1.0, until)}, until=200.0, params=params)
    assert not result.contacts
    left = {robot.name: len(robot.goals) for robot in result.robots}
    assert left == {"a": int(until > 200.0), "b": 0, "c": 0}


def test_messages_that_take_longer_than_a_grant_lasts_are_refused() -> None:
    rule = make_rule("reservation", ROAD, TrafficParams(silence=5.0))
    with pytest.raises(InputError, match="increase silence by more than 2 s"):
        TrafficControl(rule, Communication(delay_s=3.0))


def test_an_old_report_does_not_count() -> None:
    rule = make_rule("reservation", ROAD, TrafficParams(ahead=1.0))
    rule.update(5.0, [report("a", 4.0, 4, 5.0)])
    grant = rule.update(6.0, [report("a", 0.0, 4, 1.0)])["a"]
    assert grant.nodes[0] == 2


def test_a_lost_robot_is_driven_around() -> None:
    graph = build_graph(
        {0: (0.0, 0.0), 1: (2.0, 0.0), 2: (4.0, 0.0), 3: (0.0, 4.0), 4: (4.0, 4.0)},
        [(0, 1), (1, 2), (0, 3), (3, 4), (4, 2)],
        both_ways=True,
    )
    case = Case(graph, {"a": 0, "b": 1}, {"a": [2], "b": [1, 0]})
    result = drive(case, "reservation", deaths={"b": 0.0}, until=100.0)
    assert result.done
    assert not result.contacts


def test_wrong_names_and_graphs_say_what_to_do() -> None:
    with pytest.raises(InputError, match="choose one of none, lanes, reservation, pibt"):
        make_rule("reservations", ROAD)
    with pytest.raises(InputError, match="needs a route graph"):
        make_rule("pibt")
    with pytest.raises(InputError, match="write the name of a group"):
        graph = build_graph({0: (0.0, 0.0), 1: (2.0, 0.0)}, [(0, 1)])
        graph.edge_metadata[0] = {"mutex": 7}
        make_rule("lanes", graph)
    with pytest.raises(InputError, match="dropout"):
        Communication(dropout=1.5)


def trace(case: Case, rule: str, **options: object) -> list[tuple[object, ...]]:
    result = drive(case, rule, **options)  # type: ignore[arg-type]
    robots: list[tuple[object, ...]] = [(r.name, *r.xy.tolist(), r.driven_m, tuple(r.reached)) for r in result.robots]
    return [*robots, (result.time, len(result.control.rule.events))]


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["reservation", "pibt"])
def test_the_order_of_the_reports_does_not_matter(rule: str) -> None:
    link = Communication(0.5, 0.2, 3)
    first, *others = (trace(CASES["door"](3), rule, seed=3, order=order, link=link, until=60.0) for order in (0, 1, 5))
    assert all(other == first for other in others)


@pytest.mark.slow
@pytest.mark.parametrize("suite", ["corridor", "crossing", "door", "ring", "random"])
def test_reservations_end_without_contact_or_lock(suite: str) -> None:
    for seed in (0, 1):
        result = drive(CASES[suite](seed), "reservation", seed=seed, until=600.0)
        assert result.done, (seed, result.reasons)
        assert not result.contacts, seed


@pytest.mark.slow
@pytest.mark.parametrize("suite", ["corridor", "crossing", "door", "ring", "random"])
def test_pibt_ends_without_contact_or_lock(suite: str) -> None:
    for seed in (0, 1):
        result = drive(CASES[suite](seed), "pibt", seed=seed, until=600.0)
        assert result.done, (seed, result.reasons)
        assert not result.contacts, seed


@pytest.mark.parametrize("rule", ["reservation", "pibt"])
@pytest.mark.parametrize(("suite", "seed"), [("corridor", 1), ("random", 2), ("crossing", 23)])
def test_runs_that_locked_once_end(rule: str, suite: str, seed: int) -> None:
    result = drive(CASES[suite](seed), rule, seed=seed, until=600.0)
    assert result.done, result.reasons
    assert not result.contacts


def test_robots_that_want_to_the_same_node_are_there_one_after_another() -> None:
    for rule in ("reservation", "pibt"):
        case = Case(grid(3, 2), {"a": 0, "b": 2, "c": 3}, {"a": [1], "b": [1], "c": [1, 4, 1]})
        result = drive(case, rule)
        assert result.done, result.reasons
        assert not result.contacts


@pytest.mark.parametrize("rule", ["reservation", "pibt"])
def test_robots_behind_each_other_in_a_dead_end_get_out(rule: str) -> None:
    graph = build_graph(
        {i: (2.0 * i, 0.0) for i in range(6)} | {9: (4.0, 2.0)},
        [*((i, i + 1) for i in range(5)), (2, 9)],
        both_ways=True,
    )
    case = Case(graph, {"a": 5, "b": 4, "c": 3}, {"a": [0, 5], "b": [5], "c": [4]})
    result = drive(case, rule)
    assert result.done, result.reasons
    assert not result.contacts


@pytest.mark.parametrize("rule", ["reservation", "pibt"])
def test_one_way_rings_that_are_nearly_full_turn(rule: str) -> None:
    n = 10
    nodes = {i: (4.5 * math.cos(math.tau * i / n), 4.5 * math.sin(math.tau * i / n)) for i in range(n)}
    graph = build_graph(nodes, [(i, (i + 1) % n) for i in range(n)])
    case = Case(graph, {f"robot_{i}": i for i in range(9)}, {f"robot_{i}": [(i + 5) % n] for i in range(9)})
    result = drive(case, rule)
    assert result.done, result.reasons
    assert not result.contacts


@st.composite
def fleets_on_graphs(draw: st.DrawFn) -> Case:
    """A connected part of a grid, and robots with one to three goals on up to half of its nodes."""
    case = CASES["random"](draw(st.integers(1000, 9999)))
    ids = case.graph.node_ids.tolist()
    starts = draw(st.permutations(ids))[: draw(st.integers(2, len(ids) // 2))]
    goals = {f"robot_{i}": draw(st.lists(st.sampled_from(ids), min_size=1, max_size=3)) for i in range(len(starts))}
    return Case(case.graph, {f"robot_{i}": start for i, start in enumerate(starts)}, goals)


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["reservation", "pibt"])
@settings(max_examples=6, deadline=None)
@given(case=fleets_on_graphs())
def test_on_any_graph_no_two_robots_hold_a_node_and_all_get_to_their_goals(rule: str, case: Case) -> None:
    def alone(control: TrafficControl) -> None:
        ends = [held[-1] for held in control.rule.held().values()]  # type: ignore[attr-defined]
        assert len(set(ends)) == len(ends)

    result = drive(case, rule, until=3000.0, watch=alone)
    assert result.done, result.reasons
    assert not result.contacts


def test_lanes_alone_let_robots_meet() -> None:
    result = drive(CASES["corridor"](0), "lanes")
    assert result.contacts


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["reservation", "pibt"])
def test_lost_and_late_messages_make_robots_wait_not_touch(rule: str) -> None:
    result = drive(CASES["door"](1), rule, seed=1, link=Communication(1.0, 0.3, 1), until=900.0)
    assert result.done, result.reasons
    assert not result.contacts


def test_a_robot_whose_first_messages_are_lost_is_known_to_stand_where_it_is() -> None:
    # the first report of robot_7 in its way was lost, and robot_5 drove into it
    result = drive(CASES["door"](504), "reservation", seed=504, link=Communication(0.5, 0.3, 504), until=600.0)
    assert result.done, result.reasons
    assert not result.contacts


def test_messages_are_lost_by_name_and_number() -> None:
    link = Communication(dropout=0.3, seed=4)
    share = sum(link.arrives("a", "report", k) for k in range(2000)) / 2000
    assert share == pytest.approx(0.7, abs=0.04)
    control = TrafficControl(make_rule("reservation", ROAD), Communication(dropout=1.0))
    assert control.update(0.0, [report("a", 0.0, 4)]) == {}


def test_the_path_of_a_grant_begins_beside_the_robot() -> None:
    rule = make_rule("lanes", ROAD)
    path = rule.path((0, 1, 2), Pose2D(0.5, 0.1, 0.0))
    assert path[0].x == pytest.approx(0.5)
    assert path[-1].x == pytest.approx(4.0)
    assert path.length == pytest.approx(3.5)
