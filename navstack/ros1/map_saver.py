"""map_saver: writes the map of the topic `map` to a pair of files."""

from __future__ import annotations

import dataclasses
import queue
from pathlib import Path
from typing import Any

import numpy as np

from navstack.core import OccupancyGrid
from navstack.core.errors import InputError
from navstack.logs import messages as msg
from navstack.map_io import save_map
from navstack.ros1 import ros


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


def save(target: str, occupied: int, free: int) -> list[Path]:
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
            grid = msg.map_of(arrived.get(timeout=0.1))
        except queue.Empty:
            continue
        written = list(save_map(as_saved(grid, occupied, free), target))
    ros.shut_down(lambda: None)
    return written
