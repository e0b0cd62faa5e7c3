"""The images of a simulated camera on ROS topics, which are rendered only while somebody listens."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import Any, Final

from navstack.core import compilation_reported
from navstack.parameters import CameraParams
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder, Quaternion, multiply, quaternion_of_yaw
from navstack.sim import SimulatedRobot

OPTICAL: Final = Quaternion(-0.5, 0.5, -0.5, 0.5)
"""Rotation of an optical frame (z ahead, x to the right, y down) in the frame of its camera (x ahead, z up), by REP 103."""


class CameraTopics:
    """`rgb/image_raw`, `depth/image_raw` and a `camera_info` next to each, in the namespace of the camera."""

    def __init__(
        self,
        name: str,
        params: CameraParams,
        build: MessageBuilder,
        publisher: Callable[[str, str, int], Any],
        frame: Callable[[str], str],
    ) -> None:
        """`publisher` takes a topic, a type and the size of the queue; `frame` gives the name on the graph of a frame."""
        self._name, self._params, self._build, self._frame = name, params, build, frame
        root = params.topic.rstrip("/")
        self._images = {
            part: publisher(f"{root}/{part}/image_raw", "sensor_msgs/Image", 2) for part in ("rgb", "depth")
        }
        self._infos = {
            part: publisher(f"{root}/{part}/camera_info", "sensor_msgs/CameraInfo", 2) for part in ("rgb", "depth")
        }
        self._last = 0

    def optical_frame(self, part: str) -> str:
        """Return the frame of an image, `rgb` or `depth`, on the graph."""
        return self._frame(f"{self._params.frame}_{part}_optical_frame")

    def frames(self, stamp_ns: int, base: str, taken: Collection[str]) -> list[Any]:
        """Return the transforms of the camera's frames that are not `taken` by other sensors, each a child of the base.

        No frame is the child of another one of the camera: a lidar may have one of their names, at another place.
        """
        p, level = self._params, quaternion_of_yaw(self._params.yaw)
        optical = multiply(level, OPTICAL)
        turns = {self._frame(f"{p.frame}_{end}"): level for end in ("link", "rgb_frame", "depth_frame")}
        turns |= {self.optical_frame(part): optical for part in ("rgb", "depth")}
        return [
            self._build.transform(stamp_ns, base, child, (p.x, p.y, p.z), turn)
            for child, turn in turns.items()
            if child not in taken
        ]

    def publish(self, robot: SimulatedRobot, stamp_ns: int) -> None:
        """Publish what the robot sees now if the next picture is due and somebody listens."""
        number = math.floor(robot.time * self._params.frequency + 1e-6)
        if number <= self._last:
            return
        self._last = number
        p, build = self._params, self._build
        for part, publisher in self._infos.items():
            if publisher.get_num_connections():
                frame = self.optical_frame(part)
                publisher.publish(build.camera_info(stamp_ns, frame, p.width, p.height, p.focal_length, p.image_center))
        wanted = [part for part, publisher in self._images.items() if publisher.get_num_connections()]
        if not wanted:
            return
        with compilation_reported(_announce_compilation):
            picture = robot.camera(self._name)
        for part in wanted:
            encoding, pixels = "rgb8", picture.rgb
            if part == "depth":
                encoding = p.depth_encoding
                pixels = picture.depth if encoding == "32FC1" else picture.depth_mm
            self._images[part].publish(build.image(stamp_ns, self.optical_frame(part), encoding, pixels))


def _announce_compilation() -> None:
    ros.rospy().loginfo("compiling the kernels of the camera, once per machine; the simulation waits for some seconds")
