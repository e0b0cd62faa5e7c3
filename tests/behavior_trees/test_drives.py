"""A robot driven by a behavior tree, in the packaged office: every goal ends, with Nav2's error code."""

from __future__ import annotations

from pathlib import Path

import pytest

import navstack as nav
from navstack.behavior_trees import BehaviorTreeError, find_tree
from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Event, Pose2D
from navstack.explain import explain_goal
from navstack.move_base import BusyError, GoalHandle, GoalStatus, MoveBase, TreeMoveBase
from navstack.parameters import load_configuration
from navstack.sim import SimulatedRobot
from tests.behavior_trees.golden_cases import FOLDER

pytestmark = pytest.mark.slow
DEFAULT = "navigate_to_pose_w_replanning_and_recovery"
OFFICE_2 = Pose2D(6.2, 12.0, 1.57)
IN_A_WALL = Pose2D(2.05, 1.4, 0.0)
SHIPPED = sorted((FOLDER / "behavior_trees").glob("nav*to_pose*.xml")) + sorted(
    (FOLDER / "behavior_trees").glob("navigate_w_*replanning*.xml")
)


class Heard:
    """Keeps the events."""

    hears_feedback = False

    def __init__(self) -> None:
        self.events: list[Event] = []

    def on_event(self, event: Event) -> None:
        self.events.append(event)


def build(tree: str | Path | None, *listeners: Heard) -> tuple[TreeMoveBase, SimulatedRobot]:
    configuration, grid = load_configuration(["turtlebot"]), nav.load_map("office")
    robot = simulated_robot(configuration, grid, Pose2D(0.8, 7.45, 0.0))
    move_base = build_move_base(
        configuration, robot, static_map=grid, behavior_tree=tree, trees_by_goal=True, listeners=listeners
    )
    assert isinstance(move_base, TreeMoveBase)
    return move_base, robot


def run(move_base: MoveBase, robot: SimulatedRobot, handle: GoalHandle, until: float = 300.0) -> None:
    ticks = 0
    while not handle.is_done and robot.time < until and ticks < 50_000:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
        ticks += 1


@pytest.mark.parametrize("tree", [DEFAULT, f"{DEFAULT}_format_3", *SHIPPED], ids=lambda t: Path(t).stem)
def test_the_robot_reaches_its_goal(tree: str | Path) -> None:
    move_base, robot = build(tree)
    handle = move_base.send_goal(OFFICE_2)
    run(move_base, robot, handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert robot.time < 40.0
    assert robot.pose.distance_to(OFFICE_2) < 0.3
    assert not robot.in_collision


@pytest.mark.parametrize(("tree", "goal", "code", "recoveries"), [
    (DEFAULT, IN_A_WALL, 206, 0),  # no recovery helps
    (DEFAULT, Pose2D(-50.0, 0.0, 0.0), 204, 0),
    (f"{DEFAULT}_format_3", IN_A_WALL, 206, 15),
])  # fmt: skip
def test_a_goal_that_cannot_be_reached_ends_with_the_code_of_nav2(
    tree: str, goal: Pose2D, code: int, recoveries: int
) -> None:
    move_base, robot = build(tree)
    handle = move_base.send_goal(goal)
    run(move_base, robot, handle)
    assert handle.status is GoalStatus.ABORTED
    assert handle.result is not None
    assert (handle.result.error_code, handle.result.recoveries) == (code, recoveries)
    assert "ComputePathToPose" in handle.result.message
    assert any("failed with code" in line for line in handle.result.data["tree"])


def test_a_cancel_takes_effect_within_a_cycle() -> None:
    move_base, robot = build(DEFAULT)
    handle = move_base.send_goal(OFFICE_2)
    run(move_base, robot, handle, until=5.0)
    assert move_base.command.vx > 0.1
    move_base.cancel_goal(handle)
    asked = robot.time
    run(move_base, robot, handle)
    assert handle.status is GoalStatus.PREEMPTED
    assert robot.time - asked <= 1.0 / move_base.params.controller_frequency + 1e-6
    assert move_base.command.vx == 0.0


def test_a_cancel_ends_a_recovery() -> None:
    move_base, robot = build(f"{DEFAULT}_format_3")
    handle = move_base.send_goal(IN_A_WALL)
    run(move_base, robot, handle, until=0.5)
    assert move_base.recovery == "spin"
    move_base.cancel_goal(handle)
    run(move_base, robot, handle, until=1.0)
    assert handle.status is GoalStatus.PREEMPTED
    assert move_base.recovery is None


def test_a_new_goal_replaces_the_goal_of_the_tree() -> None:
    move_base, robot = build(DEFAULT)
    first = move_base.send_goal(OFFICE_2)
    run(move_base, robot, first, until=4.0)
    second = move_base.send_goal(Pose2D(11.4, 7.4, 0.0))
    run(move_base, robot, second)
    assert (first.status, second.status) == (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED)


def test_a_second_goal_begins_anew() -> None:
    move_base, robot = build(DEFAULT)
    for goal in (OFFICE_2, Pose2D(6.2, 10.5, -1.57)):
        handle = move_base.send_goal(goal)
        run(move_base, robot, handle)
        assert handle.status is GoalStatus.SUCCEEDED


def test_the_tree_changes_between_goals_and_without_one_the_states_drive() -> None:
    move_base, robot = build(None)
    plain = build_move_base(load_configuration(["turtlebot"]), robot, static_map=nav.load_map("office"))
    assert not isinstance(plain, TreeMoveBase)
    seen: list[tuple[bool, bool]] = []
    for source, goal in ((None, OFFICE_2), (DEFAULT, Pose2D(6.2, 10.5, -1.57)), (None, OFFICE_2)):
        if source is None:
            move_base.use_states()
        else:
            move_base.use_tree(find_tree(source))
        handle = move_base.send_goal(goal)
        run(move_base, robot, handle, until=robot.time + 1.0)
        with pytest.raises(BusyError, match="a goal is driven"):
            move_base.use_tree(find_tree(DEFAULT))
        run(move_base, robot, handle)
        seen.append((handle.status is GoalStatus.SUCCEEDED, move_base.tree_source is not None))
        assert robot.pose.distance_to(goal) < 0.3
    assert seen == [(True, False), (True, True), (True, False)]
    with pytest.raises(BehaviorTreeError, match="not valid XML"):
        move_base.use_tree("<root><BehaviorTree></root>")
    assert move_base.tree_source is None


def test_without_a_tree_it_drives_as_move_base_does() -> None:
    poses = []
    for trees_by_goal in (False, True):
        configuration, grid = load_configuration(["turtlebot"]), nav.load_map("office")
        robot = simulated_robot(configuration, grid, Pose2D(0.8, 7.45, 0.0))
        move_base = build_move_base(configuration, robot, static_map=grid, trees_by_goal=trees_by_goal)
        handle = move_base.send_goal(IN_A_WALL)
        run(move_base, robot, handle)
        poses.append((robot.time, *robot.pose, handle.result.recoveries, handle.result.error_code))
    assert poses[0] == poses[1]


def test_two_runs_are_equal() -> None:
    found = []
    for _ in range(2):
        move_base, robot = build(DEFAULT)
        run(move_base, robot, move_base.send_goal(OFFICE_2))
        found.append((robot.time, robot.pose, move_base.tree.explain()))
    assert found[0] == found[1]


def test_a_configuration_names_its_tree() -> None:
    robot = nav.load_robot("turtlebot", navstack={"behavior_tree": DEFAULT})
    result = nav.simulate("office", robot=robot, goals=["office_2"], seed=0)
    assert "1/1 goals" in str(result)
    assert "ComputePathToPose: succeeded" in str(result.explain(goal=1))


def test_an_unknown_tree_is_an_error_with_a_suggestion() -> None:
    with pytest.raises(BehaviorTreeError, match='did you mean "navigate_to_pose_w_replanning_and_recovery"'):
        build("navigate_to_pose_w_replaning_and_recovery")


@pytest.mark.slow
def test_a_goal_has_one_number_of_recoveries(tmp_path: Path) -> None:
    """In its result, the metrics of the run and the explanation of the record."""
    more = tmp_path / "more.yaml"
    more.write_text(f"navstack: {{behavior_tree: {DEFAULT}_format_3}}\n", encoding="utf-8")
    configuration = load_configuration(["turtlebot", str(more)])
    result = nav.simulate("office", robot=configuration, goals=[IN_A_WALL])
    (goal,) = result.goals
    report = explain_goal(result.record, 1)
    spins, clears = (sum(word in run.name for run in report.recoveries) for word in ("spin", "clear"))
    assert spins and clears
    assert goal.recoveries == len(report.recoveries) == result.metrics.recoveries
    assert [run.number for run in report.recoveries] == list(range(1, goal.recoveries + 1))
    assert f"{goal.recoveries} recoveries (" in str(result.explain(goal=1))


@pytest.mark.parametrize(("node", "counts"), [
    ('<Spin spin_dist="0.3"/>', 1),
    ('<Spin spin_dist="0.3" is_recovery="false"/>', 0),
    ('<DriveOnHeading dist_to_travel="0.1" speed="0.1"/>', 0),
    ('<ClearEntireCostmap service_name="local_costmap/clear"/>', 1),
])  # fmt: skip
def test_a_recovery_is_what_nav2_counts(node: str, counts: int) -> None:
    listener = Heard()
    move_base, robot = build(f'<root BTCPP_format="4"><BehaviorTree ID="T">{node}</BehaviorTree></root>', listener)
    handle = move_base.send_goal(OFFICE_2)
    run(move_base, robot, handle)
    assert handle.status is GoalStatus.SUCCEEDED and handle.result is not None
    assert handle.result.recoveries == move_base.tree.blackboard["number_recoveries"] == counts
    assert len({event.data["index"] for event in listener.events if event.kind == "recovery"}) == counts


def test_nodes_without_a_server_are_named_before_the_first_goal() -> None:
    node = "<FollowObject/>"
    listener = Heard()
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence><Wait/>{node}</Sequence></BehaviorTree></root>'
    move_base, robot = build(text, listener)
    (warning,) = [event for event in listener.events if event.kind == "warning"]
    assert "uses FollowObject, which navstack offers to no tree, so that this node fails" in warning.text
    assert warning.data["code"] == 9063
    handle = move_base.send_goal(OFFICE_2)
    run(move_base, robot, handle)
    assert handle.result is not None
    assert 'the server "follow_object" rejected the goal' in handle.result.message
    listener.events.clear()
    move_base.use_tree(find_tree(DEFAULT))
    assert not listener.events
