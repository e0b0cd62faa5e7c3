"""`navstack plan`: plan a path on a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.bringup import costmap_on_map, plan_on_map
from navstack.cli import options
from navstack.cli.arguments import footprint_overrides, map_of, note_off_the_map, parse_place
from navstack.cli.options import chosen_files
from navstack.cli.output import (
    loading_kernels,
    print_files,
    print_findings,
    print_json,
    print_note,
    stdout,
    titled_table,
)
from navstack.core import InputError, PlanningError, jsonable, write_json
from navstack.global_planner import smoothed
from navstack.parameters import Override, load_configuration, packaged_sets
from navstack.plot import plot_plan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from navstack.bringup import PlannedPath
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.parameters import Configuration
    from navstack.plugins import GlobalPlanner, Plugin


class PlanOptions(NamedTuple):
    """What to plan, and with which planners."""

    map_: options.Map
    start: Annotated[
        str,
        typer.Option("--start", metavar="X,Y[,YAW]|PLACE", help="Start pose in the map frame (m, rad), or a place."),
    ]
    goal: Annotated[
        str, typer.Option("--goal", metavar="X,Y[,YAW]|PLACE", help="Goal pose in the map frame (m, rad), or a place.")
    ]
    params: options.Params = ["turtlebot"]
    planner: Annotated[
        str | None,
        typer.Option("--planner", metavar="NAME", help="Global planner to use. [default: the one of the parameters]"),
    ] = None
    smoother: Annotated[
        str | None,
        typer.Option("--smoother", metavar="NAME", help="Smoother of the path. [default: the one of the parameters]"),
    ] = None
    footprint: options.Footprint = None
    compare: Annotated[
        list[str],
        typer.Option(
            "--compare",
            metavar="NAME[+SMOOTHER][:PARAMS|:KEY=VALUE..],..",
            help="Compare planners, each with a smoother and parameters of its own: a file over those of --params, a packaged "
            "set or folder in their place, values of the planner (repeatable). One table, one picture; --json prints a list.",
        ),
    ] = []
    set_: options.Set = []
    allow_missing: options.AllowMissing = False


class _Query(NamedTuple):
    """A planning request on a map."""

    grid: OccupancyGrid
    start: Pose2D
    goal: Pose2D
    map: Path


@options.with_options(chosen=PlanOptions)
def plan(
    chosen: PlanOptions,
    out: Annotated[Path | None, options.both_files("plan.png", "plan.json")] = None,
    _style: options.Style = "screen",
    json_: options.Json = False,
) -> None:
    """Plan a path on a map with the global costmap and planner of a parameter set.

    Exit codes: 0 a path was found, 1 no path was found between valid poses or a path crosses lethal cells, 2 invalid input.
    """
    query, candidates = _load(chosen)
    files = chosen_files(out, {"picture": "plan.png", "plan": "plan.json"}) if out is not None else {}
    if chosen.compare:
        documents = _compare(query, candidates, files, json_)
    else:
        documents = [_plan(query, candidates[0], files, json_)]
    if out is None and not json_:
        print_note("--out DIR writes the path and a picture of it")
    if any(document.get("lethal_cells") for document in documents):
        raise typer.Exit(1)


def _load(chosen: PlanOptions) -> tuple[_Query, list[Candidate]]:
    """The query, and what plans. Raises InputError, MapError or ParameterError."""
    start, goal = (
        parse_place(text, name, chosen.map_) for text, name in ((chosen.start, "--start"), (chosen.goal, "--goal"))
    )
    path, grid = map_of(chosen.map_)
    if chosen.compare and chosen.planner is not None:
        raise InputError(
            f'--compare "{",".join(chosen.compare)}" and --planner "{chosen.planner}" exclude each other; give one of them',
            argument="--compare",
        )
    overrides = [*chosen.set_, *footprint_overrides(chosen.footprint)]
    parameters = Parameters(chosen.params, overrides, chosen.smoother, chosen.allow_missing)
    if chosen.compare:
        candidates = compared(parameters, ",".join(chosen.compare))
    else:
        candidates = [single(parameters, chosen.planner)]
    found = list(dict.fromkeys(f for c in candidates for f in c.configuration.findings))
    # `check` does not take the parameters of single candidates
    print_findings(found, () if chosen.compare else chosen.params, chosen.set_)
    note_off_the_map(grid, start, [goal])
    return _Query(grid, start, goal, path), candidates


def _plan(query: _Query, candidate: Candidate, chosen: dict[str, Path], json_: bool) -> dict[str, Any]:
    """Plans; returns the document."""
    try:
        with loading_kernels([candidate.planner.name], quiet=json_):
            found = _planned(query, candidate, keep_potential=bool(chosen))
    except PlanningError as error:
        if "picture" in chosen:
            _draw_failure(query, candidate, error, chosen["picture"])
            print_note(f"picture of the reason: {chosen['picture']}")
        raise
    document = _document(query, candidate, found)
    if chosen:
        document["files"] = _write(query, {candidate.label: found}, [document], chosen)
        if "plan" in chosen:
            write_json(chosen["plan"], document)
    if json_:
        print_json(document)
        return document
    _print_table([document], f"plan on {query.map.name}")
    for note in found.plan.notes:
        print_note(note)
    print_files(document.get("files", {}))
    return document


def _compare(query: _Query, candidates: list[Candidate], chosen: dict[str, Path], json_: bool) -> list[dict[str, Any]]:
    """Plans with every candidate; returns their documents. Raises the first error if all of them fail."""
    import json

    found, documents = _plans(query, candidates, keep_potential=bool(chosen), quiet=json_)
    files: dict[str, str] = {}
    if chosen:
        files = _write(query, found, documents, chosen)
        if "plan" in chosen:
            write_json(chosen["plan"], documents)
    if json_:
        typer.echo(json.dumps(jsonable(documents), allow_nan=False))
        return documents
    _print_table(documents, f"plans on {query.map.name}")
    for d in documents:
        for note in [d["error"]["message"]] if "error" in d else d["notes"]:
            print_note(f"{d['candidate']}: {note}")
    print_files(files)
    return documents


def _plans(
    query: _Query, candidates: list[Candidate], *, keep_potential: bool, quiet: bool
) -> tuple[dict[str, PlannedPath], list[dict[str, Any]]]:
    """The plans that were found, by label, and a document for every candidate, also for those that failed."""
    found: dict[str, PlannedPath] = {}
    errors: list[PlanningError | InputError] = []
    documents: list[dict[str, Any]] = []
    for candidate in candidates:
        try:
            with loading_kernels([candidate.planner.name], quiet=quiet or bool(found)):
                one = _planned(query, candidate, keep_potential=keep_potential and not found)
        except (PlanningError, InputError) as error:  # such as primitives for cells of another size
            errors.append(error)
            name = {"planner": candidate.planner.name, "candidate": candidate.label}
            documents.append({**name, "error": error.as_dict()})
            continue
        documents.append(_document(query, candidate, one))
        found[candidate.label] = one
    if not found:
        raise errors[0]
    return found, documents


def _planned(query: _Query, candidate: Candidate, *, keep_potential: bool) -> PlannedPath:
    return plan_on_map(
        candidate.configuration,
        query.grid,
        query.start,
        query.goal,
        planner=candidate.planner,
        keep_potential=keep_potential,
    )


def _planning_ms(query: _Query, candidate: Candidate, found: PlannedPath) -> float:
    """Time of a new planner without caches, and of its smoother, with the kernels loaded (ms)."""
    import time

    fresh = smoothed(candidate.planner.cls(candidate.planner.params), candidate.configuration.smoother)
    began = time.perf_counter()
    fresh.make_plan(found.costmap.master, query.start, query.goal, footprint=found.costmap.footprint)
    return (time.perf_counter() - began) * 1e3


def _write(
    query: _Query, found: dict[str, PlannedPath], documents: list[dict[str, Any]], chosen: dict[str, Path]
) -> dict[str, str]:
    """Writes the picture if it is among the chosen files; returns the names of these."""
    if "picture" in chosen:
        _draw(query, found, documents, chosen["picture"])
    return {what: str(file) for what, file in chosen.items()}


def _draw(query: _Query, found: dict[str, PlannedPath], documents: list[dict[str, Any]], picture: Path) -> None:
    first = next(iter(found.values()))
    # the footprint drawn is that of the plan whose sweep is drawn
    swept = next((one for one in found.values() if one.plan.for_footprint), first)
    several = f"{len(found)} plans" if any(":" in label or "+" in label for label in found) else ", ".join(found)
    plot_plan(
        first.costmap.master,
        {label: one.plan for label, one in found.items()},
        picture,
        start=query.start,
        goal=query.goal,
        footprint=swept.costmap.footprint,
        title=f"{query.map.stem}: {several if len(found) > 1 else next(iter(found))}",
        texts={d["candidate"]: _legend_text(d) for d in documents if "error" not in d},
    )


def _draw_failure(query: _Query, candidate: Candidate, error: PlanningError, picture: Path) -> None:
    costmap = costmap_on_map(candidate.configuration, query.grid, query.start)
    plot_plan(
        costmap.master,
        {},
        picture,
        start=query.start,
        goal=query.goal,
        footprint=costmap.footprint,
        title=f"{query.map.stem}: {candidate.label} found no plan",
        subtitle=f"{error.name} ({error.code})",
        failure=error.data,
    )


def _legend_text(document: dict[str, Any]) -> str:
    """What the picture of several plans says of one."""
    parts = [f"{document['length_m']:.2f} m", f"{document['time_ms']:.1f} ms"]
    if document["clearance_m"] is not None:
        parts.append(f"clearance {document['clearance_m']:.2f} m")
    if document["cusps"] is not None:
        parts.append(f"{document['cusps']} cusp{'' if document['cusps'] == 1 else 's'}")
    return f"{_lines(document['candidate'])}\n{', '.join(parts)}"


def _print_table(documents: list[dict[str, Any]], title: str) -> None:
    table = titled_table(title, left=("planner",), right=("length", "clearance", "cusps", "cost", "expanded", "time"))
    table.columns[0].no_wrap, table.columns[0].overflow = False, "fold"
    for d in documents:
        if "error" in d:
            table.add_row(_lines(d["candidate"]), "no plan")
            continue
        table.add_row(
            _lines(d["candidate"]),
            f"{d['length_m']:.2f} m",
            "-" if d["clearance_m"] is None else f"{d['clearance_m']:.2f} m",
            "-" if d["cusps"] is None else str(d["cusps"]),
            f"{d['cost']:.0f}" if d["cost"] >= 1000.0 else f"{d['cost']:.4g}",
            f"{d['cells_expanded']:,}",
            f"{d['time_ms']:.1f} ms",
        )
    stdout().print(table)


def _lines(label: str) -> str:
    """The label of a candidate with a line for the planner, each of its parameters and the smoother."""
    return label.replace(":", "\n:").replace(" + ", "\n+ ")


def _document(query: _Query, candidate: Candidate, found: PlannedPath) -> dict[str, Any]:
    import math

    plan = found.plan
    clearance = plan.clearance_m(found.costmap.master)
    lethal, first = found.lethal_cells
    return {
        "planner": found.planner,
        "smoother": None if candidate.configuration.smoother is None else candidate.configuration.smoother.name,
        "candidate": candidate.label,
        "length_m": plan.length_m,
        "clearance_m": clearance if math.isfinite(clearance) else None,
        "lethal_cells": lethal,
        "first_lethal_m": first if lethal else None,
        "cusps": plan.path.cusps if plan.for_footprint else None,
        "cost": plan.cost,
        "time_ms": _planning_ms(query, candidate, found),
        "cells_expanded": plan.cells_expanded,
        "goal_moved_m": plan.goal_moved_m,
        "notes": list(plan.notes),
        "poses": plan.path.poses.tolist(),
    }


# ----------------------------------------------------------------------------------------------------------------------
# What `navstack plan` plans with: a planner with its parameters, or several to compare.


class Candidate(NamedTuple):
    """A planner and the parameters that it plans with."""

    label: str
    """What tables and pictures call it: `smac_hybrid`, `smac_hybrid:car.yaml`, `navfn + simple` with a smoother."""
    planner: Plugin[GlobalPlanner]
    configuration: Configuration


class Parameters(NamedTuple):
    """The parameters of the command line: what `--params`, `--set`, `--smoother` and `--allow-missing` say."""

    sources: Sequence[str]
    overrides: Sequence[str | Override]
    smoother: str | None
    allow_missing: bool

    def load(self, sources: Sequence[str], values: Sequence[Override] = ()) -> Configuration:
        """Load sources with the overrides and `values`. Raises ParameterError."""
        overrides = list(self.overrides)
        if self.smoother is not None:
            overrides.append(Override(f"base_smoother={self.smoother}", f"--smoother {self.smoother}"))
        return load_configuration(sources, overrides=[*overrides, *values], allow_missing=self.allow_missing)


def single(parameters: Parameters, planner: str | None) -> Candidate:
    """The planner of the parameters, or the named one. Raises InputError or ParameterError."""
    named = [] if planner is None else [Override(f"base_global_planner={planner}", f"--planner {planner}")]
    return _candidate(parameters.load(parameters.sources, named), "")


def compared(parameters: Parameters, compare: str) -> list[Candidate]:
    """The candidates of `--compare`, each once: `PLANNER[+SMOOTHER][:PARAMS][:KEY=VALUE]..` with commas between them.

    SMOOTHER stands in the place of that of `--smoother`. PARAMS is a file over those of `--params`, or a packaged set or folder
    in their place; `:PARAMS` stands for the planner of these parameters. KEY is a parameter of the planner. Raises InputError or
    ParameterError.
    """
    entries = [entry.strip() for entry in compare.split(",") if entry.strip()]
    if not entries:
        raise InputError(
            f'--compare "{compare}" contains no planner; give names such as navfn,astar,theta_star',
            argument="--compare",
        )
    found = [_entry(parameters, entry) for entry in entries]
    return list({candidate.label: candidate for candidate in found}.values())


def _entry(parameters: Parameters, entry: str) -> Candidate:
    """The candidate of one entry."""
    first, *parts = (part.strip() for part in entry.replace("::", "/").split(":"))
    name, plus, smoother = (part.strip() for part in first.partition("+"))
    values = [part for part in parts if "=" in part]
    sets = [part for part in parts if "=" not in part]
    wrong = len(sets) > 1 or not all(part.partition("=")[0] for part in parts) or not (name or sets)
    if wrong or bool(plus) != bool(smoother):
        raise InputError(
            f'--compare "{entry}" is not PLANNER[+SMOOTHER][:PARAMS][:KEY=VALUE]..; '
            "give for example smac_hybrid:car_mppi, smac_hybrid:minimum_turning_radius=0.8 or navfn+simple",
            argument="--compare",
        )
    sources = _sources(parameters.sources, sets[0]) if sets else parameters.sources
    plugins = {"base_global_planner": name, "base_smoother": smoother}
    overrides = [Override(f"{key}={plugin}", f"--compare {entry}") for key, plugin in plugins.items() if plugin]
    configuration = parameters.load(sources, overrides)
    if values:
        namespace = configuration.global_planner.namespace
        overrides += [Override(f"{namespace}/{value}", f"--compare {entry}") for value in values]
        configuration = parameters.load(sources, overrides)
    return _candidate(configuration, "".join(f":{part}" for part in parts))


def _sources(sources: Sequence[str], named: str) -> list[str]:
    """A file is read over the sources, a packaged set or folder stands in their place."""
    whole = named in packaged_sets() or Path(named).is_dir()
    return [named] if whole else [*sources, named]


def _candidate(configuration: Configuration, suffix: str) -> Candidate:
    planner = configuration.global_planner
    smoother = f" + {configuration.smoother.name}" if configuration.smoother is not None else ""
    return Candidate(planner.name + suffix + smoother, planner, configuration)
