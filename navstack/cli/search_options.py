"""Options that `navstack sweep` and `navstack tune` share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from navstack.cli import options
from navstack.studies import SearchOptions, prepare

if TYPE_CHECKING:
    from navstack.studies import Setup

Workers = Annotated[
    int | None,
    typer.Option("--workers", "--processes", metavar="N", help="Number of parallel runs; all cores by default.", min=1),
]
Resume = Annotated[bool, typer.Option("--resume", help="Continue an interrupted run.")]


class SearchArguments(NamedTuple):
    """The robot, the scenarios and the search space."""

    params: options.Params = ["turtlebot"]
    suite: Annotated[
        str,
        typer.Option(
            "--suite",
            metavar="NAME|DIR|FILE",
            help="Suite, folder of scenario files, BARN worlds.npz; for amcl: localization (simulated drives), or a "
            "log.",
        ),
    ] = "office"
    param: Annotated[
        list[str],
        typer.Option(
            "--param",
            metavar="NAME[=LOW:HIGH[:log]]",
            help="Search this parameter, or the choices NAME=A,B,C (repeatable). A pattern with * sets all matches together.",
        ),
    ] = []
    space: Annotated[
        str | None,
        typer.Option(
            "--space",
            metavar="NAME|FILE",
            help="Default ranges (auto, local_planner, global_planner, costmaps), or a YAML file.",
        ),
    ] = None
    keep: Annotated[
        list[str], typer.Option("--keep", metavar="NAME", help="Do not search this parameter (repeatable).")
    ] = []
    limit_factor: Annotated[
        float,
        typer.Option(
            "--limit-factor",
            metavar="F",
            help="Search speeds and accelerations up to F times their current values, if your robot can do that.",
            min=1.0,
            max=100.0,
        ),
    ] = 1.0
    set_: options.Set = []
    distro: options.Distro = None
    allow_missing: options.AllowMissing = False
    scenario: Annotated[
        list[str], typer.Option("--scenario", metavar="NAME", help="Only this scenario of the suite (repeatable).")
    ] = []
    scenario_count: Annotated[
        int | None,
        typer.Option(
            "--count", metavar="N", help="Number of scenarios of a packaged suite, half of them held out (16).", min=1
        ),
    ] = None
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", help="Runs per scenario, each with another random seed.", min=1)
    ] = 1
    seed: Annotated[
        int,
        typer.Option(
            "--seed",
            metavar="N",
            help="Random seed of the search, and first random seed of the runs. One worker gives the same trials again.",
            min=0,
        ),
    ] = 0
    rough: Annotated[bool, typer.Option("--rough", help="BARN worlds with sensor noise, lag and wheel slip.")] = False

    def prepare(self) -> Setup:
        """Loads and checks everything. Raises InputError, ParameterError, ScenarioError or MapError."""
        return prepare(
            SearchOptions(
                params=tuple(self.params),
                suite=self.suite,
                space=self.space,
                param=tuple(self.param),
                keep=tuple(self.keep),
                limit_factor=self.limit_factor,
                overrides=tuple(self.set_),
                distro=self.distro,
                allow_missing=self.allow_missing,
                scenarios=tuple(self.scenario),
                count=self.scenario_count,
                seeds=self.seeds,
                seed=self.seed,
                rough=self.rough,
            )
        )
