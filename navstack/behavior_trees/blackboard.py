"""The blackboard of a tree, and the ports by which its nodes read and write entries.

A node is connected to its entries once, when the tree is built, so that a tick reads an attribute and searches nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal, NamedTuple

import numpy as np

from navstack.behavior_trees.errors import BehaviorTreeRunError
from navstack.core import Path, Pose2D, normalize_angle

Direction = Literal["in", "out", "both"]


class _Unset(Enum):
    UNSET = 0

    def __repr__(self) -> str:
        return "unset"


UNSET: Final = _Unset.UNSET
"""Value of an entry that nothing has been written to, and of a port that is not connected."""


class StampedPose(NamedTuple):
    """A pose (m, rad) in `frame`, with its time stamp (s): Nav2's PoseStamped."""

    x: float
    y: float
    yaw: float = 0.0
    frame: str = "map"
    stamp: float = 0.0

    @property
    def pose(self) -> Pose2D:
        """The pose without frame and time."""
        return Pose2D(self.x, self.y, self.yaw)


# --- types of ports ----------------------------------------------------------------------------------------------------


def _parse_bool(text: str) -> bool:
    word = text.strip()
    if word in ("1", "true", "True", "TRUE"):
        return True
    if word in ("0", "false", "False", "FALSE"):
        return False
    raise ValueError("write true or false")


def _parse_int(text: str) -> int:
    try:
        value = int(text.strip())
    except ValueError:
        raise ValueError("write an integer") from None
    if not -(2**63) <= value < 2**63:
        raise ValueError("write an integer of at most 64 bits")
    return value


def _parse_unsigned(text: str) -> int:
    value = _parse_int(text)
    if value < 0:
        raise ValueError("write an integer of at least 0")
    return value


def _parse_double(text: str) -> float:
    try:
        value = float(text.strip())
    except ValueError:
        raise ValueError("write a number") from None
    if math.isnan(value):
        raise ValueError("write a number, not NaN")
    return value


def _parse_strings(text: str) -> list[str]:
    return text.split(";") if text else []


def _parse_ints(text: str) -> list[int]:
    return [_parse_int(part) for part in _parse_strings(text)]


_POSE_FIELDS: Final = 9
_POSE_FORM: Final = "write stamp_ns;frame;x;y;z;qx;qy;qz;qw, or {entry}"


def _pose_of(fields: list[str]) -> StampedPose:
    if len(fields) != _POSE_FIELDS:
        raise ValueError(_POSE_FORM)
    try:
        x, y, _, qx, qy, qz, qw = (float(field) for field in fields[2:])
        stamp = int(fields[0]) * 1e-9
    except (ValueError, OverflowError):
        raise ValueError(_POSE_FORM) from None
    if not all(map(math.isfinite, (x, y, qx, qy, qz, qw))):
        raise ValueError("write finite numbers")
    yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return StampedPose(x, y, yaw, fields[1], stamp)


def _parse_pose(text: str) -> StampedPose:
    return _pose_of(text.split(";"))


def _parse_poses(text: str) -> list[StampedPose]:
    fields = _parse_strings(text)
    if len(fields) % _POSE_FIELDS:
        raise ValueError(_POSE_FORM + ", once for each pose")
    return [_pose_of(fields[i : i + _POSE_FIELDS]) for i in range(0, len(fields), _POSE_FIELDS)]


def _parse_path(text: str) -> Path:
    fields = _parse_strings(text)
    if len(fields) < 2 or (len(fields) - 2) % _POSE_FIELDS:
        raise ValueError("write stamp_ns;frame and then stamp_ns;frame;x;y;z;qx;qy;qz;qw for each pose, or {entry}")
    poses = [_pose_of(fields[i : i + _POSE_FIELDS]) for i in range(2, len(fields), _POSE_FIELDS)]
    return Path(np.array([pose[:3] for pose in poses], np.float64).reshape(-1, 3), fields[1])


def _parse_text(text: str) -> str:
    return text


def _parse_nothing(text: str) -> object:
    raise ValueError("write {entry}: a value of this type comes from the blackboard only")


def _to_double(value: object) -> float:
    if isinstance(value, (int, float)):
        return float(value)
    raise ValueError("not a number")


def _to_int(value: object) -> int:
    if isinstance(value, (int, float)) and math.isfinite(value) and value == int(value):
        return int(value)
    raise ValueError("not an integer")


def _to_unsigned(value: object) -> int:
    number = _to_int(value)
    if number < 0:
        raise ValueError("negative")
    return number


def _to_bool(value: object) -> bool:
    if isinstance(value, (int, float)) and value in (0, 1):
        return bool(value)
    raise ValueError("neither true nor false")


def _to_text(value: object) -> str:
    if isinstance(value, (int, float)):
        return format_number(value)
    raise ValueError("not a text")


def _to_list(value: object) -> object:
    if isinstance(value, tuple) and not isinstance(value, StampedPose):
        return list(value)  # pyright: ignore[reportUnknownArgumentType,reportUnknownVariableType]
    raise ValueError("not a list")


def _to_nothing(value: object) -> object:
    del value
    raise ValueError("of another type")


def format_number(value: float) -> str:
    """Return a number as a script writes it: integers without a decimal point."""
    return f"{int(value)}" if math.isfinite(value) and value == int(value) else f"{value:g}"


@dataclass(frozen=True)
class PortType:
    """A type of ports: how text becomes a value, and which values it takes."""

    name: str
    parse: Callable[[str], object]
    """Text -> value; raises ValueError with the fix."""
    plain: frozenset[type]
    """Classes of values that need no conversion."""
    convert: Callable[[object], object] = _to_nothing
    """Other value (no text) -> value; raises ValueError."""


def _types() -> dict[str, PortType]:
    rows: list[tuple[str, Callable[[str], object], tuple[type, ...], Callable[[object], object]]] = [
        ("bool", _parse_bool, (bool,), _to_bool),
        ("int", _parse_int, (int,), _to_int),
        ("unsigned", _parse_unsigned, (), _to_unsigned),
        ("double", _parse_double, (float,), _to_double),
        ("string", _parse_text, (str,), _to_text),
        ("strings", _parse_strings, (list,), _to_list),
        ("ints", _parse_ints, (list,), _to_list),
        ("pose", _parse_pose, (StampedPose,), _to_nothing),
        ("poses", _parse_poses, (list,), _to_list),
        ("path", _parse_path, (Path,), _to_nothing),
    ]
    return {name: PortType(name, parse, frozenset(plain), convert) for name, parse, plain, convert in rows}


TYPES: Final[dict[str, PortType]] = _types()
"""Types that a port may name; any other name is a type of values that only the blackboard holds, such as `route`."""
ANY: Final = "any"


@dataclass(frozen=True)
class Port:
    """A port of a node."""

    name: str
    type: str = "string"
    """A key of `TYPES`, `any`, or a name for values that only the blackboard holds."""
    default: str | None = None
    """As the XML would write it; None for no default."""
    direction: Direction = "in"
    required: bool = False
    """True if the node cannot run without it."""


def inputs(**ports: str | tuple[str, str]) -> tuple[Port, ...]:
    """Return input ports: `name="type"`, `name="type!"` if the node needs it, or `name=("type", "default")`."""
    made: list[Port] = []
    for name, what in ports.items():
        kind, default = what if isinstance(what, tuple) else (what, None)
        made.append(Port(name, kind.rstrip("!"), default, required=kind.endswith("!")))
    return tuple(made)


def outputs(**ports: str) -> tuple[Port, ...]:
    """Return output ports: `name="type"`."""
    return tuple(Port(name, kind, direction="out") for name, kind in ports.items())


# --- entries -----------------------------------------------------------------------------------------------------------


class Entry:
    """One entry of a blackboard."""

    __slots__ = ("key", "type", "value", "version")

    def __init__(self, key: str, kind: str = ANY) -> None:
        self.key = key
        self.type = kind
        """Type of the first port that names it; `any` if a script or a program created it."""
        self.value: object = UNSET
        self.version = 0
        """Number of writes."""

    def set(self, value: object) -> None:
        """Write a value."""
        self.value = value
        self.version += 1


class Blackboard(Mapping[str, object]):
    """Entries by key; a subtree has its own blackboard, whose keys may stand for keys of the parent's.

    Keys that begin with `@` are those of the root blackboard. `blackboard["goal"] = pose` writes.
    """

    def __init__(self, parent: Blackboard | None = None) -> None:
        self.parent = parent
        self.remapping: dict[str, str] = {}
        """Key here -> key of the parent."""
        self.autoremap = False
        """True if all keys but those that begin with `_` are also the parent's."""
        self._entries: dict[str, Entry] = {}

    @property
    def root(self) -> Blackboard:
        """The blackboard of the main tree."""
        found = self
        while found.parent is not None:
            found = found.parent
        return found

    def find(self, key: str) -> Entry | None:
        """Return an entry, or None."""
        board, key = (self.root, key[1:]) if key.startswith("@") else (self, key)
        while True:
            entry = board._entries.get(key)
            if entry is not None:
                return entry
            parent = board.parent
            if parent is None:
                return None
            if key in board.remapping:
                key = board.remapping[key]
            elif not board.autoremap or key.startswith("_"):
                return None
            board = parent

    def entry(self, key: str, kind: str = ANY) -> Entry:
        """Return an entry; create it if there is none."""
        found = self.find(key)
        if found is not None:
            if found.type == ANY:
                found.type = kind
            return found
        board, key = (self.root, key[1:]) if key.startswith("@") else (self, key)
        while board.parent is not None:
            if key in board.remapping:
                key = board.remapping[key]
            elif not board.autoremap or key.startswith("_"):
                break
            board = board.parent
        made = board._entries[key] = Entry(key, kind)
        return made

    def unset(self, key: str) -> None:
        """Forget the value of an entry."""
        entry = self.find(key)
        if entry is not None:
            entry.set(UNSET)

    def __setitem__(self, key: str, value: object) -> None:
        self.entry(key).set(value)

    def __getitem__(self, key: str) -> object:
        entry = self.find(key)
        if entry is None or entry.value is UNSET:
            raise KeyError(key)
        return entry.value

    def __contains__(self, key: object) -> bool:
        entry = self.find(key) if isinstance(key, str) else None
        return entry is not None and entry.value is not UNSET

    def __iter__(self) -> Iterator[str]:
        return iter([key for key, entry in self._entries.items() if entry.value is not UNSET])

    def __len__(self) -> int:
        return sum(entry.value is not UNSET for entry in self._entries.values())

    def __repr__(self) -> str:
        return f"Blackboard({', '.join(f'{key}={value!r}' for key, value in self.items())})"


# --- connected ports ---------------------------------------------------------------------------------------------------


class Input:
    """An input port of one node: connected to an entry, or a constant."""

    __slots__ = ("_convert", "_parse", "_plain", "constant", "entry", "port", "where")

    def __init__(self, port: Port, where: str, entry: Entry | None = None, constant: object = UNSET) -> None:
        self.port = port
        self.where = where
        """Position in the file, for messages."""
        self.entry = entry
        self.constant = constant
        kind = TYPES.get(port.type)
        self._plain = kind.plain if kind is not None else None
        self._parse = kind.parse if kind is not None else _parse_nothing
        self._convert = kind.convert if kind is not None else _to_nothing

    def get(self, default: object = None) -> object:
        """Return the value, `default` if there is none. Raises BehaviorTreeRunError for a value of another type."""
        entry = self.entry
        if entry is None:
            return default if self.constant is UNSET else self.constant
        value = entry.value
        if value is UNSET:
            return default
        if self._plain is None or type(value) in self._plain:
            return value
        return self._converted(value)

    def _converted(self, value: object) -> object:
        try:
            return self._parse(value) if isinstance(value, str) else self._convert(value)
        except ValueError as exc:
            entry = self.entry
            assert entry is not None
            raise BehaviorTreeRunError(
                f'{self.where}: the port "{self.port.name}" takes a value of type {self.port.type}, but the entry '
                f'"{entry.key}" is {value!r:.80} ({exc}); write another value to the entry, or connect another one',
                port=self.port.name,
                entry=entry.key,
            ) from None


class Output:
    """An output port of one node; writing to one that is not connected has no effect."""

    __slots__ = ("entry", "port")

    def __init__(self, port: Port, entry: Entry | None = None) -> None:
        self.port = port
        self.entry = entry

    def set(self, value: object) -> None:
        """Write a value to the entry."""
        entry = self.entry
        if entry is not None:
            entry.value = value
            entry.version += 1


def parse_constant(port: Port, text: str) -> object:
    """Return the value of a constant in the XML. Raises ValueError with the fix."""
    kind = TYPES.get(port.type)
    if kind is None:
        if port.type == ANY:
            return text
        raise ValueError("write {entry}: a value of this type comes from the blackboard only")
    return kind.parse(text)


def as_stamped(pose: StampedPose | Pose2D | tuple[float, float, float], frame: str = "map") -> StampedPose:
    """Return a pose with frame; one without is in `frame`."""
    if isinstance(pose, StampedPose):
        return pose
    x, y, yaw = pose
    return StampedPose(float(x), float(y), normalize_angle(float(yaw)), frame)
