"""Properties of costmaps for any obstacles, scans and robot motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.ndimage import distance_transform_edt

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    InputError,
    LaserScan,
    Pose2D,
    Transform2D,
    Window,
)
from navstack.costmap import InflationLayer, InflationLayerParams, inflation_cost
from navstack.plugins import LayerContext
from tests.costmap.build import cloud, cloud_source, frames_at, inflation, obstacle, rolling, scan, scan_source

SETTINGS = settings(deadline=None, max_examples=50)
GRIDS = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(1, 24), st.integers(1, 40)),
    elements=st.sampled_from([0, 0, 0, 0, 0, 0, 0, 60, 253, 254, 255]),
)


def inflated(costs: np.ndarray, radius: float, *, unknown: bool = False, window: Window | None = None) -> np.ndarray:
    geometry = GridGeometry(costs.shape[1], costs.shape[0], 0.1)
    context = LayerContext(name="i", frame="map", frames=FrameTree(), footprint=Footprint.from_radius(0.15))
    layer = InflationLayer(
        InflationLayerParams(inflation_radius=radius, cost_scaling_factor=3.0, inflate_unknown=unknown), context
    )
    layer.match_size(geometry)
    master = Costmap(geometry, costs.copy())
    layer.update_costs(master, window or geometry.window)
    return master.data


@SETTINGS
@given(costs=GRIDS, radius=st.floats(0.0, 3.0), unknown=st.booleans())
def test_inflation_is_the_formula_of_the_exact_distance(costs: np.ndarray, radius: float, unknown: bool) -> None:
    inscribed = Footprint.from_radius(0.15).inscribed_radius
    expected = costs.astype(int)
    cells = math.ceil(radius / 0.1)
    if (costs == 254).any() and cells:
        d = np.sqrt(np.rint(distance_transform_edt(costs != 254) ** 2))
        cost = np.where(d <= cells, inflation_cost(d * 0.1, inscribed, 3.0), 0)
        threshold = 1 if unknown else 253
        expected = np.where(costs == 255, np.where(cost >= threshold, cost, 255), np.maximum(costs, cost))
    np.testing.assert_array_equal(inflated(costs, radius, unknown=unknown), expected)


@SETTINGS
@given(costs=GRIDS, radii=st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 2.0)))
def test_inflation_grows_with_the_radius(costs: np.ndarray, radii: tuple[float, float]) -> None:
    known = np.where(costs == 255, 0, costs).astype(np.uint8)
    assert (inflated(known, min(radii)) <= inflated(known, max(radii))).all()


@pytest.mark.slow
@SETTINGS
@given(costs=GRIDS, radius=st.floats(0.0, 2.0))
def test_inflation_is_symmetric(costs: np.ndarray, radius: float) -> None:
    plain = inflated(costs, radius)
    for turn in (lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: a.T):
        turned = inflated(np.ascontiguousarray(turn(costs)), radius)
        np.testing.assert_array_equal(turned, turn(plain))


@pytest.mark.slow
@SETTINGS
@given(costs=GRIDS, radius=st.floats(0.1, 1.0), data=st.data())
def test_inflation_stays_in_its_window(costs: np.ndarray, radius: float, data: st.DataObject) -> None:
    ny, nx = costs.shape
    x0, y0 = data.draw(st.integers(0, nx - 1)), data.draw(st.integers(0, ny - 1))
    window = Window(x0, y0, data.draw(st.integers(x0 + 1, nx)), data.draw(st.integers(y0 + 1, ny)))
    out = inflated(costs, radius, window=window)
    whole = inflated(costs, radius)
    inside = np.zeros(costs.shape, bool)
    inside[window.slices] = True
    np.testing.assert_array_equal(out[inside], whole[inside])
    np.testing.assert_array_equal(out[~inside], costs[~inside])


POINTS = st.lists(st.tuples(st.floats(-1.8, 1.8), st.floats(-1.8, 1.8)), min_size=1, max_size=20)


@pytest.mark.slow
@SETTINGS
@given(points=POINTS)
def test_marking_then_clearing_restores(points: list[tuple[float, float]]) -> None:
    """Beams through the marks of a scan clear them, and their inflation."""
    costmap = rolling(
        obstacle({"points": cloud_source(obstacle_range=9.0), "scan": scan_source(raytrace_range=9.0, marking=False)}),
        inflation(),
    )
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    before = costmap.master.data.copy()
    costmap.observe(cloud([(x, y, 0.2) for x, y in points]))
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    layer = costmap.layer("obstacle_layer")
    layer.buffers[0].observations.clear()  # type: ignore[attr-defined]
    costmap.observe(scan(np.full(4000, 4.0)))
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    np.testing.assert_array_equal(costmap.master.data, before)


@pytest.mark.slow
@SETTINGS
@given(points=POINTS, moves=st.lists(st.tuples(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7)), min_size=1, max_size=8))
def test_rolling_window_keeps_its_overlap(points: list[tuple[float, float]], moves: list[tuple[float, float]]) -> None:
    costmap = rolling(obstacle({"points": cloud_source(obstacle_range=9.0)}, footprint_clearing_enabled=False))
    costmap.observe(cloud([(x, y, 0.2) for x, y in points]))
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    layer = costmap.layer("obstacle_layer")
    layer.buffers[0].observations.clear()  # type: ignore[attr-defined]
    at = Pose2D(0.0, 0.0)
    for dx, dy in moves:
        before, geometry = costmap.master.data.copy(), costmap.master.geometry
        at = Pose2D(at.x + dx, at.y + dy)
        costmap.update_at(at, 0.0)
        now = costmap.master.geometry
        assert abs(math.remainder(now.origin_x - geometry.origin_x, 0.05)) < 1e-9
        for iy, ix in np.argwhere(before == 254):
            x, y = geometry.cell_to_world(int(ix), int(iy))
            left, right, bottom, top = now.extent
            if left < x < right and bottom < y < top:
                assert costmap.master.cost_at(x, y) == 254


BEAMS = st.one_of(
    st.lists(st.floats(width=32, allow_nan=True, allow_infinity=True), max_size=40),
    st.sampled_from([[], [1.0], [math.nan] * 7, [math.inf] * 7, [-math.inf], [-1.0, 0.0, -0.0], [1e-38, 3e38]]),
)
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


@SETTINGS
@given(
    ranges=BEAMS,
    angles=st.tuples(NUMBERS, NUMBERS),
    limits=st.tuples(NUMBERS, NUMBERS),
    height=NUMBERS,
    voxel=st.booleans(),
    valid=st.booleans(),
    pose=st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-10, 10)),
)
@example(
    ranges=[0.0], angles=(0.0, 0.0), limits=(0.0, -3.5e38), height=0.0, voxel=False, valid=True, pose=(0.0, 0.0, 0.0)
)
def test_any_scan_is_accepted_or_rejected(
    ranges: list[float],
    angles: tuple[float, float],
    limits: tuple[float, float],
    height: float,
    voxel: bool,
    valid: bool,
    pose: tuple[float, float, float],
) -> None:
    source = scan_source(inf_is_valid=valid, min_obstacle_height=-1e9, max_obstacle_height=1e9)
    frames = frames_at()
    frames.set_static("base_link", "laser", Transform2D(*pose))
    costmap = rolling(obstacle({"scan": source}, voxel=voxel), inflation(), frames=frames)
    before = Bounds(0.0, 0.0, 0.0, 0.0)
    try:
        costmap.observe(LaserScan(np.array(ranges, np.float32), *angles, *limits, 0.0, "laser", "scan", height))
    except InputError:
        return
    layer = costmap.layers[0]
    grown = layer.update_bounds(Pose2D(0.0, 0.0), 0.0, before)
    assert grown.union(before) == grown
    costmap.update(0.0)
    values = np.unique(costmap.layer("obstacle_layer").costs)  # type: ignore[attr-defined]
    assert set(values.tolist()) <= {0, 254, 255}


def test_a_hundred_thousand_beams() -> None:
    for voxel in (False, True):
        costmap = rolling(obstacle(voxel=voxel), inflation())
        costmap.observe(scan(np.random.default_rng(0).uniform(0.0, 12.0, 100_000)))
        costmap.update(0.0)
        assert (costmap.master.data == 254).sum() > 1000


@pytest.mark.slow
@SETTINGS
@given(steps=st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), min_size=1, max_size=6))
def test_window_updates_equal_full_updates(steps: list[tuple[float, float]]) -> None:
    """Updating the changed window gives the same costs as rewriting everything, while the window does not move.

    (When it rolls, the strip that comes in holds no inflation from marks beyond its old border until something near is
    observed again: so in C++, whose windows are held by the golden sequences.)
    """
    source = {"points": cloud_source(obstacle_range=9.0)}
    small, whole = rolling(obstacle(source), inflation()), rolling(obstacle(source), inflation())
    for x, y in steps:
        for costmap in (small, whole):
            costmap.observe(cloud([(x, y, 0.2)]))
            costmap.update_at(Pose2D(0.0, 0.0), 0.0)
        whole.layer("inflation_layer").reset()
        whole.update_at(Pose2D(0.0, 0.0), 0.0)
        np.testing.assert_array_equal(small.master.data, whole.master.data)
