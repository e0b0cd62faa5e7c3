"""Each action of the navigator with a client of rclpy: accept, feedback, preempt, cancel, abort with a code."""

from __future__ import annotations

from typing import Any

import pytest

from tests.ros2.conftest import Graph

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
DRIVES = """
from nav2_msgs.action import NavigateToPose, NavigateThroughPoses, FollowWaypoints
from nav_msgs.msg import Goals

go = Action(NavigateToPose, "navigate_to_pose")
handle = go.send(NavigateToPose.Goal(pose=stamped(3.0, 7.45)))
found["accepted"] = handle.accepted
status, result = go.end(handle)
found["reached"] = [status, result.error_code, result.error_msg]
found["at"] = robot()
seen = go.feedback
found["feedback"] = [len(seen), seen[-1].current_pose.header.frame_id, seen[0].distance_remaining, seen[-1].distance_remaining,
                     seen[-1].navigation_time.sec, seen[-1].number_of_recoveries]

# a newer goal replaces one; it is canceled then
before = go.send(NavigateToPose.Goal(pose=stamped(11.0, 7.4)))
answer = before.get_result_async()
newer = go.send(NavigateToPose.Goal(pose=stamped(1.2, 7.45)))
replaced = wait(answer, "the end of the first goal")
found["replaced"] = [replaced.status, replaced.result.error_code, replaced.result.error_msg]
spin(lambda: go.feedback, "feedback of the second goal")
found["canceling"] = len(wait(newer.cancel_goal_async(), "cancel").goals_canceling)
found["canceled"] = [go.end(newer)[0]]
found["after"] = go.run(NavigateToPose.Goal(pose=stamped(2.0, 7.45)))

# what cannot be done
before = node.get_clock().now().nanoseconds
found["no frame"] = go.run(NavigateToPose.Goal(pose=stamped(1.0, 7.45, frame="nowhere")))
found["seconds without a frame"] = 1e-9 * (node.get_clock().now().nanoseconds - before)
found["no tree"] = go.run(NavigateToPose.Goal(pose=stamped(1.0, 7.45), behavior_tree="other.xml"))

found["not finite"] = go.run(NavigateToPose.Goal(pose=stamped(float("nan"), 7.45)))

tree = "navigate_to_pose_w_replanning_and_recovery"
pathlib.Path(sys.argv[1] + ".xml").write_text("<root><BehaviorTree ID='Main'><Sequence_/></BehaviorTree></root>")
found["wrong tree"] = go.run(NavigateToPose.Goal(pose=stamped(1.0, 7.45), behavior_tree=sys.argv[1] + ".xml"))
found["tree"] = go.run(NavigateToPose.Goal(pose=stamped(1.4, 7.45), behavior_tree=tree))
running = go.send(NavigateToPose.Goal(pose=stamped(0.8, 7.45), behavior_tree=tree))
found["beside a tree"] = go.run(NavigateToPose.Goal(pose=stamped(1.0, 7.45)))
found["the tree goes on"] = go.end(running)[0]
found["without the tree"] = go.run(NavigateToPose.Goal(pose=stamped(1.6, 7.45)))

through = Action(NavigateThroughPoses, "navigate_through_poses")
status, result = through.end(through.send(NavigateThroughPoses.Goal(
    poses=Goals(goals=[stamped(2.4, 7.45), stamped(3.2, 7.45)]))))
found["through"] = [status, result.error_code, [one.waypoint_status for one in result.waypoint_statuses]]
found["left"] = [min(one.number_of_poses_remaining for one in through.feedback),
                 max(one.number_of_poses_remaining for one in through.feedback)]
found["through none"] = through.run(NavigateThroughPoses.Goal())

follow = Action(FollowWaypoints, "follow_waypoints")
status, result = follow.end(follow.send(FollowWaypoints.Goal(poses=[stamped(3.8, 7.45), stamped(4.4, 7.45)])))
found["waypoints"] = [status, result.error_code, len(result.missed_waypoints),
                      sorted({one.current_waypoint for one in follow.feedback})]
found["no waypoints"] = follow.run(FollowWaypoints.Goal())
"""
MOTIONS = """
import math
from nav2_msgs.action import BackUp, DriveOnHeading, FollowPath, Spin, Wait, NavigateToPose
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from nav_msgs.msg import Path

go = Action(NavigateToPose, "navigate_to_pose")
found["start"] = go.run(NavigateToPose.Goal(pose=stamped(2.0, 7.45)))
allowed = Duration(sec=30)
spin_ = Action(Spin, "spin")
found["spin"] = spin_.run(Spin.Goal(target_yaw=0.8, time_allowance=allowed))
found["turned"] = max(one.angular_distance_traveled for one in spin_.feedback)
found["spin too fast"] = spin_.run(Spin.Goal(target_yaw=6.0, time_allowance=Duration(sec=0, nanosec=200_000_000)))
found["spin nan"] = spin_.run(Spin.Goal(target_yaw=float("nan"), time_allowance=allowed))
found["turn back"] = spin_.run(Spin.Goal(target_yaw=-0.8, time_allowance=allowed))
ahead = Action(DriveOnHeading, "drive_on_heading")
found["ahead"] = ahead.run(DriveOnHeading.Goal(target=Point(x=0.3), speed=0.1, time_allowance=allowed))
found["sideways"] = ahead.run(DriveOnHeading.Goal(target=Point(x=0.3, y=0.1), speed=0.1, time_allowance=allowed))
found["other sign"] = ahead.run(DriveOnHeading.Goal(target=Point(x=0.3), speed=-0.1, time_allowance=allowed))
found["ahead nan"] = ahead.run(DriveOnHeading.Goal(target=Point(x=float("nan")), speed=0.1, time_allowance=allowed))
found["too far"] = ahead.run(DriveOnHeading.Goal(target=Point(x=1e30), speed=0.1, time_allowance=allowed))
found["into a wall"] = ahead.run(DriveOnHeading.Goal(target=Point(x=30.0), speed=0.3, time_allowance=Duration(sec=200)))
back = Action(BackUp, "backup")
found["back"] = back.run(BackUp.Goal(target=Point(x=0.3), speed=0.1, time_allowance=allowed))
found["driven"] = max(one.distance_traveled for one in back.feedback)
pause = Action(Wait, "wait")
handle = pause.send(Wait.Goal(time=Duration(sec=1)))
status, result = pause.end(handle)
found["wait"] = [status, result.error_code, result.total_elapsed_time.sec]
handle = pause.send(Wait.Goal(time=Duration(sec=100)))
spin(lambda: pause.feedback, "feedback of the wait")
wait(handle.cancel_goal_async(), "cancel")
found["wait canceled"] = [pause.end(handle)[0]]

follow = Action(FollowPath, "follow_path")
x, y = robot()
path = Path()
path.header.frame_id = "map"
path.poses = [stamped(x - 0.05 * i, y, math.pi) for i in range(30)]
found["follow"] = follow.run(FollowPath.Goal(path=path))
found["followed"] = [len(follow.feedback) > 0, abs(robot()[0] - (x - 1.45)) < 0.3]
found["no path"] = follow.run(FollowPath.Goal())
found["no controller"] = follow.run(FollowPath.Goal(path=path, controller_id="Other"))
handle = go.send(NavigateToPose.Goal(pose=stamped(11.0, 7.4)))
drive = handle.get_result_async()
spin(lambda: go.feedback, "feedback of the drive")
found["spin while driving"] = spin_.run(Spin.Goal(target_yaw=0.3, time_allowance=allowed))
ended = wait(drive, "the end of the drive")
found["drive replaced"] = [ended.status, ended.result.error_msg]
"""
PLANS = """
from nav2_msgs.action import ComputePathToPose, ComputePathThroughPoses, SmoothPath
from nav_msgs.msg import Goals

plan = Action(ComputePathToPose, "compute_path_to_pose")
status, result = plan.end(plan.send(ComputePathToPose.Goal(goal=stamped(6.0, 7.45), start=stamped(1.0, 7.45), use_start=True)))
path = result.path
found["plan"] = [status, result.error_code, len(path.poses), path.header.frame_id, path.poses[-1].pose.position.x]
found["outside"] = plan.run(ComputePathToPose.Goal(goal=stamped(600.0, 7.45)))
found["other planner"] = plan.run(ComputePathToPose.Goal(goal=stamped(6.0, 7.45), planner_id="Other"))
found["other frame"] = plan.run(ComputePathToPose.Goal(goal=stamped(6.0, 7.45, frame="nowhere")))
through = Action(ComputePathThroughPoses, "compute_path_through_poses")
status, result = through.end(through.send(ComputePathThroughPoses.Goal(
    goals=Goals(goals=[stamped(3.0, 7.45), stamped(6.0, 7.45)]), start=stamped(1.0, 7.45), use_start=True)))
found["through"] = [status, result.error_code, len(result.path.poses) > len(path.poses) // 2]
found["through none"] = through.run(ComputePathThroughPoses.Goal())
found["through outside"] = through.run(ComputePathThroughPoses.Goal(goals=Goals(goals=[stamped(600.0, 0.0)])))
smooth = Action(SmoothPath, "smooth_path")
status, result = smooth.end(smooth.send(SmoothPath.Goal(path=path)))
found["smooth"] = [status, result.error_code, result.was_completed, len(result.path.poses) > 10]
found["other smoother"] = smooth.run(SmoothPath.Goal(path=path, smoother_id="Other"))
found["smooth none"] = smooth.run(SmoothPath.Goal())
"""


@pytest.fixture(scope="module")
def drives(office: Graph) -> dict[str, Any]:
    return office.ask(DRIVES)


@pytest.fixture(scope="module")
def motions(office: Graph) -> dict[str, Any]:
    return office.ask(MOTIONS)


@pytest.fixture(scope="module")
def plans(office: Graph) -> dict[str, Any]:
    return office.ask(PLANS)


def test_a_goal_is_reached(drives: dict[str, Any]) -> None:
    assert drives["accepted"] and drives["reached"] == [SUCCEEDED, 0, ""]
    assert drives["at"] == pytest.approx([3.0, 7.45], abs=0.25)
    count, frame, first, last, seconds, recoveries = drives["feedback"]
    assert count > 5 and frame == "map" and last < first and seconds > 2 and recoveries == 0


def test_a_newer_goal_replaces_one(drives: dict[str, Any]) -> None:
    """As in Nav2 the earlier goal is aborted without a code."""
    assert drives["replaced"] == [ABORTED, 0, "replaced by a goal of navigate_to_pose"]
    assert drives["canceling"] == 1 and drives["canceled"] == [CANCELED]
    assert drives["after"][:2] == [SUCCEEDED, 0]


def test_goals_that_cannot_be_reached(drives: dict[str, Any]) -> None:
    status, code, text = drives["no frame"]
    assert status == ABORTED and code == 9002 and "nowhere" in text
    assert drives["seconds without a frame"] < 5.0  # not after recoveries
    status, code, text = drives["no tree"]
    assert status == ABORTED and code == 9001 and "other.xml" in text
    status, code, text = drives["not finite"]
    assert status == ABORTED and code == 9000 and "finite" in text


def test_a_goal_names_its_behavior_tree(drives: dict[str, Any]) -> None:
    assert drives["tree"] == [SUCCEEDED, 0, ""]
    status, code, text = drives["wrong tree"]
    assert status == ABORTED and code == 9001 and ".xml:1:" in text and "Sequence_" in text
    status, code, text = drives["beside a tree"]
    assert status == ABORTED and code == 9000 and "cancel the running goal first" in text
    assert drives["the tree goes on"] == SUCCEEDED and drives["without the tree"] == [SUCCEEDED, 0, ""]


def test_drives_through_poses(drives: dict[str, Any]) -> None:
    assert drives["through"] == [SUCCEEDED, 0, [1, 1]]
    assert drives["left"] == [1, 2]
    assert drives["through none"][:2] == [ABORTED, 9100] and "no poses" in drives["through none"][2]


def test_waypoints(drives: dict[str, Any]) -> None:
    assert drives["waypoints"] == [SUCCEEDED, 0, 0, [0, 1]]
    assert drives["no waypoints"][:2] == [ABORTED, 602] and "no poses" in drives["no waypoints"][2]


def test_motions(motions: dict[str, Any]) -> None:
    assert motions["spin"] == [SUCCEEDED, 0, ""] and motions["turned"] == pytest.approx(0.8, abs=0.15)
    assert motions["turn back"][0] == motions["ahead"][0] == SUCCEEDED
    assert motions["back"] == [SUCCEEDED, 0, ""] and motions["driven"] == pytest.approx(0.3, abs=0.06)
    assert motions["wait"][:2] == [SUCCEEDED, 0] and motions["wait"][2] >= 1
    assert motions["wait canceled"] == [CANCELED]


def test_motions_that_cannot_be_done(motions: dict[str, Any]) -> None:
    assert motions["spin too fast"][:2] == [ABORTED, 700] and "time_allowance" in motions["spin too fast"][2]
    assert motions["spin nan"][:2] == [ABORTED, 700] and "spin_dist = nan" in motions["spin nan"][2]
    assert motions["ahead nan"][:2] == [ABORTED, 724] and "nan" in motions["ahead nan"][2]
    assert motions["too far"][:2] == [ABORTED, 723]
    assert motions["sideways"][:2] == [ABORTED, 724] and "straight ahead" in motions["sideways"][2]
    assert motions["other sign"][:2] == [ABORTED, 724]
    assert motions["into a wall"][:2] == [ABORTED, 723] and motions["into a wall"][2]


def test_paths_are_followed(motions: dict[str, Any]) -> None:
    assert motions["follow"] == [SUCCEEDED, 0, ""] and motions["followed"] == [True, True]
    assert motions["no path"][:2] == [ABORTED, 103]
    assert motions["no controller"][:2] == [ABORTED, 101] and '"Other"' in motions["no controller"][2]


def test_a_motion_replaces_a_drive(motions: dict[str, Any]) -> None:
    assert motions["spin while driving"][:2] == [SUCCEEDED, 0]
    assert motions["drive replaced"] == [ABORTED, "replaced by a goal of spin"]


def test_plans(plans: dict[str, Any]) -> None:
    status, code, count, frame, x = plans["plan"]
    assert [status, code, frame] == [SUCCEEDED, 0, "map"] and count > 50 and x == pytest.approx(6.0, abs=0.1)
    assert plans["through"] == [SUCCEEDED, 0, True]
    assert plans["outside"][:2] == [ABORTED, 204]
    assert plans["through outside"][:2] == [ABORTED, 304]
    assert plans["other planner"][:2] == [ABORTED, 201] and plans["other frame"][:2] == [ABORTED, 202]
    assert plans["through none"][:2] == [ABORTED, 309]


def test_smoothing(plans: dict[str, Any]) -> None:
    assert plans["smooth"] == [SUCCEEDED, 0, True, True]
    assert plans["other smoother"][:2] == [ABORTED, 501] and plans["smooth none"][:2] == [ABORTED, 505]
