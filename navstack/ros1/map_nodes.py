"""The nodes map_server (the map on latched topics and by service) and map_saver (the map of a topic as files)."""

from __future__ import annotations

import dataclasses
import math
import queue
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from navstack.core import InputError, NavError, OccupancyGrid, resolved
from navstack.map_io import load_map, save_map
from navstack.ros1 import parameters, ros
from navstack.ros1.node import MasterWatch, wait_for_clock
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg


class MapTopics:
    """`map` and `map_metadata`, latched, and the services `static_map` and `change_map`."""

    def __init__(self, grid: OccupancyGrid, build: MessageBuilder, *, below: str = "") -> None:
        """`below`: what comes before the names, `robot_1/`."""
        rospy = self._rospy = ros.rospy()
        self._build = build
        self._grid = grid
        self._message: Any = None
        self._map = rospy.Publisher(f"{below}map", ros.message("nav_msgs/OccupancyGrid"), queue_size=1, latch=True)
        self._data = rospy.Publisher(
            f"{below}map_metadata", ros.message("nav_msgs/MapMetaData"), queue_size=1, latch=True
        )
        self._get = rospy.Service(f"{below}static_map", ros.message("nav_msgs/srv/GetMap"), self._on_get)
        self._load = rospy.Service(f"{below}change_map", ros.message("nav_msgs/srv/LoadMap"), self._on_change)

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


def serve_map(grid: OccupancyGrid) -> None:
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


# --- map_saver: writes the map of the topic `map` to a pair of files --------------------------------------------------


def check_thresholds(occupied: int, free: int) -> None:
    """Raise InputError unless 1 <= occupied <= 100 and 0 <= free < occupied."""
    if not (1 <= occupied <= 100 and 0 <= free < occupied):
        raise InputError(
            f"--occ {occupied} and --free {free} are no thresholds: --occ is from 1 to 100, --free from 0 to below --occ"
        )


def as_saved(grid: OccupancyGrid, occupied: int, free: int) -> OccupancyGrid:
    """Return the map with 100 from `occupied` on, 0 up to `free`, and -1 (unknown) otherwise, as map_saver writes it."""
    data = np.full(grid.data.shape, -1, np.int8)
    data[grid.data >= occupied] = 100
    data[(grid.data >= 0) & (grid.data <= free)] = 0
    return dataclasses.replace(grid, data=data, raw=False)


def receive_map(target: str, occupied: int, free: int) -> list[Path]:
    """Wait for a map, write TARGET.yaml and TARGET.pgm, and return both; none if the node was shut down before.

    Raises OutputError, and LogError for a map that is none.
    """
    rospy = ros.rospy()
    arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
    rospy.Subscriber("map", ros.message("nav_msgs/OccupancyGrid"), arrived.put, queue_size=1)
    rospy.loginfo("waiting for a map on %s", rospy.resolve_name("map"))
    written: list[Path] = []
    while not ros.is_stopping() and not written:
        try:
            grid = msg.map_of(arrived.get(timeout=0.1), str(rospy.resolve_name("map")), rospy.logwarn)
        except queue.Empty:
            continue
        written = list(save_map(as_saved(grid, occupied, free), target))
    ros.shut_down(lambda: None)
    return written


# --- the old form of map_server's arguments: an image and a resolution, without a YAML file ---------------------------


def load_image(image: str, resolution: str) -> OccupancyGrid:
    """Return the map of an image with its origin at (0, 0) and `resolution` (m per cell), by map_server's defaults.

    `~negate`, `~occupied_thresh` (0.65) and `~free_thresh` (0.196) are read from the parameter server. Raises InputError and
    MapError.
    """
    try:
        cell = float(resolution)
    except ValueError:
        cell = math.nan
    if not (math.isfinite(cell) and cell > 0.0):
        raise InputError(f"the resolution {resolution} of {image} is not a positive number (m per cell)")
    if not Path(image).is_file():
        raise InputError(f"the image {image} does not exist", file=image)
    document = {
        "image": str(resolved(Path(image))),
        "resolution": cell,
        "origin": [0.0, 0.0, 0.0],
        "negate": int(parameters.flag("negate", False)),
        "occupied_thresh": parameters.number("occupied_thresh", 0.65),
        "free_thresh": parameters.number("free_thresh", 0.196),
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{Path(image).stem}.yaml"
        file.write_text(yaml.safe_dump(document), encoding="utf-8")
        return load_map(file)
