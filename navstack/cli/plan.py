"""`navstack plan`: a path on a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from navstack.navigator import PlannedPath


def plan(
    map_: str = typer.Argument(..., metavar="MAP.yaml", help="A map_server YAML, or the name of a packaged map."),
    start: str = typer.Option(..., "--start", metavar="X,Y[,YAW]", help="Where the robot stands (m, rad)."),
    goal: str = typer.Option(..., "--goal", metavar="X,Y[,YAW]", help="Where it is to go (m, rad)."),
    params: list[str] = typer.Option(
        ["turtlebot"], "--params", metavar="NAME|DIR|FILE", help="A packaged set, a folder, or files in order (repeat)."
    ),
    planner: str | None = typer.Option(
        None, "--planner", metavar="NAME", help="Another global planner than the YAML's."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    allow_missing: bool = typer.Option(
        False, "--allow-missing", help="Leave out layers and plugins that are not here."
    ),
    out: Path | None = typer.Option(None, "--out", metavar="DIR", help="Write plan.png and plan.json there."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Plan a path on a map with the costmap and the planner of a robot's YAML."""
    import time

    from navstack.cli.arguments import map_of, parse_pose
    from navstack.cli.output import as_json_text, print_json, print_note, stdout
    from navstack.configuration import choose_global_planner, load_configuration
    from navstack.core.files import ensure_directory, write_text
    from navstack.navigator import plan_on_map

    start_pose, goal_pose = parse_pose(start, "--start"), parse_pose(goal, "--goal")
    path, grid = map_of(map_)
    configuration = load_configuration(params, overrides=set_, allow_missing=allow_missing)
    choice = choose_global_planner(configuration, planner) if planner else None
    folder = ensure_directory(out) if out is not None else None
    began = time.perf_counter()
    found = plan_on_map(configuration, grid, start_pose, goal_pose, planner=choice, keep_potential=folder is not None)
    took_ms = (time.perf_counter() - began) * 1e3
    document = _document(found, took_ms)
    if folder is not None:
        from navstack.plot import plot_plan

        picture, text = folder / "plan.png", folder / "plan.json"
        plot_plan(
            found.costmap.master,
            {found.planner: found.plan},
            picture,
            start=start_pose,
            goal=goal_pose,
            footprint=found.costmap.footprint,
            title=f"{path.stem}: {found.planner}",
        )
        document["files"] = {"picture": str(picture), "plan": str(text)}
        write_text(text, as_json_text(document))
    if json_:
        print_json(document)
        return
    from rich.table import Table

    table = Table("planner", "length", "cost", "cells expanded", "time", "poses", title=f"plan on {path.name}")
    table.add_row(
        found.planner,
        f"{document['length_m']:.2f} m",
        f"{document['cost']:.0f}",
        f"{document['cells_expanded']:,}",
        f"{took_ms:.1f} ms",
        str(len(found.plan.path)),
    )
    out_console = stdout()
    out_console.print(table)
    for note in found.plan.notes:
        print_note(note)
    if folder is None:
        print_note("--out DIR writes the path and a picture of it")
    for what, name in document.get("files", {}).items():
        out_console.print(f"{what}: {name}")


def _document(found: PlannedPath, took_ms: float) -> dict[str, Any]:
    plan = found.plan
    return {
        "planner": found.planner,
        "length_m": plan.path.length,
        "cost": plan.cost,
        "time_ms": took_ms,
        "cells_expanded": plan.cells_expanded,
        "goal_moved_m": plan.goal_moved_m,
        "notes": list(plan.notes),
        "poses": plan.path.poses.tolist(),
    }
