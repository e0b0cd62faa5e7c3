"""Checks across parameters: the registry of all rules, and what a rule receives and reports.

A rule is a function with the decorator `rule`: for the whole robot it takes the configuration, as a method of a parameter model
a `CheckContext`. Its docstring is its section in docs/reference/rules.md.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import FunctionType
from typing import Any, Literal, NamedTuple, TypeVar

from navstack.core import Footprint

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True)
class Issue:
    """A combination of parameters that does not work on this robot."""

    severity: Severity
    """`error`: the parameters cannot be loaded; `warning`: the robot will probably fail; `info`: worth knowing."""
    rule: str
    """Short stable name in kebab case: `scoring-scale`."""
    parameters: tuple[str, ...]
    """The parameters concerned; the first one that is written in a file gives the location.

    A name is relative to the namespace of the checked parameters (`scan/topic` for a namespace below), or to move_base's
    with a leading slash (`/local_costmap/width`).
    """
    message: str
    """What is wrong with which value, then how to fix it."""
    suggestion: str | None = None
    """The value or name to write instead."""


class Problem(NamedTuple):
    """What a rule found; the registry adds name and severity of the rule."""

    parameters: tuple[str, ...]
    """As in `Issue`."""
    message: str
    suggestion: str | None = None
    severity: Severity | None = None
    """If it differs from the rule's."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule across parameters."""

    name: str
    severity: Severity
    text: str
    """Its section of the documentation: what goes wrong, an example, the fix, threads of users."""
    module: str
    """Where it is declared."""
    check: Callable[..., Iterator[Problem]] | None = None
    """Takes the configuration of the robot; None for a rule of a parameter model."""

    def issues(self, *arguments: Any) -> Iterator[Issue]:
        """Yield what the rule finds."""
        if self.check is not None:
            for found in self.check(*arguments):
                yield Issue(
                    found.severity or self.severity, self.name, found.parameters, found.message, found.suggestion
                )


RULES: dict[str, Rule] = {}
"""All rules that are imported, by name."""

Check = TypeVar("Check", bound=Callable[..., Iterator[Problem]])


def rule(name: str, severity: Severity) -> Callable[[Check], Check]:
    """Register a rule: a function of the configuration, or a method of a parameter model; raise ValueError for a name in use."""

    def decorate(check: Check) -> Check:
        made = Rule(name, severity, inspect.cleandoc(check.__doc__ or ""), check.__module__, check)
        if next(iter(inspect.signature(check).parameters), "") == "self":
            setattr(check, _RULE, made)
            made = replace(made, check=None)
        _add_rule(made)
        return check

    return decorate


_RULE = "navstack_rule"


def document(name: str, severity: Severity, text: str, module: str) -> None:
    """Register a rule that `ParamModel.check` of a plugin declares; raise ValueError for a name in use."""
    _add_rule(Rule(name, severity, inspect.cleandoc(text), module))


def _add_rule(made: Rule) -> None:
    if made.name in RULES:
        raise ValueError(f'the rule "{made.name}" is registered already; choose another name')
    RULES[made.name] = made


def own_issues(params: object, context: CheckContext) -> Iterator[Issue]:
    """Yield what the methods of a parameter model with the decorator `rule` find."""
    members = {name: member for cls in reversed(type(params).__mro__) for name, member in vars(cls).items()}
    for member in members.values():
        found = getattr(member, _RULE, None) if isinstance(member, FunctionType) else None
        if isinstance(found, Rule):
            yield from found.issues(params, context)


@dataclass(frozen=True, slots=True)
class SensorSource:
    """An observation source of a layer."""

    topic: str
    data_type: str = "LaserScan"
    min_height: float = float("-inf")
    """Lower points are dropped (m)."""
    max_height: float = float("inf")
    """Higher points are dropped (m)."""
    marking: bool = True
    sensor_frame: str = ""
    """Frame of the sensor's origin; empty: that of the message."""
    raytrace_range: float = 0.0
    """Space farther away is not cleared (m)."""


@dataclass(frozen=True, slots=True)
class LayerTraits:
    """What a costmap layer does, as far as checks depend on it (`Layer.traits`)."""

    enabled: bool = True
    fed_by_sensors: bool = True
    """True if the layer marks obstacles from sensor data."""
    has_static_map: bool = False
    inflates: bool = False
    tracks_unknown_space: bool = False
    """True if the layer distinguishes unknown from free cells."""
    sources: Mapping[str, SensorSource] = field(default_factory=dict[str, SensorSource])
    """Observation sources by name."""


@dataclass(frozen=True, slots=True)
class LayerSetup:
    """A layer of a costmap: instance name and traits."""

    name: str
    traits: LayerTraits


@dataclass(frozen=True, slots=True)
class CostmapSetup:
    """A costmap of the robot: its parameters, padded footprint and layers in the order in which they write."""

    name: str
    robot_base_frame: str
    rolling_window: bool
    track_unknown_space: bool
    width: float
    height: float
    resolution: float
    update_frequency: float
    footprint: Footprint
    layers: tuple[LayerSetup, ...]

    def layers_after(self, name: str) -> tuple[LayerSetup, ...]:
        """The layers that write after the layer `name`."""
        names = [layer.name for layer in self.layers]
        return self.layers[names.index(name) + 1 :]


@dataclass(frozen=True, slots=True)
class CheckContext:
    """The robot around a plugin whose parameters are checked."""

    name: str
    """Instance name of the plugin."""
    ros_distro: str
    controller_frequency: float
    """Control cycles per second."""
    global_costmap: CostmapSetup
    local_costmap: CostmapSetup
    costmap: CostmapSetup
    """The costmap that a layer belongs to; the local costmap for every other plugin."""

    @property
    def costmaps(self) -> tuple[CostmapSetup, CostmapSetup]:
        """Both costmaps."""
        return self.global_costmap, self.local_costmap
