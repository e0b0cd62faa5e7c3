"""Reads the interactions of a scenario file."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from navstack.core.bounded_reading import short_repr
from navstack.parameters.spelling import nearest
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain
from navstack.scenario.file.context import ReadContext, describe
from navstack.scenario.interactions import INTERACTION, KINDS
from navstack.scenario.record_schema import MAX_INTERACTIONS

_EXAMPLE = "{time: 5.0, kind: goal, pose: [3.0, 1.5, 0.0]}"


def read_interactions(context: ReadContext) -> None:
    """Reads `interactions:`."""
    node = context.section("interactions")
    if node is None or (isinstance(node, ScalarNode) and node.value is None):
        return
    if not isinstance(node, ListNode):
        context.type_error(node, "interactions", f"a list, for example {_EXAMPLE}")
        return
    if len(node.items) > MAX_INTERACTIONS:
        message = f"{len(node.items)} interactions; a scenario has at most {MAX_INTERACTIONS}"
        context.error("wrong-value", node.at, "interactions", message)
        return
    made = [_read(context, item, f"interaction {number}") for number, item in enumerate(node.items, 1)]
    context.parts.interactions = tuple(item for item in made if item is not None)


def _read(context: ReadContext, node: Node, name: str) -> Any:
    if not isinstance(node, DictNode):
        context.type_error(node, name, f"a mapping, for example {_EXAMPLE}")
        return None
    kind = node.items.get("kind")
    value = plain(kind[1]) if kind is not None else None
    if value not in KINDS:
        close = nearest(value, KINDS) if isinstance(value, str) else None
        given = f"has no kind; add `kind:`, one of {', '.join(KINDS)}"
        if kind is not None:
            hint = f"did you mean {close}?" if close else f"known kinds: {', '.join(KINDS)}"
            given = f"has the unknown kind {describe(kind[1])}; {hint}"
        context.error("wrong-value", node.at, name, f"{name} {given}", close)
        return None
    try:
        return INTERACTION.validate_python(plain(node))
    except ValidationError as exc:
        for error in exc.errors(include_url=False, include_context=False)[:5]:
            where = ".".join(str(step) for step in error["loc"][1:])
            what = f" = {short_repr(error['input'])}" if error["type"] != "missing" else ""
            message = error["msg"].removeprefix("Value error, ")
            context.error("wrong-value", node.at, name, f"{name}: {where}{what}: {message}")
        return None
