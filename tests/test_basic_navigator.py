"""The simple commander: tasks, feedback and results as in Nav2."""

from __future__ import annotations

import math
import pathlib
import re

import numpy as np
import pytest

import navstack as nav
from navstack.behavior_trees import BehaviorTreeError
from navstack.bringup import BasicNavigator, TaskResult
from navstack.core import (
    LETHAL,
    Bounds,
    InputError,
    InvalidPathError,
    NotSupportedError,
    Path,
    Pose2D,
    StartOccupiedError,
    Twist2D,
)
from navstack.costmap import ObstacleLayer
from navstack.global_planner import SmoothedPlanner
from navstack.global_planner.smoothers import SimpleSmoother, SimpleSmootherParams
from navstack.move_base import TreeMoveBase
from navstack.parameters import load_configuration
from tests.move_base.world import Bench, StraightPlanner, occupied


class NavigatorBench:
    """A navigator in the small world of the goal manager's tests."""

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
    """Return a planner that finds no path to goals beyond x."""
    planner = StraightPlanner()

    def behave(n: int) -> None:
        if planner.calls[-1].x > x:
            occupied(n)

    planner.behave = behave
    return planner


def test_results_have_navs2_numbers() -> None:
    assert {r.name: r.value for r in TaskResult} == {"UNKNOWN": 0, "SUCCEEDED": 1, "CANCELED": 2, "FAILED": 3}


def test_before_the_first_task() -> None:
    navigator = NavigatorBench().navigator
    assert navigator.isTaskComplete()
    assert navigator.getResult() is TaskResult.UNKNOWN
    assert navigator.getFeedback() is None
    navigator.cancelTask()
    assert navigator.getTaskError() == (0, "")


def test_go_to_pose_with_feedback() -> None:
    world = NavigatorBench()
    assert world.navigator.goToPose(Pose2D(2.0, 1.0, 0.5))
    feedbacks = []
    before = world.bench.robot.time
    while not world.navigator.isTaskComplete():
        assert world.bench.robot.time <= before + 0.1 + 1e-9
        before = world.bench.robot.time
        feedbacks.append(world.navigator.getFeedback())
    assert world.navigator.getResult() is TaskResult.SUCCEEDED
    assert world.navigator.getFeedback() is None
    assert world.pose.distance_to(Pose2D(2.0, 1.0)) <= 0.1
    distance = math.hypot(2.0, 1.0)
    assert feedbacks[3].distance_remaining == pytest.approx(distance, abs=0.2)
    assert feedbacks[-1].distance_remaining < 0.2
    times = [f.navigation_time for f in feedbacks]
    assert times == sorted(times)
    half = next(f for f in feedbacks if f.distance_remaining < distance / 2)
    rest = world.bench.robot.time - half.navigation_time
    assert half.estimated_time_remaining == pytest.approx(rest, rel=0.5)
    assert half.number_of_recoveries == 0


def test_a_goal_without_a_plan_fails_with_code_and_reason() -> None:
    world = NavigatorBench(planner=StraightPlanner(occupied))
    world.navigator.goToPose(Pose2D(2.0, 1.0))
    assert world.run() is TaskResult.FAILED
    code, why = world.navigator.getTaskError()
    assert code == 206
    assert "in a wall" in why


def test_go_through_poses_does_not_stop_on_the_way() -> None:
    world = NavigatorBench()
    poses = [Pose2D(1.5, 0.0), Pose2D(3.0, 0.0), Pose2D(4.5, 0.0)]
    world.navigator.goThroughPoses(poses)
    seen = {3}
    while not world.navigator.isTaskComplete():
        feedback = world.navigator.getFeedback()
        if feedback is None:
            break
        seen.add(feedback.number_of_poses_remaining)
        assert feedback.distance_remaining <= 4.5 + 0.1
    assert world.navigator.getResult() is TaskResult.SUCCEEDED
    assert seen == {1, 2, 3}
    assert world.pose.distance_to(poses[-1]) <= 0.1
    moving = [t for t, twist in world.bench.robot.commands if twist.vx > 0.0]
    stopped = [t for t, twist in world.bench.robot.commands if twist == Twist2D() and moving[0] < t < moving[-1]]
    assert stopped == []


def test_follow_waypoints_stops_at_each() -> None:
    world = NavigatorBench()
    poses = [Pose2D(1.0, 0.0), Pose2D(1.0, 1.0), Pose2D(0.0, 1.0)]
    world.navigator.followWaypoints(poses)
    assert world.run() is TaskResult.SUCCEEDED
    assert [e.data["status"] for e in world.bench.listener.of("status")].count("SUCCEEDED") == 3
    assert world.navigator.missed_waypoints == []


@pytest.mark.parametrize("stop", [False, True])
def test_an_unreachable_waypoint_is_missed(stop: bool) -> None:
    world = NavigatorBench(planner=only_near(2.0))
    world.navigator.followWaypoints([Pose2D(1.0, 0.0), Pose2D(3.0, 0.0), Pose2D(0.0, 1.0)], stop_on_failure=stop)
    assert world.run() is TaskResult.FAILED
    assert world.navigator.missed_waypoints == [1]
    assert world.navigator.getTaskError()[0] == (603 if stop else 206)
    assert (world.pose.distance_to(Pose2D(0.0, 1.0)) <= 0.1) != stop


def test_cancel_takes_one_control_cycle() -> None:
    world = NavigatorBench()
    world.navigator.goToPose(Pose2D(4.0, 0.0))
    for _ in range(20):
        world.navigator.isTaskComplete()
    at = world.bench.robot.time
    world.navigator.cancelTask()
    assert world.bench.robot.time <= at + 0.2 + 1e-9
    assert world.bench.robot.twist == Twist2D()
    assert world.navigator.isTaskComplete()
    assert world.navigator.getResult() is TaskResult.CANCELED
    assert world.navigator.getTaskError()[0] == 9011


def test_a_goal_replaced_by_another_client_is_canceled() -> None:
    world = NavigatorBench()
    world.navigator.goToPose(Pose2D(4.0, 0.0))
    world.navigator.isTaskComplete()
    world.bench.move_base.send_goal(Pose2D(1.0, 1.0))
    assert world.run() is TaskResult.CANCELED


def test_spin_backup_and_drive_between_goals() -> None:
    world = NavigatorBench()
    navigator = world.navigator
    navigator.goToPose(Pose2D(1.0, 0.0))
    navigator.isTaskComplete()
    navigator.spin(1.0)  # ends the goal
    assert world.run() is TaskResult.SUCCEEDED
    assert world.pose.yaw == pytest.approx(1.0, abs=0.03)
    navigator.spin(-1.0)
    assert world.run() is TaskResult.SUCCEEDED
    x = world.pose.x
    navigator.backup(0.3, 0.1)
    navigator.isTaskComplete()
    feedback = navigator.getFeedback()
    assert feedback is not None and feedback.distance_remaining == pytest.approx(0.3, abs=0.02)
    assert world.run() is TaskResult.SUCCEEDED
    assert world.pose.x == pytest.approx(x - 0.3, abs=0.01)
    navigator.driveOnHeading(0.3, 0.1)
    assert world.run() is TaskResult.SUCCEEDED
    assert world.pose.x == pytest.approx(x, abs=0.02)
    assert world.bench.robot.twist == Twist2D()
    navigator.goToPose(Pose2D(0.0, 0.0))
    assert world.run() is TaskResult.SUCCEEDED


def test_backup_into_a_wall_fails_and_stops() -> None:
    world = NavigatorBench()
    world.bench.local_costmap.master.data[:, 90] = LETHAL  # x = -0.5
    world.navigator.backup(1.0, 0.1, 20.0)
    assert world.run() is TaskResult.FAILED
    assert world.navigator.getTaskError()[0] == 714
    assert world.bench.robot.twist == Twist2D()
    assert -0.3 < world.pose.x <= 0.0


def test_a_behavior_stops_with_stale_sensors_and_can_be_canceled() -> None:
    world = NavigatorBench()
    world.navigator.backup(1.0, 0.1, 20.0)
    world.navigator.isTaskComplete()
    world.bench.local_costmap.stale = lambda now: True
    assert world.run() is TaskResult.FAILED
    assert world.navigator.getTaskError()[0] == 9020
    assert world.bench.robot.twist == Twist2D()
    world.bench.local_costmap.stale = lambda now: False
    world.navigator.backup(1.0, 0.1, 20.0)
    world.navigator.isTaskComplete()
    world.navigator.cancelTask()
    assert world.navigator.getResult() is TaskResult.CANCELED
    assert world.bench.robot.twist == Twist2D()


def test_paths_and_costmaps() -> None:
    world = NavigatorBench(planner=only_near(2.0))
    navigator = world.navigator
    navigator.waitUntilNav2Active()
    path = navigator.getPath(Pose2D(0.0, 1.0), Pose2D(1.0, 1.0), use_start=True)
    assert path is not None and path.length == pytest.approx(1.0)
    path = navigator.getPath(Pose2D(0.0, 1.0), Pose2D(1.0, 1.0))
    assert path is not None and path.length == pytest.approx(math.sqrt(2.0))
    assert navigator.getPath(Pose2D(0.0, 0.0), Pose2D(3.0, 1.0)) is None
    assert navigator.getTaskError()[0] == 206
    local_layer, global_layer = (
        costmap.layers[1] for costmap in (world.bench.local_costmap, world.bench.global_costmap)
    )
    navigator.clearLocalCostmap()
    assert (len(local_layer.resets), len(global_layer.resets)) == (1, 0)
    navigator.clearGlobalCostmap()
    assert (len(local_layer.resets), len(global_layer.resets)) == (1, 1)
    navigator.clearAllCostmaps()
    assert (len(local_layer.resets), len(global_layer.resets)) == (2, 2)
    assert navigator.getLocalCostmap() is world.bench.local_costmap.master
    assert navigator.getGlobalCostmap() is world.bench.global_costmap.master


def test_invalid_arguments() -> None:
    navigator = NavigatorBench().navigator
    with pytest.raises(InputError, match="list of poses is empty"):
        navigator.goThroughPoses([])
    with pytest.raises(InputError, match="GridBased"):
        navigator.getPath(Pose2D(0.0, 0.0), Pose2D(0.0, 0.0), planner_id="GridBased")
    with pytest.raises(InputError, match="opposite directions"):
        navigator.driveOnHeading(1.0, -1.0)
    assert navigator.isTaskComplete()


def test_shutdown_stops_the_robot() -> None:
    world = NavigatorBench()
    world.navigator.goToPose(Pose2D(4.0, 0.0))
    for _ in range(20):
        world.navigator.isTaskComplete()
    world.navigator.lifecycleShutdown()
    assert world.bench.robot.twist == Twist2D()


def test_with_the_real_parts() -> None:
    navigator = BasicNavigator.simulated(
        load_configuration(["turtlebot"]), nav.load_map(nav.map_path("office")), Pose2D(2.0, 7.45, 0.0)
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


def test_paths_through_poses_changed_maps_and_initial_poses() -> None:
    places, office = nav.load_places("office"), nav.load_map(nav.map_path("office"))
    navigator = BasicNavigator.simulated(load_configuration(["turtlebot"]), office, places.start)
    navigator.setInitialPose(places.start)
    navigator.waitUntilNav2Active(localizer="amcl")
    navigator.lifecycleStartup()
    path = navigator.getPathThroughPoses(places.start, places.goals[:2])
    assert path is not None
    near = [min(math.hypot(x - goal.x, y - goal.y) for x, y, _ in path.poses) for goal in places.goals[:2]]
    assert max(near) < 0.3
    before = navigator.getGlobalCostmap().data.copy()
    assert navigator.changeMap(nav.map_path("office"))
    navigator.waitUntilNav2Active()
    assert navigator.getGlobalCostmap().data.shape == before.shape


def test_a_spin_that_cannot_end_in_time_is_rejected_before_it_starts() -> None:
    navigator = BasicNavigator.simulated(
        load_configuration(["turtlebot"]), nav.load_map(nav.map_path("office")), nav.load_places("office").start
    )
    with pytest.raises(InputError, match="time_allowance of 1 s"):
        navigator.spin(6.28, time_allowance=1.0)
    assert navigator.isTaskComplete()


def test_places_can_have_numbers_as_names(tmp_path) -> None:
    file = tmp_path / "tour.yaml"
    file.write_text("places:\n  1: [1.0, 2.0, 0.0]\n  2: [3.0, 2.0]\nstart: 1\ngoals: [2, 1]\n")
    places = nav.load_places(file)
    assert places.goal_names == ("2", "1")
    assert places.start == Pose2D(1.0, 2.0, 0.0)


# --- names of Nav2's simple commander ---------------------------------------------------------------------------------


def simulated(**options: object) -> BasicNavigator:
    places = nav.load_places("office")
    office = nav.load_map(nav.map_path("office"))
    return BasicNavigator.simulated(load_configuration(["turtlebot"]), office, places.start, **options)  # type: ignore[arg-type]


def finish(navigator: BasicNavigator) -> TaskResult:
    while not navigator.isTaskComplete():
        pass
    return navigator.getResult()


def pose_of(navigator: BasicNavigator) -> Pose2D:
    return navigator.move_base.global_costmap.robot_pose()


def test_the_initial_pose_of_a_simulated_robot_is_set_until_time_passes() -> None:
    places = nav.load_places("office")
    navigator = simulated()
    navigator.setInitialPose(places.goals[0])
    navigator.waitUntilNav2Active()
    assert pose_of(navigator) == pytest.approx(places.goals[0])
    navigator.goToPose(places.goals[0]._replace(yaw=0.0))
    assert finish(navigator) is TaskResult.SUCCEEDED
    navigator.setInitialPose(pose_of(navigator))
    with pytest.raises(InputError, match="from where the robot is localized"):
        navigator.setInitialPose(places.start)
    with pytest.raises(StartOccupiedError):
        simulated().setInitialPose(Pose2D(4.6, 10.0, 0.0))


def test_the_initial_pose_initializes_the_localization_of_a_robot() -> None:
    world, given = NavigatorBench(), []
    bench = world.bench
    navigator = BasicNavigator(bench.move_base, lambda t: t, place=given.append)
    navigator.setInitialPose(Pose2D(7.0, 8.0, 0.5))
    assert given == [Pose2D(7.0, 8.0, 0.5)]


def test_follow_path_uses_the_local_planner_only() -> None:
    world = NavigatorBench()
    navigator, planner = world.navigator, world.bench.planner
    x = np.linspace(0.0, 2.0, 41)
    path = Path(np.column_stack((x, np.zeros(41), np.zeros(41))))
    for _ in range(2):  # the second time from the other end
        planned = len(planner.calls)
        assert navigator.followPath(path)
        navigator.isTaskComplete()
        feedback = navigator.getFeedback()
        assert feedback is not None and feedback.current_pose is not None
        assert world.run() is TaskResult.SUCCEEDED
        assert world.pose.x == pytest.approx(2.0, abs=0.3)
        assert len(planner.calls) == planned
        assert world.bench.robot.twist == Twist2D()
        navigator.backup(1.0, 0.5)
        assert world.run() is TaskResult.SUCCEEDED


@pytest.mark.parametrize("task", ["goToPose", "followPath"])
def test_a_repeated_goal_does_not_keep_a_latched_position(task: str) -> None:
    places = nav.load_places("office")
    configuration = load_configuration(["turtlebot"], overrides=["DWAPlannerROS/latch_xy_goal_tolerance=true"])
    navigator = BasicNavigator.simulated(configuration, nav.load_map(nav.map_path("office")), places.start)
    navigator.waitUntilNav2Active()
    goal = Pose2D(places.start.x + 1.2, places.start.y, 0.0)
    path = navigator.getPath(places.start, goal)
    for _ in range(2):
        getattr(navigator, task)(path if task == "followPath" else goal)
        assert finish(navigator) is TaskResult.SUCCEEDED
        assert pose_of(navigator).distance_to(goal) < 0.3
        navigator.backup(0.8, 0.2)
        assert finish(navigator) is TaskResult.SUCCEEDED


def test_follow_path_fails_with_the_reason_after_the_patience() -> None:
    navigator = simulated(obstacles=[(3.0, 7.45, 0.4)])
    start = nav.load_places("office").start
    x = np.linspace(start.x, start.x + 5.0, 101)
    across = Path(np.column_stack((x, np.full(101, start.y), np.zeros(101))))
    navigator.move_base.reconfigure(navigator.move_base.params.model_copy(update={"controller_patience": 2.0}))
    navigator.followPath(across)
    assert finish(navigator) is TaskResult.FAILED
    code, text = navigator.getTaskError()
    assert code in (105, 106) and text
    assert not navigator.move_base.recovery
    navigator.clearTaskError()
    assert navigator.getTaskError() == (0, "")


@pytest.mark.parametrize("poses", [np.empty((0, 3)), np.full((3, 3), np.nan)])
def test_follow_path_rejects_unusable_paths(poses: np.ndarray) -> None:
    navigator = simulated()
    with pytest.raises(InvalidPathError):
        navigator.followPath(Path(poses))
    assert navigator.isTaskComplete()


def test_follow_path_can_be_canceled_and_does_not_know_other_planners() -> None:
    world = NavigatorBench()
    navigator = world.navigator
    path = Path(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    navigator.followPath(path)
    navigator.isTaskComplete()
    navigator.cancelTask()
    assert world.run() is TaskResult.CANCELED
    with pytest.raises(NotSupportedError, match="base_local_planner"):
        navigator.followPath(path, controller_id="FollowPath")


def test_costmaps_can_be_cleared_around_the_robot() -> None:
    navigator = simulated(obstacles=[(2.0, 7.45, 0.15)])
    navigator.waitUntilNav2Active()
    navigator.isTaskComplete()
    navigator.driveOnHeading(0.05, 0.1)
    finish(navigator)
    local = navigator.getLocalCostmap().geometry
    (layer,) = (x for x in navigator.move_base.local_costmap.layers if isinstance(x, ObstacleLayer))

    def marked() -> bool:
        return bool((layer.costs[local.window_of(Bounds(2.0, 7.45, 2.0, 7.45).grown(0.3)).slices] == LETHAL).any())

    assert marked()
    navigator.clearCostmapExceptRegion(4.0)
    navigator.clearCostmapAroundRobot(1.0)
    assert marked()
    navigator.clearLocalCostmapAroundPose(Pose2D(2.0, 7.45), 1.0)
    assert not marked()
    navigator.clearGlobalCostmapAroundPose(Pose2D(2.0, 7.45), 1.0)
    with pytest.raises(InputError, match="reset_distance"):
        navigator.clearCostmapAroundRobot(-1.0)


@pytest.mark.parametrize(
    ("name", "arguments", "alternative"),
    [
        ("assistedTeleop", (), "driveOnHeading"),
        ("followGpsWaypoints", ([],), "followWaypoints"),
    ],
)
def test_what_navstack_cannot_do_names_an_alternative(
    name: str, arguments: tuple[object, ...], alternative: str
) -> None:
    navigator = NavigatorBench().navigator
    with pytest.raises(NotSupportedError, match=alternative):
        getattr(navigator, name)(*arguments)
    for word in alternative.split("."):
        assert hasattr(navigator, word) or word == "theta_star"


def test_smooth_path_takes_the_smoother_of_the_parameters() -> None:
    navigator = NavigatorBench().navigator
    x = np.linspace(0.5, 1.5, 21)
    path = Path(np.column_stack((x, 0.02 * np.sin(20.0 * x), np.arctan(0.4 * np.cos(20.0 * x)))))
    moved = navigator.smoothPath(path).poses - path.poses
    assert np.abs(moved[:, 1]).max() > 1e-3
    stiff = SimpleSmoother(SimpleSmootherParams(w_data=1.0, w_smooth=0.0))
    planner = navigator.move_base.global_planner
    navigator.move_base.reconfigure(global_planner=SmoothedPlanner(planner, stiff))
    for name in ("", "simple"):
        assert navigator.smoothPath(path, name).poses[:, :2] == pytest.approx(path.poses[:, :2], abs=1e-12)
    assert np.abs(navigator.smoothPath(path, "savitzky_golay").poses - path.poses)[:, 1].max() > 1e-4


TREE = "navigate_to_pose_w_replanning_and_recovery"


@pytest.mark.slow
def test_a_goal_names_its_behavior_tree(tmp_path: pathlib.Path) -> None:
    navigator = simulated()
    move_base = navigator.move_base
    assert isinstance(move_base, TreeMoveBase)
    navigator.goToPose(Pose2D(2.2, 7.45), behavior_tree=TREE)
    assert finish(navigator) is TaskResult.SUCCEEDED
    assert pathlib.Path(str(move_base.tree_source)).stem == TREE and "FollowPath" in str(move_base.tree.explain())
    assert pose_of(navigator)[:2] == pytest.approx((2.2, 7.45), abs=0.25)
    # a tree that cannot be read changes nothing: the goal before goes on
    navigator.goThroughPoses([Pose2D(4.0, 7.45), Pose2D(5.0, 7.45)], behavior_tree=TREE)
    for _ in range(10):
        navigator.isTaskComplete()
    handle = move_base.goal_handle
    broken = tmp_path / "broken.xml"
    broken.write_text("<root><BehaviorTree ID='Main'><Sequence_/></BehaviorTree></root>")
    for wrong, told in (("nowhere", 'no behavior tree "nowhere"'), (str(broken), "broken.xml:1:")):
        with pytest.raises(BehaviorTreeError, match=re.escape(told)):
            navigator.goToPose(Pose2D(2.0, 7.45), behavior_tree=wrong)
        assert not navigator.isTaskComplete() and move_base.goal_handle is handle
    # one without a tree takes over: the states of move_base drive it
    navigator.goToPose(Pose2D(2.8, 7.45))
    assert handle is not None and handle.is_done and move_base.tree_source is None
    assert finish(navigator) is TaskResult.SUCCEEDED


def test_a_goal_manager_without_trees_says_so() -> None:
    navigator = NavigatorBench().navigator
    with pytest.raises(NotSupportedError, match="trees_by_goal=True"):
        navigator.goToPose(Pose2D(1.0, 0.0), behavior_tree="tree.xml")
    with pytest.raises(NotSupportedError, match="trees_by_goal=True"):
        navigator.goThroughPoses([Pose2D(1.0, 0.0)], behavior_tree="tree.xml")


# fmt: off
NAMES_OF_NAV2 = [
    "assistedTeleop", "backup", "cancelTask", "changeMap", "clearAllCostmaps", "clearCostmapAroundRobot",
    "clearCostmapExceptRegion", "clearGlobalCostmap", "clearGlobalCostmapAroundPose", "clearLocalCostmap",
    "clearLocalCostmapAroundPose", "clearTaskError", "debug", "destroyNode", "destroy_node", "dockRobotByID",
    "dockRobotByPose", "driveOnHeading", "error", "followGpsWaypoints", "followPath", "followWaypoints",
    "getAndTrackRoute", "getFeedback", "getGlobalCostmap", "getLocalCostmap", "getPath", "getPathThroughPoses",
    "getResult", "getRoute", "getTaskError", "goThroughPoses", "goToPose", "info", "isTaskComplete", "lifecycleShutdown",
    "lifecycleStartup", "setInitialPose", "setTaskError", "smoothPath", "spin", "undockRobot", "waitUntilNav2Active",
    "warn",
]
# fmt: on


@pytest.mark.parametrize("name", NAMES_OF_NAV2)
def test_every_method_of_nav2s_commander_exists(name: str) -> None:
    assert callable(getattr(BasicNavigator, name))


def test_messages_go_to_the_log(caplog: pytest.LogCaptureFixture) -> None:
    navigator = NavigatorBench().navigator
    with caplog.at_level("DEBUG", logger="navstack.basic_navigator"):
        for level in ("debug", "info", "warn", "error"):
            getattr(navigator, level)(f"text of {level}")
    assert [r.levelname for r in caplog.records] == ["DEBUG", "INFO", "WARNING", "ERROR"]
    navigator.destroyNode()
