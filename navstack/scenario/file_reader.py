"""Scenario files: YAML that defines the robot, the world, the goals and the success conditions of a run.

    name: narrow door                     # only `map` is required if the map's places have a start and goals
    description: Through a door of 0.9 m.
    map: office                           # a packaged map, or a file relative to this file
    params: [turtlebot, mine.yaml]        # as `--params`; default: turtlebot
    set: {DWAPlannerROS/max_vel_x: 0.4}   # changed parameters
    sim: {odometry_noise: 0.02}           # body, sensors and noise: the parameters of `navstack: sim:`
    start: corridor_west                  # [x, y, yaw] (m, rad), or a place of the map
    goals: [office_2, [16.9, 9.6, 1.57]]  # or tour: {places: [..], order: given | sorted | random, loops: 1}
    shapes:
      - {radius: 0.2, pose: [3.0, 7.4]}
      - {radius: 0.25, motion: {kind: track, points: [[5, 6], [5, 9]], speed: 0.5}}
    interactions:                         # what a person does during the run, see navstack.scenario.interactions
      - {time: 5.0, kind: put, shape: {name: box, box: [0.5, 0.4], pose: [6.0, 7.5, 0.0]}}
    seed: 1
    time_limit: 120                       # simulated seconds per goal
    success: {goals: SUCCEEDED, max_collisions: 0, max_time: 100, min_clearance: 0.02}

To run scenarios in other processes, send the path (or a `ScenarioSpec`, a few kB when pickled) and the arguments of
`load_scenario`, and load it there (about 10 ms); or send the `Scenario` itself (about 50 kB plus the map's cells).
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from navstack.behaviors import GoToStep
from navstack.core import InputError, MapError, NavError, Pose2D, exists, is_file, short_repr
from navstack.map_io import map_names, map_path
from navstack.parameters import (
    Binder,
    DictNode,
    Finding,
    ListNode,
    Location,
    Node,
    ScalarNode,
    Space,
    check_parameters,
    finding,
    in_order,
    launch_argument,
    load_configuration,
    nearest,
    overlay,
    packaged_sets,
    plain,
    read_yaml,
)
from navstack.plugins import ParamModel
from navstack.scenario.fields import file_fields, file_key, file_model
from navstack.scenario.interactions import INTERACTION, KINDS
from navstack.scenario.low_battery import LowBattery
from navstack.scenario.places import Places, is_step_node, load_places, pose_of, visit_order
from navstack.scenario.recognition import SUFFIXES, is_scenario_file
from navstack.scenario.scenario import MAX_INTERACTIONS, MAX_SHAPES, Scenario, too_many_pedestrians
from navstack.scenario.spec import (
    ScenarioSpec,
    Tour,
    cached_map,
    check_goals_on_map,
    check_start_collision,
    check_start_on_map,
    scenario_error,
)
from navstack.scenario.steps import Step, read_step, step_data, step_text
from navstack.scenario.success import Success, SuccessConditions
from navstack.scenario.trajectories import read_trajectories
from navstack.sim import MOTIONS, PedestrianMotion, ReplayMotion, Shape

_OF_SPEC: Final = file_fields(ScenarioSpec)
_OF_SCENARIO: Final = file_fields(Scenario)
_SCALARS: Final = {"name": _OF_SCENARIO["name"], **_OF_SPEC, **_OF_SCENARIO}
Settings: Final = file_model(
    "Settings", "The scalar values of a scenario file; the other keys are sections.", _SCALARS, {"rest": "pause"}
)
"""The keys with one value; the others are sections."""

M = TypeVar("M", bound=ParamModel)

POSE_FORMAT = "[x, y], [x, y, yaw] (m, rad) or the name of a place"


class ReadContext:
    """Reads one file: `findings` are its errors and notes, `spec` its contents."""

    def __init__(self, path: Path, shown: str | None = None, root: DictNode | None = None) -> None:
        """`shown` is the file name in messages; `root` replaces the contents of the file."""
        self.path = path
        self.shown = shown or str(path)
        self.is_part = root is not None
        """True for a part of a file, which may have no goals."""
        self.findings: list[Finding] = []
        if root is None:
            read = read_yaml(path, self.shown)
            root = read.root
            self.findings += [_duplicates_as_errors(f) for f in read.findings]
        self.root = root
        self.readable = not any(f.severity == "error" for f in self.findings)
        self.spec = ScenarioSpec(path=path)
        """The scenario, as far as it could be read."""
        self.places_file: Places | None = None
        self._binder = Binder(self.findings, of_ros=False)

    def error(self, rule: str, at: Location, key: str, message: str, suggestion: str | None = None) -> None:
        """Adds an error to the findings."""
        self.findings.append(finding("error", rule, at, key, message, suggestion))

    def type_error(self, node: Node, key: str, expected: str) -> None:
        """Adds the error that `key` has the wrong type."""
        self.error("wrong-type", node.at, key, f"{key} is {describe(node)}; write {expected}")

    def check_keys(
        self, node: DictNode, known: Iterable[str], owner: str, synonyms: Mapping[str, str] | None = None
    ) -> None:
        """Adds an error for every key of `node` that is not known; `synonyms` improve the suggestion."""
        names = list(known)
        for key, (at, _) in node.items.items():
            if key in names:
                continue
            close = nearest(key, names) or (synonyms or {}).get(key.lower())
            hint = f"did you mean {close}?" if close else f"known keys: {', '.join(names)}"
            self.error("unknown", at, key, f'{owner} has no key "{key}"; {hint}', close)

    def bind(self, model: type[M], node: DictNode, path: str, fixed: Mapping[str, Any] | None = None) -> M | None:
        """Returns the section as its model, None after an error; `fixed` are fields that were read separately."""
        space = Space(path, node.at)
        overlay(space, node, self.findings)
        made = self._binder.bind(model, space, fixed=fixed)
        return made if isinstance(made, model) else None

    def section(self, key: str) -> Node | None:
        """Returns the value of a top-level key."""
        found = self.root.items.get(key)
        return found[1] if found is not None else None

    def mapping(self, key: str, example: str) -> DictNode | None:
        """Returns the section as a mapping; any other type is an error, an empty section is None."""
        node = self.section(key)
        if node is None or isinstance(node, DictNode):
            return node
        if not (isinstance(node, ScalarNode) and node.value is None):
            self.type_error(node, key, example)
        return None

    def text(self, node: Node, key: str, expected: str) -> str | None:
        """Returns the node as a string; anything else is an error."""
        if isinstance(node, ScalarNode) and isinstance(node.value, str) and node.value:
            return node.value
        self.type_error(node, key, expected)
        return None

    def resolve(self, text: str) -> Path:
        """Resolves a path relative to the folder of the file."""
        path = Path(text)
        return path if path.is_absolute() else Path(os.path.normpath(self.path.parent / path))

    def pose(self, node: Node, name: str) -> Pose2D | None:
        """Reads a pose or the name of a place; None after an error."""
        if isinstance(node, ScalarNode):
            if isinstance(node.value, str):
                return self._place(node, node.value, name)
            self.type_error(node, name, POSE_FORMAT)
            return None
        try:
            return pose_of(node, name)
        except InputError as exc:
            self.add_input_error(exc, node.at, name)
            return None

    def _place(self, node: ScalarNode, place: str, name: str) -> Pose2D | None:
        places = self.spec.places
        if place in places:
            return places[place]
        if not places:
            message = f'{name} "{place}" is the name of a place, but this scenario has no places; write [x, y, yaw]'
            self.error("wrong-value", node.at, name, message)
            return None
        close = nearest(place, places)
        hint = f"did you mean {close}?" if close else f"known places: {', '.join(places)}"
        self.error("unknown", node.at, name, f'{name} "{place}" is not a known place; {hint}', close)
        return None

    def add_input_error(self, exc: InputError, at: Location, key: str) -> None:
        """Adds the error of another reader; its own file and line, if it has them, replace `at`."""
        data = exc.data
        message = exc.message
        if "line" in data:
            at = Location(str(data["file"]), int(data["line"]), int(data["column"]))
            message = message.removeprefix(f"{at}: ")
        self.error("wrong-value", at, key, message)


def describe(node: Node) -> str:
    """Describes the type of a node for a message."""
    if isinstance(node, ListNode):
        return "a list"
    if isinstance(node, DictNode):
        return "a mapping"
    if node.value is None:
        return "empty"
    shown = node.text if len(node.text) <= 40 else node.text[:37] + "..."
    if isinstance(node.value, str):
        return f'the text "{shown}"'
    return f"{shown}, {'a Boolean' if isinstance(node.value, bool) else 'a number'}"


def _duplicates_as_errors(f: Finding) -> Finding:
    """Turns the warning for a key with two values into an error: it would change what is driven."""
    if f.rule == "duplicated" and f.severity == "warning":
        return finding("error", f.rule, f.location, f.key, f.message, f.suggestion)
    return f


# --- start and goals --------------------------------------------------------------------------------------------------


def read_start_and_goals(context: ReadContext) -> None:
    """Reads `start:` and `goals:` or `tour:`; the places file supplies what is omitted."""
    spec = context.spec
    places = context.places_file
    start = context.section("start")
    if start is not None:
        spec.start_location = start.at
        spec.values["start"] = context.pose(start, "start")
    elif places is not None and places.start_pose is not None and not context.is_part:
        spec.start_location = context.root.at
        spec.values["start"] = places.start_pose
    else:
        context.error("missing", context.root.at, "start", f"start is missing; add `start: {POSE_FORMAT}`")
    goals, tour = context.root.items.get("goals"), context.root.items.get("tour")
    if goals is not None and tour is not None:
        context.error("wrong-value", tour[0], "tour", "the scenario has both goals and a tour; remove one of them")
    elif goals is not None:
        _read_goals(context, goals[1])
    elif tour is not None:
        _read_tour(context, tour[1])
    elif context.is_part:
        spec.values["goals"] = ()
    elif places is not None and places.goal_names:
        names = places.goal_names
        spec.values["steps"] = places.steps
        spec.values["goals"] = places.goals
        spec.goal_names = names
        spec.goal_locations = (context.root.at,) * len(names)
    else:
        message = f"goals are missing; add `goals: [..]`, a list of {POSE_FORMAT}"
        context.error("missing", context.root.at, "goals", message)


def _read_goals(context: ReadContext, node: Node) -> None:
    if isinstance(node, ListNode) and not node.items and ("interactions" in context.root.items or context.is_part):
        return  # somebody gives the goals
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
    spec = context.spec
    spec.goal_names = tuple(name for name, _, _ in found)
    spec.values["goals"] = tuple(pose for _, pose, _ in found)
    spec.goal_locations = tuple(at for _, _, at in found)


def _read_steps(context: ReadContext, node: ListNode) -> None:
    """Reads goals among which are steps, such as {move: 0.5}."""
    spec, steps = context.spec, list[Step]()
    for i, item in enumerate(node.items, 1):
        if not is_step_node(item):
            pose = context.pose(item, f"goal {i}")
            if pose is not None:
                name = str(item.value) if isinstance(item, ScalarNode) else ""
                steps.append(GoToStep(goto=list(pose), place=name))
            continue
        try:
            steps.append(read_step(plain(item), places=spec.places, folder=context.path.parent))
        except InputError as exc:
            context.error("wrong-value", item.at, "goals", f"step {i}: {exc.message}")
    spec.values["steps"] = tuple(steps)
    spec.goal_names = tuple(step_text(step) for step in steps)


def _read_tour(context: ReadContext, node: Node) -> None:
    spec = context.spec
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
    names = tuple(tour.places or spec.places)
    if not names:
        message = "the tour has no places; list them under `places:`, or use a map with a .places.yaml file"
        context.error("wrong-value", node.at, "tour", message)
        return
    listed = node.items.get("places")
    nodes = listed[1].items if listed is not None and isinstance(listed[1], ListNode) else []
    unknown = [item for item in nodes if context.pose(item, "place") is None]
    if unknown:
        return
    spec.tour = tour
    spec.tour_names = names
    spec.goal_names = visit_order(names, tour.order, loops=tour.loops, seed=spec.values.get("seed", 0))
    spec.values["goals"] = tuple(spec.places[name] for name in spec.goal_names)
    spec.goal_locations = (node.at,) * len(spec.goals)


# --- map, places and parameters ---------------------------------------------------------------------------------------


def read_map(context: ReadContext) -> None:
    """Reads `map:`: a file relative to the scenario file, or the name of a packaged map."""
    known = ", ".join(map_names())
    node = context.section("map")
    if node is None:
        message = f"map is missing; add `map: FILE.yaml`, relative to this file, or a packaged map ({known})"
        context.error("missing", context.root.at, "map", message)
        return
    text = context.text(node, "map", f"the file of a map, relative to this file, or a packaged map ({known})")
    if text is None:
        return
    file = context.resolve(text)
    if is_file(file):
        context.spec.map_file = file
    elif text in map_names():
        context.spec.map_file = map_path(text)
    else:
        close = nearest(text, map_names())
        hint = f'did you mean "{close}"?' if close else f"packaged maps: {known}"
        message = f'map "{text}" is neither a file, relative to this file, nor a packaged map; {hint}'
        context.error("no-source", node.at, "map", message, close)


def read_places(context: ReadContext) -> None:
    """Reads `places:`: a mapping, a file, or by default MAP.places.yaml next to the map."""
    node = context.section("places")
    if isinstance(node, DictNode):
        found: dict[str, Pose2D] = {}
        for name, (_, inner) in node.items.items():
            pose = context.pose(inner, f'"{name}"')
            if pose is not None:
                found[name] = pose
        context.spec.places = found
        return
    if node is not None:
        text = context.text(node, "places", "`name: [x, y, yaw]` lines, or the name of a file with such lines")
        if text is not None:
            _load_places(context, context.resolve(text), node.at)
        return
    map_file = context.spec.map_file
    if map_file is not None:
        default = map_file.with_name(f"{map_file.stem}.places.yaml")
        if is_file(default):
            _load_places(context, default, context.root.at)


def _load_places(context: ReadContext, file: Path, at: Location) -> None:
    if not is_file(file):
        message = f"file {file} does not exist; name a file with places, or list the places here"
        context.error("no-source", at, "places", message)
        return
    try:
        context.places_file = load_places(file)
    except InputError as exc:
        context.add_input_error(exc, at, "places")
        return
    context.spec.places = context.places_file.places


def read_parameters(context: ReadContext) -> None:
    """Reads `params:`, `set:` and `sim:`."""
    spec = context.spec
    node = context.section("params")
    expected = f"a packaged set ({', '.join(packaged_sets())}), a folder or files, relative to this file"
    if node is None:
        spec.sources.append("turtlebot")
    else:
        items = node.items if isinstance(node, ListNode) else [node]
        if not items:
            context.error("missing", node.at, "params", f"params is an empty list; write {expected}")
        for item in items:
            # inline parameters are a source like a file
            if isinstance(item, DictNode):
                spec.sources.append(item)
                continue
            text = context.text(item, "params", expected)
            if text is not None:
                _add_source(context, text, item.at)
    changes = context.mapping("set", "`NAME: VALUE` lines, for example `DWAPlannerROS/max_vel_x: 0.4`")
    if changes is not None:
        spec.overlays.append(changes)
    sim = context.mapping(
        "sim", "parameters of the simulated robot, indented below it, for example `odometry_noise: 0.02`"
    )
    if sim is not None:
        at = context.root.items["sim"][0]
        spec.overlays.append(DictNode({"navstack": (at, DictNode({"sim": (at, sim)}, sim.at))}, sim.at))


def _add_source(context: ReadContext, text: str, at: Location) -> None:
    name, marker, namespace = text.rpartition("@")
    file = context.resolve(name if marker else text)
    sources = context.spec.sources
    if text in packaged_sets() or launch_argument(text) is not None:
        sources.append(text)
    elif exists(context.resolve(text)):
        sources.append(str(context.resolve(text)))
    elif marker and exists(file):
        sources.append(f"{file}@{namespace}")
    else:
        close = nearest(text, packaged_sets())
        hint = f'did you mean "{close}"?' if close else f"packaged sets: {', '.join(packaged_sets())}"
        message = f'params "{text}" is neither a file or folder, relative to this file, nor a packaged set; {hint}'
        context.error("no-source", at, "params", message, close)


# --- interactions -----------------------------------------------------------------------------------------------------


_INTERACTION_EXAMPLE = "{time: 5.0, kind: goal, pose: [3.0, 1.5, 0.0]}"


def read_interactions(context: ReadContext) -> None:
    """Reads `interactions:`."""
    node = context.section("interactions")
    if node is None or (isinstance(node, ScalarNode) and node.value is None):
        return
    if not isinstance(node, ListNode):
        context.type_error(node, "interactions", f"a list, for example {_INTERACTION_EXAMPLE}")
        return
    if len(node.items) > MAX_INTERACTIONS:
        message = f"{len(node.items)} interactions; a scenario has at most {MAX_INTERACTIONS}"
        context.error("wrong-value", node.at, "interactions", message)
        return
    made = [_read_interaction(context, item, f"interaction {number}") for number, item in enumerate(node.items, 1)]
    context.spec.values["interactions"] = tuple(item for item in made if item is not None)


def _read_interaction(context: ReadContext, node: Node, name: str) -> Any:
    if not isinstance(node, DictNode):
        context.type_error(node, name, f"a mapping, for example {_INTERACTION_EXAMPLE}")
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
    values = plain(node)
    try:
        if value == "step" and isinstance(values.get("step"), dict):  # places and files become part of it
            step = read_step(values["step"], places=context.spec.places, folder=context.path.parent)
            values["step"] = step_data(step)
        return INTERACTION.validate_python(values)
    except NavError as exc:
        context.error("wrong-value", node.at, name, f"{name}: {exc.message}")
        return None
    except ValidationError as exc:
        for error in exc.errors(include_url=False, include_context=False)[:5]:
            where = ".".join(str(step) for step in error["loc"][1:])
            what = f" = {short_repr(error['input'])}" if error["type"] != "missing" else ""
            message = error["msg"].removeprefix("Value error, ")
            context.error("wrong-value", node.at, name, f"{name}: {where}{what}: {message}")
        return None


# --- shapes and success -----------------------------------------------------------------------------------------------


_SHAPE_SYNONYMS = {
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
_SHAPE_EXAMPLE = "{radius: 0.2, pose: [3.0, 1.5]}"


def read_shapes(context: ReadContext) -> None:
    """Reads `shapes:`."""
    node = context.section("shapes")
    if node is None or (isinstance(node, ScalarNode) and node.value is None):
        return
    if not isinstance(node, ListNode):
        context.type_error(node, "shapes", f"a list, for example {_SHAPE_EXAMPLE}")
        return
    made = [
        shape for i, item in enumerate(node.items, 1) for shape in _read_shapes_of_entry(context, item, f"shape {i}")
    ]
    context.spec.values["shapes"] = tuple(made)
    walking = sum(isinstance(shape.motion, PedestrianMotion) for shape in context.spec.shapes)
    problem = too_many_pedestrians(walking)
    if problem is None and len(made) > MAX_SHAPES:
        problem = f"{len(made)} entries; the simulator handles {MAX_SHAPES}"
    if problem is not None:
        context.error("wrong-value", node.at, "shapes", f"shapes has {problem}; remove some")


def _read_shapes_of_entry(context: ReadContext, node: Node, name: str) -> list[Shape]:
    """Returns the shapes of an entry: one, or one for each person of the file of a replay; none after an error."""
    motion = node.items["motion"][1] if isinstance(node, DictNode) and "motion" in node.items else None
    if isinstance(node, DictNode) and isinstance(motion, DictNode) and "file" in motion.items:
        kind = motion.items.get("kind")
        if kind is not None and isinstance(kind[1], ScalarNode) and kind[1].value == "replay":
            return _read_replay(context, node, motion, name)
    shape = _read_shape(context, node, name)
    return [] if shape is None else [shape]


def _read_replay(context: ReadContext, node: DictNode, motion: DictNode, name: str) -> list[Shape]:
    """Returns a shape for each person of the file that the motion names, or for the one that it names."""
    context.check_keys(motion, ("kind", "file", "person"), "a motion of kind replay with a file")
    at, file_node = motion.items["file"]
    file = context.text(file_node, "file", "the name of a CSV file with the columns t, id, x, y")
    if file is None:
        return []
    try:
        people = read_trajectories(context.resolve(file))
    except InputError as exc:
        context.add_input_error(exc, at, name)
        return []
    if "person" in motion.items:
        at, person_node = motion.items["person"]
        person = str(person_node.value) if isinstance(person_node, ScalarNode) else ""
        if person not in people:
            close = nearest(person, people)
            hint = f"did you mean {close}?" if close else f"it has {', '.join(list(people)[:10])}"
            context.error("unknown", at, name, f'{file} has no person "{person}"; {hint}', close)
            return []
        people = {person: people[person]}
    others = {key: value for key, value in node.items.items() if key not in ("motion", "pose")}
    shape = _read_shape(context, DictNode(others, node.at), name)
    if shape is None:
        return []
    if shape.radius is None:
        context.error("wrong-value", node.at, name, f"{name}: a person is a disc; give it a radius (typically 0.25 m)")
        return []
    return [
        shape.model_copy(
            update={
                "name": f"{shape.name or 'person'} {person}" if len(people) > 1 or not shape.name else shape.name,
                "pose": [*points[0][1:], 0.0],
                "motion": ReplayMotion(points=points),
            }
        )
        for person, points in people.items()
    ]


def _read_shape(context: ReadContext, node: Node, name: str) -> Shape | None:
    if not isinstance(node, DictNode):
        context.type_error(node, name, f"a mapping, for example {_SHAPE_EXAMPLE}")
        return None
    before = len(context.findings)
    context.check_keys(node, Shape.model_fields, name, _SHAPE_SYNONYMS)
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


def read_low_battery(context: ReadContext) -> None:
    """Reads `low_battery:`."""
    node = context.mapping("low_battery", "threshold:, resume: and dock: below it")
    if node is None:
        return
    context.check_keys(node, LowBattery.model_fields, "low_battery")
    made = context.bind(LowBattery, node, "low_battery")
    if made is not None:
        context.spec.values["low_battery"] = made


def read_success(context: ReadContext) -> None:
    """Reads `success:`."""
    node = context.mapping("success", "conditions indented below it, for example `max_time: 60`")
    if node is None:
        return
    context.check_keys(node, (*Success.model_fields, *Success.RENAMED), "success")
    made = context.bind(Success, node, "success")
    if made is None:
        return
    context.spec.values["success"] = SuccessConditions.from_file(made)
    states, count = context.spec.success.goals, len(context.spec.steps or context.spec.goals)
    if not isinstance(states, str) and count and len(states) != count:
        at = node.items["goals"][1].at
        listed, needed = _plural(len(states), "state"), _plural(count, "goal")
        message = f"success lists {listed} for {needed}; list one state per goal, or give a single state for all"
        context.error("wrong-value", at, "success/goals", message)


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


SECTIONS = (
    "map",
    "places",
    "params",
    "set",
    "sim",
    "start",
    "goals",
    "tour",
    "shapes",
    "interactions",
    "low_battery",
    "success",
)
"""Keys of a scenario file besides those of `Settings`."""
_KEYS = (*Settings.model_fields, *SECTIONS)

_KEY_SYNONYMS = {
    "robot": "params",
    "parameters": "params",
    "overrides": "set",
    "obstacles": "shapes",
    "discs": "shapes",
    "noise": "sim",
    "sensors": "sim",
    "body": "sim",
    "localization": "sim",
    "timeout": "time_limit",
    "limit": "time_limit",
    "conditions": "success",
    "goal": "goals",
    "world": "map",
    "events": "interactions",
    "actions": "interactions",
    "teleop": "interactions",
}
"""Other names that users may try for a key -> the key."""


# --- the file ---------------------------------------------------------------------------------------------------------


def read_file(path: Path, shown: str | None = None) -> ReadContext:
    """Reads a scenario file; `shown` is its name in messages. The result's `findings` list every problem."""
    context = ReadContext(path, shown)
    if not context.readable:
        return context
    root = context.root
    if "robots" in root.items:
        message = "this file describes a fleet of robots; drive it with navstack simulate, or navstack.fleet.load_fleet"
        context.error("wrong-value", root.items["robots"][0], "robots", message)
        return context
    _read_sections(context)
    return context


def read_part(path: Path, shown: str, root: DictNode) -> ReadContext:
    """Reads a scenario from a part of a file that describes several; it may have no goals."""
    context = ReadContext(path, shown, root)
    _read_sections(context)
    return context


def _read_sections(context: ReadContext) -> None:
    root = context.root
    unknown = {key: value for key, value in root.items.items() if key not in Settings.RENAMED}
    context.check_keys(DictNode(unknown, root.at), _KEYS, "a scenario", _KEY_SYNONYMS)
    names = (*Settings.model_fields, *Settings.RENAMED)
    settings = {key: value for key, value in root.items.items() if key in names}
    bound = context.bind(Settings, DictNode(settings, root.at), "")
    if bound is not None:
        for key in _OF_SPEC:
            setattr(context.spec, key, getattr(bound, key))
        scalars = (f.name for f in fields(Scenario) if file_key(f.name) in _OF_SCENARIO)
        context.spec.values |= {name: getattr(bound, file_key(name)) for name in scalars}
    read_map(context)
    read_places(context)
    read_parameters(context)
    read_start_and_goals(context)
    read_shapes(context)
    read_interactions(context)
    read_low_battery(context)
    read_success(context)


def scenarios_in(folder: Path) -> list[ScenarioSpec]:
    """Reads the scenario files in a folder, ordered by file name; an empty list if there are none.

    Ignores other YAML files (maps, places, parameters). Raises ScenarioError for an invalid scenario, and for a file that is
    not valid YAML, because its kind cannot be determined.
    """
    found: list[ScenarioSpec] = []
    for file in sorted(folder.iterdir()):
        if file.suffix not in SUFFIXES or not file.is_file():
            continue
        errors = [f for f in in_order(read_yaml(file).findings) if f.severity == "error"]
        if errors:
            raise scenario_error(errors)
        if is_scenario_file(file):
            found.append(read_scenario(file))
    return found


def check_unique_names(names: Sequence[str]) -> None:
    """Raises InputError if two scenarios have the same name, which identifies them in tables and results."""
    duplicates = [name for name, count in Counter(names).items() if count > 1]
    if duplicates:
        raise InputError(
            f'two scenarios have the name "{duplicates[0]}"; set `name:` in one of them', name=duplicates[0]
        )


def read_scenario(path: str | Path, shown: str | None = None) -> ScenarioSpec:
    """Reads a scenario file; `shown` is its name in messages.

    Raises ScenarioError for an invalid file: its message has one line per error, its `data["findings"]` lists all of them.
    `build` checks the parameters.
    """
    context = read_file(Path(path), shown)
    errors = [f for f in in_order(context.findings) if f.severity == "error"]
    if errors:
        raise scenario_error(errors)
    return context.spec


def load_scenario(path: str | Path, **overrides: Any) -> Scenario:
    """Reads a scenario file and builds it; `overrides` are the arguments of `ScenarioSpec.build` (`seed=3`).

    Raises ScenarioError for the file, ParameterError for the parameters, MapError for the map.
    """
    return read_scenario(path).build(**overrides)


def check_scenario(
    path: str | Path, *, overrides: Sequence[str] = (), distro: str | None = None, allow_missing: bool = False
) -> list[Finding]:
    """Checks a scenario file and the parameters it names; returns all findings, ordered by file and line."""
    context = read_file(Path(path))
    spec = context.spec
    findings = list(context.findings)
    sources = [*spec.sources, *spec.overlays]
    options: dict[str, Any] = {
        "overrides": overrides,
        "distro": distro or spec.distro,
        "allow_missing": allow_missing or spec.allow_missing,
    }
    if spec.sources and context.readable:
        findings += check_parameters(sources, **options)
    if spec.map_file is not None and context.readable:
        try:
            grid = cached_map(spec.map_file)
        except MapError as exc:
            at = context.root.items["map"][1].at
            return in_order([*findings, finding("error", "map", at, "map", exc.message)])
        findings += check_start_on_map(spec, grid) + check_goals_on_map(spec, grid)
        if not any(f.severity == "error" for f in findings):
            findings += check_start_collision(spec, grid, load_configuration(sources, **options))
    return in_order(findings)
