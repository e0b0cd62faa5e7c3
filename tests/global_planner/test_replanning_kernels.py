"""What every replanning does to costs and paths, against plain versions: changed cells, and the loops of a path."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.global_planner._search.traceback import without_loops
from navstack.global_planner._search.wavefront import HIGH, apply_changes


@pytest.mark.parametrize("shape", [(1, 1), (3, 3), (5, 7), (16, 16), (20, 61), (40, 64)])
def test_takes_over_the_bytes_that_differ_and_queues_the_cells_that_got_cheaper(shape: tuple[int, int]) -> None:
    ny, nx = shape
    size = ny * nx
    rng = np.random.default_rng(size)
    steps = np.arange(256, dtype=np.float32)[::-1].copy()
    weights = np.where(np.arange(256) > 200, np.inf, steps).astype(np.float32)
    for changes in (0, 1, size // 3, size):
        before = rng.integers(0, 256, size).astype(np.uint8)
        after = before.copy()
        after[rng.integers(0, size, min(changes, size))] += rng.integers(1, 256, dtype=np.uint8)
        pot = rng.uniform(0.0, 100.0, size).astype(np.float32)
        pot[rng.random(size) < 0.5] = HIGH
        pending = (rng.random(size) < 0.2).astype(np.uint8)
        expected: list[int] = []
        lowest = float(HIGH)
        for k in np.flatnonzero(before != after).tolist():
            iy, ix = divmod(k, nx)
            if not (0 < ix < nx - 1 and 0 < iy < ny - 1) or pending[k]:
                continue
            if after[k] > 200 or (before[k] <= 200 and steps[after[k]] >= steps[before[k]]):
                continue
            near = float(min(pot[k - 1], pot[k + 1], pot[k - nx], pot[k + nx]))
            if near < HIGH:
                expected.append(k)
                lowest = min(lowest, near)
        differ = int(np.count_nonzero(before != after))
        old, queue, marked = before.copy(), np.empty(size, np.uint32), pending.copy()
        found = apply_changes(old, after, steps, weights, pot, marked, nx, size, queue)
        assert found == (differ, len(expected), pytest.approx(lowest, rel=1e-6))
        assert queue[: len(expected)].tolist() == expected
        assert np.array_equal(old, after)
        assert np.flatnonzero(marked != pending).tolist() == expected
        if differ > 1:
            assert apply_changes(before, after, steps, weights, pot, pending, nx, differ - 1, queue)[0] == -1


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
