"""The simple commander: tasks, feedback and results as Nav2's scripts expect them."""

from __future__ import annotations

import math

import pytest

import navstack as nav
from navstack.basic_navigator import BasicNavigator, TaskResult
from navstack.core import Pose2D, Twist2D
from navstack.core.costs import LETHAL
from navstack.core.errors import InputError
from tests.move_base.world import Bench, StraightPlanner, occupied


class Table:
    """A navigator on the little world of the goal manager's tests."""

    def __init__(self, **how: object) -> None:
        self.bench = Bench(**how)  # type: ignore[arg-type]

        def advance(until: float) -> float:
            self.bench.robot.advance_to(until)
            return self.bench.robot.time

        self.navigator = BasicNavigator(self.bench.move_base, advance)

    def run(self, limit: float = 200.0) -> TaskResult:
        while not self.navigator.isTaskComplete():
            assert self.bench.robot.time < limit
        return self.navigator.getResult()

    @property
    def pose(self) -> Pose2D:
        return self.bench.robot.odom_pose


def only_near(x: float):  # type: ignore[no-untyped-def]
    """A planner that knows no way to goals beyond x."""
    planner = StraightPlanner()

    def behave(n: int) -> None:
        if planner.calls[-1].x > x:
            occupied(n)

    planner.behave = behave
    return planner


def test_results_have_navs2_numbers() -> None:
    assert {r.name: r.value for r in TaskResult} == {"UNKNOWN": 0, "SUCCEEDED": 1, "CANCELED": 2, "FAILED": 3}


def test_before_the_first_task() -> None:
    navigator = Table().navigator
    assert navigator.isTaskComplete()
    assert navigator.getResult() is TaskResult.UNKNOWN
    assert navigator.getFeedback() is None
    navigator.cancelTask()
    assert navigator.getTaskError() == (0, "")


def test_go_to_pose_with_feedback_that_comes_down_to_the_goal() -> None:
    table = Table()
    assert table.navigator.goToPose(Pose2D(2.0, 1.0, 0.5))
    told = []
    before = table.bench.robot.time
    while not table.navigator.isTaskComplete():
        assert table.bench.robot.time <= before + 0.1 + 1e-9
        before = table.bench.robot.time
        told.append(table.navigator.getFeedback())
    assert table.navigator.getResult() is TaskResult.SUCCEEDED
    assert table.navigator.getFeedback() is None
    assert table.pose.distance_to(Pose2D(2.0, 1.0)) <= 0.1
    way = math.hypot(2.0, 1.0)
    assert told[3].distance_remaining == pytest.approx(way, abs=0.2)
    assert told[-1].distance_remaining < 0.2
    times = [f.navigation_time for f in told]
    assert times == sorted(times)
    half = next(f for f in told if f.distance_remaining < way / 2)
    rest = table.bench.robot.time - half.navigation_time
    assert half.estimated_time_remaining == pytest.approx(rest, rel=0.5)
    assert half.number_of_recoveries == 0


def test_a_goal_without_a_plan_fails_with_code_and_reason() -> None:
    table = Table(planner=StraightPlanner(occupied))
    table.navigator.goToPose(Pose2D(2.0, 1.0))
    assert table.run() is TaskResult.FAILED
    code, why = table.navigator.getTaskError()
    assert code == 206
    assert "in a wall" in why


def test_go_through_poses_does_not_stop_on_the_way() -> None:
    table = Table()
    poses = [Pose2D(1.5, 0.0), Pose2D(3.0, 0.0), Pose2D(4.5, 0.0)]
    table.navigator.goThroughPoses(poses)
    seen = {3}
    while not table.navigator.isTaskComplete():
        feedback = table.navigator.getFeedback()
        if feedback is None:
            break
        seen.add(feedback.number_of_poses_remaining)
        assert feedback.distance_remaining <= 4.5 + 0.1
    assert table.navigator.getResult() is TaskResult.SUCCEEDED
    assert seen == {1, 2, 3}
    assert table.pose.distance_to(poses[-1]) <= 0.1
    moving = [t for t, twist in table.bench.robot.commands if twist.vx > 0.0]
    stopped = [t for t, twist in table.bench.robot.commands if twist == Twist2D() and moving[0] < t < moving[-1]]
    assert stopped == []


def test_follow_waypoints_stops_at_each() -> None:
    table = Table()
    poses = [Pose2D(1.0, 0.0), Pose2D(1.0, 1.0), Pose2D(0.0, 1.0)]
    table.navigator.followWaypoints(poses)
    assert table.run() is TaskResult.SUCCEEDED
    assert [e.data["status"] for e in table.bench.ears.of("status")].count("SUCCEEDED") == 3
    assert table.navigator.missed_waypoints == []


@pytest.mark.parametrize("stop", [False, True])
def test_a_waypoint_out_of_reach_is_missed(stop: bool) -> None:
    table = Table(planner=only_near(2.0))
    table.navigator.followWaypoints([Pose2D(1.0, 0.0), Pose2D(3.0, 0.0), Pose2D(0.0, 1.0)], stop_on_failure=stop)
    assert table.run() is TaskResult.FAILED
    assert table.navigator.missed_waypoints == [1]
    assert table.navigator.getTaskError()[0] == 206
    assert (table.pose.distance_to(Pose2D(0.0, 1.0)) <= 0.1) != stop


def test_cancel_takes_one_control_cycle() -> None:
    table = Table()
    table.navigator.goToPose(Pose2D(4.0, 0.0))
    for _ in range(20):
        table.navigator.isTaskComplete()
    at = table.bench.robot.time
    table.navigator.cancelTask()
    assert table.bench.robot.time <= at + 0.2 + 1e-9
    assert table.bench.robot.twist == Twist2D()
    assert table.navigator.isTaskComplete()
    assert table.navigator.getResult() is TaskResult.CANCELED
    assert table.navigator.getTaskError()[0] == 9011


def test_a_goal_taken_over_by_somebody_else_is_canceled() -> None:
    table = Table()
    table.navigator.goToPose(Pose2D(4.0, 0.0))
    table.navigator.isTaskComplete()
    table.bench.move_base.send_goal(Pose2D(1.0, 1.0))
    assert table.run() is TaskResult.CANCELED


def test_spin_backup_and_drive_between_goals() -> None:
    table = Table()
    navigator = table.navigator
    navigator.goToPose(Pose2D(1.0, 0.0))
    navigator.isTaskComplete()
    navigator.spin(1.0)  # ends the goal
    assert table.run() is TaskResult.SUCCEEDED
    assert table.pose.yaw == pytest.approx(1.0, abs=0.03)
    navigator.spin(-1.0)
    assert table.run() is TaskResult.SUCCEEDED
    x = table.pose.x
    navigator.backup(0.3, 0.1)
    navigator.isTaskComplete()
    feedback = navigator.getFeedback()
    assert feedback is not None and feedback.distance_remaining == pytest.approx(0.3, abs=0.02)
    assert table.run() is TaskResult.SUCCEEDED
    assert table.pose.x == pytest.approx(x - 0.3, abs=0.01)
    navigator.driveOnHeading(0.3, 0.1)
    assert table.run() is TaskResult.SUCCEEDED
    assert table.pose.x == pytest.approx(x, abs=0.02)
    assert table.bench.robot.twist == Twist2D()
    navigator.goToPose(Pose2D(0.0, 0.0))
    assert table.run() is TaskResult.SUCCEEDED


def test_backup_into_a_wall_fails_and_stands() -> None:
    table = Table()
    table.bench.local_costmap.master.data[:, 90] = LETHAL  # x = -0.5
    table.navigator.backup(1.0, 0.1, 20.0)
    assert table.run() is TaskResult.FAILED
    assert table.navigator.getTaskError()[0] == 714
    assert table.bench.robot.twist == Twist2D()
    assert -0.3 < table.pose.x <= 0.0


def test_a_behavior_stands_where_sensors_are_silent_and_can_be_cancelled() -> None:
    table = Table()
    table.navigator.backup(1.0, 0.1, 20.0)
    table.navigator.isTaskComplete()
    table.bench.local_costmap.stale = lambda now: True
    assert table.run() is TaskResult.FAILED
    assert table.navigator.getTaskError()[0] == 9020
    assert table.bench.robot.twist == Twist2D()
    table.bench.local_costmap.stale = lambda now: False
    table.navigator.backup(1.0, 0.1, 20.0)
    table.navigator.isTaskComplete()
    table.navigator.cancelTask()
    assert table.navigator.getResult() is TaskResult.CANCELED
    assert table.bench.robot.twist == Twist2D()


def test_paths_and_costmaps() -> None:
    table = Table(planner=only_near(2.0))
    navigator = table.navigator
    navigator.waitUntilNav2Active()
    path = navigator.getPath(Pose2D(0.0, 1.0), Pose2D(1.0, 1.0), use_start=True)
    assert path is not None and path.length == pytest.approx(1.0)
    path = navigator.getPath(Pose2D(0.0, 1.0), Pose2D(1.0, 1.0))
    assert path is not None and path.length == pytest.approx(math.sqrt(2.0))
    assert navigator.getPath(Pose2D(0.0, 0.0), Pose2D(3.0, 1.0)) is None
    assert navigator.getTaskError()[0] == 206
    local, world = (costmap.layers[1] for costmap in (table.bench.local_costmap, table.bench.global_costmap))
    navigator.clearLocalCostmap()
    assert (len(local.resets), len(world.resets)) == (1, 0)
    navigator.clearGlobalCostmap()
    assert (len(local.resets), len(world.resets)) == (1, 1)
    navigator.clearAllCostmaps()
    assert (len(local.resets), len(world.resets)) == (2, 2)
    assert navigator.getLocalCostmap() is table.bench.local_costmap.master
    assert navigator.getGlobalCostmap() is table.bench.global_costmap.master


def test_wrong_use_says_so() -> None:
    navigator = Table().navigator
    with pytest.raises(InputError, match="list of poses is empty"):
        navigator.goThroughPoses([])
    with pytest.raises(InputError, match="GridBased"):
        navigator.getPath(Pose2D(0.0, 0.0), Pose2D(0.0, 0.0), planner_id="GridBased")
    with pytest.raises(InputError, match="opposite directions"):
        navigator.driveOnHeading(1.0, -1.0)
    assert navigator.isTaskComplete()


def test_shutdown_stops_the_robot() -> None:
    table = Table()
    table.navigator.goToPose(Pose2D(4.0, 0.0))
    for _ in range(20):
        table.navigator.isTaskComplete()
    table.navigator.lifecycleShutdown()
    assert table.bench.robot.twist == Twist2D()


def test_with_the_real_parts() -> None:
    navigator = BasicNavigator.simulated(
        nav.load_configuration(["turtlebot"]), nav.load_map(nav.map_path("office")), Pose2D(2.0, 7.45, 0.0)
    )
    navigator.goThroughPoses([Pose2D(3.5, 7.45), Pose2D(5.0, 7.45)])
    while not navigator.isTaskComplete():
        pass
    assert navigator.getResult() is TaskResult.SUCCEEDED
    navigator.backup(0.3, 0.1)
    while not navigator.isTaskComplete():
        pass
    assert navigator.getResult() is TaskResult.SUCCEEDED
    assert navigator.move_base.local_costmap.robot_pose().x == pytest.approx(4.7, abs=0.2)
