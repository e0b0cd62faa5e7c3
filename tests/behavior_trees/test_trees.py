"""What trees do beyond the golden cases: scripts, conditions, subtrees, formats, timers, own nodes, servers, the trace."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from navstack import core
from navstack.behavior_trees import (
    NODES,
    Action,
    ActionState,
    ActionTicket,
    BehaviorTree,
    BehaviorTreeRunError,
    NoServers,
    StampedPose,
    Status,
    find_tree,
    inputs,
    outputs,
    packaged_trees,
)
from navstack.behavior_trees.blackboard import Blackboard
from navstack.behavior_trees.errors import ScriptError
from navstack.behavior_trees.scripts import Script


def tree(inner: str, more: str = "", head: str = 'BTCPP_format="4"', **options: object) -> BehaviorTree:
    text = f'<root {head} main_tree_to_execute="A"><BehaviorTree ID="A">{inner}</BehaviorTree>{more}</root>'
    return BehaviorTree(text, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("script", "value"),
    [
        ("1 + 2 * 3", 7.0),
        ("-(1 + 2) * 2", -6.0),
        ("7 / 2", 3.5),
        ("1 / 0", math.inf),
        ("1 < 2 < 3", 1.0),
        ("3 > 2 > 2", 0.0),
        ("!true || false", 0.0),
        ("1 && 0 || 1", 1.0),
        ("5 & 3 | 8", 9.0),
        ("6 ^ 3", 5.0),
        ("~0", -1.0),
        ("0x1F", 31.0),
        ("'a' + 'b'", "ab"),
        ("'n' .. 3", "n3"),
        ("n == 2 ? 'two' : 'other'", "two"),
        ("BLUE", 7.0),
        ("n == '2'", 1.0),
        ("a := 1; a += 2; a * 2", 6.0),
        ("0.1 + 0.2 == 0.3", 1.0),
    ],
)
def test_a_script_has_the_value_of_cpp(script: str, value: object) -> None:
    board = Blackboard()
    board["n"] = 2
    assert Script(script, {"BLUE": 7})(board) == value


@pytest.mark.parametrize("script", ["x", "x = 1", "x += 1", "'a' - 'b'", "1.5 & 1", "!'a'", "n < 'many'"])
def test_a_script_that_cannot_be_evaluated_raises(script: str) -> None:
    board = Blackboard()
    board["n"] = 2
    with pytest.raises(ScriptError):
        Script(script)(board)


def test_preconditions_decide_in_order_and_postconditions_follow() -> None:
    found = tree(
        '<Sequence><AlwaysSuccess _skipIf="mode == 1" _onSuccess="ran := 1"/>'
        '<AlwaysFailure _successIf="mode == 1" _post="posted := 1" _onFailure="failed := 1"/></Sequence>',
        blackboard={"mode": 1},
    )
    assert found.tick(0.0) is Status.SUCCESS
    assert "ran" not in found.blackboard
    assert found.blackboard["posted"] == 1
    found.blackboard["mode"] = 0
    assert found.tick(0.1) is Status.FAILURE
    assert found.blackboard["ran"] == found.blackboard["failed"] == 1


def test_while_halts_a_running_node() -> None:
    found = tree('<Sleep msec="1000" _while="go" _onHalted="stopped := 1"/>', blackboard={"go": True})
    assert found.tick(0.0) is Status.RUNNING
    found.blackboard["go"] = False
    assert found.tick(0.1) is Status.SKIPPED
    assert found.blackboard["stopped"] == 1


def test_a_subtree_sees_only_its_ports() -> None:
    inner = '<BehaviorTree ID="B"><Script code="out := in + offset; hidden := 1"/></BehaviorTree>'
    found = tree('<SubTree ID="B" in="{x}" out="{y}" offset="10"/>', inner, blackboard={"x": 1})
    assert found.tick(0.0) is Status.SUCCESS
    assert found.blackboard["y"] == 11
    assert "hidden" not in found.blackboard


def test_autoremap_shares_all_but_private_keys() -> None:
    inner = '<BehaviorTree ID="B"><Script code="y := x + 1; _own := 2; @top := 3"/></BehaviorTree>'
    found = tree('<SubTree ID="B" _autoremap="true"/>', inner, blackboard={"x": 1})
    found.tick(0.0)
    assert (found.blackboard["y"], found.blackboard["top"], "_own" in found.blackboard) == (2, 3, False)


def test_format_3_names_entries_without_braces() -> None:
    inner = '<BehaviorTree ID="B"><SetBlackboard value="7" output_key="n"/></BehaviorTree>'
    found = tree('<SequenceStar><SubTree ID="B" n="count"/></SequenceStar>', inner, head="")
    assert found.format == 3
    assert found.tick(0.0) is Status.SUCCESS
    assert found.blackboard["count"] == "7"


def test_old_releases_wrap_around() -> None:
    inner = "<RoundRobin><AlwaysFailure/><AlwaysSuccess/></RoundRobin>"
    results = {distro: tree(inner, distro=distro).tick(0.0) for distro in ("humble", "kilted", "rolling")}
    assert results == {"humble": Status.SUCCESS, "kilted": Status.SUCCESS, "rolling": Status.FAILURE}


def test_timers_run_in_simulated_time() -> None:
    found = tree(
        '<Timeout msec="250"><Sequence><Delay delay_msec="100"><AlwaysSuccess/></Delay><Sleep msec="500"/></Sequence></Timeout>'
    )
    assert [found.tick(0.05 * k) for k in range(5)] == [Status.RUNNING] * 5
    assert found.tick(0.25) is Status.FAILURE


class Count(Action):
    """Fails until it has been ticked `limit` times."""

    PORTS = (*inputs(limit=("int", "3")), *outputs(count="int"))

    def setup(self) -> None:
        self.ticks = 0

    def tick(self) -> Status:
        self.ticks += 1
        self.output("count").set(self.ticks)
        return Status.SUCCESS if self.ticks >= self.integer("limit") else Status.FAILURE


def test_a_node_of_ones_own_is_registered_and_given() -> None:
    text = '<RetryUntilSuccessful num_attempts="9"><Count limit="4" count="{n}"/></RetryUntilSuccessful>'
    assert tree(text, nodes={"Count": Count}).tick(0.0) is Status.SUCCESS
    NODES.add("TestCount", Count, origin="test")
    found = tree(text.replace("<Count", "<TestCount"))
    assert found.tick(0.0) is Status.SUCCESS
    assert found.blackboard["n"] == 4


def test_an_exception_of_a_node_is_one_error() -> None:
    class Broken(Action):
        def tick(self) -> Status:
            raise KeyError("x")

    class Wrong(Action):
        def tick(self) -> Status:
            return 1  # type: ignore[return-value]

    for cls, text in ((Broken, "KeyError in Broken.tick"), (Wrong, "return a Status")):
        with pytest.raises(BehaviorTreeRunError, match=text):
            tree("<Inverter><X/></Inverter>", nodes={"X": cls}).tick(0.0)


class Mock(NoServers):
    """Plans at once, fails to follow the first `failures` paths, notes what it is asked."""

    def __init__(self, failures: int = 0) -> None:
        self.failures = failures
        self.asked: list[str] = []
        self.x = 0.0

    def send(self, server: str, goal: Mapping[str, object]) -> ActionTicket:
        self.asked.append(server)
        ticket = ActionTicket()
        if server == "compute_path_to_pose":
            poses = np.column_stack((np.linspace(self.x, 10.0, 101), np.zeros((101, 2))))
            return ticket.end(ActionState.SUCCEEDED, path=core.Path(poses))
        if server == "follow_path" and self.failures:
            self.failures -= 1
            return ticket.end(ActionState.ABORTED, 106, "every sample collides")
        return ticket

    def call(self, service: str, kind: str, request: Mapping[str, object]) -> Mapping[str, object]:
        self.asked.append(service.split("/")[0])
        return {"success": True, "is_valid": True}

    def cancel(self, ticket: ActionTicket) -> None:
        self.asked.append("cancel")
        super().cancel(ticket)

    def robot_pose(self, frame: str, base_frame: str) -> StampedPose:
        return StampedPose(self.x, 0.0)


def test_the_trace_tells_why_a_recovery_ran() -> None:
    servers = Mock(failures=2)
    found = BehaviorTree(find_tree("navigate_to_pose_w_replanning_and_recovery"), servers=servers)
    found.blackboard["goal"] = StampedPose(10.0, 0.0)
    assert found.tick(0.0) is Status.RUNNING
    first, second = found.trace.retries
    assert first.path.endswith("FollowWithRecovery")
    assert (first.cause.rsplit("/", 1)[-1], first.code) == ("FollowPath", 106)
    assert second.path == "NavigateRecovery"
    assert "FollowPath failed with code 106: every sample collides" in found.explain()
    assert servers.asked.count("local_costmap") == 2
    assert found.blackboard["number_recoveries"] == 3


def test_a_new_path_replaces_the_goal_of_the_controller_and_a_halt_cancels_it() -> None:
    servers = Mock()
    found = BehaviorTree(find_tree("navigate_to_pose_w_replanning_and_recovery"), servers=servers)
    found.blackboard["goal"] = StampedPose(10.0, 0.0)
    for k in range(12):
        found.tick(0.1 * k)
    assert servers.asked == ["compute_path_to_pose", "follow_path"] * 2
    servers.x = 8.0
    for k in range(12, 60):
        found.tick(0.1 * k)
    assert servers.asked.count("compute_path_to_pose") == 3  # near the goal the path is kept
    found.halt()
    assert servers.asked[-1] == "cancel"


def test_the_trace_is_bounded() -> None:
    found = tree("<Sequence><AlwaysSuccess/><Inverter><AlwaysSuccess/></Inverter></Sequence>")
    for k in range(3000):
        found.tick(0.01 * k)
        found.halt()
    assert len(found.trace.changes) <= 2000
    assert "failed 3000" in found.explain()


def path_of(*points: tuple[float, float, float]) -> core.Path:
    return core.Path(np.array(points, np.float64))


def test_paths_are_truncated_as_in_nav2() -> None:
    line = path_of(*((0.5 * k, 0.0, 0.0) for k in range(21)))
    cut = tree('<TruncatePath distance="1.0" input_path="{p}" output_path="{q}"/>', blackboard={"p": line})
    cut.tick(0.0)
    assert cut.blackboard["q"].poses[-1].tolist() == [9.0, 0.0, 0.0]  # type: ignore[attr-defined]
    servers = Mock()
    servers.x = 4.1
    local = tree(
        '<TruncatePathLocal distance_forward="2.0" distance_backward="1.0" input_path="{p}" output_path="{q}"/>',
        blackboard={"p": line},
        servers=servers,
    )
    local.tick(0.0)
    xs = local.blackboard["q"].poses[:, 0]  # type: ignore[attr-defined]
    assert (xs[0], xs[-1]) == (3.0, 6.0)


def test_passed_goals_are_removed_but_the_last() -> None:
    goals = [StampedPose(0.1, 0.0), StampedPose(0.4, 0.0), StampedPose(3.0, 0.0)]
    found = tree('<RemovePassedGoals radius="0.5" input_goals="{g}" output_goals="{g}"/>', blackboard={"g": goals})
    found.tick(0.0)
    assert found.blackboard["g"] == [StampedPose(3.0, 0.0)]


@pytest.mark.parametrize("name", packaged_trees())
def test_packaged_trees_are_valid(name: str) -> None:
    assert BehaviorTree(packaged_trees()[name]).tick(0.0) is Status.FAILURE  # without servers, every goal is rejected


def test_a_path_of_nav2_finds_the_packaged_tree() -> None:
    name = "navigate_to_pose_w_replanning_and_recovery"
    assert find_tree(f"/opt/ros/share/nav2_bt_navigator/behavior_trees/{name}.xml") == packaged_trees()[name]
