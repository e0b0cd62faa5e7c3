"""The time of a fixed piece of work, a measure of the current speed of the machine."""

from __future__ import annotations

import math
import time
from typing import Final

import numpy as np

from navstack.bench._calibration_kernels import flood, relax

CALIBRATION_RUNS: Final = 7
_CELLS: Final = 1200


def calibration_ms(repeats: int = CALIBRATION_RUNS) -> float:
    """Best time (ms) of a breadth-first search on 1200 x 1200 cells, a quarter of them blocked, and one relaxation sweep."""
    n = _CELLS
    rng = np.random.default_rng(7)
    blocked = rng.random((n, n)) < 0.25
    blocked[[0, -1], :] = True
    blocked[:, [0, -1]] = True
    blocked[n // 2, n // 2] = False
    field = rng.random((n, n), np.float32) * np.float32(100.0)
    best = math.inf
    for _ in range(repeats + 1):  # the first run loads the kernels
        work = field.copy()
        start = time.thread_time()
        # the allocation is part of the measured work
        distance, queue = np.empty(n * n, np.int32), np.empty(n * n, np.int32)
        flood(blocked, n // 2 * n + n // 2, distance, queue)
        relax(work)
        best = min(best, time.thread_time() - start)
    return best * 1e3
