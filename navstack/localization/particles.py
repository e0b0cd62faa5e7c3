"""The set of particles: initialization, weights, resampling, clusters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, kernel
from navstack.parameters import AmclParams

# ----------------------------------------------------------------------------------------------------------------------
# Bins of particles: the number of bins sets the size of the particle set, connected bins are clusters.
#
# amcl keeps them in a k-d tree (pf/pf_kdtree.c); here a hash table with open addressing. `keys` (size,) int64 holds the bins, -1
# where empty; `numbers` (size,) int32 their numbers in the order of insertion. The size is a power of two, at least twice the
# number of bins.


BIN_M = 0.5
BIN_RAD = 10.0 * math.pi / 180.0
TURN = 36
OFFSET = 1 << 20
YAW_OFFSET = 1 << 14
YAW_BITS = 15


@kernel
def bin_of(x: float, y: float, yaw: float, wrapped: bool) -> int:
    """Return the key of the bin of a pose. `wrapped`: headings a full turn apart share a bin."""
    ix = min(max(math.floor(x / BIN_M) + OFFSET, 1), 2 * OFFSET - 2)
    iy = min(max(math.floor(y / BIN_M) + OFFSET, 1), 2 * OFFSET - 2)
    turn = math.floor(yaw / BIN_RAD)
    if wrapped:
        turn = turn % TURN
    turn = min(max(turn + YAW_OFFSET, 1), 2 * YAW_OFFSET - 2)
    key: int = np.int64((((np.int64(ix) << 21) | np.int64(iy)) << YAW_BITS) | np.int64(turn))  # pyright: ignore[reportAssignmentType]
    return key


@kernel
def slot_of(keys: NDArray[np.int64], key: int) -> int:
    """Return the slot of a key, or the empty one where it belongs."""
    mask = len(keys) - 1
    scrambled = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot: int = np.int64(scrambled >> np.uint64(32)) & mask  # pyright: ignore[reportAssignmentType]
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@kernel
def count_bins(
    particles: NDArray[np.float64],
    wrapped: bool,
    keys: NDArray[np.int64],
    numbers: NDArray[np.int32],
    members: NDArray[np.int32],
    bins: NDArray[np.int64],
) -> int:
    """Sort `particles` (n, 3) into bins; fill `members` (n,) and the keys `bins`; return the number of bins."""
    keys[:] = -1
    count = 0
    for i in range(len(particles)):
        key = bin_of(particles[i, 0], particles[i, 1], particles[i, 2], wrapped)
        slot = slot_of(keys, key)
        if keys[slot] == -1:
            keys[slot] = key
            numbers[slot] = count
            bins[count] = key
            count += 1
        members[i] = numbers[slot]
    return count


@kernel
def neighbor_of(key: int, dx: int, dy: int, turn: int, wrapped: bool) -> int:
    """Return the key of a neighboring bin."""
    heading = (key & ((1 << YAW_BITS) - 1)) + turn
    if wrapped:
        heading = (heading - YAW_OFFSET) % TURN + YAW_OFFSET
    found: int = (((key >> YAW_BITS) + (np.int64(dx) << 21) + dy) << YAW_BITS) | heading  # pyright: ignore[reportAssignmentType]
    return found


@kernel
def label_bins(
    count: int,
    wrapped: bool,
    keys: NDArray[np.int64],
    numbers: NDArray[np.int32],
    bins: NDArray[np.int64],
    labels: NDArray[np.int32],
    stack: NDArray[np.int32],
) -> int:
    """Label the `count` bins by their 26-connected components, from the last bin to the first; return the number of clusters."""
    labels[:count] = -1
    clusters = 0
    for first in range(count - 1, -1, -1):
        if labels[first] != -1:
            continue
        labels[first] = clusters
        stack[0] = first
        depth = 1
        while depth > 0:
            depth -= 1
            key: int = bins[stack[depth]]  # pyright: ignore[reportAssignmentType]
            for dx in range(-1, 2):
                for dy in range(-1, 2):
                    for turn in range(-1, 2):
                        other = neighbor_of(key, dx, dy, turn, wrapped)
                        slot = slot_of(keys, other)
                        if keys[slot] == other and labels[numbers[slot]] == -1:
                            labels[numbers[slot]] = clusters
                            stack[depth] = numbers[slot]
                            depth += 1
        clusters += 1
    return clusters


@kernel
def add_up(
    particles: NDArray[np.float64],
    weights: NDArray[np.float64],
    members: NDArray[np.int32],
    labels: NDArray[np.int32],
    sums: NDArray[np.float64],
) -> None:
    """Add up the moments of each cluster.

    `sums` (clusters, 9): count, weight, weighted x, y, cos yaw, sin yaw, xx, xy, yy.
    """
    sums[:] = 0.0
    for i in range(len(particles)):
        row = labels[members[i]]
        w = weights[i]
        x, y, yaw = particles[i, 0], particles[i, 1], particles[i, 2]
        wx, wy = w * x, w * y
        sums[row, 0] += 1.0
        sums[row, 1] += w
        sums[row, 2] += wx
        sums[row, 3] += wy
        sums[row, 4] += w * math.cos(yaw)
        sums[row, 5] += w * math.sin(yaw)
        sums[row, 6] += wx * x
        sums[row, 7] += wx * y
        sums[row, 8] += wy * y


# ----------------------------------------------------------------------------------------------------------------------
# Random numbers of the particle filter: the 48-bit linear congruential generator of POSIX (`drand48`).
#
# The state is an array (1,) of uint64, seeded with `random_state`. amcl draws from the same generator, so equal seeds give equal
# particles (amcl/src/amcl/pf/pf_pdf.c).


MULTIPLIER = np.uint64(0x5DEECE66D)
INCREMENT = np.uint64(0xB)
MASK = np.uint64((1 << 48) - 1)
SCALE = 1.0 / (1 << 48)


def random_state(seed: int) -> NDArray[np.uint64]:
    """Return the state (1,) after `srand48(seed)`."""
    return np.array([((seed & 0xFFFFFFFF) << 16) | 0x330E], np.uint64)


@kernel
def uniform(state: NDArray[np.uint64]) -> float:
    """Return the next number in [0, 1)."""
    value = (state[0] * MULTIPLIER + INCREMENT) & MASK
    state[0] = value
    return value * SCALE


@kernel
def normal(sigma: float, state: NDArray[np.uint64]) -> float:
    """Return a normal number of mean 0 and standard deviation `sigma` by the polar method, of whose two results one is used."""
    while True:
        a = uniform(state)
        while a == 0.0:
            a = uniform(state)
        b = uniform(state)
        while b == 0.0:
            b = uniform(state)
        x = 2.0 * a - 1.0
        y = 2.0 * b - 1.0
        w = x * x + y * y
        if w <= 1.0 and w != 0.0:
            return sigma * y * math.sqrt(-2.0 * math.log(w) / w)


@kernel
def draw_gaussian(
    mean: NDArray[np.float64],
    axes: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    state: NDArray[np.uint64],
    out: NDArray[np.float64],
) -> None:
    """Fill `out` (n, 3) with normal poses: `axes` (3, 3) has the eigenvectors in columns, `sigmas` (3,) is along them."""
    for i in range(len(out)):
        a = normal(sigmas[0], state)
        b = normal(sigmas[1], state)
        c = normal(sigmas[2], state)
        for k in range(3):
            out[i, k] = mean[k] + axes[k, 0] * a + axes[k, 1] * b + axes[k, 2] * c


# ----------------------------------------------------------------------------------------------------------------------
# The motion models of amcl (amcl/src/amcl/sensors/amcl_odom.cpp; Thrun, Burgard, Fox: Probabilistic Robotics, 5.4).


DIFF, OMNI, DIFF_CORRECTED, OMNI_CORRECTED = 0, 1, 2, 3


@kernel
def difference(a: float, b: float) -> float:
    """Return the shortest rotation (rad, in [-pi, pi]) from `b` to `a`."""
    turn = a - b
    if abs(turn) > math.pi:
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    return turn


@kernel
def move_diff(
    particles: NDArray[np.float64],
    motion: NDArray[np.float64],
    start_yaw: float,
    alphas: NDArray[np.float64],
    corrected: bool,
    state: NDArray[np.uint64],
) -> None:
    """Move `particles` (n, 3) by the odometry's `motion` (dx, dy in the odometry frame, dyaw) from the heading `start_yaw`.

    Rotation, translation, rotation, each with noise. The plain model takes the variances as standard deviations.
    """
    distance = math.sqrt(motion[0] * motion[0] + motion[1] * motion[1])
    first = 0.0 if distance < 0.01 else difference(math.atan2(motion[1], motion[0]), start_yaw)
    second = difference(motion[2], first)
    # driving backward is no rotation by half a turn
    noise_first = min(abs(difference(first, 0.0)), abs(difference(first, math.pi)))
    noise_second = min(abs(difference(second, 0.0)), abs(difference(second, math.pi)))
    square = distance * distance
    turns = noise_first * noise_first, noise_second * noise_second
    sigma_first = alphas[0] * turns[0] + alphas[1] * square
    sigma_distance = alphas[2] * square + alphas[3] * turns[0] + alphas[3] * turns[1]
    sigma_second = alphas[0] * turns[1] + alphas[1] * square
    if corrected:
        sigma_first = math.sqrt(sigma_first)
        sigma_distance = math.sqrt(sigma_distance)
        sigma_second = math.sqrt(sigma_second)
    for i in range(len(particles)):
        turn = difference(first, normal(sigma_first, state))
        way = distance - normal(sigma_distance, state)
        rest = difference(second, normal(sigma_second, state))
        heading = particles[i, 2] + turn
        particles[i, 0] += way * math.cos(heading)
        particles[i, 1] += way * math.sin(heading)
        particles[i, 2] += turn + rest


@kernel
def move_omni(
    particles: NDArray[np.float64],
    motion: NDArray[np.float64],
    start_yaw: float,
    alphas: NDArray[np.float64],
    corrected: bool,
    state: NDArray[np.uint64],
) -> None:
    """Move `particles` (n, 3) as `move_diff` does, by the model for bases that drive sideways; `alphas` (5,)."""
    distance = math.sqrt(motion[0] * motion[0] + motion[1] * motion[1])
    bearing = difference(math.atan2(motion[1], motion[0]), start_yaw)
    turn = motion[2]
    way, rotation = distance * distance, turn * turn
    if corrected:
        sigma_way = math.sqrt(alphas[2] * way + alphas[3] * rotation)
        sigma_turn = math.sqrt(alphas[0] * rotation + alphas[1] * way)
        sigma_side = math.sqrt(alphas[3] * rotation + alphas[4] * way)
    else:
        sigma_way = alphas[2] * way + alphas[0] * rotation
        sigma_turn = alphas[3] * rotation + alphas[1] * way
        sigma_side = alphas[0] * rotation + alphas[4] * way
    for i in range(len(particles)):
        heading = bearing + particles[i, 2]
        c, s = math.cos(heading), math.sin(heading)
        ahead = distance + normal(sigma_way, state)
        turned = turn + normal(sigma_turn, state)
        side = normal(sigma_side, state)
        particles[i, 0] += ahead * c + side * s
        particles[i, 1] += ahead * s - side * c
        particles[i, 2] += turned


@kernel
def wrap_yaws(particles: NDArray[np.float64]) -> None:
    """Bring the headings (column 2) into [-pi, pi)."""
    full = 2.0 * math.pi
    for i in range(len(particles)):
        yaw = particles[i, 2]
        if not -math.pi <= yaw < math.pi:
            particles[i, 2] = yaw - full * math.floor((yaw + math.pi) / full)


@kernel
def turn_by(particles: NDArray[np.float64], turns: NDArray[np.float64], distance: float) -> None:
    """Turn each of the `particles` by its own rate (rad/m) times `distance` (m)."""
    for i in range(len(particles)):
        particles[i, 2] += turns[i] * distance


@kernel
def draw_turns(
    turns: NDArray[np.float64],
    parents: NDArray[np.int64],
    start: float,
    walk: float,
    state: NDArray[np.uint64],
    out: NDArray[np.float64],
) -> None:
    """Inherit the turn rates (rad/m) of the `parents` (n,) with a normal step `walk`; without one (-1), draw from `start`."""
    for i in range(len(parents)):
        out[i] = turns[parents[i]] + normal(walk, state) if parents[i] >= 0 else normal(start, state)


# ----------------------------------------------------------------------------------------------------------------------
# Resampling with an adapted number of particles (Fox: Adapting the sample size .. through KLD-sampling, 2003).


RESAMPLING = np.dtype(
    [
        ("pop_err", np.float64),
        ("pop_z", np.float64),
        ("min_particles", np.int64),
        ("max_particles", np.int64),
        ("injected_share", np.float64),
        ("wrapped", np.bool_),
        ("one_bin_asks_for_max", np.bool_),
        ("free_x", np.float64),
        ("free_y", np.float64),
        ("free_resolution", np.float64),
        ("spread", np.float64),
    ],
    align=True,
)
"""Settings of `resample`, an array (1,). A free cell (ix, iy) is at `free_x + ix * free_resolution`; `spread` is the width of the
uniform offset about it in cells (amcl: 0)."""


@kernel
def particle_limit(bins: int, settings: NDArray[np.void]) -> int:
    """Return the number of particles for so many occupied bins: the KL distance is below `pop_err` with the quantile `pop_z`."""
    least, most = settings[0]["min_particles"], settings[0]["max_particles"]
    if bins <= 1:
        return most if settings[0]["one_bin_asks_for_max"] else least
    b = 2.0 / (9.0 * (bins - 1))
    root = 1.0 - b + math.sqrt(b) * settings[0]["pop_z"]
    number = math.ceil((bins - 1) / (2.0 * settings[0]["pop_err"]) * root * root * root)
    if number < least:
        return least
    return most if number > most else int(number)


@kernel
def draw_uniform(
    free: NDArray[np.int32], settings: NDArray[np.void], state: NDArray[np.uint64], out: NDArray[np.float64]
) -> None:
    """Write a uniform pose over the free cells `free` (m, 2; ix, iy) into `out` (3,)."""
    index = min(int(uniform(state) * len(free)), len(free) - 1)
    x, y = float(free[index, 0]), float(free[index, 1])
    spread = settings[0]["spread"]
    if spread > 0.0:
        x += spread * (uniform(state) - 0.5)
        y += spread * (uniform(state) - 0.5)
    out[0] = settings[0]["free_x"] + x * settings[0]["free_resolution"]
    out[1] = settings[0]["free_y"] + y * settings[0]["free_resolution"]
    out[2] = uniform(state) * 2.0 * math.pi - math.pi


@kernel
def draw_uniform_set(
    free: NDArray[np.int32], settings: NDArray[np.void], state: NDArray[np.uint64], out: NDArray[np.float64]
) -> None:
    """Fill `out` (n, 3) with uniform poses over the free cells."""
    for i in range(len(out)):
        draw_uniform(free, settings, state, out[i])


@kernel
def cumulate(weights: NDArray[np.float64], sums: NDArray[np.float64], guide: NDArray[np.int32]) -> None:
    """Fill `sums` (n + 1,) with the running sums of `weights` (n,), and `guide` (m + 1,) with where searches begin.

    `guide[i]` is the last interval that begins at or before i / m.
    """
    n, m = len(weights), len(guide) - 1
    sums[0] = 0.0
    for i in range(n):
        sums[i + 1] = sums[i] + weights[i]
    j = 0
    for i in range(m + 1):
        edge = i / m
        while j < n - 1 and sums[j + 1] <= edge:
            j += 1
        guide[i] = j


@kernel
def pick(sums: NDArray[np.float64], guide: NDArray[np.int32], value: float) -> int:
    """Return the index j with sums[j] <= value < sums[j + 1]."""
    n = len(sums) - 1
    j = guide[int(value * (len(guide) - 1))]
    while j > 0 and sums[j] > value:
        j -= 1
    while j < n - 1 and sums[j + 1] <= value:
        j += 1
    return j


@kernel
def resample(
    particles: NDArray[np.float64],
    sums: NDArray[np.float64],
    guide: NDArray[np.int32],
    free: NDArray[np.int32],
    settings: NDArray[np.void],
    state: NDArray[np.uint64],
    keys: NDArray[np.int64],
    out: NDArray[np.float64],
    parents: NDArray[np.int64],
) -> int:
    """Draw particles with replacement into `out` (max, 3) until their number exceeds that of the occupied bins; return it.

    `parents` (max,) receives the index of each one's particle, -1 for a uniform pose.
    """
    keys[:] = -1
    wrapped = settings[0]["wrapped"]
    share = settings[0]["injected_share"]
    most = min(settings[0]["max_particles"], len(out))
    occupied = 0
    limit = particle_limit(0, settings)
    n = 0
    while n < most:
        if uniform(state) < share:
            draw_uniform(free, settings, state, out[n])
            parents[n] = -1
        else:
            j = pick(sums, guide, uniform(state))
            parents[n] = j
            out[n, 0] = particles[j, 0]
            out[n, 1] = particles[j, 1]
            out[n, 2] = particles[j, 2]
        key = bin_of(out[n, 0], out[n, 1], out[n, 2], wrapped)
        slot = slot_of(keys, key)
        if keys[slot] == -1:
            keys[slot] = key
            occupied += 1
            limit = particle_limit(occupied, settings)
        n += 1
        if n > limit:
            break
    return n


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
        self.random = random_state(seed)
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
        self._settings = np.zeros(1, RESAMPLING)
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
        return count_bins(self.poses, self._wrapped, self._keys, self._numbers, self._members, self._bins)

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
        draw_gaussian(center, np.ascontiguousarray(axes), sigmas, self.random, self.poses)
        self._wrap()

    def draw_uniform(self, free: NDArray[np.int32], origin: tuple[float, float], cell: float) -> None:
        """Draw all particles uniformly over the free cells (m, 2), of which (0, 0) is centered at `origin` (m)."""
        self._begin(len(self._poses))
        self._place(origin, cell)
        draw_uniform_set(free, self._settings, self.random, self.poses)

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
            turn_by(self.poses, self.turns, half)
        move = move_diff if model.startswith("diff") else move_omni
        move(self.poses, motion, start_yaw, alphas, model.endswith("corrected"), self.random)
        if half:
            turn_by(self.poses, self.turns, half)
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
        cumulate(self.weights, sums, guide)
        self.count = resample(
            self.poses, sums, guide, free, self._settings, self.random, self._keys, self._next, self._parents
        )
        self._poses, self._next = self._next, self._poses
        self.weights[:] = 1.0 / self.count
        parents = self._parents[: self.count]
        self.injected = int(np.count_nonzero(parents < 0)) if share > 0.0 else 0
        if self._learns:
            turns = self._turns.copy()
            draw_turns(turns, parents, START_TURN, TURN_STEP, self.random, self._turns)
        if share > 0.0:
            self.slow = self.fast = 0.0
        self.converged = self.is_converged()

    def clusters(self) -> Clusters:
        """Return the connected groups of particles."""
        bins = self.bin_count
        labels, stack = np.empty(bins, np.int32), np.empty(bins, np.int32)
        number = label_bins(bins, self._wrapped, self._keys, self._numbers, self._bins, labels, stack)
        sums = np.zeros((number, 9))
        add_up(self.poses, self.weights, self._members, labels, sums)
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
            draw_turns(self._turns, none, START_TURN, 0.0, self.random, self._turns)
        self.slow = self.fast = 0.0
        self.converged = False
        self.injected = 0

    def _place(self, origin: tuple[float, float], cell: float) -> None:
        self._settings["free_x"], self._settings["free_y"] = origin
        self._settings["free_resolution"] = cell

    def _wrap(self) -> None:
        if self._wrapped:
            wrap_yaws(self.poses)

    def is_converged(self) -> bool:
        """Return True if every particle is within half a meter of their mean, in x and in y."""
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
