"""Layered costmaps and their sensors."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.costmap.decaying_voxel_layer import DecayingSourceParams as DecayingSourceParams
    from navstack.costmap.decaying_voxel_layer import DecayingVoxelLayer as DecayingVoxelLayer
    from navstack.costmap.decaying_voxel_layer import DecayingVoxelLayerParams as DecayingVoxelLayerParams
    from navstack.costmap.denoise_layer import DenoiseLayer as DenoiseLayer
    from navstack.costmap.denoise_layer import DenoiseLayerParams as DenoiseLayerParams
    from navstack.costmap.denoise_layer import Nav2DenoiseLayer as Nav2DenoiseLayer
    from navstack.costmap.denoise_layer import Nav2DenoiseLayerParams as Nav2DenoiseLayerParams
    from navstack.costmap.inflation_layer import InflationLayer as InflationLayer
    from navstack.costmap.inflation_layer import InflationLayerParams as InflationLayerParams
    from navstack.costmap.inflation_layer import Nav2InflationLayer as Nav2InflationLayer
    from navstack.costmap.inflation_layer import Nav2InflationLayerParams as Nav2InflationLayerParams
    from navstack.costmap.inflation_layer import inflation_cost as inflation_cost
    from navstack.costmap.layered_costmap import FIXED as FIXED
    from navstack.costmap.layered_costmap import LayeredCostmap as LayeredCostmap
    from navstack.costmap.layered_costmap import apply_reconfigure as apply_reconfigure
    from navstack.costmap.layered_costmap import check_reconfigure as check_reconfigure
    from navstack.costmap.layered_costmap import costs_of_occupied as costs_of_occupied
    from navstack.costmap.mask_layers import BinaryMaskLayer as BinaryMaskLayer
    from navstack.costmap.mask_layers import BinaryMaskLayerParams as BinaryMaskLayerParams
    from navstack.costmap.mask_layers import KeepoutMaskLayer as KeepoutMaskLayer
    from navstack.costmap.mask_layers import MaskLayer as MaskLayer
    from navstack.costmap.mask_layers import MaskLayerParams as MaskLayerParams
    from navstack.costmap.mask_layers import SpeedLimit as SpeedLimit
    from navstack.costmap.mask_layers import SpeedMaskLayer as SpeedMaskLayer
    from navstack.costmap.mask_layers import SpeedMaskLayerParams as SpeedMaskLayerParams
    from navstack.costmap.observation_buffer import Nav2ObservationSourceParams as Nav2ObservationSourceParams
    from navstack.costmap.observation_buffer import ObservationBuffer as ObservationBuffer
    from navstack.costmap.observation_buffer import ObservationSourceParams as ObservationSourceParams
    from navstack.costmap.obstacle_layer import Nav2ObstacleLayer as Nav2ObstacleLayer
    from navstack.costmap.obstacle_layer import Nav2ObstacleLayerParams as Nav2ObstacleLayerParams
    from navstack.costmap.obstacle_layer import ObstacleLayer as ObstacleLayer
    from navstack.costmap.obstacle_layer import ObstacleLayerParams as ObstacleLayerParams
    from navstack.costmap.plugin_container_layer import PluginContainerLayer as PluginContainerLayer
    from navstack.costmap.plugin_container_layer import PluginContainerLayerParams as PluginContainerLayerParams
    from navstack.costmap.range_sensor_layer import RangeSensorLayer as RangeSensorLayer
    from navstack.costmap.range_sensor_layer import RangeSensorLayerParams as RangeSensorLayerParams
    from navstack.costmap.static_layer import Nav2StaticLayer as Nav2StaticLayer
    from navstack.costmap.static_layer import Nav2StaticLayerParams as Nav2StaticLayerParams
    from navstack.costmap.static_layer import StaticLayer as StaticLayer
    from navstack.costmap.static_layer import StaticLayerParams as StaticLayerParams
    from navstack.costmap.static_layer import map_from_frame as map_from_frame
    from navstack.costmap.voxel_layer import Nav2VoxelLayer as Nav2VoxelLayer
    from navstack.costmap.voxel_layer import Nav2VoxelLayerParams as Nav2VoxelLayerParams
    from navstack.costmap.voxel_layer import VoxelLayer as VoxelLayer
    from navstack.costmap.voxel_layer import VoxelLayerParams as VoxelLayerParams
    from navstack.parameters import CostmapParams as CostmapParams
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
