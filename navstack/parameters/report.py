"""Reports on parameters: effective values and their origins, as YAML; JSON schema, reference page, files with current names.

- `parameters_of`: the effective parameters of a configuration; `as_yaml` and `as_dict` write them.
- `same_parameters`: whether two configurations are equal.
- `json_schema`: a schema of the YAML for editors.
- `reference`: the reference page of all parameters (docs/reference/parameters.md).
- `migrate`: the files of a robot with current parameter names.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic.json_schema import models_json_schema

from navstack.parameters.binding import bounds_of, nested_model, unit_of
from navstack.parameters.configuration import load_configuration
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration, NavstackParams
from navstack.parameters.findings import Finding, Location
from navstack.parameters.models.collision_monitor import (
    ExclusionZoneParams,
    MonitorSourceParams,
    SubPolygonParams,
    ZoneParams,
)
from navstack.parameters.models.docking import DockControllerParams, DockInstanceParams
from navstack.parameters.models.move_base import CostmapParams, MoveBaseParams, builtin_recoveries
from navstack.parameters.models.twist_mux import MuxInputParams, MuxLockParams
from navstack.parameters.nodes import DOCKING_SECTION, NODE_SECTIONS, ROS2_PARAMETERS, node_model
from navstack.parameters.plugin_lists import layer_names, planner_namespaces
from navstack.parameters.sources import packaged_folder, packaged_sets, read_sources
from navstack.parameters.tree import COSTMAPS
from navstack.parameters.yaml_editor import YamlEditor, text_of, value_text
from navstack.plugins import (
    CRITICS,
    DOCK_DETECTORS,
    DOCK_TYPES,
    GLOBAL_PLANNERS,
    GOAL_CHECKERS,
    LAYERS,
    LOCAL_PLANNERS,
    LOCALIZERS,
    PATH_HANDLERS,
    PROGRESS_CHECKERS,
    RECOVERY_BEHAVIORS,
    REGISTRIES,
    SMOOTHERS,
    ParamModel,
    Plugin,
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a component in use."""

    name: str
    """Full name below move_base: `local_costmap/inflation_layer/inflation_radius`."""
    value: Any
    """Effective value as plain Python objects; None if it is not set and has no default."""
    origin: Location | None
    """Location of the value; None for the default."""
    info: FieldInfo
    remark: str = ""
    """Why it is not written to YAML: something else decides its value."""

    @property
    def unit(self) -> str:
        """Unit, for example `m/s`; empty if it has none."""
        return unit_of(self.info)

    @property
    def origin_text(self) -> str:
        """`file:line`, or `default`."""
        if self.origin is None:
            return "default"
        return f"{self.origin.file}:{self.origin.line}" if self.origin.line else self.origin.file


def parameters_of(configuration: Configuration) -> list[Parameter]:
    """Return the effective parameters of every component in use, component by component."""
    return list(_all(configuration))


def same_parameters(a: Configuration, b: Configuration) -> bool:
    """Return True if all effective values are equal; their origins may differ."""

    def values(c: Configuration) -> tuple[Any, ...]:
        planners = (c.global_planner, c.local_planner)
        return (
            c.move_base,
            c.global_costmap,
            c.local_costmap,
            planners,
            c.smoother,
            c.recoveries,
            c.behaviors,
            c.smoothers,
            c.route_server,
            c.navstack,
            c.safety,
            c.localization,
            c.docking,
        )

    return values(a) == values(b)


def _all(c: Configuration) -> Iterator[Parameter]:
    walk = _Walk(c.origins)
    yield from walk.model(c.move_base, "")
    for name, costmap in (("global_costmap", c.global_costmap), ("local_costmap", c.local_costmap)):
        yield from walk.model(costmap.params, name, _left_to_layers(costmap))
        for layer in costmap.layers:
            yield from walk.model(layer.params, layer.namespace)
    for planner in (c.global_planner, c.local_planner, *((c.smoother,) if c.smoother is not None else ())):
        yield from walk.model(planner.params, planner.namespace)
    imposed: dict[str, dict[str, str]] = {}
    if c.move_base.recovery_behaviors is None:
        for spec, values in builtin_recoveries(c.move_base, c.local_costmap.footprint.circumscribed_radius):
            imposed[spec.name] = dict.fromkeys(values, "set by the built-in list of recoveries")
    for recovery in {r.namespace: r for r in c.recoveries}.values():
        yield from walk.model(recovery.params, recovery.namespace, imposed.get(recovery.name))
    yield from _for_trees(c, walk)
    yield from walk.model(c.navstack, "navstack")
    for name, params in (*c.safety.sections(), *c.localization.sections(), (DOCKING_SECTION, c.docking)):
        if params is not None:
            yield from walk.model(params, name)


def _for_trees(c: Configuration, walk: _Walk) -> Iterator[Parameter]:
    """What only behavior trees use: its lists, and the graph of routes, as they are written."""
    recoveries = {recovery.namespace for recovery in c.recoveries}
    server, routes = c.tree.space("smoother_server"), c.tree.space("route_server")
    lists = (
        (c.tree.leaf("behavior_plugins"), c.behaviors, "behaviors of trees besides the recoveries"),
        (server.leaf("smoother_plugins") if server is not None else None, c.smoothers, "smoothers of trees"),
    )
    for leaf, plugins, text in lists:
        if leaf is None:
            continue
        yield Parameter(leaf.path, leaf.value, leaf.node.at, FieldInfo(description=text))
        for plugin in plugins:
            if plugin.namespace not in recoveries:
                yield from walk.model(plugin.params, plugin.namespace)
    for leaf in routes.leaves() if routes is not None else ():
        yield Parameter(leaf.path, leaf.value, leaf.node.at, FieldInfo(description="Nav2's route_server"))


def _left_to_layers(costmap: CostmapConfiguration) -> dict[str, str]:
    """Parameters that would override a layer's different value if they were written at the costmap's level."""
    found: dict[str, str] = {}
    for layer in costmap.layers:
        for name in layer.params.FROM_PARENT & costmap.params.__class__.model_fields.keys():
            if getattr(layer.params, name) != getattr(costmap.params, name):
                found[name] = f"not written: it would override {layer.name}'s"
    return found


class _Walk:
    """Lists the parameters of models with their origins."""

    def __init__(self, origins: Mapping[str, Location]) -> None:
        self.origins = origins

    def model(self, params: ParamModel, path: str, remarks: Mapping[str, str] | None = None) -> Iterator[Parameter]:
        """Yield the parameters of a namespace, those of the namespaces below it last."""
        below: list[tuple[str, ParamModel]] = []
        cls = type(params)
        for name, info in cls.model_fields.items():
            value: Any = getattr(params, name)
            if name in cls.FROM_NAVSTACK:
                continue  # listed in the section `navstack`
            full = f"{path}/{name}" if path else name
            if name == cls.CHILD_FIELD:
                below += [(f"{path}/{child}" if path else child, made) for child, made in value.items()]
            elif isinstance(value, ParamModel):
                below.append((full, value))
            else:
                remark = (remarks or {}).get(name, "")
                yield Parameter(full, plain_value(value), self.origins.get(full), info, remark)
        for full, made in below:
            yield from self.model(made, full)


def plain_value(value: Any) -> Any:
    """Convert a field's value to plain objects for YAML."""
    if isinstance(value, ParamModel):
        return {k: plain_value(v) for k, v in value}
    if isinstance(value, (list, tuple)):
        return [plain_value(v) for v in value]
    return value


# --- YAML -------------------------------------------------------------------------------------------------------------


def as_dict(parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Return value, unit, origin (None: the default) and remark by full name, for JSON."""
    return {
        p.name: {
            "value": p.value,
            "unit": p.unit,
            "origin": p.origin._asdict() if p.origin is not None else None,
            **({"remark": p.remark} if p.remark else {}),
        }
        for p in parameters
    }


def as_yaml(parameters: Sequence[Parameter], header: Sequence[str] = (), *, written_only: bool = False) -> str:
    """Return one YAML file for move_base's namespace with the origin of every value in a comment.

    Loading it gives the same configuration. `written_only` omits the defaults.
    """
    root: dict[str, Any] = {}
    for p in parameters:
        if written_only and (p.origin is None or p.remark):
            continue
        *above, last = p.name.split("/")
        at = root
        for part in above:
            at = at.setdefault(part, {})
        at[last] = p
    lines = [f"# {_comment(line)}".rstrip() for line in header]
    _write(root, 0, lines)
    return "\n".join(lines) + "\n"


def _write(tree: Mapping[str, Any], depth: int, lines: list[str]) -> None:
    pad = "  " * depth
    leaves = [(k, v) for k, v in tree.items() if isinstance(v, Parameter)]
    texts = [(p, _leaf(key, p)) for key, p in leaves]
    width = min(48, max((len(t) for _, t in texts if "\n" not in t), default=0))
    for p, text in texts:
        first, newline, rest = text.partition("\n")
        remark = f"; {p.remark}" if p.remark else ""
        lines.append(f"{pad}{first.ljust(width)}  # {_comment(p.origin_text + remark)}")
        lines += [pad + line for line in rest.split("\n")] if newline else []
    for key, below in tree.items():
        if isinstance(below, Parameter):
            continue
        if not depth:
            lines.append("")
        # a namespace that contains only comments would be a key without a value
        lines.append(f"{pad}{text_of(key)}:" if _holds_value(below) else f"{pad}# {text_of(key)}:")
        _write(below, depth + 1, lines)


def _holds_value(tree: Mapping[str, Any]) -> bool:
    return any(
        (v.value is not None and not v.remark) if isinstance(v, Parameter) else _holds_value(v) for v in tree.values()
    )


def _leaf(key: str, p: Parameter) -> str:
    if p.value is None:
        return f"# {text_of(key)}: not set"
    if p.remark:
        return f"# {text_of(key)}: {value_text(p.value)}"
    if isinstance(p.value, list) and any(isinstance(v, dict) for v in p.value):
        return "\n".join([f"{text_of(key)}:", *(f"  - {value_text(v)}" for v in p.value)])
    return f"{text_of(key)}: {value_text(p.value)}"


def _comment(text: str) -> str:
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")


# ----------------------------------------------------------------------------------------------------------------------
# JSON Schema (2020-12) of move_base's YAML, for completion and checks in editors.
#
# A schema cannot depend on the plugins that a list names: layers and recoveries are known by their usual names, and other
# namespaces are accepted unchecked.


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
        for name in layer_names(entry.name):
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
    for name, model in ((section, node_model(section)) for section in NODE_SECTIONS):
        properties[name] = _with_ros2(of(model))
    root["additionalProperties"] = {"type": "object", "description": "parameters of a recovery behavior or plugin"}
    return {"$schema": _DIALECT, **root, "title": "move_base", "$defs": {k: defs[k] for k in sorted(defs)}}


def _models() -> Iterator[type[ParamModel]]:
    yield from (MoveBaseParams, CostmapParams)
    for registry in REGISTRIES:
        for entry in registry:
            yield entry.cls.Params
            yield from children_of(entry.cls.Params).values()
    yield from (*map(node_model, NODE_SECTIONS), ZoneParams, SubPolygonParams, MonitorSourceParams, ExclusionZoneParams)
    yield from (DockControllerParams, DockInstanceParams)
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
    """Return the namespaces below a model's for its default values, with an observation source `scan` and a dock `dock`."""
    values = {n: i.get_default(call_default_factory=True) for n, i in model.model_fields.items() if not i.is_required()}
    if "observation_sources" in values:
        values["observation_sources"] = "scan"
    if values.get("docks") == []:
        values["docks"] = ["dock"]
    return model.child_models(values)


def _as_written(schema: Schema, model: type[ParamModel], children: Mapping[str, Schema]) -> None:
    """Turn pydantic's schema of a model into that of its namespace in YAML."""
    properties: Schema = schema.setdefault("properties", {})
    for name in [n for n in properties if n == model.CHILD_FIELD or n in model.FROM_NAVSTACK]:
        del properties[name]
    for old, new in model.RENAMED.items():
        if new in properties:
            current = {k: v for k, v in properties[new].items() if k not in ("title", "default")}
            properties[old] = {**current, "deprecated": True, "description": f"previous name of {new}"}
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


# ----------------------------------------------------------------------------------------------------------------------
# The reference page of all parameters, as Markdown generated from the models.


_HEAD = """# Parameters

All parameters of all components, with the effective defaults: the values that a user of ROS noetic gets with an empty YAML.
This page is generated by `navstack params reference`. `navstack params show` prints the effective values of a robot.

Previous names are accepted, with a note. The parameters of a layer are in the namespace below its costmap that is named like its
entry in `plugins`; those of recovery behaviors and critics likewise. See [rules](rules.md) for the checks across parameters.
"""

_NODE_PARTS: tuple[tuple[str, str, type[ParamModel]], ...] = (
    ("twist_mux: an input", "an entry of `topics`", MuxInputParams),
    ("twist_mux: a lock", "an entry of `locks`", MuxLockParams),
    ("collision_monitor: a zone", "`collision_monitor/<zone>`, `collision_detector/<zone>`", ZoneParams),
    ("collision_monitor: a polygon of a velocity_polygon", "`collision_monitor/<zone>/<polygon>`", SubPolygonParams),
    ("collision_monitor: a source", "`collision_monitor/<source>`", MonitorSourceParams),
    ("collision_monitor: an exclusion zone", "`collision_monitor/<source>/<zone>`", ExclusionZoneParams),
    ("docking_server: the control law", "`docking_server/controller`", DockControllerParams),
    ("docking_server: a dock", "`docking_server/<dock>`, or below `docks` in a dock database", DockInstanceParams),
)


def reference() -> str:
    """Return the page. Plugins of other packages are omitted: they have their own documentation."""
    parts = [_HEAD, *_sections()]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _sections() -> Iterator[str]:
    yield _section("move_base", "the root of the YAML", MoveBaseParams)
    yield _section("Costmap", "`global_costmap`, `local_costmap`", CostmapParams)
    # models with a section of their own
    listed: set[type[ParamModel]] = {entry.cls.Params for registry in REGISTRIES for entry in registry}
    for entry in LAYERS:
        if entry.origin != "navstack":
            continue
        yield _plugin("Layer", entry, f"`<costmap>/{layer_names(entry.name)[0]}`", listed)
    for title, registry in (("Global planner", GLOBAL_PLANNERS), ("Local planner", LOCAL_PLANNERS)):
        for entry in registry:
            if entry.origin == "navstack":
                yield _plugin(title, entry, f"`{planner_namespaces(entry)[0]}`", listed)
    for title, registry, where in (
        ("Critic", CRITICS, "`<planner>/<name>`"),
        ("Goal checker", GOAL_CHECKERS, "`goal_checker` next to or below the local planner"),
        ("Progress checker", PROGRESS_CHECKERS, "`progress_checker`"),
        ("Path handler", PATH_HANDLERS, "`PathHandler` next to or below the local planner"),
        ("Smoother", SMOOTHERS, "`<name>`, for `base_smoother: <name>`"),
        ("Recovery behavior", RECOVERY_BEHAVIORS, "`<name>`"),
        ("Dock type", DOCK_TYPES, "`docking_server/<name>`, for a name in `dock_plugins`"),
        ("Dock detector", DOCK_DETECTORS, "`detector` below a dock type"),
    ):
        for entry in registry:
            if entry.origin == "navstack":
                yield _plugin(title, entry, where, listed)
    of_nodes = [node_model(section) for section in NODE_SECTIONS]
    for entry in LOCALIZERS:
        model = entry.cls.Params
        if entry.origin == "navstack" and model.model_fields and model not in of_nodes:
            yield _plugin(
                "Localizer",
                entry,
                "`--set NAME=VALUE` of `navstack localize`; for `mapping` of `navstack map build`",
                listed,
            )
    for name, model in ((section, node_model(section)) for section in NODE_SECTIONS):
        yield _section(name, f"`{name}`, or `{name}/ros__parameters` in a file of ROS 2", model)
    for title, where, model in _NODE_PARTS:
        yield _section(title, where, model)
    yield _section("navstack", "`navstack`, which ROS does not read", NavstackParams)
    for name, info in NavstackParams.model_fields.items():
        inner = nested_model(info)
        if inner is None:
            continue
        yield _section(f"navstack/{name}", f"`navstack/{name}`", inner)
        for child, model in children_of(inner).items():
            yield _section(f"navstack/{name}/{child}", f"`navstack/{name}/<name>`", model)
        for part, field in inner.model_fields.items():
            below = nested_model(field)
            if below is not None:
                yield _section(f"navstack/{name}/{part}", f"`{part}` in `navstack/{name}`", below)


def _plugin(kind: str, entry: Plugin[Any], where: str, listed: set[type[ParamModel]]) -> str:
    ros = ", ".join(f"`{a}`" for a in entry.aliases if "/" in a)
    model: type[ParamModel] = entry.cls.Params
    text = _section(f"{kind} {entry.name}", f"{where}{'; type ' + ros if ros else ''}", model)
    for name, child in children_of(model).items():
        if child not in listed:
            listed.add(child)
            of_sources = "observation_sources" in model.model_fields
            what, space = ("an observation source", "<source>") if of_sources else (f"`{name}`", name)
            text += "\n" + _section(f"{kind} {entry.name}: {what}", f"{where[:-1]}/{space}`", child)
    return text


def table_of(model: type[ParamModel]) -> list[str]:
    """Return the lines of a table of a model's fields: name, default, unit, range, meaning; nested models are omitted."""
    fields = {
        n: i
        for n, i in model.model_fields.items()
        if n != model.CHILD_FIELD and n not in model.FROM_NAVSTACK and nested_model(i) is None
    }
    if not fields:
        return ["No parameters."]
    lines = ["| name | default | unit | range | meaning |", "|---|---|---|---|---|"]
    for name, info in fields.items():
        extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
        meaning = f"{info.description or ''}"
        meaning += "".join(f" *{text}*" for text in _lookups(model, name))
        if extra.get("ros_differs"):
            meaning += f"<br>**ROS differs:** {extra['ros_differs']}"
        cells = (f"`{name}`", _default(info), unit_of(info), range_of(info), meaning)
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return lines


def _section(title: str, where: str, model: type[ParamModel]) -> str:
    lines = [f"## {title}", "", f"Namespace: {where}.", "", *table_of(model)]
    if model.RENAMED:
        lines += ["", "Previous names: " + ", ".join(f"`{old}` → `{new}`" for old, new in model.RENAMED.items()) + "."]
    if model.NO_EFFECT:
        lines += ["", "No effect:", ""]
        lines += [f"- `{name}`: {why}" for name, why in model.NO_EFFECT.items()]
    return "\n".join(lines) + "\n"


def _lookups(model: type[ParamModel], name: str) -> Iterator[str]:
    if name in model.SEARCHED:
        yield "(also searched in the enclosing namespaces)"
    if name in model.FROM_PARENT:
        yield "(overridden by the same name at the costmap's level)"


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = plain_value(info.get_default(call_default_factory=True))
    return "none" if value is None else f"`{value_text(value)}`"


def range_of(info: FieldInfo) -> str:
    """`[0, 20]`, `> 0`, `a, b or c`."""
    if get_origin(info.annotation) is Literal:
        return ", ".join(f"`{a}`" for a in get_args(info.annotation))
    bounds = bounds_of(info)
    low = next((f"{sign} {bounds[w]:g}" for w, sign in (("ge", "≥"), ("gt", ">")) if w in bounds), "")
    high = next((f"{sign} {bounds[w]:g}" for w, sign in (("le", "≤"), ("lt", "<")) if w in bounds), "")
    if "ge" in bounds and "le" in bounds:
        return f"[{bounds['ge']:g}, {bounds['le']:g}]"
    return ", ".join(x for x in (low, high) if x)


# ----------------------------------------------------------------------------------------------------------------------
# Write a robot's parameters with current names.
#
# Renamed keys are replaced in copies of the files, which keep their comments, order and layout. The layout from before ROS Hydro,
# launch files and mappings are written as one file that contains the values set, without comments.


SINGLE_FILE = "move_base_params.yaml"
"""Name of the single file; in a folder it has the role of move_base's own parameters."""


@dataclass(frozen=True, slots=True)
class Migration:
    """The files to write."""

    files: dict[str, str]
    """Path relative to the new folder -> text."""
    renamed: tuple[tuple[str, str], ...]
    """Former and current names, sorted by file and line."""
    why_whole: str = ""
    """Why there is a single file without comments; empty if the files keep their layout."""


def migrate(
    sources: Sequence[str],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Migration:
    """Return the files of a robot with current names; raise ParameterError as `load_configuration`."""
    configuration = load_configuration(sources, overrides=overrides, distro=distro, allow_missing=allow_missing)
    notes = {
        (f.file, f.line, f.column): f for f in configuration.findings if f.rule == "renamed" and f.severity == "info"
    }
    renames = [notes[place] for place in sorted(notes)]
    renamed = tuple((_old_name(f), str(f.suggestion)) for f in renames)
    changed = bool(overrides or distro or allow_missing)
    why = _why_whole(sources, configuration, changed)
    if not why:
        files = _copies(sources[0], renames)
        if files is not None:
            return Migration(files, renamed)
        why = "a renamed key cannot be replaced in place (it is an anchor or a key of another file)"
    text = as_yaml(parameters_of(configuration), [f"{why}:", "the values set, with their origins"], written_only=True)
    return Migration({SINGLE_FILE: text}, renamed, why)


def _old_name(f: Finding) -> str:
    return f.key.rpartition("/")[2]


def _why_whole(sources: Sequence[str], configuration: Configuration, changed: bool) -> str:
    """Why the files cannot be kept; empty if they can."""
    if any(f.rule == "pre-hydro" for f in configuration.findings):
        return "the layout from before ROS Hydro was converted to lists of layers"
    if any(f.rule == "through-launch" for f in configuration.findings):
        return "the folder is loaded through its launch file"
    if changed:
        return "values were changed on the command line"
    if len(sources) != 1 or not (Path(sources[0]).is_dir() or sources[0] in packaged_sets()):
        return "the source is not a single folder"
    return ""


def _copies(source: str, renames: Sequence[Finding]) -> dict[str, str] | None:
    """The loaded files of the folder with the keys replaced; None if a key is not at the location of its finding."""
    folder = packaged_folder(source) if source in packaged_sets() else Path(source)
    shown = source if source in packaged_sets() else source.rstrip("/") or "/"
    files: dict[str, str] = {}
    for name in read_sources([source]).files:
        relative = name.removeprefix(f"{shown}/")
        editor = YamlEditor((folder / relative).read_bytes().decode("utf-8-sig"))
        if any(editor.rename(f.line, f.column, _old_name(f), str(f.suggestion)) for f in renames if f.file == name):
            return None
        files[relative] = editor.text()
    return files
