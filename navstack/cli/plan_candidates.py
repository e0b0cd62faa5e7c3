"""What `navstack plan` plans with: a planner with its parameters, or several to compare."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from navstack.interfaces import GlobalPlanner
    from navstack.parameters.configuration import Configuration, PluginChoice
    from navstack.parameters.sources import Override


class Candidate(NamedTuple):
    """A planner and the parameters that it plans with."""

    label: str
    """What tables and pictures call it: `smac_hybrid`, `smac_hybrid:car.yaml`, `navfn + simple` with a smoother."""
    planner: PluginChoice[GlobalPlanner]
    configuration: Configuration


class Parameters(NamedTuple):
    """The parameters of the command line: what `--params`, `--set`, `--smoother` and `--allow-missing` say."""

    sources: Sequence[str]
    overrides: Sequence[str | Override]
    smoother: str | None
    allow_missing: bool

    def load(self, sources: Sequence[str], values: Sequence[Override] = ()) -> Configuration:
        """Load sources with the overrides and `values`. Raises ParameterError."""
        from navstack.parameters.configuration import load_configuration
        from navstack.parameters.sources import Override

        overrides = list(self.overrides)
        if self.smoother is not None:
            overrides.append(Override(f"base_smoother={self.smoother}", f"--smoother {self.smoother}"))
        return load_configuration(sources, overrides=[*overrides, *values], allow_missing=self.allow_missing)


def single(parameters: Parameters, planner: str | None) -> Candidate:
    """The planner of the parameters, or the named one. Raises InputError or ParameterError."""
    from navstack.parameters.sources import Override

    named = [] if planner is None else [Override(f"base_global_planner={planner}", f"--planner {planner}")]
    return _candidate(parameters.load(parameters.sources, named), "")


def compared(parameters: Parameters, compare: str) -> list[Candidate]:
    """The candidates of `--compare`, each once: `PLANNER[+SMOOTHER][:PARAMS][:KEY=VALUE]..` with commas between them.

    SMOOTHER stands in the place of that of `--smoother`. PARAMS is a file over those of `--params`, or a packaged set or folder
    in their place; `:PARAMS` stands for the planner of these parameters. KEY is a parameter of the planner. Raises InputError or
    ParameterError.
    """
    from navstack.core.errors import InputError

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
    from navstack.core.errors import InputError
    from navstack.parameters.sources import Override

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
    from navstack.parameters import packaged_sets

    whole = named in packaged_sets() or Path(named).is_dir()
    return [named] if whole else [*sources, named]


def _candidate(configuration: Configuration, suffix: str) -> Candidate:
    planner = configuration.global_planner
    smoother = f" + {configuration.smoother.name}" if configuration.smoother is not None else ""
    return Candidate(planner.name + suffix + smoother, planner, configuration)
