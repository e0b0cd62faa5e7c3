"""Driving routes: tracking, operations, closed and blocked edges, codes, the record."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.behaviors import InvalidMotionError, read_step, step_data, step_text
from navstack.bringup import BasicNavigator, TaskResult
from navstack.core import InputError, OccupancyGrid, Pose2D
from navstack.explain import explain_goal
from navstack.parameters import load_configuration
from navstack.routes import (
    FollowRoute,
    Operation,
    RouteGraph,
    RouteParams,
    RoutePlanner,
    TriggerEvent,
    build_graph,
    graph_text,
)
from navstack.routes.errors import OperationFailedError
from navstack.routes.tracking import (
    AdjustSpeedLimit,
    CollisionMonitor,
    MonitorParams,
    OperationEvent,
    ReroutingService,
    RouteOperation,
    RouteTracker,
    TimeMarker,
)
from navstack.scenario import Run, Scenario
from navstack.scenario.interactions import Edges
from navstack.sim import Shape


def two_ways() -> RouteGraph:
    """0 - 1 - 2 - 3 along y = 2, and 0 - 4 - 5 - 3 along y = -2, which is longer; edges 6 .. 17, there and back in turn."""
    nodes = {0: (0.0, 0.0), 1: (1.0, 2.0), 2: (6.0, 2.0), 3: (8.0, 0.0), 4: (1.0, -2.2), 5: (6.0, -2.2)}
    return build_graph(nodes, [(0, 1), (1, 2), (2, 3), (0, 4), (4, 5), (5, 3)], both_ways=True)


def hall() -> OccupancyGrid:
    """14 x 9 m with a block in the middle."""
    cells = np.zeros((180, 280), np.bool_)
    cells[[0, -1], :] = cells[:, [0, -1]] = True
    cells[70:110, 90:150] = True
    return OccupancyGrid.from_array(cells, 0.05, origin=(-3.0, -4.5), values="occupied")


CONFIGURATION = load_configuration(["turtlebot"])


def step(to: Any = 3, graph: RouteGraph | None = None, **values: Any) -> Any:
    return read_step({"route": "hall.geojson", "to": to, "graph": graph_text(graph or two_ways()), **values})


def scenario(*steps: Any, **values: Any) -> Scenario:
    base = Scenario(
        map=hall(), configuration=CONFIGURATION, start=Pose2D(-1.0, 0.0, 0.0), goals=(), steps=steps, time_limit_s=120.0
    )
    return dataclasses.replace(base, **values)


def drive(what: Scenario) -> Run:
    run = Run(what)
    while run.step():
        pass
    return run


@pytest.mark.slow
def test_a_route_to_a_pose_with_a_record_that_explains_it(tmp_path: Path) -> None:
    run = drive(scenario(step([7.0, -0.5, 1.0])))
    (outcome,) = run.outcomes
    assert outcome.succeeded
    assert outcome.error_code == 0
    assert outcome.figures["edges_driven"][:2] == [6, 8]
    assert outcome.figures["reroutes"] == []
    assert run.robot.pose.distance_to(Pose2D(7.0, -0.5)) < 0.3
    assert not run.robot.collisions
    # it keeps to the edges
    track = run.track()[:, 1:3]
    between = track[(track[:, 0] > 2.0) & (track[:, 0] < 5.0)]
    assert np.abs(between[:, 1] - 2.0).max() < 0.25
    assert run.recorder is not None
    record = run.recorder.record()
    report = explain_goal(record, 1)
    assert any(line.text.startswith("route of 2 edges") for line in report.timeline)
    again = drive(Scenario.from_record(record))
    assert np.array_equal(again.track(), run.track())


@pytest.mark.slow
def test_a_blocked_way_leads_to_the_other_one() -> None:
    crate = Shape(box=[0.6, 3.4], pose=[3.5, 2.6, 0.0])
    run = drive(scenario(step(), shapes=(crate,)))
    (outcome,) = run.outcomes
    assert outcome.succeeded
    (reroute,) = outcome.figures["reroutes"]
    assert reroute["reason"] == "an obstacle is on edge 8 (from node 1 to 2)"
    assert reroute["blocked"] == [8, 9]
    assert run.track()[:, 2].min() < -1.9
    assert not run.robot.collisions


@pytest.mark.slow
def test_both_ways_blocked_is_an_error_with_code_and_edges() -> None:
    crates = (Shape(box=[0.6, 3.4], pose=[3.5, 2.6, 0.0]), Shape(box=[0.6, 3.4], pose=[3.5, -2.7, 0.0]))
    run = drive(scenario(step(), shapes=crates))
    (outcome,) = run.outcomes
    assert (outcome.state, outcome.error_code, outcome.error_name) == ("ABORTED", 405, "NO_VALID_ROUTE")
    assert "an obstacle is on edge 14 (from node 4 to 5), and there is no other route" in outcome.message
    assert "4 blocked: 8, 9, 14, 15" in outcome.message
    assert not run.robot.collisions


@pytest.mark.slow
@pytest.mark.parametrize("operations", [["CollisionMonitor"], []])
def test_without_the_monitor_the_local_planner_finds_the_way_blocked(operations: list[str]) -> None:
    crate = Shape(box=[0.6, 3.4], pose=[3.5, 2.6, 0.0])
    parameters = {"operations": operations, "CollisionMonitor": {"reroute_on_collision": False}}
    run = drive(scenario(step(parameters=parameters if operations else {"operations": []}), shapes=(crate,)))
    (outcome,) = run.outcomes
    if operations:
        assert (outcome.error_code, outcome.error_name) == (406, "OPERATION_FAILED")
        assert "reroute_on_collision is false" in outcome.message
    else:
        assert outcome.succeeded
        assert outcome.figures["reroutes"][0]["reason"].startswith(("the local planner", "the robot moved less"))


@pytest.mark.slow
def test_edges_are_closed_and_opened_while_driving() -> None:
    closing = Edges(time=3.0, close=[8])
    run = drive(scenario(step(), interactions=(closing,)))
    (outcome,) = run.outcomes
    assert outcome.succeeded
    assert [r["reason"] for r in outcome.figures["reroutes"]] == ["edge 8 was closed"]
    opened = drive(scenario(step(closed=[8]), interactions=(Edges(time=0.5, open=[8]),)))
    assert [r["reason"] for r in opened.outcomes[0].figures["reroutes"]] == ["edges were opened or have other costs"]
    assert 8 in opened.outcomes[0].figures["edges_driven"]
    shut = drive(scenario(step(closed=[8, 14])))
    assert (shut.outcomes[0].error_code, shut.robot.distance_travelled) == (405, 0.0)
    with pytest.raises(InputError, match="no route is being driven"):
        drive(scenario(read_step({"wait": 2.0}), interactions=(Edges(time=0.5, close=[8]),)))


@pytest.mark.slow
def test_the_global_planner_between_nodes() -> None:
    """An edge through the block: the local planner could not follow it, the global planner goes around."""
    nodes = {0: (0.0, 0.0), 1: (6.5, 0.0)}
    run = drive(scenario(step(1, build_graph(nodes, [(0, 1)]), follow="planner", parameters={"operations": []})))
    assert run.outcomes[0].succeeded
    assert np.abs(run.track()[:, 2]).max() > 1.0
    assert not run.robot.collisions


def test_steps_of_files(tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(graph_text(two_ways()))
    read = read_step(
        {"route": "a.geojson", "to": "desk", "follow": "planner"},
        places={"desk": Pose2D(1.0, 2.0, 0.5)},
        folder=tmp_path,
    )
    assert step_text(read) == "route a to 1, 2, 0.5"
    assert read_step(step_data(read)) == read
    for values, message in (
        ({"route": "a.geojson", "to": "sofa"}, 'to "sofa" of the route is not a place; known places: desk'),
        ({"route": "b.geojson", "to": 1}, "b.geojson cannot be read"),
        ({"route": "a.geojson"}, "to of the step route"),
        ({"route": "a.geojson", "to": 1, "follow_": "path"}, "known keys: route, to, follow"),
    ):
        with pytest.raises(InvalidMotionError) as error:
            read_step(values, places={"desk": Pose2D(0.0, 0.0, 0.0)}, folder=tmp_path)
        assert message in error.value.message


# --- tracking and operations without a robot -------------------------------------------------------------------------


def test_nodes_are_passed_beyond_the_line_that_halves_the_angle() -> None:
    graph = build_graph({0: (0.0, 0.0), 1: (4.0, 0.0), 2: (4.0, 4.0)}, [(0, 1), (1, 2)])
    tracker = RouteTracker(RoutePlanner(graph).find(0, 2), RouteParams(radius_to_achieve_node=1.5))
    assert not tracker.update(Pose2D(-2.0, 0.0))
    assert tracker.update(Pose2D(0.0, 0.9))  # the first node: within the boundary radius
    assert tracker.edge == 0
    assert not tracker.update(Pose2D(3.0, 0.0))
    assert tracker.update(Pose2D(3.6, 0.5))  # cut the corner: beyond the line
    assert (tracker.last_node, tracker.next_node, tracker.exited) == (1, 2, 0)
    assert not tracker.update(Pose2D(4.0, 2.0))
    assert tracker.update(Pose2D(4.0, 3.2))
    assert tracker.completed
    assert not tracker.update(Pose2D(4.0, 4.0))


def navigator_on(graph: RouteGraph, operations: list[RouteOperation] | None = None, **shapes: Any) -> BasicNavigator:
    navigator = BasicNavigator.simulated(CONFIGURATION, hall(), Pose2D(-1.0, 0.0, 0.0), **shapes)
    navigator.setRouteGraph(graph, operations=operations)
    return navigator


def finish(navigator: BasicNavigator) -> TaskResult:
    while not navigator.isTaskComplete():
        pass
    return navigator.getResult()


@pytest.mark.slow
def test_navs2_names() -> None:
    navigator = BasicNavigator.simulated(CONFIGURATION, hall(), Pose2D(-1.0, 0.0, 0.0))
    with pytest.raises(InputError, match="call setRouteGraph"):
        navigator.getRoute(0, 3)
    navigator.setRouteGraph(two_ways(), {"smooth_corners": True, "smoothing_radius": 0.5})
    navigator.waitUntilNav2Active()
    found = navigator.getRoute(Pose2D(0.0, 0.0), Pose2D(8.0, 0.0))
    assert found is not None
    assert found[1].route.node_ids == (0, 1, 2, 3)
    navigator.adjustEdges(closed=[8, 14])
    assert navigator.getRoute(0, 3) is None
    assert navigator.getTaskError()[0] == 405
    navigator.adjustEdges(opened=[8, 14])
    navigator.getAndTrackRoute(0, 3)
    seen: list[tuple[int | None, int | None]] = []
    while not navigator.isTaskComplete():
        feedback = navigator.getRouteFeedback()
        if feedback is not None and (not seen or seen[-1] != (feedback.last_node_id, feedback.next_node_id)):
            seen.append((feedback.last_node_id, feedback.next_node_id))
    assert navigator.getResult() is TaskResult.SUCCEEDED
    assert seen[-3:] == [(1, 2), (2, 3), (3, None)]
    assert navigator.getRouteFeedback() is None


@pytest.mark.slow
def test_operations_of_the_graph() -> None:
    graph = two_ways()
    graph.node_operations[1] = (Operation("ring", "Event", "NODE", {"service_name": "bell"}),)
    graph.edge_operations[graph.edge(8)] = (Operation("in", "Event", "ON_ENTER"), Operation("out", "Event", "ON_EXIT"))
    graph.edge_metadata[graph.edge(8)] = {"speed_limit": 40.0}
    calls: list[str] = []
    speeds: list[float] = []

    def called(name: str) -> Any:
        def call(event: OperationEvent) -> None:
            assert event.graph is graph
            calls.append(name)

        return call

    event = TriggerEvent(name="Event", functions={"bell": called("bell"), "": called("door")})
    navigator = navigator_on(graph, [AdjustSpeedLimit(), TimeMarker(), event])
    navigator.getAndTrackRoute(0, 3)
    while not navigator.isTaskComplete():
        feedback = navigator.getRouteFeedback()
        if feedback is not None and feedback.current_edge_id == 8:
            speeds.append(navigator.move_base.local_planner.limits.max_vel_trans)
    assert navigator.getResult() is TaskResult.SUCCEEDED
    assert calls == ["bell", "door", "door"]
    assert np.median(speeds) == pytest.approx(0.4 * CONFIGURATION.local_planner.params.max_vel_x, abs=0.02)
    limits = navigator.move_base.local_planner.limits
    assert limits.max_vel_trans > 0.4  # restored
    taken = graph.edge_metadata[graph.edge(8)]["abs_time_taken"]
    assert 20.0 < taken < 40.0  # 5 m at 0.2 m/s
    assert navigator.router.costmap is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("operations", "message"),
    [
        ([], 'the graph has an operation of type "Event", but there is none (there: none)'),
        ([TriggerEvent(name="Event")], 'Event: no function "" was given (known: none)'),
        ([TriggerEvent(name="Event", functions={"": lambda event: False})], 'Event: "" returned False'),
        ([TriggerEvent(name="Event", functions={"": lambda event: 1 / 0})], 'Event: "" failed: ZeroDivisionError'),
    ],
)
def test_an_operation_that_fails_ends_the_route(operations: list[RouteOperation], message: str) -> None:
    graph = two_ways()
    graph.node_operations[0] = (Operation("ring", "Event", "NODE"),)
    navigator = navigator_on(graph, operations)
    navigator.getAndTrackRoute(0, 3)
    assert finish(navigator) is TaskResult.FAILED
    code, text = navigator.getTaskError()
    assert code == OperationFailedError.code == 406
    assert message in text


@pytest.mark.slow
def test_cancel_restores_the_speed() -> None:
    graph = two_ways()
    for edge in range(graph.edge_count):
        graph.edge_metadata[edge] = {"speed_limit": 0.5}
    navigator = navigator_on(
        graph, [AdjustSpeedLimit(), ReroutingService(), CollisionMonitor(MonitorParams(max_collision_dist=0.0))]
    )
    full = navigator.move_base.local_planner.limits.max_vel_trans
    navigator.getAndTrackRoute(0, 3)
    for _ in range(60):
        navigator.isTaskComplete()
    assert navigator.move_base.local_planner.limits.max_vel_trans == pytest.approx(0.5 * full)
    navigator.cancelTask()
    assert navigator.getResult() is TaskResult.CANCELED
    assert navigator.move_base.local_planner.limits.max_vel_trans == pytest.approx(full)


@pytest.mark.slow
def test_a_graph_in_another_frame_is_refused() -> None:
    graph = build_graph({0: (0.0, 0.0), 1: (1.0, 0.0)}, [(0, 1)], frame="site")
    navigator = navigator_on(graph)
    navigator.getAndTrackRoute(0, 1)
    assert finish(navigator) is TaskResult.FAILED
    assert navigator.getTaskError()[0] == 401
    assert FollowRoute(RoutePlanner(graph), 1).feedback() is None
