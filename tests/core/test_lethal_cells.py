"""The lethal cells that a line crosses."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from navstack.core import LETHAL, Costmap, GridGeometry, lethal_cells_along


def costmap_with(*cells: tuple[int, int], origin: tuple[float, float] = (0.0, 0.0)) -> Costmap:
    costmap = Costmap(GridGeometry(20, 10, 0.5, *origin))
    for ix, iy in cells:
        costmap.data[iy, ix] = LETHAL
    return costmap


@pytest.mark.parametrize(
    ("cells", "points", "expected"),
    [
        ([(4, 2)], [(0.25, 1.25), (5.0, 1.25)], (1, 1.75)),
        ([(4, 2), (5, 2), (8, 2)], [(0.25, 1.25), (1.0, 1.25), (5.0, 1.25)], (3, 1.75)),
        ([(4, 2)], [(5.0, 1.25), (0.25, 1.25)], (1, 2.5)),
        ([(4, 2)], [(0.25, 1.25), (1.9, 1.25)], (0, math.inf)),
        ([(0, 0)], [(0.1, 0.1)], (1, 0.0)),
        ([(1, 0)], [(0.0, 0.0), (1.0, 1.0)], (0, math.inf)),  # touches a corner
        ([(0, 1)], [(0.01, 0.4), (0.11, 0.501)], (1, 0.140723)),  # cuts a corner
        ([(4, 2)], [(-3.0, 1.25), (30.0, 1.25)], (1, 5.0)),  # from outside
        ([(4, 2)], [(0.25, 1.25), (3.0, 1.25), (0.25, 1.25)], (1, 1.75)),  # there and back: one cell
    ],
)
def test_cells_and_first(
    cells: list[tuple[int, int]], points: list[tuple[float, float]], expected: tuple[int, float]
) -> None:
    count, first = lethal_cells_along(costmap_with(*cells), np.array(points))
    assert count == expected[0]
    assert first == pytest.approx(expected[1], abs=1e-6)


def test_as_a_dense_walk_finds_them() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        costmap = costmap_with(*map(tuple, rng.integers(0, 10, (30, 2)).tolist()), origin=(-1.0, 2.0))
        points = rng.uniform((-2.0, 1.0), (9.0, 8.0), (4, 2))
        dense = np.concatenate([np.linspace(a, b, 20_001) for a, b in itertools.pairwise(points)])
        cells = np.floor((dense - (-1.0, 2.0)) / 0.5).astype(int)
        inside = ((cells >= 0) & (cells < (20, 10))).all(axis=1)
        hit = np.zeros(len(cells), bool)
        hit[inside] = costmap.data[cells[inside, 1], cells[inside, 0]] == LETHAL
        driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))))
        count, first = lethal_cells_along(costmap, points)
        assert count == len({tuple(cell) for cell in cells[hit].tolist()})
        assert first == pytest.approx(driven[hit.argmax()] if hit.any() else math.inf, abs=2e-3)
