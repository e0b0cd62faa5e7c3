"""The clearance of a path, against distances computed by hand."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry
from navstack.core.clearance import clearance_along
from navstack.core.costs import LETHAL

LINE = np.array([[1.0, 2.0], [9.0, 2.0]])


def costmap(*cells: tuple[int, int]) -> Costmap:
    """Cells of 0.1 m from (0, 0) to (10, 20); these, (ix, iy), are lethal."""
    data = np.zeros((200, 100), np.uint8)
    for ix, iy in cells:
        data[iy, ix] = LETHAL
    return Costmap(GridGeometry(100, 200, 0.1, 0.0, 0.0), data)


@pytest.mark.parametrize(
    ("cells", "distance"),
    [
        ([(50, 25)], 0.5),  # its lower edge is at y = 2.5
        ([(50, 25), (50, 14)], 0.5),  # the upper edge of the other at 1.5
        ([(50, 25), (50, 15)], 0.4),
        ([(50, 150)], 13.0),  # farther than the first window
        ([(93, 24)], 0.5),  # beyond the end: 0.3 to the right, 0.4 above
        ([(50, 20)], 0.0),
        ([], math.inf),
    ],
)
def test_distance_of_a_line_from_lethal_cells(cells: list[tuple[int, int]], distance: float) -> None:
    assert clearance_along(costmap(*cells), LINE) == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize("share", [0.002, 0.05, 0.3])
def test_distance_of_any_line_is_that_of_all_pairs(share: float) -> None:
    """Random cells around a random walk of 2 to 300 corners, against every sampled point and every cell."""
    rng = np.random.default_rng(round(1000 * share))
    for _ in range(20):
        data = np.where(rng.random((200, 100)) < share, LETHAL, 0).astype(np.uint8)
        walk = np.clip(np.cumsum(rng.normal(0.0, 0.1, (int(rng.integers(2, 300)), 2)), axis=0) + (5.0, 10.0), 0.2, 9.8)
        points = np.concatenate(
            [
                a + (b - a) * np.linspace(0.0, 1.0, 1 + math.ceil(np.hypot(*(b - a)) / 0.05))[:, None]
                for a, b in pairwise(walk)
            ]
        )
        ys, xs = np.nonzero(data == LETHAL)
        gaps = np.abs(np.column_stack((xs + 0.5, ys + 0.5))[None] * 0.1 - points[:, None]) - 0.05
        expected = np.hypot(*np.moveaxis(np.maximum(gaps, 0.0), 2, 0)).min() if len(xs) else math.inf
        assert clearance_along(Costmap(GridGeometry(100, 200, 0.1, 0.0, 0.0), data), walk) == pytest.approx(
            expected, abs=1e-9
        )
