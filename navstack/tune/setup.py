"""From what a user asks for to what is driven: parameters, suite, space and courses, checked before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from navstack.core.errors import InputError
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.sources import Source
from navstack.parameters.spelling import nearest
from navstack.tune.courses import Course
from navstack.tune.given import search_space
from navstack.tune.scenarios import Place, course_of, read_place
from navstack.tune.space import SearchSpace


@dataclass(frozen=True, slots=True)
class Asked:
    """What sweeps and tuning have in common."""

    params: tuple[str, ...]
    suite: str = "office"
    space: str | None = None
    param: tuple[str, ...] = ()
    keep: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    distro: str | None = None
    allow_missing: bool = False
    scenarios: tuple[str, ...] = ()
    """Only these of the suite; all for none."""
    count: int | None = None
    """How many scenarios of a suite; half of them are held out."""
    seeds: int = 1
    seed: int = 0
    rough: bool = False


@dataclass(frozen=True, slots=True)
class Setup:
    """The same, loaded."""

    asked: Asked
    place: Place
    base: Configuration
    space: SearchSpace
    names: tuple[str, ...]
    """Of the scenarios."""

    @property
    def environment(self) -> list[Source]:
        """Parameters of the suite's simulator."""
        return self.place.environment(rough=self.asked.rough)

    @property
    def sources(self) -> list[Source]:
        """The user's, and the suite's."""
        return [*self.asked.params, *self.environment]

    @property
    def speed(self) -> float:
        """The highest speed that the search may reach (m/s): what the scores' reference times are made with."""
        found = [float(getattr(self.base.local_planner.params, "max_vel_x", 0.5))]
        found += [d.high for d in self.space if d.name.endswith("/max_vel_x")]
        return max(0.05, *found)

    def course(self, names: Sequence[str] | None = None, configuration: Configuration | None = None) -> Course:
        """The cases of these scenarios, all of them unless given."""
        seeds = range(self.asked.seed, self.asked.seed + self.asked.seeds)
        return course_of(
            self.place, self.names if names is None else names, seeds, configuration or self.base, self.speed
        )

    def other(self, params: str) -> Configuration:
        """Another parameter set in the same simulator."""
        return load_configuration([params, *self.environment], allow_missing=self.asked.allow_missing)

    def what(self) -> dict[str, Any]:
        """What shapes the results beyond parameters, space and cases, for JSON."""
        return {"suite": self.place.name, "rough": self.asked.rough, "reference_speed": self.speed}


def prepare(asked: Asked) -> Setup:
    """Loads everything. Raises InputError, ParameterError, ScenarioError or MapError."""
    place = read_place(asked.suite, asked.count)
    names = place.names
    for name in asked.scenarios:
        if name not in names:
            close = nearest(name, names)
            hint = (
                f'did you mean "{close}"?'
                if close
                else f"there are {', '.join(names[:8])}{', ..' if len(names) > 8 else ''}"
            )
            raise InputError(f'--scenario "{name}": {asked.suite} has none of that name; {hint}', scenario=name)
    chosen = tuple(n for n in names if n in asked.scenarios) if asked.scenarios else names
    base = load_configuration(
        [*asked.params, *place.environment(rough=asked.rough)],
        overrides=asked.overrides,
        distro=asked.distro,
        allow_missing=asked.allow_missing,
    )
    space = search_space(base, space=asked.space, params=asked.param, keep=asked.keep)
    return Setup(asked, place, base, space, chosen)
