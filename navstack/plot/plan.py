"""The picture of one or several plans over a costmap, or of why there is none."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import (
    Entries,
    Picture,
    area_of,
    area_of_grid,
    cost_legend,
    disc_handle,
    round_length,
    shaped,
    translucent_handle,
)
from navstack.plugins import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# --- why there is no plan ---------------------------------------------------------------------------------------------


def points_of(failure: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the places (n, 2) that the data of a planning error names."""
    near, furthest, free = (failure.get(name) for name in ("nearest_reachable", "furthest", "nearest_free"))
    found = [(spot["x"], spot["y"]) for spot in failure.get("narrow", [])]
    found += _blocking(failure)
    found += [tuple(place[:2]) for place in (near, furthest, free) if place is not None]
    return np.array(found, np.float64).reshape(-1, 2)


def draw_failure(axes: Axes, failure: Mapping[str, Any], footprint: Footprint | None) -> Entries:
    """Draw what the data of a planning error says; returns the entries of the legend."""
    entries: Entries = []
    for i, spot in enumerate(failure.get("narrow", [])):
        entries += _draw_gap(axes, spot, footprint)[: 2 if i == 0 else 0]
    blocking = np.array(_blocking(failure), np.float64).reshape(-1, 2)
    if len(blocking):
        entries.append((_draw_points(axes, blocking, "X", colors.VERMILLION), "what blocks the way"))
    if failure.get("furthest") is not None and footprint is not None:
        outline = drawing.draw_footprint(axes, footprint, Pose2D(*failure["furthest"]), zorder=5.2)
        outline.set(edgecolor=colors.ORANGE, facecolor="none", lw=1.8)
        entries.append((outline, "it cannot go on from here"))
    if failure.get("nearest_reachable") is not None:
        near = np.array([failure["nearest_reachable"]], np.float64)
        entries.append((_draw_points(axes, near, "s", colors.ORANGE), "nearest place reached"))
    if failure.get("nearest_free") is not None:
        free = np.array([failure["nearest_free"][:2]], np.float64)
        entries.append((_draw_points(axes, free, "s", colors.GREEN), "nearest free cell"))
    return entries


def _blocking(failure: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Return the obstacles named as stretches of a route, or the one under the footprint at the goal."""
    blocked = failure.get("blocked_by") or []
    if blocked and not isinstance(blocked[0], Mapping):
        return [(blocked[0], blocked[1])]
    return [(spot["x"], spot["y"]) for spot in blocked]


def _draw_gap(axes: Axes, spot: Mapping[str, float], footprint: Footprint | None) -> Entries:
    """Return a bar across a gap, and the footprint in it at the heading of the gap."""
    x, y, heading = spot["x"], spot["y"], spot["heading"]
    across = 0.5 * spot["width_m"] * np.array([-math.sin(heading), math.cos(heading)])
    bar = np.array([[x, y] - across, [x, y] + across])
    line = drawing.draw_line(axes, bar, colors.VERMILLION, width=2.6, casing=True, zorder=6)
    entries: Entries = [(line, "too narrow for the footprint")]
    if footprint is not None:
        outline = drawing.draw_footprint(axes, footprint, Pose2D(x, y, heading), zorder=5.2)
        outline.set(edgecolor=colors.VERMILLION, facecolor="none", lw=1.8)
        entries.append((outline, "footprint at its heading"))
    return entries


def _draw_points(axes: Axes, points: NDArray[np.float64], marker: str, color: str) -> Any:
    (marks,) = axes.plot(points[:, 0], points[:, 1], marker, ls="none", ms=8, color=color, mec="white", zorder=9)
    return marks


_WIDEST = 4.8
"""Line width of the first of several plans beyond that of the last (points): wider ones hide the map."""
_UNREACHED = 1e9
"""Potentials from here on mark cells that the planner did not reach."""


def plot_plan(
    costmap: Costmap,
    plans: Plan | Mapping[str, Plan],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    start: Pose2D,
    goal: Pose2D,
    footprint: Footprint | None = None,
    title: str | None = None,
    subtitle: str | None = None,
    potential: bool = True,
    texts: Mapping[str, str] | None = None,
    failure: Mapping[str, Any] | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw one plan, or several by name, to a .png, .svg or .pdf. All poses are in the frame of the costmap.

    Contours show the potential of the first plan that has one, unless `potential` is False. `texts` are the legend's texts
    of several plans, by name, in place of name, length and cost. `failure` is the `data` of a PlanningError: what it names is
    drawn, also without plans. Draws into the axes `ax`, or a new figure. Raises OutputError.
    Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    named = {"plan": plans} if isinstance(plans, Plan) else dict(plans)
    g = costmap.geometry
    with canvas.style():
        picture = Picture(
            _area(costmap, named, start, goal, points_of(failure or {})),
            title=title or _title(named),
            subtitle=_single_plan_text(named) if subtitle is None else subtitle,
            ax=ax,
            managed=path is None,
        )
        axes = picture.axes
        drawing.draw_grid(axes, costmap.data, colors.COSTS, g, area=picture.area)
        entries = _draw_plans(axes, named, texts or {}) + _draw_sweep(axes, named, footprint)
        if potential:
            entries += _draw_potential(axes, named, costmap, picture.area)
        entries += _draw_ends(picture, start, goal, footprint)
        entries += _draw_moved_goal(axes, named) + draw_failure(axes, failure or {}, footprint)
        picture.legend(entries + cost_legend(costmap.data[g.window_of(picture.area).slices]))
        return picture.finish(path, dpi)


def _area(
    costmap: Costmap, plans: Mapping[str, Plan], start: Pose2D, goal: Pose2D, points: NDArray[np.float64]
) -> Bounds:
    ends = np.array([start, goal])
    area = area_of([ends, points, *(plan.path.poses for plan in plans.values())])
    if area.is_empty:
        return area_of_grid(costmap.geometry)
    margin = max(1.0, 0.12 * float(np.hypot(*(ends[1, :2] - ends[0, :2]))))
    return shaped(area.grown(margin))


def _draw_plans(axes: Axes, plans: Mapping[str, Plan], texts: Mapping[str, str]) -> Entries:
    entries: Entries = []
    for i, (name, plan) in enumerate(plans.items()):
        line = drawing.draw_line(
            axes,
            plan.path.poses,
            colors.PLANS[i % len(colors.PLANS)],
            # the first plan is the widest: plans that coincide are stripes
            width=2.4 + min(1.6, _WIDEST / max(1, len(plans) - 1)) * (len(plans) - 1 - i),
            casing=i == 0,
            zorder=4 + 0.1 * i,
        )
        text = texts.get(name, f"{name}\n{plan.path.length:.2f} m, cost {_cost(plan)}")
        entries.append((line, name if len(plans) == 1 else text))
    return entries


def _draw_sweep(axes: Axes, plans: Mapping[str, Plan], footprint: Footprint | None) -> Entries:
    """Draw the footprint along the first plan for which it was checked, and where plans change their direction."""
    plan = next((p for p in plans.values() if p.for_footprint), None)
    if plan is None or footprint is None or len(plan.path) < 2:
        return []
    poses, signs = plan.path.poses, plan.path.directions
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    spacing = max(0.5 * footprint.inscribed_radius, along[-1] / 400.0)
    shown = np.unique(np.append(np.searchsorted(along, np.arange(0.0, along[-1], spacing)), len(poses) - 1))
    entries: Entries = []
    for sign, color, label in ((1, colors.START, "swept, forward"), (-1, colors.GOAL, "swept, backward")):
        outlines = [footprint.at(plan.path[int(i)]) for i in shown if (signs[i] < 0) == (sign < 0)]
        if outlines:
            from matplotlib.collections import PolyCollection

            axes.add_collection(
                PolyCollection(outlines, facecolors=color, edgecolors=color, alpha=0.12, linewidths=0.6, zorder=3)
            )
            entries.append((translucent_handle(color), label))
    return entries + _draw_changes(axes, [p for p in plans.values() if p.for_footprint])


def _draw_changes(axes: Axes, plans: Sequence[Plan]) -> Entries:
    """Mark the poses at which plans change between forward and backward."""
    found: list[NDArray[np.float64]] = []
    for plan in plans:
        signs = plan.path.directions
        found.append(plan.path.poses[np.flatnonzero(signs[1:] * signs[:-1] < 0) + 1])
    at = np.concatenate(found)
    if not len(at):
        return []
    (mark,) = axes.plot(at[:, 0], at[:, 1], "D", ms=6, color="black", mec="white", zorder=9)  # above start and goal
    return [(mark, "change of direction")]


def _draw_ends(picture: Picture, start: Pose2D, goal: Pose2D, footprint: Footprint | None) -> Entries:
    if footprint is not None:
        for pose in (start, goal):
            drawing.draw_footprint(picture.axes, footprint, pose)
    marks = [drawing.Mark(start, "S", colors.START), drawing.Mark(goal, "G", colors.GOAL)]
    drawing.draw_marks(picture.axes, marks, picture.points_per_m)
    return [(disc_handle(colors.START), "start"), (disc_handle(colors.GOAL), "goal")]


def _draw_moved_goal(axes: Axes, plans: Mapping[str, Plan]) -> Entries:
    """Mark the end of the first plan that does not end at the goal."""
    moved = next((plan for plan in plans.values() if plan.goal_moved_m > 0.0), None)
    if moved is None:
        return []
    (cross,) = axes.plot([moved.goal.x], [moved.goal.y], "P", ms=9, color=colors.GOAL, mec="white", zorder=9)
    return [(cross, f"end of the plan ({moved.goal_moved_m:.2f} m from the goal)")]


def _title(plans: Mapping[str, Plan]) -> str:
    return next(iter(plans)) if len(plans) == 1 else f"{len(plans)} plans"


def _single_plan_text(plans: Mapping[str, Plan]) -> str:
    """Length, cost and expansions of a single plan; empty for several plans, whose legend has the numbers."""
    if len(plans) != 1:
        return ""
    (plan,) = plans.values()
    what = "states" if plan.for_footprint else "cells"
    expanded = f"   {plan.cells_expanded:,} {what} expanded" if plan.cells_expanded else ""
    return f"{plan.path.length:.2f} m   cost {_cost(plan)}{expanded}"


def _cost(plan: Plan) -> str:
    """Return the cost without an exponent."""
    return f"{plan.cost:,.0f}" if plan.cost >= 1000.0 else f"{plan.cost:.4g}"


def _draw_potential(axes: Axes, plans: Mapping[str, Plan], costmap: Costmap, area: Bounds) -> Entries:
    """Draw lines of equal potential inside `area`; nothing if no plan has a potential that varies there."""
    from matplotlib.lines import Line2D

    potential = next((plan.potential for plan in plans.values() if plan.potential is not None), None)
    window = costmap.geometry.window_of(area)
    if potential is None or window.is_empty:
        return []
    # more than 600 points per side are finer than the picture
    every = max(1, max(potential[window.slices].shape) // 600)
    field = potential[window.slices][::every, ::every].astype(np.float64)
    reached = np.isfinite(field) & (field < _UNREACHED)
    if min(field.shape) < 2 or not reached.any() or np.ptp(field[reached]) <= 0.0:
        return []
    x, y = _sample_points(costmap, area, every)
    levels = _levels(field[reached])
    lines = axes.contour(
        x,
        y,
        np.ma.masked_array(field, ~reached),
        levels=levels,
        colors=colors.SKY,
        linewidths=0.7,
        alpha=0.6,
        zorder=2,
    )
    axes.clabel(lines, levels[::4], fontsize=6, fmt="%g", colors=colors.INK)
    return [(Line2D([], [], color=colors.SKY, lw=0.9), f"equal potential, in steps of {levels[1] - levels[0]:g}")]


def _levels(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most 40 multiples of a step of 1, 2 or 5 times a power of ten, between the smallest and the largest value."""
    low, high = float(values.min()), float(values.max())
    step = round_length((high - low) / 16.0)
    return np.asarray(low - low % step + step * np.arange(1, math.ceil((high - low) / step) + 1), np.float64)


def _sample_points(costmap: Costmap, area: Bounds, every: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x and y (m) of the centers of every `every`-th cell inside `area`."""
    g = costmap.geometry
    window = g.window_of(area)
    x = g.origin_x + (np.arange(window.x0, window.x1, every) + 0.5) * g.resolution
    y = g.origin_y + (np.arange(window.y0, window.y1, every) + 0.5) * g.resolution
    return x.astype(np.float64), y.astype(np.float64)
