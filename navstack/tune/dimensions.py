"""Makes dimensions of parameters: from the metadata of their models, from a range, or from choices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, Literal, NoReturn, get_args, get_origin

from pydantic.fields import FieldInfo

from navstack.core.errors import InputError
from navstack.parameters.model_fields import bounds_of
from navstack.parameters.report import Parameter, value_text
from navstack.tune.space import Dimension, Kind, Value

_BOUND_WORDS: Final = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
_SPEED_UNITS: Final = frozenset({"m/s", "rad/s", "m/s²", "rad/s²"})
_MARGIN: Final = 1e-6
"""Relative distance from an excluded bound (absolute from 0)."""
_WIDE: Final = 4.0
"""Derived ranges extend from the present value divided by this factor to the value times the factor."""


def without_range(parameter: Parameter, where: str) -> Dimension:
    """A dimension of the parameter's kind, without a range. Raises InputError for other types than numbers and choices."""
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
    """The type of a value other than None."""
    arms = [a for a in get_args(info.annotation) if a is not type(None)]
    return arms[0] if len(arms) == 1 and get_origin(info.annotation) is not Literal else info.annotation


def _limits(info: FieldInfo) -> tuple[float, float]:
    """The bounds of the model; just inside of an excluded bound."""
    bounds = bounds_of(info)
    low = bounds.get("ge", -math.inf)
    high = bounds.get("le", math.inf)
    if "gt" in bounds:
        low = bounds["gt"] + (_MARGIN if bounds["gt"] == 0.0 else abs(bounds["gt"]) * _MARGIN)
    if "lt" in bounds:
        high = bounds["lt"] - (_MARGIN if bounds["lt"] == 0.0 else abs(bounds["lt"]) * _MARGIN)
    return low, high


def from_metadata(parameter: Parameter, where: str) -> Dimension:
    """A range derived from the model.

    The bounds of the model, if both exist and are close to the present value; otherwise from a quarter to four times the
    present value on a log scale. A speed or acceleration limit of the robot is not searched above its present value. Raises
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
            f"{where}: no range is known for {made.name}, whose present value is {made.present}; give one: "
            f"{made.name}=LOW:HIGH",
            parameter=made.name,
        )
    ends = sorted((value / _WIDE, value * _WIDE))
    low, high = max(low, ends[0]), min(high, ends[1])
    if made.kind == "int":
        low, high = math.ceil(low), max(math.floor(high), math.ceil(low) + 1)
    return replace(made, low=low, high=high, log=low > 0.0)


def _limits_robot(dimension: Dimension) -> bool:
    """Whether a larger value lets the robot drive or accelerate faster."""
    last = dimension.name.rpartition("/")[2]
    return dimension.unit in _SPEED_UNITS and last.startswith(("max_", "acc_", "decel_"))


def beyond_limit(dimension: Dimension, parameter: Parameter, factor: float) -> Dimension:
    """A limit of the robot, searched up to `factor` times its present value, within the bounds of the model."""
    return replace(dimension, high=max(dimension.high, min(dimension.high * factor, _limits(parameter.info)[1])))


def with_range(parameter: Parameter, low: float, high: float, log: bool, where: str) -> Dimension:
    """A range given by the user. Raises InputError for an empty range and one outside the bounds of the model."""
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
    """One dimension that sets all of these parameters to the same value."""
    first = dimensions[0]
    ties = dict(first.ties) | {d.name: 1.0 for d in dimensions[1:]}
    for d in dimensions[1:]:
        ties |= dict(d.ties)
    return replace(first, ties=tuple((n, f) for n, f in ties.items() if n != first.name))
