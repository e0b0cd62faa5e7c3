"""A namespace of the tree -> a parameter model, with a finding for everything that is not as it seems."""

from __future__ import annotations

import math
import types
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, TypeGuard, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from navstack.core.parameters import ParamModel
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain

Strictness = Literal["error", "warning"]


def is_model(annotation: Any) -> TypeGuard[type[ParamModel]]:
    """True for a parameter model."""
    return isinstance(annotation, type) and issubclass(annotation, ParamModel)


def nested_model(info: FieldInfo) -> type[ParamModel] | None:
    """The model of a field that is a namespace of its own."""
    if is_model(info.annotation):
        return info.annotation
    if get_origin(info.annotation) in (Union, types.UnionType):
        for arm in get_args(info.annotation):
            if is_model(arm):
                return arm
    return None


def frame_name(name: str) -> bool:
    """True for parameters that name a coordinate frame (`/map` and `map` are one, tf2 takes only the latter)."""
    return name in ("global_frame", "robot_base_frame", "sensor_frame", "global_frame_id", "frame", "frame_id")


class Binder:
    """Builds models; collects findings; marks what was used."""

    def __init__(
        self, findings: list[Finding], navstack: Mapping[str, Any] | None = None, *, of_ros: bool = True
    ) -> None:
        """`of_ros=False` for what is no parameter of ROS: nothing is rounded, and messages leave out what ROS would do."""
        self.findings = findings
        self.of_ros = of_ros
        self.navstack = dict(navstack or {})
        self.bound: list[tuple[Space, type[ParamModel]]] = []
        """Which model each namespace was read with, for telling what is left over."""
        self.origins: dict[str, Location] = {}
        """Parameter by its full name of today -> where its value was written; not there: the default."""

    def bind(
        self,
        model: type[ParamModel],
        space: Space,
        *,
        fixed: Mapping[str, Any] | None = None,
        nodes: Mapping[str, tuple[Location, Node]] | None = None,
        strictness: Strictness = "error",
    ) -> ParamModel | None:
        """The model of `space`; None when a value cannot be used.

        `fixed` are values that code gives instead of the user; `nodes` replace values of the tree (with their places).
        `strictness` is how bad a wrong value is: a namespace that nothing uses gets warnings only.
        """
        space.used = True
        self.bound.append((space, model))
        chosen: dict[str, tuple[str, Location, Node]] = {}
        for name, info in model.model_fields.items():
            if (
                name in model.FROM_NAVSTACK
                or (fixed and name in fixed)
                or name == model.CHILD_FIELD
                or nested_model(info)
            ):
                continue
            if nodes and name in nodes:
                chosen[name] = (space.join(name), *nodes[name])
                continue
            leaf = self._choose(model, name, space)
            if leaf is not None:
                leaf.used = True
                chosen[name] = (leaf.path, leaf.at, leaf.node)
        self.origins.update({space.join(n): node.at for n, (_, _, node) in chosen.items()})
        given: dict[str, Any] = {n: self.navstack[n] for n in sorted(model.FROM_NAVSTACK) if n in self.navstack}
        given.update(fixed or {})
        values = {n: plain(node) for n, (_, _, node) in chosen.items()} | {n: _raw(v) for n, v in given.items()}
        ok = True
        children: dict[str, ParamModel] = {}
        for child, child_model in model.child_models(values).items():
            made = self.bind(child_model, self.child(space, child, strictness), strictness=strictness)
            ok = ok and made is not None
            if made is not None:
                children[child] = made
        if model.CHILD_FIELD is not None:
            given[model.CHILD_FIELD] = children
        for name, info in model.model_fields.items():
            inner = nested_model(info)
            if inner is None or name == model.CHILD_FIELD or name in given:
                continue
            if space.children.get(name) is None and not info.is_required() and not is_model(info.annotation):
                continue
            made = self.bind(inner, self.child(space, name, strictness), strictness=strictness)
            ok = ok and made is not None
            if made is not None:
                given[name] = made
        return (
            self._validate(model, space, chosen, given, strictness)
            if ok
            else self._only_check(model, space, chosen, given, strictness)
        )

    def child(self, parent: Space, name: str, strictness: Strictness = "error") -> Space:
        """The namespace `name` of `parent`, an empty one where nobody wrote it; a value in its place is a finding."""
        found = parent.children.get(name)
        if isinstance(found, Space):
            return found
        if found is not None:
            read = any(_is_value(m, name) for s, m in self.bound if s is parent)
            found.used = found.used or not read
            if found.value is not None and not read:
                message = (
                    f"{name} is a namespace of parameters, not {show(found.value)}; write the parameters indented below "
                    f"`{name}:`"
                )
                self.say(strictness, "wrong-type", found.node.at, found.path, message)
        return Space(parent.join(name), parent.at, parent)

    def _of_ros(self, path: str) -> bool:
        """False for parameters that ROS does not read."""
        return self.of_ros and path.partition("/")[0] != "navstack"

    def _only_check(self, *args: Any) -> None:
        """Finds what else is wrong, for a model that a namespace below it already spoils."""
        self._validate(*args)

    # --- which value ------------------------------------------------------------------------------------------------

    def _choose(self, model: type[ParamModel], name: str, space: Space) -> Leaf | None:
        own = space.leaf(name) or self._renamed(model, name, space)
        if name in model.FROM_PARENT and space.parent is not None:
            parents = space.parent.leaf(name)
            if parents is not None:
                if own is not None and own.value != parents.value:
                    own.used = True
                    self.say(
                        "info",
                        "overridden-by-parent",
                        own.at,
                        own.path,
                        f"{own.name} = {show(own.value)} of {space.name} is overridden by {show(parents.value)} of the "
                        f"enclosing {space.parent.name or 'namespace'} ({parents.at}), as in ROS; remove one of them",
                    )
                elif own is not None:
                    own.used = True
                parents.used = True
                # the parameter server's own value is overwritten: what searches from below finds the parent's
                return space.put(name, parents.at, parents.node)
        if own is None and name in model.SEARCHED and space.parent is not None:
            return space.parent.search(name)
        return own

    def _renamed(self, model: type[ParamModel], name: str, space: Space) -> Leaf | None:
        for old, new in model.RENAMED.items():
            if new == name and (leaf := space.leaf(old)) is not None:
                leaf.used = True
                self.say(
                    "info",
                    "renamed",
                    leaf.at,
                    leaf.path,
                    f"{old} is called {new} today; its value {show(leaf.value)} is taken for it here; rename it"
                    + (", so that every ROS release takes it" if self.of_ros else ""),
                    new,
                )
                return leaf
        return None

    # --- checking ---------------------------------------------------------------------------------------------------

    def _validate(
        self,
        model: type[ParamModel],
        space: Space,
        chosen: Mapping[str, tuple[str, Location, Node]],
        given: Mapping[str, Any],
        strictness: Strictness,
    ) -> ParamModel | None:
        ready: dict[str, Any] = dict(given)
        good = True
        for name, (path, _, node) in chosen.items():
            before = len(self.findings)
            info = model.model_fields[name]
            if isinstance(node, ScalarNode) and isinstance(node.value, str) and "$(" in node.value:
                message = (
                    f"{name} = {show(node.value)} is filled in by roslaunch; load the launch file, or write the value"
                )
                self.say("warning", "unfilled", node.at, path, message)
            value = self._coerce(info.annotation, node, path, strictness)
            if isinstance(value, str) and frame_name(name):
                value = value.lstrip("/")
            if isinstance(value, float) and math.isnan(value) and isinstance(node, ScalarNode):
                self.say(strictness, "wrong-type", node.at, path, f"{name} is not a number (nan); {expected(info)}")
            if any(f.severity == "error" or f.rule in _BAD for f in self.findings[before:]):
                good = False
                continue
            ready[name] = value
        dropped: set[str] = set()
        while True:
            try:
                made = model.model_validate({k: v for k, v in ready.items() if k not in dropped})
            except ValidationError as exc:
                good = False
                # what is there but wrong has been said: it is not missing as well, and the rest may suit it
                errors = [
                    e
                    for e in exc.errors(include_url=False)
                    if (e["type"] != "missing" or len(e["loc"]) != 1 or e["loc"][0] not in chosen)
                    and (e["loc"] or not dropped)
                ]
                self._report(model, space, chosen, errors, strictness)
                bad = {str(e["loc"][0]) for e in errors if e["loc"]} & (ready.keys() - dropped)
                if not bad:
                    return None
                dropped |= bad
                continue
            return made if good or strictness == "warning" else None

    def _coerce(self, annotation: Any, node: Node, path: str, strictness: Strictness) -> Any:
        """The node as the values that strict models take: tuples where they want tuples, whole floats as ints."""
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
            args = get_args(annotation)
            fixed = origin is tuple and args[-1:] != (Ellipsis,)
            items: list[Any] = []
            for i, item in enumerate(node.items):
                inner = args[i] if fixed and i < len(args) else (args[0] if args and not fixed else Any)
                items.append(self._coerce(inner, item, f"{path}[{i}]", strictness))
            return tuple(items) if origin is tuple else items
        if is_model(annotation) and isinstance(node, DictNode):
            return self._entry(annotation, node, path, strictness)
        if isinstance(node, ScalarNode):
            if annotation is int and self.of_ros and isinstance(node.value, float) and math.isfinite(node.value):
                return self._whole(node, path)
            return node.value
        return plain(node)

    def _whole(self, node: ScalarNode, path: str) -> int:
        """Roscpp rounds a float that is read as an integer."""
        value: float = node.value
        whole = math.floor(value + 0.5)
        if whole != value:
            name = path.rpartition("/")[2]
            self.say(
                "warning",
                "rounded",
                node.at,
                path,
                f"{name} takes whole numbers only; {show(value)} is rounded to {whole}, as in ROS; write {whole}",
                str(whole),
            )
        return whole

    def _entry(self, model: type[ParamModel], node: DictNode, path: str, strictness: Strictness) -> Any:
        """A mapping in a list, as its model."""
        ready: dict[str, Any] = {}
        for name, (at, value) in node.items.items():
            if name in model.model_fields:
                ready[name] = self._coerce(model.model_fields[name].annotation, value, f"{path}/{name}", strictness)
            else:
                known = ", ".join(model.model_fields)
                self.say(
                    "warning", "unknown", at, f"{path}/{name}", f"{name} is not read in this list; it takes {known}"
                )
        try:
            return model.model_validate(ready)
        except ValidationError as exc:
            for error in exc.errors(include_url=False):
                name = str(error["loc"][0]) if error["loc"] else ""
                found = node.items.get(name)
                at = found[1].at if found else node.at
                text = message_for(
                    error, name, model.model_fields.get(name), found[1] if found else None, of_ros=self._of_ros(path)
                )
                self.say(strictness, rule_for(error), at, f"{path}/{name}", text)
            return plain(node)

    def _report(
        self,
        model: type[ParamModel],
        space: Space,
        chosen: Mapping[str, tuple[str, Location, Node]],
        errors: Sequence[Any],
        strictness: Strictness,
    ) -> None:
        for name in dict.fromkeys(str(e["loc"][0]) if e["loc"] else "" for e in errors):
            of_name = [e for e in errors if (str(e["loc"][0]) if e["loc"] else "") == name]
            # of a union's arms, the one that got farthest into the value knows best what is wrong with it
            deepest = max(len(_steps(e)) for e in of_name)
            path, at, node = chosen.get(name, (space.join(name) if name else space.path, space.at, None))
            said: set[str] = set()
            for error in (e for e in of_name if len(_steps(e)) == deepest):
                here = node
                for step in _steps(error):
                    here = here.items[step] if isinstance(here, ListNode) and step < len(here.items) else here
                text = message_for(
                    error, name, model.model_fields.get(name), here, bool(_steps(error)), of_ros=self._of_ros(path)
                )
                if text not in said and not (said and here is node):
                    self.say(strictness, rule_for(error), here.at if here is not None else at, path, text)
                said.add(text)

    def say(
        self, severity: Severity, rule: str, at: Location, key: str, message: str, suggestion: str | None = None
    ) -> None:
        """Adds a finding."""
        self.findings.append(finding(severity, rule, at, key, message, suggestion))


_BAD = frozenset({"wrong-type", "out-of-range", "missing"})


def _raw(value: Any) -> Any:
    """A value given by code, as a user would have written it."""
    if isinstance(value, ParamModel):
        return value.model_dump()
    return [_raw(v) for v in value] if isinstance(value, list) else value


def _fits(annotation: Any, node: ScalarNode) -> bool:
    value = node.value
    if get_origin(annotation) is Literal:
        return value in get_args(annotation)
    if annotation is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    return isinstance(annotation, type) and type(value) is annotation


# --- words ------------------------------------------------------------------------------------------------------------


def show(value: Any) -> str:
    """A value in a message, as YAML would write it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "nothing"
    if isinstance(value, float):
        return f"{value:g}"
    text = f'"{value}"' if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def expected(info: FieldInfo | None) -> str:
    """What a field takes, as an instruction."""
    annotation = info.annotation if info is not None else None
    arms = [annotation]
    if get_origin(annotation) in (Union, types.UnionType):
        arms = [a for a in get_args(annotation) if a is not type(None)]
    said = list(dict.fromkeys(_kind(a) for a in arms))
    text = " or ".join(said)
    extra = info.json_schema_extra if info is not None else None
    unit = extra.get("unit") if isinstance(extra, dict) else None
    return f"write {text} ({unit})" if unit and text in ("a number", "a whole number") else f"write {text}"


def _kind(annotation: Any) -> str:
    if get_origin(annotation) is Literal:
        return " or ".join(show(a) for a in get_args(annotation))
    if get_origin(annotation) is tuple and Ellipsis not in get_args(annotation):
        return f"a list of {len(get_args(annotation))}"
    if get_origin(annotation) in (list, tuple, Sequence):
        return "a list"
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
    return names.get(annotation, "another value")


def _default(info: FieldInfo | None) -> str:
    if info is None or info.is_required() or info.default is None or isinstance(info.default, (tuple, list, dict)):
        return ""
    return f"; ROS would ignore it and use {show(info.default)}"


_LIMITS = {
    "greater_than_equal": ("ge", "at least", True),
    "greater_than": ("gt", "over", False),
    "less_than_equal": ("le", "at most", True),
    "less_than": ("lt", "under", False),
}


def _steps(error: Mapping[str, Any]) -> list[int]:
    """Indices from a field's value down to what is wrong in it."""
    return [step for step in error["loc"][1:] if isinstance(step, int)]


def _is_value(model: type[ParamModel], name: str) -> bool:
    """True when the model knows a plain parameter of that name."""
    info = model.model_fields.get(name)
    return nested_model(info) is None if info is not None else name in iter_names(model)


def _kind_of(error: Mapping[str, Any]) -> str:
    """The type of a pydantic error; an entry that a list lacks is not a parameter that is missing."""
    return "too_short" if error["type"] == "missing" and len(error["loc"]) > 1 else error["type"]


def rule_for(error: Mapping[str, Any]) -> str:
    """The rule that a pydantic error breaks."""
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
    """A pydantic error in the words of this project: what, the value, the way out. `inside`: an entry of a list is wrong.

    `of_ros`: what ROS would do with it is said as well.
    """
    default = _default(info) if of_ros else ""
    kind = _kind_of(error)
    value = plain(node) if node is not None else error.get("input")
    if kind in _LIMITS:
        return _range_message(kind, error["ctx"], name, info, value, of_ros)
    if kind == "missing":
        return f"{name} is missing here; add `{name}: ...`"
    if kind == "value_error":
        return str(error["ctx"]["error"]).strip() if "ctx" in error and "error" in error["ctx"] else error["msg"]
    if kind == "finite_number":
        return f"{name} = {show(value)} is not finite; {expected(info)}"
    if kind in ("literal_error", "enum"):
        return f"{name} = {show(value)} is none of its values; {expected(info)}"
    if kind in ("too_short", "too_long"):
        return f"{name} = {show(value)} has too {'few' if kind == 'too_short' else 'many'} entries; {expected(info)}"
    if kind == "string_too_short":
        return f"{name} = {show(value)}: {str(error['msg'])[0].lower()}{str(error['msg'])[1:]}"
    if value is None:
        return f"{name} has no value; {expected(info)} or remove the line"
    if isinstance(node, ScalarNode) and node.quoted and _numeric(node.text) and kind in ("float_type", "int_type"):
        return f"{name} is the text {show(value)}, not a number, because of its quotes; take them away{default}"
    if inside:
        wanted = {"float_type": "a number", "int_type": "a whole number", "string_type": "text", "list_type": "a list"}
        return f"{name} holds {show(value)}, which is not {wanted.get(kind, 'right')}; correct it"
    if isinstance(node, ListNode):
        return f"{name} is a list; {expected(info)}"
    if isinstance(node, DictNode):
        return f"{name} is a namespace; {expected(info)}"
    return f"{name} = {show(value)} is {_is(value)}; {expected(info)}{default}"


def _is(value: Any) -> str:
    if isinstance(value, bool):
        return "a truth value"
    if isinstance(value, (int, float)):
        return "a number"
    return "text" if isinstance(value, str) else "something else"


def _numeric(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def bounds_of(info: FieldInfo) -> dict[str, float]:
    """The range of a field: `ge`, `gt`, `le`, `lt`."""
    found: dict[str, float] = {}
    for meta in info.metadata:
        for word in ("ge", "gt", "le", "lt"):
            limit = getattr(meta, word, None)
            if limit is not None:
                found[word] = limit
    return found


def _range_message(
    kind: str, ctx: Mapping[str, Any], name: str, info: FieldInfo | None, value: Any, of_ros: bool
) -> str:
    word, _, clamps = _LIMITS[kind]
    limit = ctx[word]
    bounds = bounds_of(info) if info is not None else {word: limit}
    allowed = " and ".join(f"{text} {show(float(bounds[w]))}" for w, text, _ in _LIMITS.values() if w in bounds)
    unit = ""
    if info is not None and isinstance(info.json_schema_extra, dict):
        unit = f" {info.json_schema_extra.get('unit') or ''}".rstrip()
    ros = f"; ROS would silently use {show(float(limit))}" if clamps and of_ros else ""
    return f"{name} = {show(value)} is out of range; it must be {allowed}{unit}{ros}"


def iter_names(model: type[ParamModel]) -> Iterator[str]:
    """Every name that a user may write in a model's namespace: today's, former ones, those without effect."""
    yield from (n for n in model.model_fields if n != model.CHILD_FIELD and n not in model.FROM_NAVSTACK)
    yield from model.RENAMED
    yield from model.NO_EFFECT
