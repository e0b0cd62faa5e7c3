"""Parses a search space: `--param NAME=LOW:HIGH[:log]`, or a YAML file.

DWAPlannerROS:
  sim_time: [0.5, 4.0]                  # low, high
  occdist_scale: {low: 0.001, high: 1, log: true}
  use_dwa: {choices: [true, false]}
  vx_samples:                           # a range derived from the parameter's model
"*_costmap/inflation_layer/inflation_radius": [0.25, 1.0]   # sets all matches together
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from navstack.core.errors import InputError
from navstack.core.files import exists
from navstack.parameters.configuration import Configuration
from navstack.parameters.findings import Location
from navstack.parameters.spelling import nearest
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain, read_yaml, scalar
from navstack.tune.default_ranges import SPACES, default_space
from navstack.tune.dimensions import beyond_limit, from_metadata, tied, with_choices, with_range
from navstack.tune.parameter_lookup import ParameterLookup
from navstack.tune.space import Dimension, SearchSpace

_SYNTAX: Final = "NAME=LOW:HIGH, NAME=LOW:HIGH:log, NAME=A,B,C or NAME alone, such as DWAPlannerROS/sim_time=0.5:4.0"
_KEYS: Final = ("low", "high", "log", "choices")
_RANGE: Final = re.compile(r"[^,:]+:[^,:]+(?::[^,:]*)?\Z")


def parse_search_space(
    configuration: Configuration,
    *,
    space: str | None = None,
    params: Sequence[str] = (),
    keep: Sequence[str] = (),
    limit_factor: float = 1.0,
) -> SearchSpace:
    """The space given by `space`, with the dimensions of `params` added or replaced, without the parameters of `keep`.

    `space`: one of `default_ranges.SPACES`, or a YAML file; by default `auto`, or empty if `params` is given. Speeds and
    accelerations without a given range are searched up to `limit_factor` times their present values. Raises InputError.
    """
    lookup = ParameterLookup(configuration)
    found: dict[str, Dimension] = {}
    if space is None and not params:
        space = "auto"
    if space is not None:
        found = {dimension.name: dimension for dimension in _space(configuration, lookup, space)}
    for text in params:
        _replace(found, _from_text(lookup, text))
    for dimension in list(found.values()):
        if dimension.robot and limit_factor > 1.0:
            (parameter,) = lookup.find(dimension.name, "--limit-factor")
            found[dimension.name] = beyond_limit(dimension, parameter, limit_factor)
    for pattern in keep:
        for parameter in lookup.find(pattern, f'--keep "{pattern}"'):
            left = [_without(d, parameter.name) for d in found.values()]
            found = {d.name: d for d in left if d is not None}
    if not found:
        raise InputError(
            f"the search space is empty: there are no default ranges for the planners in use; add --param {_SYNTAX}"
        )
    _check_unique(list(found.values()))
    return SearchSpace(tuple(found.values()))


def _replace(found: dict[str, Dimension], dimension: Dimension) -> None:
    """Adds a dimension in place of those of the same parameters."""
    for name in [n for n in found if n in dimension.names]:
        old = found.pop(name)
        if name == dimension.name and not dimension.ties:
            dimension = _with_ties(dimension, old)
    found[dimension.name] = dimension


def _without(dimension: Dimension, kept: str) -> Dimension | None:
    """The dimension without one of its parameters; None if nothing remains.

    Tied parameters of the same name (the inflation radius of both costmaps) remain; a parameter that only follows another one
    (`max_vel_trans` follows `max_vel_x`) is removed with it.
    """
    if kept != dimension.name:
        return replace(dimension, ties=tuple(tie for tie in dimension.ties if tie[0] != kept))
    last = kept.rpartition("/")[2]
    others = [tie for tie in dimension.ties if tie[0].rpartition("/")[2] == last]
    return replace(dimension, name=others[0][0], ties=tuple(others[1:])) if others else None


def _with_ties(dimension: Dimension, old: Dimension) -> Dimension:
    """A given range with the ties of the default one; the user confirms the upper end of a limit of the robot."""
    if old.kind != dimension.kind:
        return dimension
    return replace(dimension, ties=old.ties, start=dimension.high if old.robot else old.start, robot=False)


def _check_unique(dimensions: Sequence[Dimension]) -> None:
    seen: dict[str, str] = {}
    for d in dimensions:
        for name in d.names:
            if name in seen:
                raise InputError(
                    f"{name} is in two dimensions, {seen[name]} and {d.name}; remove one of them", parameter=name
                )
            seen[name] = d.name


# --- files ------------------------------------------------------------------------------------------------------------


def _space(configuration: Configuration, lookup: ParameterLookup, space: str) -> Iterator[Dimension]:
    if space in SPACES:
        yield from default_space(configuration, space)
        return
    path = Path(space)
    if not exists(path):
        close = nearest(space, SPACES)
        hint = f'; did you mean "{close}"?' if close else ""
        raise InputError(
            f'--space "{space}": there is no such file, and the default ranges are {", ".join(SPACES)}{hint}',
            space=space,
        )
    read = read_yaml(path)
    errors = [f for f in read.findings if f.severity == "error"]
    if errors:
        raise InputError(f"{errors[0].location}: {errors[0].message}", file=str(path))
    yield from _entries(lookup, read.root, "")


def _entries(lookup: ParameterLookup, node: DictNode, path: str) -> Iterator[Dimension]:
    for key, (at, value) in node.items.items():
        name = f"{path}/{key}" if path else key
        if isinstance(value, DictNode) and not (set(value.items) & set(_KEYS)):
            yield from _entries(lookup, value, name)
        else:
            yield _from_node(lookup, name, at, value)


def _from_node(lookup: ParameterLookup, name: str, at: Location, node: Node) -> Dimension:
    where = str(at)
    parameters = lookup.find(name, where)
    if isinstance(node, ScalarNode) and node.value is None:
        return tied([from_metadata(p, where) for p in parameters])
    syntax = f"write {name}: [LOW, HIGH] or {{low: .., high: .., log: true}} or {{choices: [..]}}"
    if isinstance(node, ListNode):
        low, high = _ends(node, syntax)
        return tied([with_range(p, low, high, False, f"{node.at}") for p in parameters])
    if not isinstance(node, DictNode):
        raise InputError(f"{node.at}: {name} is not a range; {syntax}", parameter=name)
    for key, (key_at, _) in node.items.items():
        if key not in _KEYS:
            raise InputError(f'{key_at}: unknown key "{key}"; a range takes {", ".join(_KEYS)}', parameter=name)
    values: dict[str, Any] = {key: plain(value) for key, (_, value) in node.items.items()}
    if "choices" in values:
        if not isinstance(values["choices"], list):
            raise InputError(f"{at}: the choices of {name} must be a list; {syntax}", parameter=name)
        return tied([with_choices(p, values["choices"], where) for p in parameters])
    log = values.get("log", False)
    if not isinstance(log, bool):
        raise InputError(f"{at}: log must be true or false; {syntax}", parameter=name)
    low, high = (_number(values.get(end), f"{at}: {end} of {name}", syntax) for end in ("low", "high"))
    return tied([with_range(p, low, high, log, where) for p in parameters])


def _ends(node: ListNode, syntax: str) -> tuple[float, float]:
    if len(node.items) != 2:
        raise InputError(f"{node.at}: a range needs two numbers, not {len(node.items)}; {syntax}")
    low, high = (_number(plain(item), f"{node.at}: an end of the range", syntax) for item in node.items)
    return low, high


def _number(value: Any, what: str, syntax: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        fault = "is missing" if value is None else f'is "{value}", not a number'
        raise InputError(f"{what} {fault}; {syntax}")
    return float(value)


# --- --param ----------------------------------------------------------------------------------------------------------


def _from_text(lookup: ParameterLookup, text: str) -> Dimension:
    where = f'--param "{text}"'
    name, equals, rest = text.partition("=")
    name, rest = name.strip(), rest.strip()
    if not name or (equals and not rest):
        raise InputError(f"{where}: give {_SYNTAX}", argument="--param", value=text)
    parameters = lookup.find(name, where)
    if not equals:
        return tied([from_metadata(p, where) for p in parameters])
    if _RANGE.match(rest):
        low_text, high_text, *scale = (part.strip() for part in rest.split(":"))
        if scale and scale[0] != "log":
            raise InputError(f'{where}: unknown scale "{scale[0]}"; write LOW:HIGH or LOW:HIGH:log', value=text)
        low, high = (_number(scalar(end), where + f': "{end}"', f"give {_SYNTAX}") for end in (low_text, high_text))
        return tied([with_range(p, low, high, bool(scale), where) for p in parameters])
    choices: list[Any] = [scalar(part.strip()) for part in rest.split(",")]
    if None in choices:
        raise InputError(f"{where}: a value is missing; give {_SYNTAX}", argument="--param", value=text)
    return tied([with_choices(p, choices, where) for p in parameters])
