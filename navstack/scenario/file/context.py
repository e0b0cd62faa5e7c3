"""The state of reading one scenario file: its YAML, the findings so far, and helpers that every section needs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from navstack.core import Pose2D
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel
from navstack.parameters.binding import Binder
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.spelling import nearest
from navstack.parameters.tree import Space, overlay
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, read_yaml
from navstack.places import Places, pose_of
from navstack.scenario.file.models import Parts

M = TypeVar("M", bound=ParamModel)

POSE_FORMAT = "[x, y], [x, y, yaw] (m, rad) or the name of a place"


class ReadContext:
    """Reads one file: `findings` are its errors and notes, `parts` its contents."""

    def __init__(self, path: Path, shown: str | None = None) -> None:
        """`shown` is the file name in messages."""
        self.path = path
        self.shown = shown or str(path)
        read = read_yaml(path, self.shown)
        self.root = read.root
        self.findings: list[Finding] = [_duplicates_as_errors(f) for f in read.findings]
        self.readable = not any(f.severity == "error" for f in read.findings)
        self.parts = Parts()
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
        places = self.parts.places
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
