"""Topics of costmaps and plans under the names of Nav2."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from navstack.core import Costmap, InputError, NavError, Pose2D, Transform2D, Window
from navstack.costmap import (
    BinaryMaskLayer,
    KeepoutMaskLayer,
    LayeredCostmap,
    MaskLayer,
    SpeedMaskLayer,
    StaticLayer,
)
from navstack.move_base import MoveBase, Schedule, TickResult
from navstack.ros2 import ros
from navstack.ros2.ros import RosNode
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, LoopTimes, NodeClock, NodeState, RosRobot, use_footprint, use_map_update

GRID, UPDATE = "nav_msgs/msg/OccupancyGrid", "map_msgs/msg/OccupancyGridUpdate"
RAW, RAW_UPDATE = "nav2_msgs/msg/Costmap", "nav2_msgs/msg/CostmapUpdate"


class CostmapTopics:
    """`<name>/costmap`, `costmap_raw`, their updates and `published_footprint`; `footprint` and updates of the map come in."""

    def __init__(self, costmap: LayeredCostmap, node: RosNode, clock: NodeClock, inbox: Inbox) -> None:
        self.costmap, self._build, self._clock = costmap, node.build, clock
        self._schedule = Schedule(costmap.params.publish_frequency, clock.now())
        self._touched: Window | None = None
        self._geometry: Any = None
        name = costmap.name
        self._full = node.publisher(f"{name}/costmap", GRID, latched=True)
        self._updates = (
            node.publisher(f"{name}/costmap_updates", UPDATE, latched=True) if ros.has_message(UPDATE) else None
        )
        has_raw = ros.has_message(RAW)
        self._raw = node.publisher(f"{name}/costmap_raw", RAW, latched=True) if has_raw else None
        has_updates = has_raw and ros.has_message(RAW_UPDATE)
        self._raw_updates = (
            node.publisher(f"{name}/costmap_raw_updates", RAW_UPDATE, latched=True) if has_updates else None
        )
        self._footprint = node.publisher(f"{name}/published_footprint", "geometry_msgs/msg/PolygonStamped")
        node.subscribe(
            f"{name}/footprint", "geometry_msgs/msg/Polygon", inbox.poster(partial(use_footprint, costmap), most=1)
        )
        for layer in costmap.layers:
            if isinstance(layer, StaticLayer) and layer.params.subscribe_to_updates:
                topic = f"{layer.params.map_topic or 'map'}_updates"
                node.subscribe(topic, UPDATE, inbox.poster(partial(use_map_update, layer)), depth=10)

    # --- out ----------------------------------------------------------------------------------------------------------

    def publish(self, now: float, window: Window | None) -> None:
        """Publish what is due; `window` are the cells that the last update changed, None without an update."""
        costmap = self.costmap
        if window is not None:
            if not window.is_empty:
                self._touched = window if self._touched is None else self._touched.union(window)
            if self._footprint.is_wanted:
                self._publish_footprint(now)
        self._schedule.set_frequency(costmap.params.publish_frequency, now)
        if not self._schedule.is_due(now):
            return
        self._schedule.advance(now)
        stamp, master, touched = self._clock.ns(now), costmap.master, self._touched
        is_whole = master.geometry != self._geometry or costmap.params.always_send_full_costmap
        # a late subscriber gets the last whole grid of the middleware, and at once the current one
        if self._full.has_new_subscriber() or (is_whole and self._full.is_wanted):
            self._full.publish(self._build.costmap(stamp, master))
        elif touched is not None and self._updates is not None and self._full.is_wanted:
            self._updates.publish(self._build.costmap_update(stamp, master, touched))
        if self._raw is not None and (self._raw.has_new_subscriber() or (is_whole and self._raw.is_wanted)):
            self._raw.publish(raw_costmap(self._build, stamp, master))
        elif touched is not None and self._raw_updates is not None and self._raw_updates.is_wanted:
            self._raw_updates.publish(raw_update(self._build, stamp, master, touched))
        self._geometry, self._touched = master.geometry, None

    def _publish_footprint(self, now: float) -> None:
        try:
            pose = self.costmap.robot_pose(now)
        except NavError:
            return
        corners = Transform2D(*pose).apply_points(self.costmap.footprint.vertices)
        self._footprint.publish(self._build.polygon(self._clock.ns(now), self.costmap.frame, corners))


def raw_costmap(build: MessageBuilder, stamp_ns: int, costmap: Costmap) -> Any:
    """Return a nav2_msgs/Costmap: the costs as they are."""
    geometry = costmap.geometry
    metadata = build.of(
        "nav2_msgs/msg/CostmapMetaData",
        update_time=build.time(stamp_ns),
        layer="master",
        resolution=geometry.resolution,
        size_x=geometry.nx,
        size_y=geometry.ny,
        origin=build.pose(Pose2D(geometry.origin_x, geometry.origin_y, 0.0)),
    )
    data = np.ascontiguousarray(costmap.data).ravel()
    return build.of(RAW, header=build.header(stamp_ns, costmap.frame), metadata=metadata, data=data)


def raw_update(build: MessageBuilder, stamp_ns: int, costmap: Costmap, window: Window) -> Any:
    """Return a nav2_msgs/CostmapUpdate of a window."""
    part = costmap.data[window.y0 : window.y1, window.x0 : window.x1]
    return build.of(
        RAW_UPDATE,
        header=build.header(stamp_ns, costmap.frame),
        x=window.x0,
        y=window.y0,
        size_x=part.shape[1],
        size_y=part.shape[0],
        data=np.ascontiguousarray(part).ravel(),
    )


FILTER_TYPES: Final[dict[int, tuple[type[MaskLayer], dict[str, str]]]] = {
    0: (KeepoutMaskLayer, {}),
    1: (SpeedMaskLayer, {"type": "percent"}),
    2: (SpeedMaskLayer, {"type": "absolute"}),
    3: (BinaryMaskLayer, {}),
}
"""Layer, and what it must be told, of each type in nav2_msgs/CostmapFilterInfo."""


class FilterTopics:
    """Takes the mask of one costmap filter from the topics that its `filter_info_topic` names, as Nav2."""

    def __init__(self, layer: MaskLayer, node: RosNode, inbox: Inbox, changed: Callable[[], None]) -> None:
        """`changed` is called when a new mask is in use."""
        self._layer, self._node, self._inbox, self._changed = layer, node, inbox, changed
        self._mask_topic = ""
        receive = inbox.poster(self._on_info, most=1)
        node.subscribe(layer.params.filter_info_topic, "nav2_msgs/msg/CostmapFilterInfo", receive, latched=True)

    def _on_info(self, message: Any) -> None:
        layer, kind = self._layer, int(message.type)
        cls, told = FILTER_TYPES.get(kind, (None, {}))
        if cls is not type(layer):
            topic = layer.params.filter_info_topic
            raise InputError(f"{topic} is of type {kind}, which is not for {layer.name}; the message is ignored")
        if not isinstance(layer, KeepoutMaskLayer):
            told = {**told, "base": float(message.base), "multiplier": float(message.multiplier)}
        layer.params = layer.params.model_copy(update=told)
        topic, self._mask_topic = self._mask_topic, str(message.filter_mask_topic)
        if topic != self._mask_topic:
            receive = self._inbox.poster(partial(self._on_mask, topic=self._mask_topic), most=1)
            # in the thread of rclpy, which may itself be waiting for this one
            self._node.later(partial(self._node.subscribe, self._mask_topic, GRID, receive, latched=True))
        self._changed()

    def _on_mask(self, message: Any, *, topic: str) -> None:
        if topic == self._mask_topic:
            self._layer.set_mask(msg.map_of(message, topic, self._node.log.logwarn))
            self._changed()


class BinaryState:
    """`binary_state` (std_msgs/Bool) of the binary filters: sent when it changes, and to late subscribers."""

    def __init__(self, layer: BinaryMaskLayer, node: RosNode) -> None:
        self._layer, self._build = layer, node.build
        self._out = node.publisher("binary_state", "std_msgs/msg/Bool", latched=True)
        self._sent: bool | None = None

    def publish(self) -> None:
        """Publish the state if it has changed."""
        if self._layer.state != self._sent:
            self._sent = self._layer.state
            self._out.publish(self._build.of("std_msgs/msg/Bool", data=self._sent))


class Diagnostics:
    """Publishes a diagnostic_msgs/DiagnosticArray once per second."""

    def __init__(self, node: RosNode, clock: NodeClock, robot: RosRobot, times: LoopTimes) -> None:
        self._build, self._clock = node.build, clock
        self._state = NodeState(str(node.handle.get_fully_qualified_name()).removeprefix("/"), robot, times)
        self._out = node.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", depth=10)

    def publish(self, move_base: MoveBase, now: float) -> None:
        """Publish if it is due."""
        if not self._state.is_due() or not self._out.is_wanted:
            return
        of = self._build.of
        parts = [
            of(
                "diagnostic_msgs/msg/DiagnosticStatus",
                level=bytes([level]),
                name=name,
                message=text,
                hardware_id="navstack",
                values=[of("diagnostic_msgs/msg/KeyValue", key=k, value=str(v)) for k, v in values.items()],
            )
            for level, name, text, values in self._state.parts(move_base, now)
        ]
        header = self._build.header(self._clock.ns(now), "")
        self._out.publish(of("diagnostic_msgs/msg/DiagnosticArray", header=header, status=parts))


class PlanTopics:
    """`plan`, `received_global_plan`, `transformed_global_plan`, `local_plan` and `marker` of the local trajectory."""

    def __init__(self, node: RosNode, clock: NodeClock) -> None:
        path = "nav_msgs/msg/Path"
        self._build, self._clock = node.build, clock
        self._plan = node.publisher("plan", path, depth=10)
        self._received = node.publisher("received_global_plan", path, depth=10)
        self._transformed = node.publisher("transformed_global_plan", path, depth=10)
        self._local = node.publisher("local_plan", path, depth=10)
        markers = "visualization_msgs/msg/MarkerArray"
        self._markers = node.publisher("marker", markers, depth=10) if ros.has_message(markers) else None

    def publish(self, move_base: MoveBase, tick: TickResult) -> None:
        """Publish the plans of a cycle."""
        stamp, build = self._clock.ns(tick.time), self._build
        if tick.plan is not None:
            self.publish_plan(stamp, tick.plan.path.frame, tick.plan.path.poses)
        local = tick.local_plan
        if local is None:
            return
        frame = move_base.local_costmap.frame
        if local.trajectory is not None:
            trajectory = np.asarray(local.trajectory, np.float64)
            if self._local.is_wanted:
                self._local.publish(build.path(stamp, frame, trajectory))
            if self._markers is not None and self._markers.is_wanted and len(trajectory):
                self._markers.publish(build.line_marker(stamp, frame, "local_plan", trajectory))
        if local.local_plan is not None and self._transformed.is_wanted:
            found = local.local_plan
            self._transformed.publish(build.path(stamp, found.frame, found.poses))

    def publish_plan(self, stamp: int, frame: str, poses: Any) -> None:
        """Publish a plan of the global planner."""
        if self._plan.is_wanted or self._received.is_wanted:
            message = self._build.path(stamp, frame, poses)
            self._plan.publish(message)
            self._received.publish(message)
