"""The picture of a coverage plan, and of the track that was driven."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import OccupancyGrid
from navstack.coverage import CoveragePlan, visits_of
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of_grid, occupancy_legend, shaped, swatch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ONCE_RGB: Final = (205, 232, 250)
AGAIN_RGB: Final = (120, 183, 226)
LEFT_RGB: Final = (213, 94, 0)
BEYOND_RGB: Final = (240, 228, 66)


def plot_coverage(
    plan: CoveragePlan,
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    track: NDArray[np.float64] | None = None,
    works: NDArray[np.bool_] | None = None,
    title: str = "coverage",
    subtitle: str = "",
    dpi: float = 130.0,
) -> Any:
    """Draw what the tool covers, once or more often, what it leaves, and what it cannot reach; with the passes and their order.

    With `track` (n, 2) (m) and `works` (n,), what was driven is drawn in place of the plan. Draws into the axes `ax`, or a new
    figure. Returns the file; without a path the axes. Raises OutputError.
    """
    canvas.check_target(path, ax)
    driven = track is not None and works is not None
    points, at_work = (track, works) if track is not None and works is not None else plan.line()
    visits = visits_of(plan.area, points, at_work)
    with canvas.style():
        picture = Picture(
            shaped(area_of_grid(grid.geometry)), title=title, subtitle=subtitle, ax=ax, managed=path is None
        )
        axes = picture.axes
        drawing.draw_occupancy(axes, grid, area=picture.area)
        entries = _draw_cells(axes, plan, visits, grid)
        if driven:
            entries += _draw_stretches(axes, points, at_work)
        else:
            entries += _draw_segments(axes, plan)
        drawing.draw_marks(axes, [drawing.Mark(plan.area.start, "S", colors.START)], picture.points_per_m)
        picture.legend(entries + occupancy_legend(grid))
        return picture.finish(path, dpi)


def known_cells(grid: OccupancyGrid, plan: CoveragePlan) -> NDArray[np.bool_]:
    """Return the cells of the plan's grid that the map knows; all, if its grid is another one."""
    factor = plan.area.grid.nx // grid.geometry.nx
    known = np.repeat(np.repeat(grid.data != -1, factor, axis=0), factor, axis=1)
    return known if known.shape == plan.area.grid.shape else np.ones(plan.area.grid.shape, np.bool_)


def _draw_cells(axes: Axes, plan: CoveragePlan, visits: NDArray[np.int32], grid: OccupancyGrid) -> Entries:
    area = plan.area
    rgba = np.zeros((*area.grid.shape, 4), np.uint8)
    beyond = area.wanted & ~area.reachable & known_cells(grid, plan)
    kinds = (
        (beyond, BEYOND_RGB, 150, "free, but out of reach"),
        (area.reachable & (visits == 0), LEFT_RGB, 255, "left"),
        (area.reachable & (visits == 1), ONCE_RGB, 255, "covered once"),
        (area.reachable & (visits > 1), AGAIN_RGB, 255, "covered again"),
    )
    entries: Entries = []
    for mask, rgb, alpha, label in kinds:
        if mask.any():
            rgba[mask] = (*rgb, alpha)
            entries.append((swatch(rgb), label))
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(rgba, origin="lower", extent=area.grid.extent, interpolation="nearest", zorder=1.0, aspect="equal")
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])
    return entries


def _draw_segments(axes: Axes, plan: CoveragePlan) -> Entries:
    styles = {
        "headland": (colors.GREEN, 1.0, "pass along the border"),
        "swath": (colors.BLUE, 1.0, "swath"),
        "turn": (colors.FAINT, 0.7, "turn, tool off"),
        "travel": (colors.PURPLE, 0.8, "way, tool off"),
    }
    entries: Entries = []
    for kind, (color, width, label) in styles.items():
        lines = [segment.points for segment in plan.segments if segment.kind == kind]
        if lines:
            entries.append((_lines(axes, lines, color, width), label))
    return entries


def _draw_stretches(axes: Axes, points: NDArray[np.float64], works: NDArray[np.bool_]) -> Entries:
    entries: Entries = []
    edges = np.flatnonzero(np.diff(works.astype(np.int8))) + 1
    bounds = [0, *edges.tolist(), len(points) - 1]
    stretches = [(bool(works[a]), points[a : b + 1]) for a, b in pairwise(bounds) if b > a]
    for state, color, label in (
        (False, colors.PURPLE, "driven, tool off"),
        (True, colors.BLUE, "driven, tool at work"),
    ):
        lines = [line for at_work, line in stretches if at_work is state]
        if lines:
            entries.append((_lines(axes, lines, color, 0.9), label))
    return entries


def _lines(axes: Axes, lines: Sequence[NDArray[np.float64]], color: str, width: float) -> Any:
    from matplotlib.collections import LineCollection

    collection = LineCollection(list(lines), colors=color, linewidths=width * canvas.line_scale(), zorder=4.0)
    axes.add_collection(collection)
    return collection
