"""Reads the shapes and the success conditions of a scenario file."""

from __future__ import annotations

from navstack.core.parameters import ParamModel
from navstack.parameters.spelling import nearest
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode
from navstack.scenario.file.context import ReadContext, describe
from navstack.scenario.file.models import MOTIONS, Success
from navstack.scenario.record_schema import too_many_pedestrians
from navstack.sim.shapes import PedestrianMotion, Shape

_SYNONYMS = {
    "at": "pose",
    "position": "pose",
    "type": "motion",
    "kind": "motion",
    "size": "box",
    "width": "box",
    "points": "polygon",
    "low": "height",
    "speed": "motion: {kind: .., speed: ..}",
}
"""Other names that users may try for a key of a shape -> the key."""
_EXAMPLE = "{radius: 0.2, pose: [3.0, 1.5]}"


def read_shapes(context: ReadContext) -> None:
    """Reads `shapes:`."""
    node = context.section("shapes")
    if node is None or (isinstance(node, ScalarNode) and node.value is None):
        return
    if not isinstance(node, ListNode):
        context.type_error(node, "shapes", f"a list, for example {_EXAMPLE}")
        return
    made = [_read_shape(context, item, f"shape {i}") for i, item in enumerate(node.items, 1)]
    context.parts.shapes = tuple(shape for shape in made if shape is not None)
    walking = sum(isinstance(shape.motion, PedestrianMotion) for shape in context.parts.shapes)
    problem = too_many_pedestrians(walking)
    if problem is not None:
        context.error("wrong-value", node.at, "shapes", f"shapes has {problem}; remove some")


def _read_shape(context: ReadContext, node: Node, name: str) -> Shape | None:
    if not isinstance(node, DictNode):
        context.type_error(node, name, f"a mapping, for example {_EXAMPLE}")
        return None
    before = len(context.findings)
    context.check_keys(node, Shape.model_fields, name, _SYNONYMS)
    motion = _read_motion(context, node.items["motion"][1], name) if "motion" in node.items else None
    other_values = {key: value for key, value in node.items.items() if key != "motion"}
    fixed = {} if motion is None else {"motion": motion}
    made = context.bind(Shape, DictNode(other_values, node.at), name, fixed)
    return None if any(f.severity == "error" for f in context.findings[before:]) else made


def _read_motion(context: ReadContext, node: Node, name: str) -> ParamModel | None:
    kinds = ", ".join(MOTIONS)
    if not isinstance(node, DictNode):
        message = f"the motion of {name} is {describe(node)}; write {{kind: .., ..}}, where kind is one of {kinds}"
        context.error("wrong-type", node.at, name, message)
        return None
    if "kind" not in node.items:
        context.error("missing", node.at, name, f"the motion of {name} has no kind; add `kind:`, one of {kinds}")
        return None
    kind = context.text(node.items["kind"][1], "kind", f"one of {kinds}")
    if kind is None:
        return None
    if kind not in MOTIONS:
        close = nearest(kind, MOTIONS)
        hint = f"did you mean {close}?" if close else f"known kinds: {kinds}"
        message = f'the motion of {name} has the unknown kind "{kind}"; {hint}'
        context.error("unknown", node.items["kind"][1].at, name, message, close)
        return None
    model = MOTIONS[kind]
    context.check_keys(node, (*model.model_fields, *model.RENAMED), f"a motion of kind {kind}")
    return context.bind(model, node, f"{name}/motion")


def read_success(context: ReadContext) -> None:
    """Reads `success:`."""
    node = context.mapping("success", "conditions indented below it, for example `max_time: 60`")
    if node is None:
        return
    context.check_keys(node, (*Success.model_fields, *Success.RENAMED), "success")
    made = context.bind(Success, node, "success")
    if made is None:
        return
    context.parts.success = made
    count = len(context.parts.steps or context.parts.goals)
    if isinstance(made.goals, list) and count and len(made.goals) != count:
        at = node.items["goals"][1].at
        listed, needed = _plural(len(made.goals), "state"), _plural(count, "goal")
        message = f"success lists {listed} for {needed}; list one state per goal, or give a single state for all"
        context.error("wrong-value", at, "success/goals", message)


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
