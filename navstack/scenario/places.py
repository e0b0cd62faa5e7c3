"""Named places on a map, read from YAML files in the format of the packaged maps or of MultiNav of the ROS tutorials."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from navstack.behaviors import GoToStep
from navstack.core import InputError, Pose2D
from navstack.map_io import map_names, packaged_map_file
from navstack.move_base import is_planar, yaw_of
from navstack.parameters import DictNode, ListNode, Location, Node, ScalarNode, plain, read_yaml
from navstack.scenario.steps import Step, is_step, read_step

Order = Literal["given", "sorted", "random"]

_POSE = "[x, y, yaw], {x, y, yaw} or {position: {x, y}, orientation: {x, y, z, w}}"
_KEYS = ("places", "locations", "start", "goals")


@dataclass(frozen=True, slots=True)
class Places:
    """Named poses in the map frame (m, rad), with the start and the tour that their file suggests."""

    places: dict[str, Pose2D]
    """Poses by name, in the order of the file, including start and goals of a packaged map."""
    start_pose: Pose2D | None
    """The start pose; None if the file has none."""
    goal_names: tuple[str, ...]
    """Names of the places of the suggested tour; all places if the file suggests none."""
    steps: tuple[Step, ...] = ()
    """Goals and motions of the suggested tour in order, if there are motions in it; `goal_names` are its places then."""

    @property
    def start(self) -> Pose2D:
        """The start pose; every packaged map has one. Raises InputError if the file has none."""
        if self.start_pose is None:
            raise InputError("the places have no start; add `start: [x, y, yaw]` to the file")
        return self.start_pose

    @property
    def goals(self) -> tuple[Pose2D, ...]:
        """Poses of the suggested tour."""
        return tuple(self.places[name] for name in self.goal_names)

    def __repr__(self) -> str:
        return f"Places({', '.join(self.places)})"


def _error(at: Location, message: str) -> InputError:
    return InputError(f"{at}: {message}", file=at.file, line=at.line, column=at.column)


def _number(node: Node, what: str) -> float:
    value = node.value if isinstance(node, ScalarNode) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        written = f'"{node.text or value}"' if isinstance(node, ScalarNode) else "more than one value"
        raise _error(node.at, f"{what} must be a finite number, not {written}")
    return float(value)


def _field(node: DictNode, key: str, what: str) -> float:
    if key not in node.items:
        raise _error(node.at, f"{what} has no {key}; give {_POSE}")
    return _number(node.items[key][1], f"{key} of {what}")


def _mapping(node: DictNode, key: str, what: str) -> DictNode:
    inner = node.items[key][1]
    if not isinstance(inner, DictNode):
        raise _error(inner.at, f"{key} of {what} must be a mapping; give {_POSE}")
    return inner


def _check_keys(node: DictNode, allowed: tuple[str, ...], what: str) -> None:
    for key, (at, _) in node.items.items():
        if key not in allowed:
            raise _error(at, f'{what} has an unknown key "{key}"; give {_POSE}')


def pose_of(node: Node, what: str) -> Pose2D:
    """Converts a YAML node to a pose; `what` names the pose in messages.

    Raises InputError; its message begins with file, line and column, its data contains them.
    """
    if isinstance(node, ListNode):
        if len(node.items) not in (2, 3):
            raise _error(
                node.at, f"{what} has {len(node.items)} number{'' if len(node.items) == 1 else 's'}; give {_POSE}"
            )
        numbers = [_number(item, f"{name} of {what}") for item, name in zip(node.items, ("x", "y", "yaw"))]
        return Pose2D(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0)
    if not isinstance(node, DictNode):
        raise _error(node.at, f"{what} is not a pose; give {_POSE}")
    if "pose" in node.items:
        _check_keys(node, ("pose",), what)
        return pose_of(node.items["pose"][1], what)
    if "position" in node.items:
        _check_keys(node, ("position", "orientation", "yaw"), what)
        position = _mapping(node, "position", what)
        _check_keys(position, ("x", "y", "z"), what)
    else:
        _check_keys(node, ("x", "y", "z", "yaw", "orientation"), what)
        position = node
    x, y = _field(position, "x", what), _field(position, "y", what)
    if "orientation" not in node.items:
        return Pose2D(x, y, _field(node, "yaw", what) if "yaw" in node.items else 0.0)
    if "yaw" in node.items:
        raise _error(node.items["yaw"][0], f"{what} has both a yaw and an orientation; give one")
    rotation = _mapping(node, "orientation", what)
    _check_keys(rotation, ("x", "y", "z", "w"), what)
    q = tuple(_field(rotation, key, what) if key in rotation.items else 0.0 for key in ("x", "y", "z"))
    quaternion = (q[0], q[1], q[2], _field(rotation, "w", what))
    if not is_planar(quaternion):
        message = (
            f"the orientation {quaternion} of {what} is not a rotation about z; give a unit quaternion with x = y = 0"
        )
        raise _error(rotation.at, message)
    return Pose2D(x, y, yaw_of(quaternion))


def load_places(source: str | Path) -> Places:
    """Loads the places of a packaged map, by its name, or of a YAML file.

        places:                              # or locations:, or the names at the top level
          kitchen: [20.6, 2.2, -1.57]        # x, y (m), yaw (rad)
          lounge: {x: 19.6, y: 5.2, yaw: 3.14}
          office: {position: {x: 6.2, y: 12.0}, orientation: {z: 0.7071, w: 0.7071}}
        start: [0.8, 7.45, 0]                # a pose, or the name of a place
        goals: [office, kitchen]             # names, poses or steps ({move: 0.5}); default: every place

    A string without a suffix is the name of a packaged map. Raises MapError for an unknown name, and InputError, whose
    message begins with file:line:column, for a file with errors.
    """
    path = Path(source)
    if isinstance(source, str) and (source in map_names() or not path.suffix):
        path = packaged_map_file(source, ".places.yaml")
    file = read_yaml(path, any_key=True)
    errors = [f for f in file.findings if f.severity == "error" or f.rule == "duplicated"]
    if errors:
        raise _error(errors[0].location, errors[0].message)
    root = file.root
    places = _named_poses(root)
    start = _place_or_pose(root.items["start"][1], places, "start")[1] if "start" in root.items else None
    listing = root.items["goals"][1] if "goals" in root.items else None
    if listing is None:
        return Places(places, start, tuple(places))
    if isinstance(listing, ListNode) and any(is_step_node(node) for node in listing.items):
        steps = tuple(_step(node, places, i, path.parent) for i, node in enumerate(listing.items, 1))
        return Places(places, start, tuple(s.place for s in steps if isinstance(s, GoToStep)), steps)
    return Places(places, start, _goal_names(listing, places))


def is_step_node(node: Node) -> bool:
    """Return True for a YAML mapping that is a step, such as {move: 0.5}."""
    return isinstance(node, DictNode) and is_step(node.items)


def _step(node: Node, places: dict[str, Pose2D], number: int, folder: Path) -> Step:
    """Return a step, or the goal of a place or pose as one."""
    if not is_step_node(node):
        name, pose = _place_or_pose(node, places, f"goal {number}")
        return GoToStep(goto=list(pose), place=name or "")
    try:
        return read_step(plain(node), places=places, folder=folder)
    except InputError as exc:
        raise _error(node.at, f"step {number}: {exc.message}") from None


def _named_poses(root: DictNode) -> dict[str, Pose2D]:
    sections = [key for key in ("places", "locations") if key in root.items]
    if len(sections) == 2:
        raise _error(root.items["locations"][0], "the file has both places and locations; keep one of them")
    if sections:
        for key, (at, _) in root.items.items():
            if key not in _KEYS:
                raise _error(at, f'unknown key "{key}"; known keys: {", ".join(_KEYS)}')
        listed = root.items[sections[0]][1]
    else:
        listed = DictNode({k: v for k, v in root.items.items() if k not in _KEYS}, root.at)
    if not isinstance(listed, DictNode) or not listed.items:
        raise _error(listed.at, f"the file lists no places; add `name: pose` lines, where pose is {_POSE}")
    return {name: pose_of(node, f'"{name}"') for name, (_, node) in listed.items.items()}


def _place_or_pose(node: Node, places: dict[str, Pose2D], what: str) -> tuple[str | None, Pose2D]:
    if isinstance(node, ScalarNode) and node.value is not None:
        name = node.value if isinstance(node.value, str) else node.text  # `goals: [1, 2]`: names that are numbers
        if name not in places:
            raise _error(node.at, f'{what} "{name}" is not a place; known places: {", ".join(places)}')
        return name, places[name]
    return None, pose_of(node, what)


def _goal_names(listing: Node, places: dict[str, Pose2D]) -> tuple[str, ...]:
    """Names of the listed goals. A goal given by a pose that has no name is added to `places`."""
    if not isinstance(listing, ListNode) or not listing.items:
        raise _error(listing.at, "goals must be a list of names or poses, such as [kitchen, [1.0, 2.0, 0.0]]")
    goals = [_place_or_pose(node, places, f"goal {i}") for i, node in enumerate(listing.items, 1)]
    names: list[str] = []
    for i, (name, pose) in enumerate(goals, 1):
        known = name or next((n for n, p in places.items() if p == pose), None)
        if known is None:
            known = f"goal {i}"
            places[known] = pose
        names.append(known)
    return tuple(names)


def visit_order(names: tuple[str, ...], order: Order, *, loops: int = 1, seed: int = 0) -> tuple[str, ...]:
    """Returns the names in the order of the visits, `loops` times.

    "random" shuffles every loop with the generator of `seed`; a loop does not begin with the last place of the loop before,
    unless there is only one place.
    """
    if order == "sorted":
        names = tuple(sorted(names))
    if order != "random":
        return names * loops
    rng = random.Random(seed)
    visits: list[str] = []
    for _ in range(loops):
        shuffled = list(names)
        rng.shuffle(shuffled)
        if visits and shuffled[0] == visits[-1]:
            shuffled.append(shuffled.pop(0))
        visits += shuffled
    return tuple(visits)
