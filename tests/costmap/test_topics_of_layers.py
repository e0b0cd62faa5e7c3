"""What the ROS 1 node publishes of layers and changes in them by topics: voxels, ends of rays, footprints, parts of the map."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import Footprint, FrameTree, InputError, Pose2D
from navstack.costmap import CostmapParams, LayeredCostmap
from navstack.costmap.layered_costmap import apply_reconfigure
from navstack.costmap.static_layer import StaticLayer
from navstack.costmap.voxel_layer import VoxelLayer
from tests.costmap.build import cloud, cloud_source, frames_at, grid_of, obstacle, rolling, static


@pytest.mark.parametrize("levels", [1, 2, 16])
def test_voxel_words_and_ends_of_rays(levels: int) -> None:
    """Each column as text is the column as a word; the rays end two cells before their points, inside the grid."""
    layer_spec = obstacle(
        {"cloud": cloud_source(topic="cloud", clearing=True, raytrace_range=10.0)},
        voxel=True,
        z_voxels=levels,
        unknown_threshold=16,
        max_obstacle_height=5.0,
    )
    costmap = rolling(layer_spec, frames=frames_at())
    points = [(1.5, 0.0, 0.1), (0.0, 1.0, 0.1), (-40.0, 0.0, 0.1)]
    costmap.observe(cloud(points, topic="cloud"))
    costmap.update_at(Pose2D(0.0, 0.0), 0.1)
    layer = costmap.layers[0]
    assert isinstance(layer, VoxelLayer)
    words, (ny, nx) = layer.voxel_words(), layer.geometry.shape
    assert words.shape == (ny, nx) and words.dtype == np.uint32
    seen: set[str] = set()
    for iy in range(ny):
        for ix in range(nx):
            word = int(words[iy, ix])
            signs = ("#" if word >> z + 16 & 1 else "?" if word >> z & 1 else "." for z in range(levels))
            column = "".join(signs)
            assert column == layer.column_at(ix, iy)
            assert all(word >> z & 1 for z in range(levels, 16))
            seen |= set(column)
    assert {"#", ".", "?"} <= seen or levels == 1
    ends, resolution = layer.clearing_ends(), layer.geometry.resolution
    assert ends.shape == (3, 3)
    assert np.abs(ends[0, :2] - (1.5 - 2 * resolution, 0.0)).max() <= resolution
    assert np.abs(ends[1, :2] - (0.0, 1.0 - 2 * resolution)).max() <= resolution
    left, right, bottom, top = layer.geometry.extent
    assert left <= ends[2, 0] <= left + resolution and bottom < ends[2, 1] < top and right > 0.0


def test_a_footprint_of_a_topic_and_a_part_of_the_map() -> None:
    params = CostmapParams(global_frame="map", robot_base_frame="base_link")
    costmap = LayeredCostmap(
        "global_costmap",
        params,
        [static(subscribe_to_updates=True)],
        footprint=Footprint.from_radius(0.4),
        frames=FrameTree(),
        static_map=grid_of("....\n....\n...."),
    )
    # other parameters leave a footprint that a topic has set, those of the footprint replace it
    layers = [static(subscribe_to_updates=True)]
    square = Footprint(np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]))
    costmap.set_footprint(square)
    faster = params.model_copy(update={"update_frequency": 7.0})
    apply_reconfigure(costmap, faster, layers, Footprint.from_radius(0.4))
    assert costmap.footprint == square
    larger = faster.model_copy(update={"robot_radius": 0.5})
    apply_reconfigure(costmap, larger, layers, Footprint.from_radius(0.5))
    assert costmap.footprint == Footprint.from_radius(0.5)

    costmap.update_at(Pose2D(1.0, 1.0), 0.0)
    layer = costmap.layers[0]
    assert isinstance(layer, StaticLayer)
    before = layer.map
    layer.update_map(2, 1, np.array([[100, 0], [-1, 100]], np.int8))
    costmap.update_at(Pose2D(1.0, 1.0), 1.0)
    assert costmap.master.data.tolist() == [[0, 0, 0, 0], [0, 0, 254, 0], [0, 0, 255, 254]]
    assert not before.data.any() and before.geometry == layer.map.geometry
    for x, y in ((-1, 0), (3, 0), (0, 2), (0, -1)):
        with pytest.raises(InputError, match="is not inside the map of 4 x 3 cells"):
            layer.update_map(x, y, np.zeros((2, 2), np.int8))
