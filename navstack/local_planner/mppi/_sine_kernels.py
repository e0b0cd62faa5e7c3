# pyright: basic
"""Sine and cosine in float32, without branches, so that loops over lanes are vectorized. Accurate to 1e-7."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel

f32 = np.float32
LANES = 64
"""Trajectories that a kernel works on at a time: a constant, so that the compiler knows that its buffers do not overlap."""


@kernel
def quadrant_sine(angle, quadrant):
    """Return sine and cosine of `angle`, within pi / 4 of zero, plus `quadrant` quarter turns.

    Polynomials of the least maximum error on the quarter turn, of degree 7 and 8.
    """
    z = angle * angle
    s = ((f32(-1.9515296e-4) * z + f32(8.3321609e-3)) * z - f32(1.6666655e-1)) * z * angle + angle
    c = ((f32(2.4433157e-5) * z - f32(1.3887316e-3)) * z + f32(4.1666646e-2)) * z * z - f32(0.5) * z + f32(1.0)
    swap = (quadrant & np.int32(1)) != 0
    sine = c if swap else s
    cosine = s if swap else c
    sine = -sine if (quadrant & np.int32(2)) != 0 else sine
    cosine = -cosine if ((quadrant + np.int32(1)) & np.int32(2)) != 0 else cosine
    return sine, cosine


@kernel
def sine_cosine(angle):
    """Return sine and cosine of an angle (rad)."""
    quarters = np.floor(angle * f32(0.63661977) + f32(0.5))
    # pi / 2 in three parts, so that the product with a small integer is exact (Cody and Waite)
    rest = ((angle - quarters * f32(1.5703125)) - quarters * f32(4.8375130e-4)) - quarters * f32(7.5497899e-8)
    return quadrant_sine(rest, np.int32(quarters))


@kernel
def turn_sine(turns):
    """Return sine and cosine of an angle in whole turns."""
    quarters = np.floor(turns * f32(4.0) + f32(0.5))
    return quadrant_sine((turns - quarters * f32(0.25)) * f32(6.2831855), np.int32(quarters))
