"""Reads the start, the goals and the tour of a scenario file."""

from __future__ import annotations

from navstack.core import Pose2D
from navstack.core.errors import InputError
from navstack.motion.steps import GoToStep, Step, read_step, step_text
from navstack.parameters.findings import Location
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain
from navstack.places import is_step_node, visit_order
from navstack.scenario.file.context import POSE_FORMAT, ReadContext, describe
from navstack.scenario.file.models import Tour


def read_start_and_goals(context: ReadContext) -> None:
    """Reads `start:` and `goals:` or `tour:`; the places file supplies what is omitted."""
    parts = context.parts
    places = context.places_file
    start = context.section("start")
    if start is not None:
        parts.start_location = start.at
        parts.start = context.pose(start, "start")
    elif places is not None and places.start_pose is not None:
        parts.start_location = context.root.at
        parts.start = places.start_pose
    else:
        context.error("missing", context.root.at, "start", f"start is missing; add `start: {POSE_FORMAT}`")
    goals, tour = context.root.items.get("goals"), context.root.items.get("tour")
    if goals is not None and tour is not None:
        context.error("wrong-value", tour[0], "tour", "the scenario has both goals and a tour; remove one of them")
    elif goals is not None:
        _read_goals(context, goals[1])
    elif tour is not None:
        _read_tour(context, tour[1])
    elif places is not None and places.goal_names:
        names = places.goal_names
        parts.steps = places.steps
        parts.goals = places.goals
        parts.goal_names = names
        parts.goal_locations = (context.root.at,) * len(names)
    else:
        message = f"goals are missing; add `goals: [..]`, a list of {POSE_FORMAT}"
        context.error("missing", context.root.at, "goals", message)


def _read_goals(context: ReadContext, node: Node) -> None:
    if isinstance(node, ListNode) and not node.items and "interactions" in context.root.items:
        return  # a person gives the goals
    if not isinstance(node, ListNode) or not node.items:
        problem = "is empty" if isinstance(node, ListNode) else f"is {describe(node)}"
        context.error("wrong-type", node.at, "goals", f"goals {problem}; write a list of {POSE_FORMAT}")
        return
    if all(isinstance(item, ScalarNode) and not isinstance(item.value, str) for item in node.items):
        values = ", ".join(str(plain(item)) for item in node.items)
        message = f"goals = [{values}] is a single pose, not a list of poses; write goals: [[{values}]]"
        context.error("wrong-type", node.at, "goals", message)
        return
    if any(is_step_node(item) for item in node.items):
        _read_steps(context, node)
        return
    found: list[tuple[str, Pose2D, Location]] = []
    for i, item in enumerate(node.items, 1):
        pose = context.pose(item, f"goal {i}")
        if pose is not None:
            name = item.value if isinstance(item, ScalarNode) else ""
            found.append((str(name), pose, item.at))
    if len(found) < len(node.items):
        return  # otherwise the remaining goals would be numbered wrongly
    parts = context.parts
    parts.goal_names = tuple(name for name, _, _ in found)
    parts.goals = tuple(pose for _, pose, _ in found)
    parts.goal_locations = tuple(at for _, _, at in found)


def _read_steps(context: ReadContext, node: ListNode) -> None:
    """Reads goals among which are steps, such as {move: 0.5}."""
    parts, steps = context.parts, list[Step]()
    for i, item in enumerate(node.items, 1):
        if not is_step_node(item):
            pose = context.pose(item, f"goal {i}")
            if pose is not None:
                name = str(item.value) if isinstance(item, ScalarNode) else ""
                steps.append(GoToStep(goto=list(pose), place=name))
            continue
        try:
            steps.append(read_step(plain(item), places=parts.places, folder=context.path.parent))
        except InputError as exc:
            context.error("wrong-value", item.at, "goals", f"step {i}: {exc.message}")
    parts.steps = tuple(steps)
    parts.goal_names = tuple(step_text(step) for step in steps)


def _read_tour(context: ReadContext, node: Node) -> None:
    parts = context.parts
    if isinstance(node, ListNode) and any(is_step_node(item) for item in node.items):
        _read_steps(context, node)
        return
    if isinstance(node, ListNode):
        node = DictNode({"places": (node.at, node)}, node.at)
    if isinstance(node, ScalarNode) and node.value is None:
        node = DictNode({}, node.at)
    if not isinstance(node, DictNode):
        context.type_error(node, "tour", "places:, order: and loops: below it")
        return
    context.check_keys(node, Tour.model_fields, "tour")
    tour = context.bind(Tour, node, "tour")
    if tour is None:
        return
    if tour.places == []:
        at = node.items["places"][1].at
        message = "the tour lists no places; list some, or omit `places:` to visit all places of the map"
        context.error("wrong-value", at, "tour", message)
        return
    names = tuple(tour.places or parts.places)
    if not names:
        message = "the tour has no places; list them under `places:`, or use a map with a .places.yaml file"
        context.error("wrong-value", node.at, "tour", message)
        return
    listed = node.items.get("places")
    nodes = listed[1].items if listed is not None and isinstance(listed[1], ListNode) else []
    unknown = [item for item in nodes if context.pose(item, "place") is None]
    if unknown:
        return
    parts.tour = tour
    parts.tour_names = names
    parts.goal_names = visit_order(names, tour.order, loops=tour.loops, seed=parts.settings.seed)
    parts.goals = tuple(parts.places[name] for name in parts.goal_names)
    parts.goal_locations = (node.at,) * len(parts.goals)
