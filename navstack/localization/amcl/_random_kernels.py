"""Random numbers of the particle filter: the 48-bit linear congruential generator of POSIX (`drand48`).

The state is an array (1,) of uint64, seeded with `random_state`. amcl draws from the same generator, so equal seeds give equal
particles (amcl/src/amcl/pf/pf_pdf.c).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel

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
