"""Observation sources, the obstacle layer and the voxel layer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Bounds, Footprint, FrameTree, InputError, Pose2D, Transform2D
from navstack.costmap import LayeredCostmap, ObstacleLayer, VoxelLayer
from tests.costmap.build import cloud, cloud_source, frames_at, inflation, obstacle, rolling, scan, scan_source

HERE = Pose2D(0.0, 0.0)


def layer_of(costmap: LayeredCostmap) -> ObstacleLayer:
    layer = costmap.layer("obstacle_layer")
    assert isinstance(layer, ObstacleLayer)
    return layer


@pytest.mark.parametrize("voxel", [False, True])
def test_beam_marks_its_end_and_clears_its_ray(voxel: bool) -> None:
    costmap = rolling(obstacle(voxel=voxel), track_unknown_space=True)
    costmap.observe(scan([1.0]))
    costmap.update(0.0)
    assert costmap.master.cost_at(1.0, 0.0) == 254
    assert costmap.master.cost_at(0.5, 0.0) == 0
    assert costmap.master.cost_at(1.5, 0.0) == 255
    assert costmap.master.cost_at(-1.0, 0.0) == 255


def test_removed_obstacle_is_cleared() -> None:
    costmap = rolling(obstacle())
    costmap.observe(scan([1.0], 0.0))
    costmap.update(0.0)
    costmap.observe(scan([2.0], 0.1))
    costmap.update_at(HERE, 0.1)
    assert costmap.master.cost_at(1.0, 0.0) == 0
    # beyond obstacle_range (2.5) nothing is marked, beyond raytrace_range (3.0) nothing is cleared
    far = rolling(obstacle(), size=10.0, track_unknown_space=True)
    far.observe(scan([2.83]))
    far.update(0.0)
    assert far.master.cost_at(2.83, 0.0) == 0
    assert not (far.master.data == 254).any()
    far.observe(scan([4.5]))
    far.update(0.0)
    assert [far.master.cost_at(x, 0.0) for x in (2.93, 3.23)] == [0, 255]


def test_marking_and_clearing_flags() -> None:
    blind = rolling(obstacle({"scan": scan_source(marking=False, clearing=False)}), track_unknown_space=True)
    blind.observe(scan([1.0]))
    blind.update(0.0)
    assert blind.master.cost_at(1.0, 0.0) == 255
    only_marks = rolling(obstacle({"scan": scan_source(clearing=False)}), track_unknown_space=True)
    only_marks.observe(scan([1.0]))
    only_marks.update(0.0)
    assert [only_marks.master.cost_at(x, 0.0) for x in (0.5, 1.0)] == [255, 254]


def test_all_sources_clear_before_any_marks() -> None:
    sources = {"bump": cloud_source(topic="points"), "scan": scan_source()}
    costmap = rolling(obstacle(sources))
    costmap.observe(cloud([(0.5, 0.0, 0.1)]))
    costmap.observe(scan([1.0]))
    costmap.update(0.0)
    assert costmap.master.cost_at(0.5, 0.0) == 254
    assert costmap.master.cost_at(1.0, 0.0) == 254


def test_heights_of_source_and_layer() -> None:
    costmap = rolling(
        obstacle({"points": cloud_source(min_obstacle_height=0.1, max_obstacle_height=1.0)}, max_obstacle_height=0.8)
    )
    costmap.observe(cloud([(1.0, 0.0, 0.05), (0.0, 1.0, 0.5), (-1.0, 0.0, 0.9), (0.0, -1.0, 1.5)]))
    costmap.update(0.0)
    assert [costmap.master.cost_at(x, y) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))] == [0, 254, 0, 0]
    high = rolling(obstacle({"scan": scan_source(max_obstacle_height=0.25)}))
    high.observe(scan([1.0], height=0.3))
    high.update(0.0)
    assert not high.master.data.any()


def test_invalid_ranges_are_ignored() -> None:
    nothing = [math.nan, math.inf, -math.inf, -1.0, 0.01, 10.0, 11.0]
    costmap = rolling(obstacle(), size=30.0, track_unknown_space=True)
    costmap.observe(scan(nothing))
    costmap.update_at(HERE, 0.0)
    assert not (costmap.master.data == 254).any()
    layer = layer_of(costmap)
    assert layer.buffers[0].observations[0].count == 0


def test_inf_is_valid_clears() -> None:
    costmap = rolling(obstacle({"scan": scan_source(inf_is_valid=True)}), track_unknown_space=True)
    costmap.observe(scan([math.inf], range_max=1.0))
    costmap.update(0.0)
    # C++ marks the replaced distance, slightly below range_max, as an obstacle too
    assert [costmap.master.cost_at(x, 0.0) for x in (0.5, 0.94, 0.99)] == [0, 0, 254]


def test_persistence_keeps_observations_by_age() -> None:
    costmap = rolling(obstacle({"points": cloud_source(observation_persistence=1.0)}))
    for k in range(4):
        costmap.observe(cloud([(1.0, 0.1 * k, 0.2)], stamp=0.5 * k))
    costmap.update_at(HERE, 2.0)
    assert [o.stamp for o in layer_of(costmap).buffers[0].observations] == []


def test_persistence_with_moving_frames() -> None:
    frames = FrameTree()
    frames.set_static("base_link", "laser", Transform2D())
    costmap = rolling(obstacle({"points": cloud_source(observation_persistence=1.0)}), frames=frames)
    for k in range(4):
        frames.set("odom", "base_link", Transform2D(), 0.5 * k)
        costmap.observe(cloud([(1.0, 0.2 * k, 0.2)], stamp=0.5 * k))
    costmap.update(1.5)
    assert [o.stamp for o in layer_of(costmap).buffers[0].observations] == [1.5, 1.0, 0.5]
    # the oldest was dropped before it could mark
    assert [costmap.master.cost_at(1.0, 0.2 * k) for k in range(4)] == [0, 254, 254, 254]


def test_messages_wait_for_their_transforms() -> None:
    frames = frames_at(stamp=0.0)
    costmap = rolling(obstacle(), frames=frames)
    costmap.observe(scan([1.0], stamp=1.0))
    costmap.update_at(HERE, 1.0)
    assert not costmap.master.data.any()
    frames.set("odom", "base_link", Transform2D(0.0, 0.5, 0.0), 1.0)
    costmap.update_at(HERE, 1.2)
    assert costmap.master.cost_at(1.0, 0.5) == 254
    for k in range(60):
        costmap.observe(scan([1.0], stamp=100.0 + k))
    assert layer_of(costmap).buffers[0].dropped == 10


def test_sensor_frame_and_topic_names() -> None:
    frames = frames_at()
    frames.set_static("base_link", "mast", Transform2D(0.025, 1.025, 0.0))
    costmap = rolling(
        obstacle({"front": scan_source(topic="/front/scan", sensor_frame="mast")}),
        frames=frames,
        track_unknown_space=True,
    )
    costmap.observe(scan([1.0]))
    costmap.observe(scan([1.0], topic="front/scan"))
    costmap.update(0.0)
    assert costmap.master.cost_at(1.0, 0.0) == 254
    # the ray starts at the mast
    assert [costmap.master.cost_at(*p) for p in ((0.025, 1.025), (0.525, 0.525), (0.525, 0.0))] == [0, 0, 255]


def test_rotated_robot() -> None:
    costmap = rolling(obstacle(), frames=frames_at(0.525, 0.025, math.pi / 2))
    costmap.observe(scan([1.0, 0.5, math.nan, math.nan]))
    costmap.update(0.0)
    assert costmap.master.cost_at(0.525, 1.025) == 254
    assert costmap.master.cost_at(0.025, 0.025) == 254


def test_stale_source() -> None:
    sources = {"scan": scan_source(expected_update_rate=0.5), "bump": cloud_source(topic="bumper")}
    costmap = rolling(obstacle(sources))
    assert costmap.is_current(0.0)
    assert costmap.is_current(0.5)
    assert not costmap.is_current(0.6)
    costmap.frames.set("odom", "base_link", Transform2D(), 0.6)
    costmap.observe(scan([1.0], stamp=0.6))
    assert costmap.is_current(1.05)
    assert not costmap.is_current(1.2)
    costmap.reset()
    assert costmap.is_current(5.0)


def test_source_without_a_rate_is_never_stale() -> None:
    costmap = rolling(
        obstacle({"scan": scan_source(), "bump": cloud_source(topic="mobile_base/sensors/bumper_pointcloud")})
    )
    assert costmap.is_current(0.0)
    assert costmap.is_current(1e6)


def test_footprint_clearing_can_be_disabled() -> None:
    for clearing, expected in ((True, 0), (False, 254)):
        costmap = rolling(obstacle({"points": cloud_source()}, footprint_clearing_enabled=clearing))
        costmap.observe(cloud([(0.02, 0.02, 0.2)]))
        costmap.update(0.0)
        assert costmap.master.cost_at(0.02, 0.02) == expected


def test_concave_footprints_keep_their_notch() -> None:
    # a U-shape, open at the front
    u = Footprint(
        np.array(
            [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5], [0.5, -0.25], [-0.2, -0.25], [-0.2, 0.25], [0.5, 0.25]]
        )
    )
    costmap = rolling(obstacle({"points": cloud_source()}))
    costmap.set_footprint(u)
    points = {(0.4, 0.0): 254, (0.0, 0.0): 254, (-0.35, 0.0): 0, (0.4, 0.4): 0, (0.4, -0.4): 0, (0.725, 0.0): 254}
    costmap.observe(cloud([(*p, 0.2) for p in points]))
    costmap.update(0.0)
    assert {p: costmap.master.cost_at(*p) for p in points} == points


def test_combination_methods() -> None:
    for method, expected in ((0, 0), (1, 77), (99, 77)):
        costmap = rolling(obstacle(combination_method=method))
        layer = layer_of(costmap)
        costmap.observe(scan([1.0]))
        costmap.update(0.0)
        costmap.master.data[:] = 77
        layer.update_costs(costmap.master, costmap.master.geometry.window)
        assert costmap.master.cost_at(0.5, 0.0) == expected
        assert costmap.master.cost_at(1.0, 0.0) == (77 if method == 99 else 254)


def test_reset_counts_obstacles() -> None:
    costmap = rolling(obstacle({"points": cloud_source()}), inflation())
    costmap.observe(cloud([(1.0, 0.0, 0.2), (0.0, 1.0, 0.2), (-1.0, -1.0, 0.2)]))
    costmap.update(0.0)
    layer = layer_of(costmap)
    assert layer.reset(Bounds(5.0, 5.0, 6.0, 6.0)) == 0
    assert layer.reset(Bounds(0.5, -0.5, 1.5, 0.5)) == 1
    assert layer.reset(Bounds(-0.5, 0.5, 0.5, 1.5), invert=True) == 1
    assert layer.reset() == 1
    assert not (layer.costs == 254).any()


def test_a_reset_region_is_rewritten() -> None:
    costmap = rolling(obstacle({"points": cloud_source()}), inflation())
    costmap.observe(cloud([(1.5, 1.5, 0.2)]))
    costmap.update(0.0)
    layer = layer_of(costmap)
    layer.buffers[0].observations.clear()
    layer.reset(Bounds(1.0, 1.0, 2.0, 2.0))
    costmap.update_at(HERE, 0.1)
    assert not costmap.master.data.any()


def test_voxels_distinguish_heights() -> None:
    sources = {"scan": scan_source(), "points": cloud_source()}
    costmap = rolling(obstacle(sources, voxel=True, z_voxels=3, z_resolution=0.2))
    layer = costmap.layer("obstacle_layer")
    assert isinstance(layer, VoxelLayer)
    costmap.observe(cloud([(0.5, 0.0, 0.05)]))  # a doorstep, below the scan at 0.3 m
    costmap.observe(scan([1.0], height=0.3))
    costmap.update(0.0)
    layer.buffers[1].observations.clear()
    costmap.update_at(HERE, 0.1)
    cell = costmap.master.geometry.world_to_cell(0.5, 0.0)
    assert cell is not None
    assert layer.column_at(*cell) == "#.?"
    assert costmap.master.cost_at(0.5, 0.0) == 254
    # the obstacle layer clears it
    flat = rolling(obstacle(sources))
    flat.observe(cloud([(0.5, 0.0, 0.05)]))
    flat.observe(scan([1.0], height=0.3))
    flat.update(0.0)
    layer_of(flat).buffers[1].observations.clear()
    flat.update_at(HERE, 0.1)
    assert flat.master.cost_at(0.5, 0.0) == 0


def test_voxel_thresholds() -> None:
    points = [(0.5, 0.0, 0.1), (0.5, 0.0, 0.3)]
    for threshold, expected in ((0, 254), (1, 254), (2, 255)):
        costmap = rolling(
            obstacle({"points": cloud_source()}, voxel=True, mark_threshold=threshold, track_unknown_space=True),
            track_unknown_space=True,
        )
        costmap.observe(cloud(points))
        costmap.update(0.0)
        assert costmap.master.cost_at(0.5, 0.0) == expected
    for unknown, expected in ((15, 0), (8, 255)):
        costmap = rolling(
            obstacle(voxel=True, z_voxels=10, unknown_threshold=unknown, track_unknown_space=True),
            track_unknown_space=True,
        )
        costmap.observe(scan([2.0]))
        costmap.update(0.0)
        # one of ten levels is seen free: nine are unknown, the limits are 15 + 6 and 8 + 6
        assert costmap.master.cost_at(0.5, 0.0) == (0 if unknown + 6 >= 9 else expected)


@pytest.mark.parametrize("levels", [1, 8, 9, 16])
def test_columns_of_every_height(levels: int) -> None:
    costmap = rolling(obstacle({"points": cloud_source()}, voxel=True, z_voxels=levels, z_resolution=2.0 / levels))
    top = 2.0 - 1.0 / levels
    costmap.observe(cloud([(0.5, 0.0, top)]))
    costmap.update(0.0)
    layer = costmap.layer("obstacle_layer")
    assert isinstance(layer, VoxelLayer)
    cell = costmap.master.geometry.world_to_cell(0.5, 0.0)
    assert cell is not None
    assert layer.column_at(*cell) == "?" * (levels - 1) + "#"
    assert layer.marks.itemsize == (2 if levels <= 8 else 4)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (scan(np.zeros((2, 2), np.float32)), "one-dimensional, contiguous float32"),
        (scan([1.0], stamp=math.nan), "finite numbers"),
        (scan([1.0], range_max=math.nan), "finite numbers"),
        (scan([1.0], range_min=math.inf), "finite numbers"),
    ],
)
def test_invalid_scans_are_rejected(bad: object, message: str) -> None:
    costmap = rolling(obstacle())
    with pytest.raises(InputError, match=message):
        costmap.observe(bad)  # type: ignore[arg-type]


def test_memory_is_at_most_three_bytes_a_cell() -> None:
    for voxel in (False, True):
        costmap = rolling(obstacle(voxel=voxel, **({"z_voxels": 8} if voxel else {})), inflation(), size=20.0)
        cells = costmap.master.data.size
        for layer in costmap.layers:
            arrays = [a for a in vars(layer).values() if isinstance(a, np.ndarray) and a.base is None]
            # scratch rows and tables do not count
            assert sum(a.nbytes for a in arrays) <= 3 * cells + 40_000
