"""Layers of an animation's frame: costmaps, and marks that never change."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from navstack.core import FREE, Bounds, Costmap, Transform2D
from navstack.plot import colors, drawing
from navstack.plot.picture import Picture
from navstack.record import Record


class Stamp:
    """Artists that never change, drawn once. Copying their pixels takes a tenth of the time of drawing them."""

    def __init__(self, surface: Any, axes: Any, artists: list[Any]) -> None:
        surface.get_renderer().clear()
        for artist in artists:
            axes.draw_artist(artist)
        rgba = np.asarray(surface.buffer_rgba())
        self._at = np.nonzero(rgba[:, :, 3])
        ink = rgba[self._at].astype(np.float32)
        opacity = ink[:, 3:] / np.float32(255.0)
        self._color = ink[:, :3] * opacity
        self._through = np.float32(1.0) - opacity

    def press(self, surface: Any) -> None:
        """Blends the pixels into the canvas."""
        pixels = np.asarray(surface.buffer_rgba())[:, :, :3]
        pixels[self._at] = np.round(self._color + self._through * pixels[self._at]).astype(np.uint8)


class CostmapLayer:
    """A costmap over the map. Free cells are transparent; the local costmap has a border."""

    def __init__(self, axes: Any, record: Record, name: str, area: Bounds) -> None:
        self.name = name
        self._area = area
        self._record = record
        self._axes = axes
        self._times = record.costmap_times(name)
        self._updates: Iterator[tuple[float, Costmap]] = iter(())
        self._next = 0
        self._image: Any = None
        self._border: Any = None
        self._drawn: Any = None

    def draw(self, t: float, picture: Picture) -> None:
        """Draws the costmap at time `t` (s); nothing before its first update."""
        wanted = int(np.searchsorted(self._times, t, side="right"))
        if wanted < self._next:
            self._image, self._next = None, 0
        if self._next == 0:
            self._updates = self._record.costmap_updates(self.name)
        costmap: Costmap | None = None
        while self._next < wanted:
            _, costmap = next(self._updates)
            self._next += 1
        if costmap is not None:
            self._show(costmap, t)
            self._drawn = None
        if self._drawn is not None:
            picture.canvas.restore_region(self._drawn)
        elif self._image is not None:
            self._axes.draw_artist(self._image)
            if self.name == "local":
                self._axes.draw_artist(self._border)
            else:
                # the global costmap is large and rarely changes; it is the first layer, so the canvas can be cached
                self._drawn = picture.canvas.copy_from_bbox(picture.figure.bbox)

    def _show(self, costmap: Costmap, t: float) -> None:
        pose = self._pose(costmap, t)
        x0, x1, y0, y1 = costmap.geometry.extent
        corners = pose.apply_points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
        rgba, extent = drawing.visible(costmap.data, colors.COSTS, costmap.geometry, self._area, pose, clear=FREE)
        if self._image is None:
            self._image = self._axes.imshow(rgba, origin="lower", extent=extent, interpolation="nearest", animated=True)
            (self._border,) = self._axes.fill(*corners.T, fill=False, edgecolor=colors.INK, lw=1.0, ls=(0, (3, 2)))
            self._border.set_animated(True)
            self._axes.set_xlim(self._area.min_x, self._area.max_x)
            self._axes.set_ylim(self._area.min_y, self._area.max_y)
        self._image.set_data(rgba)
        self._image.set_extent(extent)
        self._image.set_transform(drawing.transform_of(pose) + self._axes.transData)
        self._border.set_xy(corners)

    def _pose(self, costmap: Costmap, t: float) -> Transform2D:
        return self._record.to_global(costmap.frame, t)
