"""`navstack bench speed`: how fast navstack runs on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.arguments import map_of, scenario_file
from navstack.cli.bench.execution import BenchOutput
from navstack.cli.options import with_options
from navstack.core import InputError
from navstack.map_io import map_names
from navstack.parameters import load_configuration
from navstack.scenario import Scenario, load_places, read_scenario, shipped_scenarios
from navstack.studies import SpeedTask, for_workers, read_reference, short_names


@with_options(output=BenchOutput)
def speed(
    map_: Annotated[
        str,
        typer.Argument(
            metavar="[SCENARIO.yaml | MAP]",
            help="Scenario file, name of a shipped scenario, or packaged map with places.",
        ),
    ] = "office",
    params: options.ParamsOrScenario = [],
    set_: options.Set = [],
    repeats: Annotated[
        int,
        typer.Option("--repeats", metavar="N", min=1, help="Number of runs; the tables show the best and the median."),
    ] = 7,
    reference: Annotated[
        Path | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="Times to compare with: of the C++ costmaps and DWA, or the --json output of an earlier version.",
        ),
    ] = None,
    *,
    output: BenchOutput,
) -> int:
    """Measure the real-time factor of the whole stack, its share by stage, and single stages, on one core.

    Each figure comes with the calibration: the time of a fixed piece of work at that moment. Ratios are scaled by it.
    """
    known = read_reference(reference) if reference is not None else None
    scenario = _scenario(map_, [for_workers(p) for p in params], set_)
    named = {"drives": Path(map_).name, "params": short_names(params), "set": list(set_)}
    return output.carry_out(SpeedTask(scenario, repeats, named, known), processes=1)


def _scenario(name: str, params: list[str], overrides: list[str]) -> Scenario:
    """The scenario file of that name, or the tour of a packaged map. Raises InputError, MapError, ScenarioError."""
    file = scenario_file(name)
    if file is not None:
        return read_scenario(file).build(params=params or None, overrides=overrides)
    _, grid = map_of(name, {"scenario": shipped_scenarios()})
    if name not in map_names():
        raise InputError(
            f"{name} defines no start and no goals; give a scenario file, or a packaged map: {', '.join(map_names())}",
            argument="MAP",
            value=name,
        )
    places = load_places(name)
    configuration = load_configuration(params or ["turtlebot"], overrides=overrides)
    return Scenario(grid, configuration, places.start, places.goals)
