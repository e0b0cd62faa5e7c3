"""Pictures of maps with their places, and of costmaps with what the local planner works with."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, OccupancyGrid, Pose2D, RecordError, Transform2D
from navstack.plot import canvas, colors, drawing
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
from navstack.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_map(
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    places: Mapping[str, Pose2D] | None = None,
    title: str = "map",
    dpi: float = 130.0,
) -> Any:
    """Draw a map to a .png, .svg or .pdf, with named `places` (m, rad, map frame) and lines of equal coordinates.

    Draws into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    g = grid.geometry
    x0, x1, y0, y1 = g.extent
    corners = drawing.map_pose(grid).apply_points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    named = dict(places or {})
    area = area_of([corners, *(np.array([[pose.x, pose.y]]) for pose in named.values())])
    with canvas.style():
        picture = Picture(
            shaped(area.grown(0.02 * max(g.width_m, g.height_m)), least=0.0),
            title=title,
            subtitle=f"{g.nx} x {g.ny} cells of {g.resolution:g} m   x {x0:g} to {x1:g} m   y {y0:g} to {y1:g} m",
            ax=ax,
            managed=path is None,
        )
        axes = picture.axes
        drawing.draw_occupancy(axes, grid, area=picture.area)
        axes.grid(color=colors.FAINT, lw=0.5, alpha=0.5)
        axes.set_axisbelow(False)
        for name, pose in named.items():
            _draw_place(axes, name, pose, picture.points_per_m)
        place: Entries = [(disc_handle(colors.BLUE), "place and its heading")] if named else []
        picture.legend(place + occupancy_legend(grid))
        return picture.finish(path, dpi)


def _draw_place(axes: Axes, name: str, pose: Pose2D, points_per_m: float) -> None:
    from matplotlib.patheffects import withStroke

    drawing.draw_heading(axes, pose, colors.BLUE, points_per_m)
    axes.annotate(
        name,
        (pose.x, pose.y),
        # not over the arrow
        xytext=(0, -7 if math.sin(pose.yaw) > 0.5 else 7),
        textcoords="offset points",
        ha="center",
        va="top" if math.sin(pose.yaw) > 0.5 else "bottom",
        fontsize=8,
        fontweight="bold",
        zorder=9,
        path_effects=[withStroke(linewidth=2.4, foreground="white")],
        annotation_clip=True,
    )


# --- a costmap --------------------------------------------------------------------------------------------------------


def plot_costmap(
    costmap: Costmap,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
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
    """Draw the costs to a .png, .svg or .pdf: the whole grid, or the part inside `area` (m).

    In the frame of the costmap: `robot` with its `footprint`, the `plan` (n, 2+), the chosen `trajectory` (n, 2+), the `goal`
    and the end points (n, 2+) of the last `scan`. Draws into the axes `ax`, or a new figure. Raises OutputError. Returns the
    file; without a path the axes.
    """
    canvas.check_target(path, ax)
    g = costmap.geometry
    shown = shaped(area_of_grid(g) if area is None else area, least=min(3.0, g.width_m))
    with canvas.style():
        picture = Picture(
            shown,
            title=title or f"costmap in {costmap.frame}",
            subtitle=f"{g.nx} x {g.ny} cells of {g.resolution:g} m",
            ax=ax,
            managed=path is None,
        )
        drawing.draw_grid(picture.axes, costmap.data, colors.COSTS, g, area=picture.area)
        entries = cost_legend(costmap.data[g.window_of(picture.area).slices])
        if robot is not None:
            if footprint is not None:
                (polygon,) = picture.axes.fill(
                    *footprint.at(robot).T, facecolor=colors.SKY + "55", edgecolor=colors.BLUE, lw=1.4, zorder=5
                )
                entries.append((polygon, "footprint"))
            drawing.draw_heading(picture.axes, robot, colors.BLUE, picture.points_per_m)
        picture.legend(entries + _draw_inputs(picture, plan, trajectory, goal, scan))
        return picture.finish(path, dpi)


def _draw_inputs(
    picture: Picture,
    plan: NDArray[np.float64] | None,
    trajectory: NDArray[np.float64] | None,
    goal: Pose2D | None,
    scan: NDArray[np.float64] | None,
) -> Entries:
    """Draw what the local planner works with. Returns the entries of the legend."""
    axes = picture.axes
    entries: Entries = []
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
            entries.append((disc_handle(colors.GOAL), "goal"))
        else:
            text = f"goal {np.hypot(*(at - [goal.x, goal.y])):.1f} m beyond"
            axes.plot(*at, "o", ms=9, mfc="white", mec=colors.GOAL, mew=2.0, zorder=8, clip_on=False)
            entries.append((disc_handle(colors.GOAL, hollow=True), text))
    return entries


# --- a recorded costmap -----------------------------------------------------------------------------------------------


def plot_costmap_at(
    record: Record,
    name: str,
    time: float,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw the `global` or `local` costmap of a run at `time` (s), with robot, plan, goal, scans and chosen trajectory.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError, and RecordError if the record has no
    such costmap until then. Returns the file; without a path the axes.
    """
    costmap = record.costmap_at(name, time)
    if costmap is None:
        where = record.path.parent if record.path is not None else "the record"
        raise RecordError(
            f"{where} contains no {name} costmap until {time:.3f} s: it was not recorded or not yet updated; give a later --time"
        )
    updates = record.costmap_times(name)
    updated = float(updates[updates <= time][-1])
    return plot_costmap(
        costmap,
        path,
        ax=ax,
        title=f"{name} costmap at {time:.2f} s (updated {updated:.2f} s), in {costmap.frame}",
        footprint=record.footprint,
        dpi=dpi,
        **inputs_at(record, name, time),
    )


def inputs_at(record: Record, name: str, time: float) -> dict[str, Any]:
    """Robot, plan, goal, chosen trajectory and last scans at `time` (s), in the frame of a costmap."""
    to_costmap = record.to_global(record.costmap_frame(name), time).inverse()
    found: dict[str, Any] = {"robot": _robot(record, name, time)}
    plan = record.plan_at(time)
    if plan is not None:
        found["plan"] = (to_costmap @ record.to_global(plan.frame, plan.t)).apply_poses(plan.poses)
    index = int(record.goal_indices[record.index_at(time)])
    if 0 <= index < len(record.goals):
        found["goal"] = to_costmap.apply(Pose2D(*map(float, record.goals[index])))
    local = record.local_plan_at(time)
    # too short to be seen on a map
    if name == "local" and local is not None and local.plan.trajectory is not None:
        local_to_map = record.to_global(record.costmap_frame("local"), time)
        found["trajectory"] = (to_costmap @ local_to_map).apply_poses(local.plan.trajectory)
    scans = record.scans_at(time)
    if scans:
        poses = [_robot(record, name, scan.t) for scan in scans]
        found["scan"] = np.concatenate(
            [Transform2D(*pose).apply_points(scan.base_points) for pose, scan in zip(poses, scans, strict=True)]
        )
    return found


def _robot(record: Record, name: str, time: float) -> Pose2D:
    """Return the robot's pose as the costmap has it: by odometry in the local frame, else the true pose."""
    if record.costmap_frame(name) == record.local_frame:
        return Pose2D(*map(float, record.odom_poses[record.index_at(time)]))
    return record.pose_at(time)
