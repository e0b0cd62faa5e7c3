"""A moment of a log as a scenario: the map, the robot, what it saw, and its goal."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import LogError, NavError
from navstack.logs import Log
from navstack.parameters.configuration import Configuration
from navstack.replay.logged_lidars import with_logged_lidars
from navstack.replay.replay import LogReplay, ReplayOptions
from navstack.scenario import Scenario
from navstack.sim import Shape

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
    """Return the centres (n, 2) of the lethal cells in `frame`."""
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
    # a wall in the costmaps can be a cell beside that of the map: the pose is not exact
    occupied = np.pad(grid.data >= OCCUPIED, 1)
    ny, nx = grid.data.shape
    near = np.zeros((ny, nx), np.bool_)
    for dy in range(3):
        for dx in range(3):
            near |= occupied[dy : dy + ny, dx : dx + nx]
    points = points[~near[at[:, 1], at[:, 0]]]
    return {(int(x), int(y)) for x, y in np.floor(points / CELL_M)}


def rectangles(cells: set[tuple[int, int]]) -> list[tuple[float, float, float, float]]:
    """Return cells (x, y) of `CELL_M` as rectangles: centre x, y and size (m); equal runs in rows above each other are joined."""
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
