"""A search space as users write it: `--param NAME=LOW:HIGH[:log]`, or a YAML file.

DWAPlannerROS:
  sim_time: [0.5, 4.0]                  # from, to
  occdist_scale: {low: 0.001, high: 1, log: true}
  use_dwa: {choices: [true, false]}
  vx_samples:                           # the model's own range
"*_costmap/inflation_layer/inflation_radius": [0.25, 1.0]   # all of them together
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from navstack.core.errors import InputError
from navstack.core.files import exists
from navstack.parameters.configuration import Configuration
from navstack.parameters.findings import Location
from navstack.parameters.spelling import nearest
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain, read_yaml, scalar
from navstack.tune.ready_made import SPACES
from navstack.tune.space import (
    Dimension,
    Known,
    SearchSpace,
    from_metadata,
    ready_made_space,
    together,
    with_choices,
    with_range,
)

_SHAPE = "NAME=LOW:HIGH, NAME=LOW:HIGH:log, NAME=A,B,C or NAME alone, such as DWAPlannerROS/sim_time=0.5:4.0"
_KEYS = ("low", "high", "log", "choices")
_RANGE = re.compile(r"[^,:]+:[^,:]+(?::[^,:]*)?\Z")


def search_space(
    configuration: Configuration,
    *,
    space: str | None = None,
    params: Sequence[str] = (),
    keep: Sequence[str] = (),
) -> SearchSpace:
    """The space that `space` names or holds, with `params` added or replaced and `keep` left as they are.

    `space`: one of `ready_made.SPACES`, or a YAML file; `auto` when neither it nor `params` are given. Raises InputError.
    """
    known = Known(configuration)
    found: dict[str, Dimension] = {}
    if space is None:
        space = None if params else "auto"
    if space is not None:
        for dimension in _named(configuration, known, space):
            found[dimension.name] = dimension
    for text in params:
        dimension = _from_text(known, text)
        # what is given replaces what was there for the same parameters
        for name in [n for n in found if n in dimension.names]:
            old = found.pop(name)
            if name == dimension.name and not dimension.ties:
                dimension = _with_ties(dimension, old)
        found[dimension.name] = dimension
    for pattern in keep:
        for parameter in known.find(pattern, f'--keep "{pattern}"'):
            left = [_without(d, parameter.name) for d in found.values()]
            found = {d.name: d for d in left if d is not None}
    if not found:
        raise InputError(
            "there is nothing to search: no ready-made ranges for the planners in use; give some by --param " + _SHAPE
        )
    _once(list(found.values()))
    return SearchSpace(tuple(found.values()))


def _without(dimension: Dimension, kept: str) -> Dimension | None:
    """What is left of a dimension when one of its parameters is left alone; None: nothing.

    Parameters of one name (both costmaps' inflation radius) go on without it; what only follows another one (`max_vel_trans`
    the speed ahead) stays with the one it follows.
    """
    if kept != dimension.name:
        return replace(dimension, ties=tuple(tie for tie in dimension.ties if tie[0] != kept))
    last = kept.rpartition("/")[2]
    others = [tie for tie in dimension.ties if tie[0].rpartition("/")[2] == last]
    return replace(dimension, name=others[0][0], ties=tuple(others[1:])) if others else None


def _with_ties(dimension: Dimension, old: Dimension) -> Dimension:
    """A range that was given, with what the ready-made one knows besides: of the robot's limits, the upper end is vouched for."""
    if old.kind != dimension.kind:
        return dimension
    return replace(dimension, ties=old.ties, start=dimension.high if old.robot else old.start, robot=False)


def _once(dimensions: Sequence[Dimension]) -> None:
    seen: dict[str, str] = {}
    for d in dimensions:
        for name in d.names:
            if name in seen:
                raise InputError(
                    f"{name} is searched twice, by {seen[name]} and by {d.name}; leave one out", parameter=name
                )
            seen[name] = d.name


def _named(configuration: Configuration, known: Known, space: str) -> Iterator[Dimension]:
    if space in SPACES:
        yield from ready_made_space(configuration, space)
        return
    path = Path(space)
    if not exists(path):
        close = nearest(space, SPACES)
        hint = f'; did you mean "{close}"?' if close else ""
        raise InputError(
            f'--space "{space}": there is no such file, and the ready-made ones are {", ".join(SPACES)}{hint}',
            space=space,
        )
    read = read_yaml(path)
    errors = [f for f in read.findings if f.severity == "error"]
    if errors:
        raise InputError(f"{errors[0].location}: {errors[0].message}", file=str(path))
    yield from _entries(known, read.root, "")


def _entries(known: Known, node: DictNode, path: str) -> Iterator[Dimension]:
    for key, (at, value) in node.items.items():
        name = f"{path}/{key}" if path else key
        if isinstance(value, DictNode) and not (set(value.items) & set(_KEYS)):
            yield from _entries(known, value, name)
        else:
            yield _from_node(known, name, at, value)


def _from_node(known: Known, name: str, at: Location, node: Node) -> Dimension:
    where = str(at)
    parameters = known.find(name, where)
    if isinstance(node, ScalarNode) and node.value is None:
        return together([from_metadata(p, where) for p in parameters])
    shape = f"write {name}: [LOW, HIGH] or {{low: .., high: .., log: true}} or {{choices: [..]}}"
    if isinstance(node, ListNode):
        low, high = _two(node, f"{node.at}", shape)
        return together([with_range(p, low, high, False, f"{node.at}") for p in parameters])
    if not isinstance(node, DictNode):
        raise InputError(f"{node.at}: {name} is no range; {shape}", parameter=name)
    for key, (key_at, _) in node.items.items():
        if key not in _KEYS:
            raise InputError(f'{key_at}: a range has no "{key}"; it takes {", ".join(_KEYS)}', parameter=name)
    given: dict[str, Any] = {key: plain(value) for key, (_, value) in node.items.items()}
    if "choices" in given:
        if not isinstance(given["choices"], list):
            raise InputError(f"{at}: the choices of {name} are a list; {shape}", parameter=name)
        return together([with_choices(p, given["choices"], where) for p in parameters])
    log = given.get("log", False)
    if not isinstance(log, bool):
        raise InputError(f"{at}: log is true or false; {shape}", parameter=name)
    low, high = (_number(given.get(end), f"{at}: {end} of {name}", shape) for end in ("low", "high"))
    return together([with_range(p, low, high, log, where) for p in parameters])


def _two(node: ListNode, where: str, shape: str) -> tuple[float, float]:
    if len(node.items) != 2:
        raise InputError(f"{where}: a range has two ends, not {len(node.items)}; {shape}")
    low, high = (_number(plain(item), f"{where}: an end", shape) for item in node.items)
    return low, high


def _number(value: Any, what: str, shape: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        said = "is missing" if value is None else f'is "{value}", no number'
        raise InputError(f"{what} {said}; {shape}")
    return float(value)


def _from_text(known: Known, text: str) -> Dimension:
    where = f'--param "{text}"'
    name, equals, rest = text.partition("=")
    name, rest = name.strip(), rest.strip()
    if not name or (equals and not rest):
        raise InputError(f"{where}: give {_SHAPE}", argument="--param", value=text)
    parameters = known.find(name, where)
    if not equals:
        return together([from_metadata(p, where) for p in parameters])
    if _RANGE.match(rest):
        low_text, high_text, *scale = (part.strip() for part in rest.split(":"))
        if scale and scale[0] != "log":
            raise InputError(f'{where}: the scale "{scale[0]}" is none; write LOW:HIGH or LOW:HIGH:log', value=text)
        low, high = (_number(scalar(end), where + f': "{end}"', f"give {_SHAPE}") for end in (low_text, high_text))
        return together([with_range(p, low, high, bool(scale), where) for p in parameters])
    choices: list[Any] = [scalar(part.strip()) for part in rest.split(",")]
    if None in choices:
        raise InputError(f"{where}: a value is missing; give {_SHAPE}", argument="--param", value=text)
    return together([with_choices(p, choices, where) for p in parameters])
