# pyright: basic
"""Drive-odds of an occupancy grid from scans with known poses.

Source of the formula: Moravec and Elfes (High resolution maps from wide angle sonar, ICRA 1985), with log-odds as in Thrun et al.
(Probabilistic Robotics, chapter 9).
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import line_next, line_start

MODEL = np.dtype([("resolution", "f8"), ("hit", "f4"), ("miss", "f4"), ("limit", "f4")])
"""Resolution (m) and what a hit adds to the log-odds of a cell, a miss takes away, and their largest absolute value."""


@kernel
def add_scan(odds, seen, number, eye, ends, model):
    """Add one scan to the log-odds `odds` (ny, nx) float32; each cell changes once at most, and a hit wins over a miss.

    `seen` (ny, nx) int32: number of the last scan that changed a cell; `number`: of this scan, greater than all before; `eye`
    (2,): the sensor; `ends` (n, 3): ends of the beams and 1 for a return, 0 for none; both relative to the grid's corner (m).
    """
    m = model[0]
    ny, nx = odds.shape
    flat, marks = odds.ravel(), seen.ravel()
    per = 1.0 / m.resolution
    x0, y0 = math.floor(eye[0] * per), math.floor(eye[1] * per)
    if not (0 <= x0 < nx and 0 <= y0 < ny):
        return
    for i in range(ends.shape[0]):
        x, y = math.floor(ends[i, 0] * per), math.floor(ends[i, 1] * per)
        if ends[i, 2] > 0.0 and 0 <= x < nx and 0 <= y < ny and marks[y * nx + x] != number:
            marks[y * nx + x] = number
            flat[y * nx + x] = min(flat[y * nx + x] + m.hit, m.limit)
    for i in range(ends.shape[0]):
        x, y = math.floor(ends[i, 0] * per), math.floor(ends[i, 1] * per)
        line = line_start(x0, y0, x, y, nx)
        cell, error = y0 * nx + x0, line[0] // 2
        cx = x0
        for _ in range(line[0]):
            if not 0 <= cell < ny * nx or abs(cell % nx - cx) > 1:
                break  # left the grid
            cx = cell % nx
            if marks[cell] != number:
                marks[cell] = number
                flat[cell] = max(flat[cell] - m.miss, -m.limit)
            cell, error = line_next(cell, error, line)
