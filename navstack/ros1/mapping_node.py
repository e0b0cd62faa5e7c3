"""Mapping as a ROS 1 node, with the topics, service, parameters and transform of gmapping's slam_gmapping."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from navstack.core import InputError, NavError, OccupancyGrid, Transform2D, clean_frame
from navstack.mapping import MapperParams, OnlineMapper
from navstack.ros1 import parameters, ros
from navstack.ros1.localization_node import ScanNode, WaitingScan
from navstack.ros_messages import messages as msg

_UNUSED: Final = (
    *(
        "inverted_laser",
        "sigma",
        "kernelSize",
        "lstep",
        "astep",
        "iterations",
        "lsigma",
        "ogain",
        "lskip",
        "minimumScore",
    ),
    *("srr", "srt", "str", "stt", "temporalUpdate", "resampleThreshold", "particles", "xmin", "ymin", "xmax", "ymax"),
    *("llsamplerange", "llsamplestep", "lasamplerange", "lasamplestep", "occ_thresh", "maxRange"),
)
"""Parameters of gmapping's particle filter and of its fixed map size, which this mapper does not have."""


class MappingNodeParams(NamedTuple):
    """`~` of slam_gmapping: what of it this mapper uses, with gmapping's names and defaults."""

    base_frame: str
    map_frame: str
    odom_frame: str
    map_update_interval: float
    """s."""
    transform_publish_period: float
    """s; 0: map -> odom is not published."""
    tf_delay: float
    """map -> odom is stamped this far ahead (s)."""
    throttle_scans: int
    """Every n-th scan is used."""
    max_urange: float
    """Longest beam that is drawn (m)."""
    mapper: MapperParams


def read_mapping_params() -> MappingNodeParams:
    """Return the parameters of the node's private namespace. Raises InputError for wrong ones; says which have no effect."""
    number, text = parameters.number, parameters.text
    defaults = MapperParams()
    period = number("transform_publish_period", 0.05, low=0.0)
    throttle = number("throttle_scans", 1.0, low=1.0)
    if throttle != int(throttle):
        raise InputError(f"~throttle_scans is {throttle:g}; it must be a whole number, such as 1")
    unused = [name for name in _UNUSED if ros.rospy().has_param(f"~{name}")]
    if unused:
        ros.rospy().logwarn(
            "these parameters of gmapping have no effect, as this mapper matches scans and closes loops without particles: %s",
            ", ".join(unused),
        )
    return MappingNodeParams(
        clean_frame(text("base_frame", "base_link")),
        clean_frame(text("map_frame", "map")),
        clean_frame(text("odom_frame", "odom")),
        number("map_update_interval", 5.0, low=0.0),
        period,
        number("tf_delay", period, low=0.0),
        int(throttle),
        number("maxUrange", 80.0, positive=True),
        MapperParams(
            resolution=number("delta", defaults.resolution, low=0.005, high=1.0),
            minimum_travel_distance=number("linearUpdate", defaults.minimum_travel_distance, low=0.02),
            minimum_travel_heading=number("angularUpdate", defaults.minimum_travel_heading, low=0.02),
        ),
    )


class MappingNode(ScanNode):
    """The node: `map` and `map_metadata`, latched, `~entropy`, the service `dynamic_map`, and map -> odom on /tf.

    `rospy.init_node` must have been called.
    """

    def __init__(self, params: MappingNodeParams) -> None:
        super().__init__(params.map_frame, params.odom_frame, params.base_frame, params.tf_delay)
        self._params = params
        self.mapper = OnlineMapper(params.mapper)
        self._heard = 0
        self._drawn = 0
        self._drawn_at = self._told_at = -math.inf
        self._message: Any = None
        rospy = self._rospy
        grid, data = ros.message("nav_msgs/OccupancyGrid"), ros.message("nav_msgs/MapMetaData")
        self._map = rospy.Publisher("map", grid, queue_size=1, latch=True)
        self._metadata = rospy.Publisher("map_metadata", data, queue_size=1, latch=True)
        self._entropy = rospy.Publisher("~entropy", ros.message("std_msgs/Float64"), queue_size=1, latch=True)
        self._service = rospy.Service(
            "dynamic_map", ros.message("nav_msgs/srv/GetMap"), self.inbox.caller(self._on_get)
        )
        self.subscribe()

    def set_pose(self, message: Any) -> None:
        """Use the first pose of the base; once there is a map, a pose is ignored."""
        if self.mapper.keyframes:
            self._rospy.logwarn("an initial pose is ignored: the map exists, and its scans tell where the robot is")
            return
        self.mapper.set_pose(msg.pose_of(message.pose.pose), np.eye(3), 0.0)

    def on_scan(self, message: Any) -> None:
        """Receive every `throttle_scans`-th scan."""
        self._heard += 1
        if (self._heard - 1) % self._params.throttle_scans == 0:
            super().on_scan(message)

    def process(self, now: float) -> None:
        """Map the scans whose odometry is known; publish the map and the transform where they are due."""
        self.use_waiting_scans()
        params, estimate = self._params, self.mapper.estimate
        if estimate is None:
            return
        if now < self._told_at:  # the clock jumped back
            self._told_at = self._drawn_at = -math.inf
        if params.transform_publish_period > 0.0 and now - self._told_at >= params.transform_publish_period:
            self._told_at = now
            self.tf.publish(self.clock.ns(now), estimate.map_to_odom)
        if self.mapper.keyframes != self._drawn and now - self._drawn_at >= params.map_update_interval:
            self._draw(now)

    def use_scan(self, waiting: WaitingScan, odometry: Transform2D, sensor: Transform2D) -> None:
        """Add a scan to the map."""
        self.mapper.update(odometry, waiting.scan, sensor)

    def _draw(self, now: float) -> None:
        self._drawn, self._drawn_at = self.mapper.keyframes, now
        try:
            grid: OccupancyGrid = self.mapper.map(max_range=self._params.max_urange, clear_without_return=False)
        except NavError as exc:
            self.report(exc)
            return
        self._message = self.build.map(self.clock.ns(now), replace(grid, frame=self.map_frame))
        self._map.publish(self._message)
        self._metadata.publish(self._message.info)
        entropy = self.mapper.pose_entropy
        if entropy is not None:
            self._entropy.publish(ros.message("std_msgs/Float64")(data=entropy))

    def _on_get(self, request: Any) -> Any:
        """Return the map; an empty one before the first scan, as gmapping does."""
        del request
        if self.mapper.keyframes != self._drawn:
            self._draw(self.clock.now())
        response = ros.message("nav_msgs/srv/GetMapResponse")
        return response() if self._message is None else response(map=self._message)
