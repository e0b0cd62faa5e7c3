"""The picture of a map: cells, places with their names, grid lines and coordinates."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from navstack.core import OccupancyGrid, Pose2D, Transform2D
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.picture import Picture


def plot_map(
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    places: Mapping[str, Pose2D] | None = None,
    title: str = "map",
    dpi: float = 130.0,
) -> Any:
    """Draws a map to a .png, .svg or .pdf, with named `places` (m, rad, map frame) and lines of equal coordinates.

    Draws into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    g = grid.geometry
    corner = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ Transform2D(-g.origin_x, -g.origin_y, 0.0)
    x0, x1, y0, y1 = g.extent
    corners = corner.apply_points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    named = dict(places or {})
    area = areas.area_of([corners, *(np.array([[pose.x, pose.y]]) for pose in named.values())])
    with canvas.style():
        picture = Picture(
            areas.shaped(area.grown(0.02 * max(g.width_m, g.height_m)), least=0.0),
            title=title,
            subtitle=f"{g.nx} x {g.ny} cells of {g.resolution:g} m   x {x0:g} to {x1:g} m   y {y0:g} to {y1:g} m",
            ax=ax,
            managed=path is None,
        )
        axes = picture.axes
        drawing.draw_grid(axes, grid.data, colors.OCCUPANCY, g, area=picture.area, pose=corner)
        axes.grid(color=colors.FAINT, lw=0.5, alpha=0.5)
        axes.set_axisbelow(False)
        for name, pose in named.items():
            _draw_place(axes, name, pose, picture.points_per_m)
        handles, labels = legend.occupancy_legend()
        if named:
            handles, labels = [legend.disc(colors.BLUE), *handles], ["place and its heading", *labels]
        picture.legend(handles, labels)
        return picture.finish(path, dpi)


def _draw_place(axes: Any, name: str, pose: Pose2D, points_per_m: float) -> None:
    from matplotlib.patheffects import withStroke

    drawing.draw_heading(axes, pose, colors.BLUE, points_per_m)
    axes.annotate(
        name,
        (pose.x, pose.y),
        # not over the arrow
        xytext=(0, -7 if math.sin(pose.yaw) > 0.5 else 7),
        textcoords="offset points",
        ha="center",
        va="top" if math.sin(pose.yaw) > 0.5 else "bottom",
        fontsize=8,
        fontweight="bold",
        zorder=9,
        path_effects=[withStroke(linewidth=2.4, foreground="white")],
        annotation_clip=True,
    )
