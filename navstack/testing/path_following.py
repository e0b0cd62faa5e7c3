"""The contracts of goal checkers, progress checkers and path handlers."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import pytest

from navstack.core import GridGeometry, InvalidPathError, Path, Pose2D, Transform2D, Twist2D, angle_between
from navstack.plugins import Approach, GoalChecker, LocalPath, PathHandler, PluginSection, ProgressChecker
from navstack.testing.base import Contract, contract_of
from navstack.testing.doubles import driven, straight_path

SMALL: Final = 1e-6
WINDOW: Final = GridGeometry(80, 80, 0.05, -2.0, -2.0)
"""A local costmap of 4 m around the origin."""


class _SectionContract(Contract):
    """What all plugins with a namespace of their own (`goal_checker: {plugin: ..}`) must do."""

    @classmethod
    def make(cls) -> Any:
        """The plugin."""
        return cls.plugin(cls.params())

    def test_the_namespace_names_its_plugin(self) -> None:
        """The parameter model is a PluginSection, and its `plugin` is a name of this plugin."""
        assert issubclass(self.plugin.Params, PluginSection)
        assert self.plugin.Params().plugin


class GoalCheckerContract(_SectionContract):
    """What every goal checker must do."""

    @staticmethod
    def approach(pose: Pose2D, goal: Pose2D, velocity: Twist2D = Twist2D(), loop_m: float = 0.0) -> Approach:
        """On a straight path to the goal, along x; `loop_m` more meters of it are left."""
        path = straight_path(Pose2D(goal.x - 1.0, goal.y), goal).poses
        return Approach(pose, goal, velocity, path, pose.distance_to(goal) + loop_m)

    def settle(self, checker: GoalChecker, approach: Approach, cycles: int = 40) -> bool:
        """Ask in some cycles, as a robot that stands still does."""
        return any(checker.reached(approach) for _ in range(cycles))

    def test_a_robot_at_its_goal_has_reached_it(self) -> None:
        """Exactly there, standing still."""
        goal = Pose2D(0.7, -0.3, 0.4)
        assert self.settle(self.make(), self.approach(goal, goal))

    def test_a_far_robot_has_not(self) -> None:
        """Three meters away, for any heading and cycle."""
        checker: GoalChecker = self.make()
        goal = Pose2D(3.0, 0.0, 0.0)
        assert not self.settle(checker, self.approach(Pose2D(0.0, 0.0), goal))

    def test_the_tolerances_are_those_that_it_states(self) -> None:
        """Within them at the goal, well beyond them not."""
        goal = Pose2D(0.0, 0.0, 0.0)
        checker: GoalChecker = self.make()
        assert math.isfinite(checker.xy_tolerance) and checker.xy_tolerance > 0.0
        assert 0.0 < checker.yaw_tolerance <= math.pi
        assert self.settle(self.make(), self.approach(Pose2D(-0.9 * checker.xy_tolerance, 0.0), goal))
        assert not self.settle(self.make(), self.approach(Pose2D(-2.0 * checker.xy_tolerance - 0.01, 0.0), goal))
        if checker.yaw_tolerance < 1.0:
            for side in (-1.0, 1.0):
                turned = Pose2D(0.0, 0.0, 1.01 * side * checker.yaw_tolerance)
                assert not self.settle(self.make(), self.approach(turned, goal))
                turned = Pose2D(0.0, 0.0, 0.99 * side * checker.yaw_tolerance)
                assert self.settle(self.make(), self.approach(turned, goal))

    def test_a_path_that_loops_past_its_goal_is_driven_out(self) -> None:
        """At the goal's place, with a long path left."""
        goal = Pose2D(0.0, 0.0, 0.0)
        assert not self.settle(self.make(), self.approach(goal, goal, loop_m=20.0))

    def test_it_is_the_same_in_every_frame(self) -> None:
        """Robot, goal and path moved and turned together."""
        goal, frame = Pose2D(0.4, 0.1, 0.2), Transform2D(-3.0, 8.0, 2.1)
        for distance in (0.0, 0.1, 0.3, 1.0):
            here = self.approach(Pose2D(goal.x - distance, goal.y, 0.1), goal)
            there = Approach(
                frame.apply(here.pose), frame.apply(goal), Twist2D(), frame.apply_poses(here.path), here.remaining_m
            )
            assert self.settle(self.make(), here) == self.settle(self.make(), there)

    def test_reset_forgets(self) -> None:
        """After `reset`, a position that was reached counts no more."""
        checker: GoalChecker = self.make()
        goal = Pose2D(0.0, 0.0, 0.0)
        assert self.settle(checker, self.approach(goal, goal))
        checker.reset()
        assert not self.settle(checker, self.approach(Pose2D(-0.9, 0.0), goal))


class ProgressCheckerContract(_SectionContract):
    """What every progress checker must do."""

    @staticmethod
    def fails_after(checker: ProgressChecker, velocity: Twist2D, limit_s: float = 300.0) -> float:
        """Time (s) at which it fails a robot of constant velocity; infinite if it doesn't."""
        pose, now = Pose2D(0.0, 0.0, 0.0), 0.0
        checker.reset()
        while now < limit_s:
            if not checker.makes_progress(pose, now):
                return now
            pose, now = driven(pose, velocity, 0.1), now + 0.1
        return math.inf

    def test_a_moving_robot_makes_progress(self) -> None:
        """A robot that drives is never failed."""
        assert self.fails_after(self.make(), Twist2D(0.3, 0.0, 0.0)) == math.inf

    def test_a_robot_that_stands_still_is_failed(self) -> None:
        """Some time after the start, again after `reset`, and with a reason."""
        checker: ProgressChecker = self.make()
        first = self.fails_after(checker, Twist2D())
        assert 0.0 < first < math.inf
        assert checker.failure
        assert self.fails_after(checker, Twist2D()) == first

    def test_the_time_of_the_start_does_not_matter(self) -> None:
        """Only differences of times count."""
        checker: ProgressChecker = self.make()
        answers: list[list[bool]] = []
        for start in (0.0, 12345.0):
            checker.reset()
            answers.append([checker.makes_progress(Pose2D(0.0, 0.0), start + 0.5 * k) for k in range(100)])
        assert answers[0] == answers[1]


class PathHandlerContract(_SectionContract):
    """What every path handler must do."""

    def test_it_returns_the_path_from_the_robot_on(self) -> None:
        """The first pose is the closest one, all are in the window, and lengths are those of the segments."""
        handler: PathHandler = self.make()
        plan = straight_path(Pose2D(-1.0, 0.3), Pose2D(9.0, 0.3))
        handler.set_plan(plan)
        path = handler.local_path(Pose2D(0.0, 0.0, 0.5), Transform2D(), WINDOW)
        assert isinstance(path, LocalPath)
        assert path.poses[0, 0] == pytest.approx(0.0, abs=0.05)
        assert (np.abs(path.poses[:, :2]) <= 2.0).all()
        np.testing.assert_allclose(path.poses, plan.poses[path.first : path.end], atol=SMALL)
        assert path.length == pytest.approx(Path(path.poses).length)
        assert path.remaining_m == pytest.approx(9.0, abs=0.06) and not path.ends_at_goal

    def test_the_path_never_goes_back(self) -> None:
        """While a robot drives along a path that crosses itself, the first pose only moves forward, to the end."""
        angles = np.linspace(0.0, 2.0 * math.pi, 200)
        x, y = 1.5 * np.sin(angles), 1.5 * np.sin(angles) * np.cos(angles)
        plan = Path(np.column_stack((x, y, np.arctan2(np.gradient(y), np.gradient(x)))), "odom")
        handler: PathHandler = self.make()
        handler.set_plan(plan)
        robots = [Pose2D(*row) for row in (plan.poses + (0.02, -0.02, 0.0)).tolist()]
        paths = [handler.local_path(robot, Transform2D(), WINDOW) for robot in robots]
        firsts = [path.first for path in paths]
        assert firsts == sorted(firsts)
        assert firsts[-1] >= len(plan) - 4 and paths[-1].ends_at_goal

    def test_a_plan_in_another_frame(self) -> None:
        """The path is in the costmap's frame, with yaws in (-pi, pi]."""
        here, there = self.make(), self.make()
        plan, frame = straight_path(Pose2D(-0.5, -0.5), Pose2D(1.0, 1.0, 3.0)), Transform2D(0.7, -1.1, 2.8)
        here.set_plan(plan)
        there.set_plan(plan.transformed(frame.inverse(), "map"))
        robot = Pose2D(0.1, 0.0, 0.0)
        a = here.local_path(robot, Transform2D(), WINDOW)
        b = there.local_path(robot, frame, WINDOW)
        np.testing.assert_allclose(a.poses[:, :2], b.poses[:, :2], atol=SMALL)
        turned = [angle_between(float(u), float(v)) for u, v in zip(a.poses[:, 2], b.poses[:, 2], strict=True)]
        np.testing.assert_allclose(turned, 0.0, atol=SMALL)
        assert (np.abs(b.poses[:, 2]) <= math.pi + SMALL).all()

    def test_the_input_is_not_changed(self) -> None:
        """The plan is copied."""
        plan = straight_path(Pose2D(0.0, 0.0), Pose2D(1.0, 0.0))
        before = plan.poses.copy()
        handler: PathHandler = self.make()
        handler.set_plan(plan)
        handler.local_path(Pose2D(0.4, 0.0), Transform2D(1.0, 0.0, 0.0), WINDOW).poses[:] = 7.0
        np.testing.assert_array_equal(plan.poses, before)
        plan.poses[:] = 50.0
        assert handler.local_path(Pose2D(0.4, 0.0), Transform2D(), WINDOW).poses[-1, 0] == pytest.approx(1.0)

    def test_plans_that_cannot_be_followed(self) -> None:
        """None, empty, not finite, out of reach: InvalidPathError."""
        handler: PathHandler = self.make()
        with pytest.raises(InvalidPathError):
            handler.local_path(Pose2D(0.0, 0.0), Transform2D(), WINDOW)
        with pytest.raises(InvalidPathError):
            handler.set_plan(Path(np.empty((0, 3))))
        with pytest.raises(InvalidPathError):
            handler.set_plan(Path(np.array([[0.0, math.nan, 0.0], [1.0, 0.0, 0.0]])))
        handler.set_plan(straight_path(Pose2D(30.0, 0.0), Pose2D(31.0, 0.0)))
        with pytest.raises(InvalidPathError, match="reach"):
            handler.local_path(Pose2D(0.0, 0.0), Transform2D(), WINDOW)

    def test_a_plan_of_one_pose(self) -> None:
        """It is its own local path."""
        handler: PathHandler = self.make()
        handler.set_plan(Path(np.array([[0.5, 0.2, 1.0]])))
        path = handler.local_path(Pose2D(0.0, 0.0), Transform2D(), WINDOW)
        assert path.poses.tolist() == [[0.5, 0.2, 1.0]] and path.length == 0.0 and path.ends_at_goal


def goal_checker_contract(plugin: type[GoalChecker], **values: Any) -> type[GoalCheckerContract]:
    """The suite for a goal checker."""
    return contract_of(GoalCheckerContract, plugin, values)


def progress_checker_contract(plugin: type[ProgressChecker], **values: Any) -> type[ProgressCheckerContract]:
    """The suite for a progress checker."""
    return contract_of(ProgressCheckerContract, plugin, values)


def path_handler_contract(plugin: type[PathHandler], **values: Any) -> type[PathHandlerContract]:
    """The suite for a path handler."""
    return contract_of(PathHandlerContract, plugin, values)
