"""The picture of a run: goals, plans, driven path, obstacles, recoveries and collisions."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Event, Pose2D, Transform2D
from navstack.plot import canvas, colors, drawing
from navstack.plot.commands import draw_changed_commands, wheel_lines
from navstack.plot.localization import draw_estimates
from navstack.plot.picture import (
    Entries,
    Picture,
    area_of,
    area_of_grid,
    cost_legend,
    disc_handle,
    occupancy_legend,
    shaped,
)
from navstack.record import Record, Stall, find_stalls

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# --- obstacles that are not on the map --------------------------------------------------------------------------------


def draw_obstacles(axes: Axes, record: Record, *, moving: bool = True) -> Entries:
    """Draw the obstacles that are not on the map; moving ones (if wanted) at their last place, with their paths dotted.

    Returns the entries of the legend.
    """
    still, movers = obstacle_patches(record, float(record.times[-1]) if len(record.times) else 0.0)
    if still or movers:
        movers = movers if moving else []
        for patch in still + movers:
            axes.add_patch(patch)
        for path in _paths(record) if moving else ():
            drawing.draw_line(axes, path, colors.MOVING, width=1.3, zorder=2.9, ls=":")
        entries: Entries = [(still[0], "obstacle, not on the map")] if still else []
        return entries + ([(movers[0], "moving obstacle (at the end), its path")] if movers else [])
    return _draw_discs(axes, record)


def _draw_discs(axes: Axes, record: Record) -> Entries:
    """Draw the discs of the scenario, for records without recorded obstacles."""
    from matplotlib.patches import Circle

    handle: Any = None
    for obstacle in record.scenario.get("obstacles") or ():
        try:
            x, y, r = (float(v) for v in obstacle[:3])
        except (TypeError, ValueError, KeyError):
            continue
        handle = axes.add_patch(
            Circle((x, y), r, facecolor=colors.OBSTACLE, edgecolor="white", hatch="/////", lw=1.0, zorder=3)
        )
    return [(handle, "obstacle, not on the map")] if handle is not None else []


def obstacle_patches(record: Record, t: float) -> tuple[list[Any], list[Any]]:
    """Return patches of the recorded discs and polygons at time `t` (s): fixed ones, and moving ones."""
    from matplotlib.patches import Circle, Polygon

    discs, polygons = record.solids_at(t, absent=True)
    moved = obstacles_moved(record)
    still: list[Any] = []
    moving: list[Any] = []
    for shape, moves in zip([*discs.tolist(), *polygons], moved, strict=True):
        style: dict[str, Any] = {"edgecolor": "white", "lw": 1.0, "zorder": 3, "facecolor": colors.OBSTACLE}
        style |= {"hatch": "....", "facecolor": colors.MOVING} if moves else {"hatch": "/////"}
        if isinstance(shape, list):
            x, y, r = shape
            made: Any = Circle((x, y), r, **style)
        else:
            made = Polygon(shape, **style)
        (moving if moves else still).append(made)
    return still, moving


def obstacles_moved(record: Record) -> list[bool]:
    """Return, for the recorded discs and then the polygons, whether they ever moved."""
    discs, corners = record.arrays.get("solid_discs"), record.arrays.get("solid_corners")
    if discs is None or corners is None:
        return []
    first = record.arrays["solid_first"].tolist()
    return [bool((discs[:, k] != discs[0, k]).any()) for k in range(discs.shape[1])] + [
        bool((corners[:, a:b] != corners[0, a:b]).any()) for a, b in itertools.pairwise(first)
    ]


def _paths(record: Record) -> list[NDArray[np.float64]]:
    """Return the path (n, 2) of the center of each obstacle that moved."""
    discs, corners = record.arrays["solid_discs"], record.arrays["solid_corners"]
    first = record.arrays["solid_first"].tolist()
    paths = [discs[:, k, :2] for k in range(discs.shape[1])]
    paths += [corners[:, a:b].mean(axis=1) for a, b in itertools.pairwise(first)]
    return [path.astype(np.float64) for path, moved in zip(paths, obstacles_moved(record), strict=True) if moved]


MOST_REPLANS = 40
"""Number of replans that a picture shows; more of them, evenly distributed, hide the map."""
_COMMON_NAMES = ("param", "params", "config", "cfg", "launch", "yaml", "navigation", "move_base", "map", "maps")


def plot_run(
    record: Record,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    costmap: str | None = "global",
    footprints: bool = True,
    replans: bool = True,
    title: str | None = None,
    area: Bounds | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw a run to a .png, .svg or .pdf, cut to the area of the run or to `area` (m, global frame).

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
        ground = draw_ground(picture.axes, record, picture.area, costmap)
        entries: Entries = []
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
        _draw_stalls(picture.axes, record, entries)
        _draw_stops(picture.axes, record, entries)
        _draw_incidents(picture.axes, record, entries)
        picture.legend(entries + ground)
        return picture.finish(path, dpi)


# --- words ------------------------------------------------------------------------------------------------------------


def headline(record: Record) -> str:
    """Return the outcome of a run in one line."""
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
        turned = math.degrees(float(np.abs(np.diff(np.unwrap(record.poses[:, 2]))).sum()))
        in_place = record.path_length < 0.05 and turned >= 1.0
        how = f"turned {turned:.0f} degrees" if in_place else f"{record.path_length:.1f} m"
        parts.append(f"{how} in {record.duration:.1f} s")
    recoveries = len(incidents(record))
    if recoveries:
        parts.append(f"{recoveries} recover{'ies' if recoveries != 1 else 'y'}")
    collisions = len(record.collision_times)
    if collisions:
        parts.append(f"{collisions} collision{'s' if collisions != 1 else ''}")
    return ", ".join(parts) or "a run without samples"


def circumstances(record: Record) -> str:
    """Return map, parameters, planner and seed of a run in one line, as far as the scenario has them."""
    parts: list[str] = []
    given = dict(record.scenario)
    if given.get("nav2_distro"):
        given["ros_distro"] = f"Nav2 {given['nav2_distro']}"
    for key in ("map", "params", "robot", "planner", "distro", "ros_distro", "seed"):
        value = given.get(key)
        values = value if isinstance(value, list) else [value]
        if value in (None, "", []) or not all(isinstance(v, (str, int, float)) for v in values):
            continue
        text = ", ".join(_telling_name(str(v)) for v in values[:3])
        parts.append(f"{key.removeprefix('ros_')} {text}{', ..' if len(values) > 3 else ''}")
    return "   ".join(parts)


def _telling_name(value: str) -> str:
    """Return the name of a file or folder; with its folder if the name is one that most robots use, such as `param`."""
    path = Path(value)
    name = path.name.removesuffix(".yaml")
    parent = path.parent.name
    return f"{parent}/{name}" if parent and name in _COMMON_NAMES else name


# --- parts shared with the animation -----------------------------------------------------------------------------------


def area_of_run(record: Record) -> Bounds:
    """Return the area of start, goals, driven path, plans and collisions, with a margin for robot and arrows."""
    parts: list[NDArray[np.float64]] = [record.poses, record.goals, record.collisions]
    parts += [_global_poses(record, plan.poses, plan.frame, plan.t) for plan in record.plans]
    area = area_of(parts)
    if not area.is_empty:
        extent = max(area.max_x - area.min_x, area.max_y - area.min_y)
        return shaped(area.grown(max(1.0, 0.07 * extent) + record.footprint.circumscribed_radius))
    if record.map is not None:
        return shaped(area_of_grid(record.map.geometry))
    return Bounds(-3.0, -3.0, 3.0, 3.0)


def draw_map(axes: Axes, record: Record, area: Bounds) -> None:
    """Draw the map of a run, if it has one."""
    if record.map is not None:
        drawing.draw_occupancy(axes, record.map, area=area)


def draw_ground(axes: Axes, record: Record, area: Bounds, costmap: str | None) -> Entries:
    """Draw the map and the last state of a costmap over it. Return the entries of the legend."""
    draw_map(axes, record, area)
    times = record.costmap_times(costmap) if costmap else np.empty(0)
    last = record.costmap_at(costmap, float(times[-1])) if costmap and len(times) else None
    if last is None:
        return [] if record.map is None else occupancy_legend(record.map)
    pose = record.to_global(last.frame, float(times[-1])) if len(record.times) else Transform2D()
    drawing.draw_grid(axes, last.data, colors.COSTS, last.geometry, area=area, pose=pose, zorder=0.5)
    window = last.geometry.window_of(area) if pose.is_identity() else last.geometry.window
    return cost_legend(last.data[window.slices])


def draw_ends(axes: Axes, record: Record, points_per_m: float) -> Entries:
    """Draw the start and the goals, numbered in order. Returns the entries of the legend."""
    entries: Entries = []
    marks: list[drawing.Mark] = []
    if len(record.times):
        marks.append(drawing.Mark(drawing.pose_of(record.poses[0]), "S", colors.START))
        entries.append((disc_handle(colors.START), "start"))
    goals = [
        drawing.Mark(drawing.pose_of(pose), str(i + 1), colors.GOAL, hollow=not _was_reached(record, i))
        for i, pose in enumerate(record.goals)
    ]
    drawing.draw_marks(axes, marks + goals, points_per_m)
    for hollow, name in ((False, ""), (True, ", not reached")):
        count = sum(goal.hollow is hollow for goal in goals)
        if count:
            entries.append((disc_handle(colors.GOAL, hollow=hollow), f"goal{'s' if count > 1 else ''}{name}"))
    return entries


def _was_reached(record: Record, goal: int) -> bool:
    """Return False only if the results contain a failure of this goal."""
    return goal >= len(record.results) or record.results[goal].get("state", "SUCCEEDED") == "SUCCEEDED"


def incidents(record: Record) -> list[Event]:
    """Return the first event of every recovery."""
    first: list[Event] = []
    running = False
    for event in record.events_of("recovery"):
        if not running:
            first.append(event)
        running = event.data.get("status") == "running"
    return first


# --- parts of this picture --------------------------------------------------------------------------------------------


def draw_plans(axes: Axes, record: Record, entries: Entries, *, replans: bool) -> None:
    """Draw the first plan to each goal, and the replans; adds their entries for the legend."""
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


def _draw_replans(axes: Axes, plans: Sequence[NDArray[np.float64]]) -> Any:
    """Draw at most MOST_REPLANS of the plans, the fainter the more there are. Returns a legible handle."""
    from matplotlib.lines import Line2D

    shown = [plans[i] for i in np.unique(np.linspace(0, len(plans) - 1, min(len(plans), MOST_REPLANS)).astype(int))]
    for poses in shown:
        drawing.draw_line(axes, poses, colors.PLAN, width=0.7, alpha=max(0.12, 0.5 / len(shown) ** 0.5), zorder=3.5)
    return Line2D([], [], color=colors.PLAN, lw=1.2, alpha=0.6)


def _draw_footprints(axes: Axes, record: Record, entries: Entries) -> None:
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


LONG_STALL_S = 6.0
"""Stalls from this long on are marked (s): a turn to the heading of a goal is shorter."""
SAME_PLACE_M = 0.5
MOST_LABELS = 6
"""Stalls with their seconds beside them, the longest ones."""
_TURNED_RAD = 1.0


def long_stalls(record: Record) -> list[Stall]:
    """Return where a robot with a goal stood or turned in place for LONG_STALL_S or more, with all seconds spent there."""
    if not len(record.times):
        return []
    busy = np.isin(record.states, ("PLANNING", "CONTROLLING", "CLEARING"))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], busy, [False])).astype(np.int8)))
    stalls = [s for a, b in edges.reshape(-1, 2).tolist() for s in find_stalls(record.times[a:b], record.poses[a:b])]
    return _merged([stall for stall in stalls if stall.duration >= LONG_STALL_S])


def _merged(stalls: Sequence[Stall]) -> list[Stall]:
    """Return one stall for each place: marks side by side would hide each other."""
    places: list[Stall] = []
    for stall in stalls:
        near = next((p for p in places if np.hypot(p.x - stall.x, p.y - stall.y) < SAME_PLACE_M), None)
        if near is None:
            places.append(stall)
            continue
        seconds, turned = near.duration + stall.duration, near.turned_rad + stall.turned_rad
        places[places.index(near)] = Stall(near.begin, near.begin + seconds, near.x, near.y, turned)
    return places


def _draw_stalls(axes: Any, record: Record, entries: Entries) -> None:
    """Mark where the robot turned in place or stood, with the seconds."""
    from matplotlib.patheffects import withStroke

    stalls = long_stalls(record)
    labeled = sorted(stalls, key=lambda stall: -stall.duration)[:MOST_LABELS]
    for turning, marker, what in ((True, "o", "turned in place"), (False, "s", "stood")):
        shown = [stall for stall in stalls if (stall.turned_rad > _TURNED_RAD) is turning]
        if not shown:
            continue
        (handle,) = axes.plot(
            [stall.x for stall in shown],
            [stall.y for stall in shown],
            marker,
            ms=11,
            mfc="none",
            mec=colors.STALL,
            mew=2.0,
            ls="none",
            zorder=8.8,
        )
        seconds = sum(stall.duration for stall in shown)
        entries.append((handle, f"{what} ({seconds:.0f} s)"))
    for stall in labeled:
        axes.annotate(
            f"{stall.duration:.0f} s",
            (stall.x, stall.y),
            (9.0, 7.0),
            textcoords="offset points",
            fontsize=8,
            color=colors.STALL,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
            zorder=9.8,
        )


def _draw_stops(axes: Any, record: Record, entries: Entries) -> None:
    """Draw the footprint where a motion that stopped would have hit an obstacle."""
    outline: Any = None
    for event in record.events_of("status"):
        ahead = event.data.get("collision_ahead")
        if ahead is None or not len(record.times):
            continue
        pose = Transform2D(*record.pose_at(event.time)).apply(Pose2D(*ahead))
        outline = drawing.draw_footprint(axes, record.footprint, pose, zorder=6.0)
        outline.set(edgecolor=colors.VERMILLION, facecolor="none", lw=1.8)
    if outline is not None:
        entries.append((outline, "stopped: obstacle ahead"))


def _draw_incidents(axes: Axes, record: Record, entries: Entries) -> None:
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
