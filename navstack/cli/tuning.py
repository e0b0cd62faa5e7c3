"""What `navstack sweep` and `navstack tune` both ask for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from navstack.tune.setup import Setup

PARAMS: list[str] = typer.Option(
    ["turtlebot"], "--params", metavar="NAME|DIR|FILE", help="The robot's parameters as they are (repeat)."
)
SUITE: str = typer.Option(
    "office", "--suite", metavar="NAME|DIR|FILE", help="A suite, a folder of scenario files, or BARN's worlds.npz."
)
PARAM: list[str] = typer.Option(
    [],
    "--param",
    metavar="NAME[=LOW:HIGH[:log]]",
    help="Search this parameter, or among the choices NAME=A,B,C (repeat). A pattern with * sets all that match together.",
)
SPACE: str | None = typer.Option(
    None,
    "--space",
    metavar="NAME|FILE",
    help="Ready-made ranges (auto, local_planner, global_planner, costmaps) or a YAML file.",
)
KEEP: list[str] = typer.Option([], "--keep", metavar="NAME", help="Leave this parameter as it is (repeat).")
SET: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Change a parameter beforehand (repeat).")
DISTRO: str | None = typer.Option(
    None, "--distro", metavar="noetic|indigo", help="Whose scoring scale: noetic's, or that of releases before 2018."
)
ALLOW_MISSING: bool = typer.Option(False, "--allow-missing", help="Leave out layers and plugins that are not here.")
SCENARIO: list[str] = typer.Option([], "--scenario", metavar="NAME", help="Only this scenario of the suite (repeat).")
COUNT: int | None = typer.Option(
    None, "--count", metavar="N", help="Scenarios of a suite, half of them held out (16).", min=1
)
SEEDS: int = typer.Option(
    1, "--seeds", metavar="N", help="Runs per scenario, each with another seed of the noise.", min=1
)
SEED: int = typer.Option(
    0,
    "--seed",
    metavar="N",
    help="Of the search, and the first of the noise; the same seed gives the same trials on one worker.",
    min=0,
)
WORKERS: int | None = typer.Option(
    None, "--workers", "--processes", metavar="N", help="How many runs at once; all cores unless given.", min=1
)
RESUME: bool = typer.Option(False, "--resume", help="Go on with what an earlier call left.")
ROUGH: bool = typer.Option(False, "--rough", help="BARN worlds with noise, lag and slip.")
JSON: bool = typer.Option(False, "--json", help="One JSON document on stdout.")


def prepared(
    params: Sequence[str],
    suite: str,
    space: str | None,
    param: Sequence[str],
    keep: Sequence[str],
    set_: Sequence[str],
    distro: str | None,
    allow_missing: bool,
    scenario: Sequence[str],
    count: int | None,
    seeds: int,
    seed: int,
    rough: bool,
) -> Setup:
    """All that both ask for, loaded and checked. Raises InputError, ParameterError, ScenarioError or MapError."""
    from navstack.tune.setup import Asked, prepare

    return prepare(
        Asked(
            params=tuple(params),
            suite=suite,
            space=space,
            param=tuple(param),
            keep=tuple(keep),
            overrides=tuple(set_),
            distro=distro,
            allow_missing=allow_missing,
            scenarios=tuple(scenario),
            count=count,
            seeds=seeds,
            seed=seed,
            rough=rough,
        )
    )
