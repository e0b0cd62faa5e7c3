"""The lidars of a log as those of the simulator, so that a simulated robot sees what the real one could see."""

from __future__ import annotations

import math
from typing import Any, Final

from navstack.core.errors import NavError
from navstack.logs import Log
from navstack.logs import messages as ros
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.replay.replay import LogReplay
from navstack.replay.setup import periods_of

_SAME: Final = 1e-3
"""A lidar whose values (m, rad, Hz) differ by less, relative to values above 1, is the same."""
_FIELDS: Final = ("x", "y", "yaw", "height", "beams", "fov", "range_min", "range_max", "frequency")


def with_logged_lidars(log: Log, replay: LogReplay, configuration: Configuration) -> Configuration:
    """Return the configuration with the lidars of the log in `navstack: sim:`.

    Unchanged if the parameters describe their simulated lidars, or if these are the same.
    """
    tree = configuration.tree.as_dict()
    sim: Any = (tree.get("navstack") or {}).get("sim") or {}
    known = configuration.navstack.sim
    if any(name in sim for name in ("lasers", *known.lasers)):
        return configuration
    found = _lidars(log, replay)
    same = len(found) == len(known.lasers) and all(
        any(_is_same(lidar, known.lidar(name)) for name in known.lasers) for lidar in found
    )
    if not found or same:
        return configuration
    names = [f"lidar_{number}" if len(found) > 1 else "laser" for number in range(1, len(found) + 1)]
    values = {"navstack": {"sim": {"lasers": names, **dict(zip(names, found, strict=True))}}}
    return load_configuration([tree, values], distro=configuration.navstack.ros_distro)


def _lidars(log: Log, replay: LogReplay) -> list[dict[str, Any]]:
    """Return the parameters of the lidars whose scans the replay used."""
    periods = periods_of(log, replay.topics)
    base = replay.configuration.local_costmap.params.robot_base_frame
    found: list[dict[str, Any]] = []
    for topic, sensor in replay.topics.sensors.items():
        if sensor.type != ros.SCAN:
            continue
        try:
            message = next(log.messages([topic])).data
            frame = ros.frame_of(message)
            mounting = replay.player.frames.mounting(frame)
            upside_down = mounting.tilt > 0.5 * math.pi
            scan = ros.scan_of(message, sensor.name, 0.0, height=mounting.height, upside_down=upside_down)
            pose = replay.robot.frames.lookup(base, frame)
        except (NavError, StopIteration):
            continue
        beams = len(scan.ranges)
        step = abs(scan.angle_increment)
        centre = pose.yaw + scan.angle_min + 0.5 * scan.angle_increment * (beams - 1)
        full = beams * step > 2.0 * math.pi - 0.5 * step
        values: dict[str, Any] = {
            "x": pose.x,
            "y": pose.y,
            "yaw": math.remainder(centre, 2.0 * math.pi),
            "height": max(scan.height, 0.0),
            "fov": 2.0 * math.pi if full else step * max(beams - 1, 1),
            "range_min": scan.range_min,
            "range_max": scan.range_max,
            "frequency": 1.0 / periods[topic] if periods.get(topic) else 10.0,
        }
        rounded = {key: value if key == "fov" else round(value, 6) for key, value in values.items()}
        found.append({"topic": sensor.name, "frame": frame, "beams": beams, **rounded})
    return found


def _is_same(lidar: dict[str, Any], known: Any) -> bool:
    pairs = [(float(lidar[name]), float(getattr(known, name))) for name in _FIELDS]
    return lidar["topic"] == known.topic.strip("/") and all(abs(a - b) <= _SAME * max(1.0, abs(b)) for a, b in pairs)
