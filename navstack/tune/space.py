"""The search space: dimensions with their ranges, and the parameters they set."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from navstack.parameters.report import value_text

Value = float | int | bool | str
Kind = Literal["float", "int", "choice"]

DIGITS: Final = 4
"""Significant digits of tried values: the YAML contains exactly what was driven."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """A parameter to search, and the parameters tied to it."""

    name: str
    """Full current name of the parameter: `DWAPlannerROS/sim_time`."""
    kind: Kind
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[Value, ...] = ()
    """The values of a choice; for a number, the values of a grid, if given."""
    ties: tuple[tuple[str, float], ...] = ()
    """Further parameters (full name, factor), set to the value times the factor."""
    present: Value | None = None
    start: Value | None = None
    """Recommended first value."""
    unit: str = ""
    meaning: str = ""
    robot: bool = False
    """True for a limit of the robot itself."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that it sets."""
        return (self.name, *(name for name, _ in self.ties))

    def clean(self, value: Value) -> Value:
        """The value as tried and written: within the range, of the right type, rounded."""
        if self.kind == "choice":
            return value
        bounded = min(max(float(value), self.low), self.high)
        if self.kind == "int":
            return min(max(round(bounded), math.ceil(self.low)), math.floor(self.high))
        rounded = float(f"{bounded:.{DIGITS}g}")
        return rounded if self.low <= rounded <= self.high else bounded

    def settings(self, value: Value) -> Iterator[tuple[str, Value]]:
        """(full name, value) of every parameter that it sets."""
        yield self.name, value
        for name, factor in self.ties:
            yield name, (value if isinstance(value, (bool, str)) or factor == 1.0 else value * factor)

    def at(self, share: float) -> Value:
        """The value at a share in [0, 1] of the range (on its scale) or of the choices."""
        if self.kind == "choice":
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.kind == "int":
            # every integer gets the same share
            low, high = math.ceil(self.low), math.floor(self.high)
            if self.log:
                return self.clean(math.exp(math.log(low) + share * math.log(high / low)))
            return min(low + int(share * (high - low + 1)), high)
        if self.log:
            return self.clean(math.exp(math.log(self.low) + share * math.log(self.high / self.low)))
        return self.clean(self.low + share * (self.high - self.low))

    def grid(self, points: int) -> list[Value]:
        """The given values, every choice, or `points` values over the range."""
        if self.choices:
            return list(self.choices)
        if points == 1:
            return [self.at(0.5)]
        if self.kind == "int":
            low, high = math.ceil(self.low), math.floor(self.high)
            points = min(points, high - low + 1)
            shares = [i / max(points - 1, 1) for i in range(points)]
            if self.log:
                values = [self.clean(low * (high / low) ** share) for share in shares]
            else:
                values = [self.clean(low + (high - low) * i / max(points - 1, 1)) for i in range(points)]
        else:
            values = [self.at(i / (points - 1)) for i in range(points)]
        return list(dict.fromkeys(values))

    def described(self) -> dict[str, Any]:
        """Everything that determines its values, for JSON."""
        document: dict[str, Any] = {"kind": self.kind}
        if self.kind == "choice" or self.choices:
            document["choices"] = list(self.choices)
        if self.kind != "choice":
            document |= {"low": self.low, "high": self.high, "log": self.log}
        if self.ties:
            document["ties"] = dict(self.ties)
        return document

    def range_text(self) -> str:
        """`0.5 to 4 s (log)`."""
        if self.choices:
            return ", ".join(value_text(v) for v in self.choices)
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:.4g} to {self.high:.4g}{unit}{' (log)' if self.log else ''}"


Candidate = Mapping[str, Value]
"""Values by the name of the dimension."""


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """All dimensions."""

    dimensions: tuple[Dimension, ...]

    def __iter__(self) -> Iterator[Dimension]:
        return iter(self.dimensions)

    def __len__(self) -> int:
        return len(self.dimensions)

    def settings(self, candidate: Candidate) -> dict[str, Value]:
        """Every parameter that a candidate sets, by full name."""
        return {n: v for d in self.dimensions if d.name in candidate for n, v in d.settings(candidate[d.name])}

    def overrides(self, candidate: Candidate) -> list[str]:
        """The settings in the form that `load_configuration` takes."""
        return [f"{name}={value_text(value)}" for name, value in self.settings(candidate).items()]

    def present(self) -> dict[str, Value]:
        """The present values, clipped to the ranges."""
        return {
            d.name: d.clean(d.present if d.present is not None else d.at(0.5))
            if d.kind != "choice" or d.present in d.choices
            else d.choices[0]
            for d in self.dimensions
        }

    def start(self) -> dict[str, Value]:
        """The recommended first values; the present value where there is none."""
        present = self.present()
        return {d.name: d.clean(d.start) if d.start is not None else present[d.name] for d in self.dimensions}

    def described(self) -> dict[str, Any]:
        """Everything that determines the candidates, for JSON."""
        return {d.name: d.described() for d in self.dimensions}
