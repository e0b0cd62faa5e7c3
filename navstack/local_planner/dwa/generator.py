"""The trajectory generator of DWA: a lattice of reachable velocities, each simulated for sim_time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import RobotState, Twist2D
from navstack.interfaces import Rollouts, TrajectoryGenerator, VelocityLimits
from navstack.local_planner.dwa._generator_kernels import sample_velocities, simulate
from navstack.local_planner.dwa.params import DWAParams
from navstack.local_planner.rollouts import check_points

SIMULATION_SETTINGS = np.dtype(
    [
        ("acc_lim_x", "f8"),
        ("acc_lim_y", "f8"),
        ("acc_lim_theta", "f8"),
        ("min_vel_trans", "f8"),
        ("max_vel_trans", "f8"),
        ("min_vel_theta", "f8"),
        ("sim_time", "f8"),
        ("sim_granularity", "f8"),
        ("angular_sim_granularity", "f8"),
        ("accelerate", "?"),
    ]
)
"""Settings of the simulation, named as the parameters. `accelerate`: the velocity approaches the sample (use_dwa is off)."""


class DWAGenerator(TrajectoryGenerator):
    """Samples velocities that are reachable within one period and simulates each for sim_time.

    Its arrays are buffers: samples and rollouts are valid until the next call.
    """

    def __init__(self, params: DWAParams, period: float) -> None:
        """`period`: the control period (s)."""
        self._params = params
        self._period = period
        numbers = (params.vx_samples, params.vy_samples, params.vth_samples)
        widest = [max(2, n) + 1 for n in numbers]
        capacity = widest[0] * widest[1] * widest[2]
        self._numbers = numbers
        self._axis_values = np.empty((3, max(widest)))
        self._samples = np.empty((capacity, 3))
        self._commands = np.empty((capacity, 3))
        self._counts = np.empty(capacity, np.int64)
        self._points = np.empty(0)
        self._limits: VelocityLimits | None = None
        self._settings = np.empty(1, SIMULATION_SETTINGS)

    # --- velocity samples -------------------------------------------------------------------------------------------

    def samples(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(K, 3) velocities of the window, in C++'s order."""
        return self.lattice(self.window(state, plan, limits))

    def window(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(3, 2) lowest and highest vx, vy, wz to sample."""
        p = self._params
        if not p.use_dwa:
            # without the dynamic window: at most the speed that reaches the end of the local plan (float32 as in C++)
            offset = plan[-1, :2].astype(np.float32) - np.array(state.pose[:2], np.float32)
            distance = math.hypot(float(offset[0]), float(offset[1]))
            capped = limits._replace(
                max_vel_x=max(min(limits.max_vel_x, distance / p.sim_time), limits.min_vel_x),
                max_vel_y=max(min(limits.max_vel_y, distance / p.sim_time), limits.min_vel_y),
            )
            return velocity_window(state.velocity, capped, p.sim_time)
        window = velocity_window(state.velocity, limits, self._period)
        # ROS differs: if one period's acceleration stays below min_vel_trans, C++ cannot start to move: only turns in place
        # are legal, forever. Here the lowest speed can be commanded from rest, as a turn at the goal can.
        lowest = limits.min_vel_trans
        if limits.acc_lim_x * self._period < lowest and state.velocity.speed < lowest:
            window[0, 0] = max(limits.min_vel_x, min(window[0, 0], -lowest))
            window[0, 1] = min(limits.max_vel_x, max(window[0, 1], lowest))
        return window

    def widen_rotation(self, window: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> bool:
        """Widen `window` to min_vel_theta in both directions if acceleration alone does not reach it; False if it does."""
        lowest = min(limits.min_vel_theta, limits.max_vel_theta)
        if not self._params.use_dwa or abs(state.velocity.wz) + limits.acc_lim_theta * self._period >= lowest:
            return False
        # ROS differs: if acc_lim_theta / controller_frequency is below min_vel_theta, a robot that cannot drive is stuck
        window[2] = -lowest, lowest
        return True

    def lattice(self, window: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 3) velocities of the window, in C++'s order."""
        count = sample_velocities(window, *self._numbers, self._axis_values, self._samples)
        return self._samples[:count]

    # --- rollouts ---------------------------------------------------------------------------------------------------

    def simulate(self, samples: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> Rollouts:
        """Rollouts of `samples` (K, 3); samples below both lowest speeds or above the highest speed have no points."""
        k = len(samples)
        if k > len(self._counts):
            self._commands = np.empty((k, 3))
            self._counts = np.empty(k, np.int64)
        if limits is not self._limits:
            self._set_limits(limits)
        longest = self._run(samples, state)
        if k * longest * 3 > len(self._points):
            check_points(k, longest)
            self._points = np.empty(k * longest * 3)
            self._run(samples, state)
        poses = self._points[: k * longest * 3].reshape(k, longest, 3)
        return Rollouts(self._commands[:k], poses, self._counts[:k])

    def _run(self, samples: NDArray[np.float64], state: RobotState) -> int:
        k = len(samples)
        (x, y, yaw), (vx, vy, wz) = state.pose, state.velocity
        return simulate(
            samples,
            float(x),  # integers would compile another version of the kernel
            float(y),
            float(yaw),
            float(vx),
            float(vy),
            float(wz),
            self._settings,
            self._counts[:k],
            self._commands[:k],
            self._points,
        )

    def _set_limits(self, limits: VelocityLimits) -> None:
        p = self._params
        self._limits = limits
        self._settings[0] = (
            limits.acc_lim_x,
            limits.acc_lim_y,
            limits.acc_lim_theta,
            limits.min_vel_trans,
            limits.max_vel_trans,
            limits.min_vel_theta,
            p.sim_time,
            p.sim_granularity,
            p.angular_sim_granularity,
            not p.use_dwa,
        )


def velocity_window(velocity: Twist2D, limits: VelocityLimits, horizon: float) -> NDArray[np.float64]:
    """(3, 2) lowest and highest vx, vy, wz within the limits that are reachable within `horizon` (s).

    A robot outside its limits gets the nearest limit alone. The velocity is rounded to float32, as DWAPlanner::findBestPath
    stores it.
    """
    vx, vy, wz = np.array(velocity, np.float32).tolist()
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
