"""The footprint check is exact: a cell counts if the footprint overlaps it, compared with shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D
from navstack.core.collision import footprint_cost

RESOLUTION = 0.05
CELLS = 60
LONG = Footprint(np.array([[0.45, 0.15], [-0.35, 0.15], [-0.35, -0.15], [0.45, -0.15]]), 0.01)
BOX = Footprint(np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]), 0.01)
ROUND = Footprint.from_radius(0.22, 0.01)
HOOK = Footprint(
    np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4], [0.4, -0.2], [-0.2, -0.2], [-0.2, 0.2], [0.4, 0.2]])
)
WEDGE = Footprint(np.array([[0.5, 0.003], [-0.3, 0.25], [-0.3, -0.25], [0.5, -0.003]]))


def overlap_m2(footprint: Footprint, pose: Pose2D) -> np.ndarray:
    """(CELLS, CELLS) area (m²) of each cell under the footprint."""
    low = -1.5 + np.arange(CELLS) * RESOLUTION
    left, bottom = np.meshgrid(low, low)
    cells = shapely.box(left, bottom, left + RESOLUTION, bottom + RESOLUTION)
    return shapely.area(shapely.intersection(cells, shapely.Polygon(footprint.at(pose))))


@pytest.mark.slow
@settings(deadline=None, max_examples=150)
@given(
    st.sampled_from([LONG, BOX, ROUND, HOOK, WEDGE]),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(-10.0, 10.0) | st.sampled_from([0.0, np.pi / 2, np.pi / 4]),
)
def test_every_overlapped_cell_counts(footprint: Footprint, x: float, y: float, yaw: float) -> None:
    pose = Pose2D(x, y, yaw)
    area = overlap_m2(footprint, pose)
    geometry = GridGeometry(CELLS, CELLS, RESOLUTION, -1.5, -1.5)
    for iy, ix in np.argwhere(area > 0.0):
        costs = np.zeros((CELLS, CELLS), np.uint8)
        costs[iy, ix] = 254
        if area[iy, ix] < 1e-9:  # a tenth of a micrometer: rounding decides
            continue
        assert footprint_cost(Costmap(geometry, costs), footprint, pose) == 254, (ix, iy, area[iy, ix])


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(st.sampled_from([LONG, BOX, ROUND, HOOK]), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-10.0, 10.0))
def test_other_cells_count_only_where_cpp_draws_an_edge(footprint: Footprint, x: float, y: float, yaw: float) -> None:
    pose = Pose2D(x, y, yaw)
    geometry = GridGeometry(CELLS, CELLS, RESOLUTION, -1.5, -1.5)
    costs = np.where(overlap_m2(footprint, pose) > 0.0, 0, 254).astype(np.uint8)
    costmap = Costmap(geometry, costs)
    center = geometry.world_to_cell(x, y)  # counts too, also where it is outside a concave footprint
    assert center is not None
    costs[center[1], center[0]] = 0
    edges = footprint_cost(costmap, footprint, pose, interior=False)
    assert footprint_cost(costmap, footprint, pose) == edges


def test_touching_a_cell_is_no_overlap() -> None:
    square = Footprint(np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]))
    costs = np.full((8, 8), 254, np.uint8)
    costs[2:6, 2:6] = 0
    costs[2:7, 6] = costs[6, 2:7] = 0  # C++ draws the edges at 0.3 m in the next cells
    costmap = Costmap(GridGeometry(8, 8, 0.0625), costs)
    pose = Pose2D(0.25, 0.25, 0.0)
    assert footprint_cost(costmap, Footprint(square.vertices * 1.25), pose) == 0
    assert footprint_cost(costmap, Footprint(square.vertices * 1.251), pose) == 254


@pytest.mark.slow
@pytest.mark.parametrize("footprint", [LONG, BOX])
def test_a_corner_of_one_square_centimeter_is_found(footprint: Footprint) -> None:
    """Bresenham from corner to corner misses cells that the footprint overlaps by up to several square centimeters."""
    geometry = GridGeometry(CELLS, CELLS, RESOLUTION, -1.5, -1.5)
    rng = np.random.default_rng(15)
    missed = 0
    for _ in range(100):
        pose = Pose2D(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3.0, 3.0))
        costs = np.where(overlap_m2(footprint, pose) >= 1e-4, 0, 254).astype(np.uint8)
        free = Costmap(geometry, 254 - costs)  # lethal: overlapped by at least 1 cm²
        assert footprint_cost(free, footprint, pose) == 254
        for iy, ix in np.argwhere(free.data):
            one = np.zeros_like(costs)
            one[iy, ix] = 254
            edges_only = footprint_cost(Costmap(geometry, one), footprint, pose, interior=False)
            missed += edges_only == 0
    assert missed > 1000
