"""Report every parameter and namespace that nothing read, with the name that was probably meant."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

from navstack.parameters.binding import Binder, is_value, iter_names, show
from navstack.parameters.builtin_names import BUILTIN_NAMES, PluginNames
from navstack.parameters.configuration_types import NavstackParams
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.foreign import FOREIGN_PARAMETERS, FOREIGN_PLANNERS, NAV2_NODES, REMOVED_PARAMETERS
from navstack.parameters.models.motion import MotionParams
from navstack.parameters.models.move_base import CostmapParams, MoveBaseParams
from navstack.parameters.models.sim import SimParams, WheelParams
from navstack.parameters.nodes import NODE_SECTIONS, node_model
from navstack.parameters.plugin_lists import layer_names, own_namespaces
from navstack.parameters.spelling import is_certain, nearest
from navstack.parameters.tree import COSTMAPS, Leaf, Space
from navstack.plugins import (
    BUILTIN,
    GLOBAL_PLANNERS,
    LAYERS,
    LOCAL_PLANNERS,
    RECOVERY_BEHAVIORS,
    SMOOTHERS,
    ParamModel,
    Registry,
)

# ----------------------------------------------------------------------------------------------------------------------
# All parameters of all registered plugins by namespace, to find out what an unused key was meant for.


ModelSource = Callable[[], type[ParamModel]]
"""Imports a plugin and returns its parameter model."""


@dataclass(slots=True)
class Catalog:
    """Known namespaces and parameters."""

    planners: dict[str, ModelSource] = field(default_factory=dict[str, ModelSource])
    """Namespace of every registered planner -> what imports its model."""
    layers: dict[str, list[ModelSource]] = field(default_factory=dict[str, list[ModelSource]])
    """Usual instance name of a registered layer -> models, for namespaces that no costmap lists."""
    recovery_names: set[str] = field(default_factory=set[str])
    """Every name that a recovery behavior accepts."""
    home: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Parameter name -> namespaces that read it, as a user writes them."""

    def add(self, namespace: str, model: type[ParamModel]) -> None:
        """Add the names of a model that is read in `namespace`."""
        for name in iter_names(model):
            if name not in model.NO_EFFECT and is_value(model, name):
                self._add_name(namespace, name)

    def add_plugin(self, namespace: str, names: PluginNames) -> None:
        """Add the parameters of a plugin that is not imported."""
        for name in names.values.split():
            self._add_name(namespace, name)

    def _add_name(self, namespace: str, name: str) -> None:
        places = self.home.setdefault(name, [])
        if namespace not in places:
            places.append(namespace)


def catalog_of(binder: Binder) -> Catalog:
    """Return the parameters of all registered plugins and of the namespaces that were read."""
    catalog = Catalog()
    catalog.add("move_base", MoveBaseParams)
    for name in COSTMAPS:
        catalog.add(name, CostmapParams)
    for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS, SMOOTHERS):
        for name, aliases in registry.names():
            names = _names_of(registry, name)
            namespaces = own_namespaces(name, aliases)
            for namespace in dict.fromkeys([*namespaces, *names.namespaces.split()]):
                catalog.planners[namespace] = partial(_model_of, registry, name)
            catalog.add_plugin(namespaces[0], names)
    for name, _ in LAYERS.names():
        for usual in layer_names(name):
            catalog.layers.setdefault(usual, []).append(partial(_model_of, LAYERS, name))
        catalog.add_plugin(layer_names(name)[0], _names_of(LAYERS, name))
    for name, _ in RECOVERY_BEHAVIORS.names():
        names = _names_of(RECOVERY_BEHAVIORS, name)
        catalog.recovery_names.update(names.values.split(), names.others.split())
        catalog.add_plugin(name, names)
    catalog.add("navstack", NavstackParams)
    catalog.add("navstack/sim", SimParams)
    catalog.add("navstack/sim/wheels", WheelParams)
    catalog.add("navstack/motion", MotionParams)
    for name in NODE_SECTIONS:
        if any(space.path == name for space, _ in binder.bound):
            catalog.add(name, node_model(name))
    for space, model in binder.bound:
        if space.parent is not None and space.children:
            catalog.add(space.name, model)
    return catalog


def _model_of(registry: Registry[Any], name: str) -> type[ParamModel]:
    """The parameter model of a plugin, which is imported."""
    return registry.get(name).cls.Params


def _names_of(registry: Registry[Any], name: str) -> PluginNames:
    """The names that a plugin accepts; only one of a third party is imported for that."""
    known = BUILTIN_NAMES.get(registry.kind, {}).get(name)
    if known is not None and name in BUILTIN.get(registry.kind, {}):
        return known
    model = _model_of(registry, name)
    names = list(dict.fromkeys(iter_names(model)))
    values = [n for n in names if n not in model.NO_EFFECT and is_value(model, n)]
    others = [n for n in names if n not in values]
    return PluginNames(" ".join(values), " ".join(others), " ".join(getattr(registry.get(name).cls, "NAMESPACES", ())))


MAX_GUESSES = 200
"""Names per loading for which the nearest known one is searched: a search takes time."""
_FAR = 2
"""Distance between namespaces from which on another place is an unlikely guess."""


_SURE, _LIKELY = 0.8, 0.5
"""Share of the names in a section that a model must have: for a section with the name of another planner, for others."""


def meant_sections(root: Space, binder: Binder) -> dict[Space, Space]:
    """Return the sections that nothing reads, each with the namespace without any value that has its parameters.

    The content decides, then the spelling: a section with the parameters of the selected planner is meant for it, whatever it
    is called. Each namespace that is meant is bound.
    """
    found: dict[Space, Space] = {}
    for parent in (root, *(space for name in COSTMAPS if (space := root.space(name)) is not None)):
        empty = {
            space: model
            for space, model in binder.bound
            if space.parent is parent and space.name not in (*COSTMAPS, "navstack") and not any(space.leaves())
        }
        for section in parent.children.values():
            if isinstance(section, Space) and not section.used and not _contains_used(section):
                target = _meant(section, empty)
                if target is not None:
                    found[section] = target
    return found


def _meant(section: Space, empty: Mapping[Space, type[ParamModel]]) -> Space | None:
    """The namespace that a section is meant for; None if its content does not say."""
    fits = {space: _fit(section, model) for space, model in empty.items()}
    best = max(fits.values(), default=0.0)
    planner = _planner_of(section)
    if best < (_LIKELY if planner is None else _SURE):
        return None
    if planner is not None and planner[1] is not None:
        own = _fit(section, planner[1])
        if own > best or (own == best and planner[0] == section.name):
            return None
    same = [space for space, fit in fits.items() if fit == best]
    if len(same) == 1:
        return same[0]
    name = nearest(section.name, [space.name for space in same], cutoff=0.6)
    return next((space for space in same if space.name == name), None)


def _planner_of(section: Space) -> tuple[str, type[ParamModel] | None] | None:
    """The planner or layer that a section is called like, and its model (None if it is not navstack's)."""
    if section.parent is None or section.parent.path:
        names = {usual: name for name, _ in reversed(LAYERS.names()) for usual in reversed(layer_names(name))}
        found = names.get(section.name)
        return None if found is None else (section.name, _model_of(LAYERS, found))
    planners = {
        namespace: (registry, name)
        for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS, SMOOTHERS)
        for name, aliases in registry.names()
        for namespace in own_namespaces(name, aliases)
    }
    close = nearest(section.name, [*planners, *FOREIGN_PLANNERS], cutoff=0.85)
    if close is None:
        return None
    return close, _model_of(*planners[close]) if close in planners else None


def _fit(section: Space, model: type[ParamModel]) -> float:
    """Share of the names in a section that a model has."""
    known = set(iter_names(model))
    names = [child.name for child in section.children.values()]
    return sum(name in known for name in names) / len(names) if names else 0.0


def with_consequences(found: Finding, consequences: Sequence[str]) -> Finding:
    """Return a finding that also says what the defaults cause that are in use because of it."""
    if not consequences:
        return found
    return replace(found, message=f"{found.message}. Because of its defaults: {'; '.join(dict.fromkeys(consequences))}")


MAX_NAMES = 6
"""Full names that a message about an override lists."""


def unused_parameters(
    root: Space,
    binder: Binder,
    overrides: Collection[str] = (),
    meant: Mapping[Space, Space] | None = None,
    consequences: Mapping[str, Sequence[str]] | None = None,
) -> list[Finding]:
    """Return the findings about everything in the tree that nothing read.

    `meant` are the sections of `meant_sections`, and `consequences` what the defaults of those namespaces cause.

    A value that one of the `overrides` (their names as locations) sets and that nothing reads is an error: what the user asked
    for does not happen.
    """
    check = _UnusedCheck(root, binder, meant or {}, consequences or {})
    found = check.run()
    unread = [leaf for leaf in root.leaves() if leaf.at.file in overrides and not leaf.used]
    # a section that another choice of planner reads, and a name that is kept for old files, are no errors
    explained = {f.key for f in found if f.severity == "info" and not check.is_foreign(f.key)}
    errors = [check.unread_override(leaf) for leaf in unread if not _names_within(leaf.path, explained)]
    wrong = {f.key for f in errors}
    return [f for f in found if f.file not in overrides or (f.severity == "info" and f.key not in wrong)] + errors


def _names_within(path: str, names: Collection[str]) -> bool:
    """True if a path or a namespace above it is among the names."""
    parts = path.split("/")
    return any("/".join(parts[:end]) in names for end in range(1, len(parts) + 1))


def _source(leaf: Leaf) -> Location | int:
    """What identifies a written value: its location, or itself if it has none (a Python mapping)."""
    return leaf.at if leaf.at.line else id(leaf.node)


class _UnusedCheck:
    """One pass over the tree after everything was read."""

    def __init__(
        self, root: Space, binder: Binder, meant: Mapping[Space, Space], consequences: Mapping[str, Sequence[str]]
    ) -> None:
        self.root = root
        self._meant = meant
        self._consequences = consequences
        self._binder = binder
        self.findings: list[Finding] = []
        self.read = {_source(leaf) for leaf in root.leaves() if leaf.used}
        """Values that were read in one namespace count as used in others (a file loaded into both costmaps)."""
        self.present = set(_present(root))
        """Values in namespaces that are read: those without effect are reported there."""
        self.models: dict[str, list[type[ParamModel]]] = {}
        for space, model in binder.bound:
            self.models.setdefault(space.path, []).append(model)
        self._guesses = MAX_GUESSES

    @cached_property
    def catalog(self) -> Catalog:
        """The parameters of all registered plugins: importing them takes time, so only if something is unused."""
        return catalog_of(self._binder)

    def run(self) -> list[Finding]:
        self._visit(self.root)
        return self.findings

    def is_foreign(self, namespace: str) -> bool:
        """Return True for the namespace of a planner that navstack does not have."""
        return namespace in FOREIGN_PLANNERS and namespace not in self.catalog.planners

    def unread_override(self, leaf: Leaf) -> Finding:
        """Return the error about an override that nothing reads, with the full names that exist."""
        names = {
            f"{space.path}/{name}".lstrip("/"): None
            for space, model in self._binder.bound
            for name in model.model_fields
            if name != model.CHILD_FIELD and name not in model.FROM_NAVSTACK and is_value(model, name)
        }
        *above, last = leaf.path.split("/")
        meant = [n for n in names if n.rpartition("/")[2] == last]
        if not meant:
            close = nearest(last, {n.rpartition("/")[2] for n in names})
            meant = [n for n in names if (end := n.rpartition("/")[2]) == close or end.startswith(f"{last}_")]
        # those in the namespaces that are written, if there are such
        for part in above:
            near = nearest(part, {p for n in meant for p in n.split("/")[:-1]})
            meant = [n for n in meant if near in n.split("/")[:-1]] or meant
        what = f"{leaf.path} = {show(leaf.value)} sets nothing"
        if above and self.is_foreign(above[0]):
            package = FOREIGN_PLANNERS[above[0]]
            message = f"{what}: {above[0]} belongs to the planner of {package}, which is not in use; remove it"
            return finding("error", "override", leaf.at, leaf.path, message)
        if not meant:
            message = (
                f"{what}: this robot has no parameter of that name; `navstack params show` lists those that it has"
            )
            return finding("error", "override", leaf.at, leaf.path, message)
        listed = ", ".join(meant[:MAX_NAMES]) + (
            f" and {len(meant) - MAX_NAMES} more" if len(meant) > MAX_NAMES else ""
        )
        known = "the full name is" if len(meant) == 1 else "the full names are"
        message = f"{what}: {known} {listed}; write {'it' if len(meant) == 1 else 'the one that is meant'}"
        return finding("error", "override", leaf.at, leaf.path, message, meant[0] if len(meant) == 1 else None)

    def _add(
        self,
        severity: Severity,
        rule: str,
        what: Leaf | Space,
        message: str,
        suggestion: str | None = None,
        replacement: str | None = None,
    ) -> None:
        self.findings.append(finding(severity, rule, what.at, what.path, message, suggestion, replacement))

    def _nearest(self, name: str, known: Iterable[str], cutoff: float = 0.75) -> str | None:
        if self._guesses <= 0:
            return None
        self._guesses -= 1
        return nearest(name, known, cutoff)

    def _visit(self, space: Space) -> None:
        models = self.models.get(space.path, [])
        for child in space.children.values():
            if isinstance(child, Leaf):
                if not child.used and _source(child) not in self.read:
                    self._leaf(space, child, models)
            elif child.used or _contains_used(child):
                self._visit(child)
            else:
                leaves = list(child.leaves())
                # a layer of a file for both costmaps that the other one uses: its misspelt names are reported there
                if leaves and not any(_source(leaf) in self.read for leaf in leaves):
                    self._unknown_namespace(space, child)
                    continue
                for leaf in leaves:
                    if _source(leaf) not in self.present:
                        self._beside_shared(space, child, leaf)

    def _beside_shared(self, parent: Space, space: Space, leaf: Leaf) -> None:
        """Report a value in a namespace that only the other costmap uses: the costmap's own file added it."""
        name = leaf.path.removeprefix(f"{space.path}/")
        message = (
            f"{name} of {space.path} has no effect because {parent.name or 'move_base'} does not use {space.name}; list "
            f"{space.name} under plugins of {parent.name or 'move_base'}, or remove this line"
        )
        self._add("warning", "layer-not-listed", leaf, message)

    # --- parameters ---------------------------------------------------------------------------------------------------

    def _leaf(self, space: Space, leaf: Leaf, models: Sequence[type[ParamModel]]) -> None:
        """Report a parameter that nothing read; the first explanation that applies."""
        name, where = leaf.name, space.name or "move_base"
        if self._declared(where, leaf, models):
            return
        if leaf.value is None and not models:
            return
        if leaf.value is None and not space.path and (name in self.catalog.planners or name in FOREIGN_PLANNERS):
            return  # an empty namespace
        close = self._nearest(name, [n for m in models for n in iter_names(m)])
        # what ROS reads below a namespace is not meant for the simulated robot
        own = not space.path or space.path.partition("/")[0] == "navstack"
        elsewhere = [
            p for p in self.catalog.home.get(name, []) if p != where and (own or not p.startswith("navstack/"))
        ]
        far_off = all(self._distance(space, p) > _FAR for p in elsewhere)
        if elsewhere and not (far_off and close is not None) and self._elsewhere(space, leaf, elsewhere):
            return
        self._unknown_leaf(where, leaf, models, close)

    def _declared(self, where: str, leaf: Leaf, models: Sequence[type[ParamModel]]) -> bool:
        """Report a name that a model declares as without effect or as a previous name that is overridden."""
        name = leaf.name
        for model in models:
            if name in model.NO_EFFECT:
                self._add("info", "no-effect", leaf, f"{name} of {where} has no effect: {model.NO_EFFECT[name]}")
                return True
            if name in model.RENAMED:
                new = model.RENAMED[name]
                message = f"{name} is the previous name of {new}, which is also set and takes precedence; remove {name}"
                self._add("warning", "renamed", leaf, message, new)
                return True
        return False

    def _unknown_leaf(self, where: str, leaf: Leaf, models: Sequence[type[ParamModel]], close: str | None) -> None:
        name = leaf.name
        if close is not None:
            new = next((m.RENAMED[close] for m in models if close in m.RENAMED), close)
            message = (
                f"{name} = {show(leaf.value)} is not a parameter of {where} and has no effect; did you mean {new}?"
            )
            self._add("warning", "unknown", leaf, message, new, new if _is_certain(name, close, models) else None)
            return
        if name in REMOVED_PARAMETERS:
            self._add("info", "no-effect", leaf, f"{name} of {where} has no effect: {REMOVED_PARAMETERS[name]}")
            return
        package = next((p for p, names in FOREIGN_PARAMETERS.items() if name in names), None)
        if package is not None:
            message = f"{name} is a parameter of {package}, not of {where}, and has no effect; remove it"
            self._add("warning", "unknown", leaf, message)
            return
        if where in self.catalog.home.get(name, ()):
            message = f"{name} has no effect, because the type of {where} does not read it here; remove it"
            self._add("warning", "unknown", leaf, message)
            return
        far = self._nearest(name, self.catalog.home, cutoff=0.86)
        place = self._likely(self.catalog.home[far])[0] if far is not None else ""
        if place and not place.startswith("navstack/") and self._is_in_use(place):
            meant = f"{place}/{far}"
            message = f"{name} is not a parameter of {where} and has no effect; did you mean {meant}?"
            self._add("warning", "unknown", leaf, message, meant)
            return
        message = (
            f"{name} = {show(leaf.value)} is not a parameter of {where} and has no effect, here or in ROS; remove it"
        )
        self._add("warning", "unknown", leaf, message)

    # --- parameters in the wrong namespace ----------------------------------------------------------------------------

    def _elsewhere(self, space: Space, leaf: Leaf, places: Sequence[str]) -> bool:
        """Report the namespace that reads a parameter of that name; False if that would not help."""
        name, where = leaf.name, space.name or "move_base"
        places = self._likely(places)
        near = sorted(places, key=lambda p: (self._distance(space, p), places.index(p)))
        first = near[0]
        if space.name in COSTMAPS and first in self.catalog.layers and space.space(first) is None:
            readers = [c.name for c in space.children.values() if isinstance(c, Space) and self._reads(c, name)]
            if not readers:
                message = f"{name} of {where} has no effect because none of its layers reads it; remove it"
                self._add("warning", "elsewhere", leaf, message)
                return True
            first = readers[0]
        if self._distance(space, first) > _FAR and len(places) > 2:
            return False
        if not self._is_in_use(first) and first not in space.children:
            return self._beside_use(where, leaf, first)
        if first == "move_base":
            beside = space.path.partition("/")[0]
            message = f"{name} has no effect under {where}; move it to the root, next to {beside}"
            self._add("warning", "elsewhere", leaf, message, name)
        elif not self._already_there(space, leaf, first):
            to = f"{first}/{name}"
            if first in COSTMAPS and all(c in places for c in COSTMAPS):
                to = " and ".join(f"{c}/{name}" for c in COSTMAPS)
            message = f"{name} has no effect under {where}; did you mean {to}?"
            self._add("warning", "elsewhere", leaf, message, to)
        return True

    def _is_in_use(self, place: str) -> bool:
        """True if move_base reads a namespace of that name."""
        return place == "move_base" or any(place in (path, path.rpartition("/")[2]) for path in self.models)

    def _beside_use(self, where: str, leaf: Leaf, place: str) -> bool:
        """Report a parameter of a planner that is not in use; False for other plugins, whose names are no hint."""
        if place not in self.catalog.planners:
            return False
        message = (
            f"{leaf.name} is a parameter of {place}, which is not in use, and has no effect under {where}; remove it"
        )
        self._add("warning", "elsewhere", leaf, message)
        return True

    def _already_there(self, space: Space, leaf: Leaf, place: str) -> bool:
        """Report a parameter whose right namespace has the same value already or does not read it."""
        name, where = leaf.name, space.name or "move_base"
        there = space.space(place) or (space.parent.space(place) if space.parent is not None else None)
        same = there.leaf(name) if there is not None else None
        if there is not None and same is not None and same.value == leaf.value:
            message = f"{name} has no effect under {where}; {place} has the same value, which is used; remove this one"
            self._add("info", "elsewhere", leaf, message)
            return True
        if there is not None and self.models.get(there.path) and not self._reads(there, name):
            message = f"{name} has no effect under {where}, and the type of {place} does not read it either; remove it"
            self._add("warning", "elsewhere", leaf, message)
            return True
        return False

    def _likely(self, places: Sequence[str]) -> list[str]:
        """The namespaces in use, otherwise those that exist in ROS, otherwise all."""
        in_use = [p for p in places if any(p == path.rpartition("/")[2] for path in self.models) or p == "move_base"]
        known = [p for p in places if p in FOREIGN_PLANNERS or p in self.catalog.layers or p in COSTMAPS]
        return in_use or known or list(places)

    def _reads(self, space: Space, name: str) -> bool:
        """True if a component reads a parameter of that name from a namespace."""
        return any(name in iter_names(m) and name not in m.NO_EFFECT for m in self.models.get(space.path, []))

    def _distance(self, space: Space, place: str) -> int:
        """How far a parameter is from the namespace `place`: 0 above it, 1 below it, 2 next to it, 3 farther."""
        parent = space.parent
        if place in space.children or (space.name in COSTMAPS and place in self.catalog.layers):
            return 0
        if parent is not None and place in (parent.name or "move_base", "move_base"):
            return 1
        if parent is not None and place in parent.children:
            return _FAR
        return _FAR + 1

    # --- namespaces ---------------------------------------------------------------------------------------------------

    def _unknown_namespace(self, parent: Space, space: Space) -> None:
        """Report a namespace that nothing read; the first explanation that applies."""
        name = space.name
        if space in self._meant:
            self._meant_for(parent, space, self._meant[space])
            return
        package = FOREIGN_PLANNERS.get(name) if not parent.path else None
        if package is not None:
            message = f"{name} has no effect: it belongs to the planner of {package}, which is not in use"
            self._add("info", "not-in-use", space, message)
            return
        if not self._unlisted(parent, space) and not self._misspelt_namespace(parent, space):
            self._foreign_namespace(parent, space)

    def _meant_for(self, parent: Space, space: Space, target: Space) -> None:
        """Report a section whose parameters are those of a namespace that has none."""
        [model, *_] = self.models[target.path]
        count, known = len(space.children), round(_fit(space, model) * len(space.children))
        has = "its parameter is one" if count == 1 else f"its {count} parameters are those"
        if known < count:
            has = f"{known} of its {count} parameters {'is one' if known == 1 else 'are those'}"
        message = (
            f"{space.name} is not read, and {has} of {target.name}, which has its defaults; rename it to {target.name}"
        )
        sure = target.name if _fit(space, model) >= _SURE else None
        self._add("warning", "unknown-namespace", space, message, target.name, sure)
        self.findings[-1] = with_consequences(self.findings[-1], self._consequences.get(target.path, ()))
        self._misspelt_in(space, [model])

    def _unlisted(self, parent: Space, space: Space) -> bool:
        """Report the namespace of a layer or an observation source that its list does not contain."""
        name = space.name
        layers = self.catalog.layers.get(name)
        if layers is not None and parent.name in COSTMAPS:
            message = f"{name} has no effect because the plugins of {parent.name} do not list it; list it or remove it"
            self._add("warning", "layer-not-listed", space, message)
            self._misspelt_in(space, [model() for model in layers])
            return True
        if any("observation_sources" in m.model_fields for m in self.models.get(parent.path, [])):
            message = f"{name} has no effect because observation_sources of {parent.name} does not list it; list it or remove it"
            self._add("warning", "source-not-listed", space, message)
            return True
        return False

    def _misspelt_namespace(self, parent: Space, space: Space) -> bool:
        name, where = space.name, parent.name or "move_base"
        below = [path.rpartition("/") for path in self.models if path]
        known: dict[str, ModelSource | None] = dict.fromkeys(last for above, _, last in below if above == parent.path)
        if not parent.path:
            known |= dict.fromkeys((*COSTMAPS, "navstack", *FOREIGN_PLANNERS))
            known |= self.catalog.planners
        close = self._nearest(name, known, cutoff=0.7)
        if close is None or close == name:
            return False
        models = self.models.get(parent.join(close), [])
        source = known.get(close)
        model = source() if source is not None else models[0] if models else None
        fit = _fit(space, model) if model is not None and any(True for _ in space.leaves()) else 1.0
        if fit == 0.0 and len(space.children) > 1:
            return False  # a similar name with other content
        message = f"{name} is not a namespace of {where} and has no effect; did you mean {close}?"
        certain = close if is_certain(name, close, known) else None
        self._add("warning", "unknown-namespace", space, message, close, certain)
        if model is not None and fit >= _LIKELY:
            self._misspelt_in(space, [model])
        return True

    def _foreign_namespace(self, parent: Space, space: Space) -> None:
        name = space.name
        leaves = list(space.leaves())
        if not parent.path and all(leaf.name in self.catalog.recovery_names for leaf in leaves):
            message = f"{name} has no effect because recovery_behaviors does not list it; list it or remove it"
            self._add("warning", "recovery-not-listed", space, message)
            return
        content = f"its parameter {leaves[0].name} has" if len(leaves) == 1 else f"its {len(leaves)} parameters have"
        instead = NAV2_NODES.get(name) if not parent.path else None
        if instead is not None:
            message = f"{name} is a node of Nav2, so {content} no effect; in move_base, {instead}"
        else:
            message = f"{name} is not a namespace of {parent.name or 'move_base'}, so {content} no effect; remove it"
        self._add("warning", "unknown-namespace", space, message)

    def _misspelt_in(self, space: Space, models: Sequence[type[ParamModel]]) -> None:
        """Report misspelt names in a namespace that is not read, by the models that it was meant for."""
        for child in space.children.values():
            if isinstance(child, Leaf) and not any(child.name in iter_names(m) for m in models):
                self._leaf(space, child, models)


def _is_certain(name: str, close: str, models: Sequence[type[ParamModel]]) -> bool:
    """True if no other parameter of the models can be meant; previous names of one parameter mean the same."""
    current = {n: next((m.RENAMED[n] for m in models if n in m.RENAMED), n) for m in models for n in iter_names(m)}
    others = [n for n, meant in current.items() if meant != current.get(close, close)]
    return is_certain(name, close, others)


def _present(space: Space) -> Iterator[Location | int]:
    """The values in a namespace and in those below it that are read."""
    for child in space.children.values():
        if isinstance(child, Leaf):
            yield _source(child)
        elif child.used or _contains_used(child):
            yield from _present(child)


def _contains_used(space: Space) -> bool:
    return any(leaf.used for leaf in space.leaves()) or any(
        isinstance(c, Space) and c.used for c in space.children.values()
    )
