"""Tuned values in the user's own files: only the changed values are touched; layout, key names and comments stay.

ruamel.yaml says where each value begins and ends; the text is replaced there and nowhere else. A parameter that no file
has yet gets a line in the namespace it belongs to. What was written is loaded again and compared before it is given out;
where the files cannot say it (a launch file's own values, say), a file to be loaded after them does.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from navstack.core.errors import NavError, OutputError, ParameterError
from navstack.core.files import ensure_directory, write_text
from navstack.parameters import Location, packaged_folder, packaged_sets, read_sources
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.report import Parameter, parameters_of, same_parameters
from navstack.parameters.sources import Source, split_namespace
from navstack.tune.extras import need
from navstack.tune.space import Value, value_of

OVERLAY = "tuned.yaml"
"""Name of the file that says what the user's own files cannot."""
_BOM = "\ufeff"
_PREFIX = re.compile(r"(?:&\S+\s+)+")


@dataclass(frozen=True, slots=True)
class Change:
    """A parameter whose value is another one now."""

    name: str
    old: Any
    new: Any
    place: str
    """file:line of the user's file; empty for a line that was added."""
    added: bool
    """It got a line of its own."""


@dataclass(frozen=True, slots=True)
class Written:
    """Files that say the tuned parameters."""

    files: dict[str, str]
    """Name relative to the new folder -> text."""
    params: tuple[str, ...]
    """What `--params` takes, in order, relative to the new folder (its own name: `.`)."""
    changes: tuple[Change, ...]
    why_overlay: str = ""
    """Why a file is to be loaded after the user's own; empty where they say it themselves."""

    def sources(self, folder: Path) -> list[str]:
        """The same for files in `folder`."""
        return [_in(folder, name) for name in self.params]

    def save(self, folder: Path) -> list[str]:
        """Writes the files; what to give `--params`."""
        ensure_directory(folder)
        for name, text in self.files.items():
            ensure_directory((folder / name).parent)
            _write_exactly(folder / name, text)
        return self.sources(folder)


def _in(folder: Path, name: str) -> str:
    if name.startswith("="):  # as the user named it: not ours to move
        return name[1:]
    file, at, namespace = name.partition("@")
    return f"{folder if file == '.' else folder / file}{at}{namespace}"


def _write_exactly(path: Path, text: str) -> None:
    """Line ends as they are."""
    if "\r" not in text:
        write_text(path, text)
        return
    try:
        path.write_bytes(text.encode("utf-8"))
    except OSError as exc:
        raise OutputError(f"cannot write {path}: {exc.strerror or exc}", path=str(path)) from exc


def written(
    sources: Sequence[Source],
    values: Mapping[str, Value],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Written:
    """The user's `sources` with `values` (by full name) in them, as new files.

    `overrides` and `distro`, given on the command line, are written as well: loaded without them, the new files come to
    the same. Raises InputError where ruamel.yaml is missing, ParameterError for values that cannot be used.
    """
    need("ruamel.yaml", "writing tuned parameters")
    all_overrides = [*overrides, *(f"{name}={value_of(value)}" for name, value in values.items())]
    target = load_configuration(sources, overrides=all_overrides, distro=distro, allow_missing=allow_missing)
    named = [str(s) for s in sources if not isinstance(s, Mapping)]
    environment: list[Source] = [s for s in sources if isinstance(s, Mapping)]
    try:
        base = load_configuration(sources, allow_missing=allow_missing)
    except ParameterError:
        base = None  # only the overrides made it usable
    copies = _Copies(named)
    if base is None:
        why = "your files cannot be loaded without the values of the command line"
        wanted = {n: v for n, v in _by_name(target).items() if n in values or _from_command_line(target, n)}
        changes = tuple(Change(n, None, v.value, "", True) for n, v in wanted.items())
        return _overlaid(copies, named, changes, {n: p.value for n, p in wanted.items()}, why)
    changes = tuple(_changes(base, target))
    edits = _Edits(base, copies)
    why = edits.apply(changes)
    changes = tuple(replace(c, place="", added=True) if c.name in edits.inserted else c for c in changes)
    made = Written(copies.files(), copies.params, changes)
    if not why:
        why = _differs(made, environment, target, allow_missing)
    if why:
        return _overlaid(_Copies(named), named, changes, {c.name: c.new for c in changes}, why)
    return made


def _overlaid(
    copies: _Copies, named: Sequence[str], changes: Sequence[Change], values: Mapping[str, Any], why: str
) -> Written:
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *above, last = name.split("/")
        at = tree
        for part in above:
            at = at.setdefault(part, {})
        at[last] = value
    lines = [
        "# Tuned values. Load this file after the others; it stands beside them because",
        f"# {why}.",
        *_block(tree, 0),
    ]
    kept = copies.params if copies.movable else tuple(f"={name}" for name in named)
    files = copies.files() if copies.movable else {}
    return Written({**files, OVERLAY: "\n".join(lines) + "\n"}, (*kept, OVERLAY), tuple(changes), why)


def _block(tree: Mapping[str, Any], depth: int) -> Iterator[str]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield f"{'  ' * depth}{key}:"
            yield from _block(value, depth + 1)
        else:
            yield f"{'  ' * depth}{key}: {value_of(value)}"


def _by_name(configuration: Configuration) -> dict[str, Parameter]:
    return {p.name: p for p in parameters_of(configuration)}


def _from_command_line(configuration: Configuration, name: str) -> bool:
    origin = configuration.origins.get(name)
    return origin is not None and origin.file.startswith("--")


def _changes(base: Configuration, target: Configuration) -> Iterator[Change]:
    before, after = _by_name(base), _by_name(target)
    for name, parameter in after.items():
        old = before.get(name)
        if parameter.remark or parameter.value is None or (old is not None and old.value == parameter.value):
            continue
        origin = old.origin if old is not None else None
        place = f"{origin.file}:{origin.line}" if origin is not None and origin.line else ""
        yield Change(name, old.value if old is not None else None, parameter.value, place, origin is None)


def _differs(made: Written, environment: Sequence[Source], target: Configuration, allow_missing: bool) -> str:
    """Why what was written does not come to the same; empty where it does."""
    with tempfile.TemporaryDirectory(prefix="navstack-") as name:
        folder = Path(name)
        sources: list[Source] = [*made.save(folder), *environment]
        try:
            again = load_configuration(sources, allow_missing=allow_missing)
        except NavError:
            return "the edited files could not be loaded"
    if same_parameters(again, target):
        return ""
    return "in your files' layout, the values would not have come out as they are"


# --- the user's files -------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Copy:
    """A file of the user's, to be edited."""

    shown: str
    """As locations name it."""
    name: str
    """In the new folder."""
    text: str
    root: Any = None
    """Its composed document; None where ruamel.yaml cannot read it, or it is no YAML."""
    edits: list[tuple[int, int, str]] = field(default_factory=list[tuple[int, int, str]])

    @property
    def edited(self) -> str:
        text = self.text
        order = sorted(range(len(self.edits)), key=lambda i: (self.edits[i][0], i), reverse=True)
        for i in order:
            start, end, new = self.edits[i]
            text = text[:start] + new + text[end:]
        return text

    @property
    def newline(self) -> str:
        return "\r\n" if "\r\n" in self.text else "\n"


class _Copies:
    """Everything that the sources load, under new names."""

    def __init__(self, named: Sequence[str]) -> None:
        self.copies: dict[str, _Copy] = {}
        params: list[str] = []
        self.movable = True
        """False for sources that would not work elsewhere: launch files, which look around them."""
        for number, source in enumerate(named, 1):
            text, namespace = split_namespace(source)
            sub = f"{number}/" if len(named) > 1 else ""
            folder = packaged_folder(text) if text in packaged_sets() else Path(text)
            if folder.is_dir():
                shown = text if text in packaged_sets() else text.rstrip("/") or "/"
                for name in read_sources([source]).files:
                    relative = name.removeprefix(f"{shown}/")
                    self._add(folder / relative, name, f"{sub}{relative}")
                params.append((sub.rstrip("/") or ".") + (f"@{namespace}" if namespace else ""))
            elif folder.suffix in (".launch", ".xml") or not folder.is_file():
                self.movable = False
            else:
                self._add(folder, text, f"{sub}{folder.name}")
                params.append(f"{sub}{folder.name}" + (f"@{namespace}" if namespace else ""))
        self.params = tuple(params)

    def _add(self, path: Path, shown: str, name: str) -> None:
        copy = _Copy(shown, name, path.read_bytes().decode("utf-8"))
        copy.root = _compose(copy.text)
        self.copies.setdefault(shown, copy)

    def files(self) -> dict[str, str]:
        """Name -> text."""
        return {c.name: c.edited for c in self.copies.values()}


def _compose(text: str) -> Any:
    """The document's nodes with their marks, whose `index` counts characters of `text`."""
    yaml: Any = need("ruamel.yaml", "writing tuned parameters")
    blank = " " if text.startswith(_BOM) else ""  # the mark counts characters, so one stands in for it
    reader = yaml.YAML(typ="rt")
    reader.allow_duplicate_keys = True
    try:
        root = reader.compose(blank + text.removeprefix(_BOM))
    except yaml.error.YAMLError:
        return None
    return root if root is not None and root.id == "mapping" else None


def _pairs(node: Any) -> Iterator[tuple[Any, Any, Any]]:
    """(mapping, key, value) of every mapping in a document, from the top."""
    for key, value in node.value:
        yield node, key, value
        if value.id == "mapping":
            yield from _pairs(value)


def _at(mark: Any) -> tuple[int, int]:
    return mark.line + 1, mark.column + 1


class _Edits:
    """Changes -> edits of the copies."""

    def __init__(self, base: Configuration, copies: _Copies) -> None:
        self.base = base
        self.copies = copies
        self.sharing: dict[Location, list[str]] = {}
        for p in parameters_of(base):
            if p.origin is not None:
                self.sharing.setdefault(p.origin, []).append(p.name)
        self.homes = _homes(base)
        self.added: dict[int, tuple[_Copy, Any, dict[str, Any]]] = {}
        """By mapping: what is to be added to it."""
        self.inserted: set[str] = set()
        """Names of the parameters that get a line of their own."""

    def apply(self, changes: Sequence[Change]) -> str:
        """Edits; why it cannot be done, or nothing."""
        if not self.copies.movable:
            return "a launch file finds its files from where it lies"
        new = {c.name: c.new for c in changes}
        present = {p.name: p.value for p in parameters_of(self.base)}
        todo = list(changes)
        while todo:
            change = todo.pop(0)
            origin = self.base.origins.get(change.name)
            done = False
            if origin is not None:
                together = self.sharing[origin]
                agree = all(new.get(n, present[n]) == change.new for n in together)
                if agree:
                    done = self._replace(origin, change.new)
                    todo = [c for c in todo if c.name not in together]
            if not done and not self._insert(change):
                return f"there is no place for {change.name} in your files"
        self._write_added()
        return ""

    def _replace(self, origin: Location, value: Any) -> bool:
        """The value at its place; False where the file has none there."""
        copy = self.copies.copies.get(origin.file)
        if copy is None or copy.root is None or isinstance(value, (list, dict)):
            return False
        for _, _, node in _pairs(copy.root):
            if node.id == "scalar" and _at(node.start_mark) == (origin.line, origin.column):
                start, end = node.start_mark.index, node.end_mark.index
                anchor = _PREFIX.match(copy.text[start:end])
                start += len(anchor[0]) if anchor else 0
                if (start, end) not in [(a, b) for a, b, _ in copy.edits]:
                    copy.edits.append((start, end, value_of(value)))
                return True
        return False

    def _insert(self, change: Change) -> bool:
        """A line of its own, in a mapping that only this namespace is loaded from."""
        if isinstance(change.new, (list, dict)):
            return False
        path, _, key = change.name.rpartition("/")
        below: list[str] = [key]
        # the namespace itself, or the nearest one above that has a mapping of its own
        while True:
            for copy, mapping in self._mappings(path):
                if self._add_to(copy, mapping, below, change.new):
                    self.inserted.add(change.name)
                    return True
            if not path:
                return False
            path, _, part = path.rpartition("/")
            below.insert(0, part)

    def _mappings(self, path: str) -> Iterator[tuple[_Copy, Any]]:
        """Mappings that hold this namespace and no other, the last file's first."""
        for copy in reversed(self.copies.copies.values()):
            if copy.root is None:
                continue
            seen: list[Any] = []
            for mapping, key, _ in _pairs(copy.root):
                homes = self.homes.get((copy.shown, *_at(key.start_mark)), set())
                if homes == {path} and all(mapping is not m for m in seen):
                    seen.append(mapping)
            # a mapping of which some keys go elsewhere too does not do
            yield from ((copy, m) for m in seen if self._only(copy, m, path))

    def _only(self, copy: _Copy, mapping: Any, path: str) -> bool:
        homes = [self.homes.get((copy.shown, *_at(key.start_mark)), set()) for key, _ in mapping.value]
        return all(h <= {path} for h in homes)

    def _add_to(self, copy: _Copy, mapping: Any, below: Sequence[str], value: Any) -> bool:
        """Notes a value for a mapping; part of its namespaces may be there already."""
        *spaces, last = below
        while spaces:
            inner = next((v for k, v in mapping.value if k.value == spaces[0]), None)
            if inner is None:
                break
            if inner.id != "mapping":
                return False
            mapping = inner
            spaces.pop(0)
        if not mapping.value or (not spaces and any(k.value == last for k, _ in mapping.value)):
            return False
        at = self.added.setdefault(id(mapping), (copy, mapping, {}))[2]
        for space in spaces:
            at = at.setdefault(space, {})
        at[last] = value
        return True

    def _write_added(self) -> None:
        for copy, mapping, tree in self.added.values():
            end = _last_end(mapping)
            if mapping.flow_style:
                copy.edits.append((end, end, f", {_flow(tree)}"))
                continue
            indent = " " * mapping.value[0][0].start_mark.column
            text = copy.newline.join(indent + line for line in _block(tree, 0))
            newline = copy.text.find("\n", end)
            if newline < 0:
                copy.edits.append((len(copy.text), len(copy.text), copy.newline + text))
            else:
                copy.edits.append((newline + 1, newline + 1, text + copy.newline))


def _flow(tree: Mapping[str, Any]) -> str:
    return ", ".join(f"{k}: {{{_flow(v)}}}" if isinstance(v, dict) else f"{k}: {value_of(v)}" for k, v in tree.items())


def _last_end(node: Any) -> int:
    """Where the last thing that is written in a node ends."""
    while node.value and node.id == "mapping":
        key, value = node.value[-1]
        if value.id == "scalar" and value.value == "" and value.start_mark.index <= key.end_mark.index:
            return key.end_mark.index
        if value.id == "scalar" or value.flow_style:
            return value.end_mark.index
        node = value
    if node.id == "sequence" and node.value and not node.flow_style:
        return _last_end(node.value[-1])
    return node.end_mark.index


def _homes(configuration: Configuration) -> dict[tuple[str, int, int], set[str]]:
    """Place of a key -> the namespaces (of the parameters' tree) whose mappings hold it."""
    found: dict[tuple[str, int, int], set[str]] = {}

    def walk(space: Any) -> None:
        for child in space.children.values():
            found.setdefault(tuple(child.at), set()).add(space.path)
            if hasattr(child, "children"):
                walk(child)

    walk(configuration.tree)
    return found


__all__ = ["OVERLAY", "Change", "Written", "written"]
