"""The picture of a control cycle: the fan of trajectories over the local costmap, legal and rejected."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, InputError, Pose2D
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of, area_of_grid, cost_legend, shaped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from navstack.explain import CommandReport

Shapes = dict[int, NDArray[np.float64]]
"""By row, the points (n, 3) that are drawn for a trajectory."""
# critics differ by dashes as well as by color
_REJECTED: Final = (
    (colors.VERMILLION, (0, (4.0, 1.6)), "X"),
    (colors.PURPLE, (0, (1.0, 1.3)), "v"),
    (colors.SKY, (0, (6.0, 1.4, 1.2, 1.4)), "s"),
    (colors.GREEN, (0, (2.0, 2.4)), "D"),
    (colors.FAINT, (0, (1.0, 3.0)), "P"),
)
_RADIUS_WITHOUT_FOOTPRINT_M: Final = 0.3


_LONGEST_SUBTITLE: Final = 110


def plot_command(
    report: CommandReport, path: str | os.PathLike[str] | None = None, *, ax: Axes | None = None, dpi: float = 130.0
) -> Any:
    """Draw the trajectories of a control cycle; `report` is the result of `explain_command(record, time)`.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError, and InputError for a local planner
    without trajectories. Returns the file; without a path the axes.
    """
    plan = report.plan
    if report.poses is None or report.counts is None or plan.totals is None:
        raise InputError(f"{report.planner} has no trajectories to draw; omit --out", planner=report.planner)
    rows = sorted(report.samples, key=lambda sample: sample.index)
    vx, vy, wz = (v + 0.0 if abs(v) >= 5e-4 else 0.0 for v in plan.command)
    requested = f" (requested {report.requested:.2f} s)" if report.time != report.requested else ""
    rejections: str = report.rejections
    return plot_fan(
        Fan(
            poses=report.poses,
            counts=report.counts,
            totals=plan.totals,
            rejected_by=[sample.rejected_by for sample in rows],
            best=plan.best,
            collisions=[int(sample.collision.get("step", -1)) for sample in rows],
        ),
        report.costmap,
        path,
        ax=ax,
        robot=report.robot,
        footprint=report.footprint,
        plan=plan.local_plan.poses if plan.local_plan is not None else None,
        title=f"{report.planner} at {report.time:.2f} s{requested}: vx {vx:.2f}{f', vy {vy:.2f}' if vy else ''}, wz {wz:.2f}",
        subtitle=rejections if len(rejections) <= _LONGEST_SUBTITLE else rejections[: _LONGEST_SUBTITLE - 1] + "…",
        dpi=dpi,
    )


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
        """Return the rows that each critic rejected, the critic with most rejections first."""
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
    ax: Axes | None = None,
    robot: Pose2D,
    footprint: Footprint | None = None,
    plan: NDArray[np.float64] | None = None,
    title: str = "",
    subtitle: str = "",
    dpi: float = 130.0,
) -> Any:
    """Draw trajectories to a .png, .svg or .pdf: legal ones colored by cost, the others by the critic that rejected them.

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
        entries += cost_legend(costmap.data[window.slices])
        box = picture.legend(entries, extra_in=0.55 if len(fan.legal) else 0.0)
        if len(fan.legal) and ax is None:
            draw_scale_bar(picture, box, scale)
        return picture.finish(path, dpi)


def _area(fan: Fan, robot: Pose2D, radius: float, costmap: Costmap) -> Bounds:
    points = [np.array([[robot.x - radius, robot.y - radius], [robot.x + radius, robot.y + radius]])]
    points += [fan.poses[k, : fan.counts[k], :2] for k in fan.drawn.tolist()]
    area = area_of(points)
    margin = 0.08 * max(area.max_x - area.min_x, area.max_y - area.min_y) + 0.3 * radius
    area = shaped(area.grown(margin), widest=1.9, tallest=1.1, least=2.0 * radius)
    whole = area_of_grid(costmap.geometry)
    size = area.max_x - area.min_x, area.max_y - area.min_y
    if size[0] >= whole.max_x - whole.min_x or size[1] >= whole.max_y - whole.min_y:
        return whole
    return area


def _draw_rejected(axes: Axes, fan: Fan, shapes: Shapes) -> Entries:
    """Draw rejected trajectories, up to the collision if they have one."""
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


def _draw_legal(axes: Axes, fan: Fan, shapes: Shapes, scale: CostScale) -> Entries:
    legal = fan.legal
    # in the order of descending cost, so that cheap trajectories are on top
    for k in sorted(legal.tolist(), key=lambda k: -fan.totals[k]):
        if k != fan.best:
            drawing.draw_line(axes, shapes[k], scale.color(float(fan.totals[k])), width=1.5, zorder=4.0)
    if not len(legal):
        return []
    return [(_line(scale.color(scale.low), "-", ""), f"{len(legal)} legal, by cost (below)")]


def _draw_surroundings(
    axes: Axes, robot: Pose2D, footprint: Footprint | None, plan: NDArray[np.float64] | None
) -> Entries:
    entries: Entries = []
    if plan is not None and len(plan):
        line = drawing.draw_line(axes, plan, colors.PLAN, width=2.0, casing=True, ls=(0, (7, 2.5)), zorder=4.5)
        entries.append((line, "local plan"))
    if footprint is not None:
        entries.append((drawing.draw_footprint(axes, footprint, robot, zorder=4.8), "footprint, with padding"))
    return entries


def _draw_best(axes: Axes, fan: Fan, shapes: Shapes, footprint: Footprint | None) -> Entries:
    """Draw the chosen trajectory, with the footprint at its end."""
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


# --- shapes of trajectories -------------------------------------------------------------------------------------------


_IN_PLACE_M: Final = 0.02
"""A trajectory with a smaller extent is a rotation in place."""


def trajectory_shapes(
    poses: NDArray[np.float64], counts: NDArray[np.int64], robot: Pose2D, radius: float
) -> dict[int, NDArray[np.float64]]:
    """Return, by row, the points (n, 3) to draw for each trajectory of `poses` (K, T, 3).

    Rotations in place become arcs around the robot, each with a larger radius than the one before.
    """
    shapes: Shapes = {}
    arcs = 0
    for k in np.flatnonzero(counts > 0).tolist():
        path = poses[k, : counts[k]]
        if np.ptp(path[:, 0]) + np.ptp(path[:, 1]) > _IN_PLACE_M:
            shapes[k] = path
            continue
        angle = float(np.unwrap(path[:, 2])[-1] - path[0, 2])
        around = path[0, 2] + np.linspace(0.0, angle, 40)
        reach = radius * (1.1 + 0.035 * arcs)
        arcs += 1
        shapes[k] = np.column_stack((robot.x + reach * np.cos(around), robot.y + reach * np.sin(around), around))
    return shapes


def draw_arrow_head(axes: Axes, path: NDArray[np.float64]) -> None:
    """Draw an arrow head at the end of a path (n, 2+)."""
    apart = np.flatnonzero(np.hypot(*(path[:, :2] - path[-1, :2]).T) > 1e-3)
    if not len(apart):
        return
    axes.annotate(
        "",
        xy=tuple(path[-1, :2]),
        xytext=tuple(path[apart[-1], :2]),
        arrowprops={
            "arrowstyle": "-|>,head_length=0.6,head_width=0.35",
            "color": colors.BLACK,
            "lw": 2.0,
            "shrinkB": 0,
        },
        zorder=5.6,
        annotation_clip=True,
    )


# --- colors of costs --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CostScale:
    """Maps costs to colors: dark blue for `low`, yellow from `high` on. Suitable for color-blind readers."""

    low: float
    high: float
    clipped: bool
    """True if some costs exceed `high`."""

    @classmethod
    def of(cls, totals: NDArray[np.float64]) -> CostScale:
        """Return the scale of these costs; outliers exceed its upper end."""
        if not len(totals):
            return cls(0.0, 0.0, False)
        low, median, top = float(totals.min()), float(np.median(totals)), float(totals.max())
        high = min(top, low + 4.0 * (median - low)) if median > low else top
        return cls(low, high, bool((totals > high).any()))

    def color(self, cost: float) -> Any:
        """Return the RGBA of a cost."""
        return _rgba((min(cost, self.high) - self.low) / (self.high - self.low) if self.high > self.low else 0.0)


def _rgba(share: float) -> Any:
    from matplotlib import colormaps

    return colormaps["cividis"](0.92 * float(share))


def draw_scale_bar(picture: Any, legend: Any, scale: CostScale) -> None:
    """Draw a bar with the colors and their costs below the legend."""
    picture.canvas.draw()
    figure = picture.figure
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    height = 0.13 / figure.get_figheight()
    bar = figure.add_axes(
        (box.x0 + 0.01, max(box.y0 - 3.2 * height, 0.02 + 1.2 * height), 1.7 / figure.get_figwidth(), height)
    )
    rgba = np.array([[_rgba(share) for share in np.linspace(0.0, 1.0, 128)]])
    bar.imshow(rgba[..., :3], aspect="auto", extent=(0.0, 1.0, 0.0, 1.0))
    bar.set_yticks([])
    low = f"{scale.low:.4g}"
    if math.isclose(scale.low, scale.high, rel_tol=1e-12):
        bar.set_xticks([0.0], [low])
    else:
        bar.set_xticks([0.0, 1.0], [low, f"{scale.high:.4g}{' or more' if scale.clipped else ''}"])
    bar.tick_params(length=0, labelsize=8)
    bar.set_title("cost of legal samples", fontsize=8.5, fontweight="normal", pad=3)
