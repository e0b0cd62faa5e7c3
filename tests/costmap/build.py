"""Small costmaps for tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from navstack.core import Footprint, FrameTree, GridGeometry, LaserScan, OccupancyGrid, PointCloud, Transform2D
from navstack.costmap import (
    CostmapParams,
    InflationLayer,
    InflationLayerParams,
    LayeredCostmap,
    ObservationSourceParams,
    ObstacleLayer,
    ObstacleLayerParams,
    StaticLayer,
    StaticLayerParams,
    VoxelLayer,
    VoxelLayerParams,
)
from navstack.plugins import Plugin


def scan_source(**changes: Any) -> ObservationSourceParams:
    values: dict[str, Any] = {"data_type": "LaserScan", "marking": True, "clearing": True}
    return ObservationSourceParams(**(values | changes))


def cloud_source(**changes: Any) -> ObservationSourceParams:
    values: dict[str, Any] = {"data_type": "PointCloud2", "marking": True}
    return ObservationSourceParams(**(values | changes))


def obstacle(
    sources: dict[str, ObservationSourceParams] | None = None, *, voxel: bool = False, **changes: Any
) -> Plugin:
    sources = {"scan": scan_source()} if sources is None else sources
    common: dict[str, Any] = {"observation_sources": " ".join(sources), "sources": sources} | changes
    if voxel:
        return Plugin("obstacle_layer", VoxelLayer, VoxelLayerParams(**common))
    return Plugin("obstacle_layer", ObstacleLayer, ObstacleLayerParams(**common))


def inflation(**changes: Any) -> Plugin:
    values: dict[str, Any] = {"inflation_radius": 0.5, "cost_scaling_factor": 5.0}
    return Plugin("inflation_layer", InflationLayer, InflationLayerParams(**(values | changes)))


def static(**changes: Any) -> Plugin:
    return Plugin("static_layer", StaticLayer, StaticLayerParams(**changes))


def frames_at(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, stamp: float = 0.0) -> FrameTree:
    frames = FrameTree()
    frames.set("odom", "base_link", Transform2D(x, y, yaw), stamp)
    frames.set_static("base_link", "laser", Transform2D())
    return frames


def rolling(
    *layers: Plugin, size: float = 4.0, resolution: float = 0.05, frames: FrameTree | None = None, **changes: Any
) -> LayeredCostmap:
    values: dict[str, Any] = {
        "global_frame": "odom",
        "rolling_window": True,
        "width": size,
        "height": size,
        "resolution": resolution,
    }
    return LayeredCostmap(
        "local_costmap",
        CostmapParams(**(values | changes)),
        layers,
        footprint=Footprint.from_radius(0.1),
        frames=frames or frames_at(),
    )


def scan(ranges: list[float] | np.ndarray, stamp: float = 0.0, *, height: float = 0.3, **changes: Any) -> LaserScan:
    """Return a scan over the full circle; the first beam points ahead."""
    beams = np.asarray(ranges, np.float32)
    values: dict[str, Any] = {"range_min": 0.05, "range_max": 10.0, "frame": "laser", "topic": "scan"}
    return LaserScan(beams, 0.0, 2.0 * math.pi / max(1, len(beams)), stamp=stamp, height=height, **(values | changes))


def cloud(points: list[tuple[float, float, float]], stamp: float = 0.0, **changes: Any) -> PointCloud:
    values: dict[str, Any] = {"frame": "laser", "topic": "points"}
    return PointCloud(np.array(points, np.float32).reshape(-1, 3), stamp=stamp, **(values | changes))


def grid_of(text: str, resolution: float = 1.0, **changes: Any) -> OccupancyGrid:
    """Return a map from text, top row first: `#` occupied, `.` free, `?` unknown."""
    values = {"#": 100, ".": 0, "?": -1}
    rows = [[values[c] for c in line.strip()] for line in text.strip().splitlines()]
    data = np.ascontiguousarray(np.array(rows, np.int8)[::-1])
    ny, nx = data.shape
    return OccupancyGrid(data, GridGeometry(nx, ny, resolution), **changes)
