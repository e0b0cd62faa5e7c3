"""The picture of global starts over a map: where a localizer found the pose, stayed uncertain, or was wrong."""

from __future__ import annotations

import os
from typing import Any, Final, NamedTuple

import numpy as np

from navstack.core import OccupancyGrid, Transform2D
from navstack.drives.starts import Starts
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.picture import Picture


class _Kind(NamedTuple):
    label: str
    color: str
    marker: str
    size: float


_KINDS: Final = {
    "found": _Kind("found", colors.BLUE, "o", 5.5),
    "uncertain": _Kind("stayed uncertain", colors.ORANGE, "D", 6.0),
    "wrong": _Kind("certain of a wrong pose", colors.VERMILLION, "X", 7.5),
}
"""Outcomes differ by colour and by marker."""
_HEADING: Final = 0.03
"""Length of the line that shows the heading at a start, as a share of the picture's width."""


def plot_starts(
    starts: Starts,
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str = "global starts",
    dpi: float = 130.0,
) -> Any:
    """Draws the true pose of each start with its outcome, and the path of the reference, over the map.

    Draws into the axes `ax`, or a new figure (.png, .svg, .pdf). Raises OutputError. Returns the file; without a path the axes.
    """
    from matplotlib.lines import Line2D

    canvas.check_target(path, ax)
    with canvas.style():
        driven = starts.path[np.isfinite(starts.path).all(axis=1)]
        area = areas.shaped(areas.area_of([driven[:, :2]]).grown(3.0))
        table = starts.table()
        subtitle = f"{len(starts.results)} starts, {len(starts.of('found'))} found"
        if len(table):
            scans, seconds, metres = np.median(table, axis=0).tolist()
            subtitle += f"   median {scans:.0f} scans, {seconds:.1f} s, {metres:.1f} m"
        picture = Picture(area, title=title, subtitle=subtitle, ax=ax, managed=path is None)
        g = grid.geometry
        corner = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ Transform2D(-g.origin_x, -g.origin_y, 0.0)
        drawing.draw_grid(picture.axes, grid.data, colors.OCCUPANCY, g, area=picture.area, pose=corner)
        handles, labels = legend.occupancy_legend()
        drawing.draw_line(picture.axes, driven, colors.BLACK, width=0.8, zorder=3.5, linestyle=(0, (4, 2)))
        handles.insert(0, Line2D([], [], color=colors.BLACK, lw=0.8, linestyle=(0, (4, 2))))
        labels.insert(0, "reference")
        length = _HEADING * (picture.area.max_x - picture.area.min_x)
        for outcome, kind in reversed(_KINDS.items()):
            rows = np.array([result.pose for result in starts.of(outcome)]).reshape(-1, 3)
            if not len(rows):
                continue
            ends = rows[:, :2] + length * np.column_stack((np.cos(rows[:, 2]), np.sin(rows[:, 2])))
            for row, end in zip(rows, ends, strict=True):
                picture.axes.plot([row[0], end[0]], [row[1], end[1]], color=kind.color, lw=1.4, zorder=5.0)
            style: dict[str, Any] = {
                "ls": "",
                "marker": kind.marker,
                "color": kind.color,
                "ms": kind.size,
                "mec": "white",
            }
            picture.axes.plot(rows[:, 0], rows[:, 1], zorder=6.0, mew=0.6, **style)
            handles.insert(0, Line2D([], [], **style))
            labels.insert(0, kind.label)
        picture.legend(handles, labels)
        return picture.finish(path, dpi)
