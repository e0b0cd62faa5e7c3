"""`navstack explain costmap`: draw a costmap of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.core import Transform2D
    from navstack.record import Record


def costmap(
    run: options.RunFolder,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Write a picture (.png, .svg or .pdf).")],
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
    to_map = record.to_global(shown.frame, at)
    updates = record.costmap_times(name)
    updated = float(updates[updates <= at][-1])
    plot_costmap(
        shown,
        out,
        title=f"{name} costmap at {at:.2f} s (updated {updated:.2f} s), in {shown.frame}",
        robot=to_map.inverse().apply(record.pose_at(at)),
        footprint=record.footprint,
        **_inputs(record, name, at, to_map.inverse()),
    )
    files = {"picture": str(out)}
    if json_:
        print_json({"time": at, "updated_at": updated, "costmap": name, "files": files})
    else:
        print_files(files)


def _inputs(record: Record, name: str, at: float, to_costmap: Transform2D) -> dict[str, Any]:
    """Plan, goal and chosen trajectory at a time, in the frame of the costmap."""
    from navstack.core import Pose2D

    found: dict[str, Any] = {}
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
    return found
