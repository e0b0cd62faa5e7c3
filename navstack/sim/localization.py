"""Simulated localization: the true pose with noise, delay and an offset, as a transform map -> odom."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from navstack.core import Transform2D
from navstack.parameters.models.sim import SimParams


class Localization:
    """Computes map -> odom from true poses, as ROS's fake_localization does.

    An update compares the true pose with the odometry at the same time, so a delay delays the correction, not the pose:
    between updates the robot follows its odometry. `delta_x`, `delta_y`, `delta_yaw` are those of fake_localization: the origin
    of the localization's map in the simulator's (a point p of the latter is R(-yaw) p - (x, y) in the former).
    """

    def __init__(self, params: SimParams, *, seed: int, offset: Transform2D) -> None:
        """`offset`: the pose of the odometry frame in the simulator's map at the start."""
        self._noise = (params.localization_noise, params.localization_noise, params.localization_yaw_noise)
        self._noisy = any(sigma > 0.0 for sigma in self._noise)
        self._seed = seed
        self._physics = params.physics_frequency
        self._frequency = params.localization_frequency
        self._delay_steps = math.ceil(params.localization_delay * self._physics - 1e-9)
        self._delta = Transform2D(-params.delta_x, -params.delta_y, -params.delta_yaw)
        self._shifted = not self._delta.is_identity()
        self._update = 0
        self._next_step = 0
        # (step from which it is in force, map -> odom), oldest first
        self._delayed: deque[tuple[int, Transform2D]] = deque()
        truth = params.localization == "truth"
        self.start = self._delta @ offset if self._shifted and truth else offset
        """map -> odom before the first update."""
        drifts = (
            params.wheel_slip > 0.0
            or params.odometry_noise > 0.0
            or params.wheel_slip_turn > 0.0
            or params.odometry_noise_turn > 0.0
            or params.odometry_scale != 0.0
            or params.odometry_turn != 0.0
        )
        self.is_static = not (truth and (drifts or self._noisy))
        """True if map -> odom is constant."""
        self._current = self.start

    @property
    def current(self) -> Transform2D:
        """Present transform map -> odom."""
        return self._current

    def correct(self, truth: Transform2D, odometry: Transform2D) -> None:
        """Sets map -> odom at once for the base at `truth` (map) and, by its odometry, at `odometry`; drops delayed updates."""
        self._delayed.clear()
        self._current = self._correction(truth, odometry)

    def at(self, step: int, truth: Transform2D, odometry: Transform2D) -> Transform2D:
        """Returns map -> odom at a physics step with the base at `truth` (map) and, by its odometry, at `odometry`.

        Must be called for every step, in order.
        """
        if step >= self._next_step:
            self._delayed.append((step + self._delay_steps, self._correction(truth, odometry)))
            self._update += 1
            if self._frequency is None:
                self._next_step = step + 1
            else:
                passed = math.floor(step * self._frequency / self._physics + 1e-6)
                self._update = max(self._update, passed + 1)
                self._next_step = math.ceil(self._update * self._physics / self._frequency - 1e-6)
        while self._delayed and self._delayed[0][0] <= step:
            self._current = self._delayed.popleft()[1]
        return self._current

    def _correction(self, truth: Transform2D, odometry: Transform2D) -> Transform2D:
        if self._shifted:
            truth = self._delta @ truth
        if self._noisy:
            rng = np.random.Generator(np.random.PCG64([self._seed, 1 << 23, self._update]))
            dx, dy, dyaw = (rng.standard_normal(3) * self._noise).tolist()
            truth = Transform2D(truth.x + dx, truth.y + dy, truth.yaw + dyaw)
        return truth @ odometry.inverse()
