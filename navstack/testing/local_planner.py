"""The contract of local planners, on an ideal robot."""

from __future__ import annotations

import json
import math
from typing import Any, ClassVar, Final

import numpy as np
import pytest

from navstack.core import (
    LETHAL,
    ControlError,
    InvalidPathError,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    angle_between,
    normalize_angle,
)
from navstack.plugins import ControlInput, LocalPlanner
from navstack.testing.base import Contract, contract_of
from navstack.testing.doubles import FOOTPRINT, control_input, driven, local_costmap, straight_path

SLACK: Final = 1e-6
"""Planners may keep velocities in float32."""
DWA_SLACK: Final = 1e-4
"""Tolerance of C++ for the translational limits."""


class LocalPlannerContract(Contract):
    """What every local planner must do."""

    frequency: ClassVar[float] = 5.0
    """Control cycles per second (Hz)."""
    goal_tolerance: ClassVar[float] = 0.2
    """Distance (m) to the goal at which the planner may say that it is reached."""

    @classmethod
    def make(cls, **values: Any) -> LocalPlanner:
        """The planner."""
        return cls.plugin(cls.params(controller_frequency=cls.frequency, **values))

    def drive(self, planner: LocalPlanner, start: Pose2D, goal: Pose2D, seconds: float = 60.0) -> Pose2D:
        """Follow a straight path until the goal is reached; every command must respect the limits."""
        planner.set_plan(straight_path(start, goal), goal)
        pose, velocity, period = start, Twist2D(), 1.0 / self.frequency
        for _ in range(math.ceil(seconds * self.frequency)):
            inputs = control_input(pose, velocity)
            if planner.goal_reached(inputs):
                return pose
            velocity = planner.compute_command(inputs).command
            self.check_limits(planner, velocity)
            pose = driven(pose, velocity, period)
        raise AssertionError(f"{goal} is not reached within {seconds} s; the robot is at {pose}")

    @staticmethod
    def check_limits(planner: LocalPlanner, command: Twist2D) -> None:
        """A command within the limits that the planner itself states."""
        limits = planner.limits
        assert command.is_finite()
        assert min(0.0, limits.min_vel_x) - SLACK <= command.vx <= max(0.0, limits.max_vel_x) + SLACK
        assert min(0.0, limits.min_vel_y) - SLACK <= command.vy <= max(0.0, limits.max_vel_y) + SLACK
        assert abs(command.wz) <= limits.max_vel_theta + SLACK
        assert command.speed <= limits.max_vel_trans + DWA_SLACK + SLACK
        assert abs(command.wz) * limits.min_turning_radius <= abs(command.vx) + SLACK

    @pytest.mark.parametrize("heading", [2.0 * math.pi * i / 16 for i in range(16)])
    def test_it_reaches_a_free_goal_from_any_heading(self, heading: float) -> None:
        """Position within the tolerance, heading within the planner's own."""
        planner = self.make()
        goal = Pose2D(1.0, 0.4, 0.5)
        end = self.drive(planner, Pose2D(0.0, 0.0, normalize_angle(heading)), goal)
        assert end.distance_to(goal) <= self.goal_tolerance + 1e-9
        assert abs(angle_between(end.yaw, goal.yaw)) <= planner.limits.yaw_goal_tolerance + 1e-9

    def test_braking_after_a_cancel_ends(self) -> None:
        """`brake` never speeds up, keeps to the limits, and returns None within five seconds."""
        planner = self.make()
        start, goal = Pose2D(0.0, 0.0), Pose2D(1.5, 0.0)
        planner.set_plan(straight_path(start, goal), goal)
        pose, velocity, period = start, Twist2D(), 1.0 / self.frequency
        for _ in range(round(self.frequency)):
            velocity = planner.compute_command(control_input(pose, velocity)).command
            pose = driven(pose, velocity, period)
        for _ in range(math.ceil(5.0 * self.frequency) + 1):
            plan = planner.brake(control_input(pose, velocity))
            if plan is None:
                return
            assert plan.command.speed <= velocity.speed + SLACK and abs(plan.command.wz) <= abs(velocity.wz) + SLACK
            self.check_limits(planner, plan.command)
            velocity = plan.command
            pose = driven(pose, velocity, period)
        raise AssertionError("the planner still brakes after 5 s")

    def test_replanning_to_the_same_goal(self) -> None:
        """A new plan in every cycle does not prevent the arrival."""
        planner = self.make()
        goal = Pose2D(1.0, 0.3, -0.6)
        pose, velocity = Pose2D(0.0, 0.0, 0.0), Twist2D()
        for _ in range(150):
            planner.set_plan(straight_path(pose, goal), goal)
            if planner.goal_reached(control_input(pose, velocity)):
                return
            velocity = planner.compute_command(control_input(pose, velocity)).command
            pose = driven(pose, velocity, 1.0 / self.frequency)
        raise AssertionError(f"not reached: {pose}")

    def test_a_far_goal_is_not_reached(self) -> None:
        """Before a plan and with one."""
        planner = self.make()
        goal = Pose2D(1.0, 0.0, 0.0)
        assert not planner.goal_reached(control_input(Pose2D(0.0, 0.0)))
        planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
        assert not planner.goal_reached(control_input(Pose2D(0.0, 0.0)))

    def test_it_never_drives_into_a_wall(self) -> None:
        """A wall across the path: the robot stops before it, or the planner raises a ControlError."""
        wall = tuple((0.8, 0.025 + 0.05 * i) for i in range(-30, 30))
        for heading in np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False).tolist():
            planner = self.make()
            pose, velocity, goal = Pose2D(0.0, 0.0, normalize_angle(heading)), Twist2D(), Pose2D(1.6, 0.0, 0.0)
            planner.set_plan(straight_path(pose, goal), goal)
            for _ in range(60):
                inputs = control_input(pose, velocity, wall)
                try:
                    plan = planner.compute_command(inputs)
                except ControlError:
                    velocity = Twist2D()
                    continue
                for row in plan.trajectory if plan.trajectory is not None else ():
                    for x, y in FOOTPRINT.at(Pose2D(*row)):
                        assert inputs.costmap.cost_at(float(x), float(y)) != LETHAL
                velocity = plan.command
                pose = driven(pose, velocity, 1.0 / self.frequency)
                assert pose.x + FOOTPRINT.inscribed_radius < 0.85

    def test_no_command_if_every_motion_collides(self) -> None:
        """A ring of obstacles at the footprint: NO_VALID_CONTROL (106) with data that JSON can hold."""
        planner = self.make()
        goal = Pose2D(1.5, 0.0, 0.0)
        planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
        ring = [(0.18 * math.cos(a), 0.18 * math.sin(a)) for a in np.linspace(0.0, 2.0 * math.pi, 100).tolist()]
        with pytest.raises(ControlError) as caught:
            planner.compute_command(control_input(Pose2D(0.0, 0.0), lethal=ring))
        assert caught.value.code == 106 and caught.value.message
        json.dumps(caught.value.as_dict(), allow_nan=False)

    def test_speed_limits_are_applied_and_restored(self) -> None:
        """`set_limits` lowers the speeds, zero stops, None restores."""
        planner = self.make()
        before = planner.limits
        goal = Pose2D(1.8, 0.0, 0.0)
        planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
        planner.set_limits(max_vel_trans=0.2, max_vel_theta=0.3)
        pose, velocity, fastest = Pose2D(0.0, 0.0, 0.4), Twist2D(0.5, 0.0, 0.0), 0.0
        for cycle in range(15):
            velocity = planner.compute_command(control_input(pose, velocity)).command
            pose = driven(pose, velocity, 1.0 / self.frequency)
            if cycle > 2:
                fastest = max(fastest, velocity.speed)
                assert abs(velocity.wz) <= 0.3 + SLACK
        assert 0.0 < fastest <= 0.2 + DWA_SLACK + SLACK
        planner.set_limits()
        assert planner.limits == before

    def test_paths_that_cannot_be_followed(self) -> None:
        """No plan, an empty plan, a plan or goal that is not finite: a ControlError."""
        planner = self.make()
        goal = Pose2D(1.0, 0.0)
        with pytest.raises(ControlError):
            planner.compute_command(control_input(Pose2D(0.0, 0.0)))
        path = straight_path(Pose2D(0.0, 0.0), goal)
        with pytest.raises(InvalidPathError):
            planner.set_plan(type(path)(np.empty((0, 3)), "odom"), goal)
        for value in (math.nan, math.inf):
            poses = path.poses.copy()
            poses[3, 1] = value
            with pytest.raises(InvalidPathError):
                planner.set_plan(type(path)(poses, "odom"), goal)
        with pytest.raises(ControlError):
            planner.set_plan(path, Pose2D(math.nan, 0.0, 0.0))

    @pytest.mark.parametrize("bad", [math.nan, math.inf])
    def test_states_that_are_not_finite(self, bad: float) -> None:
        """A ControlError, not a command."""
        planner = self.make()
        goal = Pose2D(1.0, 0.0)
        planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
        costmap = local_costmap(Pose2D(0.0, 0.0))
        for state in (RobotState(Pose2D(0.0, bad)), RobotState(Pose2D(0.0, 0.0), Twist2D(0.0, 0.0, bad))):
            with pytest.raises(ControlError):
                planner.compute_command(ControlInput(state, costmap, FOOTPRINT))

    def test_a_plan_in_another_frame(self) -> None:
        """A plan in a frame that is moved and turned against the costmap's gives the same command."""
        goal, start = Pose2D(1.0, 0.4, 0.3), Pose2D(0.0, 0.0, 0.2)
        odom_from_map = Transform2D(0.7, -1.1, 0.8)
        here, there = self.make(), self.make()
        here.set_plan(straight_path(start, goal), goal)
        back = odom_from_map.inverse()
        there.set_plan(straight_path(start, goal).transformed(back, "map"), back.apply(goal))
        inputs = control_input(start)
        moved = ControlInput(inputs.state, inputs.costmap, FOOTPRINT, odom_from_map)
        a, b = here.compute_command(inputs).command, there.compute_command(moved).command
        assert tuple(a) == pytest.approx(tuple(b), abs=1e-9)

    def test_it_is_reproducible(self) -> None:
        """Two planners in the same run agree to the bit."""
        runs: list[list[bytes]] = []
        for _ in range(2):
            planner = self.make()
            goal = Pose2D(1.2, 0.6, 1.0)
            planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
            pose, velocity, commands = Pose2D(0.0, 0.0, -0.4), Twist2D(), list[bytes]()
            for _ in range(30):
                velocity = planner.compute_command(control_input(pose, velocity)).command
                commands.append(np.array(velocity).tobytes())
                pose = driven(pose, velocity, 1.0 / self.frequency)
            runs.append(commands)
        assert runs[0] == runs[1]


def local_planner_contract(plugin: type[LocalPlanner], **values: Any) -> type[LocalPlannerContract]:
    """The suite for a local planner."""
    return contract_of(LocalPlannerContract, plugin, values)
