"""A picture of one plan, or of several side by side, over the costmap they were made on."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.interfaces import Plan
from navstack.plot import canvas, colors

_UNREACHED = 1e9
_STYLES = ("-", (0, (5, 1.6)), (0, (2, 1.2)), (0, (6, 1.4, 1.2, 1.4)))


def plot_plan(
    costmap: Costmap,
    plans: Plan | Mapping[str, Plan],
    path: str | os.PathLike[str],
    *,
    start: Pose2D,
    goal: Pose2D,
    footprint: Footprint | None = None,
    title: str | None = None,
    subtitle: str | None = None,
    potential: bool = True,
    dpi: float = 130.0,
) -> Path:
    """Draws plans (one, or several by name) from `start` to `goal`, all in the costmap's frame, to a .png, .svg or .pdf.

    The first plan that carries a potential has it drawn as contours, unless `potential` is False. Raises OutputError.
    """
    out = Path(path)
    canvas.check_format(out)
    named = {"plan": plans} if isinstance(plans, Plan) else dict(plans)
    ends = np.array([start, goal])
    area = canvas.area_of([ends, *(plan.path.poses for plan in named.values())])
    area = canvas.area_of_grid(costmap.geometry) if area.is_empty else canvas.shaped(area.grown(_margin(ends)))
    g = costmap.geometry
    with canvas.style():
        picture = canvas.Picture(
            area, title=title or _title(named), subtitle=_figures(named) if subtitle is None else subtitle
        )
        axes = picture.axes
        canvas.draw_grid(axes, costmap.data, colors.COSTS, g, area=picture.area)
        handles: list[Any] = []
        labels: list[str] = []
        field = next((plan.potential for plan in named.values() if plan.potential is not None), None)
        if potential and field is not None:
            lines = _contours(axes, field, costmap, picture.area)
            if lines is not None:
                handles.append(lines)
                labels.append("potential")
        for i, (name, plan) in enumerate(named.items()):
            line = canvas.draw_line(
                axes,
                plan.path.poses,
                colors.PLANS[i % len(colors.PLANS)],
                width=2.4,
                casing=True,
                linestyle=_STYLES[(i // len(colors.PLANS) + i) % len(_STYLES)] if len(named) > 1 else "-",
                zorder=4 + 0.1 * i,
            )
            handles.insert(i, line)
            labels.insert(i, name if len(named) == 1 else f"{name}\n{plan.path.length:.2f} m, cost {_cost(plan)}")
        if footprint is not None:
            for pose in (start, goal):
                canvas.draw_footprint(axes, footprint, pose)
        marks = [canvas.Mark(start, "S", colors.START), canvas.Mark(goal, "G", colors.GOAL)]
        canvas.draw_marks(axes, marks, picture.points_per_m)
        handles += [canvas.disc(colors.START), canvas.disc(colors.GOAL)]
        labels += ["start", "goal"]
        moved = next((plan for plan in named.values() if plan.goal_moved_m > 0.0), None)
        if moved is not None:
            (cross,) = axes.plot([moved.goal.x], [moved.goal.y], "P", ms=9, color=colors.GOAL, mec="white", zorder=9)
            handles.append(cross)
            labels.append(f"goal used ({moved.goal_moved_m:.2f} m off)")
        bands, texts = canvas.cost_legend(costmap.data[g.window_of(picture.area).slices])
        picture.legend(handles + bands, labels + texts)
        return canvas.save(picture.figure, out, dpi)


def _title(plans: Mapping[str, Plan]) -> str:
    return next(iter(plans)) if len(plans) == 1 else f"{len(plans)} plans"


def _figures(plans: Mapping[str, Plan]) -> str:
    """What there is to say of a single plan; several say it in the legend."""
    if len(plans) != 1:
        return ""
    (plan,) = plans.values()
    expanded = f"   {plan.cells_expanded:,} cells expanded" if plan.cells_expanded else ""
    return f"{plan.path.length:.2f} m   cost {_cost(plan)}{expanded}"


def _cost(plan: Plan) -> str:
    """A plan's cost in full, not as a power of ten."""
    return f"{plan.cost:,.0f}" if plan.cost >= 1000.0 else f"{plan.cost:.4g}"


def _margin(ends: NDArray[np.float64]) -> float:
    return max(1.0, 0.12 * float(np.hypot(*(ends[1, :2] - ends[0, :2]))))


def _contours(axes: Any, potential: NDArray[np.float32], costmap: Costmap, area: Bounds) -> Any:
    """Lines of equal potential inside `area`; None where it was never reached."""
    from matplotlib.lines import Line2D

    g = costmap.geometry
    window = g.window_of(area)
    # a line every few pixels needs no more points than that
    every = max(1, max(potential[window.slices].shape) // 600)
    field = potential[window.slices][::every, ::every].astype(np.float64)
    reached = np.isfinite(field) & (field < _UNREACHED)
    if window.is_empty or min(field.shape) < 2 or np.ptp(field[reached] if reached.any() else np.zeros(1)) <= 0.0:
        return None
    x = g.origin_x + (np.arange(window.x0, window.x1, every) + 0.5) * g.resolution
    y = g.origin_y + (np.arange(window.y0, window.y1, every) + 0.5) * g.resolution
    levels = np.linspace(field[reached].min(), field[reached].max(), 26)[1:-1]
    axes.contour(
        x,
        y,
        np.ma.masked_array(field, ~reached),
        levels=levels,
        colors=colors.SKY,
        linewidths=0.7,
        alpha=0.6,
        zorder=2,
    )
    return Line2D([], [], color=colors.SKY, lw=0.9)
