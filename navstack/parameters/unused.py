"""Every key is accounted for: what nobody read is told apart here."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from navstack.core.parameters import ParamModel
from navstack.parameters.binding import Binder, iter_names, show
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.tree import COSTMAPS, Leaf, Space

_FAR = 2
MAX_GUESSES = 200
"""Names for which a nearest known one is looked up in one loading."""

FOREIGN = {
    "TrajectoryPlannerROS": "base_local_planner",
    "TebLocalPlannerROS": "teb_local_planner",
    "EBandPlannerROS": "eband_local_planner",
    "DWBLocalPlanner": "dwb_local_planner",
    "MIRPlannerROS": "mir_dwb",
    "PoseFollower": "pose_follower",
    "MpcLocalPlannerROS": "mpc_local_planner",
    "PalLocalPlanner": "pal_local_planner",
    "RegulatedPurePursuit": "regulated_pure_pursuit_controller",
    "SBPLLatticePlanner": "sbpl_lattice_planner",
    "CarrotPlanner": "carrot_planner",
    "GlobalPlanner": "global_planner",
    "NavfnROS": "navfn",
    "DWAPlannerROS": "dwa_local_planner",
    "GridBased": "nav2",
}
"""Namespaces of planners that exist for move_base, and their packages."""


FOREIGN_NAMES = {
    "teb_local_planner": frozenset(
        {
            "min_obstacle_dist",
            "inflation_dist",
            "include_costmap_obstacles",
            "costmap_obstacles_behind_robot_dist",
            "obstacle_poses_affected",
            "costmap_converter_plugin",
            "costmap_converter_spin_thread",
            "costmap_converter_rate",
            "weight_obstacle",
            "weight_inflation",
            "weight_kinematics_nh",
            "weight_optimaltime",
        }
    ),
}
"""Parameters of planners that exist elsewhere, as they turn up in other components' namespaces."""


GONE = {"planner_costmap_publish_frequency": "nothing reads it any more (navfn removed it as unused)"}
"""Parameters of former releases that nothing reads any more, and why they are still written."""


@dataclass(slots=True)
class Catalogue:
    """What may stand where."""

    planners: dict[str, type[ParamModel]] = field(default_factory=dict[str, type[ParamModel]])
    """Namespace of every registered planner -> its model."""
    layers: dict[str, list[type[ParamModel]]] = field(default_factory=dict[str, list[type[ParamModel]]])
    """Registered layer types by their usual instance name, for namespaces that no costmap lists."""
    recoveries: list[type[ParamModel]] = field(default_factory=list[type[ParamModel]])
    """Models of the registered recovery behaviours."""
    home: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Parameter name -> the namespaces where it is read, as a user would write them."""

    def learn(self, namespace: str, model: type[ParamModel]) -> None:
        """`model`'s names are read in `namespace`."""
        for name in iter_names(model):
            if name in model.NO_EFFECT:
                continue
            places = self.home.setdefault(name, [])
            if namespace not in places:
                places.append(namespace)


def nearest(name: str, known: Iterable[str], cutoff: float = 0.75) -> str | None:
    """The known name that a misspelt one means, if there is one near enough."""
    names = sorted(set(known))
    by_lower = {n.lower(): n for n in names}
    if name.lower() in by_lower:
        return by_lower[name.lower()]
    # the same words in another order or without their underscores: vel_max_x, maxvelx
    squeezed = {re.sub(r"[_\-. ]", "", n.lower()): n for n in names}
    if re.sub(r"[_\-. ]", "", name.lower()) in squeezed:
        return squeezed[re.sub(r"[_\-. ]", "", name.lower())]
    words = sorted(name.lower().split("_"))
    for n in names:
        if len(words) > 1 and sorted(n.lower().split("_")) == words:
            return n
    close = difflib.get_close_matches(name.lower(), list(by_lower), n=1, cutoff=cutoff)
    return by_lower[close[0]] if close else None


def _source(leaf: Leaf) -> Location | int:
    """What tells one written value from another: its place, or itself where it has none (a Python mapping)."""
    return leaf.at if leaf.at.line else id(leaf.node)


class Accountant:
    """Goes through the tree after everything was read and says what is left."""

    def __init__(self, root: Space, binder: Binder, catalogue: Catalogue) -> None:
        self.root = root
        self.binder = binder
        self.catalogue = catalogue
        self.findings: list[Finding] = []
        self.read = {_source(leaf) for leaf in root.leaves() if leaf.used}
        """Values that were read in one namespace: in another they need no excuse (files loaded into both costmaps)."""
        self._guesses = MAX_GUESSES
        self.recovery_names = {n for m in catalogue.recoveries for n in iter_names(m)}
        self.models: dict[str, list[type[ParamModel]]] = {}
        for space, model in binder.bound:
            self.models.setdefault(space.path, []).append(model)

    def _nearest(self, name: str, known: Iterable[str], cutoff: float = 0.75) -> str | None:
        """What a misspelt name means; gives up on files that are misspelt all over, since comparing takes time."""
        if self._guesses <= 0:
            return None
        self._guesses -= 1
        return nearest(name, known, cutoff)

    def settle(self) -> list[Finding]:
        """Findings about every key that nothing read."""
        self._namespace(self.root)
        return self.findings

    def _namespace(self, space: Space) -> None:
        models = self.models.get(space.path, [])
        for name, child in space.children.items():
            if isinstance(child, Leaf):
                if not child.used and _source(child) not in self.read:
                    self._leaf(space, child, models)
            elif child.used or self._holds_used(child):
                self._namespace(child)
            elif not all(_source(leaf) in self.read for leaf in child.leaves()):
                self._unknown_namespace(space, name, child)

    @staticmethod
    def _holds_used(space: Space) -> bool:
        return any(leaf.used for leaf in space.leaves()) or any(
            isinstance(c, Space) and c.used for c in space.children.values()
        )

    # --- one key ----------------------------------------------------------------------------------------------------

    def _leaf(self, space: Space, leaf: Leaf, models: Sequence[type[ParamModel]]) -> None:
        name, where = leaf.name, space.name or "move_base"
        for model in models:
            if name in model.NO_EFFECT:
                reason = model.NO_EFFECT[name]
                self.say("info", "no-effect", leaf, f"{name} in {where} has no effect: {reason}")
                return
            if name in model.RENAMED:
                new = model.RENAMED[name]
                message = f"{name} is called {new} today, and {new} is given as well, which counts; remove {name}"
                self.say("warning", "renamed", leaf, message, new)
                return
        if leaf.value is None and not models:
            return
        if leaf.value is None and not space.path and (name in self.catalogue.planners or name in FOREIGN):
            return  # a namespace without a parameter
        close = self._nearest(name, [n for m in models for n in iter_names(m)])
        elsewhere = [p for p in self.catalogue.home.get(name, []) if p != where]
        far_off = all(self._distance(space, p) > _FAR for p in elsewhere)
        if elsewhere and not (far_off and close is not None) and self._elsewhere(space, leaf, elsewhere):
            return
        if close is not None:
            new = next((m.RENAMED[close] for m in models if close in m.RENAMED), close)
            message = f"{where} has no parameter {name}, so {show(leaf.value)} has no effect; did you mean {new}?"
            self.say("warning", "unknown", leaf, message, new)
            return
        if name in GONE:
            self.say("info", "no-effect", leaf, f"{name} in {where} has no effect: {GONE[name]}")
            return
        package = next((p for p, names in FOREIGN_NAMES.items() if name in names), None)
        if package is not None:
            message = f"{name} is a parameter of {package}, not of {where}, so it has no effect; remove it"
            self.say("warning", "unknown", leaf, message)
            return
        far = self._nearest(name, self.catalogue.home, cutoff=0.86)
        if far is not None:
            place = self._likely(self.catalogue.home[far])[0]
            message = f"{where} has no parameter {name}, so it has no effect; did you mean {place}/{far}?"
            self.say("warning", "unknown", leaf, message, f"{place}/{far}")
            return
        message = f"{where} has no parameter {name}, so {show(leaf.value)} has no effect, in ROS as here; remove it"
        self.say("warning", "unknown", leaf, message)

    def _elsewhere(self, space: Space, leaf: Leaf, places: Sequence[str]) -> bool:
        """Says where a parameter of that name is read; False when that would not help."""
        name, where = leaf.name, space.name or "move_base"
        places = self._likely(places)
        near = sorted(places, key=lambda p: (self._distance(space, p), places.index(p)))
        first = near[0]
        if space.name in COSTMAPS and first in self.catalogue.layers and space.space(first) is None:
            readers = [c.name for c in space.children.values() if isinstance(c, Space) and self._reads(c, name)]
            if not readers:
                message = f"no layer of {where} reads {name}, so it has no effect; remove it"
                self.say("warning", "elsewhere", leaf, message)
                return True
            first = readers[0]
        if self._distance(space, first) > _FAR and len(places) > 2:
            return False
        if first == "move_base":
            beside = space.path.partition("/")[0]
            message = f"{name} under {where} has no effect; it stands at the root, beside {beside}"
            self.say("warning", "elsewhere", leaf, message, name)
            return True
        there = space.space(first) or (space.parent.space(first) if space.parent is not None else None)
        same = there.leaf(name) if there is not None else None
        if there is not None and same is not None and same.value == leaf.value:
            message = f"{name} under {where} has no effect; {first} has the same value, which counts; remove this one"
            self.say("info", "elsewhere", leaf, message)
            return True
        if there is not None and self.models.get(there.path) and not self._reads(there, name):
            message = f"{name} under {where} has no effect: {first} is here of a type that does not read it; remove it"
            self.say("warning", "elsewhere", leaf, message)
            return True
        to = f"{first}/{name}"
        if first in COSTMAPS and all(c in places for c in COSTMAPS):
            to = " and ".join(f"{c}/{name}" for c in COSTMAPS)
        self.say("warning", "elsewhere", leaf, f"{name} under {where} has no effect; did you mean {to}?", to)
        return True

    def _likely(self, places: Sequence[str]) -> list[str]:
        """The namespaces that are in use here; else those that exist in ROS; else all."""
        in_use = [p for p in places if any(p == path.rpartition("/")[2] for path in self.models) or p == "move_base"]
        known = [p for p in places if p in FOREIGN or p in self.catalogue.layers or p in COSTMAPS]
        return in_use or known or list(places)

    def _reads(self, space: Space, name: str) -> bool:
        """True when a component takes a parameter of that name from there."""
        return any(name in iter_names(m) and name not in m.NO_EFFECT for m in self.models.get(space.path, []))

    def _distance(self, space: Space, place: str) -> int:
        """How far a user would have to move a parameter: below, up, beside, farther."""
        parent = space.parent
        if place in space.children or (space.name in COSTMAPS and place in self.catalogue.layers):
            return 0
        if parent is not None and place in (parent.name or "move_base", "move_base"):
            return 1
        if parent is not None and place in parent.children:
            return _FAR
        return _FAR + 1

    # --- one namespace ----------------------------------------------------------------------------------------------

    def _unknown_namespace(self, parent: Space, name: str, space: Space) -> None:
        below = [path.rpartition("/") for path in self.models if path]
        places = [name for above, _, name in below if above == parent.path]
        where = parent.name or "move_base"
        package = FOREIGN.get(name) if not parent.path else None
        if package is not None:
            message = f"{name} is the namespace of {package}'s planner, which is not in use here; its parameters have no effect"
            self.say_at("info", "not-in-use", space.at, space.path, message)
            return
        layers = self.catalogue.layers.get(name)
        if layers is not None and parent.name in COSTMAPS:
            message = (
                f"{name} is not among the `plugins` of {where}, so its parameters have no effect; list it or remove it"
            )
            self.say_at("warning", "layer-not-listed", space.at, space.path, message)
            self._names_only(space, layers)
            return
        if any("observation_sources" in m.model_fields for m in self.models.get(parent.path, [])):
            message = f"{name} is not in the observation_sources of {where}, so its parameters have no effect; add or remove it"
            self.say_at("warning", "source-not-listed", space.at, space.path, message)
            return
        known: dict[str, type[ParamModel] | None] = dict.fromkeys(places)
        if not parent.path:
            known |= dict.fromkeys((*COSTMAPS, "navstack", *FOREIGN))
            known |= self.catalogue.planners
        close = self._nearest(name, known, cutoff=0.7)
        if close is not None and close != name:
            model = known.get(close) or self._model_at(parent, close)
            message = f"{where} has no namespace {name}, so what stands under it has no effect; did you mean {close}?"
            self.say_at("warning", "unknown-namespace", space.at, space.path, message, close)
            if model is not None:
                self._names_only(space, [model])
            return
        leaves = list(space.leaves())
        if not parent.path and all(leaf.name in self.recovery_names for leaf in leaves):
            message = (
                f"{name} is not among the recovery_behaviors, so its parameters have no effect; list it or remove it"
            )
            self.say_at("warning", "recovery-not-listed", space.at, space.path, message)
            return
        message = f"{where} has no namespace {name}; the {len(leaves)} parameters under it have no effect; remove it"
        if len(leaves) == 1:
            message = (
                f"{where} has no namespace {name}; the parameter {leaves[0].name} under it has no effect; remove it"
            )
        self.say_at("warning", "unknown-namespace", space.at, space.path, message)

    def _names_only(self, space: Space, models: Sequence[type[ParamModel]]) -> None:
        """Misspelt names in a namespace that is not read, by the model that it was meant for."""
        for child in space.children.values():
            if isinstance(child, Leaf) and not any(child.name in iter_names(m) for m in models):
                self._leaf(space, child, models)

    def _model_at(self, parent: Space, name: str) -> type[ParamModel] | None:
        found = self.models.get(parent.join(name))
        return found[0] if found else None

    def say(self, severity: str, rule: str, leaf: Leaf, message: str, suggestion: str | None = None) -> None:
        self.say_at(severity, rule, leaf.at, leaf.path, message, suggestion)

    def say_at(
        self, severity: str, rule: str, at: Location, key: str, message: str, suggestion: str | None = None
    ) -> None:
        self.findings.append(finding(severity, rule, at, key, message, suggestion))  # type: ignore[arg-type]
