"""From the options of sweeps and tuning to parameters, suite, search space and evaluation, checked before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from navstack.core import InputError
from navstack.parameters import Configuration, Source, load_configuration, nearest
from navstack.studies.evaluation import Evaluation
from navstack.studies.search_space import SearchSpace
from navstack.studies.search_space_parser import parse_search_space
from navstack.studies.suites import Suite, make_evaluation, read_suite

_NAMES_SHOWN = 8


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """The options that sweeps and tuning share."""

    params: tuple[str, ...]
    suite: str = "office"
    space: str | None = None
    param: tuple[str, ...] = ()
    keep: tuple[str, ...] = ()
    limit_factor: float = 1.0
    """Speeds and accelerations are searched up to this many times their current values."""
    overrides: tuple[str, ...] = ()
    distro: str | None = None
    allow_missing: bool = False
    scenarios: tuple[str, ...] = ()
    """Only these scenarios of the suite; empty: all."""
    count: int | None = None
    """Number of scenarios of a packaged suite, half of them held out."""
    seeds: int = 1
    seed: int = 0
    rough: bool = False


@dataclass(frozen=True, slots=True)
class Setup:
    """The loaded options."""

    options: SearchOptions
    suite: Suite
    base: Configuration
    """The user's parameters."""
    space: SearchSpace
    names: tuple[str, ...]
    """Names of the scenarios."""

    @property
    def environment(self) -> list[Source]:
        """Parameters of the suite's simulator."""
        return self.suite.environment(rough=self.options.rough)

    @property
    def sources(self) -> list[Source]:
        """The user's sources and those of the suite."""
        return [*self.options.params, *self.environment]

    @property
    def speed(self) -> float:
        """Highest speed in the search space (m/s), for the reference times of the score."""
        found = [float(getattr(self.base.local_planner.params, "max_vel_x", 0.5))]
        found += [d.high for d in self.space if d.name.endswith("/max_vel_x")]
        return max(0.05, *found)

    def evaluation(self, names: Sequence[str] | None = None) -> Evaluation:
        """Return the evaluation on these scenarios; None: all."""
        seeds = range(self.options.seed, self.options.seed + self.options.seeds)
        return make_evaluation(self.suite, self.names if names is None else names, seeds, self.base, self.speed)

    def reference(self, params: str) -> Configuration:
        """Another parameter set in the same simulator."""
        return load_configuration([params, *self.environment], allow_missing=self.options.allow_missing)

    def described(self) -> dict[str, Any]:
        """Return everything that affects the results, except parameters, space and cases, for JSON."""
        found = {"suite": self.suite.name, "rough": self.options.rough, "reference_speed": self.speed}
        return found if self.suite.scale == 1.0 else {**found, "scale": self.suite.scale}

    @property
    def scale_text(self) -> str:
        """What was done to the maps so that the robot fits; empty if nothing."""
        if self.suite.scale == 1.0:
            return ""
        footprint = self.base.global_costmap.footprint
        return (
            f"the maps and doors of {self.suite.name} are {self.suite.scale:g} times as large as usual, so that the robot "
            f"fits: its circumscribed radius with padding is {footprint.circumscribed_radius:.2f} m"
        )


def prepare(options: SearchOptions) -> Setup:
    """Load everything. Raises InputError, ParameterError, ScenarioError or MapError."""
    suite = read_suite(options.suite, options.count)
    names = suite.names
    for name in options.scenarios:
        if name not in names:
            raise InputError(
                f'--scenario "{name}": {options.suite} has no scenario of that name; {_hint(name, names)}',
                scenario=name,
            )
    base = load_configuration(
        [*options.params, *suite.environment(rough=options.rough)],
        overrides=options.overrides,
        distro=options.distro,
        allow_missing=options.allow_missing,
    )
    suite = suite.fitted(base.global_costmap.footprint)
    default = "localization" if suite.localizes and not options.param else None
    space = parse_search_space(
        base, space=options.space or default, params=options.param, keep=options.keep, limit_factor=options.limit_factor
    )
    chosen = tuple(n for n in names if n in options.scenarios) if options.scenarios else names
    return Setup(options, suite, base, space, chosen)


def _hint(name: str, names: Sequence[str]) -> str:
    close = nearest(name, names)
    if close:
        return f'did you mean "{close}"?'
    return f"it has {', '.join(names[:_NAMES_SHOWN])}{', ..' if len(names) > _NAMES_SHOWN else ''}"
