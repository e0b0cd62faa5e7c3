"""The picture of a run: goals, plans, driven path, recoveries and collisions."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Event, Transform2D
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.commands import draw_changed_commands
from navstack.plot.estimates import draw_estimates
from navstack.plot.obstacles import draw_obstacles
from navstack.plot.picture import Picture
from navstack.plot.steering import wheel_lines
from navstack.record import Record

MOST_REPLANS = 40
"""Number of replans that a picture shows; more of them, evenly distributed, hide the map."""
_COMMON_NAMES = ("param", "params", "config", "cfg", "launch", "yaml", "navigation", "move_base", "map", "maps")


def plot_run(
    record: Record,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    costmap: str | None = "global",
    footprints: bool = True,
    replans: bool = True,
    title: str | None = None,
    area: Bounds | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draws a run to a .png, .svg or .pdf, cut to the area of the run or to `area` (m, global frame).

    `costmap` names the costmap whose last state is the background; None draws the map alone. Draws into the axes `ax`, or a
    new figure. Raises OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    shown = area or area_of_run(record)
    with canvas.style():
        picture = Picture(
            shown,
            title=title or headline(record),
            subtitle=circumstances(record),
            ax=ax,
            managed=path is None,
        )
        bands, texts = draw_ground(picture.axes, record, picture.area, costmap)
        entries: list[tuple[Any, str]] = []
        draw_plans(picture.axes, record, entries, replans=replans)
        if len(record.times):
            line = drawing.draw_line(picture.axes, record.poses, colors.DRIVEN, width=2.2, casing=True, zorder=5)
            entries.insert(0, (line, "driven path"))
        draw_estimates(picture.axes, record, entries)
        if footprints:
            _draw_footprints(picture.axes, record, entries)
        entries += draw_obstacles(picture.axes, record)
        entries += draw_ends(picture.axes, record, picture.points_per_m)
        draw_changed_commands(picture.axes, record, entries)
        _draw_incidents(picture.axes, record, entries)
        picture.legend([handle for handle, _ in entries] + bands, [label for _, label in entries] + texts)
        return picture.finish(path, dpi)


# --- words ------------------------------------------------------------------------------------------------------------


def headline(record: Record) -> str:
    """Returns the outcome of a run in one line."""
    results = record.results
    parts: list[str] = []
    if results:
        reached = sum(result.get("state") == "SUCCEEDED" for result in results)
        motions = any("step" in result for result in results)
        what, done = ("step", "completed") if motions else ("goal", "reached")
        if len(results) == 1:
            parts.append(f"{what} {done}" if reached else f"{what} not {done}")
        else:
            parts.append(f"{reached} of {len(results)} {what}s {done}")
    if len(record.times):
        parts.append(f"{record.path_length:.1f} m in {record.duration:.1f} s")
    recoveries = len(incidents(record))
    if recoveries:
        parts.append(f"{recoveries} recover{'ies' if recoveries != 1 else 'y'}")
    collisions = len(record.collision_times)
    if collisions:
        parts.append(f"{collisions} collision{'s' if collisions != 1 else ''}")
    return ", ".join(parts) or "a run without samples"


def circumstances(record: Record) -> str:
    """Returns map, parameters, planner and seed of a run in one line, as far as the scenario has them."""
    parts: list[str] = []
    for key in ("map", "params", "robot", "planner", "distro", "ros_distro", "seed"):
        value = record.scenario.get(key)
        values = value if isinstance(value, list) else [value]
        if value in (None, "", []) or not all(isinstance(v, (str, int, float)) for v in values):
            continue
        text = ", ".join(_telling_name(str(v)) for v in values[:3])
        parts.append(f"{key.removeprefix('ros_')} {text}{', ..' if len(values) > 3 else ''}")
    return "   ".join(parts)


def _telling_name(value: str) -> str:
    """The name of a file or folder; with its folder if the name is one that most robots use, such as `param`."""
    path = Path(value)
    name = path.name.removesuffix(".yaml")
    parent = path.parent.name
    return f"{parent}/{name}" if parent and name in _COMMON_NAMES else name


# --- parts shared with the animation -----------------------------------------------------------------------------------


def area_of_run(record: Record) -> Bounds:
    """Returns the area of start, goals, driven path, plans and collisions, with a margin for robot and arrows."""
    parts: list[NDArray[np.float64]] = [record.poses, record.goals, record.collisions]
    parts += [_global_poses(record, plan.poses, plan.frame, plan.t) for plan in record.plans]
    area = areas.area_of(parts)
    if not area.is_empty:
        extent = max(area.max_x - area.min_x, area.max_y - area.min_y)
        return areas.shaped(area.grown(max(1.0, 0.07 * extent) + record.footprint.circumscribed_radius))
    if record.map is not None:
        return areas.shaped(areas.area_of_grid(record.map.geometry))
    return Bounds(-3.0, -3.0, 3.0, 3.0)


def draw_map(axes: Any, record: Record, area: Bounds) -> None:
    """Draws the map, rotated about its corner by the yaw of its origin."""
    grid = record.map
    if grid is None:
        return
    g = grid.geometry
    rotation = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ Transform2D(-g.origin_x, -g.origin_y, 0.0)
    drawing.draw_grid(axes, grid.data, colors.OCCUPANCY, g, area=area, pose=rotation)


def draw_ground(axes: Any, record: Record, area: Bounds, costmap: str | None) -> tuple[list[Any], list[str]]:
    """Draws the map and the last state of a costmap over it. Returns handles and labels for the legend."""
    draw_map(axes, record, area)
    times = record.costmap_times(costmap) if costmap else np.empty(0)
    last = record.costmap_at(costmap, float(times[-1])) if costmap and len(times) else None
    if last is None:
        return ([], []) if record.map is None else legend.occupancy_legend()
    pose = record.to_global(last.frame, float(times[-1])) if len(record.times) else Transform2D()
    drawing.draw_grid(axes, last.data, colors.COSTS, last.geometry, area=area, pose=pose, zorder=0.5)
    window = last.geometry.window_of(area) if pose.is_identity() else last.geometry.window
    return legend.cost_legend(last.data[window.slices])


def draw_ends(axes: Any, record: Record, points_per_m: float) -> list[tuple[Any, str]]:
    """Draws the start and the goals, numbered in order. Returns the entries of the legend."""
    entries: list[tuple[Any, str]] = []
    marks: list[drawing.Mark] = []
    if len(record.times):
        marks.append(drawing.Mark(drawing.pose_of(record.poses[0]), "S", colors.START))
        entries.append((legend.disc(colors.START), "start"))
    goals = [
        drawing.Mark(drawing.pose_of(pose), str(i + 1), colors.GOAL, hollow=not _was_reached(record, i))
        for i, pose in enumerate(record.goals)
    ]
    drawing.draw_marks(axes, marks + goals, points_per_m)
    for hollow, name in ((False, ""), (True, ", not reached")):
        count = sum(goal.hollow is hollow for goal in goals)
        if count:
            entries.append((legend.disc(colors.GOAL, hollow=hollow), f"goal{'s' if count > 1 else ''}{name}"))
    return entries


def _was_reached(record: Record, goal: int) -> bool:
    """False only if the results contain a failure of this goal."""
    return goal >= len(record.results) or record.results[goal].get("state", "SUCCEEDED") == "SUCCEEDED"


def incidents(record: Record) -> list[Event]:
    """Returns the first event of every recovery."""
    first: list[Event] = []
    running = False
    for event in record.events_of("recovery"):
        if not running:
            first.append(event)
        running = event.data.get("status") == "running"
    return first


# --- parts of this picture --------------------------------------------------------------------------------------------


def draw_plans(axes: Any, record: Record, entries: list[tuple[Any, str]], *, replans: bool) -> None:
    """Draws the first plan to each goal, and the replans; adds their entries for the legend."""
    seen: set[int] = set()
    first: Any = None
    later: list[NDArray[np.float64]] = []
    for plan in record.plans:
        poses = _global_poses(record, plan.poses, plan.frame, plan.t)
        if plan.goal not in seen:
            seen.add(plan.goal)
            first = drawing.draw_line(
                axes, poses, colors.PLAN, width=1.4, linestyle=(0, (4, 1.8)), dash_capstyle="butt", zorder=5.2
            )
        elif replans:
            later.append(poses)
    if first is not None:
        entries.append((first, "first plan to each goal" if len(seen) > 1 else "first plan"))
    if later:
        entries.append((_draw_replans(axes, later), f"replans ({len(later)})"))


def _draw_replans(axes: Any, plans: Sequence[NDArray[np.float64]]) -> Any:
    """Draws at most MOST_REPLANS of the plans, the fainter the more there are. Returns a legible handle."""
    from matplotlib.lines import Line2D

    shown = [plans[i] for i in np.unique(np.linspace(0, len(plans) - 1, min(len(plans), MOST_REPLANS)).astype(int))]
    for poses in shown:
        drawing.draw_line(axes, poses, colors.PLAN, width=0.7, alpha=max(0.12, 0.5 / len(shown) ** 0.5), zorder=3.5)
    return Line2D([], [], color=colors.PLAN, lw=1.2, alpha=0.6)


def _draw_footprints(axes: Any, record: Record, entries: list[tuple[Any, str]]) -> None:
    poses = record.poses
    if not len(poses):
        return
    step = np.hypot(*np.diff(poses[:, :2], axis=0).T) if len(poses) > 1 else np.empty(0)
    along = np.concatenate(([0.0], np.cumsum(step)))
    spacing = max(2.6 * record.footprint.circumscribed_radius, along[-1] / 40.0, 1e-6)
    rows = set(np.searchsorted(along, np.arange(0.0, along[-1] + spacing, spacing)).clip(max=len(poses) - 1).tolist())
    handle: Any = None
    for row in sorted(rows | {len(poses) - 1}):
        handle = drawing.draw_footprint(axes, record.footprint, drawing.pose_of(poses[row]))
        if record.steered_base is not None:
            drawing.draw_line(axes, wheel_lines(record, row), colors.INK, width=2.0, zorder=4.5)
    entries.append((handle, "footprint"))


def _draw_incidents(axes: Any, record: Record, entries: list[tuple[Any, str]]) -> None:
    recoveries = incidents(record)
    if recoveries and len(record.times):
        at = _positions(record, [event.time for event in recoveries])
        drawing.draw_rings(axes, at, colors.RECOVERY)
        marks = drawing.ring_handle(colors.RECOVERY)
        entries.append((marks, f"recovery ({len(recoveries)})" if len(recoveries) > 1 else "recovery"))
    collisions = record.collisions
    if len(collisions):
        (marks,) = axes.plot(
            *collisions[:, :2].T, "X", ms=11, color=colors.COLLISION, mec="black", mew=1.1, ls="none", zorder=9.5
        )
        entries.append((marks, f"collision ({len(collisions)})" if len(collisions) > 1 else "collision"))


def _positions(record: Record, times: Sequence[float]) -> NDArray[np.float64]:
    return np.array([record.pose_at(t)[:2] for t in times], np.float64).reshape(-1, 2)


def _global_poses(record: Record, poses: NDArray[np.float64], frame: str, t: float) -> NDArray[np.float64]:
    if frame != record.local_frame or frame == record.global_frame or not len(record.times):
        return poses
    return record.to_global(frame, t).apply_poses(poses)
