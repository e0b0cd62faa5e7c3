"""What every replanning does to costs and paths, against plain versions: changed cells, and loops of a path."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.global_planner._search.traceback import without_loops
from navstack.global_planner._search.wavefront import differing


@pytest.mark.parametrize("size", [0, 1, 7, 8, 9, 64, 1000])
def test_finds_the_bytes_that_differ(size: int) -> None:
    rng = np.random.default_rng(size)
    for changes in (0, 1, size // 3, size):
        before = rng.integers(0, 256, size).astype(np.uint8)
        after = before.copy()
        after[rng.integers(0, max(size, 1), min(changes, size))] += 1
        expected = np.flatnonzero(before != after)
        for room in (size + 1, max(len(expected) // 2, 1)):
            found = np.empty(room, np.int64)
            count = differing(before, after, found)
            assert found[:count].tolist() == expected[:room].tolist()


def plain(points: NDArray[np.float32], nx: int) -> list[list[float]]:
    """Walks the path, and jumps to the last visit of a cell where a run of points in it is not the last one."""
    cells = [round(float(y)) * nx + round(float(x)) for x, y in points]
    kept, i = [True] * len(cells), 0
    while i < len(cells):
        left = i
        while left + 1 < len(cells) and cells[left + 1] == cells[i]:
            left += 1
        last = max(k for k, cell in enumerate(cells) if cell == cells[i])
        if last != left:
            kept[i + 1 : last] = [False] * (last - i - 1)
            while left < last:  # the runs within the loop have no say
                left += 1
            while left + 1 < len(cells) and cells[left + 1] == cells[left]:
                left += 1
        i = left + 1
    return [point for point, keep in zip(points.tolist(), kept, strict=True) if keep]


@pytest.mark.parametrize("seed", range(30))
def test_removes_the_loops_of_a_path(seed: int) -> None:
    """Random walks with many loops, and drifting ones with few."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-0.6, 0.6 + 0.3 * (seed % 3), (int(rng.integers(0, 200)), 2))
    points = (np.cumsum(steps, axis=0) + 300.0).astype(np.float32)
    assert without_loops(points, 900).tolist() == plain(points, 900)
