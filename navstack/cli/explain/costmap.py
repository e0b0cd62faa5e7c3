"""`navstack explain costmap`: draw a costmap of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.core import Pose2D
    from navstack.record import Record


def costmap(
    run: options.RunFolder,
    out: Annotated[Path, options.picture_file("costmap.png")],
    time: options.Time = None,
    costmap: options.CostmapName = "global",
    json_: options.Json = False,
) -> None:
    """Draw a costmap of a run at a given time, with its cost bands."""
    from navstack.cli.arguments import parse_costmap_name
    from navstack.cli.output import print_files, print_json
    from navstack.core.errors import RecordError
    from navstack.explain.replay import time_in
    from navstack.plot import plot_costmap
    from navstack.record import Record

    name = parse_costmap_name(costmap)
    record = Record.load(run)
    at = time_in(record, time)
    shown = record.costmap_at(name, at)
    if shown is None:
        raise RecordError(
            f"{run} contains no {name} costmap until {at:.3f} s: it was not recorded or not yet updated; give a later --time"
        )
    updates = record.costmap_times(name)
    updated = float(updates[updates <= at][-1])
    plot_costmap(
        shown,
        out,
        title=f"{name} costmap at {at:.2f} s (updated {updated:.2f} s), in {shown.frame}",
        footprint=record.footprint,
        **inputs_at(record, name, at),
    )
    files = {"picture": str(out)}
    if json_:
        print_json({"time": at, "updated_at": updated, "costmap": name, "files": files})
    else:
        print_files(files)


def _robot(record: Record, name: str, at: float) -> Pose2D:
    """The robot's pose as the costmap has it: by odometry in the local frame, else the true pose."""
    from navstack.core import Pose2D

    if record.costmap_frame(name) == record.local_frame:
        return Pose2D(*map(float, record.odom_poses[record.index_at(at)]))
    return record.pose_at(at)


def inputs_at(record: Record, name: str, at: float) -> dict[str, Any]:
    """Robot, plan, goal, chosen trajectory and last scans at a time, in the frame of the costmap."""
    import numpy as np

    from navstack.core import Pose2D, Transform2D

    to_costmap = record.to_global(record.costmap_frame(name), at).inverse()
    found: dict[str, Any] = {"robot": _robot(record, name, at)}
    plan = record.plan_at(at)
    if plan is not None:
        found["plan"] = (to_costmap @ record.to_global(plan.frame, plan.t)).apply_poses(plan.poses)
    index = int(record.goal_indices[record.index_at(at)])
    if 0 <= index < len(record.goals):
        found["goal"] = to_costmap.apply(Pose2D(*map(float, record.goals[index])))
    local = record.local_plan_at(at)
    if local is not None and local.plan.trajectory is not None:
        local_to_map = record.to_global(record.costmap_frame("local"), at)
        found["trajectory"] = (to_costmap @ local_to_map).apply_poses(local.plan.trajectory)
    scans = record.scans_at(at)
    if scans:
        poses = [_robot(record, name, scan.t) for scan in scans]
        found["scan"] = np.concatenate(
            [Transform2D(*pose).apply_points(scan.base_points) for pose, scan in zip(poses, scans, strict=True)]
        )
    return found
