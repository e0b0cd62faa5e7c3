"""SmoothPath, ComputeRoute and ComputeAndTrackRoute as nodes of trees that drive a simulated robot in the office."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.behavior_trees import ActionState
from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Event, Pose2D, Twist2D
from navstack.core import Path as PosePath
from navstack.move_base import GoalHandle, GoalStatus, TreeMoveBase
from navstack.parameters import Configuration, load_configuration
from navstack.routes import build_graph, save_graph
from tests.behavior_trees.golden_cases import FOLDER

pytestmark = pytest.mark.slow
START, GOAL = Pose2D(0.8, 7.45, 0.0), Pose2D(6.2, 12.0, 1.57)
NODES = {1: (1.5, 7.5), 2: (7.57, 7.5), 3: (7.57, 10.5), 4: (11.4, 7.5), 5: (3.8, 7.5)}
EDGES = [(1, 5), (5, 2), (2, 3), (2, 4)]
ROUTE = (
    '<ComputeRoute goal="{goal}" use_poses="true" path="{path}" route="{route}" error_code_id="{route_error_code}"/>'
)
SILK = (
    '<ComputePathToPose goal="{goal}" path="{path}"/><SmoothPath unsmoothed_path="{path}" smoothed_path="{s}" '
    'smoother_id="silk" error_code_id="{route_error_code}"/>'
)
PAUSE = '<Wait wait_duration="5"/>'
"""Keeps the tree running: a path is emptied when its node is halted."""
SMOOTHERS = {
    "smoother_plugins": [{"name": "route_smoother", "type": "nav2_smoother::SimpleSmoother"}],
    "route_smoother": {"refinement_num": 5, "enforce_path_inversion": False},
}


@pytest.fixture
def graph_file(tmp_path: Path) -> Path:
    file = tmp_path / "office.geojson"
    save_graph(build_graph(NODES, EDGES, both_ways=True), file)
    return file


def tree_of(nodes: str) -> str:
    return f'<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>{nodes}</Sequence></BehaviorTree></root>'


class Bench:
    """A turtlebot in the office whose goals are driven by a tree."""

    def __init__(self, tree: str | Path, **sections: Mapping[str, Any]) -> None:
        self.configuration: Configuration = load_configuration(["turtlebot", sections])
        grid = nav.load_map("office")
        self.robot = simulated_robot(self.configuration, grid, START)
        move_base = build_move_base(self.configuration, self.robot, static_map=grid, behavior_tree=tree)
        assert isinstance(move_base, TreeMoveBase)
        self.move_base = move_base
        self.board: Any = move_base.tree.blackboard

    def drive(self, goal: Pose2D = GOAL, until: float = 60.0) -> GoalHandle:
        handle = self.move_base.send_goal(goal)
        self.go_on(handle, until)
        return handle

    def go_on(self, handle: GoalHandle, until: float) -> None:
        while not handle.is_done and self.robot.time < until:
            self.robot.advance_to(self.move_base.next_due(self.robot.time))
            self.move_base.tick(self.robot.time)

    def code(self, name: str) -> object:
        return self.board[f"{name}_error_code"]


@pytest.mark.parametrize(
    "tree", ["navigate_on_route_graph_w_recovery", "navigate_w_routing_global_planning_and_control_w_recovery"]
)
def test_the_shipped_trees_of_routes_reach_their_goal(tree: str, graph_file: Path) -> None:
    file = FOLDER / "behavior_trees" / f"{tree}.xml"
    if not file.is_file():
        pytest.skip(f"{file} is not there")
    bench = Bench(file, route_server={"graph_filepath": str(graph_file)}, smoother_server=SMOOTHERS)
    handle = bench.drive()
    assert handle.status is GoalStatus.SUCCEEDED and handle.result is not None
    assert bench.robot.pose.distance_to(GOAL) < 0.3 and not bench.robot.in_collision
    assert handle.result.recoveries == 0


def test_a_route_is_a_path_along_its_nodes_and_goals_of_its_nodes(graph_file: Path) -> None:
    nodes = ROUTE + '<ExtractRouteNodesAsGoals route="{route}" goals="{goals}"/>'
    bench = Bench(tree_of(nodes + PAUSE), route_server={"graph_filepath": str(graph_file)})
    bench.drive(until=1.0)
    found = [(pose.x, pose.y) for pose in bench.board["goals"]]
    np.testing.assert_allclose(found, [NODES[k] for k in (1, 5, 2, 3)], atol=1e-6)
    path = bench.board["path"]
    np.testing.assert_allclose(path.poses[[0, -1], :2], [NODES[1], NODES[3]], atol=1e-6)


def test_a_tracked_route_gives_its_progress_and_ends_at_its_last_node(graph_file: Path) -> None:
    track = (
        '<ComputeAndTrackRoute goal="{goal}" use_poses="true" path="{path}" route="{route}" last_node_id="{last}" '
        'next_node_id="{next}" current_edge_id="{edge}" rerouted="{rerouted}"/>'
    )
    # the tracker's path is followed while it runs
    follow = '<Sequence><Wait wait_duration="0.5"/><FollowPath path="{path}"/></Sequence>'
    both = f'<Parallel success_count="1">{track}{follow}</Parallel>'
    bench = Bench(
        tree_of(both), route_server={"graph_filepath": str(graph_file), "boundary_radius_to_achieve_node": 0.5}
    )
    handle = bench.drive(until=2.0)
    seen = [(bench.board["last"], bench.board["next"])]
    while not handle.is_done and bench.robot.time < 60.0:
        bench.go_on(handle, bench.robot.time + 0.2)
        now = bench.board["last"], bench.board["next"]
        if now != seen[-1]:
            seen.append(now)
    assert handle.status is GoalStatus.SUCCEEDED
    assert seen[-3:] == [(5, 2), (2, 3), (3, 0)]
    assert bench.robot.pose.distance_to(Pose2D(*NODES[3], 0.0)) < 0.6
    assert bench.board["rerouted"] is False


def test_a_smoother_is_found_by_its_id_and_has_its_parameters() -> None:
    plan = '<ComputePathToPose goal="{goal}" path="{path}"/>'
    smooth = (
        '<SmoothPath unsmoothed_path="{path}" smoothed_path="{smooth}" smoother_id="route_smoother" '
        'check_for_collisions="true" was_completed="{completed}"/>'
    )
    bench = Bench(tree_of(plan + smooth + PAUSE), smoother_server=SMOOTHERS)
    bench.drive(until=1.0)
    (configured,) = bench.configuration.smoothers
    assert configured.params.model_dump()["refinement_num"] == 5
    before, after = bench.board["path"], bench.board["smooth"]
    assert isinstance(after, PosePath) and bench.board["completed"] is True
    np.testing.assert_array_equal(before.poses[[0, -1], :2], after.poses[[0, -1], :2])

    def bends(path: PosePath) -> float:
        steps = np.diff(path.poses[:, :2], axis=0)
        course = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        return float(np.square(np.diff(course)).sum())

    assert bends(after) < 0.7 * bends(before)


@pytest.mark.parametrize(
    ("nodes", "sections", "code", "text"),
    [
        (ROUTE, {}, 402, "write graph_filepath: FILE.geojson in route_server"),
        ('<ComputeRoute start_id="1" goal_id="99" error_code_id="{route_error_code}"/>', {"graph"}, 402, "99"),
        (
            '<ComputeRoute goal_id="3" error_code_id="{route_error_code}"/>',
            {"graph"},
            405,
            "write start_id and goal_id",
        ),
        (
            '<SmoothPath unsmoothed_path="{goal_path}" smoothed_path="{s}" error_code_id="{route_error_code}"/>',
            {},
            505,
            "an empty path",
        ),
        (SILK, {}, 501, 'the smoother "silk"'),
    ],
)
def test_a_failure_has_the_code_of_nav2_and_says_what_to_do(
    nodes: str, sections: set[str], code: int, text: str, graph_file: Path
) -> None:
    routes = {"route_server": {"graph_filepath": str(graph_file)}} if sections else {}
    bench = Bench(tree_of(nodes), **routes)
    bench.board["goal_path"] = PosePath(np.empty((0, 3)))
    handle = bench.drive()
    assert handle.status is GoalStatus.ABORTED and handle.result is not None
    assert bench.code("route") == code == handle.result.error_code
    assert text in handle.result.message


@pytest.mark.parametrize(
    ("routes", "text"),
    [
        ({}, "there is no graph; write graph_filepath"),
        ({"graph_filepath": "nowhere.geojson"}, "nowhere.geojson"),
        ({"graph_filepath": "GRAPH", "path_densty": 0.1}, "did you mean path_density?"),
        ({"graph_filepath": "GRAPH", "operations": ["Sing"]}, "Sing.plugin is missing"),
    ],
)
def test_what_a_route_needs_is_read_before_the_first_goal(routes: dict[str, Any], text: str, graph_file: Path) -> None:
    given = {key: str(graph_file) if value == "GRAPH" else value for key, value in routes.items()}
    bench = Bench(tree_of(ROUTE), route_server=given)
    heard: list[str] = []

    class Listener:
        hears_feedback = False

        def on_event(self, event: Event) -> None:
            heard.append(event.text)

    bench.move_base.listeners.append(Listener())
    bench.move_base.use_tree(tree_of(ROUTE))
    assert [text in message for message in heard] == [True]


def test_an_edge_that_is_blocked_leads_to_another_route(graph_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tree_of("<AlwaysSuccess/>"), route_server={"graph_filepath": str(graph_file)})
    server: Any = bench.move_base.task_servers["compute_and_track_route"]
    bench.drive(until=0.2)
    server.start({"start_id": 1, "goal_id": 3}, bench.robot.time)
    assert server.update(bench.robot.time) is None
    (first, *_) = server.feedback()["route"].planned.route.edge_ids
    tracked = server._tracked
    from navstack.routes.tracking import ReroutingService

    (service,) = [o for o in tracked._operations.all if isinstance(o, ReroutingService)]
    service.request()
    assert server.update(bench.robot.time + 0.1) is None
    assert server.feedback()["rerouted"] is True and tracked.rerouted == 1
    assert first in server.feedback()["route"].planned.whole.edge_ids
    server.stop()
    assert server.feedback() == {}


def test_a_halt_cancels_the_goal_and_restores_the_speed(graph_file: Path) -> None:
    track = '<ComputeAndTrackRoute start_id="1" goal_id="3" path="{path}" route="{route}"/>'
    bench = Bench(tree_of(track), route_server={"graph_filepath": str(graph_file)})
    handle = bench.drive(until=1.0)
    assert bench.move_base.command == Twist2D()
    servers: Any = bench.move_base._servers
    (ticket,) = servers._at_work.values()
    bench.move_base.cancel_goal(handle)
    bench.go_on(handle, 2.0)
    assert handle.status is GoalStatus.PREEMPTED
    assert ticket.state is ActionState.CANCELED and servers._at_work == {}
