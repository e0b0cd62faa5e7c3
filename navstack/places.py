"""Named places and poses in YAML files, as the packaged maps and MultiNav of the ROS tutorials write them."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from navstack.core import Pose2D
from navstack.core.errors import InputError
from navstack.map_io import packaged_map_file
from navstack.move_base.goal import is_planar, yaw_of
from navstack.parameters.findings import Location
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, read_yaml

Order = Literal["given", "sorted", "random"]

_POSE = "[x, y, yaw], {x, y, yaw} or {position: {x, y}, orientation: {x, y, z, w}}"
_KEYS = ("places", "locations", "start", "goals")


@dataclass(frozen=True, slots=True)
class PlacesFile:
    """A file of places. Poses in the map frame (m, rad)."""

    places: dict[str, Pose2D]
    """By name, in the order of the file."""
    start: Pose2D | None
    goals: tuple[str, ...]
    """Names of the places of the tour that the file proposes; all of them when it proposes none."""


def _wrong(at: Location, message: str) -> InputError:
    return InputError(f"{at}: {message}", file=at.file, line=at.line, column=at.column)


def _number(node: Node, what: str) -> float:
    value = node.value if isinstance(node, ScalarNode) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        written = f'"{node.text or value}"' if isinstance(node, ScalarNode) else "more than one value"
        raise _wrong(node.at, f"{what} must be a finite number, not {written}")
    return float(value)


def _field(node: DictNode, key: str, what: str) -> float:
    if key not in node.items:
        raise _wrong(node.at, f"{what} has no {key}; give {_POSE}")
    return _number(node.items[key][1], f"{key} of {what}")


def _mapping(node: DictNode, key: str, what: str) -> DictNode:
    inner = node.items[key][1]
    if not isinstance(inner, DictNode):
        raise _wrong(inner.at, f"{key} of {what} must be a mapping; give {_POSE}")
    return inner


def _check_keys(node: DictNode, allowed: tuple[str, ...], what: str) -> None:
    for key, (at, _) in node.items.items():
        if key not in allowed:
            raise _wrong(at, f'{what} has a key "{key}" that says nothing; give {_POSE}')


def pose_of(node: Node, what: str) -> Pose2D:
    """A pose as a YAML file writes it; `what` is what it is the pose of, in messages.

    Raises InputError, whose data are file, line and column and whose message begins with them.
    """
    if isinstance(node, ListNode):
        if len(node.items) not in (2, 3):
            raise _wrong(
                node.at, f"{what} has {len(node.items)} number{'' if len(node.items) == 1 else 's'}; give {_POSE}"
            )
        numbers = [_number(item, f"{name} of {what}") for item, name in zip(node.items, ("x", "y", "yaw"))]
        return Pose2D(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0)
    if not isinstance(node, DictNode):
        raise _wrong(node.at, f"{what} is no pose; give {_POSE}")
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
        raise _wrong(node.items["yaw"][0], f"{what} has both a yaw and an orientation; give one")
    turned = _mapping(node, "orientation", what)
    _check_keys(turned, ("x", "y", "z", "w"), what)
    q = tuple(_field(turned, key, what) if key in turned.items else 0.0 for key in ("x", "y", "z"))
    quaternion = (q[0], q[1], q[2], _field(turned, "w", what))
    if not is_planar(quaternion):
        raise _wrong(turned.at, f"the orientation {quaternion} of {what} is no heading in the plane; x and y are 0")
    return Pose2D(x, y, yaw_of(quaternion))


def read_places(path: Path) -> PlacesFile:
    """Reads a file of places: those of the packaged maps (`NAME.places.yaml`), or locations as in MultiNav.

        places:                              # or locations:, or the names alone
          kitchen: [20.6, 2.2, -1.57]        # x, y (m), yaw (rad)
          lounge: {x: 19.6, y: 5.2, yaw: 3.14}
          office: {position: {x: 6.2, y: 12.0}, orientation: {z: 0.7071, w: 0.7071}}
        start: [0.8, 7.45, 0]                # a pose, or the name of a place
        goals: [office, kitchen]             # names or poses; without it, every place

    Raises InputError, whose message begins with file:line:column.
    """
    file = read_yaml(path)
    errors = [f for f in file.findings if f.severity == "error" or f.rule == "duplicated"]
    if errors:
        raise _wrong(errors[0].location, errors[0].message)
    root = file.root
    named = [key for key in ("places", "locations") if key in root.items]
    if len(named) == 2:
        raise _wrong(root.items["locations"][0], "the file has both places and locations; give one")
    if named:
        for key, (at, _) in root.items.items():
            if key not in _KEYS:
                raise _wrong(at, f'"{key}" says nothing here; there are {", ".join(_KEYS)}')
        listed = root.items[named[0]][1]
    else:
        listed = DictNode({k: v for k, v in root.items.items() if k not in _KEYS}, root.at)
    if not isinstance(listed, DictNode) or not listed.items:
        raise _wrong(listed.at, f"there are no places; give `name: pose` lines, a pose being {_POSE}")
    places = {name: pose_of(node, f'"{name}"') for name, (_, node) in listed.items.items()}

    def named_or_pose(node: Node, what: str) -> tuple[str | None, Pose2D]:
        if isinstance(node, ScalarNode) and isinstance(node.value, str):
            if node.value not in places:
                raise _wrong(node.at, f'{what} "{node.value}" is no place; there are {", ".join(places)}')
            return node.value, places[node.value]
        return None, pose_of(node, what)

    start = named_or_pose(root.items["start"][1], "start")[1] if "start" in root.items else None
    goals: list[str] = []
    if "goals" in root.items:
        listing = root.items["goals"][1]
        if not isinstance(listing, ListNode) or not listing.items:
            raise _wrong(listing.at, "goals must be a list of names or poses, such as [kitchen, [1.0, 2.0, 0.0]]")
        proposed = [named_or_pose(node, f"goal {i}") for i, node in enumerate(listing.items, 1)]
        for i, (name, pose) in enumerate(proposed, 1):
            known = name or next((n for n, p in places.items() if p == pose), None)
            if known is None:
                known = f"goal {i}"
                places[known] = pose
            goals.append(known)
    return PlacesFile(places, start, tuple(goals) or tuple(places))


def itinerary(names: tuple[str, ...], order: Order, *, loops: int = 1, seed: int = 0) -> tuple[str, ...]:
    """The names in the order in which they are visited, `loops` times.

    Random: shuffled by `seed`, anew in every loop; no loop begins where the last one ended, unless there is one place only.
    """
    if order == "sorted":
        names = tuple(sorted(names))
    if order != "random":
        return names * loops
    dice = random.Random(seed)
    found: list[str] = []
    for _ in range(loops):
        shuffled = list(names)
        dice.shuffle(shuffled)
        if found and shuffled[0] == found[-1]:
            shuffled.append(shuffled.pop(0))
        found += shuffled
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Places:
    """Free poses in the frame of a packaged map (m, rad)."""

    start: Pose2D
    """Where `navstack simulate` starts by default."""
    goals: tuple[Pose2D, ...]
    """The tour it drives by default."""
    places: dict[str, Pose2D]
    """All of them by name, start and goals included."""


def load_places(name: str) -> Places:
    """Start, tour and named places of a packaged map; raises MapError with the names there are."""
    file = read_places(packaged_map_file(name, ".places.yaml"))
    assert file.start is not None
    return Places(start=file.start, goals=tuple(file.places[goal] for goal in file.goals), places=file.places)
