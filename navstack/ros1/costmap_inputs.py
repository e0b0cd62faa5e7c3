"""What changes a costmap by topics: a new footprint, and updates of the map."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from navstack.core import Footprint
from navstack.core.errors import InputError, NavError
from navstack.costmap import LayeredCostmap
from navstack.costmap.static_layer import StaticLayer
from navstack.ros1 import ros
from navstack.ros1.inbox import Inbox


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
        self._costmap = costmap
        topic = footprint_topic(costmap, "footprint_topic")
        polygon, update = ros.message("geometry_msgs/Polygon"), ros.message("map_msgs/OccupancyGridUpdate")
        if topic == footprint_topic(costmap, "published_footprint_topic"):
            logging.getLogger("rosout").addFilter(_OwnTopic())
        rospy.Subscriber(topic, polygon, inbox.poster(self._on_footprint), queue_size=1)
        for layer in costmap.layers:
            if isinstance(layer, StaticLayer) and layer.params.subscribe_to_updates:
                name = f"{layer.params.map_topic}_updates"
                rospy.Subscriber(name, update, inbox.poster(self._on_update, layer), queue_size=10)

    def _on_footprint(self, message: Any) -> None:
        """Use another footprint, padded by `footprint_padding`. Raises InputError for a polygon that is none."""
        points = np.array([(point.x, point.y) for point in message.points], np.float64).reshape(-1, 2)
        try:
            footprint = Footprint(points, self._costmap.params.footprint_padding)
        except NavError as exc:
            raise InputError(f"a footprint of {self._costmap.name} is ignored: {exc.message}") from exc
        self._costmap.set_footprint(footprint)

    def _on_update(self, message: Any, layer: StaticLayer) -> None:
        """Change a part of the map. Raises InputError for one that is not inside the map."""
        height, width = int(message.height), int(message.width)
        data = np.asarray(message.data, np.int8)
        if height * width != len(data):
            raise InputError(f"an update of the map of {width} x {height} cells has {len(data)} values; it is ignored")
        layer.update_map(int(message.x), int(message.y), data.reshape(height, width))
