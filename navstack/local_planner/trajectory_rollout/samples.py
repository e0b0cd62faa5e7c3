"""Velocity samples of trajectory rollout, and their rollouts (TrajectoryPlanner::createTrajectories)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import RobotState
from navstack.interfaces import Rollouts, TrajectoryGenerator, VelocityLimits
from navstack.local_planner.rollouts import check_points
from navstack.local_planner.trajectory_rollout._kernels import count_points, simulate_accelerating
from navstack.local_planner.trajectory_rollout.params import TrajectoryPlannerParams

STRAFE = 0.1
"""Speed (m/s) forward and to either side of the two strafing samples of a holonomic robot."""


def accumulated(first: float, last: float, number: int) -> NDArray[np.float64]:
    """`number` values from `first` to about `last`, each the one before plus the step: rounded as the loop of C++."""
    values = np.full(number, (last - first) / max(number - 1, 1))
    values[0] = first
    return np.cumsum(values)  # adds from left to right


class TrajectoryRolloutGenerator(TrajectoryGenerator):
    """Samples forward speeds, each straight and with turns, then turns in place."""

    def __init__(self, params: TrajectoryPlannerParams, period: float) -> None:
        """`period`: the control period (s)."""
        self._params = params
        self._period = period

    def samples(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(K, 3) samples that drive forward, then turns in place."""
        bottom, top, right, left = self.ranges(state, plan, limits)
        turns = self.turns(right, left)
        return np.vstack((self.forward(bottom, top, turns, limits), self.in_place(turns, limits)))

    def ranges(
        self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits
    ) -> tuple[float, float, float, float]:
        """Lowest and highest vx, lowest and highest wz: reachable, and at most the speed that reaches the plan's end."""
        p = self._params
        distance = math.hypot(plan[-1, 0] - state.pose.x, plan[-1, 1] - state.pose.y)
        horizon = self._period if p.dwa else p.sim_time
        slowest = min(p.min_vel_x, limits.max_vel_x)
        v, w = state.velocity.vx, state.velocity.wz
        top = max(min(limits.max_vel_x, distance / p.sim_time, v + limits.acc_lim_x * horizon), slowest)
        bottom = min(max(slowest, v - limits.acc_lim_x * horizon), limits.max_vel_x)
        left = min(p.max_vel_theta, limits.max_vel_theta)
        right = max(p.min_vel_theta, -limits.max_vel_theta)
        change = limits.acc_lim_theta * horizon
        return bottom, top, min(max(right, w - change), left), max(min(left, w + change), right)

    def turns(self, right: float, left: float) -> NDArray[np.float64]:
        """(vtheta_samples,) turning speeds, from right to left."""
        return accumulated(right, left, self._params.vtheta_samples)

    def forward(
        self, bottom: float, top: float, turns: NDArray[np.float64], limits: VelocityLimits
    ) -> NDArray[np.float64]:
        """(n, 3) each forward speed straight, then with every turn but the last; for a holonomic robot two that strafe."""
        p = self._params
        samples = np.zeros((p.vx_samples, len(turns), 3))
        samples[:, :, 0] = accumulated(bottom, top, p.vx_samples)[:, None]
        samples[:, 1:, 2] = turns[:-1]
        samples = samples.reshape(-1, 3)
        strafe = min(STRAFE, limits.max_vel_x)
        if p.holonomic_robot and math.hypot(strafe, STRAFE) <= limits.max_vel_trans:
            samples = np.vstack((samples, [(strafe, STRAFE, 0.0), (strafe, -STRAFE, 0.0)]))
        return samples

    def in_place(self, turns: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(n, 3) turns in place of at least the lowest turning speed."""
        slowest = limits.min_vel_theta
        samples = np.zeros((len(turns), 3))
        samples[:, 2] = np.where(turns > 0.0, np.maximum(turns, slowest), np.minimum(turns, -slowest))
        return samples

    def simulate(self, samples: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> Rollouts:
        """Rollouts of `samples` (K, 3), which accelerate towards their sample."""
        p = self._params
        counts = np.empty(len(samples), np.int64)
        longest = count_points(
            samples, p.sim_time, p.sim_granularity, p.angular_sim_granularity, p.heading_scoring, counts
        )
        check_points(len(samples), longest)
        poses = np.empty((len(samples), longest, 3))
        simulate_accelerating(
            samples,
            np.array(state.pose),
            np.array(state.velocity),
            np.array((limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta)),
            p.sim_time,
            counts,
            poses,
        )
        return Rollouts(samples, poses, counts)
