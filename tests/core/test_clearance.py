"""The clearance of a path, against distances computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, clearance
from navstack.core.clearance import clearance_along
from navstack.core.costs import LETHAL

LINE = np.array([[1.0, 2.0], [9.0, 2.0]])


def costmap(*cells: tuple[int, int]) -> Costmap:
    """Cells of 0.1 m from (0, 0) to (10, 20); these, (ix, iy), are lethal."""
    data = np.zeros((200, 100), np.uint8)
    for ix, iy in cells:
        data[iy, ix] = LETHAL
    return Costmap(GridGeometry(100, 200, 0.1, 0.0, 0.0), data)


@pytest.mark.parametrize("few_pairs", [10**9, 0], ids=["all pairs", "tree"])
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
def test_distance_of_a_line_from_lethal_cells(
    cells: list[tuple[int, int]], distance: float, few_pairs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clearance, "_FEW_PAIRS", few_pairs)
    assert clearance_along(costmap(*cells), LINE) == pytest.approx(distance, abs=1e-9)
