"""The sensor models of amcl: how well a scan fits each particle (amcl/src/amcl/sensors/amcl_laser.cpp).

Beams are (forward, left) end points in the base frame in cells; tables hold a value per cell, with a border of one cell for
everything off the map. `FIELD` places the table: a point x (m) has the column `(x - center_x) / cell + shift_x` of the table.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel

FIELD = np.dtype(
    [
        ("center_x", np.float64),
        ("center_y", np.float64),
        ("cell", np.float64),
        ("shift_x", np.float64),
        ("shift_y", np.float64),
    ],
    align=True,
)
BLOCK = 256


@kernel
def add_beams(
    particles: NDArray[np.float64],
    beams: NDArray[np.float64],
    table: NDArray[np.float64],
    field: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Add the table's values at the end points of `beams` (m, 2) to `out` (n,), for each of the `particles` (n, 3)."""
    ny, nx = table.shape
    flat = table.ravel()
    last_x, last_y = float(nx - 1), float(ny - 1)
    scale = 1.0 / field[0]["cell"]
    center_x, center_y = field[0]["center_x"], field[0]["center_y"]
    shift_x, shift_y = field[0]["shift_x"], field[0]["shift_y"]
    x = np.empty(BLOCK)
    y = np.empty(BLOCK)
    c = np.empty(BLOCK)
    s = np.empty(BLOCK)
    cells = np.empty(BLOCK, np.int32)
    for first in range(0, len(particles), BLOCK):
        size = min(BLOCK, len(particles) - first)
        for i in range(size):
            yaw = particles[first + i, 2]
            c[i], s[i] = math.cos(yaw), math.sin(yaw)
            x[i] = (particles[first + i, 0] - center_x) * scale + shift_x
            y[i] = (particles[first + i, 1] - center_y) * scale + shift_y
        block = out[first : first + size]
        for k in range(len(beams)):
            ahead, left = beams[k, 0], beams[k, 1]
            for i in range(size):
                column = min(max(x[i] + (c[i] * ahead - s[i] * left), 0.0), last_x)
                row = min(max(y[i] + (s[i] * ahead + c[i] * left), 0.0), last_y)
                cells[i] = np.int32(row) * np.int32(nx) + np.int32(column)
            for i in range(size):
                block[i] += flat[cells[i]]


@kernel
def multiply_beams(
    particles: NDArray[np.float64],
    beams: NDArray[np.float64],
    table: NDArray[np.float64],
    field: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Multiply `out` (n,) by the table's values at the end points of `beams`, as `add_beams` adds them.

    Products are taken in groups of beams, so that they do not underflow before the whole does.
    """
    logs = np.zeros(len(out))
    add_beams(particles, beams, table, field, logs)
    for i in range(len(out)):
        out[i] *= math.exp(logs[i])


@kernel
def count_agreeing(
    particles: NDArray[np.float64],
    beams: NDArray[np.float64],
    near: NDArray[np.float64],
    field: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Count for each beam the particles that it agrees with: `near` is a table of ones and zeros, `out` (m,)."""
    agree = np.empty(len(particles))
    for k in range(len(beams)):
        agree[:] = 0.0
        add_beams(particles, beams[k : k + 1], near, field, agree)
        out[k] = agree.sum()
