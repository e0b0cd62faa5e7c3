from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D
from navstack.core.collision import footprint_cost, turn_cost
from navstack.core.errors import InputError
from tests.conftest import golden_files

SQUARE = Footprint(np.array([[0.3, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.3, -0.2]]))
HOOK = Footprint(
    np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4], [0.4, -0.2], [-0.2, -0.2], [-0.2, 0.2], [0.4, 0.2]])
)


def grid() -> Costmap:
    return Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0))


@pytest.mark.parametrize("file", golden_files("dwa_footprint_cost*.npz"), ids=lambda f: f.stem)
def test_edge_costs_match_cpp(file: object) -> None:
    golden = np.load(file)  # type: ignore[call-overload]
    ox, oy, resolution = (float(v) for v in golden["footprint_costmap_info"])
    data = np.ascontiguousarray(golden["footprint_costmap"])
    costmap = Costmap(GridGeometry(data.shape[1], data.shape[0], resolution, ox, oy), data)
    outlines = [Footprint(golden["footprint_circle"]), Footprint(golden["footprint_rect"])]
    differing = 0
    for x, y, yaw, *theirs in golden["footprint_cost"]:
        for outline, expected in zip(outlines, theirs, strict=True):
            cost = footprint_cost(costmap, outline, Pose2D(x, y, yaw), interior=False)
            if expected < 0:
                # -1 lethal, -2 unknown, -3 outside; C++ returns the first one found, navstack prefers outside
                assert cost is None or cost >= 254
                differing += (cost is None) != (expected == -3)
            else:
                assert cost == expected
            whole = footprint_cost(costmap, outline, Pose2D(x, y, yaw))
            assert (whole is None) == (cost is None)
            assert cost is None or (whole is not None and whole >= cost)
    assert differing <= 0.01 * len(golden["footprint_cost"]) * 2


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from([SQUARE, HOOK]),
    st.floats(-1.3, 1.3),
    st.floats(-1.3, 1.3),
    st.floats(-10.0, 10.0),
    st.integers(0, 2**32 - 1),
)
def test_every_cell_with_its_center_inside_counts(
    outline: Footprint, x: float, y: float, yaw: float, seed: int
) -> None:
    pose = Pose2D(x, y, yaw)
    costmap = grid()
    polygon = shapely.Polygon(outline.at(pose))
    xs = -2.0 + (np.arange(80) + 0.5) * 0.05
    inside = shapely.contains_xy(polygon.buffer(-1e-9), *np.meshgrid(xs, xs))
    assert footprint_cost(costmap, outline, pose) == 0
    rows, columns = np.nonzero(inside)
    k = np.random.default_rng(seed).integers(len(rows))
    costmap.data[rows[k], columns[k]] = 254
    assert footprint_cost(costmap, outline, pose) == 254
    # cells farther than a cell's diagonal do not count
    away = shapely.contains_xy(polygon.buffer(0.075), *np.meshgrid(xs, xs))
    costmap.data[:] = np.where(away, 7, 254)
    center = costmap.geometry.world_to_cell(x, y)
    assert center is not None
    costmap.data[center[1], center[0]] = 7
    assert footprint_cost(costmap, outline, pose) == 7


def test_outside_is_none() -> None:
    for pose in (
        Pose2D(1.9, 0.0),
        Pose2D(-1.9, 0.0),
        Pose2D(0.0, 5.0),
        Pose2D(math.nan, 0.0),
        Pose2D(0.0, 0.0, math.inf),
    ):
        assert footprint_cost(grid(), SQUARE, pose) is None


def test_turn_cost_is_the_highest_cost_of_its_poses() -> None:
    costmap = grid()
    cell = costmap.geometry.world_to_cell(0.0, 0.28)
    assert cell is not None
    costmap.data[cell[1], cell[0]] = 254
    for arc, free_for in ((3.0, None), (-6.2, None), (0.3, 0.3)):
        cost, turned = turn_cost(costmap, SQUARE, Pose2D(0.0, 0.0), arc)
        if free_for is not None:
            assert (cost, turned) == (0, free_for)
            continue
        assert cost == 254
        before = [math.copysign(a, arc) for a in np.arange(0.0, abs(turned) - 1e-6, 0.017)]
        assert all(footprint_cost(costmap, SQUARE, Pose2D(0.0, 0.0, a)) == 0 for a in before)
        assert footprint_cost(costmap, SQUARE, Pose2D(0.0, 0.0, turned)) == 254


def test_turn_checks_the_end_of_the_arc() -> None:
    costmap = grid()
    cell = costmap.geometry.world_to_cell(0.0, 0.28)
    assert cell is not None
    costmap.data[cell[1], cell[0]] = 254
    assert turn_cost(costmap, SQUARE, Pose2D(0.0, 0.0), math.pi / 2.0, step=1.0)[0] == 254


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan, math.inf])
def test_invalid_steps_are_rejected(step: float) -> None:
    with pytest.raises(InputError):
        turn_cost(grid(), SQUARE, Pose2D(0.0, 0.0), 1.0, step=step)
    with pytest.raises(InputError):
        turn_cost(grid(), SQUARE, Pose2D(0.0, 0.0), math.nan)
