"""A conversion between move_base and Nav2: the values of the target's file with their sources, and the report of each key."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from navstack.core import OutputError, ensure_directory, is_dir, write_text
from navstack.parameters.nav2.declared import Type
from navstack.parameters.report import Parameter
from navstack.parameters.yaml_editor import value_text

Kind = Literal["carried over", "converted", "nearest", "added", "no counterpart"]
KINDS: Final[Mapping[Kind, str]] = {
    "carried over": "the same parameter, the same value",
    "converted": "another unit, scale or place; the formula gives the same effect",
    "nearest": "the target has something similar; the note states the difference",
    "added": "the target needs it and the source has no such parameter",
    "no counterpart": "the target has nothing for it; the note states what is lost",
}
"""What became of a key."""


class Change(NamedTuple):
    """What became of one key."""

    kind: Kind
    source: str
    """Full name in the source; empty for a key that is added."""
    value: Any
    origin: str
    """`file:line`, or whose default it is."""
    target: str
    """Full name in the target; empty without counterpart."""
    converted: Any
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return self._asdict()


class Item(NamedTuple):
    """A value of the target's file, and the comment behind it."""

    value: Any
    type: Type
    comment: str


@dataclass(slots=True)
class Conversion:
    """Files of the target and the report."""

    target: str
    """`Nav2 jazzy` or `move_base`."""
    sources: tuple[str, ...]
    changes: list[Change] = field(default_factory=list[Change])
    files: dict[str, str] = field(default_factory=dict[str, str])
    """Name -> content."""
    params: tuple[str, ...] = ()
    """The files of those that navstack loads, in loading order."""
    tree: str = ""
    """The file with the behavior tree; empty without."""

    def of_kind(self, kind: Kind) -> list[Change]:
        """Return the changes of a kind."""
        return [c for c in self.changes if c.kind == kind]

    def counts(self) -> str:
        """Return the number of keys of each kind as text."""
        return ", ".join(f"{len(found)} {kind}" for kind in KINDS if (found := self.of_kind(kind)))

    def save(self, folder: Path, *, force: bool = False) -> list[Path]:
        """Write the files into a new folder, or replace those of their names with `force`; all of them or none.

        Raise OutputError for a folder that is not empty.
        """
        if is_dir(folder) and any(folder.iterdir()) and not force:
            raise OutputError(
                f"--out {folder} is not empty; give a new folder, or replace {', '.join(self.files)} in it with --force",
                path=str(folder),
            )
        ensure_directory(folder.parent)
        with tempfile.TemporaryDirectory(prefix=".navstack-", dir=folder.parent) as name:
            beside = Path(name)
            for file, content in self.files.items():
                write_text(beside / file, content)
            ensure_directory(folder)
            for file in self.files:
                try:
                    (beside / file).replace(folder / file)
                except OSError as exc:
                    raise OutputError(f"cannot write {folder / file}: {exc.strerror or exc}", path=str(folder)) from exc
        return [folder / file for file in self.files]

    def markdown(self) -> str:
        """Return the report: a table for each kind of change."""
        lines = [f"# {' '.join(self.sources)} for {self.target}", "", f"{self.counts()}.", ""]
        for kind, meaning in KINDS.items():
            found = self.of_kind(kind)
            if not found:
                continue
            lines += [f"## {kind.capitalize()}", "", f"{meaning[0].upper()}{meaning[1:]}.", ""]
            lines += ["| from | value | source | to | value | note |", "|---|---|---|---|---|---|"]
            lines += [_row(c) for c in found]
            lines.append("")
        return "\n".join(lines)


def _row(c: Change) -> str:
    old = f"`{shown(c.value)}`" if c.source else ""
    new = f"`{shown(c.converted)}`" if c.target else ""
    cells = (f"`{c.source}`" if c.source else "", old, c.origin, f"`{c.target}`" if c.target else "", new, c.note)
    return "| " + " | ".join(text.replace("|", "\\|") for text in cells) + " |"


def shown(value: Any) -> str:
    """Return a value for a report: numbers with six digits."""
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.6g}"
    return value_text(value)


def origin_of(p: Parameter, program: str) -> str:
    """Return `file:line` of a value, or `default of PROGRAM`."""
    return f"default of {program}" if p.origin is None else p.origin_text


# ----------------------------------------------------------------------------------------------------------------------
# YAML with the strict types of rcl: a double has a point or an exponent, a text has quotes.


def typed(kind: Type, value: Any) -> Any:
    """Return a value in a type of rcl."""
    match kind:
        case "double":
            return float(value) + 0.0  # -0.0 -> 0.0
        case "int":
            return round(value)
        case "bool":
            return bool(value)
        case "string":
            return value if isinstance(value, str) else value_text(value)
        case "doubles":
            return [float(v) + 0.0 for v in value]
        case "ints":
            return [round(v) for v in value]
        case "strings":
            return [str(v) for v in value]


def rcl_text(value: Any) -> str:
    """Return a value in the YAML of ROS 2."""
    if isinstance(value, float):
        return _double(value)
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, list):
        items: Sequence[Any] = value
        return "[" + ", ".join(rcl_text(v) for v in items) + "]"
    return value_text(value)


def _double(value: float) -> str:
    if math.isinf(value):
        return ".inf" if value > 0.0 else "-.inf"
    text = repr(value)
    if "e" in text and "." not in text:  # 1e-10 has no point: YAML 1.1 would read a text
        mantissa, _, exponent = text.partition("e")
        return f"{mantissa}.0e{exponent}"
    return text


def nav2_yaml(nodes: Mapping[str, Mapping[str, Item]], header: Iterable[str]) -> str:
    """Return a parameter file of ROS 2: nodes by name (`local_costmap/local_costmap`), parameters by dotted name."""
    lines = [f"# {line}".rstrip() for line in header]
    for name, items in nodes.items():
        if not items:
            continue
        lines.append("")
        depth = 0
        for part in (*name.split("/"), "ros__parameters"):
            lines.append(f"{'  ' * depth}{part}:")
            depth += 1
        tree: dict[str, Any] = {}
        for dotted, item in items.items():
            *above, last = dotted.split(".")
            at = tree
            for part in above:
                at = at.setdefault(part, {})
            at[last] = item
        _write(tree, depth, lines)
    return "\n".join(lines) + "\n"


def _write(tree: Mapping[str, Any], depth: int, lines: list[str]) -> None:
    pad = "  " * depth
    texts = {k: f"{pad}{k}: {rcl_text(v.value)}" for k, v in tree.items() if isinstance(v, Item)}
    width = min(56, max((len(t) for t in texts.values()), default=0))
    for key, child in tree.items():
        if isinstance(child, Item):
            comment = child.comment if child.comment.isprintable() else child.comment.encode("unicode_escape").decode()
            lines.append(f"{texts[key].ljust(width)}  # {comment}")
    for key, child in tree.items():
        if not isinstance(child, Item):
            lines.append(f"{pad}{key}:")
            _write(child, depth + 1, lines)
