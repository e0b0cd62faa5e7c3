"""The search space: dimensions with their ranges, the parameters they set, and candidates drawn from it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NoReturn, get_args, get_origin

from pydantic.fields import FieldInfo

from navstack.core import InputError
from navstack.parameters import Parameter, bounds_of, value_text

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
        """Return the value as tried and written: within the range, of the right type, rounded."""
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
        """Return the value at a share in [0, 1] of the range (on its scale) or of the choices."""
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
        """Return the given values, every choice, or `points` values over the range."""
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
        """Return everything that determines its values, for JSON."""
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
        """Return every parameter that a candidate sets, by full name."""
        return {n: v for d in self.dimensions if d.name in candidate for n, v in d.settings(candidate[d.name])}

    def overrides(self, candidate: Candidate) -> list[str]:
        """Return the settings in the form that `load_configuration` takes."""
        return [f"{name}={value_text(value)}" for name, value in self.settings(candidate).items()]

    def present(self) -> dict[str, Value]:
        """Return the current values, clipped to the ranges."""
        return {
            d.name: d.clean(d.present if d.present is not None else d.at(0.5))
            if d.kind != "choice" or d.present in d.choices
            else d.choices[0]
            for d in self.dimensions
        }

    def start(self) -> dict[str, Value]:
        """Return the recommended first values; the current value where there is none."""
        present = self.present()
        return {d.name: d.clean(d.start) if d.start is not None else present[d.name] for d in self.dimensions}

    def described(self) -> dict[str, Any]:
        """Return everything that determines the candidates, for JSON."""
        return {d.name: d.described() for d in self.dimensions}


# --- dimensions of parameters -----------------------------------------------------------------------------------------


_BOUND_WORDS: Final = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
_SPEED_UNITS: Final = frozenset({"m/s", "rad/s", "m/s²", "rad/s²"})
_MARGIN: Final = 1e-6
"""Relative distance from an excluded bound (absolute from 0)."""
_WIDE: Final = 4.0
"""Derived ranges extend from the current value divided by this factor to the value times the factor."""


def without_range(parameter: Parameter, where: str) -> Dimension:
    """Return a dimension of the parameter's kind, without a range. Raises InputError for other types than numbers and choices."""
    present = parameter.value if not isinstance(parameter.value, (list, dict)) else None
    kind, choices = _kind_of(parameter, where)
    return Dimension(
        parameter.name,
        kind,
        choices=choices,
        present=present,
        unit=parameter.unit,
        meaning=parameter.info.description or "",
    )


def _kind_of(parameter: Parameter, where: str) -> tuple[Kind, tuple[Value, ...]]:
    annotation = _annotation(parameter.info)
    if annotation is bool:
        return "choice", (False, True)
    if annotation is int:
        return "int", ()
    if annotation is float:
        return "float", ()
    if annotation is str:
        return "choice", ()
    if get_origin(annotation) is Literal:
        return "choice", get_args(annotation)
    raise InputError(
        f"{where}: {parameter.name} cannot be searched: it is neither a number nor a choice",
        parameter=parameter.name,
    )


def _annotation(info: FieldInfo) -> Any:
    """Return the type of a value other than None."""
    arms = [a for a in get_args(info.annotation) if a is not type(None)]
    return arms[0] if len(arms) == 1 and get_origin(info.annotation) is not Literal else info.annotation


def _limits(info: FieldInfo) -> tuple[float, float]:
    """Return the bounds of the model; just inside of an excluded bound."""
    bounds = bounds_of(info)
    low = bounds.get("ge", -math.inf)
    high = bounds.get("le", math.inf)
    if "gt" in bounds:
        low = bounds["gt"] + (_MARGIN if bounds["gt"] == 0.0 else abs(bounds["gt"]) * _MARGIN)
    if "lt" in bounds:
        high = bounds["lt"] - (_MARGIN if bounds["lt"] == 0.0 else abs(bounds["lt"]) * _MARGIN)
    return low, high


def from_metadata(parameter: Parameter, where: str) -> Dimension:
    """Return a range derived from the model.

    The bounds of the model, if both exist and are close to the current value; otherwise from a quarter to four times the
    current value on a log scale. A speed or acceleration limit of the robot is not searched above its current value. Raises
    InputError if neither is possible.
    """
    made = without_range(parameter, where)
    if made.kind == "choice":
        if len(made.choices) < 2:
            raise InputError(
                f"{where}: {made.name} is a text; give its choices: {made.name}=A,B,..", parameter=made.name
            )
        return made
    low, high = _limits(parameter.info)
    value = float(made.present) if made.present is not None else 0.0
    if _limits_robot(made) and value > 0.0:
        return replace(made, low=max(low, value / _WIDE), high=value, robot=True)
    if math.isfinite(low) and math.isfinite(high) and (value == 0.0 or high <= _WIDE * abs(value)):
        return replace(made, low=low, high=high, log=low > 0.0 and high / low >= 100.0)
    if value == 0.0:
        raise InputError(
            f"{where}: no range is known for {made.name}, whose current value is {made.present}; give one: "
            f"{made.name}=LOW:HIGH",
            parameter=made.name,
        )
    ends = sorted((value / _WIDE, value * _WIDE))
    low, high = max(low, ends[0]), min(high, ends[1])
    if made.kind == "int":
        low, high = math.ceil(low), max(math.floor(high), math.ceil(low) + 1)
    return replace(made, low=low, high=high, log=low > 0.0)


def _limits_robot(dimension: Dimension) -> bool:
    """Return whether a larger value lets the robot drive or accelerate faster."""
    last = dimension.name.rpartition("/")[2]
    return dimension.unit in _SPEED_UNITS and last.startswith(("max_", "acc_", "decel_"))


def beyond_limit(dimension: Dimension, parameter: Parameter, factor: float) -> Dimension:
    """Return a limit of the robot, searched up to `factor` times its current value, within the bounds of the model."""
    return replace(dimension, high=max(dimension.high, min(dimension.high * factor, _limits(parameter.info)[1])))


def with_range(parameter: Parameter, low: float, high: float, log: bool, where: str) -> Dimension:
    """Return a range given by the user. Raises InputError for an empty range and one outside the bounds of the model."""
    made = without_range(parameter, where)
    name = made.name

    def refuse(reason: str) -> NoReturn:
        raise InputError(f"{where}: {reason}", parameter=name, low=low, high=high)

    if made.kind == "choice":
        refuse(f"{name} is not a number; give its choices: {name}=A,B,..")
    if not (math.isfinite(low) and math.isfinite(high)):
        refuse(f"the ends of the range of {name} must be finite")
    if low >= high:
        refuse(f"the range of {name} is empty: {low:g} is not below {high:g}; give LOW:HIGH")
    least, most = _limits(parameter.info)
    if low < least or high > most:
        ends = " and ".join(f"{_BOUND_WORDS[w]} {v:g}" for w, v in bounds_of(parameter.info).items())
        refuse(f"{name} must be {ends}{f' {made.unit}' if made.unit else ''}, not {low:g} to {high:g}")
    if log and low <= 0.0:
        refuse(f"the range of {name} starts at {low:g}, but a log scale needs values above 0; raise the lower end")
    if made.kind == "int" and math.floor(high) <= math.ceil(low):
        refuse(f"{name} takes integers, and {low:g} to {high:g} contains fewer than two; widen the range")
    return replace(made, low=low, high=high, log=log)


def with_choices(parameter: Parameter, choices: Sequence[Value], where: str) -> Dimension:
    """Choices given by the user. Raises InputError for an invalid value and for fewer than two values."""
    made = without_range(parameter, where)
    check = _checked_choice if made.kind == "choice" else _checked_number
    unique = tuple(dict.fromkeys(check(made, parameter, choice, where) for choice in choices))
    if len(unique) < 2:
        raise InputError(f"{where}: give at least two values of {made.name}", parameter=made.name)
    if made.kind == "choice":
        return replace(made, choices=unique)
    return replace(made, low=float(min(unique)), high=float(max(unique)), choices=unique)


def _checked_choice(made: Dimension, parameter: Parameter, choice: Value, where: str) -> Value:
    del parameter
    # in Python, 1 == True
    same = [c for c in made.choices if c == choice and type(c) is type(choice)]
    if made.choices and not same:
        known = ", ".join(value_text(v) for v in made.choices)
        raise InputError(f"{where}: {made.name} cannot be {value_text(choice)}; it takes {known}", parameter=made.name)
    return choice


def _checked_number(made: Dimension, parameter: Parameter, choice: Value, where: str) -> Value:
    if isinstance(choice, (bool, str)) or not math.isfinite(choice):
        raise InputError(f"{where}: {made.name} cannot be {value_text(choice)}; give numbers", parameter=made.name)
    least, most = _limits(parameter.info)
    whole = made.kind != "int" or float(choice).is_integer()
    if not (least <= choice <= most and whole):
        reason = "the value is out of range" if whole else "it takes integers"
        raise InputError(f"{where}: {made.name} cannot be {choice:g}: {reason}", parameter=made.name)
    return int(choice) if made.kind == "int" else float(choice)


def tied(dimensions: Sequence[Dimension]) -> Dimension:
    """Return one dimension that sets all of these parameters to the same value."""
    first = dimensions[0]
    ties = dict(first.ties) | {d.name: 1.0 for d in dimensions[1:]}
    for d in dimensions[1:]:
        ties |= dict(d.ties)
    return replace(first, ties=tuple((n, f) for n, f in ties.items() if n != first.name))


# --- candidates of a sweep --------------------------------------------------------------------------------------------


METHODS: Final = ("grid", "random", "lhs")
MAX_CANDIDATES: Final = 1_000_000


def candidates(space: SearchSpace, method: str, *, samples: int, points: int, seed: int) -> list[dict[str, Value]]:
    """Return the candidates of a sweep; a pure function of its arguments.

    `samples`: number of candidates for `random` and `lhs`; `points`: values per range for `grid`. Raises InputError for an
    unknown method and for a grid of more than a million candidates.
    """
    if method == "grid":
        return _grid(space, points)
    if method not in METHODS:
        raise InputError(
            f'--method "{method}": unknown method; choose {", ".join(METHODS)}', argument="--method", value=method
        )
    if samples < 1:
        raise InputError(f"--samples {samples}: give at least 1", argument="--samples", value=samples)
    shares = _random(samples, len(space), seed) if method == "random" else _latin(samples, len(space), seed)
    return [{d.name: d.at(share) for d, share in zip(space, row, strict=True)} for row in shares]


def _grid(space: SearchSpace, points: int) -> list[dict[str, Value]]:
    if points < 1:
        raise InputError(f"--points {points}: give at least 1", argument="--points", value=points)
    axes = [d.grid(points) for d in space]
    many = math.prod(len(axis) for axis in axes)
    if many > MAX_CANDIDATES:
        counts = " x ".join(str(len(axis)) for axis in axes)
        raise InputError(
            f"the grid has {counts} = {many} candidates; give fewer --points or --param, or --method lhs --samples N",
            candidates=many,
        )
    names = [d.name for d in space]
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*axes)]


def _random(samples: int, dimensions: int, seed: int) -> list[list[float]]:
    import numpy as np

    rows: list[list[float]] = np.random.Generator(np.random.PCG64(seed)).random((samples, dimensions)).tolist()
    return rows


def _latin(samples: int, dimensions: int, seed: int) -> list[list[float]]:
    import numpy as np
    from scipy.stats import qmc

    generator = np.random.Generator(np.random.PCG64(seed))
    rows: list[list[float]] = qmc.LatinHypercube(dimensions, rng=generator).random(samples).tolist()
    return rows
