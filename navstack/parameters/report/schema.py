"""JSON Schema (2020-12) of move_base's YAML, for completion and checks in editors.

A schema cannot depend on the plugins that a list names: layers and recoveries are known by their usual names, and other
namespaces are accepted unchecked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic.json_schema import models_json_schema

from navstack.core.parameters import ParamModel
from navstack.parameters.configuration_types import NavstackParams
from navstack.parameters.localization_sections import NODE_MODELS
from navstack.parameters.model_fields import nested_model
from navstack.parameters.models.collision_monitor import (
    ExclusionZoneParams,
    MonitorSourceParams,
    SubPolygonParams,
    ZoneParams,
)
from navstack.parameters.models.costmap import CostmapParams
from navstack.parameters.models.move_base import MoveBaseParams, builtin_recoveries
from navstack.parameters.namespaces import layer_names, planner_namespaces
from navstack.parameters.safety_sections import ROS2_PARAMETERS
from navstack.parameters.tree import COSTMAPS
from navstack.plugins import GLOBAL_PLANNERS, LAYERS, LOCAL_PLANNERS, RECOVERY_BEHAVIORS, REGISTRIES

Schema = dict[str, Any]
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> Schema:
    """Return the schema of a file loaded into move_base's own namespace; `$defs` has one for each namespace below."""
    models = list(dict.fromkeys(m for m in _models()))
    refs, document = models_json_schema([(m, "validation") for m in models])
    defs: dict[str, Schema] = document["$defs"]

    def of(model: type[ParamModel]) -> Schema:
        return dict(refs[(model, "validation")])

    for model in models:
        name = of(model)["$ref"].rpartition("/")[2]
        _as_written(defs[name], model, {n: of(m) for n, m in children_of(model).items()})
    costmap = defs["CostmapParams"]
    layers: dict[str, list[Schema]] = {}
    for entry in LAYERS:
        for name in layer_names(entry):
            layers.setdefault(name, []).append(of(entry.cls.Params))
    costmap["properties"] |= {n: s[0] if len(s) == 1 else {"anyOf": s} for n, s in layers.items()}
    # layers may have any name; values from before ROS Hydro are at the costmap's own level
    costmap["additionalProperties"] = True
    root = defs.pop("MoveBaseParams")
    properties: Schema = root["properties"]
    for name in COSTMAPS:
        properties[name] = of(CostmapParams)
    for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS):
        for entry in registry:
            for name in planner_namespaces(entry):
                properties[name] = of(entry.cls.Params)
    for spec, _ in builtin_recoveries(MoveBaseParams(), 1.0):
        properties[spec.name] = of(RECOVERY_BEHAVIORS.get(spec.type).cls.Params)
    properties["navstack"] = of(NavstackParams)
    for name, model in NODE_MODELS.items():
        properties[name] = _with_ros2(of(model))
    root["additionalProperties"] = {"type": "object", "description": "parameters of a recovery behavior or plugin"}
    return {"$schema": _DIALECT, **root, "title": "move_base", "$defs": {k: defs[k] for k in sorted(defs)}}


def _models() -> Iterator[type[ParamModel]]:
    yield from (MoveBaseParams, CostmapParams)
    for registry in REGISTRIES:
        for entry in registry:
            yield entry.cls.Params
            yield from children_of(entry.cls.Params).values()
    yield from (*NODE_MODELS.values(), ZoneParams, SubPolygonParams, MonitorSourceParams, ExclusionZoneParams)
    yield NavstackParams
    for info in NavstackParams.model_fields.values():
        if isinstance(info.default, ParamModel):
            yield type(info.default)
            yield from children_of(type(info.default)).values()
            yield from (m for i in type(info.default).model_fields.values() if (m := nested_model(i)) is not None)


def _with_ros2(section: Schema) -> Schema:
    """The schema of a section that may have its parameters below `ros__parameters`."""
    nested = {"type": "object", "required": [ROS2_PARAMETERS], "properties": {ROS2_PARAMETERS: section}}
    return {"anyOf": [section, nested]}


def children_of(model: type[ParamModel]) -> dict[str, type[ParamModel]]:
    """Return the namespaces below a model's for its default values, with an observation source named `scan`."""
    values = {n: i.get_default(call_default_factory=True) for n, i in model.model_fields.items() if not i.is_required()}
    if "observation_sources" in values:
        values["observation_sources"] = "scan"
    return model.child_models(values)


def _as_written(schema: Schema, model: type[ParamModel], children: Mapping[str, Schema]) -> None:
    """Turn pydantic's schema of a model into that of its namespace in YAML."""
    properties: Schema = schema.setdefault("properties", {})
    for name in [n for n in properties if n == model.CHILD_FIELD or n in model.FROM_NAVSTACK]:
        del properties[name]
    for old, new in model.RENAMED.items():
        if new in properties:
            current = {k: v for k, v in properties[new].items() if k not in ("title", "default")}
            properties[old] = {**current, "deprecated": True, "description": f"former name of {new}"}
    for name, why in model.NO_EFFECT.items():
        properties.setdefault(name, {"deprecated": True, "description": f"no effect: {why}"})
    for one in properties.values():
        for empty in ("unit", "ros_differs"):
            if one.get(empty) == "":
                del one[empty]
        one.pop("title", None)
    if model.CHILD_FIELD is not None:
        values = list({str(s): s for s in children.values()}.values())
        properties.update(children)
        schema["additionalProperties"] = values[0] if len(values) == 1 else {"type": "object"}
