# pyright: basic
"""Normally distributed noise from a counter: every number is a function of the key and its index."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner.mppi._sine_kernels import LANES, turn_sine

f32 = np.float32
u32 = np.uint32


@kernel
def mixed(value, key):
    """Return a hash of 32 bits: two rounds of multiplication and shift, the second half of the key between them."""
    h = u32(value ^ (value >> u32(16)))
    h = u32(h * u32(0x21F0AAAD))
    h = u32((h ^ (h >> u32(15))) ^ key)
    h = u32(h * u32(0xD35A2D97))
    h = u32(h ^ (h >> u32(15)))
    h = u32(h * u32(0x735A2D97))
    return u32(h ^ (h >> u32(15)))


@kernel
def fill_normals(keys, sigma, out):
    """Write independent normal numbers of standard deviation `sigma` to `out` (n,) float32, n a multiple of 2 * LANES.

    `keys` (2,) uint32. Box and Muller's method on two uniform numbers of 24 bits, on LANES pairs at a time.
    """
    first, second = keys[0], keys[1]
    uniform = np.empty(2 * LANES, np.float32)
    bits = uniform.view(np.uint32)
    exponent = np.empty(LANES, np.float32)
    for begin in range(0, len(out), 2 * LANES):
        for i in range(LANES):
            number = u32(u32(begin + 2 * i) + first)
            # in (0, 1], because of the logarithm
            uniform[i] = (f32(np.int32(mixed(number, second) >> u32(8))) + f32(1.0)) * f32(2.0**-24)
            uniform[LANES + i] = f32(np.int32(mixed(u32(number + u32(1)), second) >> u32(8))) * f32(2.0**-24)
        # u = m * 2**e with m in [1, 2)
        for i in range(LANES):
            exponent[i] = f32(np.int32(bits[i] >> u32(23)) - np.int32(127))
            bits[i] = u32((bits[i] & u32(0x007FFFFF)) | u32(0x3F800000))
        row = out[begin : begin + 2 * LANES]
        for i in range(LANES):
            m = uniform[i]
            large = m > f32(1.4142135)
            e = exponent[i] + f32(1.0) if large else exponent[i]
            x = (f32(0.5) * m if large else m) - f32(1.0)
            # log(1 + x) on [-0.293, 0.414]: Chebyshev fit of (log(1 + x) - x + x * x / 2) / x**3, error below 1e-7
            z = x * x
            p = f32(7.0376836e-2) * x - f32(1.1514610e-1)
            p = p * x + f32(1.1676998e-1)
            p = p * x - f32(1.2420141e-1)
            p = p * x + f32(1.4249323e-1)
            p = p * x - f32(1.6668057e-1)
            p = p * x + f32(2.0000714e-1)
            p = p * x - f32(2.4999994e-1)
            p = p * x + f32(3.3333331e-1)
            logarithm = (p * x * z - f32(0.5) * z) + x + e * f32(0.6931472)
            radius = np.sqrt(max(f32(-2.0) * logarithm, f32(0.0))) * sigma
            sine, cosine = turn_sine(uniform[LANES + i])
            row[i] = radius * cosine
            row[LANES + i] = radius * sine
