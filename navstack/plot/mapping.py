"""The picture of a mapping: the map, the path, and the loops that were accepted and rejected."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from navstack.core import OccupancyGrid
from navstack.mapping import Mapper
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of_grid, disc_handle, occupancy_legend, shaped

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_mapping(
    mapper: Mapper,
    path: str | os.PathLike[str] | None = None,
    *,
    grid: OccupancyGrid | None = None,
    ax: Axes | None = None,
    title: str = "mapping",
    dpi: float = 130.0,
) -> Any:
    """Draw the graph of a mapping on its map (`grid`, by default made here) to a .png, .svg or .pdf.

    Draws into the axes `ax`, or a new figure. Raises OutputError, and LogError without a keyframe. Returns the file; without a
    path the axes.
    """
    canvas.check_target(path, ax)
    grid = mapper.map() if grid is None else grid
    poses = mapper.graph.poses
    accepted = [loop for loop in mapper.loops if loop.accepted]
    rejected = [loop for loop in mapper.loops if not loop.accepted]
    with canvas.style():
        picture = Picture(
            shaped(area_of_grid(grid.geometry), least=0.0),
            title=title,
            subtitle=f"{len(poses)} keyframes on {mapper.travelled:.0f} m   {len(accepted)} loops accepted, "
            f"{len(rejected)} rejected",
            ax=ax,
            managed=path is None,
        )
        axes = picture.axes
        drawing.draw_occupancy(axes, grid, area=picture.area)
        path_line = drawing.draw_line(axes, poses, colors.BLUE, width=0.9)
        entries: Entries = [(path_line, "path of the keyframes")]
        for loops, color, width, label in (
            (rejected, colors.FAINT, 0.4, "loop rejected"),
            (accepted, colors.VERMILLION, 0.9, "loop accepted"),
        ):
            line: Any = None
            for loop in loops:
                line = drawing.draw_line(axes, poses[[loop.place, loop.keyframe]], color, width=width)
            if line is not None:
                entries.append((line, label))
        axes.plot(*np.asarray(poses[0, :2]), "o", color=colors.BLUE, markersize=5.0)
        entries.append((disc_handle(colors.BLUE), "start"))
        picture.legend(entries + occupancy_legend(grid))
        return picture.finish(path, dpi)
