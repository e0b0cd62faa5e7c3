"""The topics of a costmap: the grid, its updates, the footprint and the voxels; a footprint and updates of the map come in."""

from __future__ import annotations

import logging
from functools import partial
from typing import Any

from navstack.core import NavError, Transform2D, Window
from navstack.costmap import LayeredCostmap, StaticLayer, VoxelLayer
from navstack.move_base import Schedule
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import Inbox, NodeClock, use_footprint, use_map_update

# --- what changes a costmap by topics: a new footprint, and updates of the map ----------------------------------------


def footprint_topic(costmap: LayeredCostmap, parameter: str) -> str:
    """Return the topic of `footprint_topic` or `published_footprint_topic`, searched in the enclosing namespaces."""
    rospy = ros.rospy()
    params = costmap.params
    found = None if parameter in params.model_fields_set else rospy.search_param(parameter)
    topic = str(getattr(params, parameter) if found is None else rospy.get_param(found))
    return topic if topic.startswith(("/", "~")) else f"~{costmap.name}/{topic}"


class _OwnTopic(logging.Filter):
    """Drops rospy's warning that the node cannot subscribe to its own footprint: by default both topics have one name."""

    def filter(self, record: logging.LogRecord) -> bool:
        text = record.getMessage()
        own = str(ros.rospy().get_name())
        return not ("topic types do not match" in text and "geometry_msgs/Polygon" in text and f"'{own}'" in text)


class CostmapInputs:
    """Subscribes to the footprint of one costmap and to the updates of its maps."""

    def __init__(self, costmap: LayeredCostmap, inbox: Inbox) -> None:
        rospy = ros.rospy()
        topic = footprint_topic(costmap, "footprint_topic")
        polygon, update = ros.message("geometry_msgs/Polygon"), ros.message("map_msgs/OccupancyGridUpdate")
        if topic == footprint_topic(costmap, "published_footprint_topic"):
            logging.getLogger("rosout").addFilter(_OwnTopic())
        rospy.Subscriber(topic, polygon, inbox.poster(partial(use_footprint, costmap)), queue_size=1)
        for layer in costmap.layers:
            if isinstance(layer, StaticLayer) and layer.params.subscribe_to_updates:
                name = f"{layer.params.map_topic}_updates"
                rospy.Subscriber(name, update, inbox.poster(partial(use_map_update, layer)), queue_size=10)


# --- the topics of voxel layers: the voxels, and the ends of the rays that clear them ---------------------------------


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
            kind = ros.message(ros.VOXEL_GRID)
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
        message = ros.message(ros.VOXEL_GRID)(header=header)
        message.data = layer.voxel_words().ravel().tolist()
        message.origin.x, message.origin.y, message.origin.z = geometry.origin_x, geometry.origin_y, params.origin_z
        message.resolutions.x = message.resolutions.y = geometry.resolution
        message.resolutions.z = params.z_resolution
        message.size_x, message.size_y, message.size_z = geometry.nx, geometry.ny, layer.levels
        return message


class CostmapTopics:
    """Publishes one costmap."""

    def __init__(self, costmap: LayeredCostmap, clock: NodeClock, build: MessageBuilder, inbox: Inbox) -> None:
        rospy = ros.rospy()
        self.costmap = costmap
        self._clock, self._build = clock, build
        self._schedule = Schedule(costmap.params.publish_frequency, clock.now())
        self._touched: Window | None = None
        self._geometry: Any = None

        class Greeter(rospy.SubscribeListener):  # type: ignore[name-defined,misc]
            """Sends the whole grid to each new subscriber."""

            def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
                del self, topic_name, topic_publish
                inbox.post(lambda: peer_publish(greeting()))

        greeting = self._grid
        name = f"~{costmap.name}"
        grid, update = ros.message("nav_msgs/OccupancyGrid"), ros.message("map_msgs/OccupancyGridUpdate")
        self._full = rospy.Publisher(f"{name}/costmap", grid, subscriber_listener=Greeter(), queue_size=1)
        self._updates = rospy.Publisher(f"{name}/costmap_updates", update, queue_size=1)
        polygon = ros.message("geometry_msgs/PolygonStamped")
        topic = footprint_topic(costmap, "published_footprint_topic")
        self._footprint = rospy.Publisher(topic, polygon, queue_size=1)
        self._voxels = VoxelTopics(costmap, build)

    def _grid(self) -> Any:
        return self._build.costmap(self._clock.ns(self._clock.now()), self.costmap.master)

    def publish(self, now: float, window: Window | None) -> None:
        """Publish what is due; `window` are the cells that the last update changed, None without an update."""
        costmap = self.costmap
        if window is not None:
            if not window.is_empty:
                before = self._touched
                self._touched = window if before is None else before.union(window)
            if self._footprint.get_num_connections():
                self._publish_footprint(now)
            self._voxels.publish(self._clock.ns(now))
        self._schedule.set_frequency(costmap.params.publish_frequency, now)
        if not self._schedule.is_due(now):
            return
        self._schedule.advance(now)
        if not self._full.get_num_connections():
            return
        geometry, touched = costmap.master.geometry, self._touched
        if geometry != self._geometry or costmap.params.always_send_full_costmap:
            self._geometry = geometry
            self._full.publish(self._grid())
        elif touched is not None:
            self._updates.publish(self._build.costmap_update(self._clock.ns(now), costmap.master, touched))
        self._touched = None

    def _publish_footprint(self, now: float) -> None:
        try:
            pose = self.costmap.robot_pose(now)
        except NavError:
            return
        corners = Transform2D(*pose).apply_points(self.costmap.footprint.vertices)
        self._footprint.publish(self._build.polygon(self._clock.ns(now), self.costmap.frame, corners))
