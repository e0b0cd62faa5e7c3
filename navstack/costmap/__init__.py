"""Layered costmaps and their sensors."""

from navstack.costmap.denoise_layer import DenoiseLayer, DenoiseLayerParams
from navstack.costmap.inflation_layer import InflationLayer, InflationLayerParams, inflation_cost
from navstack.costmap.layered_costmap import LayeredCostmap, LayerSpec
from navstack.costmap.mask_layers import (
    KeepoutMaskLayer,
    MaskLayerParams,
    SpeedLimit,
    SpeedMaskLayer,
    SpeedMaskLayerParams,
)
from navstack.costmap.observation_buffer import ObservationBuffer, ObservationSourceParams
from navstack.costmap.obstacle_layer import ObstacleLayer, ObstacleLayerParams
from navstack.costmap.range_sensor_layer import RangeSensorLayer, RangeSensorLayerParams
from navstack.costmap.static_layer import StaticLayer, StaticLayerParams
from navstack.costmap.voxel_layer import VoxelLayer, VoxelLayerParams
from navstack.parameters.models.costmap import CostmapParams

__all__ = [
    "CostmapParams",
    "DenoiseLayer",
    "DenoiseLayerParams",
    "InflationLayer",
    "InflationLayerParams",
    "KeepoutMaskLayer",
    "LayerSpec",
    "LayeredCostmap",
    "MaskLayerParams",
    "ObservationBuffer",
    "ObservationSourceParams",
    "ObstacleLayer",
    "ObstacleLayerParams",
    "RangeSensorLayer",
    "RangeSensorLayerParams",
    "SpeedLimit",
    "SpeedMaskLayer",
    "SpeedMaskLayerParams",
    "StaticLayer",
    "StaticLayerParams",
    "VoxelLayer",
    "VoxelLayerParams",
    "inflation_cost",
]
