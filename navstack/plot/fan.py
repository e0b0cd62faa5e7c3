"""The picture of a control cycle: the fan of trajectories over the local costmap, legal and rejected."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.fan_shapes import Shapes, draw_arrow_head, trajectory_shapes
from navstack.plot.picture import Picture
from navstack.plot.scale_bar import CostScale, draw_scale_bar

# critics differ by dashes as well as by colour
_REJECTED: Final = (
    (colors.VERMILLION, (0, (4.0, 1.6)), "X"),
    (colors.PURPLE, (0, (1.0, 1.3)), "v"),
    (colors.SKY, (0, (6.0, 1.4, 1.2, 1.4)), "s"),
    (colors.GREEN, (0, (2.0, 2.4)), "D"),
    (colors.FAINT, (0, (1.0, 3.0)), "P"),
)
_RADIUS_WITHOUT_FOOTPRINT_M: Final = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Fan:
    """The K trajectories of a control cycle, of at most T points each, in the frame of the costmap."""

    poses: NDArray[np.float64]
    """(K, T, 3)"""
    counts: NDArray[np.int64]
    """(K,) number of valid points; trajectories without points are not drawn."""
    totals: NDArray[np.float64]
    """(K,) total cost of legal trajectories."""
    rejected_by: Sequence[str | None]
    """K names of critics; None for legal trajectories."""
    best: int
    """Index of the chosen trajectory; -1 for none."""
    collisions: Sequence[int] | None = None
    """(K,) index of the first point in collision, -1 for none."""

    @property
    def drawn(self) -> NDArray[np.int64]:
        """Rows with points."""
        return np.flatnonzero(self.counts > 0)

    @property
    def legal(self) -> NDArray[np.int64]:
        """Rows with points that no critic rejected."""
        return np.array([k for k in self.drawn.tolist() if self.rejected_by[k] is None], np.int64)

    def rejections(self) -> dict[str, list[int]]:
        """The rows that each critic rejected, the critic with most rejections first."""
        found: dict[str, list[int]] = {}
        for k in self.drawn.tolist():
            name = self.rejected_by[k]
            if name is not None:
                found.setdefault(name, []).append(k)
        return dict(sorted(found.items(), key=lambda item: (-len(item[1]), item[0])))


def plot_fan(
    fan: Fan,
    costmap: Costmap,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    robot: Pose2D,
    footprint: Footprint | None = None,
    plan: NDArray[np.float64] | None = None,
    title: str = "",
    subtitle: str = "",
    dpi: float = 130.0,
) -> Any:
    """Draws trajectories to a .png, .svg or .pdf: legal ones coloured by cost, the others by the critic that rejected them.

    `plan` (n, 2+) is the local plan, in the frame of the costmap. Draws into the axes `ax`, or a new figure. Raises
    OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    radius = footprint.circumscribed_radius if footprint is not None else _RADIUS_WITHOUT_FOOTPRINT_M
    scale = CostScale.of(fan.totals[fan.legal])
    with canvas.style():
        picture = Picture(
            _area(fan, robot, radius, costmap),
            title=title,
            subtitle=subtitle,
            width_in=10.0,
            ax=ax,
            managed=path is None,
        )
        axes = picture.axes
        drawing.draw_grid(axes, costmap.data, colors.COSTS, costmap.geometry, area=picture.area)
        shapes = trajectory_shapes(fan.poses, fan.counts, robot, radius)
        entries = _draw_rejected(axes, fan, shapes)
        entries += _draw_legal(axes, fan, shapes, scale)
        entries += _draw_surroundings(axes, robot, footprint, plan)
        entries = _draw_best(axes, fan, shapes, footprint) + entries
        drawing.draw_heading(axes, robot, colors.BLUE, picture.points_per_m)
        window = costmap.geometry.window_of(picture.area)
        bands, texts = legend.cost_legend(costmap.data[window.slices])
        box = picture.legend(
            [h for h, _ in entries] + bands,
            [text for _, text in entries] + texts,
            extra_in=0.55 if len(fan.legal) else 0.0,
        )
        if len(fan.legal) and ax is None:
            draw_scale_bar(picture, box, scale)
        return picture.finish(path, dpi)


Entries = list[tuple[Any, str]]


def _area(fan: Fan, robot: Pose2D, radius: float, costmap: Costmap) -> Bounds:
    points = [np.array([[robot.x - radius, robot.y - radius], [robot.x + radius, robot.y + radius]])]
    points += [fan.poses[k, : fan.counts[k], :2] for k in fan.drawn.tolist()]
    area = areas.area_of(points)
    margin = 0.08 * max(area.max_x - area.min_x, area.max_y - area.min_y) + 0.3 * radius
    area = areas.shaped(area.grown(margin), widest=1.9, tallest=1.1, least=2.0 * radius)
    whole = areas.area_of_grid(costmap.geometry)
    size = area.max_x - area.min_x, area.max_y - area.min_y
    if size[0] >= whole.max_x - whole.min_x or size[1] >= whole.max_y - whole.min_y:
        return whole
    return area


def _draw_rejected(axes: Any, fan: Fan, shapes: Shapes) -> Entries:
    """Draws rejected trajectories, up to the collision if they have one."""
    entries: Entries = []
    for number, (name, rows) in enumerate(fan.rejections().items()):
        color, dashes, marker = _REJECTED[min(number, len(_REJECTED) - 1)]
        for k in rows:
            stop = fan.collisions[k] if fan.collisions is not None else -1
            shape = shapes[k]
            is_path = len(shape) == fan.counts[k]  # not the arc of a rotation in place
            part = shape[: stop + 1] if is_path and stop > 0 else shape
            axes.plot(part[:, 0], part[:, 1], color=color, ls=dashes, lw=1.0, alpha=0.85, zorder=3.0)
            axes.plot(*part[-1, :2], marker, ms=4.0, color=color, mec="white", mew=0.4, zorder=3.1)
        entries.append((_line(color, dashes, marker), f"{len(rows)} rejected by {name}"))
    return entries


def _draw_legal(axes: Any, fan: Fan, shapes: Shapes, scale: CostScale) -> Entries:
    legal = fan.legal
    # in the order of descending cost, so that cheap trajectories are on top
    for k in sorted(legal.tolist(), key=lambda k: -fan.totals[k]):
        if k != fan.best:
            drawing.draw_line(axes, shapes[k], scale.color(float(fan.totals[k])), width=1.5, zorder=4.0)
    if not len(legal):
        return []
    return [(_line(scale.color(scale.low), "-", ""), f"{len(legal)} legal, by cost (below)")]


def _draw_surroundings(
    axes: Any, robot: Pose2D, footprint: Footprint | None, plan: NDArray[np.float64] | None
) -> Entries:
    entries: Entries = []
    if plan is not None and len(plan):
        line = drawing.draw_line(axes, plan, colors.PLAN, width=2.0, casing=True, ls=(0, (7, 2.5)), zorder=4.5)
        entries.append((line, "local plan"))
    if footprint is not None:
        entries.append((drawing.draw_footprint(axes, footprint, robot, zorder=4.8), "footprint, with padding"))
    return entries


def _draw_best(axes: Any, fan: Fan, shapes: Shapes, footprint: Footprint | None) -> Entries:
    """Draws the chosen trajectory, with the footprint at its end."""
    best = fan.best
    if best < 0 or fan.counts[best] == 0:
        return []
    line = drawing.draw_line(axes, shapes[best], colors.BLACK, width=3.4, casing=True, zorder=5.5)
    draw_arrow_head(axes, shapes[best])
    if footprint is not None:
        end = drawing.pose_of(fan.poses[best, fan.counts[best] - 1])
        axes.fill(*footprint.at(end).T, fill=False, edgecolor=colors.BLACK, lw=0.9, ls=(0, (2, 1.5)), zorder=5.4)
    return [(line, f"chosen (cost {fan.totals[best]:.4g})")]


def _line(color: Any, dashes: Any, marker: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, ls=dashes, lw=1.4, marker=marker, ms=5, mec="white", mew=0.4)
