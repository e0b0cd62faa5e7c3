"""All parameters of all registered plugins by namespace, to find out what an unused key was meant for."""

from __future__ import annotations

from dataclasses import dataclass, field

from navstack.core.parameters import ParamModel
from navstack.parameters.binding import Binder
from navstack.parameters.configuration_types import NavstackParams
from navstack.parameters.localization_sections import NODE_MODELS
from navstack.parameters.model_fields import is_value, iter_names
from navstack.parameters.models.costmap import CostmapParams
from navstack.parameters.models.motion import MotionParams
from navstack.parameters.models.move_base import MoveBaseParams
from navstack.parameters.models.sim import SimParams
from navstack.parameters.models.wheels import WheelParams
from navstack.parameters.namespaces import layer_names, planner_namespaces
from navstack.parameters.tree import COSTMAPS
from navstack.plugins import GLOBAL_PLANNERS, LAYERS, LOCAL_PLANNERS, RECOVERY_BEHAVIORS, SMOOTHERS


@dataclass(slots=True)
class Catalogue:
    """Known namespaces and parameters."""

    planners: dict[str, type[ParamModel]] = field(default_factory=dict[str, type[ParamModel]])
    """Namespace of every registered planner -> its model."""
    layers: dict[str, list[type[ParamModel]]] = field(default_factory=dict[str, list[type[ParamModel]]])
    """Usual instance name of a registered layer -> models, for namespaces that no costmap lists."""
    recoveries: list[type[ParamModel]] = field(default_factory=list[type[ParamModel]])
    """Models of the registered recovery behaviors."""
    home: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Parameter name -> namespaces that read it, as a user writes them."""

    def add(self, namespace: str, model: type[ParamModel]) -> None:
        """Add the names of a model that is read in `namespace`."""
        for name in iter_names(model):
            if name in model.NO_EFFECT or not is_value(model, name):
                continue
            places = self.home.setdefault(name, [])
            if namespace not in places:
                places.append(namespace)


def catalogue_of(binder: Binder) -> Catalogue:
    """Return the parameters of all registered plugins and of the namespaces that were read."""
    catalogue = Catalogue()
    catalogue.add("move_base", MoveBaseParams)
    for name in COSTMAPS:
        catalogue.add(name, CostmapParams)
    for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS, SMOOTHERS):
        for entry in registry:
            namespaces = planner_namespaces(entry)
            for name in namespaces:
                catalogue.planners[name] = entry.cls.Params
            catalogue.add(namespaces[0], entry.cls.Params)
    for entry in LAYERS:
        for name in layer_names(entry):
            catalogue.layers.setdefault(name, []).append(entry.cls.Params)
        catalogue.add(layer_names(entry)[0], entry.cls.Params)
    for entry in RECOVERY_BEHAVIORS:
        catalogue.recoveries.append(entry.cls.Params)
        catalogue.add(entry.name, entry.cls.Params)
    catalogue.add("navstack", NavstackParams)
    catalogue.add("navstack/sim", SimParams)
    catalogue.add("navstack/sim/wheels", WheelParams)
    catalogue.add("navstack/motion", MotionParams)
    for name, model in NODE_MODELS.items():
        if any(space.path == name for space, _ in binder.bound):
            catalogue.add(name, model)
    for space, model in binder.bound:
        if space.parent is not None and space.children:
            catalogue.add(space.name, model)
    return catalogue
