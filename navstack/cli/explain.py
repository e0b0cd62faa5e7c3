"""`navstack explain`: what became of a goal, a cell's cost, the doors a robot passes, what inflation charges."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from navstack.cli.explain_command import command
from navstack.cli.explain_goal import goal

if TYPE_CHECKING:
    from navstack.explain import CellExplanation, InflationCurve, PassageReport
    from navstack.explain.passages import Passage

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Say why: what became of a goal, a command, a cell's cost, the doors a robot passes, what inflation charges.",
)

STYLE = {"free": "blue", "costly": "yellow", "blocked": "bold red"}
BOTH = ("global", "local")


def _which(name: str) -> str:
    from navstack.core.errors import InputError

    chosen = name.removesuffix("_costmap")
    if chosen not in BOTH:
        raise InputError(f'--costmap "{name}": there is a global and a local one', argument="--costmap", value=name)
    return chosen


app.command("command")(command)
app.command("goal")(goal)


@app.command("cell")
def cell(
    run: Path = typer.Argument(..., help="The folder of a run, or its run.npz."),
    at: str = typer.Option(..., "--at", metavar="X,Y", help="The point asked about (m, in the map)."),
    time: float | None = typer.Option(None, "--time", metavar="T", help="Second of the run; its end if left out."),
    costmap: str = typer.Option("global", "--costmap", metavar="global|local", help="Which costmap."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Which layer and which sensor set a cell, when, and what every layer says there: the run is driven once more."""
    from navstack.cli.arguments import parse_point
    from navstack.cli.output import print_json
    from navstack.explain import explain_cell_at, replay
    from navstack.record import Record

    x, y = parse_point(at, "--at")
    name = _which(costmap)
    explained = explain_cell_at(replay(Record.load(run), time), x, y, costmap=name)
    if json_:
        print_json(explained.as_dict())
    else:
        _print_cell(explained)


def _print_cell(explained: CellExplanation) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout

    told, out = explained.provenance, stdout()
    robot = explained.robot
    out.print(
        f"{told.costmap} at {explained.time:.3f} s: cell ({told.ix}, {told.iy}) at ({told.x:.3f}, {told.y:.3f}) in "
        f"{escape(explained.frame)}; the robot is at ({robot.x:.2f}, {robot.y:.2f})"
    )
    out.print(f"[bold]{escape(explained.verdict)}[/]")
    table = Table("layer", "cost", "says", box=SIMPLE_HEAD, pad_edge=False)
    subjects = [("", told)] + ([("its obstacle: ", told.obstacle)] if told.obstacle is not None else [])
    for lead, subject in subjects:
        for i, share in enumerate(subject.layers):
            says = share.explanation.text if share.explanation is not None else "no account"
            change = f"{share.before} -> {share.after}" if share.after != share.before else str(share.after)
            last = i == len(subject.layers) - 1
            table.add_row(escape(lead + share.layer), change, escape(says), end_section=last)
    out.print(table)


@app.command("passages")
def passages(
    map_: str = typer.Argument(..., metavar="MAP.yaml", help="A map_server YAML, or the name of a packaged map."),
    params: list[str] = typer.Option(
        ["turtlebot"], "--params", metavar="NAME|DIR|FILE", help="A packaged set, a folder, or files in order (repeat)."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    costmap: str = typer.Option("global", "--costmap", metavar="global|local", help="Whose inflation and footprint."),
    narrowest: float | None = typer.Option(
        None, "--narrowest", metavar="M", help="Leave out what is narrower; the inscribed radius if left out.", min=0.0
    ),
    widest: float | None = typer.Option(
        None, "--widest", metavar="M", help="Leave out what is wider; where inflation ends if left out.", min=0.0
    ),
    unknown: bool = typer.Option(
        False, "--unknown", help="Unknown space bounds passages too: for maps whose walls are not occupied cells."
    ),
    out: Path | None = typer.Option(None, "--out", metavar="DIR", help="Write passages.png and passages.json there."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Which doors and corridors a robot passes, which only at high cost, which not at all."""
    from navstack.cli.arguments import map_of
    from navstack.cli.output import print_json, print_note
    from navstack.core.files import ensure_directory, write_json
    from navstack.explain import find_passages
    from navstack.parameters.configuration import load_configuration

    name = _which(costmap)
    path, grid = map_of(map_)
    configuration = load_configuration(params, overrides=set_)
    report = find_passages(
        configuration, grid, costmap=name, narrowest=narrowest, widest=widest, unknown_is_wall=unknown
    )
    document: dict[str, Any] = {"map": path.name, **report.as_dict()}
    for number, entry in enumerate(document["passages"], 1):
        entry["number"] = number
    if out is not None:
        folder = ensure_directory(out)
        picture, text = folder / "passages.png", folder / "passages.json"
        _draw_passages(report, picture, path.stem)
        document["files"] = {"picture": str(picture), "passages": str(text)}
        write_json(text, document)
    if report.unknown_border > MOSTLY and not unknown:
        print_note(
            f"{100.0 * report.unknown_border:.0f} % of what borders on free space in {path.name} is unknown, not occupied: "
            "no layer inflates that; --unknown takes it for walls when looking for passages"
        )
    if json_:
        print_json(document)
        return
    _print_passages(report, path.name, document.get("files", {}))


MOSTLY = 0.9
"""From here on, a map's walls were never marked as occupied."""


def _headline(report: PassageReport) -> str:
    from navstack.explain.passages import IN_WORDS, VERDICTS

    return ", ".join(f"{report.count(verdict)} {IN_WORDS[verdict]}" for verdict in VERDICTS)


def _needs(report: PassageReport) -> str:
    w = report.widths
    return (
        f"passes from {w.passable:.2f} m, freely from {w.free:.2f} m, turns from {w.turning:.2f} m; "
        f"the robot itself is {w.own:.2f} m wide"
    )


def _draw_passages(report: PassageReport, picture: Path, name: str) -> None:
    from navstack.plot.passages import Bar, plot_passages

    plot_passages(
        report.costmap,
        [Bar(i, passage.ends, passage.verdict) for i, passage in enumerate(report.passages, 1)],
        picture,
        title=f"passages of {name}: {_headline(report)}",
        subtitle=f"{report.costmap_name} costmap: inscribed {report.inscribed_radius:.3f} m, inflation "
        f"{report.inflation_radius:g} m   passes from {report.widths.passable:.2f} m, freely from {report.widths.free:.2f} m",
    )


def _print_passages(report: PassageReport, name: str, files: dict[str, str]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout
    from navstack.explain.passages import IN_WORDS

    out = stdout()
    table = Table(title=f"passages of {escape(name)}", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("no.", "at (m)", "width", "cost"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("its middle is")
    for number, passage in enumerate(report.passages, 1):
        table.add_row(
            str(number),
            f"{passage.x:.2f}, {passage.y:.2f}",
            f"{passage.width:.2f} m",
            str(passage.cost),
            f"[{STYLE[passage.verdict]}]{IN_WORDS[passage.verdict]}[/]",
            escape(_because(passage)),
        )
    out.print(table)
    out.print(f"{_headline(report)}; openings from {report.narrowest:.2f} to {report.widest:.2f} m were looked at")
    out.print(f"this robot {_needs(report)}")
    for what, file in files.items():
        out.print(f"{what}: {file}")


def _because(passage: Passage) -> str:
    return passage.reason + (f"; {passage.length:.1f} m long" if passage.length >= 0.5 else "")


@app.command("inflation")
def inflation(
    params: list[str] = typer.Option(
        ["turtlebot"], "--params", metavar="NAME|DIR|FILE", help="A packaged set, a folder, or files in order (repeat)."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    map_: str | None = typer.Option(
        None, "--map", metavar="MAP.yaml", help="The map that the global costmap takes its resolution from."
    ),
    out: Path | None = typer.Option(None, "--out", metavar="DIR", help="Write inflation.png and inflation.json there."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Cost against distance to the nearest obstacle, for both costmaps of a parameter set."""
    from navstack.cli.arguments import map_of
    from navstack.cli.output import print_json
    from navstack.core.files import ensure_directory, write_json
    from navstack.explain import inflation_curves
    from navstack.parameters.configuration import load_configuration

    resolution = map_of(map_)[1].geometry.resolution if map_ is not None else None
    configuration = load_configuration(params, overrides=set_)
    curves = inflation_curves(configuration, map_resolution=resolution)
    document: dict[str, Any] = {"curves": [curve.as_dict() for curve in curves]}
    if out is not None:
        folder = ensure_directory(out)
        picture, text = folder / "inflation.png", folder / "inflation.json"
        _draw_inflation(curves, picture, [Path(p).name for p in params])
        document["files"] = {"picture": str(picture), "curves": str(text)}
        write_json(text, document)
    if json_:
        print_json(document)
        return
    _print_inflation(curves, document.get("files", {}))


def _draw_inflation(curves: list[InflationCurve], picture: Path, names: list[str]) -> None:
    import numpy as np

    from navstack.plot.inflation import Curve, plot_inflation

    drawn: list[Curve] = []
    for curve in curves:
        reach = max(curve.cells[-1], curve.circumscribed_radius + curve.resolution)
        distances = np.linspace(0.0, 1.05 * reach, 1200)
        drawn.append(
            Curve(
                label=f"{' and '.join(curve.costmaps)} costmap{'s' if len(curve.costmaps) > 1 else ''}",
                distances=distances,
                costs=curve.at(distances).astype(np.float64),
                cells=curve.cells,
                cell_costs=curve.cell_costs.astype(np.float64),
                inscribed=curve.inscribed_radius,
                circumscribed=curve.circumscribed_radius,
                inflation=curve.inflation_radius,
                subtitle=f"cost_scaling_factor {curve.cost_scaling_factor:g} / m   cells of {curve.resolution:g} m",
            )
        )
    plot_inflation(drawn, picture, title=f"inflation: {', '.join(names)}")


def _print_inflation(curves: list[InflationCurve], files: dict[str, str]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from navstack.cli.output import stdout
    from navstack.core import describe_cost

    out = stdout()
    for curve in curves:
        table = Table(
            "cells",
            "distance",
            "cost",
            title=f"{' and '.join(curve.costmaps)}: inscribed {curve.inscribed_radius:.3f} m, circumscribed "
            f"{curve.circumscribed_radius:.3f} m, inflation radius {curve.inflation_radius:g} m, cost_scaling_factor "
            f"{curve.cost_scaling_factor:g} / m",
            title_justify="left",
            box=SIMPLE_HEAD,
            pad_edge=False,
        )
        for cells, (distance, cost) in enumerate(curve.steps()):
            table.add_row(str(cells), f"{distance:.3f} m", describe_cost(cost))
        out.print(table)
    for what, file in files.items():
        out.print(f"{what}: {file}")


@app.command("costmap")
def costmap_(
    run: Path = typer.Argument(..., help="The folder of a run, or its run.npz."),
    time: float | None = typer.Option(None, "--time", metavar="T", help="Second of the run; its end if left out."),
    costmap: str = typer.Option("global", "--costmap", metavar="global|local", help="Which costmap."),
    out: Path = typer.Option(..., "--out", metavar="FILE", help="Picture to write (.png, .svg or .pdf)."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Draw a costmap of a run as it was, with its bands of cost."""
    from navstack.cli.output import print_json, stdout
    from navstack.core import Transform2D
    from navstack.core.errors import RecordError
    from navstack.explain.replay import time_in
    from navstack.plot import plot_costmap
    from navstack.record import Record

    name = _which(costmap)
    record = Record.load(run)
    at = time_in(record, time)
    shown = record.costmap_at(name, at)
    if shown is None:
        raise RecordError(
            f"{run} holds no {name} costmap at {at:.3f} s: it was not recorded, or not updated before; give a later --time"
        )
    to_map: Transform2D = record.to_global(shown.frame, at)
    robot = to_map.inverse().apply(record.pose_at(at))
    updated = float(record.costmap_times(name)[record.costmap_times(name) <= at][-1])
    plot_costmap(
        shown,
        out,
        title=f"{name} costmap at {at:.2f} s (updated {updated:.2f} s), in {shown.frame}",
        robot=robot,
        footprint=record.footprint,
    )
    if json_:
        print_json({"time": at, "updated_at": updated, "costmap": name, "files": {"picture": str(out)}})
        return
    stdout().print(f"picture: {out}")
