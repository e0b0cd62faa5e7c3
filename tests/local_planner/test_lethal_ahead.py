"""The obstacle critic visits only lethal cells: equal to a test of every cell around the footprint."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import overlaps_cell
from navstack.local_planner.critics.obstacle import overlaps_lethal_ahead, write_lethal_ahead


@pytest.mark.parametrize("seed", range(20))
def test_equals_a_test_of_every_cell(seed: int) -> None:
    """Polygons from a cell to a hundred in size, on maps with few and many lethal cells, wider than 255 cells too."""
    rng = np.random.default_rng(seed)
    ny, nx = int(rng.integers(20, 120)), int(rng.integers(20, 600))
    costs = np.where(rng.random((ny, nx)) < 10.0 ** rng.uniform(-2.5, -1.0), 254, 100).astype(np.uint8)
    ahead = np.empty_like(costs)
    write_lethal_ahead(costs, 0, 0, nx, ny, 3, ahead)
    lethal = np.argwhere(costs == 254)
    met = 0
    for _ in range(12):
        corners = np.exp(rng.uniform(-1.0, np.log(0.5 * nx))) * rng.uniform(-1.0, 1.0, (2, int(rng.integers(3, 7))))
        placed = np.clip(corners + rng.uniform((0.0,), 1.0, (2, 1)) * [[nx], [ny]], 0.0, [[nx - 1e-6], [ny - 1e-6]])
        expected = any(overlaps_cell(placed, ix, iy) for iy, ix in lethal.tolist())
        assert bool(overlaps_lethal_ahead(ahead, placed)) == expected
        met += expected
    assert met > 0
