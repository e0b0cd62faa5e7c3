"""Resampling with an adapted number of particles (Fox: Adapting the sample size .. through KLD-sampling, 2003)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel
from navstack.localization.amcl._histogram_kernels import bin_of, slot_of
from navstack.localization.amcl._random_kernels import uniform

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
