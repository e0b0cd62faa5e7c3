"""Waypoint tasks of BasicNavigator: loops, begin, executors, missed waypoints, the report of each."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from navstack.behaviors import InputAtWaypoint, NoWaypointsError, PhotoAtWaypoint, WaitAtWaypoint, WaypointStatus
from navstack.bringup import TaskResult
from navstack.core import InputError, NavError, Pose2D
from tests.test_basic_navigator import NavigatorBench, only_near

A, B, C = Pose2D(1.0, 0.0), Pose2D(1.0, 1.0), Pose2D(0.0, 1.0)
FAR = Pose2D(3.0, 0.0)


def test_loops_and_the_first_waypoint() -> None:
    world = NavigatorBench()
    visits: list[int] = []
    world.navigator.followWaypoints(
        [A, B, C], number_of_loops=1, goal_index=1, executor=lambda index, pose: visits.append(index)
    )
    assert world.run() is TaskResult.SUCCEEDED
    assert visits == [1, 2, 0, 1, 2]
    report = world.navigator.waypoint_report
    assert [(r.loop, r.waypoint_index) for r in report] == [(0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]
    assert {r.waypoint_status for r in report} == {WaypointStatus.COMPLETED}
    assert all(a.ended_s == b.started_s for a, b in pairwise(report))
    assert report[0].as_dict()["waypoint_pose"] == [1.0, 1.0, 0.0]


def test_a_pause_takes_its_time_and_the_robot_stands() -> None:
    times: list[float] = []
    for duration in (0.0, 2.0):
        world = NavigatorBench()
        world.navigator.followWaypoints([A, B], executor=WaitAtWaypoint(duration))
        assert world.run() is TaskResult.SUCCEEDED
        times.append(world.navigator.waypoint_report[-1].ended_s)
    assert times[1] - times[0] == pytest.approx(4.0, abs=0.3)


def test_missed_waypoints_have_code_and_text() -> None:
    world = NavigatorBench(planner=only_near(2.0))
    world.navigator.followWaypoints([A, FAR, C])
    assert world.run() is TaskResult.FAILED
    statuses = [r.waypoint_status for r in world.navigator.waypoint_report]
    assert statuses == [WaypointStatus.COMPLETED, WaypointStatus.FAILED, WaypointStatus.COMPLETED]
    missed = world.navigator.waypoint_report[1]
    assert missed.error_code == 206
    assert missed.error_msg


def test_stop_on_failure_names_what_was_skipped() -> None:
    world = NavigatorBench(planner=only_near(2.0))
    world.navigator.followWaypoints([FAR, A, C], stop_on_failure=True)
    assert world.run() is TaskResult.FAILED
    assert [r.waypoint_status.value for r in world.navigator.waypoint_report] == [3, 2, 2]
    code, text = world.navigator.getTaskError()
    assert code == 603
    assert text.startswith("waypoint 0 was missed: ")


def refused(index: int, pose: Pose2D) -> bool:
    return False


def broken(index: int, pose: Pose2D) -> bool:
    raise ValueError("the gripper is cold")


@pytest.mark.parametrize(
    ("executor", "why"),
    [
        (refused, "the task at waypoint 0 failed"),
        (broken, "the task at waypoint 0 failed: ValueError: the gripper is cold"),
        (
            InputAtWaypoint(lambda: False, 1.5),
            "the task at waypoint 0 failed: no input came within its timeout of 1.5 s",
        ),
    ],
)
@pytest.mark.parametrize("stop", [False, True])
def test_a_task_that_fails(executor: Any, why: str, stop: bool) -> None:
    world = NavigatorBench()
    world.navigator.followWaypoints([A, B], executor=executor, stop_on_failure=stop)
    assert world.run() is TaskResult.FAILED
    first = world.navigator.waypoint_report[0]
    assert (first.error_code, first.error_msg) == (601, why)
    assert world.navigator.getTaskError()[0] == 601
    assert world.navigator.missed_waypoints == ([0] if stop else [0, 1])


def test_input_ends_the_wait() -> None:
    world = NavigatorBench()
    asked: list[int] = []

    def ready() -> bool:
        asked.append(1)
        return len(asked) >= 5

    world.navigator.followWaypoints([A], executor=InputAtWaypoint(ready))
    assert world.run() is TaskResult.SUCCEEDED
    assert len(asked) == 5
    with pytest.raises(InputError, match=r"timeout is 0\.0 s"):
        InputAtWaypoint(ready, 0.0)


def test_photos(tmp_path: Path) -> None:
    from PIL import Image

    world = NavigatorBench()
    shots = iter(range(1, 10))
    camera: Any = lambda: SimpleNamespace(rgb=np.full((4, 6, 3), next(shots), np.uint8))  # noqa: E731
    photo = PhotoAtWaypoint(camera, tmp_path / "photos")
    world.navigator.followWaypoints([A, B], number_of_loops=1, executor=photo)
    assert world.run() is TaskResult.SUCCEEDED
    assert [file.name for file in photo.taken] == [
        "waypoint_0.png",
        "waypoint_1.png",
        "waypoint_0_2.png",
        "waypoint_1_3.png",
    ]
    assert np.asarray(Image.open(photo.taken[2]))[0, 0].tolist() == [3, 3, 3]


def test_cancel_at_a_waypoint() -> None:
    world = NavigatorBench()
    world.navigator.followWaypoints([A, B], executor=WaitAtWaypoint(100.0))
    while not world.navigator.isTaskComplete() and world.bench.robot.time < 30.0:
        feedback = world.navigator.getFeedback()
        assert feedback is not None
        assert feedback.current_waypoint == 0
    world.navigator.cancelTask()
    assert world.navigator.getResult() is TaskResult.CANCELED


@pytest.mark.parametrize(
    "arguments", [{"poses": []}, {"poses": [A], "goal_index": 1}, {"poses": [A], "number_of_loops": -1}]
)
def test_wrong_waypoints(arguments: dict[str, Any]) -> None:
    with pytest.raises(NoWaypointsError) as error:
        NavigatorBench().navigator.followWaypoints(**arguments)
    assert error.value.code == 602
    assert isinstance(error.value, NavError)
