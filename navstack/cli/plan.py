"""`navstack plan`: a path on a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

if TYPE_CHECKING:
    from navstack.bringup import PlannedPath
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.interfaces import GlobalPlanner
    from navstack.parameters.configuration import Configuration, PluginChoice


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
    compare: str | None = typer.Option(
        None,
        "--compare",
        metavar="NAME,NAME..",
        help="Several planners in one table and one picture; --json gives a list.",
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    allow_missing: bool = typer.Option(
        False, "--allow-missing", help="Leave out layers and plugins that are not here."
    ),
    out: Path | None = typer.Option(None, "--out", metavar="DIR", help="Write plan.png and plan.json there."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Plan a path on a map with the costmap and the planner of a robot's YAML."""
    from navstack.cli.arguments import map_of, note_off_the_map, parse_pose
    from navstack.cli.output import note_warnings, print_note
    from navstack.core.errors import InputError
    from navstack.core.files import ensure_directory
    from navstack.parameters.configuration import choose_global_planner, load_configuration

    start_pose, goal_pose = parse_pose(start, "--start"), parse_pose(goal, "--goal")
    path, grid = map_of(map_)
    if compare is not None and planner is not None:
        raise InputError(f'--compare "{compare}" and --planner "{planner}": give one of them', argument="--compare")
    names = [n.strip() for n in compare.split(",") if n.strip()] if compare is not None else []
    if compare is not None and not names:
        raise InputError(
            f'--compare "{compare}" names no planner; give names such as navfn,astar,theta_star', argument="--compare"
        )
    configuration = load_configuration(params, overrides=set_, allow_missing=allow_missing)
    chosen = [choose_global_planner(configuration, n) for n in dict.fromkeys(names)]
    if planner is not None:
        chosen = [choose_global_planner(configuration, planner)]
    note_warnings(configuration)
    note_off_the_map(grid, start_pose, [goal_pose])
    query = _Query(configuration, grid, start_pose, goal_pose, path)
    folder = ensure_directory(out) if out is not None else None
    if compare is not None:
        _compare(query, list({c.name: c for c in chosen}.values()), folder, json_)
    else:
        _plan(query, chosen[0] if chosen else None, folder, json_)
    if folder is None and not json_:
        print_note("--out DIR writes the path and a picture of it")


class _Query(NamedTuple):
    """What is asked."""

    configuration: Configuration
    grid: OccupancyGrid
    start: Pose2D
    goal: Pose2D
    map: Path


def _plan(query: _Query, choice: PluginChoice[GlobalPlanner] | None, folder: Path | None, json_: bool) -> None:
    """One planner."""
    from navstack.bringup import plan_on_map
    from navstack.cli.output import loading_kernels, print_json, print_note, stdout
    from navstack.core.files import write_json

    with loading_kernels(quiet=json_):
        found = plan_on_map(
            query.configuration, query.grid, query.start, query.goal, planner=choice, keep_potential=folder is not None
        )
    document = _document(found, _planning_ms(query, found, choice or query.configuration.global_planner))
    if folder is not None:
        document["files"] = _draw(query, [found], folder)
        write_json(folder / "plan.json", document)
    if json_:
        print_json(document)
        return
    _print_table([document], f"plan on {query.map.name}")
    for note in found.plan.notes:
        print_note(note)
    for what, name in document.get("files", {}).items():
        stdout().print(f"{what}: {name}")


def _compare(query: _Query, choices: list[PluginChoice[GlobalPlanner]], folder: Path | None, json_: bool) -> None:
    """Several planners on the same costmap; those that find no plan say why. Raises the first error when none does."""
    import json

    from navstack.bringup import plan_on_map
    from navstack.cli.output import loading_kernels, print_note, stdout
    from navstack.core.errors import PlanningError, jsonable
    from navstack.core.files import write_json

    found: list[PlannedPath] = []
    errors: list[PlanningError] = []
    documents: list[dict[str, Any]] = []
    for choice in choices:
        keep = folder is not None and not found
        try:
            with loading_kernels(quiet=json_ or bool(found)):
                one = plan_on_map(
                    query.configuration, query.grid, query.start, query.goal, planner=choice, keep_potential=keep
                )
        except PlanningError as error:
            errors.append(error)
            documents.append({"planner": choice.name, "error": error.as_dict()})
            continue
        documents.append(_document(one, _planning_ms(query, one, choice)))
        found.append(one)
    if not found:
        raise errors[0]
    files: dict[str, str] = {}
    if folder is not None:
        files = _draw(query, found, folder)
        write_json(folder / "plan.json", documents)
    if json_:
        typer.echo(json.dumps(jsonable(documents), allow_nan=False))
        return
    _print_table(documents, f"plans on {query.map.name}")
    for d in documents:
        for note in [d["error"]["message"]] if "error" in d else d["notes"]:
            print_note(f"{d['planner']}: {note}")
    for what, name in files.items():
        stdout().print(f"{what}: {name}")


def _planning_ms(query: _Query, found: PlannedPath, choice: PluginChoice[GlobalPlanner]) -> float:
    """Once more with kernels loaded, by a planner that remembers nothing: what planning alone takes."""
    import time

    fresh = choice.cls(choice.params)
    began = time.perf_counter()
    fresh.make_plan(found.costmap.master, query.start, query.goal, footprint=found.costmap.footprint)
    return (time.perf_counter() - began) * 1e3


def _draw(query: _Query, found: list[PlannedPath], folder: Path) -> dict[str, str]:
    """Writes plan.png; the names of the files of this command."""
    from navstack.plot import plot_plan

    picture = folder / "plan.png"
    plot_plan(
        found[0].costmap.master,
        {one.planner: one.plan for one in found},
        picture,
        start=query.start,
        goal=query.goal,
        footprint=found[0].costmap.footprint,
        title=f"{query.map.stem}: {', '.join(one.planner for one in found)}",
    )
    return {"picture": str(picture), "plan": str(folder / "plan.json")}


def _print_table(documents: list[dict[str, Any]], title: str) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from navstack.cli.output import stdout

    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("planner", no_wrap=True)
    for name in ("length", "clearance", "cost", "cells expanded", "time", "poses"):
        table.add_column(name, justify="right", no_wrap=True)
    for d in documents:
        if "error" in d:
            table.add_row(d["planner"], "no plan")
            continue
        table.add_row(
            d["planner"],
            f"{d['length_m']:.2f} m",
            "-" if d["clearance_m"] is None else f"{d['clearance_m']:.2f} m",
            f"{d['cost']:.0f}",
            f"{d['cells_expanded']:,}",
            f"{d['time_ms']:.1f} ms",
            str(len(d["poses"])),
        )
    stdout().print(table)


def _document(found: PlannedPath, took_ms: float) -> dict[str, Any]:
    import math

    plan = found.plan
    clearance = plan.clearance_m(found.costmap.master)
    return {
        "planner": found.planner,
        "length_m": plan.length_m,
        "clearance_m": clearance if math.isfinite(clearance) else None,
        "cost": plan.cost,
        "time_ms": took_ms,
        "cells_expanded": plan.cells_expanded,
        "goal_moved_m": plan.goal_moved_m,
        "notes": list(plan.notes),
        "poses": plan.path.poses.tolist(),
    }
