"""`navstack plan`: plan a path on a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.bringup import PlannedPath
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.interfaces import GlobalPlanner
    from navstack.parameters.configuration import Configuration, PluginChoice


class PlanOptions(NamedTuple):
    """What to plan, and with which planners."""

    map_: options.Map
    start: Annotated[str, typer.Option("--start", metavar="X,Y[,YAW]", help="Start pose in the map frame (m, rad).")]
    goal: Annotated[str, typer.Option("--goal", metavar="X,Y[,YAW]", help="Goal pose in the map frame (m, rad).")]
    params: options.Params = ["turtlebot"]
    planner: Annotated[
        str | None,
        typer.Option("--planner", metavar="NAME", help="Global planner to use. [default: the one of the parameters]"),
    ] = None
    smoother: Annotated[
        str | None,
        typer.Option("--smoother", metavar="NAME", help="Smoother of the path. [default: the one of the parameters]"),
    ] = None
    footprint: Annotated[
        str | None,
        typer.Option(
            "--footprint",
            metavar="LENGTHxWIDTH|POINTS",
            help="Footprint (m): a box such as 1.2x0.7 around the centre, or points [[x,y],..]. [default: of the parameters]",
        ),
    ] = None
    compare: Annotated[
        str | None,
        typer.Option(
            "--compare",
            metavar="NAME,NAME..",
            help="Compare planners in one table and one picture; --json prints a list.",
        ),
    ] = None
    set_: options.Set = []
    allow_missing: options.AllowMissing = False


class _Query(NamedTuple):
    """A planning request on a map with a configuration."""

    configuration: Configuration
    grid: OccupancyGrid
    start: Pose2D
    goal: Pose2D
    map: Path


@options.with_options(chosen=PlanOptions)
def plan(
    chosen: PlanOptions,
    out: Annotated[Path | None, options.both_files("plan.png", "plan.json")] = None,
    json_: options.Json = False,
) -> None:
    """Plan a path on a map with the global costmap and planner of a parameter set.

    Exit codes: 0 a path was found, 1 no path was found between valid poses, 2 invalid input.
    """
    from navstack.cli.out_path import chosen_files
    from navstack.cli.output import print_note

    query, planners = _load(chosen)
    files = chosen_files(out, {"picture": "plan.png", "plan": "plan.json"}) if out is not None else {}
    if chosen.compare is not None:
        _compare(query, planners, files, json_)
    else:
        _plan(query, planners[0] if planners else None, files, json_)
    if out is None and not json_:
        print_note("--out DIR writes the path and a picture of it")


def _load(chosen: PlanOptions) -> tuple[_Query, list[PluginChoice[GlobalPlanner]]]:
    """The query, and the planners named on the command line. Raises InputError, MapError or ParameterError."""
    from dataclasses import replace

    from navstack.cli.arguments import map_of, note_off_the_map, parse_pose
    from navstack.cli.output import print_warnings
    from navstack.parameters.configuration import choose_global_planner, choose_smoother, load_configuration

    start, goal = parse_pose(chosen.start, "--start"), parse_pose(chosen.goal, "--goal")
    path, grid = map_of(chosen.map_)
    names = _planner_names(chosen.compare, chosen.planner)
    configuration = load_configuration(
        chosen.params, overrides=[*chosen.set_, *_footprint(chosen.footprint)], allow_missing=chosen.allow_missing
    )
    if chosen.smoother is not None:
        configuration = replace(configuration, smoother=choose_smoother(configuration, chosen.smoother))
    planners = [choose_global_planner(configuration, name) for name in names]
    print_warnings(configuration)
    note_off_the_map(grid, start, [goal])
    unique = list({planner.name: planner for planner in planners}.values())
    return _Query(configuration, grid, start, goal, path), unique


def _footprint(text: str | None) -> list[str]:
    """Overrides that set the footprint of both costmaps. Raises InputError."""
    import re

    from navstack.core.errors import InputError

    if text is None:
        return []
    box = re.fullmatch(r"\s*([\d.]+)\s*x\s*([\d.]+)\s*", text)
    if box is None and not text.lstrip().startswith("[["):
        raise InputError(
            f'--footprint "{text}" is neither a box such as 1.2x0.7 (length x width, m) nor a list of points [[x,y],[x,y],..]',
            argument="--footprint",
        )
    if box is not None:
        try:
            x, y = 0.5 * float(box[1]), 0.5 * float(box[2])
        except ValueError:
            raise InputError(f'--footprint "{text}" has no two numbers; give 1.2x0.7', argument="--footprint") from None
        text = f"[[{x},{y}],[{-x},{y}],[{-x},{-y}],[{x},{-y}]]"
    return [f"{name}.footprint={text}" for name in ("global_costmap", "local_costmap")]


def _planner_names(compare: str | None, planner: str | None) -> list[str]:
    from navstack.core.errors import InputError

    if compare is None:
        return [] if planner is None else [planner]
    if planner is not None:
        raise InputError(
            f'--compare "{compare}" and --planner "{planner}" exclude each other; give one of them',
            argument="--compare",
        )
    names = [name.strip() for name in compare.split(",") if name.strip()]
    if not names:
        raise InputError(
            f'--compare "{compare}" contains no planner; give names such as navfn,astar,theta_star',
            argument="--compare",
        )
    return names


def _plan(query: _Query, choice: PluginChoice[GlobalPlanner] | None, chosen: dict[str, Path], json_: bool) -> None:
    from navstack.bringup import plan_on_map
    from navstack.cli.output import loading_kernels, print_files, print_json, print_note
    from navstack.core.files import write_json

    with loading_kernels(quiet=json_):
        found = plan_on_map(
            query.configuration, query.grid, query.start, query.goal, planner=choice, keep_potential=bool(chosen)
        )
    document = _document(found, _planning_ms(query, found, choice or query.configuration.global_planner))
    if chosen:
        document["files"] = _write(query, [found], chosen)
        if "plan" in chosen:
            write_json(chosen["plan"], document)
    if json_:
        print_json(document)
        return
    _print_table([document], f"plan on {query.map.name}")
    for note in found.plan.notes:
        print_note(note)
    print_files(document.get("files", {}))


def _compare(query: _Query, choices: list[PluginChoice[GlobalPlanner]], chosen: dict[str, Path], json_: bool) -> None:
    """Runs several planners on the same costmap. Raises the first error if every planner fails."""
    import json

    from navstack.cli.output import print_files, print_note
    from navstack.core.errors import jsonable
    from navstack.core.files import write_json

    found, documents = _plans(query, choices, keep_potential=bool(chosen), quiet=json_)
    files: dict[str, str] = {}
    if chosen:
        files = _write(query, found, chosen)
        if "plan" in chosen:
            write_json(chosen["plan"], documents)
    if json_:
        typer.echo(json.dumps(jsonable(documents), allow_nan=False))
        return
    _print_table(documents, f"plans on {query.map.name}")
    for d in documents:
        for note in [d["error"]["message"]] if "error" in d else d["notes"]:
            print_note(f"{d['planner']}: {note}")
    print_files(files)


def _plans(
    query: _Query, choices: list[PluginChoice[GlobalPlanner]], *, keep_potential: bool, quiet: bool
) -> tuple[list[PlannedPath], list[dict[str, Any]]]:
    """The plans that were found, and a document for every planner, also for those that failed."""
    from navstack.bringup import plan_on_map
    from navstack.cli.output import loading_kernels
    from navstack.core.errors import PlanningError

    found: list[PlannedPath] = []
    errors: list[PlanningError] = []
    documents: list[dict[str, Any]] = []
    for choice in choices:
        keep = keep_potential and not found
        try:
            with loading_kernels(quiet=quiet or bool(found)):
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
    return found, documents


def _planning_ms(query: _Query, found: PlannedPath, choice: PluginChoice[GlobalPlanner]) -> float:
    """Planning time of a new planner without caches, with the kernels loaded (ms)."""
    import time

    fresh = choice.cls(choice.params)
    began = time.perf_counter()
    fresh.make_plan(found.costmap.master, query.start, query.goal, footprint=found.costmap.footprint)
    return (time.perf_counter() - began) * 1e3


def _write(query: _Query, found: list[PlannedPath], chosen: dict[str, Path]) -> dict[str, str]:
    """Writes the picture if it is among the chosen files; returns the names of these."""
    if "picture" in chosen:
        _draw(query, found, chosen["picture"])
    return {what: str(file) for what, file in chosen.items()}


def _draw(query: _Query, found: list[PlannedPath], picture: Path) -> None:
    from navstack.plot import plot_plan

    plot_plan(
        found[0].costmap.master,
        {one.planner: one.plan for one in found},
        picture,
        start=query.start,
        goal=query.goal,
        footprint=found[0].costmap.footprint,
        title=f"{query.map.stem}: {', '.join(one.planner for one in found)}",
    )


def _print_table(documents: list[dict[str, Any]], title: str) -> None:
    from navstack.cli.output import stdout, titled_table

    columns = ("length", "clearance", "cost", "cells expanded", "time", "poses")
    table = titled_table(title, left=("planner",), right=columns)
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


def _document(found: PlannedPath, planning_ms: float) -> dict[str, Any]:
    import math

    plan = found.plan
    clearance = plan.clearance_m(found.costmap.master)
    return {
        "planner": found.planner,
        "length_m": plan.length_m,
        "clearance_m": clearance if math.isfinite(clearance) else None,
        "cost": plan.cost,
        "time_ms": planning_ms,
        "cells_expanded": plan.cells_expanded,
        "goal_moved_m": plan.goal_moved_m,
        "notes": list(plan.notes),
        "poses": plan.path.poses.tolist(),
    }
