"""Written values of a namespace -> validated parameter model, with a finding for each value that cannot be used."""

from __future__ import annotations

import math
import types
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from navstack.core.bounded_reading import short_repr
from navstack.core.parameters import ParamModel
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.model_fields import bounds_of, is_frame, is_model
from navstack.parameters.tree import Space
from navstack.parameters.value_messages import clamped_message, expected, message_for, rule_for, show, steps_of
from navstack.parameters.yaml_nodes import DictNode, ListNode, Node, ScalarNode, plain

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
            message = (
                f"{name} = {short_repr(too_large)} is out of range: sums and products of numbers beyond {MAX_NUMBER:g} "
                f"overflow; {expected(info)}"
            )
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
