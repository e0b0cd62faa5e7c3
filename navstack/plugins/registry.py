"""Registries of plugins by name and ROS alias, from this package and from the entry points of others."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar, cast

from navstack.core import UnknownPluginError
from navstack.plugins.builtin import BUILTIN

if TYPE_CHECKING:
    from navstack.plugins.behavior import RecoveryBehavior
    from navstack.plugins.costmap import Layer
    from navstack.plugins.critic import Critic
    from navstack.plugins.docking import DockDetector, DockType
    from navstack.plugins.global_planner import GlobalPlanner, Smoother
    from navstack.plugins.local_planner import LocalPlanner
    from navstack.plugins.localization import Localizer
    from navstack.plugins.path_following import GoalChecker, PathHandler, ProgressChecker

T = TypeVar("T")
C = TypeVar("C", bound="type[Any]")


@dataclass(frozen=True)  # without slots, so that `Plugin[Layer](..)` may note its type
class Plugin(Generic[T]):
    """A plugin: name, class, ROS aliases and origin and, once it is configured, namespace and parameters of the instance."""

    name: str
    """Registered name; of a configured layer, critic or behavior the name of the instance: `inflation_layer`."""
    cls: type[T]
    params: Any = None
    """Parameters, of the model `cls.Params`; None until it is configured."""
    namespace: str = ""
    """Namespace of the parameters, below move_base; empty until it is configured."""
    aliases: tuple[str, ...] = field(default=(), compare=False)
    """Further names, the ROS names among them: `navfn/NavfnROS`."""
    origin: str = field(default="navstack", compare=False)
    """`navstack`, or the distribution that registered it by entry point."""

    @property
    def ros_name(self) -> str:
        """The first ROS alias (`navfn/NavfnROS`), or the registered name."""
        return ros_name(self.name, self.aliases)

    def configured(self, params: Any, namespace: str, name: str | None = None) -> Plugin[T]:
        """Return an instance of the plugin with its parameters; `name` is that of the instance."""
        return replace(self, params=params, namespace=namespace, name=name or self.name)


def ros_name(name: str, aliases: tuple[str, ...]) -> str:
    """Return the first of the aliases that is a ROS name (`navfn/NavfnROS`), otherwise the registered name."""
    return next((alias for alias in aliases if "/" in alias), name)


def normalize(name: str) -> str:
    """Return a plugin name in one spelling: `costmap_2d::StaticLayer` and `costmap_2d/StaticLayer` are the same."""
    return name.strip().replace("::", "/")


@cache
def _entry_points() -> EntryPoints:
    """All entry points of the environment: each call would read the metadata of every distribution."""
    return cast("EntryPoints", entry_points())  # Python 3.11 returns another class with the same `select`


class Registry(Generic[T]):
    """Plugins of one kind.

    `navstack.plugins.builtin` says in which module each built-in plugin is: it is imported, and registers itself with the
    decorator, when its name is looked up. Plugins of others are found through the entry point group `navstack.<kind>s`: each
    entry is a class, its name the name of the plugin; the class attribute `PLUGIN_ALIASES` may list further names.
    """

    def __init__(self, kind: str, group: str) -> None:
        self.kind = kind
        self.group = group
        self._entries: dict[str, Plugin[T]] = {}
        """Those that are imported, by their registered names."""
        self._modules: dict[str, str] = {}
        """Registered name -> module of every built-in plugin."""
        self._lookup: dict[str, str] = {}
        """Every name and alias -> registered name."""
        self._entry_points_read = False
        for name, (module, *aliases) in BUILTIN.get(kind, {}).items():
            self._modules[name] = module
            self._lookup.update(dict.fromkeys((name, *aliases), name))

    def register(self, name: str, *, aliases: tuple[str, ...] = ()) -> Callable[[C], C]:
        """Class decorator that registers a class; see `add` for errors."""

        def decorate(cls: C) -> C:
            self.add(name, cast("type[T]", cls), aliases=aliases)
            return cls

        return decorate

    def add(self, name: str, cls: type[T], *, aliases: tuple[str, ...] = (), origin: str = "navstack") -> None:
        """Register `cls`; raise ValueError if a name or alias is already registered."""
        name, *others = (normalize(n) for n in (name, *aliases))
        if name in self._entries or self._modules.get(name) != cls.__module__:
            for n in (name, *others):
                if n in self._lookup:
                    other = self._plugin(self._lookup[n]).cls
                    raise ValueError(
                        f'the {self.kind} name "{n}" of {cls.__module__}.{cls.__qualname__} is already registered by '
                        f"{other.__module__}.{other.__qualname__}; choose another name"
                    )
        self._entries[name] = Plugin(name, cls, aliases=tuple(others), origin=origin)
        self._lookup.update(dict.fromkeys((name, *others), name))

    def get(self, name: str) -> Plugin[T]:
        """Return the plugin of a name or alias; raise UnknownPluginError with a suggestion and the known names."""
        if name not in self:
            known = [registered for registered, _ in self.names()]
            close = self.suggest(name)
            hint = f'did you mean "{close}"? ' if close else ""
            elsewhere = "".join(f"; {text}" for point, text in unknown_groups() if point == normalize(name))
            raise UnknownPluginError(
                f'unknown {self.kind} "{name}"; {hint}known: {", ".join(known) or "none"}{elsewhere}',
                kind=self.kind,
                plugin=name,
                known=known,
                suggestion=close,
            )
        return self._plugin(self._lookup[normalize(name)])

    def suggest(self, name: str) -> str | None:
        """Return the registered name or alias closest to a misspelt one."""
        self._read_entry_points()
        by_lower = {n.lower(): n for n in self._lookup}
        close = difflib.get_close_matches(normalize(name).lower(), list(by_lower), n=1, cutoff=0.6)
        return by_lower[close[0]] if close else None

    def names(self) -> list[tuple[str, tuple[str, ...]]]:
        """Return every registered name with its aliases, sorted, without importing the built-in plugins."""
        self._read_entry_points()
        found: dict[str, list[str]] = {name: [] for name in sorted(set(self._lookup.values()))}
        for alias, name in self._lookup.items():
            found[name] += [alias] if alias != name else []
        return [(name, tuple(aliases)) for name, aliases in found.items()]

    def __contains__(self, name: str) -> bool:
        if normalize(name) not in self._lookup:
            self._read_entry_points()
        return normalize(name) in self._lookup

    def __iter__(self) -> Iterator[Plugin[T]]:
        """Yield all plugins by name; imports each of them."""
        return iter([self._plugin(name) for name, _ in self.names()])

    def _plugin(self, name: str) -> Plugin[T]:
        """The plugin of a registered name, imported."""
        if name not in self._entries:
            importlib.import_module(self._modules[name])
        return self._entries[name]

    def _read_entry_points(self) -> None:
        if self._entry_points_read:
            return
        self._entry_points_read = True
        for point in _entry_points().select(group=self.group):
            cls: type[T] = point.load()
            origin = point.dist.name if point.dist else "entry point"
            self.add(point.name, cls, aliases=tuple(getattr(cls, "PLUGIN_ALIASES", ())), origin=origin)


_PREFIX: Final = "navstack."
"""Beginning of the groups of entry points."""
_OTHER_GROUPS: Final = ("navstack.behavior_tree_nodes",)
"""Groups of registries in other packages: `navstack.behavior_trees.NODES`."""


def unknown_groups() -> list[tuple[str, str]]:
    """Return name and fault of each entry point in a group `navstack.*` that no registry reads: it has no effect."""
    groups = [*(registry.group for registry in REGISTRIES), *_OTHER_GROUPS]
    foreign = sorted(group for group in _entry_points().groups if group.startswith(_PREFIX) and group not in groups)
    found: list[tuple[str, str]] = []
    for point in (p for group in foreign for p in _entry_points().select(group=group)):
        close = difflib.get_close_matches(point.group[len(_PREFIX) :], [group[len(_PREFIX) :] for group in groups], n=1)
        fix = f'did you mean "{_PREFIX}{close[0]}"?' if close else f"the groups are {', '.join(groups)}"
        origin = f" of {point.dist.name}" if point.dist else ""
        text = f'the entry point "{point.name}"{origin} has no effect: its group "{point.group}" is unknown; {fix}'
        found.append((point.name, text))
    return found


LAYERS: Registry[Layer] = Registry("costmap layer", "navstack.layers")
GLOBAL_PLANNERS: Registry[GlobalPlanner] = Registry("global planner", "navstack.global_planners")
SMOOTHERS: Registry[Smoother] = Registry("smoother", "navstack.smoothers")
LOCAL_PLANNERS: Registry[LocalPlanner] = Registry("local planner", "navstack.local_planners")
CRITICS: Registry[Critic] = Registry("critic", "navstack.critics")
GOAL_CHECKERS: Registry[GoalChecker] = Registry("goal checker", "navstack.goal_checkers")
PROGRESS_CHECKERS: Registry[ProgressChecker] = Registry("progress checker", "navstack.progress_checkers")
PATH_HANDLERS: Registry[PathHandler] = Registry("path handler", "navstack.path_handlers")
RECOVERY_BEHAVIORS: Registry[RecoveryBehavior] = Registry("recovery behavior", "navstack.recovery_behaviors")
LOCALIZERS: Registry[Localizer] = Registry("localizer", "navstack.localizers")
"""Constructor: `(params, *, seed)`."""
DOCK_TYPES: Registry[DockType] = Registry("dock type", "navstack.dock_types")
DOCK_DETECTORS: Registry[DockDetector] = Registry("dock detector", "navstack.dock_detectors")

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
    DOCK_TYPES,
    DOCK_DETECTORS,
)
