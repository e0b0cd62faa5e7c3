"""DockRobot and UndockRobot as nodes of a behavior tree that drives a simulated robot."""

from __future__ import annotations

import math

import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Pose2D
from navstack.docking import DockDatabase
from navstack.move_base import GoalHandle, GoalStatus, TreeMoveBase
from navstack.sim import SimulatedRobot, World, dock_shapes
from tools.docking_runs import DOCK, Case, configuration, contact_error, room

pytestmark = pytest.mark.slow

QUIET = {"dock_camera": {"noise": 0.0, "yaw_noise": 0.0}, "localization_noise": 0.0, "localization_yaw_noise": 0.0}
DRIVE = '<ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/>'
DOCK_NODE = '<DockRobot dock_id="home" navigate_to_staging_pose="false" success="{docked}" num_retries="{tries}"/>'
ELSEWHERE = "0;map;-3.0;2.0;0;0;0;0.0;1.0"
UNDOCK = '<UndockRobot dock_type="simple_charging_dock" success="{undocked}"/>'


class Bench:
    """A simulated robot before a dock; its goals are driven by a sequence of these nodes."""

    def __init__(self, nodes: str) -> None:
        made = configuration(Case("tree", sim=QUIET))
        world = World(room(), shapes=dock_shapes(made.navstack.sim))
        self.robot: SimulatedRobot = simulated_robot(made, world, Pose2D(0.5, -0.8, 0.5), seed=0)
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>{nodes}</Sequence></BehaviorTree></root>'
        move_base = build_move_base(made, self.robot, static_map=room(), behavior_tree=text)
        assert isinstance(move_base, TreeMoveBase)
        self.move_base, self.sim = move_base, made.navstack.sim
        self.move_base.tick(0.0)
        self.docks = DockDatabase.of(made)
        dock = self.docks.dock("home")
        self.staging = self.docks.type_of(dock).staging_pose(dock.pose)

    def drive(self, until: float = 120.0) -> GoalHandle:
        """Drive to the staging pose and run the rest of the tree."""
        handle = self.move_base.send_goal(self.staging)
        self.go_on(handle, until)
        return handle

    def go_on(self, handle: GoalHandle, until: float) -> None:
        while not handle.is_done and self.robot.time < until:
            self.robot.advance_to(self.move_base.next_due(self.robot.time))
            self.move_base.tick(self.robot.time)


def test_a_tree_docks_and_undocks() -> None:
    bench = Bench(DRIVE + DOCK_NODE)
    handle = bench.drive()
    assert handle.status is GoalStatus.SUCCEEDED and handle.result is not None
    board = bench.move_base.tree.blackboard
    assert (board["docked"], board["tries"]) == (True, 0)
    error = contact_error(bench.sim.dock("home"), bench.robot.pose)
    assert math.hypot(error.x, error.y) < 0.01 and abs(error.yaw) < 0.018
    assert handle.result.recoveries == 0
    bench.move_base.use_tree(f'<root BTCPP_format="4"><BehaviorTree ID="T">{UNDOCK}</BehaviorTree></root>')
    assert bench.drive(bench.robot.time + 60.0).status is GoalStatus.SUCCEEDED
    assert bench.move_base.tree.blackboard["undocked"] is True
    assert bench.robot.pose.distance_to(bench.staging) < 0.1
    assert not bench.robot.in_collision


def test_a_dock_by_its_pose() -> None:
    pose = f"0;map;{DOCK[0]};{DOCK[1]};0;0;0;0.0;1.0"
    node = f'<DockRobot use_dock_id="false" dock_pose="{pose}" dock_type="simple_charging_dock" {{}}/>'
    stage = 'navigate_to_staging_pose="false"'
    assert tuple(DOCK)[2] == 0.0  # the quaternion of the text
    assert Bench(DRIVE + node.format(stage)).drive().status is GoalStatus.SUCCEEDED


@pytest.mark.parametrize(
    ("node", "code", "text"),
    [
        ('<DockRobot dock_id="hoem"/>', 901, 'did you mean "home"?'),
        ('<DockRobot dock_id="home"/>', 903, "a tree drives there itself"),
        (
            f'<DockRobot use_dock_id="false" dock_pose="{ELSEWHERE}" navigate_to_staging_pose="false"/>',
            904,
            "not detected within initial_perception_timeout",
        ),
        ('<UndockRobot dock_type="hook"/>', 902, 'unknown type "hook"'),
    ],
)
def test_a_docking_that_fails_ends_the_goal_with_its_code(node: str, code: int, text: str) -> None:
    bench = Bench(node.replace("/>", ' success="{docked}" error_code_id="{dock_error_code}"/>'))
    handle = bench.drive()
    assert handle.status is GoalStatus.ABORTED and handle.result is not None
    assert handle.result.error_code == code == bench.move_base.tree.blackboard["dock_error_code"]
    assert text in handle.result.message
    assert bench.move_base.tree.blackboard["docked"] is False


def test_a_cancel_ends_the_approach() -> None:
    bench = Bench(DRIVE + DOCK_NODE)
    handle = bench.drive(until=1.0)
    while bench.move_base.recovery != "dock_robot":
        bench.go_on(handle, bench.robot.time + 0.1)
    bench.go_on(handle, bench.robot.time + 2.0)
    bench.move_base.cancel_goal(handle)
    bench.go_on(handle, bench.robot.time + 1.0)
    assert handle.status is GoalStatus.PREEMPTED
    assert bench.move_base.recovery is None and bench.move_base.command == (0.0, 0.0, 0.0)


def test_without_docks_the_node_says_what_is_missing() -> None:
    bench = Bench('<DockRobot dock_id="home" error_code_id="{dock_error_code}"/>')
    bench.move_base.behavior_servers = {}
    bench.move_base.use_tree(bench.move_base.tree_source or "")
    handle = bench.drive()
    assert handle.result is not None and handle.result.error_code == 1
