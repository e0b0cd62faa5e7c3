"""What is searched: parameters with their ranges, from the models' metadata, ready-made, or given."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel
from navstack.parameters.configuration import Configuration
from navstack.parameters.model_fields import bounds_of
from navstack.parameters.report import Parameter, parameters_of
from navstack.parameters.spelling import nearest
from navstack.tune import ready_made
from navstack.tune.ready_made import Choice, Range

Value = float | int | bool | str
Kind = Literal["float", "int", "choice"]

DIGITS = 4
"""Significant digits of a value that is tried: what was driven is what the YAML says."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """One thing to search: a parameter, and those that go with it."""

    name: str
    """Full name of the parameter, as of today: `DWAPlannerROS/sim_time`."""
    kind: Kind
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[Value, ...] = ()
    """For a choice; for a number, the values that a grid takes, where they were given."""
    ties: tuple[tuple[str, float], ...] = ()
    """Further parameters, full names, set to the value times a factor."""
    present: Value | None = None
    start: Value | None = None
    """Where someone with experience would begin."""
    unit: str = ""
    meaning: str = ""
    robot: bool = False
    """A limit of the robot itself."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that it sets."""
        return (self.name, *(name for name, _ in self.ties))

    def clean(self, value: Value) -> Value:
        """A value as it is tried and written: in the range, of the right type, with few digits."""
        if self.kind == "choice":
            return value
        bounded = min(max(float(value), self.low), self.high)
        if self.kind == "int":
            return min(max(round(bounded), math.ceil(self.low)), math.floor(self.high))
        rounded = float(f"{bounded:.{DIGITS}g}")
        return rounded if self.low <= rounded <= self.high else bounded

    def settings(self, value: Value) -> Iterator[tuple[str, Value]]:
        """(full name, value) of everything it sets."""
        yield self.name, value
        for name, factor in self.ties:
            yield name, (value if isinstance(value, (bool, str)) or factor == 1.0 else value * factor)

    def at(self, share: float) -> Value:
        """The value at a share in [0, 1] of the range, on its scale; of a choice, the one there."""
        if self.kind == "choice":
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.kind == "int":
            # every whole number gets the same share
            low, high = math.ceil(self.low), math.floor(self.high)
            if self.log:
                return self.clean(math.exp(math.log(low) + share * math.log(high / low)))
            return min(low + int(share * (high - low + 1)), high)
        if self.log:
            return self.clean(math.exp(math.log(self.low) + share * math.log(self.high / self.low)))
        return self.clean(self.low + share * (self.high - self.low))

    def grid(self, points: int) -> list[Value]:
        """Values from end to end: those given, every choice, or `points` of the range."""
        if self.choices:
            return list(self.choices)
        if points == 1:
            return [self.at(0.5)]
        if self.kind == "int":
            low, high = math.ceil(self.low), math.floor(self.high)
            points = min(points, high - low + 1)
            values = [self.clean(low + (high - low) * i / max(points - 1, 1)) for i in range(points)]
            if self.log:
                values = [self.clean(low * (high / low) ** (i / max(points - 1, 1))) for i in range(points)]
        else:
            values = [self.at(i / (points - 1)) for i in range(points)]
        return list(dict.fromkeys(values))

    def described(self) -> dict[str, Any]:
        """For JSON: what decides the values it can take."""
        told: dict[str, Any] = {"kind": self.kind}
        if self.kind == "choice" or self.choices:
            told["choices"] = list(self.choices)
        if self.kind != "choice":
            told |= {"low": self.low, "high": self.high, "log": self.log}
        if self.ties:
            told["ties"] = dict(self.ties)
        return told

    def range_text(self) -> str:
        """`0.5 to 4 s (log)`."""
        if self.choices:
            return ", ".join(value_of(v) for v in self.choices)
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:.4g} to {self.high:.4g}{unit}{' (log)' if self.log else ''}"


Candidate = Mapping[str, Value]
"""Values by the name of a dimension."""


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """All that is searched."""

    dimensions: tuple[Dimension, ...]

    def __iter__(self) -> Iterator[Dimension]:
        return iter(self.dimensions)

    def __len__(self) -> int:
        return len(self.dimensions)

    def settings(self, candidate: Candidate) -> dict[str, Value]:
        """Every parameter that a candidate sets, by full name."""
        return {n: v for d in self.dimensions if d.name in candidate for n, v in d.settings(candidate[d.name])}

    def overrides(self, candidate: Candidate) -> list[str]:
        """The same as `load_configuration` takes it."""
        return [f"{name}={value_of(value)}" for name, value in self.settings(candidate).items()]

    def present(self) -> dict[str, Value]:
        """The present values, brought into the ranges."""
        return {
            d.name: d.clean(d.present if d.present is not None else d.at(0.5))
            if d.kind != "choice" or d.present in d.choices
            else d.choices[0]
            for d in self.dimensions
        }

    def start(self) -> dict[str, Value]:
        """Where someone with experience would begin; the present value where nothing is known."""
        present = self.present()
        return {d.name: d.clean(d.start) if d.start is not None else present[d.name] for d in self.dimensions}

    def described(self) -> dict[str, Any]:
        """For JSON."""
        return {d.name: d.described() for d in self.dimensions}


def value_of(value: Value) -> str:
    """A value as YAML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)


# --- the parameters there are -----------------------------------------------------------------------------------------


def _models(c: Configuration) -> Iterator[tuple[str, type[ParamModel]]]:
    """Namespace and model of every component in use."""
    yield "", type(c.move_base)
    for name, costmap in (("global_costmap", c.global_costmap), ("local_costmap", c.local_costmap)):
        yield name, type(costmap.params)
        yield from ((layer.namespace, type(layer.params)) for layer in costmap.layers)
    yield from ((p.namespace, type(p.params)) for p in (c.global_planner, c.local_planner))
    yield from ((r.namespace, type(r.params)) for r in c.recoveries)


class Known:
    """The parameters of a configuration, found by what users write."""

    def __init__(self, configuration: Configuration) -> None:
        self.configuration = configuration
        self.parameters = {p.name: p for p in parameters_of(configuration)}
        self.former = {
            f"{path}/{old}".lstrip("/"): f"{path}/{new}".lstrip("/")
            for path, model in _models(configuration)
            for old, new in model.RENAMED.items()
        }

    def find(self, pattern: str, where: str) -> list[Parameter]:
        """Those of a full name, a former name, a last part that only one has, or a pattern with * and ?.

        Raises InputError with what was meant; `where` begins the message.
        """
        name = "/".join(part for part in pattern.split("/") if part)
        name = self.former.get(name, name)
        if name in self.parameters:
            found = [name]
        elif any(sign in name for sign in "*?["):
            found = [p for p in self.parameters if fnmatch.fnmatchcase(p, name)]
            if not found:
                raise InputError(
                    f'{where}: no parameter matches "{pattern}"; `navstack params show` lists them', parameter=pattern
                )
        else:
            found = [p for p in self.parameters if p.rpartition("/")[2] == name and "/" not in name]
            found = found or [new for old, new in self.former.items() if old.rpartition("/")[2] == name]
            if len(found) > 1:
                raise InputError(
                    f'{where}: several parameters are called "{pattern}": {", ".join(found)}; give the full name of one, '
                    f'or "*/{name}" for all of them together',
                    parameter=pattern,
                    found=found,
                )
            if not found:
                raise self._unknown(pattern, name, where)
        for one in found:
            if self.parameters[one].remark:
                remark = self.parameters[one].remark
                raise InputError(f"{where}: {one} cannot be searched: {remark}", parameter=one)
        return [self.parameters[n] for n in found]

    def _unknown(self, pattern: str, name: str, where: str) -> InputError:
        last = name.rpartition("/")[2]
        same = [p for p in self.parameters if p.rpartition("/")[2] == last]
        close = same[0] if same else nearest(name, self.parameters)
        if close is None:
            lasts = {p.rpartition("/")[2]: p for p in self.parameters}
            near = nearest(last, lasts)
            close = lasts[near] if near else None
        hint = f'did you mean "{close}"?' if close else "`navstack params show` lists those there are"
        return InputError(f'{where}: there is no parameter "{pattern}" in use; {hint}', parameter=pattern, meant=close)


# --- ranges -----------------------------------------------------------------------------------------------------------


def _annotation(info: FieldInfo) -> Any:
    """The type of a value that is there."""
    arms = [a for a in get_args(info.annotation) if a is not type(None)]
    return arms[0] if len(arms) == 1 and get_origin(info.annotation) is not Literal else info.annotation


def _limits(info: FieldInfo) -> tuple[float, float]:
    """What the model allows; an excluded end is moved in a little."""
    bounds = bounds_of(info)
    low = bounds.get("ge", -math.inf)
    high = bounds.get("le", math.inf)
    if "gt" in bounds:
        low = bounds["gt"] + (1e-6 if bounds["gt"] == 0.0 else abs(bounds["gt"]) * 1e-6)
    if "lt" in bounds:
        high = bounds["lt"] - (1e-6 if bounds["lt"] == 0.0 else abs(bounds["lt"]) * 1e-6)
    return low, high


def blank(parameter: Parameter, where: str) -> Dimension:
    """A dimension of a parameter's kind, without its range. Raises InputError for one that is no number and no choice."""
    info = parameter.info
    kind: Kind
    choices: tuple[Value, ...] = ()
    annotation = _annotation(info)
    if annotation is bool:
        kind, choices = "choice", (False, True)
    elif annotation is int:
        kind = "int"
    elif annotation is float:
        kind = "float"
    elif get_origin(annotation) is Literal:
        kind, choices = "choice", get_args(annotation)
    elif annotation is str:
        kind = "choice"
    else:
        raise InputError(
            f"{where}: {parameter.name} is neither a number nor a choice, so it cannot be searched",
            parameter=parameter.name,
        )
    present = parameter.value
    if isinstance(present, (list, dict)):
        present = None
    return Dimension(
        parameter.name, kind, choices=choices, present=present, unit=parameter.unit, meaning=info.description or ""
    )


def from_metadata(parameter: Parameter, where: str) -> Dimension:
    """A range for a parameter of which nothing but its model is known.

    Both ends, where the model has them and they are not far apart; else from a quarter to four times the present value,
    on a log scale.
    """
    made = blank(parameter, where)
    if made.kind == "choice":
        if len(made.choices) < 2:
            raise InputError(f"{where}: {made.name} is text; give its choices: {made.name}=A,B,..", parameter=made.name)
        return made
    low, high = _limits(parameter.info)
    value = float(made.present) if made.present is not None else 0.0
    if math.isfinite(low) and math.isfinite(high) and (value == 0.0 or high <= 4.0 * abs(value)):
        return replace(made, low=low, high=high, log=low > 0.0 and high / low >= 100.0)
    if value == 0.0:
        raise InputError(
            f"{where}: {made.name} is {made.present} now and its model knows no range to search; give one: "
            f"{made.name}=LOW:HIGH",
            parameter=made.name,
        )
    ends = sorted((value / 4.0, value * 4.0))
    low, high = max(low, ends[0]), min(high, ends[1])
    if made.kind == "int":
        low, high = math.ceil(low), max(math.floor(high), math.ceil(low) + 1)
    return replace(made, low=low, high=high, log=low > 0.0)


def with_range(
    parameter: Parameter, low: float, high: float, log: bool, where: str, points: Sequence[Value] = ()
) -> Dimension:
    """A range that the user gave. Raises InputError for one that is empty, or not within what the model allows."""
    made = blank(parameter, where)
    if made.kind == "choice":
        raise InputError(
            f"{where}: {made.name} is no number; give its choices: {made.name}=A,B,..", parameter=made.name
        )
    unit = f" {made.unit}" if made.unit else ""
    if not (math.isfinite(low) and math.isfinite(high)):
        raise InputError(f"{where}: the ends of the range of {made.name} must be finite", parameter=made.name)
    if low >= high:
        raise InputError(
            f"{where}: the range of {made.name} is empty: {low:g} is not below {high:g}; give LOW:HIGH",
            parameter=made.name,
            low=low,
            high=high,
        )
    least, most = _limits(parameter.info)
    if low < least or high > most:
        words = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
        ends = " and ".join(f"{words[w]} {v:g}" for w, v in bounds_of(parameter.info).items())
        raise InputError(
            f"{where}: {made.name} must be {ends}{unit}, not {low:g} to {high:g}",
            parameter=made.name,
            low=low,
            high=high,
        )
    if log and low <= 0.0:
        raise InputError(
            f"{where}: a log scale needs a range above 0, and {made.name} is to be from {low:g}; raise the lower end",
            parameter=made.name,
            low=low,
        )
    if made.kind == "int" and math.floor(high) <= math.ceil(low):
        raise InputError(
            f"{where}: {made.name} takes whole numbers, of which {low:g} to {high:g} holds fewer than two",
            parameter=made.name,
        )
    return replace(made, low=low, high=high, log=log, choices=tuple(points))


def with_choices(parameter: Parameter, choices: Sequence[Value], where: str) -> Dimension:
    """Values to choose from. Raises InputError for one that the parameter cannot have."""
    made = blank(parameter, where)
    cleaned: list[Value] = []
    for choice in choices:
        # to Python, 1 is True
        same = [c for c in made.choices if c == choice and type(c) is type(choice)]
        if made.kind == "choice" and made.choices and not same:
            known = ", ".join(value_of(v) for v in made.choices)
            raise InputError(
                f"{where}: {made.name} cannot be {value_of(choice)}; it takes {known}", parameter=made.name
            )
        if made.kind != "choice":
            if isinstance(choice, (bool, str)) or not math.isfinite(choice):
                raise InputError(
                    f"{where}: {made.name} cannot be {value_of(choice)}: give numbers", parameter=made.name
                )
            least, most = _limits(parameter.info)
            whole = made.kind != "int" or float(choice).is_integer()
            if not (least <= choice <= most and whole):
                raise InputError(
                    f"{where}: {made.name} cannot be {choice:g}: {'it is out of its range' if whole else 'it is whole'}",
                    parameter=made.name,
                )
            choice = int(choice) if made.kind == "int" else float(choice)
        cleaned.append(choice)
    unique = tuple(dict.fromkeys(cleaned))
    if len(unique) < 2:
        raise InputError(f"{where}: give at least two values of {made.name}", parameter=made.name)
    if made.kind == "choice":
        return replace(made, choices=unique)
    return replace(made, low=float(min(unique)), high=float(max(unique)), choices=unique)


def together(dimensions: Sequence[Dimension]) -> Dimension:
    """One dimension that sets all of these parameters to the same value."""
    first = dimensions[0]
    ties = dict(first.ties) | {d.name: 1.0 for d in dimensions[1:]}
    for d in dimensions[1:]:
        ties |= dict(d.ties)
    return replace(first, ties=tuple((n, f) for n, f in ties.items() if n != first.name))


# --- ready-made -------------------------------------------------------------------------------------------------------


def _made(parameters: Mapping[str, Parameter], name: str, ready: Range | Choice, limit: float | None) -> Dimension:
    parameter = parameters[name]
    made = blank(parameter, name)
    if isinstance(ready, Choice):
        return replace(made, choices=ready.values, start=ready.start)
    high, start = ready.high, ready.start
    if ready.robot:
        now = abs(float(made.present)) if made.present is not None else 0.0
        high = limit if limit is not None else max(high, now)
        start = max(start, now)
    path = name.rpartition("/")[0]
    ties = tuple((f"{path}/{other}", factor) for other, factor in ready.ties)
    return replace(
        made,
        low=min(ready.low, high / 2.0),
        high=high,
        log=ready.log,
        start=min(start, high),
        robot=ready.robot,
        ties=ties,
    )


def ready_made_space(configuration: Configuration, part: str = "auto") -> SearchSpace:
    """What is worth searching of the planners and costmaps in use; `part` is one of `ready_made.SPACES`."""
    parameters = {p.name: p for p in parameters_of(configuration)}
    sim = configuration.navstack.sim
    limits = {"acc_lim_x": sim.acc_lim_x, "acc_lim_theta": sim.acc_lim_theta}
    found: list[Dimension] = []
    for here, planner, table in (
        ("local_planner", configuration.local_planner, ready_made.LOCAL_PLANNERS),
        ("global_planner", configuration.global_planner, ready_made.GLOBAL_PLANNERS),
    ):
        if part in ("auto", here):
            for name, ready in table.get(planner.name, {}).items():
                made = _made(parameters, f"{planner.namespace}/{name}", ready, limits.get(name))
                if planner.name == "dwa" and planner.params.max_vel_y > 0.0:
                    made = replace(made, ties=())  # of a robot that strafes, max_vel_trans is a speed of its own
                found.append(made)
    if part in ("auto", "costmaps"):
        found += _inflation(configuration, parameters)
    return SearchSpace(tuple(found))


def _inflation(configuration: Configuration, parameters: Mapping[str, Parameter]) -> Iterator[Dimension]:
    """Both costmaps' inflation, as one where they agree now."""
    layers = {
        name: layer
        for name, costmap in (
            ("global_costmap", configuration.global_costmap),
            ("local_costmap", configuration.local_costmap),
        )
        for layer in costmap.layers
        if layer.cls.__name__ == "InflationLayer"
    }
    radius = configuration.local_costmap.footprint.inscribed_radius
    for name, ready in ready_made.LAYERS["inflation"].items():
        assert isinstance(ready, Range)
        if name == "inflation_radius":
            low = float(f"{radius + 0.01:.2g}")
            ready = ready._replace(low=low, high=max(ready.high, 3.0 * low), start=max(ready.start, 1.5 * low))
        made = [_made(parameters, f"{layer.namespace}/{name}", ready, None) for layer in layers.values()]
        if len({d.present for d in made}) == 1:
            yield together(made)
        else:
            yield from made
