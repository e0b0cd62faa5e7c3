"""A scenario's YAML -> what it says, with a finding for everything that is not as it should be."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from navstack.core import OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.core.files import exists, is_file
from navstack.core.parameters import ParamModel
from navstack.map_io import map_names, map_path
from navstack.parameters import packaged_sets
from navstack.parameters.binding import Binder
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.launch import launch_argument
from navstack.parameters.sources import Source
from navstack.parameters.tree import Space, overlay
from navstack.parameters.unused import nearest
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, plain, read_yaml
from navstack.places import Places, load_places, pose_of, visit_order
from navstack.scenario.file.models import MOTIONS, Settings, Success, Tour
from navstack.sim.shapes import Shape

M = TypeVar("M", bound=ParamModel)

SECTIONS = ("map", "places", "params", "set", "sim", "start", "goals", "tour", "shapes", "success")
"""Keys of a scenario file beside the plain ones of `Settings`."""
KEYS = (*Settings.model_fields, *SECTIONS)

_POSE = "[x, y], [x, y, yaw] (m, rad) or the name of a place"
_MEANT = {
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
}
"""Other words for the same things."""
_MEANT_OF_SHAPES = {
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
_SHAPE = "{radius: 0.2, pose: [3.0, 1.5]}"


@dataclass(slots=True)
class Parts:
    """What a scenario file says, as far as it could be read."""

    settings: Settings = field(default_factory=Settings)
    map_file: Path | None = None
    grid: OccupancyGrid | None = None
    """The map itself, where it is no file."""
    sources: list[Source] = field(default_factory=list[Source])
    """Of parameters: `params:`."""
    over: list[Source] = field(default_factory=list[Source])
    """What lies over them: `set:`, then `sim:`."""
    start: Pose2D | None = None
    start_at: Location = Location("")
    goals: tuple[Pose2D, ...] = ()
    goal_names: tuple[str, ...] = ()
    goals_at: tuple[Location, ...] = ()
    tour: Tour | None = None
    tour_names: tuple[str, ...] = ()
    """Places of the tour in the order of the file, for `tour`'s own order."""
    places: Mapping[str, Pose2D] = field(default_factory=dict[str, Pose2D])
    shapes: tuple[Shape, ...] = ()
    success: Success = field(default_factory=Success)


class ScenarioReader:
    """Reads one file; `findings` says what is wrong with it, `parts` what it says."""

    def __init__(self, path: Path, shown: str | None = None) -> None:
        self.path = path
        self.shown = shown or str(path)
        read = read_yaml(path, self.shown)
        self.root = read.root
        # a key given twice changes what is driven: nothing is guessed here
        self.findings: list[Finding] = [_sterner(f) for f in read.findings]
        self.readable = not any(f.severity == "error" for f in read.findings)
        self.parts = Parts()
        self._binder = Binder(self.findings, of_ros=False)
        self._named: Places | None = None

    def read(self) -> Parts:
        """Goes through every section; whatever is wrong is among the findings afterwards."""
        if not self.readable:
            return self.parts
        parts = self.parts
        self._keys(self.root, KEYS, "a scenario", meant=_MEANT)
        plain_values = {k: v for k, v in self.root.items.items() if k in Settings.model_fields}
        parts.settings = self._bound(Settings, DictNode(plain_values, self.root.at), "") or parts.settings
        self._map()
        self._places()
        self._sources()
        self._ends()
        self._shapes()
        self._success()
        return parts

    # --- words --------------------------------------------------------------------------------------------------------

    def say(self, rule: str, at: Location, key: str, message: str, suggestion: str | None = None) -> None:
        """Adds an error."""
        self.findings.append(finding("error", rule, at, key, message, suggestion))

    def _keys(self, node: DictNode, known: Iterable[str], where: str, meant: Mapping[str, str] | None = None) -> None:
        names = list(known)
        for key, (at, _) in node.items.items():
            if key in names:
                continue
            close = nearest(key, names) or (meant or {}).get(key.lower())
            way_out = f"did you mean {close}?" if close else f"there are {', '.join(names)}"
            self.say("unknown", at, key, f'{where} has no key "{key}"; {way_out}', close)

    def _bound(self, model: type[M], node: DictNode, path: str, fixed: Mapping[str, Any] | None = None) -> M | None:
        """The section as its model; `fixed` are fields that were read elsewhere."""
        space = Space(path, node.at)
        overlay(space, node, self.findings)
        made = self._binder.bind(model, space, fixed=fixed)
        return made if isinstance(made, model) else None

    def _section(self, key: str) -> Node | None:
        found = self.root.items.get(key)
        return found[1] if found is not None else None

    def _mapping(self, key: str, example: str) -> DictNode | None:
        """The section as a mapping; what is none is said."""
        node = self._section(key)
        if node is None or isinstance(node, DictNode):
            return node
        if isinstance(node, ScalarNode) and node.value is None:
            return None
        self.say("wrong-type", node.at, key, f"{key} is {_is(node)}; write {example}")
        return None

    def _text(self, node: Node, key: str, wanted: str) -> str | None:
        if isinstance(node, ScalarNode) and isinstance(node.value, str) and node.value:
            return node.value
        self.say("wrong-type", node.at, key, f"{key} is {_is(node)}; write {wanted}")
        return None

    # --- map and places -----------------------------------------------------------------------------------------------

    def _beside(self, text: str) -> Path:
        """A path as the file means it: relative to its own folder."""
        path = Path(text)
        return path if path.is_absolute() else Path(os.path.normpath(self.path.parent / path))

    def _map(self) -> None:
        known = ", ".join(map_names())
        node = self._section("map")
        if node is None:
            message = f"map is missing; add `map: FILE.yaml`, relative to this file, or a packaged map ({known})"
            self.say("missing", self.root.at, "map", message)
            return
        text = self._text(node, "map", f"the file of a map, relative to this one, or a packaged map ({known})")
        if text is None:
            return
        file = self._beside(text)
        if is_file(file):
            self.parts.map_file = file
        elif text in map_names():
            self.parts.map_file = map_path(text)
        else:
            close = nearest(text, map_names())
            hint = f'did you mean "{close}"?' if close else f"packaged maps are {known}"
            message = f'there is no map "{text}": no such file beside this one and no packaged map; {hint}'
            self.say("no-source", node.at, "map", message, close)

    def _places(self) -> None:
        node = self._section("places")
        if isinstance(node, DictNode):
            found: dict[str, Pose2D] = {}
            for name, (_, inner) in node.items.items():
                pose = self._pose(inner, f'"{name}"')
                if pose is not None:
                    found[name] = pose
            self.parts.places = found
            return
        if node is not None:
            text = self._text(node, "places", "`name: [x, y, yaw]` lines, or the name of a file that holds them")
            if text is not None:
                self._read_places(self._beside(text), node.at)
            return
        map_file = self.parts.map_file
        if map_file is not None:
            beside = map_file.with_name(f"{map_file.stem}.places.yaml")
            if is_file(beside):
                self._read_places(beside, self.root.at)

    def _read_places(self, file: Path, at: Location) -> None:
        if not is_file(file):
            self.say(
                "no-source", at, "places", f"there is no file {file}; name one that holds places, or list them here"
            )
            return
        try:
            self._named = load_places(file)
        except InputError as exc:
            self._from_error(exc, at, "places")
            return
        self.parts.places = self._named.places

    def _from_error(self, exc: InputError, at: Location, key: str) -> None:
        """An error of someone who reads poses, which knows its place, as a finding."""
        data = exc.data
        message = exc.message
        if "line" in data:
            at = Location(str(data["file"]), int(data["line"]), int(data["column"]))
            message = message.removeprefix(f"{at}: ")
        self.say("wrong-value", at, key, message)

    # --- parameters ---------------------------------------------------------------------------------------------------

    def _sources(self) -> None:
        node = self._section("params")
        wanted = f"a packaged set ({', '.join(packaged_sets())}), a folder or files, relative to this one"
        if node is None:
            self.parts.sources.append("turtlebot")
        else:
            items = node.items if isinstance(node, ListNode) else [node]
            if not items:
                self.say("missing", node.at, "params", f"params lists nothing; write {wanted}")
            for item in items:
                # inline parameters are a source like a file
                if isinstance(item, DictNode):
                    self.parts.sources.append(item)
                    continue
                text = self._text(item, "params", wanted)
                if text is not None:
                    self._source(text, item.at)
        changes = self._mapping("set", "`NAME: VALUE` lines, for example `DWAPlannerROS/max_vel_x: 0.4`")
        if changes is not None:
            self.parts.over.append(changes)
        sim = self._mapping(
            "sim", "parameters of the simulated robot, indented below it, such as `odometry_noise: 0.02`"
        )
        if sim is not None:
            inner = DictNode({"sim": (self.root.items["sim"][0], sim)}, sim.at)
            self.parts.over.append(DictNode({"navstack": (self.root.items["sim"][0], inner)}, sim.at))

    def _source(self, text: str, at: Location) -> None:
        name, marker, namespace = text.rpartition("@")
        file = self._beside(name if marker else text)
        if text in packaged_sets() or launch_argument(text) is not None:
            self.parts.sources.append(text)
        elif exists(self._beside(text)):
            self.parts.sources.append(str(self._beside(text)))
        elif marker and exists(file):
            self.parts.sources.append(f"{file}@{namespace}")
        else:
            close = nearest(text, packaged_sets())
            hint = f'did you mean "{close}"?' if close else f"packaged sets are {', '.join(packaged_sets())}"
            message = (
                f'there are no parameters "{text}": no such file or folder beside this one and no packaged set; {hint}'
            )
            self.say("no-source", at, "params", message, close)

    # --- start and goals ----------------------------------------------------------------------------------------------

    def _pose(self, node: Node, what: str) -> Pose2D | None:
        if isinstance(node, ScalarNode) and isinstance(node.value, str):
            place = self.parts.places.get(node.value)
            if place is not None:
                return place
            if not self.parts.places:
                self.say(
                    "wrong-value",
                    node.at,
                    what,
                    f'{what} "{node.value}" is a place, and no places are known here; write [x, y, yaw]',
                )
                return None
            close = nearest(node.value, self.parts.places)
            hint = f"did you mean {close}?" if close else f"there are {', '.join(self.parts.places)}"
            self.say("unknown", node.at, what, f'{what} "{node.value}" is no place; {hint}', close)
            return None
        if isinstance(node, ScalarNode):
            self.say("wrong-type", node.at, what, f"{what} is {_is(node)}; write {_POSE}")
            return None
        try:
            return pose_of(node, what)
        except InputError as exc:
            self._from_error(exc, node.at, what)
            return None

    def _ends(self) -> None:
        parts = self.parts
        start = self._section("start")
        if start is not None:
            parts.start_at = start.at
            parts.start = self._pose(start, "start")
        elif self._named is not None and self._named.start_pose is not None:
            parts.start_at = self.root.at
            parts.start = self._named.start_pose
        else:
            self.say("missing", self.root.at, "start", f"start is missing; add `start: {_POSE}`")
        both = [key for key in ("goals", "tour") if key in self.root.items]
        if len(both) == 2:
            at = self.root.items["tour"][0]
            self.say("wrong-value", at, "tour", "the scenario has both goals and a tour; keep one of them")
        elif both == ["goals"]:
            self._goals(self.root.items["goals"][1])
        elif both == ["tour"]:
            self._tour(self.root.items["tour"][1])
        elif self._named is not None and self._named.goal_names:
            names = self._named.goal_names
            parts.goals = self._named.goals
            parts.goal_names = names
            parts.goals_at = (self.root.at,) * len(names)
        else:
            self.say("missing", self.root.at, "goals", f"goals are missing; add `goals: [..]`, a list of {_POSE}")

    def _goals(self, node: Node) -> None:
        if not isinstance(node, ListNode) or not node.items:
            what = "is empty" if isinstance(node, ListNode) else f"is {_is(node)}"
            self.say("wrong-type", node.at, "goals", f"goals {what}; write a list of {_POSE}")
            return
        if all(isinstance(item, ScalarNode) and not isinstance(item.value, str) for item in node.items):
            values = ", ".join(str(plain(item)) for item in node.items)
            message = f"goals = [{values}] is one pose, not a list of poses; write goals: [[{values}]]"
            self.say("wrong-type", node.at, "goals", message)
            return
        found: list[tuple[str, Pose2D, Location]] = []
        for i, item in enumerate(node.items, 1):
            pose = self._pose(item, f"goal {i}")
            if pose is not None:
                name = item.value if isinstance(item, ScalarNode) else ""
                found.append((str(name), pose, item.at))
        if len(found) < len(node.items):
            return  # the others would be counted wrongly
        self.parts.goal_names = tuple(name for name, _, _ in found)
        self.parts.goals = tuple(pose for _, pose, _ in found)
        self.parts.goals_at = tuple(at for _, _, at in found)

    def _tour(self, node: Node) -> None:
        parts = self.parts
        if isinstance(node, ListNode):
            node = DictNode({"places": (node.at, node)}, node.at)
        if isinstance(node, ScalarNode) and node.value is None:
            node = DictNode({}, node.at)
        if not isinstance(node, DictNode):
            self.say("wrong-type", node.at, "tour", f"tour is {_is(node)}; write places:, order: and loops: below it")
            return
        self._keys(node, Tour.model_fields, "tour")
        tour = self._bound(Tour, node, "tour")
        if tour is None:
            return
        if tour.places == []:
            at = node.items["places"][1].at
            message = "the tour lists no places; name some, or leave `places:` out for all of the map's"
            self.say("wrong-value", at, "tour", message)
            return
        names = tuple(tour.places or parts.places)
        if not names:
            message = "no places are known here; list them under `places:`, or name a map that has a .places.yaml file"
            self.say("wrong-value", node.at, "tour", message)
            return
        listed = node.items.get("places")
        nodes = listed[1].items if listed is not None and isinstance(listed[1], ListNode) else []
        unknown = [item for item in nodes if self._pose(item, "place") is None]
        if unknown:
            return
        parts.tour = tour
        parts.tour_names = names
        parts.goal_names = visit_order(names, tour.order, loops=tour.loops, seed=parts.settings.seed)
        parts.goals = tuple(parts.places[name] for name in parts.goal_names)
        parts.goals_at = (node.at,) * len(parts.goals)

    # --- shapes and success -------------------------------------------------------------------------------------------

    def _shapes(self) -> None:
        node = self._section("shapes")
        if node is None or (isinstance(node, ScalarNode) and node.value is None):
            return
        if not isinstance(node, ListNode):
            self.say("wrong-type", node.at, "shapes", f"shapes is {_is(node)}; write a list, such as {_SHAPE}")
            return
        made = [self._shape(item, f"shape {i}") for i, item in enumerate(node.items, 1)]
        self.parts.shapes = tuple(shape for shape in made if shape is not None)

    def _shape(self, node: Node, what: str) -> Shape | None:
        if not isinstance(node, DictNode):
            self.say("wrong-type", node.at, what, f"{what} is {_is(node)}; write, for example, {_SHAPE}")
            return None
        before = len(self.findings)
        self._keys(node, Shape.model_fields, what, meant=_MEANT_OF_SHAPES)
        motion = self._motion(node.items["motion"][1], what) if "motion" in node.items else None
        plain_values = {key: value for key, value in node.items.items() if key != "motion"}
        fixed = {} if motion is None else {"motion": motion}
        made = self._bound(Shape, DictNode(plain_values, node.at), what, fixed)
        return made if len(self.findings) == before else None

    def _motion(self, node: Node, what: str) -> ParamModel | None:
        kinds = ", ".join(MOTIONS)
        if not isinstance(node, DictNode):
            self.say(
                "wrong-type",
                node.at,
                what,
                f"the motion of {what} is {_is(node)}; write {{kind: .., ..}}, kind one of {kinds}",
            )
            return None
        if "kind" not in node.items:
            self.say("missing", node.at, what, f"the motion of {what} has no kind; add `kind:`, one of {kinds}")
            return None
        kind = self._text(node.items["kind"][1], "kind", f"one of {kinds}")
        if kind is None:
            return None
        if kind not in MOTIONS:
            close = nearest(kind, MOTIONS)
            hint = f"did you mean {close}?" if close else f"there are {kinds}"
            message = f'the motion of {what} is of the kind "{kind}", which is none; {hint}'
            self.say("unknown", node.items["kind"][1].at, what, message, close)
            return None
        self._keys(node, MOTIONS[kind].model_fields, f"a motion of the kind {kind}")
        return self._bound(MOTIONS[kind], node, f"{what}/motion")

    def _success(self) -> None:
        node = self._mapping("success", "conditions indented below it, such as `max_time: 60`")
        if node is None:
            return
        self._keys(node, (*Success.model_fields, *Success.RENAMED), "success")
        made = self._bound(Success, node, "success")
        if made is None:
            return
        self.parts.success = made
        count = len(self.parts.goals)
        if isinstance(made.goals, list) and count and len(made.goals) != count:
            at = node.items["goals"][1].at
            given, wanted = _many(len(made.goals), "state"), _many(count, "goal")
            message = f"success lists {given} for {wanted}; give one for each, or one for all"
            self.say("wrong-value", at, "success/goals", message)


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _sterner(f: Finding) -> Finding:
    """A key given twice with two values is an error here."""
    if f.rule == "duplicated" and f.severity == "warning":
        return finding("error", f.rule, f.location, f.key, f.message, f.suggestion)
    return f


def _is(node: Node) -> str:
    """What a node is, in a message."""
    if isinstance(node, ListNode):
        return "a list"
    if isinstance(node, DictNode):
        return "a mapping"
    if node.value is None:
        return "empty"
    shown = node.text if len(node.text) <= 40 else node.text[:37] + "..."
    return f'the text "{shown}"' if isinstance(node.value, str) else f"{shown}, {_kind(node.value)}"


def _kind(value: Any) -> str:
    return "a truth value" if isinstance(value, bool) else "a number"
