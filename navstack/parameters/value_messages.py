"""Messages about values that a field does not accept: the value, what is wrong, how to fix it."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from navstack.parameters.model_fields import bounds_of, unit_of
from navstack.parameters.yaml_nodes import DictNode, ListNode, Node, ScalarNode, plain

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
