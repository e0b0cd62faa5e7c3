"""Random errors of the simulated wheels and of their odometry."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.parameters.models.sim import SimParams

_NONE = np.empty((0, 8))


class DriveNoise:
    """Draws the errors of physics steps, as the kernel `drive` takes them."""

    def __init__(self, params: SimParams, seed: int) -> None:
        self._params = params
        self._frequency = params.physics_frequency
        self._turns = params.wheel_slip_turn > 0.0 or params.odometry_noise_turn > 0.0
        self._any = params.wheel_slip > 0.0 or params.odometry_noise > 0.0 or self._turns
        self._heading_rng = np.random.Generator(np.random.PCG64([seed, 1 << 24]))
        self._rng = np.random.Generator(np.random.PCG64([seed, 0]))

    def of(self, steps: int) -> NDArray[np.float64]:
        """Return errors per step, (steps, 8), or (0, 8) without any.

        The variances of the relative errors over one second add up to the square of the parameter.
        """
        if not self._any:
            return _NONE
        noise = np.zeros((steps, 8))
        relative = self._rng.standard_normal((steps, 6)) * math.sqrt(self._frequency)
        noise[:, :3] = relative[:, :3] * self._params.wheel_slip
        noise[:, 3:6] = relative[:, 3:] * self._params.odometry_noise
        if self._turns:
            sigmas = self._params.wheel_slip_turn, self._params.odometry_noise_turn
            noise[:, 6:] = self._heading_rng.standard_normal((steps, 2)) * sigmas
        return noise
