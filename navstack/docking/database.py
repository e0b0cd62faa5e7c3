"""The docks that a robot knows: the parameters of `docking_server`, or a file in the format of Nav2's dock database.

docks:
  home_dock:
    type: simple_charging_dock
    frame: map
    pose: [1.0, 0.5, 0.0]
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from navstack.core import InputError, Pose2D, normalize_angle, short_repr
from navstack.docking.errors import DockNotInDatabaseError, DockNotValidError
from navstack.parameters import Configuration, DictNode, DockingParams, DockInstanceParams, nearest, plain, read_yaml
from navstack.plugins import DOCK_TYPES, DockType

MAX_DOCKS: Final = 10_000


@dataclass(frozen=True, slots=True)
class Dock:
    """A dock."""

    name: str
    type: str
    """Name of its type, one of `dock_plugins`; empty for the only one."""
    pose: Pose2D
    """Pose of the base of a docked robot in `frame`; the x axis points into the dock."""
    frame: str = "map"
    id: str = ""
    """Identifier of its marker."""


@dataclass(frozen=True, slots=True)
class DockDatabase:
    """The docks by name, and the parameters of docking."""

    params: DockingParams
    docks: Mapping[str, Dock] = field(default_factory=dict[str, Dock])

    @classmethod
    def of(cls, configuration: Configuration) -> DockDatabase:
        """Return the docks of a configuration. Raises InputError for an unreadable file of docks, or docks in two places."""
        params = configuration.docking or DockingParams()
        if params.docks and params.dock_database:
            raise InputError(
                "docking_server has both docks and dock_database; write the docks into the file, or remove dock_database",
                docks=params.docks,
            )
        if params.dock_database:
            at = configuration.origins.get("docking_server/dock_database")
            folder = Path(at.file).parent if at is not None and Path(at.file).is_file() else Path()
            return cls(params, load_docks(folder / Path(params.dock_database).expanduser()))
        docks: dict[str, Dock] = {}
        for name in params.docks:
            one = params.sections.get(name)
            if not isinstance(one, DockInstanceParams):
                raise InputError(
                    f"docking_server/docks names {name}, but {name}/pose is not written; add it", dock=name
                )
            docks[name] = _dock(name, one)
        return cls(params, docks)

    def dock(self, name: str) -> Dock:
        """Return a dock by its name. Raises DockNotInDatabaseError with a suggestion."""
        found = self.docks.get(name)
        if found is None:
            close = nearest(name, list(self.docks))
            hint = f'did you mean "{close}"? ' if close else ""
            known = ", ".join(self.docks) or "none; list them under docking_server/docks or in dock_database"
            raise DockNotInDatabaseError(
                f'no dock is called "{name}"; {hint}known: {known}', dock=name, known=list(self.docks)
            )
        return found

    def type_of(self, dock: Dock) -> DockType:
        """Return a new instance of the type of a dock. Raises DockNotValidError."""
        return self.type_named(dock.type, f'the dock "{dock.name}"')

    def type_named(self, name: str, who: str = "the dock") -> DockType:
        """Return a new instance of a type by its name, or of the only one. Raises DockNotValidError."""
        types = self.params.dock_types
        if not name and len(types) == 1:
            name = next(iter(types))
        if name not in types:
            known = ", ".join(types)
            what = f'has the unknown type "{name}"' if name else "has no type"
            raise DockNotValidError(f"{who} {what}; name one of dock_plugins: {known}", type=name, known=list(types))
        params = types[name]
        return DOCK_TYPES.get(getattr(params, "plugin", "") or "simple_charging_dock").cls(name, params)


def load_docks(path: str | os.PathLike[str]) -> dict[str, Dock]:
    """Read a dock database. Raises InputError with file, line and column."""
    path = Path(path)
    read = read_yaml(path)
    errors = [f for f in read.findings if f.severity == "error"]
    if errors:
        raise InputError(
            "\n".join(f"{f.location}: {f.message}" for f in errors), findings=[f.as_dict() for f in errors]
        )
    root = read.root
    entry = root.items.get("docks")
    if entry is None:
        keys = f"its keys are {', '.join(root.items)}" if root.items else "it is empty"
        raise InputError(f"{path}: {keys}, not docks; write `docks:` and below it a mapping for each dock")
    listed = entry[1]
    if not isinstance(listed, DictNode):
        raise InputError(
            f"{listed.at}: docks is not a mapping; write the name of each dock, and below it type, frame and pose"
        )
    if len(listed.items) > MAX_DOCKS:
        raise InputError(f"{listed.at}: {len(listed.items)} docks; at most {MAX_DOCKS} are read")
    docks: dict[str, Dock] = {}
    for name, (at, node) in listed.items.items():
        if not isinstance(node, DictNode):
            raise InputError(f"{at}: the dock {name} is not a mapping; write type, frame and pose below it")
        values: dict[str, Any] = plain(node)
        try:
            docks[name] = _dock(name, DockInstanceParams.model_validate(values))
        except ValidationError as exc:
            error = exc.errors(include_url=False, include_context=False)[0]
            key = str(error["loc"][0]) if error["loc"] else "pose"
            there = node.items[key][1].at if key in node.items else at
            message = str(error["msg"]).removeprefix("Value error, ")
            if error["type"] == "extra_forbidden":
                there = node.items[key][0]
                close = nearest(key, list(DockInstanceParams.model_fields))
                message = f"unknown key{f'; did you mean {close}?' if close else ''}; known: type, frame, pose, id"
            if error["type"] == "missing":
                message = "pose is missing; write pose: [x, y, yaw]"
            elif not message.startswith(f"{key} ="):
                message = f"{key} = {short_repr(error['input'])}: {message}"
            raise InputError(f"{there}: the dock {name}: {message}") from None
    return docks


def dump_docks(docks: Mapping[str, Dock]) -> str:
    """Return the text of a dock database, which `load_docks` reads."""
    lines = ["docks:"]
    for name, dock in docks.items():
        lines += [f"  {name}:"]
        lines += [f"    type: {dock.type}"] if dock.type else []
        lines += [f"    frame: {dock.frame}", f"    pose: [{', '.join(repr(float(v)) for v in dock.pose)}]"]
        lines += [f'    id: "{dock.id}"'] if dock.id else []
    return "\n".join(lines if docks else ["docks: {}"]) + "\n"


def _dock(name: str, params: DockInstanceParams) -> Dock:
    x, y, yaw = params.pose
    return Dock(name, params.type, Pose2D(x, y, normalize_angle(yaw)), params.frame, params.id)
