"""The topics of a costmap: the grid, its updates and the footprint, as Costmap2DPublisher publishes them."""

from __future__ import annotations

from typing import Any

from navstack.core import Transform2D, Window
from navstack.core.errors import NavError
from navstack.costmap import LayeredCostmap
from navstack.logs.builder import MessageBuilder
from navstack.move_base.schedule import Schedule
from navstack.ros1 import ros
from navstack.ros1.clock import NodeClock
from navstack.ros1.costmap_inputs import footprint_topic
from navstack.ros1.inbox import Inbox
from navstack.ros1.voxel_topics import VoxelTopics


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
                self._touched = window if before is None else _union(before, window)
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


def _union(a: Window, b: Window) -> Window:
    return Window(min(a.x0, b.x0), min(a.y0, b.y0), max(a.x1, b.x1), max(a.y1, b.y1))
