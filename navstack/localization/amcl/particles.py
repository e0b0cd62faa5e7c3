"""The set of particles: initialization, weights, resampling, clusters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.localization.amcl import _histogram_kernels, _motion_kernels, _random_kernels, _resample_kernels
from navstack.parameters.models.amcl import AmclParams

Array = NDArray[np.float64]
CONVERGED_M = 0.5
START_TURN = 0.08
"""Standard deviation of the odometry's turn error at the start (rad/m)."""
TURN_STEP = 0.002
"""Its random step per resampling (rad/m): the error may change as the robot drives, and few particles stay diverse."""


class Clusters(NamedTuple):
    """Connected groups of particles, with those of the most weight first, and the whole set."""

    weights: Array
    """(k,)."""
    counts: NDArray[np.int64]
    """(k,) particles."""
    means: Array
    """(k, 3) x, y, yaw."""
    covariances: Array
    """(k, 3, 3); x and y, and the circular variance of yaw."""
    mean: Array
    """(3,) of the set."""
    covariance: Array
    """(3, 3) of the set."""

    @property
    def pose(self) -> Pose2D:
        """Mean of the heaviest cluster."""
        return Pose2D(*self.means[0].tolist())


class ParticleSet:
    """Weighted poses (n, 3) and the averages that decide when random poses are added."""

    def __init__(self, params: AmclParams, seed: int) -> None:
        defects = frozenset(params.ros_defects)
        self._wrapped = "yaw_bins" not in defects
        self._average_prior = "average_weight" in defects
        self.random = _random_kernels.random_state(seed)
        self._alphas = params.recovery_alpha_slow, params.recovery_alpha_fast
        most = params.max_particles
        size = 1 << max(4, (2 * most - 1).bit_length())
        self._poses, self._next = np.zeros((most, 3)), np.zeros((most, 3))
        self._weights = np.zeros(most)
        self._parents = np.zeros(most, np.int64)
        self._learns = params.learn_odometry
        self._turns = np.zeros(most)
        self._keys, self._numbers = np.full(size, -1, np.int64), np.zeros(size, np.int32)
        self._bins, self._members = np.zeros(most, np.int64), np.zeros(most, np.int32)
        self._settings = np.zeros(1, _resample_kernels.RESAMPLING)
        self._settings["pop_err"], self._settings["pop_z"] = params.kld_err, params.kld_z
        self._settings["min_particles"], self._settings["max_particles"] = params.min_particles, most
        self._settings["wrapped"] = self._wrapped
        self._settings["one_bin_asks_for_max"] = "one_bin_max" in defects
        self._settings["spread"] = 0.0 if "half_cell" in defects else 1.0
        self.count = 0
        self.slow = 0.0
        """Slow average of the likelihood of the scans."""
        self.fast = 0.0
        self.converged = False
        """All particles were near their mean at the last resampling."""
        self.injected = 0
        """Random poses at the last resampling."""

    @property
    def poses(self) -> Array:
        """(n, 3) x, y, yaw: a view."""
        return self._poses[: self.count]

    @property
    def weights(self) -> Array:
        """(n,), sum 1: a view."""
        return self._weights[: self.count]

    @property
    def turns(self) -> Array:
        """(n,) turn of the robot beyond that of its odometry (rad/m), of each particle: a view."""
        return self._turns[: self.count]

    @property
    def turn(self) -> float:
        """Mean turn beyond the odometry's (rad/m)."""
        return float(self.weights @ self.turns)

    @property
    def effective(self) -> float:
        """Effective number of particles."""
        return 1.0 / float(np.square(self.weights).sum())

    @property
    def bin_count(self) -> int:
        """Number of bins of 0.5 m and 10 degrees with particles."""
        return _histogram_kernels.count_bins(
            self.poses, self._wrapped, self._keys, self._numbers, self._members, self._bins
        )

    @property
    def injection(self) -> float:
        """Share of random poses that the next resampling draws."""
        return max(0.0, 1.0 - self.fast / self.slow) if self.slow > 0.0 else 0.0

    def draw_gaussian(self, mean: Pose2D, covariance: Array) -> None:
        """Draw all particles from a normal distribution; `covariance` (3, 3) symmetric, without negative eigenvalues."""
        values, axes = np.linalg.eigh(covariance)
        self._begin(len(self._poses))
        sigmas = np.sqrt(np.maximum(values, 0.0))
        center = np.array(mean)
        _random_kernels.draw_gaussian(center, np.ascontiguousarray(axes), sigmas, self.random, self.poses)
        self._wrap()

    def draw_uniform(self, free: NDArray[np.int32], origin: tuple[float, float], cell: float) -> None:
        """Draw all particles uniformly over the free cells (m, 2), of which (0, 0) is centred at `origin` (m)."""
        self._begin(len(self._poses))
        self._place(origin, cell)
        _resample_kernels.draw_uniform_set(free, self._settings, self.random, self.poses)

    def put(self, poses: Array, weights: Array) -> None:
        """Take these poses (n, 3) and weights (n,), for example from a search over the map; n at most max_particles."""
        self._begin(len(poses))
        self.poses[:] = poses
        self.weights[:] = weights / weights.sum()
        self._wrap()

    def move(self, motion: Array, start_yaw: float, alphas: Array, model: str) -> None:
        """Apply a motion model to `motion` (3,), see the kernels; with `learn_odometry`, each particle also turns at its rate."""
        half = 0.5 * math.hypot(*motion[:2].tolist()) if self._learns else 0.0
        if half:
            _motion_kernels.turn_by(self.poses, self.turns, half)
        move = _motion_kernels.move_diff if model.startswith("diff") else _motion_kernels.move_omni
        move(self.poses, motion, start_yaw, alphas, model.endswith("corrected"), self.random)
        if half:
            _motion_kernels.turn_by(self.poses, self.turns, half)
        self._wrap()

    def weigh(self, factors: Array) -> bool:
        """Multiply the weights by the likelihood of a scan, (n,); return False if they are all 0 or not finite.

        In that case the weights become equal.
        """
        weights = self.weights
        weights *= factors
        total = float(weights.sum())
        if not (total > 0.0 and math.isfinite(total)):
            weights[:] = 1.0 / self.count
            return False
        weights /= total
        # ROS differs: the mean likelihood, not divided by the number of particles, which changes from scan to scan
        average = total / self.count if self._average_prior else total
        slow, fast = self._alphas
        self.slow = average if self.slow == 0.0 else self.slow + slow * (average - self.slow)
        self.fast = average if self.fast == 0.0 else self.fast + fast * (average - self.fast)
        return True

    def resample(self, free: NDArray[np.int32], origin: tuple[float, float], cell: float) -> None:
        """Draw new particles in proportion to their weights, as many as the bins that they occupy need."""
        share = self.injection if len(free) else 0.0
        self._settings["injected_share"] = share
        self._place(origin, cell)
        sums, guide = np.empty(self.count + 1), np.empty(self.count + 1, np.int32)
        _resample_kernels.cumulate(self.weights, sums, guide)
        self.count = _resample_kernels.resample(
            self.poses, sums, guide, free, self._settings, self.random, self._keys, self._next, self._parents
        )
        self._poses, self._next = self._next, self._poses
        self.weights[:] = 1.0 / self.count
        parents = self._parents[: self.count]
        self.injected = int(np.count_nonzero(parents < 0)) if share > 0.0 else 0
        if self._learns:
            turns = self._turns.copy()
            _motion_kernels.draw_turns(turns, parents, START_TURN, TURN_STEP, self.random, self._turns)
        if share > 0.0:
            self.slow = self.fast = 0.0
        self.converged = self.is_converged()

    def clusters(self) -> Clusters:
        """Return the connected groups of particles."""
        bins = self.bin_count
        labels, stack = np.empty(bins, np.int32), np.empty(bins, np.int32)
        number = _histogram_kernels.label_bins(
            bins, self._wrapped, self._keys, self._numbers, self._bins, labels, stack
        )
        sums = np.zeros((number, 9))
        _histogram_kernels.add_up(self.poses, self.weights, self._members, labels, sums)
        order = np.argsort(-sums[:, 1], kind="stable")
        sums = sums[order]
        means, covariances = _moments(sums)
        mean, covariance = _moments(sums.sum(axis=0, keepdims=True))
        return Clusters(sums[:, 1], sums[:, 0].astype(np.int64), means, covariances, mean[0], covariance[0])

    def _begin(self, count: int) -> None:
        """Start with so many particles of equal weight."""
        self.count = count
        self.weights[:] = 1.0 / count
        if self._learns:
            none = np.full(count, -1, np.int64)
            _motion_kernels.draw_turns(self._turns, none, START_TURN, 0.0, self.random, self._turns)
        self.slow = self.fast = 0.0
        self.converged = False
        self.injected = 0

    def _place(self, origin: tuple[float, float], cell: float) -> None:
        self._settings["free_x"], self._settings["free_y"] = origin
        self._settings["free_resolution"] = cell

    def _wrap(self) -> None:
        if self._wrapped:
            _motion_kernels.wrap_yaws(self.poses)

    def is_converged(self) -> bool:
        """Return True if every particle is within half a metre of their mean, in x and in y."""
        position = self.poses[:, :2]
        return bool((np.abs(position - position.mean(axis=0)) <= CONVERGED_M).all())


def _moments(sums: Array) -> tuple[Array, Array]:
    """Return means (k, 3) and covariances (k, 3, 3) of sums (k, 9) as `add_up` makes them."""
    weight = np.maximum(sums[:, 1], np.finfo(np.float64).tiny)
    x, y, c, s, xx, xy, yy = (sums[:, 2:] / weight[:, None]).T
    means = np.column_stack((x, y, np.arctan2(s, c)))
    covariances = np.zeros((len(sums), 3, 3))
    covariances[:, 0, 0], covariances[:, 1, 1] = xx - x * x, yy - y * y
    covariances[:, 0, 1] = covariances[:, 1, 0] = xy - x * y
    length = np.clip(np.hypot(c, s), np.finfo(np.float64).tiny, 1.0)
    covariances[:, 2, 2] = -2.0 * np.log(length)
    return means, covariances
