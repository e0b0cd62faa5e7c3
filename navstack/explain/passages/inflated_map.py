"""The static map in a costmap of a parameter set, before any sensor data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, FrameTree, OccupancyGrid, Pose2D
from navstack.costmap import LayeredCostmap, LayerSpec
from navstack.costmap.inflation_layer import InflationLayer
from navstack.costmap.mask_layers import KeepoutMaskLayer
from navstack.costmap.static_layer import StaticLayer, map_from_frame
from navstack.map_io import load_map
from navstack.parameters.configuration import CostmapConfiguration


def inflated_map(chosen: CostmapConfiguration, static_map: OccupancyGrid, name: str) -> LayeredCostmap:
    """The whole map, at its resolution, with the static, keepout and inflation layers of a costmap."""
    params = chosen.params.model_copy(
        update={"global_frame": static_map.frame, "robot_base_frame": "base", "rolling_window": False}
    )
    kinds = (StaticLayer, KeepoutMaskLayer, InflationLayer)
    specs = [LayerSpec(x.name, x.cls, x.params) for x in chosen.layers if issubclass(x.cls, kinds)]
    if not any(issubclass(spec.cls, StaticLayer) for spec in specs):
        # a costmap without a static layer observes the same walls with its sensors
        specs.insert(0, LayerSpec("static_layer", StaticLayer, StaticLayer.Params()))
    costmap = LayeredCostmap(
        f"{name}_costmap",
        params,
        specs,
        footprint=chosen.footprint,
        frames=FrameTree(),
        static_map=static_map,
        read_map=load_map,
    )
    g = costmap.master.geometry
    costmap.update_at(Pose2D(*g.cell_to_world(0, 0), 0.0), 0.0)
    return costmap


def known_cells(static_map: OccupancyGrid, live: LayeredCostmap) -> NDArray[np.bool_]:
    """(ny, nx) True for the costmap's cells that the map knows."""
    if static_map.data.shape == live.master.data.shape and static_map.origin_yaw == 0.0:
        return static_map.data >= 0
    layer = next(x for x in live.layers if isinstance(x, StaticLayer))
    return _known_in_rotated_map(layer, live.master)


def _known_in_rotated_map(layer: StaticLayer, master: Costmap) -> NDArray[np.bool_]:
    """Looks up the centre of every cell of the master grid in the map."""
    g, m = master.geometry, layer.map.geometry
    to_map = map_from_frame(layer.map, FrameTree(), layer.map.frame, None)
    x = g.origin_x + (np.arange(g.nx) + 0.5) * g.resolution
    y = g.origin_y + (np.arange(g.ny) + 0.5) * g.resolution
    grid: NDArray[np.float64] = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float64)
    points = to_map.apply_points(grid)
    ix = np.floor((points[:, 0] - m.origin_x) / m.resolution).astype(np.int64)
    iy = np.floor((points[:, 1] - m.origin_y) / m.resolution).astype(np.int64)
    inside = (ix >= 0) & (ix < m.nx) & (iy >= 0) & (iy < m.ny)
    known = np.zeros(len(points), bool)
    known[inside] = layer.map.data[iy[inside], ix[inside]] >= 0
    return known.reshape(g.shape)
