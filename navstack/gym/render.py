"""Pictures of a level with the robot in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint
from navstack.gym.levels import Level
from navstack.sim import OCCUPIED


class LevelPicture:
    """Draws frames; the map and the obstacles of a level are drawn once."""

    def __init__(self, *, height: int = 480) -> None:
        self._height = height
        self._level: Level | None = None
        self._episode = -1
        self._figure: Any = None
        self._parts: tuple[Any, ...] = ()
        self._way: list[tuple[float, float]] = []

    def draw(
        self,
        level: Level,
        footprint: Footprint,
        pose: tuple[float, float, float],
        episode: int,
        beams: NDArray[np.float64],
        mounted: NDArray[np.float64],
        ranges: NDArray[np.float32],
        clip: float,
    ) -> NDArray[np.uint8]:
        """Return (height, width, 3): world, goal, the way so far, hits of the lidar and the robot."""
        if level is not self._level:
            self._begin(level)
        if episode != self._episode:
            self._episode, self._way = episode, []
        self._way.append(pose[:2])
        body, way, hits = self._parts
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = np.array([[c, -s], [s, c]])
        body.set_xy(footprint.vertices @ turn.T + pose[:2])
        way.set_data(*np.array(self._way).T)
        at = np.array(pose[:2]) + turn @ mounted[:2]
        cl, sl = np.cos(pose[2] + mounted[2]), np.sin(pose[2] + mounted[2])
        seen = ranges < clip
        points = at + (beams[seen] * ranges[seen, None]) @ np.array([[cl, -sl], [sl, cl]]).T
        hits.set_data(*points.T)
        canvas = self._figure.canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

    def _begin(self, level: Level) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import PatchCollection, PolyCollection
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle, Polygon

        self._level = level
        solids = level.world.solids_at(0.0)
        points = [np.array([level.start[:2], level.goal[:2]]), solids.discs[:, :2], solids.corners]
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
        axes.plot(*level.goal[:2], marker="*", color="tab:green", markersize=14)
        (way,) = axes.plot([], [], color="tab:blue", linewidth=1.5)
        (hits,) = axes.plot([], [], ".", color="tab:red", markersize=2)
        body = Polygon(np.zeros((3, 2)), facecolor="tab:orange", edgecolor="black", zorder=5)
        axes.add_patch(body)
        self._parts = body, way, hits

    def close(self) -> None:
        """Drop the figure."""
        self._figure = self._level = None
        self._parts = ()
