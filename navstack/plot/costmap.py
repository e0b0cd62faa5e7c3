"""The picture of a costmap with its cost bands."""

from __future__ import annotations

import os
from pathlib import Path

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.plot import areas, canvas, colors, drawing, legend


def plot_costmap(
    costmap: Costmap,
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    robot: Pose2D | None = None,
    footprint: Footprint | None = None,
    area: Bounds | None = None,
    dpi: float = 130.0,
) -> Path:
    """Draws the costs to a .png, .svg or .pdf: the whole grid, or the part inside `area` (m).

    `robot` is a pose in the frame of the costmap, drawn with `footprint`. Raises OutputError. Returns the file.
    """
    out = Path(path)
    canvas.check_format(out)
    g = costmap.geometry
    shown = areas.shaped(areas.area_of_grid(g) if area is None else area, least=min(3.0, g.width_m))
    with canvas.style():
        picture = canvas.Picture(
            shown,
            title=title or f"costmap in {costmap.frame}",
            subtitle=f"{g.nx} x {g.ny} cells of {g.resolution:g} m",
        )
        drawing.draw_grid(picture.axes, costmap.data, colors.COSTS, g, area=picture.area)
        handles, labels = legend.cost_legend(costmap.data[g.window_of(picture.area).slices])
        if robot is not None:
            if footprint is not None:
                (polygon,) = picture.axes.fill(
                    *footprint.at(robot).T, facecolor=colors.SKY + "55", edgecolor=colors.BLUE, lw=1.4, zorder=5
                )
                handles.append(polygon)
                labels.append("footprint")
            drawing.draw_heading(picture.axes, robot, colors.BLUE, picture.points_per_m)
        picture.legend(handles, labels, title="cost", alignment="left")
        return canvas.save(picture.figure, out, dpi)
