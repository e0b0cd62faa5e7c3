"""`navstack explain inflation`: cost against distance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from navstack.cli import options
from navstack.cli.arguments import map_of
from navstack.cli.options import chosen_files
from navstack.cli.output import print_files, print_json, stdout
from navstack.core import describe_cost, write_json
from navstack.explain import inflation_curves
from navstack.parameters import load_configuration
from navstack.plot import plot_inflation_curves

if TYPE_CHECKING:
    from navstack.explain import InflationCurve


def inflation(
    params: options.Params = ["turtlebot"],
    set_: options.Set = [],
    map_: Annotated[
        str | None,
        typer.Option(
            "--map", metavar="MAP.yaml", help="Map whose resolution the global costmap takes. [default: no map]"
        ),
    ] = None,
    out: Annotated[Path | None, options.both_files("inflation.png", "inflation.json")] = None,
    json_: options.Json = False,
) -> None:
    """Print cost against distance to the nearest obstacle for both costmaps of a parameter set."""
    resolution = map_of(map_)[1].geometry.resolution if map_ is not None else None
    configuration = load_configuration(params, overrides=set_)
    curves = inflation_curves(configuration, map_resolution=resolution)
    document: dict[str, Any] = {"curves": [curve.as_dict() for curve in curves]}
    if out is not None:
        chosen = chosen_files(out, {"picture": "inflation.png", "curves": "inflation.json"})
        document["files"] = {what: str(file) for what, file in chosen.items()}
        if "picture" in chosen:
            title = f"inflation: {', '.join(Path(p).name for p in params)}"
            plot_inflation_curves(curves, chosen["picture"], title=title)
        if "curves" in chosen:
            write_json(chosen["curves"], document)
    if json_:
        print_json(document)
    else:
        _print(curves, document.get("files", {}))


def _print(curves: list[InflationCurve], files: dict[str, str]) -> None:
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
        stdout().print(table)
    print_files(files)
