"""map_server: the map on latched topics and by service, and a service that changes it."""

from __future__ import annotations

from typing import Any

from navstack.core import OccupancyGrid
from navstack.core.errors import NavError
from navstack.logs.builder import MessageBuilder
from navstack.map_io import load_map
from navstack.ros1 import ros
from navstack.ros1.clock import wait_for_clock
from navstack.ros1.master import MasterWatch


class MapTopics:
    """`map` and `map_metadata`, latched, and the services `static_map` and `change_map`."""

    def __init__(self, grid: OccupancyGrid, build: MessageBuilder) -> None:
        rospy = self._rospy = ros.rospy()
        self._build = build
        self._grid = grid
        self._message: Any = None
        self._map = rospy.Publisher("map", ros.message("nav_msgs/OccupancyGrid"), queue_size=1, latch=True)
        self._data = rospy.Publisher("map_metadata", ros.message("nav_msgs/MapMetaData"), queue_size=1, latch=True)
        self._get = rospy.Service("static_map", ros.message("nav_msgs/srv/GetMap"), self._on_get)
        self._load = rospy.Service("change_map", ros.message("nav_msgs/srv/LoadMap"), self._on_change)

    def publish(self, stamp_ns: int) -> None:
        """Publish the map."""
        self._message = self._build.map(stamp_ns, self._grid)
        self._map.publish(self._message)
        self._data.publish(self._message.info)

    def _on_get(self, request: Any) -> Any:
        del request
        return ros.message("nav_msgs/srv/GetMapResponse")(map=self._message)

    def _on_change(self, request: Any) -> Any:
        """Load a map file and publish it; the result is 0, or 255 if it cannot be read."""
        response = ros.message("nav_msgs/srv/LoadMapResponse")()
        try:
            self._grid = load_map(str(request.map_url))
        except NavError as exc:
            self._rospy.logerr("%s", exc.message)
            response.result = 255
            return response
        self.publish(int(self._rospy.Time.now().to_nsec()))
        response.result = 0
        return response


def run(grid: OccupancyGrid) -> None:
    """Serve a map until the node is shut down; the parameter `~frame_id` names its frame."""
    import dataclasses

    rospy = ros.rospy()
    frame = str(rospy.get_param("~frame_id", "map"))
    topics = MapTopics(dataclasses.replace(grid, frame=frame), MessageBuilder(ros.MessageTypes(), ros1=True))
    wait_for_clock()
    MasterWatch()
    topics.publish(int(rospy.Time.now().to_nsec()))
    while not ros.is_stopping():
        ros.STOP.wait(0.1)
    ros.shut_down(lambda: None)
