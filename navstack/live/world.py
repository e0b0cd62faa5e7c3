"""What does not change during a session, for a page that connects: map, robot, names, rights."""

from __future__ import annotations

from typing import Any

import numpy as np

from navstack import __version__
from navstack.core.errors import NavError
from navstack.live.frame import Frame
from navstack.live.messages import PROTOCOL
from navstack.live.stage import Stage
from navstack.map_io import map_names
from navstack.motion.keyboard import MOVE_KEYS, SPEED_KEYS, START_SPEED, START_TURN
from navstack.places import load_places


def world_frame(stage: Stage, *, server: str, read_only: bool) -> Frame:
    """Returns the first message to a page; `server` identifies this start of the server."""
    session = stage.main
    scenario, robot = session.scenario, session.run.robot
    grid = scenario.map
    frame = Frame({"type": "world"})
    limits = session.run.move_base.local_planner.limits
    frame.header |= {
        "protocol": PROTOCOL,
        "version": __version__,
        "server": server,
        "name": scenario.name or str(scenario.names.get("map", "map")),
        "map": {
            "nx": grid.geometry.nx,
            "ny": grid.geometry.ny,
            "resolution": grid.geometry.resolution,
            "origin": [grid.geometry.origin_x, grid.geometry.origin_y],
            "yaw": grid.origin_yaw,
            "blob": frame.blob(grid.data.astype(np.int8)),
        },
        "footprint": robot.footprint.vertices.tolist(),
        "padded": [s.run.move_base.local_costmap.footprint.vertices.tolist() for s in stage.sessions],
        "wheelbase": robot.params.wheelbase if robot.params.is_steered else None,
        "holonomic": robot.params.kinematics == "holonomic",
        "limits": {name: _finite(getattr(limits, name)) for name in limits._fields},
        "teleop": {"moves": MOVE_KEYS, "speeds": SPEED_KEYS, "speed": START_SPEED, "turn": START_TURN},
        "places": _places(session.origin.map_file),
        "labels": list(stage.options.labels),
        "read_only": read_only,
        "fixed": stage.options.fixed,
        "save_to": str(stage.options.save_to) if stage.options.save_to is not None else None,
    }
    return frame


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _places(map_file: Any) -> dict[str, list[float]]:
    if map_file is None:
        return {}
    name = map_file.stem
    source = name if name in map_names() else map_file.with_name(f"{name}.places.yaml")
    try:
        return {place: list(pose) for place, pose in load_places(source).places.items()}
    except (NavError, OSError):
        return {}
