"""A robot that is commanded to move and does not: stopped, recovered, given up with the reason."""

from __future__ import annotations

import math

import pytest

from navstack.core import Pose2D, RobotState, Twist2D
from navstack.move_base.checks import StallCheck
from navstack.move_base.errors import NoProgressError
from tests.move_base.world import LIMITS, Bench, KinematicRobot, Waiting

TIMEOUT = 2.0
CYCLE = 0.2


class BlockedRobot(KinematicRobot):
    """Does not move while `blocked_from` <= time < `blocked_until` (s), whatever it is commanded."""

    blocked_from = 1.0
    blocked_until = math.inf

    @property
    def is_blocked(self) -> bool:
        return self.blocked_from <= self.time < self.blocked_until

    def advance_to(self, time: float) -> None:
        twist = self.twist
        self.twist = Twist2D() if self.is_blocked else twist
        super().advance_to(time)
        self.twist = twist

    def state(self) -> RobotState:
        state = super().state()
        return state._replace(velocity=Twist2D()) if self.is_blocked else state


def blocked_bench(until: float = math.inf, timeout: float = TIMEOUT, recoveries: int = 2) -> Bench:
    bench = Bench(
        recoveries=[Waiting(f"wait_{i}", 1.0, frequency=20.0) for i in range(recoveries)], oscillation_timeout=0.0
    )
    bench.robot.__class__ = BlockedRobot
    bench.robot.blocked_until = until  # pyright: ignore[reportAttributeAccessIssue]
    bench.move_base.stall_timeout_s = timeout
    return bench


def pushes(bench: Bench) -> list[float]:
    """Durations (s) of the commanded motions while the robot is blocked."""
    found: list[float] = []
    since = None
    for time, twist in [*bench.robot.commands, (bench.robot.time, Twist2D())]:
        if time < BlockedRobot.blocked_from:
            continue
        if since is None and twist != Twist2D():
            since = time
        elif since is not None and twist == Twist2D():
            found.append(time - since)
            since = None
    return found


def test_a_blocked_robot_is_stopped_and_the_goal_ends_with_the_reason() -> None:
    bench = blocked_bench()
    handle = bench.run(bench.move_base.send_goal(Pose2D(5.0, 0.0, 0.0)))
    assert handle.status.name == "ABORTED"
    assert handle.result.error_name == "FAILED_TO_MAKE_PROGRESS"
    assert handle.result.message.startswith("the robot does not move: for 2.")
    assert handle.result.recovery_names == ("wait_0", "wait_1")  # each of them once
    found = pushes(bench)
    assert len(found) == 5  # two of them are the turns of the recoveries
    assert max(found) <= TIMEOUT + 1.0 + CYCLE
    texts = [event.text for event in bench.listener.events if event.kind == "control_failed"]
    assert all("it may push against something" in text for text in texts)


def test_a_robot_that_is_only_commanded_sideways_is_told_so() -> None:
    check, still = StallCheck(), RobotState(Pose2D(0.0, 0.0, 0.0), Twist2D())
    with pytest.raises(NoProgressError, match=r"cannot drive sideways: set holonomic_robot: false .* max_vel_y: 0"):
        for step in range(40):
            check.check(still, Twist2D(0.0, -0.1, 0.0), LIMITS, TIMEOUT, 0.2 * step)


def test_no_timeout_no_check() -> None:
    bench = blocked_bench(timeout=0.0)
    handle = bench.move_base.send_goal(Pose2D(5.0, 0.0, 0.0))
    bench.run_to(60.0)
    assert not handle.is_done
    assert pushes(bench) == [pytest.approx(59.0, abs=CYCLE)]


def test_a_short_stop_is_no_stall() -> None:
    bench = blocked_bench(until=2.8)
    handle = bench.run(bench.move_base.send_goal(Pose2D(5.0, 0.0, 0.0)))
    assert handle.status.name == "SUCCEEDED"
    assert not [event for event in bench.listener.events if event.kind == "control_failed"]


def test_a_robot_that_comes_free_drives_on_after_the_recovery() -> None:
    bench = blocked_bench(until=6.0)
    handle = bench.run(bench.move_base.send_goal(Pose2D(5.0, 0.0, 0.0)))
    assert handle.status.name == "SUCCEEDED"
    assert handle.result.recovery_names == ("wait_0",)


def test_a_new_goal_is_tried_again() -> None:
    bench = blocked_bench(until=5.0)
    bench.move_base.send_goal(Pose2D(5.0, 0.0, 0.0))
    bench.run_to(5.0)
    handle = bench.run(bench.move_base.send_goal(Pose2D(4.0, 0.0, 0.0)))
    assert handle.status.name == "SUCCEEDED"
    assert handle.result.recovery_names == ()


@pytest.mark.parametrize(
    ("sent", "velocity", "stalls"),
    [
        (Twist2D(0.3), Twist2D(), True),
        (Twist2D(-0.3), Twist2D(0.01, 0.0, 0.02), True),
        (Twist2D(0.0, 0.0, 0.5), Twist2D(), True),
        (Twist2D(0.3), Twist2D(0.2), False),  # the odometry measures motion
        (Twist2D(0.3, 0.0, 0.5), Twist2D(0.0, 0.0, 0.3), False),
        (Twist2D(), Twist2D(), False),
        (Twist2D(0.06), Twist2D(), False),  # below min_vel_trans
        (Twist2D(0.04, 0.0, 0.3), Twist2D(), False),  # both below the lowest velocities: a dead band
    ],
)
def test_commands_that_are_expected_to_move_a_robot(sent: Twist2D, velocity: Twist2D, stalls: bool) -> None:
    check = StallCheck()
    error = None
    for i in range(200):
        try:
            check.check(RobotState(Pose2D(1.0, 2.0, 0.3), velocity), sent, LIMITS, TIMEOUT, 0.05 * i)
        except NoProgressError as exc:
            error = exc
            break
    assert (error is not None) == stalls
    if error is not None:
        assert TIMEOUT <= error.data["seconds"] <= TIMEOUT + 1.0 + 0.05
        with pytest.raises(NoProgressError):  # until it is reset, even without a command
            check.check(RobotState(Pose2D(1.0, 2.0, 0.3)), Twist2D(), LIMITS, TIMEOUT, 20.0)


def test_a_creeping_robot_is_not_stalled() -> None:
    """The slowest expected motion: 0.05 m/s, or 0.2 rad/s, well above what is measured as motion in the timeout."""
    for speed, turn in ((0.1, 0.0), (0.0, 0.4)):
        check = StallCheck()
        for i in range(400):
            time = 0.05 * i
            state = RobotState(Pose2D(0.3 * speed * time, 0.0, 0.3 * turn * time))
            check.check(state, Twist2D(speed, 0.0, turn), LIMITS, TIMEOUT, time)
