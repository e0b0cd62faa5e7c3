"""Pictures of levels with the robots in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint
from navstack.gym.levels import Level
from navstack.sim import OCCUPIED

COLORS: Final = ("orange", "blue", "green", "purple", "brown", "pink", "olive", "cyan")
"""Colors of the robots, their ways and goals; the ninth robot has the first again."""


class DrawnRobot(NamedTuple):
    """What a picture shows of a robot."""

    footprint: Footprint
    pose: tuple[float, float, float]
    """In the map (m, rad)."""
    hits: NDArray[np.float64] | None
    """(n, 2) where its lidar hits, in the robot's frame (m); None when its episode has ended."""

    @classmethod
    def of(
        cls,
        footprint: Footprint,
        pose: tuple[float, float, float],
        mounted: NDArray[np.float64],
        beams: NDArray[np.float64],
        shares: NDArray[np.float32],
        clip: float,
    ) -> DrawnRobot:
        """Return a robot with a lidar at `mounted` (x, y, yaw); `beams` (n, 2): unit vectors, `shares` (n,) of `clip`: ranges."""
        seen = shares < 1.0
        c, s = np.cos(mounted[2]), np.sin(mounted[2])
        hits = (beams[seen] * (shares[seen, None] * clip)) @ np.array([[c, s], [-s, c]]) + mounted[:2]
        return cls(footprint, pose, hits)


class LevelPicture:
    """Draws frames; the map, the obstacles and the goals are drawn once."""

    def __init__(self, *, height: int = 480) -> None:
        self._height = height
        self._level: Level | None = None
        self._figure: Any = None
        self._parts: list[tuple[Any, ...]] = []
        self._ways: list[list[tuple[float, float]]] = []

    def begin_episode(self) -> None:
        """Forget the ways."""
        for way in self._ways:
            way.clear()

    def draw(self, levels: Sequence[Level], robots: Sequence[DrawnRobot]) -> NDArray[np.uint8]:
        """Return (height, width, 3): the world, and of each robot its goal, the way so far, the hits of its lidar and its body.

        `levels`: one per robot, all in one world.
        """
        if levels[0] is not self._level:
            self._begin(levels)
        for robot, (body, line, points), way in zip(robots, self._parts, self._ways, strict=True):
            hits = np.empty((0, 2)) if robot.hits is None else robot.hits
            if robot.hits is not None:
                way.append(robot.pose[:2])
            c, s = np.cos(robot.pose[2]), np.sin(robot.pose[2])
            turn = np.array([[c, s], [-s, c]])
            body.set_xy(robot.footprint.vertices @ turn + robot.pose[:2])
            line.set_data(*np.array(way).reshape(-1, 2).T)
            points.set_data(*(hits @ turn + robot.pose[:2]).T)
        canvas = self._figure.canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

    def _begin(self, levels: Sequence[Level]) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import PatchCollection, PolyCollection
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle, Polygon

        level = self._level = levels[0]
        solids = level.world.solids_at(0.0)
        ends = np.array([pose[:2] for each in levels for pose in (each.start, each.goal)])
        points = [ends, solids.discs[:, :2], solids.corners]
        grid = level.world.map
        iy, ix = np.nonzero(grid.data >= OCCUPIED)
        resolution = grid.geometry.resolution
        c, s = np.cos(grid.origin_yaw), np.sin(grid.origin_yaw)
        square = resolution * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        corners = resolution * np.stack((ix, iy), axis=1)[:, None, :] + square
        cells = corners @ np.array([[c, s], [-s, c]]) + (grid.geometry.origin_x, grid.geometry.origin_y)
        points.append(cells.reshape(-1, 2))
        box = np.concatenate(points)
        low, high = box.min(axis=0) - 0.5, box.max(axis=0) + 0.5
        size = high - low
        dpi = 100.0
        figure = Figure((self._height / dpi * float(size[0] / size[1]), self._height / dpi), dpi)
        self._figure = figure
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_axis_off()
        axes.add_collection(PolyCollection(list(cells), facecolors="0.2", edgecolors="none"))
        axes.add_collection(
            PatchCollection([Circle((x, y), r) for x, y, r in solids.discs.tolist()], facecolors="0.35")
        )
        for k in range(len(solids.circles)):
            axes.add_patch(Polygon(solids.polygon(k), facecolor="0.35"))
        self._parts, self._ways = [], [[] for _ in levels]
        for k, each in enumerate(levels):
            color = f"tab:{COLORS[k % len(COLORS)]}"
            axes.plot(*each.goal[:2], marker="*", color=color if len(levels) > 1 else "tab:green", markersize=14)
            (way,) = axes.plot([], [], color=color if len(levels) > 1 else "tab:blue", linewidth=1.5)
            (hits,) = axes.plot([], [], ".", color="tab:red", markersize=2)
            body = Polygon(np.zeros((3, 2)), facecolor=color, edgecolor="black", zorder=5)
            axes.add_patch(body)
            self._parts.append((body, way, hits))

    def close(self) -> None:
        """Drop the figure."""
        self._figure = self._level = None
        self._parts = []
