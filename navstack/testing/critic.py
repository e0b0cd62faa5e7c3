"""The contract of critics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from navstack.core import LETHAL, Pose2D, RobotState, Twist2D
from navstack.plugins import Critic, Rollouts, ScoringContext
from navstack.testing.base import Contract, contract_of
from navstack.testing.doubles import FOOTPRINT, StopPlanner, local_costmap, straight_path

POINTS = 9
COMMANDS = [(vx, 0.0, wz) for vx in (0.0, 0.2, 0.4) for wz in (-0.8, -0.2, 0.0, 0.2, 0.8)]


def rollouts(pose: Pose2D) -> Rollouts:
    """Arcs of constant velocity over 1.6 s from a pose, one row per command."""
    commands = np.array(COMMANDS)
    poses = np.empty((len(commands), POINTS, 3))
    for k, (vx, _, wz) in enumerate(COMMANDS):
        for i in range(POINTS):
            yaw = pose.yaw + wz * 0.2 * i
            distance, heading = vx * 0.2 * i, 0.5 * (pose.yaw + yaw)
            poses[k, i] = pose.x + distance * math.cos(heading), pose.y + distance * math.sin(heading), yaw
    return Rollouts(commands, poses, np.full(len(commands), POINTS, np.int64))


class CriticContract(Contract):
    """What every critic must do."""

    @classmethod
    def make(cls) -> Critic:
        """The critic."""
        return cls.plugin("under_test", cls.params())

    @staticmethod
    def context(pose: Pose2D, lethal: tuple[tuple[float, float], ...] = ()) -> ScoringContext:
        """A cycle on the way to a goal 1.5 m ahead."""
        goal = Pose2D(1.5, 0.0, 0.0)
        return ScoringContext(
            RobotState(pose, Twist2D(0.2, 0.0, 0.1)),
            local_costmap(pose, lethal),
            FOOTPRINT,
            straight_path(Pose2D(0.0, 0.0), goal).poses,
            goal,
            StopPlanner().limits,
        )

    def scores(self, critic: Critic, pose: Pose2D, lethal: tuple[tuple[float, float], ...] = ()) -> Any:
        """One cycle: prepare, score."""
        critic.prepare(self.context(pose, lethal))
        return critic.score(rollouts(pose)).copy()

    def test_scores_are_one_finite_number_per_rollout(self) -> None:
        """(K,) float64, never NaN, negative only for codes that the critic declares."""
        critic = self.make()
        critic.reset()
        for pose in (Pose2D(0.0, 0.0), Pose2D(0.2, 0.1, 0.5)):
            scores = self.scores(critic, pose)
            assert scores.shape == (len(COMMANDS),) and np.isfinite(scores).all()
            assert {int(code) for code in scores[scores < 0.0]} <= set(critic.CODES)

    def test_rejections_have_a_reason(self) -> None:
        """For a rejected row `explain` or `CODES` gives a reason."""
        wall = tuple((0.5, 0.025 + 0.05 * i) for i in range(-30, 30))
        critic = self.make()
        scores = self.scores(critic, Pose2D(0.0, 0.0), wall)
        for row in np.flatnonzero(scores < 0.0):
            assert critic.explain(int(row)).reason or critic.CODES[int(scores[row])]

    def test_the_input_is_not_changed(self) -> None:
        """Costmap, plan and rollouts are read only."""
        critic, pose = self.make(), Pose2D(0.1, 0.0, 0.2)
        context = self.context(pose, ((0.6, 0.3),))
        rows = rollouts(pose)
        before = context.costmap.data.copy(), context.plan.copy(), rows.commands.copy(), rows.poses.copy()
        critic.prepare(context)
        critic.score(rows)
        for old, new in zip(before, (context.costmap.data, context.plan, rows.commands, rows.poses), strict=True):
            np.testing.assert_array_equal(old, new)
        assert (context.costmap.data == LETHAL).sum() == 1

    def test_it_is_reproducible(self) -> None:
        """After `reset`, the same cycles give the same scores to the bit."""
        critic = self.make()
        runs: list[list[bytes]] = []
        for _ in range(2):
            critic.reset()
            scores: list[bytes] = []
            for cycle in range(5):
                pose = Pose2D(0.05 * cycle, 0.0, 0.1 * cycle)
                scores.append(self.scores(critic, pose).tobytes())
                critic.debrief(Twist2D(0.2, 0.0, 0.3 if cycle % 2 else -0.3), pose)
            runs.append(scores)
        assert runs[0] == runs[1]

    def test_the_weight_is_finite(self) -> None:
        """`scale` is a finite number and not negative."""
        assert math.isfinite(self.make().scale) and self.make().scale >= 0.0


def critic_contract(plugin: type[Critic], **values: Any) -> type[CriticContract]:
    """The suite for a critic."""
    return contract_of(CriticContract, plugin, values)
