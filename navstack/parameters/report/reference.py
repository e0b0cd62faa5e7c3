"""The reference page of all parameters, as Markdown generated from the models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from navstack.core.parameters import ParamModel
from navstack.parameters.configuration_types import NavstackParams
from navstack.parameters.model_fields import bounds_of, nested_model, unit_of
from navstack.parameters.models.costmap import CostmapParams
from navstack.parameters.models.move_base import MoveBaseParams
from navstack.parameters.namespaces import layer_names, planner_namespaces
from navstack.parameters.report.document import plain_value, value_text
from navstack.parameters.report.schema import children_of
from navstack.plugins import CRITICS, GLOBAL_PLANNERS, LAYERS, LOCAL_PLANNERS, RECOVERY_BEHAVIORS, PluginEntry

_HEAD = """# Parameters

Every parameter of every component, with the default that a user of ROS noetic really gets. Written by
`navstack params reference`; a test compares. `navstack params show` prints the values that a robot's own files come to.

Where a name has changed, the former one is honoured, with a note. Layers stand below a costmap, under the name that its
`plugins` gives them; recovery behaviours and critics likewise. [Rules](rules.md) has the checks across parameters.
"""


def reference() -> str:
    """Return the page. Plugins of other packages are omitted: they have their own documentation."""
    parts = [_HEAD, *_sections()]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _sections() -> Iterator[str]:
    yield _section("move_base", "the root of the YAML", MoveBaseParams)
    yield _section("Costmap", "`global_costmap`, `local_costmap`", CostmapParams)
    listed: set[type[ParamModel]] = set()
    for entry in LAYERS:
        if entry.origin != "navstack":
            continue
        yield _plugin("Layer", entry, f"`<costmap>/{layer_names(entry)[0]}`", listed)
    for title, registry in (("Global planner", GLOBAL_PLANNERS), ("Local planner", LOCAL_PLANNERS)):
        for entry in registry:
            if entry.origin == "navstack":
                yield _plugin(title, entry, f"`{planner_namespaces(entry)[0]}`", listed)
    for title, registry, where in (
        ("Critic", CRITICS, "`<planner>/<name>`"),
        ("Recovery behaviour", RECOVERY_BEHAVIORS, "`<name>`"),
    ):
        for entry in registry:
            if entry.origin == "navstack":
                yield _plugin(title, entry, where, listed)
    yield _section("navstack", "`navstack`, which ROS does not read", NavstackParams)
    for name, info in NavstackParams.model_fields.items():
        inner = nested_model(info)
        if inner is None:
            continue
        yield _section(f"navstack/{name}", f"`navstack/{name}`", inner)
        for child, model in children_of(inner).items():
            yield _section(f"navstack/{name}/{child}", f"`navstack/{name}/<name>`", model)


def _plugin(kind: str, entry: PluginEntry[Any], where: str, listed: set[type[ParamModel]]) -> str:
    ros = ", ".join(f"`{a}`" for a in entry.aliases if "/" in a)
    model: type[ParamModel] = entry.cls.Params
    text = _section(f"{kind} {entry.name}", f"{where}{'; type ' + ros if ros else ''}", model)
    for child in dict.fromkeys(children_of(model).values()):
        if child not in listed:
            listed.add(child)
            text += "\n" + _section(f"{kind} {entry.name}: an observation source", f"{where[:-1]}/<source>`", child)
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
        lines += ["", "Former names: " + ", ".join(f"`{old}` → `{new}`" for old, new in model.RENAMED.items()) + "."]
    if model.NO_EFFECT:
        lines += ["", "Without effect:", ""]
        lines += [f"- `{name}`: {why}" for name, why in model.NO_EFFECT.items()]
    return "\n".join(lines) + "\n"


def _lookups(model: type[ParamModel], name: str) -> Iterator[str]:
    if name in model.SEARCHED:
        yield "(also looked up in the enclosing namespaces)"
    if name in model.FROM_PARENT:
        yield "(overridden by one of that name at the costmap's own level)"


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
