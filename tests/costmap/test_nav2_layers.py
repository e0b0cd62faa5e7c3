"""Nav2's layers where they do what Nav2 should do: containers and footprints; and their rules in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import (
    Footprint,
    FrameTree,
    GridGeometry,
    InputError,
    OccupancyGrid,
    PointCloud,
    Pose2D,
    Transform2D,
    Window,
)
from navstack.costmap import (
    CostmapParams,
    LayeredCostmap,
    Nav2DenoiseLayer,
    Nav2InflationLayer,
    Nav2ObservationSourceParams,
    Nav2ObstacleLayer,
    Nav2StaticLayer,
    Nav2VoxelLayer,
    PluginContainerLayer,
)
from navstack.costmap.obstacle_layer import GRID, clear_rays, line_ends
from navstack.costmap.voxel_layer import VOXEL_GRID, clear_voxel_rays, ray_ends
from navstack.parameters import check_parameters, load_configuration
from navstack.plugins import Layer, Plugin

N, RESOLUTION = 40, 0.1
SQUARE = Footprint(np.array([[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]]))


def plugin(name: str, cls: type[Layer], **values: Any) -> Plugin[Layer]:
    return Plugin(name, cls, cls.Params(**values))


def sources(**changes: Any) -> dict[str, Any]:
    values = {"data_type": "PointCloud2", "clearing": True, "max_obstacle_height": 2.0, "sensor_frame": "base_link"}
    return {
        "observation_sources": "points",
        "sources": {"points": Nav2ObservationSourceParams(**{**values, **changes})},
    }


def costmap(*layers: Plugin[Layer], rolling: bool = False, track: bool = False, occupied: Any = None) -> LayeredCostmap:
    frames = FrameTree()
    static_map = None
    if occupied is not None:
        cells = np.zeros((N, N), np.int8)
        for ix, iy, value in occupied:
            cells[iy, ix] = value
        static_map = OccupancyGrid(cells, GridGeometry(N, N, RESOLUTION))
    params = CostmapParams(
        global_frame="map",
        width=N * RESOLUTION,
        height=N * RESOLUTION,
        resolution=RESOLUTION,
        rolling_window=rolling,
        track_unknown_space=track,
    )
    return LayeredCostmap("costmap", params, layers, footprint=SQUARE, frames=frames, static_map=static_map)


def see(grid: LayeredCostmap, *points: tuple[float, float], now: float, at: Pose2D) -> np.ndarray:
    cloud = np.array([(x, y, 0.3) for x, y in points], np.float32).reshape(-1, 3)
    grid.frames.set("map", "base_link", Transform2D(*at), now)
    grid.observe(PointCloud(cloud, now, "map", "points"))
    grid.update_at(at, now)
    return grid.master.data


def container(**values: Any) -> Plugin[Layer]:
    names = {"obstacles": "nav2_costmap_2d::ObstacleLayer", "inflated": "nav2_costmap_2d::InflationLayer"}
    models = PluginContainerLayer.Params.child_models(
        {"plugins": list(names), **{n: {"plugin": t} for n, t in names.items()}}
    )
    sections = {
        "obstacles": models["obstacles"].model_validate(sources()),
        "inflated": models["inflated"].model_validate({"inflation_radius": 0.5}),
    }
    return plugin("box", PluginContainerLayer, plugins=list(names), sections=sections, **values)


# --- containers -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("as_nav2", [False, True])
def test_an_obstacle_that_left_a_container_leaves_no_costs(as_nav2: bool) -> None:
    """In Nav2 they stay for ever."""
    grid = costmap(container(nav2_compatible=as_nav2))
    at = Pose2D(1.0, 2.0)
    seen = see(grid, (2.05, 2.05), now=1.0, at=at)
    assert seen[20, 20] == 254 and 0 < seen[20, 23] < 253
    gone = see(grid, (3.45, 2.05), now=2.0, at=at)
    assert gone[20, 34] == 254
    assert (gone[20, 20] == 254) == as_nav2 and (gone[20, 23] > 0) == as_nav2


@pytest.mark.parametrize("as_nav2", [False, True])
def test_the_costs_of_a_container_move_with_a_rolling_window(as_nav2: bool) -> None:
    grid = costmap(container(nav2_compatible=as_nav2), rolling=True)
    see(grid, (1.05, 0.05), now=1.0, at=Pose2D(0.0, 0.0))
    data = see(grid, (3.0, 3.0), now=2.0, at=Pose2D(0.5, 0.0))
    found = {
        (round(x, 2), round(y, 2))
        for iy, ix in np.argwhere(data == 254)
        for x, y in [grid.master.geometry.cell_to_world(ix, iy)]
    }
    assert (1.05, 0.05) in found
    assert (len(found) > 1) is as_nav2


def test_a_container_passes_everything_on() -> None:
    grid = costmap(container())
    layer = grid.layer("box")
    assert isinstance(layer, PluginContainerLayer) and layer.clearable and layer.inflation is not None
    assert layer.inflation.inflation_radius == 0.5
    see(grid, (2.05, 2.05), now=1.0, at=Pose2D(1.0, 2.0))
    told = grid.explain(20, 20)
    assert told.source == "points" and "points" in told.text
    traits = type(layer).traits(layer.params)
    assert traits.fed_by_sensors and traits.inflates and not traits.has_static_map and "points" in traits.sources
    assert layer.reset() == 1
    assert see(grid, now=2.0, at=Pose2D(1.0, 2.0))[20, 20] == 0


def test_a_static_layer_in_a_container_sizes_the_costmap() -> None:
    models = PluginContainerLayer.Params.child_models(
        {"plugins": ["m"], "m": {"plugin": "nav2_costmap_2d/StaticLayer"}}
    )
    box = plugin("box", PluginContainerLayer, plugins=["m"], sections={"m": models["m"]()})
    grid = costmap(box, occupied=[(7, 9, 100)])
    grid.update_at(Pose2D(1.0, 1.0), 0.0)
    assert grid.master.data[9, 7] == 254 and grid.master.data.sum() == 254
    with pytest.raises(InputError, match="no section"):
        costmap(plugin("box", PluginContainerLayer, plugins=["m"]))


YAML = {
    "global_costmap": {
        "plugins": [
            {"name": "static_layer", "type": "nav2_costmap_2d::StaticLayer"},
            {"name": "box", "type": "nav2_costmap_2d::PluginContainerLayer"},
        ],
        "static_layer": {"footprint_clearing_enabled": True},
        "box": {
            "plugins": ["scans", "inflated"],
            "scans": {
                "plugin": "nav2_costmap_2d::VoxelLayer",
                "observation_sources": "front",
                "front": {
                    "topic": "scan",
                    "max_obstacle_height": 2.0,
                    "obstacle_max_range": 4.0,
                    "raytrace_max_range": 5.0,
                },
            },
            "inflated": {"plugin": "nav2_costmap_2d::InflationLayer", "inflation_radius": 0.7},
        },
    },
}


@pytest.mark.slow
def test_a_container_from_a_file() -> None:
    made = load_configuration(["turtlebot", YAML]).global_costmap
    box = made.layers[1].params
    assert box.sections["scans"].sources["front"].obstacle_max_range == 4.0
    assert box.sections["inflated"].inflation_radius == 0.7
    wrong = {
        "global_costmap": {
            **YAML["global_costmap"],
            "box": {"plugins": ["a"], "a": {"plugin": "nav2_costmap_2d::InflatonLayer"}},
        }
    }
    errors = [f for f in check_parameters(["turtlebot", wrong]) if f.severity == "error"]
    assert [f.key for f in errors] == ["global_costmap/box/a/plugin"]


# --- the footprint in the static map ----------------------------------------------------------------------------------


@pytest.mark.parametrize("restore", [True, False])
@pytest.mark.parametrize("as_nav2", [True, False])
def test_the_static_map_is_cleared_under_the_robot(as_nav2: bool, restore: bool) -> None:
    values = {"footprint_clearing_enabled": True, "restore_cleared_footprint": restore, "nav2_compatible": as_nav2}
    grid = costmap(plugin("m", Nav2StaticLayer, **values), occupied=[(10, 10, 100), (20, 10, 100)])
    first, second = Pose2D(1.05, 1.05), Pose2D(2.05, 1.05)
    grid.update_at(first, 0.0)
    assert grid.master.data[10, 10] == 0 and grid.master.data[10, 20] == 254
    grid.update_at(second, 1.0)
    expected = (0, 254) if as_nav2 else (254 if restore else 0, 0)
    assert (grid.master.data[10, 10], grid.master.data[10, 20]) == expected


def test_map_values_of_the_static_layer() -> None:
    cells = [(1, 1, 98), (2, 1, 99), (3, 1, 100), (4, 1, -1), (5, 1, 50)]
    for trinary, expected in ((True, [0, 253, 254, 255, 0]), (False, [248, 253, 254, 255, 127])):
        layer = plugin("m", Nav2StaticLayer, trinary_costmap=trinary, track_unknown_space=True)
        grid = costmap(layer, occupied=cells)
        grid.update_at(Pose2D(1.0, 1.0), 0.0)
        assert grid.master.data[1, 1:6].tolist() == expected


# --- ranges and combination -------------------------------------------------------------------------------------------


def test_ranges_are_those_of_the_plane() -> None:
    """At exactly the farthest distance a point is marked, and its height does not count."""
    layer = plugin("o", Nav2ObstacleLayer, **sources(obstacle_max_range=1.0, obstacle_min_range=0.5))
    for distance, marked in ((0.4, False), (0.5, True), (0.75, True), (1.0, True), (1.03125, False)):
        grid = costmap(layer)
        data = see(grid, (1.0 + distance, 2.0), now=1.0, at=Pose2D(1.0, 2.0))
        assert (data == 254).any() == marked, distance


def test_low_points_are_dropped_by_the_layer() -> None:
    for cls in (Nav2ObstacleLayer, Nav2VoxelLayer):
        grid = costmap(plugin("o", cls, min_obstacle_height=0.4, **sources()))
        assert not (see(grid, (2.0, 2.0), now=1.0, at=Pose2D(1.0, 2.0)) == 254).any()


@pytest.mark.parametrize(
    ("method", "expected"), [(0, (0, 254, 255)), (1, (254, 254, 254)), (2, (254, 254, 255)), (7, (254, 254, 254))]
)
def test_combination_methods(method: int, expected: tuple[int, int, int]) -> None:
    """A lethal, a free and an unknown cell of the map; the second and the third are marked, the first is cleared."""
    static = plugin("m", Nav2StaticLayer, track_unknown_space=True)
    marks = plugin("o", Nav2ObstacleLayer, combination_method=method, footprint_clearing_enabled=False, **sources())
    grid = costmap(static, marks, track=True, occupied=[(15, 20, 100), (20, 24, -1)])
    data = see(grid, (2.05, 2.05), (2.05, 2.45), now=1.0, at=Pose2D(1.05, 2.05))
    third = 254 if method == 0 else expected[2]
    assert (data[20, 15], data[20, 20], data[24, 20]) == (expected[0], 254, third)


def line(start: tuple[int, ...], end: tuple[int, ...], share: float) -> list[tuple[int, ...]]:
    """The cells of a line in any number of dimensions, up to a share of its length (bresenham in costmap_2d and voxel_grid.h)."""
    spans = [abs(b - a) for a, b in zip(start, end, strict=True)]
    longest, at, cells = max(spans), list(start), []
    errors = [longest // 2] * len(spans)
    for _ in range(int(share * longest) + 1):
        cells.append(tuple(at))
        for axis, span in enumerate(spans):
            errors[axis] += span
            if errors[axis] >= longest:
                errors[axis] -= longest
                at[axis] += 1 if end[axis] > start[axis] else -1
    return cells


def span_of(box: np.ndarray, ends: np.ndarray, sensor: tuple[float, float], nearest: float) -> np.ndarray:
    """The bounds, grown by the ends (2, n) that are not nearer than `nearest`."""
    far = ends[:, np.hypot(ends[0] - sensor[0], ends[1] - sensor[1]) >= nearest]
    reached = np.column_stack((box[:2], box[2:], far))
    return np.concatenate((reached.min(axis=1), reached.max(axis=1)))


@pytest.mark.slow
@pytest.mark.parametrize("with_minimum", [False, True])
@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_rays_clear_the_cells_of_their_lines(with_minimum: bool, seed: int) -> None:
    """From the cell `nearest` along the ray to `reach`, cell by cell."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 5.0, (12, 3)).astype(np.float32)
    points[6] = points[5]
    sx, sy = rng.uniform(0.5, 3.5, 2).tolist()
    grid = np.array([(0.0, 0.0, RESOLUTION, 2.0, -math.inf, 0)], GRID)
    reach, nearest = float(rng.uniform(0.5, 4.0)), float(rng.uniform(0.1, 1.0)) if with_minimum else 0.0
    farthest, first = math.ceil(reach / RESOLUTION), math.ceil(nearest / RESOLUTION)
    costs, box = np.full((N, N), 254, np.uint8), np.array([sx, sy, sx, sy])
    assert clear_rays(costs, points, len(points), grid, sx, sy, nearest, reach, box)

    ends, cells = np.empty((2, 12)), np.empty((3, 12), np.int32)
    line_ends(points, grid, (sx, sy), reach, (float(N), float(N)), ends, cells)
    expected, at = np.full((N, N), 254, np.uint8), (int(sx / RESOLUTION), int(sy / RESOLUTION))
    for x, y in cells[:2, cells[2] == 1].T.tolist():
        length = math.hypot(x - at[0], y - at[1])
        if length < first:
            continue
        begin = at
        if first:
            begin = (int(at[0] + (x - at[0]) / length * first), int(at[1] + (y - at[1]) / length * first))
        for ix, iy in line(begin, (x, y), min(1.0, farthest / length) if length else 1.0):
            expected[iy, ix] = 0
    np.testing.assert_array_equal(costs, expected)
    np.testing.assert_allclose(box, span_of(np.array([sx, sy, sx, sy]), ends[:, cells[2] == 1], (sx, sy), nearest))


@pytest.mark.slow
@pytest.mark.parametrize("with_minimum", [False, True])
@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_voxel_rays_clear_the_voxels_of_their_lines(with_minimum: bool, seed: int) -> None:
    """As above; a column is free if it has few marks and few unknown voxels."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 5.0, (12, 3)).astype(np.float32)
    points[:, 2] = rng.uniform(-0.5, 2.5, 12)
    sx, sy, sz = sensor = (*rng.uniform(0.5, 3.5, 2).tolist(), 0.5)
    points[:4, 2] = sz  # rays of one level
    levels, threshold = int(rng.integers(3, 17)), int(rng.integers(0, 3))
    unknown = int(rng.choice([0, levels // 2, 16]))
    settings_of = (0.0, 0.0, 0.0, RESOLUTION, 0.2, 2.0, 0.0, levels * 0.2, 0.0, 1e-5, levels, threshold, unknown)
    grid = np.array([settings_of], VOXEL_GRID)
    before = rng.integers(0, 1 << 2 * levels, (N, N)).astype(np.uint64)
    reach, nearest = float(rng.uniform(0.5, 4.0)), float(rng.uniform(0.1, 1.0)) if with_minimum else 0.0
    farthest, first = math.ceil(reach / RESOLUTION), math.ceil(nearest / RESOLUTION)
    costs, columns = np.full((N, N), 254, np.uint8), before.copy()
    start = np.array([sx, sy, sx, sy])
    box = start.copy()
    assert clear_voxel_rays(costs, columns, points, len(points), grid, *sensor, nearest, reach, box)

    ends, cells = np.empty((6, 12)), np.empty((4, 12), np.int32)
    ray_ends(points, grid, sensor, reach, (float(N), float(N)), ends, cells)
    expected, words, mask = np.full((N, N), 254, np.uint8), before.copy(), (1 << levels) - 1
    origin = np.array([sx / RESOLUTION, sy / RESOLUTION, sz / 0.2])
    for i in np.flatnonzero(cells[3]):
        length = float(ends[2, i])
        if int(length) < first:
            continue
        begin = origin + (ends[3:, i] - origin) / length * first if first else origin
        places = line(
            tuple(int(v) for v in begin), tuple(cells[:3, i].tolist()), min(1.0, farthest / max(length, 1e-9))
        )
        for ix, iy, iz in places:
            word = (int(words[iy, ix]) | 1 << iz) & ~(1 << iz + levels)
            words[iy, ix] = word
            if (word >> levels).bit_count() <= threshold:
                few = (mask & ~(word | word >> levels)).bit_count() <= unknown
                expected[iy, ix] = 0 if few else 255
    np.testing.assert_array_equal(columns, words)
    np.testing.assert_array_equal(costs, expected)
    np.testing.assert_allclose(box, span_of(start, ends[:2, cells[3] == 1], (sx, sy), nearest))


# --- inflation and noise ----------------------------------------------------------------------------------------------


def test_inflation_around_unknown_cells() -> None:
    static = plugin("m", Nav2StaticLayer, track_unknown_space=True)
    for around in (False, True):
        grid = costmap(
            static, plugin("i", Nav2InflationLayer, inflate_around_unknown=around), track=True, occupied=[(20, 20, -1)]
        )
        grid.update_at(Pose2D(1.0, 1.0), 0.0)
        assert (grid.master.data[20, 21] == 253) == around
        assert grid.master.data[20, 20] == (254 if around else 255)


def test_a_custom_inscribed_radius() -> None:
    grid = costmap(
        plugin("m", Nav2StaticLayer),
        plugin("i", Nav2InflationLayer, custom_inscribed_radius=0.35),
        occupied=[(20, 20, 100)],
    )
    grid.update_at(Pose2D(1.0, 1.0), 0.0)
    assert grid.master.data[20, 23] == 253 and grid.master.data[20, 24] < 253
    assert grid.layer("i").inflation.inscribed_radius == 0.35  # type: ignore[union-attr]


@pytest.mark.parametrize(("cells", "inflated"), [(6, True), (7, False), (8, True), (14, False), (16, True)])
def test_cells_at_exactly_the_radius(cells: int, inflated: bool) -> None:
    """Where Nav2's square root rounds the radius up, they are left out."""
    layer = plugin("i", Nav2InflationLayer, inflation_radius=cells * RESOLUTION - 1e-6, cost_scaling_factor=1.0)
    grid = costmap(plugin("m", Nav2StaticLayer), layer, occupied=[(20, 20, 100)])
    grid.update_at(Pose2D(1.0, 1.0), 0.0)
    assert (grid.master.data[20, 20 + cells] > 0) == inflated and grid.master.data[20, 19 + cells] > 0


def test_noise_at_the_edge_of_the_window() -> None:
    """A group of two cells of which the window contains one is removed there; `denoise` knows better."""
    layer = plugin("d", Nav2DenoiseLayer)
    grid = costmap(layer)
    grid.master.data[5, 5:7] = 254
    grid.layers[0].update_costs(grid.master, Window(0, 0, 6, 10))
    assert grid.master.data[5, 5] == 0 and grid.master.data[5, 6] == 254
