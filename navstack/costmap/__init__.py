"""Costmaps: layers of costs over a grid, and the sensors that feed them."""

from navstack.costmap.inflation_layer import InflationLayer, InflationLayerParams, inflation_cost
from navstack.costmap.layered_costmap import LayeredCostmap, LayerSpec, footprint_of, parse_footprint
from navstack.costmap.observation_buffer import ObservationBuffer, ObservationSourceParams
from navstack.costmap.obstacle_layer import ObstacleLayer, ObstacleLayerParams
from navstack.costmap.params import CostmapParams
from navstack.costmap.static_layer import StaticLayer, StaticLayerParams
from navstack.costmap.voxel_layer import VoxelLayer, VoxelLayerParams

__all__ = [
    "CostmapParams",
    "InflationLayer",
    "InflationLayerParams",
    "LayerSpec",
    "LayeredCostmap",
    "ObservationBuffer",
    "ObservationSourceParams",
    "ObstacleLayer",
    "ObstacleLayerParams",
    "StaticLayer",
    "StaticLayerParams",
    "VoxelLayer",
    "VoxelLayerParams",
    "footprint_of",
    "inflation_cost",
    "parse_footprint",
]
