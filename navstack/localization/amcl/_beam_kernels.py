"""The beam model: each range against the range that a ray through the map has (amcl/src/amcl/map/map_range.c, amcl_laser.cpp)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel

BEAM = np.dtype(
    [
        ("map_center_x", np.float64),
        ("map_center_y", np.float64),
        ("map_cell", np.float64),
        ("map_shift_x", np.float64),
        ("map_shift_y", np.float64),
        ("z_hit", np.float64),
        ("z_short", np.float64),
        ("z_max", np.float64),
        ("z_rand", np.float64),
        ("sigma_hit", np.float64),
        ("lambda_short", np.float64),
        ("farthest", np.float64),
    ],
    align=True,
)
"""The map's place and the mixture, an array (1,). A point x (m) has the column `floor((x - map_center_x) / map_cell +
map_shift_x)`; `farthest` is the greatest range (m)."""


@kernel
def cast(
    blocked: NDArray[np.bool_], beam: NDArray[np.void], x: float, y: float, bearing: float, longest: float
) -> float:
    """Return the range (m) of a ray over cells that are not `blocked` (ny, nx), by Bresenham's line; at most `longest` (m)."""
    ny, nx = blocked.shape
    cell = beam[0]["map_cell"]
    center_x, center_y = beam[0]["map_center_x"], beam[0]["map_center_y"]
    x0 = math.floor((x - center_x) / cell + beam[0]["map_shift_x"])
    y0 = math.floor((y - center_y) / cell + beam[0]["map_shift_y"])
    x1 = math.floor((x + longest * math.cos(bearing) - center_x) / cell + beam[0]["map_shift_x"])
    y1 = math.floor((y + longest * math.sin(bearing) - center_y) / cell + beam[0]["map_shift_y"])
    steep = abs(y1 - y0) > abs(x1 - x0)
    a0, b0, a1, b1 = (y0, x0, y1, x1) if steep else (x0, y0, x1, y1)
    length, rise = abs(a1 - a0), abs(b1 - b0)
    step_a = 1 if a0 < a1 else -1
    step_b = 1 if b0 < b1 else -1
    error = 0
    a, b = a0, b0
    while True:
        ix, iy = (b, a) if steep else (a, b)
        if ix < 0 or iy < 0 or ix >= nx or iy >= ny or blocked[iy, ix]:
            return math.sqrt((a - a0) * (a - a0) + (b - b0) * (b - b0)) * cell
        if a == a1 + step_a:
            return longest
        a += step_a
        error += rise
        if 2 * error >= length:
            b += step_b
            error -= length


@kernel
def add_ranges(
    particles: NDArray[np.float64],
    laser: NDArray[np.float64],
    readings: NDArray[np.float64],
    blocked: NDArray[np.bool_],
    beam: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Add the cubed likelihoods of `readings` (m, 2; range, bearing) to `out` (n,); `laser` (3,) is in the base frame."""
    z_hit, z_short, z_max = beam[0]["z_hit"], beam[0]["z_short"], beam[0]["z_max"]
    farthest, decay = beam[0]["farthest"], beam[0]["lambda_short"]
    noise = beam[0]["z_rand"] / farthest
    spread = 2.0 * beam[0]["sigma_hit"] * beam[0]["sigma_hit"]
    for i in range(len(particles)):
        yaw = particles[i, 2]
        c, s = math.cos(yaw), math.sin(yaw)
        x = particles[i, 0] + c * laser[0] - s * laser[1]
        y = particles[i, 1] + s * laser[0] + c * laser[1]
        total = out[i]
        for k in range(len(readings)):
            reading = readings[k, 0]
            z = reading - cast(blocked, beam, x, y, yaw + laser[2] + readings[k, 1], farthest)
            p = z_hit * math.exp(-(z * z) / spread)
            if z < 0.0:
                p += z_short * decay * math.exp(-decay * reading)
            if reading == farthest:
                p += z_max
            elif reading < farthest:
                p += noise
            total += p * p * p
        out[i] = total
