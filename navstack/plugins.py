"""Registries of plugins by name and ROS alias, from this package and from the entry points of others."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Generic, NamedTuple, TypeVar, cast

from navstack.core.errors import UnknownPluginError
from navstack.interfaces import (
    Critic,
    GlobalPlanner,
    GoalChecker,
    Layer,
    Localizer,
    LocalPlanner,
    PathHandler,
    ProgressChecker,
    RecoveryBehavior,
    Smoother,
)

T = TypeVar("T")
C = TypeVar("C", bound="type[Any]")


@dataclass(frozen=True, slots=True)
class PluginEntry(Generic[T]):
    """A registered plugin."""

    name: str
    cls: type[T]
    aliases: tuple[str, ...]
    origin: str
    """`navstack`, or the distribution that registered it by entry point."""

    @property
    def ros_name(self) -> str:
        """The first ROS alias (`navfn/NavfnROS`), or the registered name."""
        return next((a for a in self.aliases if "/" in a), self.name)


class PluginChoice(NamedTuple, Generic[T]):
    """A plugin to be made: instance name, class and parameters."""

    name: str
    """Instance name: the namespace of a layer or recovery behavior, the registered name of a planner."""
    cls: type[T]
    params: Any
    """Parameters, of the model `cls.Params`."""
    namespace: str = ""
    """Namespace of the parameters, below move_base."""


def normalize(name: str) -> str:
    """Return a plugin name in one spelling: `costmap_2d::StaticLayer` and `costmap_2d/StaticLayer` are the same."""
    return name.strip().replace("::", "/")


class Registry(Generic[T]):
    """Plugins of one kind.

    Built-in plugins register themselves with a decorator when their package is imported, which happens at the first
    look-up. Plugins of others are found through the entry point group `navstack.<kind>s`: each entry is a class, its name
    the name of the plugin. The class attribute `PLUGIN_ALIASES` may list further names.
    """

    def __init__(self, kind: str, group: str, package: str) -> None:
        self.kind = kind
        self.group = group
        self._package = package
        self._entries: dict[str, PluginEntry[T]] = {}
        self._lookup: dict[str, str] = {}
        self._loaded = False

    def register(self, name: str, *, aliases: tuple[str, ...] = ()) -> Callable[[C], C]:
        """Class decorator that registers a class; see `add` for errors."""

        def decorate(cls: C) -> C:
            self.add(name, cast("type[T]", cls), aliases=aliases)
            return cls

        return decorate

    def add(self, name: str, cls: type[T], *, aliases: tuple[str, ...] = (), origin: str = "navstack") -> None:
        """Register `cls`; raise ValueError if a name or alias is already registered."""
        names = [normalize(n) for n in (name, *aliases)]
        for n in names:
            taken = self._lookup.get(n)
            if taken is not None:
                other = self._entries[taken].cls
                raise ValueError(
                    f'the {self.kind} name "{n}" of {cls.__module__}.{cls.__qualname__} is already registered by '
                    f"{other.__module__}.{other.__qualname__}; choose another name"
                )
        self._entries[names[0]] = PluginEntry(names[0], cls, tuple(names[1:]), origin)
        for n in names:
            self._lookup[n] = names[0]

    def get(self, name: str) -> PluginEntry[T]:
        """Return the plugin of a name or alias; raise UnknownPluginError with a suggestion and the known names."""
        self._load()
        found = self._lookup.get(normalize(name))
        if found is None:
            known = sorted(self._entries)
            close = self.suggest(name)
            hint = f'did you mean "{close}"? ' if close else ""
            raise UnknownPluginError(
                f'unknown {self.kind} "{name}"; {hint}known: {", ".join(known) or "none"}',
                kind=self.kind,
                plugin=name,
                known=known,
                suggestion=close,
            )
        return self._entries[found]

    def suggest(self, name: str) -> str | None:
        """Return the registered name or alias closest to a misspelt one."""
        self._load()
        by_lower = {n.lower(): n for n in self._lookup}
        close = difflib.get_close_matches(normalize(name).lower(), list(by_lower), n=1, cutoff=0.6)
        return by_lower[close[0]] if close else None

    def __contains__(self, name: str) -> bool:
        self._load()
        return normalize(name) in self._lookup

    def __iter__(self) -> Iterator[PluginEntry[T]]:
        self._load()
        return iter(sorted(self._entries.values(), key=lambda e: e.name))

    def _load(self) -> None:
        if self._loaded:
            return
        self._loaded = True
        importlib.import_module(self._package)
        for point in entry_points(group=self.group):
            cls: type[T] = point.load()
            origin = point.dist.name if point.dist else "entry point"
            self.add(point.name, cls, aliases=tuple(getattr(cls, "PLUGIN_ALIASES", ())), origin=origin)


LAYERS: Registry[Layer] = Registry("costmap layer", "navstack.layers", "navstack.costmap")
GLOBAL_PLANNERS: Registry[GlobalPlanner] = Registry(
    "global planner", "navstack.global_planners", "navstack.global_planner"
)
LOCAL_PLANNERS: Registry[LocalPlanner] = Registry("local planner", "navstack.local_planners", "navstack.local_planner")
CRITICS: Registry[Critic] = Registry("critic", "navstack.critics", "navstack.local_planner")
RECOVERY_BEHAVIORS: Registry[RecoveryBehavior] = Registry(
    "recovery behavior", "navstack.recovery_behaviors", "navstack.recovery"
)

LOCALIZERS: Registry[Localizer] = Registry("localizer", "navstack.localizers", "navstack.localization")
"""Constructor: `(params, *, seed)`."""

SMOOTHERS: Registry[Smoother] = Registry("smoother", "navstack.smoothers", "navstack.smoother")

GOAL_CHECKERS: Registry[GoalChecker] = Registry("goal checker", "navstack.goal_checkers", "navstack.local_planner")
PROGRESS_CHECKERS: Registry[ProgressChecker] = Registry(
    "progress checker", "navstack.progress_checkers", "navstack.local_planner"
)
PATH_HANDLERS: Registry[PathHandler] = Registry("path handler", "navstack.path_handlers", "navstack.local_planner")

REGISTRIES: tuple[Registry[Any], ...] = (
    LAYERS,
    GLOBAL_PLANNERS,
    SMOOTHERS,
    LOCAL_PLANNERS,
    CRITICS,
    GOAL_CHECKERS,
    PROGRESS_CHECKERS,
    PATH_HANDLERS,
    RECOVERY_BEHAVIORS,
    LOCALIZERS,
)
