"""A namespace of the tree -> its parameter model: which written value counts, its conversion, its check and its message."""

from __future__ import annotations

import math
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeGuard, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from navstack.core import short_repr
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain
from navstack.plugins import ParamModel

# ----------------------------------------------------------------------------------------------------------------------
# Facts about the fields of parameter models: nested models, ranges, names that a user may write.


_FRAMES = ("global_frame", "robot_base_frame", "sensor_frame", "global_frame_id", "frame", "frame_id")


def is_model(annotation: Any) -> TypeGuard[type[ParamModel]]:
    """Return True for a parameter model."""
    return isinstance(annotation, type) and issubclass(annotation, ParamModel)


def nested_model(info: FieldInfo) -> type[ParamModel] | None:
    """Return the model of a field that is itself a namespace."""
    if is_model(info.annotation):
        return info.annotation
    if get_origin(info.annotation) in (Union, types.UnionType):
        for arm in get_args(info.annotation):
            if is_model(arm):
                return arm
    return None


def is_frame(name: str) -> bool:
    """Return True for parameters that name a frame: `/map` and `map` are the same, tf2 accepts only the latter."""
    return name in _FRAMES


def unit_of(info: FieldInfo | None) -> str:
    """Return the unit of a field, empty if it has none."""
    extra = info.json_schema_extra if info is not None else None
    return str(extra.get("unit") or "") if isinstance(extra, dict) else ""


def bounds_of(info: FieldInfo) -> dict[str, float]:
    """Return the range of a field: `ge`, `gt`, `le`, `lt`."""
    found: dict[str, float] = {}
    for meta in info.metadata:
        for word in ("ge", "gt", "le", "lt"):
            limit = getattr(meta, word, None)
            if limit is not None:
                found[word] = limit
    return found


def iter_names(model: type[ParamModel]) -> Iterator[str]:
    """Yield every name that a user may write in the namespace of a model: current, previous and without effect."""
    yield from (n for n in model.model_fields if n != model.CHILD_FIELD and n not in model.FROM_NAVSTACK)
    yield from model.RENAMED
    yield from model.NO_EFFECT


def is_value(model: type[ParamModel], name: str) -> bool:
    """Return True if the model has a parameter, not a namespace, of that name."""
    info = model.model_fields.get(name)
    return nested_model(info) is None if info is not None else name in iter_names(model)


# ----------------------------------------------------------------------------------------------------------------------
# Messages about values that a field does not accept: the value, what is wrong, how to fix it.


_LIMITS = {
    "greater_than_equal": ("ge", "at least"),
    "greater_than": ("gt", "greater than"),
    "less_than_equal": ("le", "at most"),
    "less_than": ("lt", "less than"),
}
"""Error type of pydantic -> bound, text."""
_ENTRY_KINDS = {"float_type": "a number", "int_type": "an integer", "string_type": "text", "list_type": "a list"}


def show(value: Any) -> str:
    """Return a value for a message, as YAML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, float):
        return f"{value:g}"
    text = f'"{value}"' if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def expected(info: FieldInfo | None) -> str:
    """Return what a field accepts, as an instruction."""
    annotation = info.annotation if info is not None else None
    arms = [annotation]
    if get_origin(annotation) in (Union, types.UnionType):
        arms = [a for a in get_args(annotation) if a is not type(None)]
    text = " or ".join(dict.fromkeys(_kind(a) for a in arms))
    unit = unit_of(info)
    return f"write {text} ({unit})" if unit and text in ("a number", "an integer") else f"write {text}"


def _kind(annotation: Any) -> str:
    if get_origin(annotation) is Literal:
        return " or ".join(show(a) for a in get_args(annotation))
    if get_origin(annotation) is tuple and Ellipsis not in get_args(annotation):
        return f"a list of {len(get_args(annotation))}"
    if get_origin(annotation) in (list, tuple, Sequence):
        return "a list"
    names = {bool: "true or false", int: "an integer", float: "a number", str: "text"}
    return names.get(annotation, "another value")


def steps_of(error: Mapping[str, Any]) -> list[int]:
    """Return the list indices from a field's value to the wrong entry in it."""
    return [step for step in error["loc"][1:] if isinstance(step, int)]


def _kind_of(error: Mapping[str, Any]) -> str:
    """The type of a pydantic error; an entry missing from a list is not a missing parameter."""
    return "too_short" if error["type"] == "missing" and len(error["loc"]) > 1 else error["type"]


def rule_for(error: Mapping[str, Any]) -> str:
    """Return the rule that a pydantic error breaks."""
    kind = _kind_of(error)
    if kind in _LIMITS:
        return "out-of-range"
    if kind == "missing":
        return "missing"
    return "wrong-value" if kind in ("value_error", "literal_error", "enum") else "wrong-type"


def message_for(
    error: Mapping[str, Any],
    name: str,
    info: FieldInfo | None,
    node: Node | None,
    inside: bool = False,
    *,
    of_ros: bool = True,
) -> str:
    """Return the message for a pydantic error. `inside`: an entry of a list is wrong; `of_ros`: state what ROS does."""
    kind = _kind_of(error)
    value = plain(node) if node is not None else error.get("input")
    if kind in _LIMITS:
        return _range_message(kind, error["ctx"], name, info, value)
    if kind == "missing":
        return f"{name} is required; add `{name}: ...`"
    if kind == "value_error":
        return str(error["ctx"]["error"]).strip() if "ctx" in error and "error" in error["ctx"] else error["msg"]
    if kind == "finite_number":
        return f"{name} = {show(value)} is not finite; {expected(info)}"
    if kind in ("literal_error", "enum"):
        return f"{name} = {show(value)} is not a valid value; {expected(info)}"
    if kind in ("too_short", "too_long"):
        return f"{name} = {show(value)} has too {'few' if kind == 'too_short' else 'many'} entries; {expected(info)}"
    if kind == "string_too_short":
        return f"{name} = {show(value)}: {str(error['msg'])[0].lower()}{str(error['msg'])[1:]}"
    if value is None:
        return f"{name} has no value; {expected(info)} or remove the line"
    if inside:
        return f"{name} contains {show(value)}, which is not {_ENTRY_KINDS.get(kind, 'valid')}; correct it"
    return _type_message(kind, name, info, node, value, _ros_default(info) if of_ros else "")


def _type_message(kind: str, name: str, info: FieldInfo | None, node: Node | None, value: Any, default: str) -> str:
    if isinstance(node, ScalarNode) and node.quoted and _is_numeric(node.text) and kind in ("float_type", "int_type"):
        return f"{name} = {show(value)} is text, not a number, because it is quoted{default}; remove the quotes"
    if isinstance(node, ListNode):
        return f"{name} is a list; {expected(info)}"
    if isinstance(node, DictNode):
        return f"{name} is a namespace; {expected(info)}"
    return f"{name} = {show(value)} is {_type_of(value)}{default}; {expected(info)}"


def _ros_default(info: FieldInfo | None) -> str:
    if info is None or info.is_required() or info.default is None or isinstance(info.default, (tuple, list, dict)):
        return ""
    return f" (ROS ignores it and uses {show(info.default)})"


def _type_of(value: Any) -> str:
    if isinstance(value, bool):
        return "a boolean"
    if isinstance(value, (int, float)):
        return "a number"
    return "text" if isinstance(value, str) else "of another type"


def _is_numeric(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def clamped_message(name: str, info: FieldInfo, value: float, used: float) -> str:
    """Return the message for a value that is clamped, as ROS does silently."""
    allowed = _allowed(bounds_of(info), info)
    return f"{name} = {show(value)} is out of range, so {show(used)} is used, as in ROS; it must be {allowed}"


def _range_message(kind: str, ctx: Mapping[str, Any], name: str, info: FieldInfo | None, value: Any) -> str:
    word = _LIMITS[kind][0]
    allowed = _allowed(bounds_of(info) if info is not None else {word: ctx[word]}, info)
    return f"{name} = {show(value)} is out of range; it must be {allowed}"


def _allowed(bounds: Mapping[str, float], info: FieldInfo | None) -> str:
    texts = [f"{text} {show(float(bounds[word]))}" for word, text in _LIMITS.values() if word in bounds]
    return f"{' and '.join(texts)} {unit_of(info)}".rstrip()


# ----------------------------------------------------------------------------------------------------------------------
# Written values of a namespace -> validated parameter model, with a finding for each value that cannot be used.


Strictness = Literal["error", "warning"]
"""Severity of a wrong value: only a warning in a namespace that is not in use."""

MAX_NUMBER = 1e15
"""Largest magnitude of a float: squares and products of a few such numbers are finite, in float32 as well as sums."""

MAX_INTEGER = 2**63 - 1
_UNUSABLE = frozenset({"wrong-type", "out-of-range", "missing"})


class Written(NamedTuple):
    """The value of a field as written: full name, location of the key, value."""

    path: str
    at: Location
    node: Node


class Validator:
    """Converts and checks values; collects findings."""

    def __init__(self, findings: list[Finding], *, of_ros: bool = True) -> None:
        """`of_ros=False` for files that ROS does not read: floats are not rounded, messages do not mention ROS."""
        self.findings = findings
        self.of_ros = of_ros

    def add_finding(
        self,
        severity: Severity,
        rule: str,
        at: Location,
        key: str,
        message: str,
        suggestion: str | None = None,
        replacement: str | None = None,
    ) -> None:
        """Add a finding."""
        self.findings.append(finding(severity, rule, at, key, message, suggestion, replacement))

    def _is_of_ros(self, path: str) -> bool:
        """False for parameters that ROS does not read."""
        return self.of_ros and path.partition("/")[0] != "navstack"

    def validate(
        self,
        model: type[ParamModel],
        space: Space,
        written: Mapping[str, Written],
        fixed: Mapping[str, Any],
        strictness: Strictness,
    ) -> ParamModel | None:
        """Return the model of the written and the fixed values; None if a value cannot be used."""
        values: dict[str, Any] = dict(fixed)
        good = True
        for name, value in written.items():
            before = len(self.findings)
            converted = self._convert(model, name, value, strictness)
            if any(f.severity == "error" or f.rule in _UNUSABLE for f in self.findings[before:]):
                good = False
            else:
                values[name] = converted
        # wrong values are dropped until the rest validates, so that all of them are reported
        dropped = False
        while True:
            try:
                made = model.model_validate(values)
            except ValidationError as exc:
                errors = [e for e in exc.errors(include_url=False) if _is_new(e, written, dropped)]
                good = False
                self._report(model, space, written, errors, strictness)
                wrong = {str(e["loc"][0]) for e in errors if e["loc"]} & values.keys()
                if not wrong:
                    return None
                for name in wrong:
                    del values[name]
                dropped = True
                continue
            return made if good or strictness == "warning" else None

    # --- conversion ---------------------------------------------------------------------------------------------------

    def _convert(self, model: type[ParamModel], name: str, written: Written, strictness: Strictness) -> Any:
        info = model.model_fields[name]
        path, _, node = written
        if isinstance(node, ScalarNode) and isinstance(node.value, str) and "$(" in node.value:
            message = f"{name} = {show(node.value)} contains a substitution of roslaunch; load the launch file or write the value"
            self.add_finding("warning", "unfilled", node.at, path, message)
        value = self._coerce(info.annotation, node, path, strictness)
        if isinstance(value, str) and is_frame(name):
            value = value.lstrip("/")
        if isinstance(value, float) and math.isnan(value) and isinstance(node, ScalarNode):
            self.add_finding(strictness, "wrong-type", node.at, path, f"{name} is not a number (nan); {expected(info)}")
        too_large = _beyond(value)
        if too_large is not None:
            why = f"sums and products of numbers beyond {MAX_NUMBER:g} overflow"
            if isinstance(too_large, int):
                why = "an integer has 64 bits"
            message = f"{name} = {short_repr(too_large)} is out of range: {why}; {expected(info)}"
            self.add_finding(strictness, "out-of-range", node.at, path, message)
        in_use = strictness == "error"
        if (
            in_use
            and self.of_ros
            and name in model.CLAMPED
            and isinstance(value, (int, float))
            and not isinstance(value, bool)
        ):
            return self._clamped(info, name, value, node, path)
        return value

    def _clamped(self, info: FieldInfo, name: str, value: float, node: Node, path: str) -> float:
        """The value as ROS uses it: dynamic_reconfigure clamps it to the range."""
        bounds = bounds_of(info)
        limit = min(max(value, bounds.get("ge", -math.inf)), bounds.get("le", math.inf))
        if limit == value or not math.isfinite(value):
            return value
        limit = int(limit) if info.annotation is int else float(limit)
        message = clamped_message(name, info, value, limit)
        self.add_finding("warning", "clamped", node.at, path, message, show(limit))
        return limit

    def _coerce(self, annotation: Any, node: Node, path: str, strictness: Strictness) -> Any:
        """Convert a node to the types that strict models accept: tuples for tuples, whole floats to ints."""
        origin = get_origin(annotation)
        if origin in (Union, types.UnionType):
            arms = [a for a in get_args(annotation) if a is not type(None)]
            if isinstance(node, ScalarNode):
                if any(_fits(a, node) for a in arms):
                    return node.value
                scalars = [a for a in arms if a in (int, float, str, bool)]
                return self._coerce(scalars[0], node, path, strictness) if scalars else node.value
            lists = [a for a in arms if get_origin(a) in (list, tuple, Sequence)]
            return self._coerce(lists[0], node, path, strictness) if lists else plain(node)
        if isinstance(node, ListNode) and origin in (list, tuple, Sequence):
            return self._coerce_list(annotation, node, path, strictness)
        if is_model(annotation) and isinstance(node, DictNode):
            return self._entry(annotation, node, path, strictness)
        if isinstance(node, ScalarNode):
            if annotation is int and self.of_ros and isinstance(node.value, float) and math.isfinite(node.value):
                return self._rounded(node, path)
            return node.value
        return plain(node)

    def _coerce_list(self, annotation: Any, node: ListNode, path: str, strictness: Strictness) -> Any:
        args, is_tuple = get_args(annotation), get_origin(annotation) is tuple
        fixed = is_tuple and args[-1:] != (Ellipsis,)
        items: list[Any] = []
        for i, item in enumerate(node.items):
            inner = args[i] if fixed and i < len(args) else (args[0] if args and not fixed else Any)
            items.append(self._coerce(inner, item, f"{path}[{i}]", strictness))
        return tuple(items) if is_tuple else items

    def _rounded(self, node: ScalarNode, path: str) -> int:
        """Round a float that is read as an integer, as roscpp does."""
        value: float = node.value
        whole = math.floor(value + 0.5)
        if whole != value:
            name = path.rpartition("/")[2]
            message = (
                f"{name} = {show(value)} is rounded to {whole}, as in ROS, because {name} is an integer; write {whole}"
            )
            self.add_finding("warning", "rounded", node.at, path, message, str(whole))
        return whole

    def _entry(self, model: type[ParamModel], node: DictNode, path: str, strictness: Strictness) -> Any:
        """A mapping in a list, as its model."""
        values: dict[str, Any] = {}
        for name, (at, value) in node.items.items():
            if name in model.model_fields:
                values[name] = self._coerce(model.model_fields[name].annotation, value, f"{path}/{name}", strictness)
            else:
                known = ", ".join(model.model_fields)
                message = f"{name} has no effect in an entry of this list; use {known}"
                self.add_finding("warning", "unknown", at, f"{path}/{name}", message)
        try:
            return model.model_validate(values)
        except ValidationError as exc:
            for error in exc.errors(include_url=False):
                name = str(error["loc"][0]) if error["loc"] else ""
                found = node.items.get(name)
                at, value = found if found else (node.at, None)
                text = message_for(error, name, model.model_fields.get(name), value, of_ros=self._is_of_ros(path))
                self.add_finding(strictness, rule_for(error), value.at if value else at, f"{path}/{name}", text)
            return plain(node)

    # --- findings -----------------------------------------------------------------------------------------------------

    def _report(
        self,
        model: type[ParamModel],
        space: Space,
        written: Mapping[str, Written],
        errors: Sequence[Any],
        strictness: Strictness,
    ) -> None:
        for name in dict.fromkeys(_name_of(e) for e in errors):
            of_name = [e for e in errors if _name_of(e) == name]
            # of the arms of a union, the one that matched most of the value describes the error best
            deepest = max(len(steps_of(e)) for e in of_name)
            where = written.get(name) or (space.join(name) if name else space.path, space.at, None)
            self._report_value([e for e in of_name if len(steps_of(e)) == deepest], name, model, where, strictness)

    def _report_value(
        self,
        errors: Iterable[Any],
        name: str,
        model: type[ParamModel],
        written: tuple[str, Location, Node | None],
        strictness: Strictness,
    ) -> None:
        path, at, node = written
        messages: set[str] = set()
        for error in errors:
            here = node
            for step in steps_of(error):
                here = here.items[step] if isinstance(here, ListNode) and step < len(here.items) else here
            inside = bool(steps_of(error))
            text = message_for(error, name, model.model_fields.get(name), here, inside, of_ros=self._is_of_ros(path))
            if text not in messages and not (messages and here is node):
                self.add_finding(strictness, rule_for(error), here.at if here is not None else at, path, text)
            messages.add(text)


def _name_of(error: Any) -> str:
    return str(error["loc"][0]) if error["loc"] else ""


def _is_new(error: Any, written: Mapping[str, Written], dropped: bool) -> bool:
    """False for a consequence of a value that was reported and dropped: a missing field, a check of the whole model."""
    if error["type"] == "missing" and len(error["loc"]) == 1 and error["loc"][0] in written:
        return False
    return bool(error["loc"]) or not dropped


def _beyond(value: Any) -> float | int | None:
    """A finite number in the value that no computation can use, None if there is none."""
    if isinstance(value, (list, tuple)):
        found = (_beyond(item) for item in value)
        return next((number for number in found if number is not None), None)
    if isinstance(value, int):
        return value if abs(value) > MAX_INTEGER else None
    return value if isinstance(value, float) and math.isfinite(value) and abs(value) > MAX_NUMBER else None


def _fits(annotation: Any, node: ScalarNode) -> bool:
    value = node.value
    if get_origin(annotation) is Literal:
        return value in get_args(annotation)
    if annotation is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    return isinstance(annotation, type) and type(value) is annotation


class Binder:
    """Builds models from namespaces, collects findings and marks what was used."""

    def __init__(
        self, findings: list[Finding], navstack: Mapping[str, Any] | None = None, *, of_ros: bool = True
    ) -> None:
        """`navstack` are the values of fields in `FROM_NAVSTACK`.

        `of_ros=False` for files that ROS does not read: floats are not rounded, messages do not mention ROS.
        """
        self.findings = findings
        self.navstack = dict(navstack or {})
        self.bound: list[tuple[Space, type[ParamModel]]] = []
        """The model that read each namespace."""
        self.origins: dict[str, Location] = {}
        """Full current name of a parameter -> location of its value; defaults are absent."""
        self._validator = Validator(findings, of_ros=of_ros)

    def bind(
        self,
        model: type[ParamModel],
        space: Space,
        *,
        fixed: Mapping[str, Any] | None = None,
        nodes: Mapping[str, tuple[Location, Node]] | None = None,
        strictness: Strictness = "error",
    ) -> ParamModel | None:
        """Return the model of `space`, None if a value cannot be used.

        `fixed` are values that code sets instead of the user; `nodes` replace values of the tree (with their locations).
        `strictness` is the severity of wrong values: "warning" for a namespace that is not in use.
        """
        space.used = True
        self.bound.append((space, model))
        written = self._written(model, space, fixed or {}, nodes or {})
        self.origins.update({space.join(name): value.node.at for name, value in written.items()})
        values: dict[str, Any] = {n: self.navstack[n] for n in sorted(model.FROM_NAVSTACK) if n in self.navstack}
        values.update(fixed or {})
        raw = {n: plain(w.node) for n, w in written.items()} | {n: _raw(v) for n, v in values.items()}
        below = self._children(model, space, raw, values, strictness) if model.CHILD_FIELD is not None else True
        nested = self._nested(model, space, values, strictness)
        # validated even after an error below, so that every wrong value is reported
        made = self._validator.validate(model, space, written, values, strictness)
        return made if below and nested else None

    def child(self, parent: Space, name: str, strictness: Strictness = "error") -> Space:
        """Return the namespace `name` of `parent`, empty if it is not written; a value in its place is a finding."""
        found = parent.children.get(name)
        if isinstance(found, Space):
            return found
        if found is not None:
            is_read = any(is_value(m, name) for s, m in self.bound if s is parent)
            found.used = found.used or not is_read
            if found.value is not None and not is_read:
                message = (
                    f"{name} = {show(found.value)} is a value, but {name} is a namespace of parameters; write the parameters "
                    f"indented below `{name}:`"
                )
                self._validator.add_finding(strictness, "wrong-type", found.node.at, found.path, message)
        return Space(parent.join(name), parent.at, parent)

    # --- values -------------------------------------------------------------------------------------------------------

    def _written(
        self,
        model: type[ParamModel],
        space: Space,
        fixed: Mapping[str, Any],
        nodes: Mapping[str, tuple[Location, Node]],
    ) -> dict[str, Written]:
        """The value of every field that is written, and marks it as used."""
        written: dict[str, Written] = {}
        for name, info in model.model_fields.items():
            if name in model.FROM_NAVSTACK or name in fixed or name == model.CHILD_FIELD or nested_model(info):
                continue
            if name in nodes:
                written[name] = Written(space.join(name), *nodes[name])
                continue
            leaf = self._find(model, name, space)
            if leaf is not None:
                leaf.used = True
                written[name] = Written(leaf.path, leaf.at, leaf.node)
        return written

    def _find(self, model: type[ParamModel], name: str, space: Space) -> Leaf | None:
        own = space.leaf(name) or self._find_renamed(model, name, space)
        if name in model.FROM_PARENT and space.parent is not None:
            parents = space.parent.leaf(name)
            if parents is not None:
                return self._overridden(name, own, parents, space, space.parent)
        if own is None and name in model.SEARCHED and space.parent is not None:
            return space.parent.search(name)
        return own

    def _overridden(self, name: str, own: Leaf | None, parents: Leaf, space: Space, parent: Space) -> Leaf:
        """The parent's parameter, which overrides the namespace's own."""
        if own is not None:
            own.used = True
            if own.value != parents.value:
                message = (
                    f"{own.name} = {show(own.value)} of {space.name} is overridden by {show(parents.value)} of the enclosing "
                    f"{parent.name or 'namespace'} ({parents.at}), as in ROS; remove one of them"
                )
                self._validator.add_finding("info", "overridden-by-parent", own.at, own.path, message)
        parents.used = True
        # ROS overwrites the value on the parameter server: a search from below finds the parent's
        return space.put(name, parents.at, parents.node)

    def _find_renamed(self, model: type[ParamModel], name: str, space: Space) -> Leaf | None:
        for old, new in model.RENAMED.items():
            if new == name and (leaf := space.leaf(old)) is not None:
                leaf.used = True
                ros = f"; its value {show(leaf.value)} is used here, but current ROS releases may ignore it"
                message = (
                    f"{old} is the previous name of {new}{ros if self._validator.of_ros else ''}; rename it to {new}"
                )
                self._validator.add_finding("info", "renamed", leaf.at, leaf.path, message, new, new)
                return leaf
        return None

    # --- namespaces below ---------------------------------------------------------------------------------------------

    def _children(
        self,
        model: type[ParamModel],
        space: Space,
        raw: Mapping[str, Any],
        values: dict[str, Any],
        strictness: Strictness,
    ) -> bool:
        """Bind the namespaces whose names depend on values into `values`; False after an error."""
        good = True
        children: dict[str, ParamModel] = {}
        outer = _namespaces(space.parent) if space.parent is not None else {}
        raw = {**_namespaces(space), **raw}
        shared = model.shared_children({**outer, **raw})
        models = model.child_models({**{n: v for n, v in outer.items() if n in shared}, **raw})
        for name, child_model in models.items():
            beside = space.parent if name in shared and space.space(name) is None else None
            holder = beside if beside is not None and beside.space(name) is not None else space
            made = self.bind(child_model, self.child(holder, name, strictness), strictness=strictness)
            good = good and made is not None
            if made is not None:
                children[name] = made
            if holder is not space:
                self._share_origins(holder.join(name), space.join(name))
        assert model.CHILD_FIELD is not None
        values[model.CHILD_FIELD] = children
        return good

    def _share_origins(self, there: str, here: str) -> None:
        """Record the locations of the values below `there` also below `here`, the namespace that they are used in."""
        found = {name: at for name, at in self.origins.items() if name.startswith(f"{there}/")}
        self.origins.update({here + name[len(there) :]: at for name, at in found.items()})

    def _nested(self, model: type[ParamModel], space: Space, values: dict[str, Any], strictness: Strictness) -> bool:
        """Bind the fields that are namespaces into `values`; False after an error."""
        good = True
        for name, info in model.model_fields.items():
            inner = nested_model(info)
            if inner is None or name == model.CHILD_FIELD or name in values:
                continue
            if space.children.get(name) is None and not info.is_required() and not is_model(info.annotation):
                continue
            made = self.bind(inner, self.child(space, name, strictness), strictness=strictness)
            good = good and made is not None
            if made is not None:
                values[name] = made
        return good


def _namespaces(space: Space) -> dict[str, Any]:
    """The namespaces below one, as dictionaries."""
    return {name: child.as_dict() for name, child in space.children.items() if isinstance(child, Space)}


def _raw(value: Any) -> Any:
    """A value set by code, as a user would write it."""
    if isinstance(value, ParamModel):
        return value.model_dump()
    return [_raw(v) for v in value] if isinstance(value, list) else value
