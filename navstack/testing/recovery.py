"""The contract of recovery behaviors."""

from __future__ import annotations

import math
from typing import Any

from navstack.core import NavError, Pose2D, RobotState, Twist2D
from navstack.plugins import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.testing.base import Contract, contract_of
from navstack.testing.doubles import EmptyCostmap, IdealRobot, StopPlanner

TIME_LIMIT_S = 120.0


class RecoveryContract(Contract):
    """What every recovery behavior must do in free space."""

    @classmethod
    def make(cls) -> RecoveryBehavior:
        """The behavior."""
        return cls.plugin("under_test", cls.params())

    @staticmethod
    def scene() -> tuple[IdealRobot, RecoveryContext]:
        """A robot in the middle of empty costmaps, a controller at 5 Hz."""
        robot = IdealRobot(Pose2D(0.5, -0.5, 1.0))
        costmaps = EmptyCostmap("global_costmap", "map", robot), EmptyCostmap("local_costmap", "odom", robot)
        return robot, RecoveryContext(*costmaps, StopPlanner(), 5.0)

    @staticmethod
    def run(recovery: RecoveryBehavior, robot: IdealRobot, context: RecoveryContext) -> list[RecoveryStep]:
        """Step it at its frequency until it ends."""
        start = robot.time
        recovery.start(context, start)
        frequency = recovery.frequency or context.controller_frequency
        steps: list[RecoveryStep] = []
        while True:
            steps.append(recovery.step(robot.state(), robot.time))
            robot.command(steps[-1].twist)
            if steps[-1].status is not RecoveryStatus.RUNNING:
                return steps
            robot.advance_to(start + len(steps) / frequency)
            assert robot.time < start + TIME_LIMIT_S, "the behavior does not end"

    def test_it_ends_with_a_text_and_legal_commands(self) -> None:
        """It is DONE in free space, within the speed limits, and stops at the end."""
        robot, context = self.scene()
        recovery = self.make()
        recovery.check(context)
        steps = self.run(recovery, robot, context)
        assert steps[-1].status is RecoveryStatus.DONE
        assert steps[-1].twist == Twist2D()
        assert any(step.text for step in steps)
        limits = context.local_planner.limits
        for step in steps:
            assert all(math.isfinite(v) for v in step.twist)
            assert abs(step.twist.wz) <= limits.max_vel_theta + 1e-9
            assert step.twist.speed <= limits.max_vel_trans + 1e-9

    def test_it_can_be_used_again(self) -> None:
        """A second use in the same scene gives the same steps."""
        recovery = self.make()
        first = self.run(recovery, *self.scene())
        second = self.run(recovery, *self.scene())
        assert [(s.status, s.twist, s.text) for s in first] == [(s.status, s.twist, s.text) for s in second]

    def test_it_can_be_interrupted(self) -> None:
        """After an interruption a new start behaves as the first."""
        recovery = self.make()
        robot, context = self.scene()
        recovery.start(context, 0.0)
        recovery.step(robot.state(), 0.0)
        assert self.run(recovery, *self.scene())[-1].status is RecoveryStatus.DONE

    def test_its_follow_up_ends(self) -> None:
        """`follow_up` returns False at the latest when the robot has driven on."""
        recovery = self.make()
        robot, context = self.scene()
        self.run(recovery, robot, context)
        x, y, yaw = robot.pose
        calls = [recovery.follow_up(RobotState(Pose2D(x + 0.1 * k, y, yaw)), 0.2 * k) for k in range(1000)]
        assert not calls[-1]

    def test_an_unknown_pose_is_a_nav_error(self) -> None:
        """Without a transform to the base it may fail, but only with a NavError."""
        robot, context = self.scene()
        robot.frames.remove("base_link")
        recovery = self.make()
        try:
            recovery.start(context, 0.0)
            recovery.step(robot.state(), 0.0)
        except NavError as error:
            assert error.message


def recovery_contract(plugin: type[RecoveryBehavior], **values: Any) -> type[RecoveryContract]:
    """The suite for a recovery behavior."""
    return contract_of(RecoveryContract, plugin, values)
