"""A robot that does not know where it is: stopped, recovered, given up with the reason, planned again when it is found."""

from __future__ import annotations

from typing import Any

import pytest

from navstack.behaviors import SpinToLocalize, SpinToLocalizeParams
from navstack.core import Pose2D, Twist2D
from navstack.move_base import GoalStatus, states
from navstack.plugins import LocalizationStatus, RecoveryContext, RecoveryStatus
from tests.move_base.world import Bench, EmptyCostmap, KinematicRobot, TurnAndGo, Waiting

LOST = LocalizationStatus(True, 0.9, 0.12, "lost since 0.9 s: the map explains 12% of the scan")
GOAL = Pose2D(3.0, 0.0, 0.0)


class LocalizingRobot(KinematicRobot):
    """Is lost while `lost_from` <= time < `lost_until` (s)."""

    lost_from = 1.0
    lost_until = 4.0
    answer: Any = None

    @property
    def localization_status(self) -> Any:
        self.broken("localization_status")
        lost = self.lost_from <= self.time < self.lost_until
        return self.answer or (LOST if lost else LocalizationStatus())


def bench_of(action: Any = "recover", until: float = 4.0, recoveries: int = 0, timeout: float = 60.0) -> Bench:
    bench = Bench(recoveries=[Waiting(f"wait_{i}", 1.0, frequency=20.0) for i in range(recoveries)])
    bench.robot.__class__ = LocalizingRobot
    bench.robot.lost_until = until  # pyright: ignore[reportAttributeAccessIssue]
    bench.move_base.lost.action, bench.move_base.lost.timeout_s = action, timeout
    return bench


def commands(bench: Bench, begin: float, end: float) -> set[Twist2D]:
    return {twist for time, twist in bench.robot.commands if begin <= time < end}


def resets_of(bench: Bench) -> list[int]:
    layers: list[Any] = [*bench.global_costmap.layers, *bench.local_costmap.layers]
    return [len(layer.resets) for layer in layers]


def test_it_waits_and_plans_anew_when_it_is_found() -> None:
    bench = bench_of("stop", until=3.5, recoveries=1)
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(3.4)
    assert commands(bench, 1.2, 3.4) == {Twist2D()}
    assert bench.move_base.recovery is None
    resets = resets_of(bench)
    plans = len(bench.planner.calls)  # pyright: ignore[reportAttributeAccessIssue]
    bench.run(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    # what was marked in the map from wrong poses is forgotten; the local costmap is in the frame of the odometry
    assert [b - a for a, b in zip(resets, resets_of(bench), strict=True)] == [1, 1, 0, 0]
    assert len(bench.planner.calls) > plans  # pyright: ignore[reportAttributeAccessIssue]
    (warned,) = bench.listener.of("warning")
    assert (warned.text, warned.data["name"]) == (LOST.text, "LOST")
    assert (warned.data["since"], warned.data["explained"]) == (0.9, 0.12)
    (found,) = [e for e in bench.listener.of("info") if "lost" in e.data]
    assert found.text == "the robot is localized again, after 2.6 s"
    assert found.time in bench.global_costmap.updates  # before it plans


@pytest.mark.parametrize(("action", "recoveries"), [("stop", 2), ("recover", 2), ("recover", 0)])
def test_it_is_given_up_after_its_time(action: str, recoveries: int) -> None:
    bench = bench_of(action, until=1e9, recoveries=recoveries, timeout=5.0)
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert (handle.status, handle.text) == (GoalStatus.ABORTED, states.LOST)
    result = handle.result
    assert (result.error_code, result.error_name) == (9025, "LOST")
    assert LOST.text in result.message
    assert "lost_timeout 5 s" in result.message
    assert bench.robot.time == pytest.approx(6.0, abs=0.41)  # two control cycles
    expected = [f"wait_{i}" for i in range(recoveries)] if action == "recover" else []
    assert list(result.recovery_names) == expected
    if expected:
        assert {e.data["trigger"] for e in bench.listener.of("recovery")} == {"LOST_R"}


def test_a_recovery_ends_when_the_robot_is_found() -> None:
    bench = bench_of(until=2.5, recoveries=2)
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert handle.status is GoalStatus.SUCCEEDED
    assert list(handle.result.recovery_names) == ["wait_0", "wait_1"]
    assert bench.move_base.recovery_index == 0
    assert commands(bench, 2.6, 3.2) != {Twist2D()}


def test_ignored_as_in_ros() -> None:
    bench = bench_of("ignore", until=1e9)
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert handle.status is GoalStatus.SUCCEEDED
    assert [e.text for e in bench.listener.of("warning")] == [LOST.text]


def test_a_robot_that_reports_nothing_or_nonsense_drives_on() -> None:
    for answer, raises, text in (
        ("maybe", None, "has a localization_status of type str, not LocalizationStatus"),
        (None, OSError("no driver"), "raised OSError: no driver"),
    ):
        bench = bench_of(until=0.0)
        bench.robot.answer = answer  # pyright: ignore[reportAttributeAccessIssue]

        def broken(what: str, error: Exception | None = raises) -> None:
            if what == "localization_status" and error is not None:
                raise error

        bench.robot.broken = broken
        assert bench.run(bench.move_base.send_goal(GOAL)).status is GoalStatus.SUCCEEDED
        (warned,) = bench.listener.of("warning")
        assert text in warned.text


@pytest.mark.parametrize(
    ("status", "found_after", "ended", "turn"),
    [
        (LOST, 2.0, RecoveryStatus.DONE, 1.2),
        (LOST, 1e9, RecoveryStatus.FAILED, 6.28),
        (LocalizationStatus(), 0.0, RecoveryStatus.DONE, 0.0),
        (None, 1e9, RecoveryStatus.DONE, 6.28),
    ],
)
def test_spin_to_localize(
    status: LocalizationStatus | None, found_after: float, ended: RecoveryStatus, turn: float
) -> None:
    robot = KinematicRobot()
    context = RecoveryContext(
        EmptyCostmap("global_costmap", "map", robot),
        EmptyCostmap("local_costmap", "odom", robot),
        TurnAndGo(),
        10.0,
        lambda: LocalizationStatus() if robot.time >= found_after else status,
    )
    spin = SpinToLocalize("localize", SpinToLocalizeParams())
    spin.start(context, 0.0)
    turned, step = 0.0, None
    for k in range(1, 200):
        step = spin.step(robot.state(), robot.time)
        if step.status is not RecoveryStatus.RUNNING:
            break
        robot.command(step.twist)
        turned += step.twist.wz * 0.1
        robot.advance_to(0.1 * k)
    assert step is not None
    assert step.status is ended
    assert turned == pytest.approx(turn, abs=0.13)
    assert ("still lost: lost since 0.9 s" in step.text) == (ended is RecoveryStatus.FAILED)
