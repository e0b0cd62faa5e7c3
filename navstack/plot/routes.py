"""The picture of a route graph on its map, with a route and the findings of its check."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from navstack.core import OccupancyGrid
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of, disc_handle, occupancy_legend, shaped
from navstack.routes import PlannedRoute, RouteGraph

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_NUMBERS: Final = 60
"""Nodes of which each has its id in the picture."""


def plot_graph(
    graph: RouteGraph,
    path: str | os.PathLike[str] | None = None,
    *,
    grid: OccupancyGrid | None = None,
    route: PlannedRoute | None = None,
    wrong_edges: Collection[int] = (),
    wrong_nodes: Collection[int] = (),
    ax: Axes | None = None,
    title: str = "",
    dpi: float = 150.0,
) -> Any:
    """Draw a graph to a .png, .svg or .pdf: on a map, with a route, with edges and nodes (ids) that a check found wrong.

    One-way edges have an arrow. Draws into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path
    the axes.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    canvas.check_target(path, ax)
    xy = graph.xy.astype(np.float64)
    pairs = np.sort(np.stack([graph.starts, graph.ends], axis=1), axis=1)
    _, first, counts = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    both, one_way = first[counts > 1], first[counts == 1]
    bad = np.isin(graph.edge_ids, list(wrong_edges)) if wrong_edges else np.zeros(graph.edge_count, np.bool_)
    ends = [np.array([[p.x, p.y]]) for p in (route.start, route.goal) if p is not None] if route is not None else []
    area = area_of([xy, *ends])
    margin = 0.06 * max(area.max_x - area.min_x, area.max_y - area.min_y) + 0.5
    with canvas.style():
        picture = Picture(
            shaped(area.grown(margin), least=3.0),
            title=title or graph.name or "route graph",
            subtitle=f"{len(graph)} nodes, {graph.edge_count} edges, {len(one_way)} of them one-way",
            ax=ax,
            managed=path is None,
        )
        axes, entries = picture.axes, Entries()
        if grid is not None:
            drawing.draw_occupancy(axes, grid, area=picture.area)
        for edges, style, label in ((both, "-", "edge, both ways"), (one_way, (0, (4, 2)), "edge, one way")):
            good = edges[~bad[edges]]
            if len(good):
                lines = xy[np.stack([graph.starts[good], graph.ends[good]], axis=1)]
                axes.add_collection(
                    LineCollection(list(lines), colors=colors.SKY, linewidths=1.6, linestyles=[style], zorder=4)
                )
                entries.append((Line2D([], [], color=colors.SKY, lw=1.6, ls=style), label))
        _draw_arrows(axes, graph, one_way[~bad[one_way]])
        if bad.any():
            lines = xy[np.stack([graph.starts[bad], graph.ends[bad]], axis=1)]
            axes.add_collection(LineCollection(list(lines), colors=colors.VERMILLION, linewidths=2.4, zorder=5))
            entries.append((Line2D([], [], color=colors.VERMILLION, lw=2.4), f"edge with an error ({int(bad.sum())})"))
        size = 4.0 if len(graph) <= _MOST_NUMBERS else 2.2
        axes.plot(xy[:, 0], xy[:, 1], "o", ms=size, color=colors.BLUE, mec="white", mew=0.4, zorder=6, ls="none")
        wrong = np.isin(graph.node_ids, list(wrong_nodes)) if wrong_nodes else np.zeros(len(graph), np.bool_)
        if wrong.any():
            axes.plot(
                xy[wrong, 0],
                xy[wrong, 1],
                "X",
                ms=7.0,
                color=colors.VERMILLION,
                mec="white",
                mew=0.6,
                zorder=7,
                ls="none",
            )
            cross = Line2D([], [], marker="X", ms=7.0, color=colors.VERMILLION, mec="white", mew=0.6, ls="none")
            entries.append((cross, f"node with an error ({int(wrong.sum())})"))
        entries.append((disc_handle(colors.BLUE), "node" + (" and its id" if len(graph) <= _MOST_NUMBERS else "")))
        if len(graph) <= _MOST_NUMBERS:
            _number(axes, graph)
        if route is not None:
            entries += _draw_route(axes, route, picture.points_per_m)
        picture.legend(entries + (occupancy_legend(grid) if grid is not None else []))
        return picture.finish(path, dpi)


def _draw_arrows(axes: Axes, graph: RouteGraph, edges: Any) -> None:
    """Draw an arrow head in the middle of each edge."""
    xy = graph.xy.astype(np.float64)
    for edge in edges.tolist():
        a, b = xy[graph.starts[edge]], xy[graph.ends[edge]]
        if np.hypot(*(b - a)) > 0.0:
            tail, head = a + 0.52 * (b - a), a + 0.55 * (b - a)
            style = {"arrowstyle": "-|>", "color": colors.BLUE, "lw": 0.0, "mutation_scale": 9}
            axes.annotate("", xy=(head[0], head[1]), xytext=(tail[0], tail[1]), arrowprops=style, zorder=5)


def _number(axes: Axes, graph: RouteGraph) -> None:
    from matplotlib.patheffects import withStroke

    for node, (x, y) in zip(graph.node_ids.tolist(), graph.xy.tolist(), strict=True):
        axes.annotate(
            str(node),
            (x, y),
            xytext=(4, 4),
            textcoords="offset points",
            fontsize=6.5,
            color=colors.INK,
            zorder=8,
            path_effects=[withStroke(linewidth=1.8, foreground="white")],
            annotation_clip=True,
        )


def _draw_route(axes: Axes, route: PlannedRoute, points_per_m: float) -> Entries:
    line = drawing.draw_line(axes, route.path.poses, colors.PLAN, width=2.6, casing=True, zorder=5.5)
    marks = [
        drawing.Mark(pose, text, color)
        for pose, text, color in ((route.start, "S", colors.START), (route.goal, "G", colors.GOAL))
        if pose is not None
    ]
    drawing.draw_marks(axes, marks, points_per_m)
    return [(line, f"route: {len(route.route.edges)} edges, cost {route.route.cost:.4g}")]
