"""The topics of voxel layers: the voxels, and the ends of the rays that clear them."""

from __future__ import annotations

from typing import Any

from navstack.costmap import LayeredCostmap
from navstack.costmap.voxel_layer import VoxelLayer
from navstack.logs.builder import MessageBuilder
from navstack.ros1 import generated_messages, ros


class VoxelTopics:
    """Publishes `<layer>/voxel_grid` (with publish_voxel_map) and `<layer>/clearing_endpoints` of one costmap.

    They are computed only while a node subscribes.
    """

    def __init__(self, costmap: LayeredCostmap, build: MessageBuilder) -> None:
        self._build = build
        self._layers = [
            _LayerTopics(f"~{costmap.name}/{layer.name}", layer)
            for layer in costmap.layers
            if isinstance(layer, VoxelLayer)
        ]
        self._frame = costmap.frame

    def publish(self, stamp_ns: int) -> None:
        """Publish the voxels after an update of the costmap."""
        for topics in self._layers:
            topics.publish(self._build.header(stamp_ns, self._frame))


class _LayerTopics:
    def __init__(self, name: str, layer: VoxelLayer) -> None:
        rospy = ros.rospy()
        self._layer = layer
        self._grid: Any = None
        if layer.params.publish_voxel_map:
            kind = generated_messages.message(generated_messages.VOXEL_GRID)
            self._grid = rospy.Publisher(f"{name}/voxel_grid", kind, queue_size=1)
        self._ends = rospy.Publisher(f"{name}/clearing_endpoints", ros.message("sensor_msgs/PointCloud"), queue_size=1)

    def publish(self, header: Any) -> None:
        if self._grid is not None and self._grid.get_num_connections():
            self._grid.publish(self._voxels(header))
        if self._ends.get_num_connections():
            point = ros.message("geometry_msgs/Point32")
            points = [point(*row) for row in self._layer.clearing_ends().tolist()]
            self._ends.publish(ros.message("sensor_msgs/PointCloud")(header=header, points=points))

    def _voxels(self, header: Any) -> Any:
        layer = self._layer
        geometry, params = layer.geometry, layer.params
        message = generated_messages.message(generated_messages.VOXEL_GRID)(header=header)
        message.data = layer.voxel_words().ravel().tolist()
        message.origin.x, message.origin.y, message.origin.z = geometry.origin_x, geometry.origin_y, params.origin_z
        message.resolutions.x = message.resolutions.y = geometry.resolution
        message.resolutions.z = params.z_resolution
        message.size_x, message.size_y, message.size_z = geometry.nx, geometry.ny, layer.levels
        return message
