"""A picture of a costmap, with the bands of cost explained."""

from __future__ import annotations

import os
from pathlib import Path

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.plot import canvas, colors


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
    """Draws the costs to a .png, .svg or .pdf; the whole grid, or the part in `area` (m).

    `robot`: a pose in the costmap's frame, drawn with `footprint`. Raises OutputError. Returns the file.
    """
    out = Path(path)
    canvas.check_format(out)
    g = costmap.geometry
    shown = canvas.shaped(canvas.area_of_grid(g) if area is None else area, least=min(3.0, g.width_m))
    with canvas.style():
        picture = canvas.Picture(
            shown,
            title=title or f"costmap in {costmap.frame}",
            subtitle=f"{g.nx} x {g.ny} cells of {g.resolution:g} m",
        )
        canvas.draw_grid(picture.axes, costmap.data, colors.COSTS, g, area=picture.area)
        handles, labels = canvas.cost_legend(costmap.data[g.window_of(picture.area).slices])
        if robot is not None:
            if footprint is not None:
                (outline,) = picture.axes.fill(
                    *footprint.at(robot).T, facecolor=colors.SKY + "55", edgecolor=colors.BLUE, lw=1.4, zorder=5
                )
                handles.append(outline)
                labels.append("footprint")
            canvas.draw_heading(picture.axes, robot, colors.BLUE, picture.points_per_m)
        picture.legend(handles, labels, title="cost", alignment="left")
        return canvas.save(picture.figure, out, dpi)
