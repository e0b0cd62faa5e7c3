"""Sampled velocities and their simulated trajectories, in buffers that are used again every cycle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D
from navstack.interfaces import Rollouts, VelocityLimits
from navstack.local_planner.dwa._generator_kernels import roll_out, sample_velocities
from navstack.local_planner.rollouts import check_points


def velocity_window(velocity: Twist2D, limits: VelocityLimits, horizon: float) -> NDArray[np.float64]:
    """(3, 2) lowest and highest vx, vy, wz that can be reached within `horizon` (s) and are within the limits.

    A robot faster or slower than its limits allow gets the nearest limit alone.
    """
    vx, vy, wz = velocity
    return np.array(
        (
            _reachable(vx, limits.min_vel_x, limits.max_vel_x, limits.acc_lim_x * horizon),
            _reachable(vy, limits.min_vel_y, limits.max_vel_y, limits.acc_lim_y * horizon),
            _reachable(wz, -limits.max_vel_theta, limits.max_vel_theta, limits.acc_lim_theta * horizon),
        )
    )


def _reachable(value: float, low: float, high: float, change: float) -> tuple[float, float]:
    bottom, top = max(low, value - change), min(high, value + change)
    if bottom > top:
        # ROS differs: C++ samples between the two, outside the limits (a vy of 0.001 for a robot that cannot strafe)
        bottom = top = min(max(value, low), high)
    return bottom, top


class Simulator:
    """Samples velocities on a lattice and simulates each for `sim_time` (s)."""

    def __init__(
        self,
        numbers: tuple[int, int, int],
        sim_time: float,
        granularity: float,
        angular_granularity: float,
        *,
        accelerate: bool,
    ) -> None:
        self.numbers = numbers
        self.sim_time = sim_time
        self.granularity = granularity
        self.angular_granularity = angular_granularity
        self.accelerate = accelerate
        widest = [max(2, n) + 1 for n in numbers]
        capacity = widest[0] * widest[1] * widest[2]
        self._scratch = np.empty((3, max(widest)))
        self._samples = np.empty((capacity, 3))
        self._commands = np.empty((capacity, 3))
        self._counts = np.empty(capacity, np.int64)
        self._points = np.empty(0)
        self._limits: VelocityLimits | None = None
        self._limits_array = np.empty(6)

    def lattice(self, window: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocities (K, 3) of the window, in C++'s order; valid until the next call."""
        count = sample_velocities(window, *self.numbers, self._scratch, self._samples)
        return self._samples[:count]

    def run(self, samples: NDArray[np.float64], pose: Pose2D, velocity: Twist2D, limits: VelocityLimits) -> Rollouts:
        """Trajectories of `samples` (K, 3) from `pose`; valid until the next call.

        A sample that is too slow on both counts, or too fast, has no points.
        """
        k = len(samples)
        if k > len(self._counts):
            self._commands = np.empty((k, 3))
            self._counts = np.empty(k, np.int64)
        counts = self._counts[:k]
        commands = self._commands[:k]
        longest = self._roll_out(samples, pose, velocity, limits, counts, commands)
        size = k * longest * 3
        if size > len(self._points):
            check_points(k, longest)
            self._points = np.empty(size)
            self._roll_out(samples, pose, velocity, limits, counts, commands)
        return Rollouts(commands, self._points[:size].reshape(k, longest, 3), counts)

    def _roll_out(
        self,
        samples: NDArray[np.float64],
        pose: Pose2D,
        velocity: Twist2D,
        limits: VelocityLimits,
        counts: NDArray[np.int64],
        commands: NDArray[np.float64],
    ) -> int:
        if limits is not self._limits:
            self._limits = limits
            self._limits_array = np.array(
                (
                    limits.acc_lim_x,
                    limits.acc_lim_y,
                    limits.acc_lim_theta,
                    limits.min_vel_trans,
                    limits.max_vel_trans,
                    limits.min_vel_theta,
                ),
                np.float64,
            )
        x, y, yaw = pose
        vx, vy, wz = velocity
        return roll_out(
            samples,
            float(x),
            float(y),
            float(yaw),
            float(vx),
            float(vy),
            float(wz),
            self._limits_array,
            self.sim_time,
            self.granularity,
            self.angular_granularity,
            self.accelerate,
            counts,
            commands,
            self._points,
        )
