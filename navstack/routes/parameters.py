"""Parameters of nav2_route's server -> graph, edge scorers, operations. Names as in Nav2, sections nested or with dots."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from navstack.core import ParameterError, UnknownPluginError, short_repr
from navstack.plugins import ParamModel
from navstack.routes.route import RouteParams
from navstack.routes.scorers import SCORERS, EdgeScorer
from navstack.routes.tracking import DEFAULT_OPERATIONS, OPERATIONS, RouteOperation

M = TypeVar("M", bound=ParamModel)
T = TypeVar("T")

_DEFAULT_SCORERS: Final = ("DistanceScorer", "DynamicEdgesScorer")
LISTS: Final = ("edge_cost_functions", "operations")
_NO_EFFECT: Final = frozenset(
    [
        "base_frame",
        "route_frame",
        "costmap_topic",
        "graph_file_loader",
        "graph_filepath",
        "max_planning_time",
        "tracker_update_rate",
        "use_sim_time",
    ]
)
"""What Nav2's node reads about ROS, files and rates."""


def nested(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with dotted names (`D.weight`) as nested mappings."""
    found: dict[str, Any] = {}
    for name, value in parameters.items():
        section, dot, key = str(name).partition(".")
        if dot or isinstance(value, Mapping):
            inner: dict[str, Any] = {key: value} if dot else dict(value)
            found.setdefault(section, {}).update(inner)
        else:
            found[name] = value
    return found


def read_model(model: type[M], values: Mapping[str, Any], where: str) -> M:
    """Return the values as a model. Raises ParameterError for an unknown name or a wrong value."""
    try:
        return model.model_validate(dict(values))
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        name = ".".join(str(part) for part in error["loc"])
        if error["type"] == "extra_forbidden":
            close = difflib.get_close_matches(name, model.model_fields, 1, 0.6)
            hint = (
                f"did you mean {close[0]}?" if close else f"it knows {', '.join(model.model_fields) or 'no parameters'}"
            )
            raise ParameterError(f"{where} has no parameter {name}; {hint}", parameter=name) from None
        raise ParameterError(
            f"{where}: {name} is {short_repr(error['input'])}: {error['msg']}", parameter=name
        ) from None


def read_plugins(
    values: Mapping[str, Any], key: str, default: Sequence[str], known: Mapping[str, type[T]]
) -> list[tuple[str, type[T], dict[str, Any]]]:
    """Return (name, class, parameters) of the plugins that `key` lists. Raises ParameterError, UnknownPluginError."""
    names = values.get(key, list(default))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ParameterError(f"{key} is {short_repr(names)}; write a list of names", parameter=key)
    found: list[tuple[str, type[T], dict[str, Any]]] = []
    for name in names:
        section = values.get(name, {})
        if not isinstance(section, Mapping):
            raise ParameterError(f"{name} is {short_repr(section)}; write its parameters below it", parameter=name)
        section = dict(section)
        kind = section.pop("plugin", name if name in known else None)
        cls = known.get(str(kind).replace("::", "/").rsplit("/", 1)[-1])
        if cls is None:
            what = (
                f"{name}.plugin is missing"
                if kind is None
                else f"{name}.plugin is {short_repr(kind)}, which is unknown"
            )
            raise UnknownPluginError(f"{what}; known: {', '.join(known)}", parameter=f"{name}.plugin")
        found.append((name, cls, section))
    return found


def read_operations(parameters: Mapping[str, Any]) -> list[RouteOperation]:
    """Return the operations of the parameters of the server. Raises ParameterError for what is unknown or has the wrong type."""
    listed = read_plugins(nested(parameters), LISTS[1], DEFAULT_OPERATIONS, OPERATIONS)
    return [cls(read_model(cls.Params, section, name), name) for name, cls, section in listed]


def read_scorers(parameters: Mapping[str, Any]) -> tuple[RouteParams, list[EdgeScorer]]:
    """Return the parameters of the server and its edge scorers.

        read_scorers({"edge_cost_functions": ["D"], "D.plugin": "nav2_route::DistanceScorer", "D.weight": 2.0})

    Raises ParameterError for what is unknown or has the wrong type.
    """
    values = nested(parameters)
    scorers: list[EdgeScorer] = [
        cls(read_model(cls.Params, section, name), name)
        for name, cls, section in read_plugins(values, LISTS[0], _DEFAULT_SCORERS, SCORERS)
    ]
    listed = {name for key in LISTS for name in values.get(key, ())} | {
        *LISTS,
        *_NO_EFFECT,
        *_DEFAULT_SCORERS,
        *DEFAULT_OPERATIONS,
    }
    own = {name: value for name, value in values.items() if name not in listed}
    return read_model(RouteParams, own, "the route server"), scorers
