"""The picture of a costmap with its cost bands."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.picture import Picture


def plot_costmap(
    costmap: Costmap,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str | None = None,
    robot: Pose2D | None = None,
    footprint: Footprint | None = None,
    plan: NDArray[np.float64] | None = None,
    trajectory: NDArray[np.float64] | None = None,
    goal: Pose2D | None = None,
    scan: NDArray[np.float64] | None = None,
    area: Bounds | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draws the costs to a .png, .svg or .pdf: the whole grid, or the part inside `area` (m).

    In the frame of the costmap: `robot` with its `footprint`, the `plan` (n, 2+), the chosen `trajectory` (n, 2+), the `goal`
    and the end points (n, 2+) of the last `scan`. Draws into the axes `ax`, or a new figure. Raises OutputError. Returns the
    file; without a path the axes.
    """
    canvas.check_target(path, ax)
    g = costmap.geometry
    shown = areas.shaped(areas.area_of_grid(g) if area is None else area, least=min(3.0, g.width_m))
    with canvas.style():
        picture = Picture(
            shown,
            title=title or f"costmap in {costmap.frame}",
            subtitle=f"{g.nx} x {g.ny} cells of {g.resolution:g} m",
            ax=ax,
            managed=path is None,
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
        for handle, label in _draw_inputs(picture, plan, trajectory, goal, scan):
            handles.append(handle)
            labels.append(label)
        picture.legend(handles, labels)
        return picture.finish(path, dpi)


def _draw_inputs(
    picture: Picture,
    plan: NDArray[np.float64] | None,
    trajectory: NDArray[np.float64] | None,
    goal: Pose2D | None,
    scan: NDArray[np.float64] | None,
) -> list[tuple[Any, str]]:
    """Draws what the local planner works with. Returns the entries of the legend."""
    axes = picture.axes
    entries: list[tuple[Any, str]] = []
    if plan is not None and len(plan):
        entries.append((drawing.draw_line(axes, plan, colors.PLAN, width=2.0, casing=True, zorder=4.5), "plan"))
    if trajectory is not None and len(trajectory):
        line = drawing.draw_line(axes, trajectory, colors.GREEN, width=3.0, casing=True, zorder=5.5)
        entries.append((line, "chosen trajectory"))
    if scan is not None and len(scan):
        (dots,) = axes.plot(scan[:, 0], scan[:, 1], ".", ms=4, color=colors.SCAN, ls="none", zorder=4.0)
        entries.append((dots, "scan"))
    if goal is not None:
        at = np.clip([goal.x, goal.y], *np.reshape(picture.area, (2, 2)))
        if (at == [goal.x, goal.y]).all():
            drawing.draw_marks(axes, [drawing.Mark(goal, "G", colors.GOAL)], picture.points_per_m)
            entries.append((legend.disc(colors.GOAL), "goal"))
        else:
            text = f"goal {np.hypot(*(at - [goal.x, goal.y])):.1f} m beyond"
            axes.plot(*at, "o", ms=9, mfc="white", mec=colors.GOAL, mew=2.0, zorder=8, clip_on=False)
            entries.append((legend.disc(colors.GOAL, hollow=True), text))
    return entries
