"""Where the robot takes itself to be: the truth, with noise, delay and an offset, as a transform map -> odom."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from navstack.core import Transform2D
from navstack.parameters.models.sim import SimParams


class Localization:
    """Makes map -> odom from true poses, as ROS's fake_localization does.

    An update compares the true pose with the odometry of the same moment, so that a delay lets the correction come late,
    not the pose: between updates the robot goes by its odometry. `delta_x`, `delta_y`, `delta_yaw` are fake_localization's:
    the origin of the localization's map in the simulator's (a point p of the latter is R(-yaw) p - (x, y) in the former).
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
        # (step from which it holds, map -> odom), oldest first
        self._coming: deque[tuple[int, Transform2D]] = deque()
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
        """True when map -> odom never changes."""
        self._current = self.start

    def at(self, step: int, truth: Transform2D, odometry: Transform2D) -> Transform2D:
        """Map -> odom at that physics step, where the base truly is at `truth` (map) and by its odometry at `odometry`.

        To be called for every step, in order.
        """
        if step >= self._next_step:
            self._coming.append((step + self._delay_steps, self._found(truth, odometry)))
            self._update += 1
            if self._frequency is None:
                self._next_step = step + 1
            else:
                passed = math.floor(step * self._frequency / self._physics + 1e-6)
                self._update = max(self._update, passed + 1)
                self._next_step = math.ceil(self._update * self._physics / self._frequency - 1e-6)
        while self._coming and self._coming[0][0] <= step:
            self._current = self._coming.popleft()[1]
        return self._current

    def _found(self, truth: Transform2D, odometry: Transform2D) -> Transform2D:
        if self._shifted:
            truth = self._delta @ truth
        if self._noisy:
            rng = np.random.Generator(np.random.PCG64([self._seed, 1 << 23, self._update]))
            dx, dy, dyaw = (rng.standard_normal(3) * self._noise).tolist()
            truth = Transform2D(truth.x + dx, truth.y + dy, truth.yaw + dyaw)
        return truth @ odometry.inverse()
