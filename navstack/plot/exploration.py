"""The picture of an exploration: the map that was made, the way of the robot, its goals, and the frontiers that remain."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from navstack.core import OccupancyGrid
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of_grid, disc_handle, occupancy_legend, shaped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from navstack.mapping import Exploration


def plot_exploration(
    exploration: Exploration,
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    title: str = "exploration",
    subtitle: str = "",
    dpi: float = 130.0,
) -> Any:
    """Draw the map `grid` of an exploration with the true way of the robot, its goals and the frontiers that remain.

    Draws into the axes `ax`, or a new figure. Returns the file; without a path the axes. Raises OutputError.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        picture = Picture(
            shaped(area_of_grid(grid.geometry)), title=title, subtitle=subtitle, ax=ax, managed=path is None
        )
        axes = picture.axes
        drawing.draw_occupancy(axes, grid, area=picture.area)
        track = exploration.run.track()[:, 1:3]
        entries: Entries = [(drawing.draw_line(axes, track, colors.DRIVEN, width=1.2, casing=True), "driven")]
        goals: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
        for visit in exploration.visits:
            if visit.frontier.goal is not None:
                goals[visit.failed].append((visit.frontier.goal.x, visit.frontier.goal.y))
        for failed, color, label in (
            (False, colors.GREEN, "goal at a frontier"),
            (True, colors.VERMILLION, "goal that failed"),
        ):
            at = np.array(goals[failed]).reshape(-1, 2)
            if len(at):
                axes.plot(at[:, 0], at[:, 1], "o", ms=4.0, color=color, mec="white", mew=0.6, zorder=6.0)
                entries.append((disc_handle(color), label))
        remaining = [frontier.cells for frontier in exploration.frontiers]
        if remaining:
            cells = np.concatenate(remaining)
            axes.plot(cells[:, 0], cells[:, 1], "s", ms=1.6, color=colors.PURPLE, mec="none", zorder=5.0)
            entries.append((disc_handle(colors.PURPLE), "frontier that remains"))
        drawing.draw_marks(axes, [drawing.Mark(exploration.scenario.start, "S", colors.START)], picture.points_per_m)
        picture.legend(entries + occupancy_legend(grid))
        return picture.finish(path, dpi)
