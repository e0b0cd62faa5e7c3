"""The layered costmap: size, rolling window, bounds, errors, explanations."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameError,
    FrameTree,
    GridGeometry,
    InputError,
    InternalError,
    Pose2D,
    Transform2D,
    Window,
)
from navstack.costmap import (
    CostmapParams,
    InflationLayer,
    KeepoutMaskLayer,
    LayeredCostmap,
    MaskLayerParams,
    inflation_cost,
)
from navstack.plugins import LAYERS, Layer, ParamModel, Plugin
from tests.costmap.build import cloud, cloud_source, frames_at, grid_of, inflation, obstacle, rolling, scan, static

ROOM = """
    #####
    #...#
    #.?.#
    #...#
    #####
"""


def on_map(
    *layers: Plugin, text: str = ROOM, frame: str = "map", frames: FrameTree | None = None, **map_changes: Any
) -> LayeredCostmap:
    return LayeredCostmap(
        "global_costmap",
        CostmapParams(global_frame=frame, robot_base_frame="base_link"),
        layers,
        footprint=Footprint.from_radius(0.4),
        frames=frames or FrameTree(),
        static_map=grid_of(text, **map_changes),
    )


def test_size_of_the_static_map() -> None:
    costmap = on_map(static())
    assert costmap.master.geometry == GridGeometry(5, 5, 1.0)
    assert costmap.update_at(Pose2D(2.0, 2.0), 0.0) == Window(0, 0, 5, 5)
    assert costmap.master.cost_at(0.5, 0.5) == 254
    assert costmap.master.cost_at(2.5, 2.5) == 255
    # no change, no update
    assert costmap.update_at(Pose2D(2.0, 2.0), 1.0).is_empty
    assert costmap.bounds.is_empty


def test_size_of_the_parameters_without_a_map() -> None:
    params = CostmapParams(width=3.0, height=1.0, resolution=0.1, origin_x=-1.0, origin_y=2.0)
    costmap = LayeredCostmap("c", params, [], footprint=Footprint.from_radius(0.2), frames=FrameTree())
    assert costmap.master.geometry == GridGeometry(30, 10, 0.1, -1.0, 2.0)


@pytest.mark.parametrize("changes", [{"width": 0.0}, {"resolution": 20.0}, {"width": 1e6, "height": 1e6}])
def test_invalid_sizes_are_rejected(changes: dict[str, float]) -> None:
    with pytest.raises(InputError, match="choose between 1 and"):
        LayeredCostmap("c", CostmapParams(**changes), [], footprint=Footprint.from_radius(0.2), frames=FrameTree())


def test_static_layer_requires_a_map() -> None:
    with pytest.raises(InputError, match="requires a map"):
        rolling(static())


def test_a_new_map_resizes() -> None:
    costmap = on_map(static(), inflation())
    master = costmap.master
    costmap.update_at(Pose2D(2.0, 2.0), 0.0)
    assert costmap.set_static_map(grid_of("..#\n..."))
    assert costmap.master is master
    assert master.data.shape == (2, 3)
    costmap.update_at(Pose2D(1.0, 1.0), 1.0)
    assert master.cost_at(2.5, 1.5) == 254
    once = on_map(static(first_map_only=True))
    assert not once.set_static_map(grid_of("..#"))
    assert once.master.data.shape == (5, 5)


def test_static_layer_in_a_rolling_window() -> None:
    frames = frames_at()
    frames.set("map", "odom", Transform2D(10.0, 0.0, math.pi / 2), 0.0)
    costmap = LayeredCostmap(
        "local",
        CostmapParams(global_frame="odom", rolling_window=True, width=4.0, height=4.0, resolution=0.5),
        [static()],
        footprint=Footprint.from_radius(0.2),
        frames=frames,
        static_map=grid_of("#" + "." * 19, resolution=1.0),
    )
    costmap.update(0.0)
    # odom x is map y: the map's only row, y in [0, 1), is a strip x in [0, 1); its obstacle is at odom y = 9.5
    assert not (costmap.master.data == 254).any()
    frames.set("odom", "base_link", Transform2D(0.5, 9.0, 0.0), 1.0)
    frames.set("map", "odom", Transform2D(10.0, 0.0, math.pi / 2), 1.0)
    costmap.update(1.0)
    ys, xs = np.nonzero(costmap.master.data == 254)
    seen = {costmap.master.geometry.cell_to_world(int(x), int(y)) for x, y in zip(xs, ys, strict=True)}
    assert len(seen) == 4
    assert all(0.0 <= x < 1.0 and 9.0 <= y < 10.0 for x, y in seen)


def test_rotated_map_is_looked_up() -> None:
    costmap = on_map(static(), text="#..\n...", origin_yaw=math.pi / 2)
    # three columns to the right become three rows upward; the upper row is to the left
    assert costmap.master.geometry.shape == (3, 2)
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    assert (costmap.master.data == 254).sum() == 1
    assert costmap.master.cost_at(-1.5, 0.5) == 254


@pytest.mark.parametrize("kind", ["map with a yaw", "rolling window in a rotated frame", "rotated mask"])
@pytest.mark.parametrize("seed", range(8))
def test_a_cell_is_lethal_if_and_only_if_it_overlaps_an_obstacle(kind: str, seed: int) -> None:
    """No obstacle is lost at any yaw, and free space loses only the cells that an obstacle reaches into: one at its border."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((10, 12)) < 0.15
    text = "\n".join("".join(".#"[int(cell)] for cell in row) for row in occupied[::-1])
    yaw = float(rng.uniform(-math.pi, math.pi))
    if kind == "map with a yaw":
        costmap = on_map(static(), text=text, origin_yaw=yaw)
    else:
        frames = frames_at()
        frames.set("map", "odom", Transform2D(6.0, 5.0, -yaw), 0.0)
        layer = static() if kind.startswith("rolling") else Plugin("keepout", KeepoutMaskLayer, MaskLayerParams())
        params = CostmapParams(global_frame="odom", rolling_window=True, width=20.0, height=20.0, resolution=0.7)
        footprint = Footprint.from_radius(0.2)
        costmap = LayeredCostmap("c", params, [layer], footprint=footprint, frames=frames, static_map=grid_of(text))
        if kind == "rotated mask":
            costmap.layer("keepout").set_mask(grid_of(text))  # type: ignore[attr-defined]
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    # the occupied cells in the costmap's frame
    at = Transform2D(0.0, 0.0, yaw) if kind == "map with a yaw" else Transform2D(6.0, 5.0, -yaw).inverse()
    corners = [(ix + dx, iy + dy) for iy, ix in np.argwhere(occupied) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))]
    obstacles = shapely.union_all(shapely.polygons(at.apply_points(np.array(corners, float)).reshape(-1, 4, 2)))
    g = costmap.master.geometry
    iy, ix = np.indices(g.shape)
    left, low = g.origin_x + ix * g.resolution, g.origin_y + iy * g.resolution
    shared = shapely.area(
        shapely.intersection(shapely.box(left, low, left + g.resolution, low + g.resolution), obstacles)
    )
    lethal = costmap.master.data == 254
    assert lethal[shared > 1e-9].all() and (shared > 1e-9).any()
    assert not lethal[shared == 0.0].any()


def test_use_maximum_keeps_the_larger_cost() -> None:
    costmap = on_map(static(), replace(static(use_maximum=True), name="again"))
    costmap.update_at(Pose2D(1.0, 1.0), 0.0)
    assert costmap.master.cost_at(0.5, 0.5) == 254
    assert costmap.master.cost_at(2.5, 2.5) == 255


def test_invalid_robot_poses_are_rejected() -> None:
    costmap = rolling(obstacle(), frames=frames_at(1.0, 2.0, 0.5, stamp=5.0))
    assert costmap.robot_pose() == Pose2D(1.0, 2.0, 0.5)
    assert costmap.robot_pose(5.2) == Pose2D(1.0, 2.0, 0.5)
    with pytest.raises(FrameError):
        costmap.update(6.0)
    for pose in (Pose2D(math.nan, 0.0), Pose2D(0.0, math.inf), Pose2D(1e300, 0.0), Pose2D(0.0, 0.0, math.nan)):
        with pytest.raises(InputError, match="cannot be updated at the invalid robot pose"):
            costmap.update_at(pose, 5.0)


def test_large_jump_clears_the_window() -> None:
    costmap = rolling(obstacle({"points": cloud_source()}))
    costmap.observe(cloud([(1.0, 0.0, 0.2)]))
    costmap.update(0.0)
    assert (costmap.master.data == 254).any()
    costmap.update_at(Pose2D(1e6, -1e6), 0.1)
    assert not costmap.master.data.any()
    geometry = costmap.master.geometry
    assert geometry.origin_x == pytest.approx(1e6 - 2.0, abs=0.1)


class _NoParams(ParamModel):
    pass


class _Shrinks(Layer):
    Params = _NoParams

    def match_size(self, geometry: GridGeometry) -> None: ...

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        return Bounds(0.0, 0.0, 0.1, 0.1)

    def update_costs(self, master: Costmap, window: Window) -> None: ...


def test_bounds_may_only_grow() -> None:
    costmap = on_map(static(), Plugin("greedy", _Shrinks, _NoParams()))
    with pytest.raises(InternalError, match='"greedy" of global_costmap shrank the bounds'):
        costmap.update_at(Pose2D(0.0, 0.0), 0.0)


def test_footprint_changes_reinflate() -> None:
    costmap = rolling(obstacle({"points": cloud_source()}), inflation())
    costmap.observe(cloud([(1.0, 0.0, 0.2)]))
    costmap.update(0.0)
    before = costmap.master.cost_at(1.3, 0.0)
    costmap.set_footprint(Footprint.from_radius(0.4))
    assert costmap.update_at(Pose2D(0.0, 0.0), 0.1) == costmap.master.geometry.window
    assert before is not None
    assert before < 253
    assert costmap.master.cost_at(1.3, 0.0) == 253


def test_reset_clears_and_the_map_is_written_again() -> None:
    costmap = on_map(static(), obstacle({"points": cloud_source()}), inflation(inflation_radius=1.0))
    costmap.update_at(Pose2D(2.5, 2.5), 0.0)
    before = costmap.master.data.copy()
    assert costmap.reset() == 0
    assert not costmap.master.data.any()
    costmap.update_at(Pose2D(2.5, 2.5), 1.0)
    np.testing.assert_array_equal(costmap.master.data, before)


def test_inflation_radius_larger_than_a_byte() -> None:
    """400 cells exceed the kernel's limit of one byte."""
    costmap = rolling(
        obstacle({"points": cloud_source()}),
        inflation(inflation_radius=4.0, cost_scaling_factor=1.0),
        size=6.0,
        resolution=0.01,
    )
    costmap.observe(cloud([(-2.4, 0.0, 0.2)]))
    costmap.update(0.0)
    layer = costmap.layer("inflation_layer")
    assert isinstance(layer, InflationLayer)
    assert layer.radius_cells == 400
    geometry = costmap.master.geometry
    cell = geometry.world_to_cell(-2.4, 0.0)
    assert cell is not None
    for ix in (cell[0] + 399, cell[0] + 300, cell[0] + 1):
        d = (ix - cell[0]) * 0.01
        expected = int(inflation_cost(d, layer.inscribed_radius, 1.0))
        assert costmap.master.data[cell[1], ix] == expected > 0
    assert costmap.master.data[cell[1], cell[0] + 401] == 0


def test_ros_names_of_layers() -> None:
    for name, alias in (
        ("static", "StaticLayer"),
        ("obstacle", "ObstacleLayer"),
        ("voxel", "VoxelLayer"),
        ("inflation", "InflationLayer"),
    ):
        assert LAYERS.get(f"costmap_2d::{alias}") is LAYERS.get(name)
        assert LAYERS.get(f"costmap_2d/{alias}").cls.Params.__name__ == f"{alias}Params"


# --- provenance -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("voxel", [False, True])
def test_explain_which_layer_set_a_cell(voxel: bool) -> None:
    frames = FrameTree()
    frames.set_static("base_link", "laser", Transform2D())
    changes: dict[str, Any] = {"z_voxels": 4} if voxel else {}
    costmap = LayeredCostmap(
        "global_costmap",
        CostmapParams(robot_base_frame="base_link"),
        [static(), obstacle(voxel=voxel, **changes), inflation()],
        footprint=Footprint.from_radius(0.1),
        frames=frames,
        static_map=grid_of("." * 40 + "\n" + "." * 39 + "#", resolution=0.1),
    )
    frames.set("map", "base_link", Transform2D(0.55, 0.05, 0.0), 3.0)
    costmap.observe(scan([1.0], stamp=3.0))
    costmap.update(3.0)
    frames.set("map", "base_link", Transform2D(0.55, 0.05, 0.0), 4.0)
    costmap.observe(scan([math.nan], stamp=4.0))
    costmap.update(4.0)

    marked = costmap.explain_cell(1.55, 0.05)
    assert (marked.cost, marked.set_by, marked.source, marked.stamp) == (254, "obstacle_layer", "scan", 3.0)
    assert marked.updated_at == 4.0
    assert [s.after for s in marked.layers] == [0, 254, 254]
    assert marked.layers[0].explanation is not None
    assert marked.layers[0].explanation.data["map_value"] == 0
    near = costmap.explain_cell(1.35, 0.05)
    assert (near.set_by, near.source, near.stamp) == ("inflation_layer", "scan", 3.0)
    assert near.obstacle is not None
    assert (near.obstacle.ix, near.obstacle.iy) == (15, 0)
    assert 0 < near.cost < 253
    wall = costmap.explain_cell(3.95, 0.05)
    assert (wall.set_by, wall.source) == ("static_layer", "map")
    free = costmap.explain_cell(3.0, 0.15)
    assert (free.cost, free.set_by) == (0, None)
    assert 'marked by "scan" at 3.000 s' in marked.text
    assert near.as_dict()["obstacle"]["set_by"] == "obstacle_layer"
    with pytest.raises(InputError, match="is outside global_costmap, which covers"):
        costmap.explain_cell(10.0, 0.0)


def test_explaining_changes_nothing() -> None:
    costmap = rolling(obstacle(), inflation())
    costmap.observe(scan([1.0, 0.7, 1.3]))
    costmap.update(0.0)
    layer = costmap.layer("obstacle_layer")
    before = (costmap.master.data.copy(), layer.costs.copy(), costmap.window)  # type: ignore[attr-defined]
    explained = [costmap.explain_cell(x, y).text for x in np.arange(-1.5, 1.6, 0.5) for y in np.arange(-1.5, 1.6, 0.5)]
    assert len(explained) == 49
    np.testing.assert_array_equal(costmap.master.data, before[0])
    np.testing.assert_array_equal(layer.costs, before[1])  # type: ignore[attr-defined]
    assert costmap.window == before[2]
    freed = costmap.explain_cell(0.5, 0.0)
    assert freed.layers[0].explanation is not None
    assert freed.layers[0].explanation.text == 'cleared by "scan" at 0.000 s'


def test_old_marks_never_show_a_new_time() -> None:
    """With more observations than serial numbers, the time of an old mark becomes unknown."""
    costmap = rolling(obstacle({"points": cloud_source()}, footprint_clearing_enabled=False))
    costmap.observe(cloud([(1.0, 0.0, 0.2)], stamp=0.0))
    costmap.update(0.0)
    layer: Any = costmap.layer("obstacle_layer")
    assert costmap.explain_cell(1.0, 0.0).stamp == 0.0
    nothing = cloud([], stamp=0.0)
    for _ in range(9000):
        layer.buffers[0].receive(nothing)
        layer._assign_serials(layer.buffers[0])
    explained = costmap.explain_cell(1.0, 0.0)
    assert (explained.cost, explained.source, explained.stamp) == (254, None, None)
    assert explained.layers[0].explanation is not None
    assert "no longer stored" in explained.layers[0].explanation.text
