"""The picture of a recorded costmap, with what the local planner worked with at that time."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from navstack.core import Pose2D, Transform2D
from navstack.core.errors import RecordError
from navstack.plot.costmap import plot_costmap
from navstack.record import Record


def plot_costmap_at(
    record: Record,
    name: str,
    time: float,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    dpi: float = 130.0,
) -> Any:
    """Draws the `global` or `local` costmap of a run at `time` (s), with robot, plan, goal, scans and chosen trajectory.

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
    """The robot's pose as the costmap has it: by odometry in the local frame, else the true pose."""
    if record.costmap_frame(name) == record.local_frame:
        return Pose2D(*map(float, record.odom_poses[record.index_at(time)]))
    return record.pose_at(time)
