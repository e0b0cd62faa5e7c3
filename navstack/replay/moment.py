"""A moment of a log as a scenario: the map, the robot, what it saw, and its goal."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, LogError, NavError, OccupancyGrid, Pose2D, Transform2D
from navstack.logs import Log
from navstack.parameters import Configuration, load_configuration
from navstack.replay.log_replay import LogReplay, ReplayOptions
from navstack.replay.player import periods_of
from navstack.ros_messages import messages as ros
from navstack.scenario import Scenario
from navstack.sim import Shape

# --- the lidars of a log as those of the simulator, so that a simulated robot sees what the real one could see --------


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
        center = pose.yaw + scan.angle_min + 0.5 * scan.angle_increment * (beams - 1)
        full = beams * step > 2.0 * math.pi - 0.5 * step
        values: dict[str, Any] = {
            "x": pose.x,
            "y": pose.y,
            "yaw": math.remainder(center, 2.0 * math.pi),
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


LOOK_BACK_S: Final = 30.0
"""The costmaps see this much of the log before the moment (s)."""
CELL_M: Final = 0.05
"""Size of the cells that obstacles are made of (m)."""
OCCUPIED: Final = 65
"""Occupancy of a map from which a cell is an obstacle."""


def snapshot(
    log: Log,
    configuration: Configuration,
    static_map: OccupancyGrid,
    time: float,
    options: ReplayOptions | None = None,
) -> Scenario:
    """Return the scenario of a moment (s since the first message): start, goal, and obstacles that are not on the map.

    The obstacles are the lethal cells of both costmaps where the map is not occupied, joined to rectangles in the map frame;
    those under the robot are left out. The simulated lidars are those of the log, unless the parameters describe them. Raises
    LogError if the robot's pose is not known or the time is not in the log.
    """
    if not 0.0 <= time <= log.duration:
        raise LogError(f"{log.path} has {log.duration:.1f} s; {time:g} s is not in it", time=time)
    options = replace(options or ReplayOptions(), start=max(0.0, time - LOOK_BACK_S), end=time, scans=False)
    replay = LogReplay(log, configuration, static_map, options, record=False)
    replay.run()
    frame = configuration.global_costmap.params.global_frame
    start = replay.robot.pose_in(frame, configuration.local_costmap.params.robot_base_frame)
    if start is None:
        raise LogError(
            f'the robot\'s pose in "{frame}" is not known at {time:g} s; give --initial-pose x,y,yaw', time=time
        )
    move_base = replay.move_base
    points = [_lethal(replay, c.master, frame) for c in (move_base.global_costmap, move_base.local_costmap)]
    radius = configuration.local_costmap.true_footprint.circumscribed_radius
    cells = _new_cells(np.concatenate(points), static_map, start, radius)
    shapes = tuple(
        Shape(name=f"seen {number}", box=[width, height], pose=[x, y, 0.0])
        for number, (x, y, width, height) in enumerate(rectangles(cells), 1)
    )
    goals = tuple(goal.pose for goal in replay.goals[-1:] if goal.frame in ("", frame))
    return Scenario(
        map=static_map,
        configuration=with_logged_lidars(log, replay, configuration),
        start=start,
        goals=goals,
        shapes=shapes,
        name=f"{log.path.stem} at {time:g} s",
        names={"map": "", "params": [], "overrides": []},
    )


def _lethal(replay: LogReplay, costmap: Costmap, frame: str) -> NDArray[np.float64]:
    """Return the centers (n, 2) of the lethal cells in `frame`."""
    rows, columns = np.nonzero(costmap.data == LETHAL)
    g = costmap.geometry
    points = np.empty((len(rows), 2))
    points[:, 0] = g.origin_x + (columns + 0.5) * g.resolution
    points[:, 1] = g.origin_y + (rows + 0.5) * g.resolution
    try:
        return replay.robot.frames.lookup(frame, costmap.frame).apply_points(points)
    except NavError:
        return np.empty((0, 2))


def _new_cells(points: NDArray[np.float64], grid: OccupancyGrid, start: Pose2D, radius: float) -> set[tuple[int, int]]:
    """Return the cells of `CELL_M` with points where the map is not occupied, outside `radius` (m) around the robot."""
    g = grid.geometry
    away = np.hypot(points[:, 0] - start.x, points[:, 1] - start.y) > radius + CELL_M
    points = points[away]
    own = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw).inverse().apply_points(points) / g.resolution
    at = np.floor(own).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < grid.data.shape[1]) & (at[:, 1] < grid.data.shape[0])
    points, at = points[inside], at[inside]
    # a wall in the costmaps can be a cell next to that of the map: the pose is not exact
    occupied = np.pad(grid.data >= OCCUPIED, 1)
    ny, nx = grid.data.shape
    near = np.zeros((ny, nx), np.bool_)
    for dy in range(3):
        for dx in range(3):
            near |= occupied[dy : dy + ny, dx : dx + nx]
    points = points[~near[at[:, 1], at[:, 0]]]
    return {(int(x), int(y)) for x, y in np.floor(points / CELL_M)}


def rectangles(cells: set[tuple[int, int]]) -> list[tuple[float, float, float, float]]:
    """Return cells (x, y) of `CELL_M` as rectangles: center x, y and size (m); equal runs in rows above each other are joined."""
    rows: dict[int, list[int]] = {}
    for x, y in cells:
        rows.setdefault(y, []).append(x)
    found: list[list[int]] = []
    open_: dict[tuple[int, int], list[int]] = {}
    for y in sorted(rows):
        now: dict[tuple[int, int], list[int]] = {}
        for run in _runs(sorted(rows[y])):
            before = open_.get(run)
            if before is not None and before[3] == y:
                before[3] = y + 1
                now[run] = before
            else:
                now[run] = [run[0], y, run[1], y + 1]
                found.append(now[run])
        open_ = now
    scaled = ((0.5 * (x0 + x1), 0.5 * (y0 + y1), x1 - x0, y1 - y0) for x0, y0, x1, y1 in found)
    return [
        (round(x * CELL_M, 6), round(y * CELL_M, 6), round(w * CELL_M, 6), round(h * CELL_M, 6))
        for x, y, w, h in scaled
    ]


def _runs(columns: list[int]) -> list[tuple[int, int]]:
    """Return the runs (first, end) of consecutive numbers."""
    runs: list[tuple[int, int]] = []
    for x in columns:
        if runs and runs[-1][1] == x:
            runs[-1] = runs[-1][0], x + 1
        else:
            runs.append((x, x + 1))
    return runs
