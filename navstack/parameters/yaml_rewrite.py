"""Write changed parameter values into copies of the user's YAML files; layout, key names and comments stay as they are.

A parameter that no file sets gets a new line in its namespace. The result is loaded again and compared with the wanted
configuration before it is returned. Where the files cannot express it (for example, a launch file), the values go to an
overlay file that is loaded after them.

In a file of Nav2, the values go to Nav2's own parameters, with the types that Nav2 declares.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from navstack.core import InputError, NavError, OutputError, ParameterError, ensure_directory, write_text
from navstack.parameters.configuration import load_configuration
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.findings import Location
from navstack.parameters.nav2.declared import NAV2_DISTROS
from navstack.parameters.nav2.own_keys import OwnKey, own_keys
from navstack.parameters.report import Parameter, parameters_of, same_parameters
from navstack.parameters.sources import Source, packaged_folder, packaged_sets, read_sources, split_namespace
from navstack.parameters.yaml_editor import YamlEditor, block_lines, value_text

# ----------------------------------------------------------------------------------------------------------------------
# Editable copies of the YAML files that parameter sources load.


@dataclass(frozen=True, slots=True)
class SourceCopy:
    """One file."""

    shown: str
    """Its name in locations."""
    name: str
    """Its name in the new folder."""
    path: Path
    """The user's file."""
    editor: YamlEditor


class SourceCopies:
    """All files of the sources, with new names; several sources get a numbered folder each."""

    def __init__(self, sources: Sequence[str]) -> None:
        self.by_shown: dict[str, SourceCopy] = {}
        params: list[str] = []
        self.movable = True
        """False for sources that cannot be copied: launch files refer to files by their own location."""
        for number, source in enumerate(sources, 1):
            found = self._add_source(source, f"{number}/" if len(sources) > 1 else "")
            if found is None:
                self.movable = False
            else:
                params.append(found)
        self.params = tuple(params)
        """The copies as values of `--params`, relative to the new folder (`.`: the folder itself)."""

    def _add_source(self, source: str, prefix: str) -> str | None:
        """Adds the files of a source; its value of `--params`, or None if it cannot be copied."""
        text, namespace = split_namespace(source)
        packaged = text in packaged_sets()
        path = packaged_folder(text) if packaged else Path(text)
        suffix = f"@{namespace}" if namespace else ""
        if path.is_dir():
            shown = text if packaged else text.rstrip("/") or "/"
            names = read_sources([source]).files
            if any(name.endswith((".launch", ".xml")) for name in names):
                return None  # loaded through its launch file
            for name in names:
                relative = name.removeprefix(f"{shown}/")
                self._add_file(path / relative, name, f"{prefix}{relative}")
            return (prefix.rstrip("/") or ".") + suffix
        if path.suffix in (".launch", ".xml") or not path.is_file():
            return None
        self._add_file(path, text, f"{prefix}{path.name}")
        return f"{prefix}{path.name}{suffix}"

    def _add_file(self, path: Path, shown: str, name: str) -> None:
        editor = YamlEditor(path.read_bytes().decode("utf-8"))
        self.by_shown.setdefault(shown, SourceCopy(shown, name, path, editor))

    def files(self) -> dict[str, str]:
        """The edited text of each file, by its name in the new folder."""
        return {c.name: c.editor.text() for c in self.by_shown.values()}

    def originals(self) -> dict[str, Path]:
        """The user's file of each copy, by the copy's name."""
        return {c.name: c.path for c in self.by_shown.values()}


OVERLAY_FILE = "overlay.yaml"
"""Default name of the file for values that the user's own files cannot express."""


@dataclass(frozen=True, slots=True)
class ValueChange:
    """A parameter with a new value."""

    name: str
    old: Any
    """None if no file sets it."""
    new: Any
    place: str
    """file:line in the user's file; empty for an added line."""
    added: bool
    """True if the parameter gets a new line."""


@dataclass(frozen=True, slots=True)
class RewrittenFiles:
    """Files with the new values."""

    files: dict[str, str]
    """Name relative to the new folder -> text."""
    params: tuple[str, ...]
    """Values of `--params`, in order, relative to the new folder (`.`: the folder itself; `=NAME`: not copied)."""
    changes: tuple[ValueChange, ...]
    overlay_reason: str = ""
    """Why an overlay file is needed; empty without one."""
    originals: Mapping[str, Path] = field(default_factory=dict[str, Path])
    """The user's file of each copy; an overlay has none."""

    def sources(self, folder: Path) -> list[str]:
        """Values of `--params` for files saved in `folder`."""
        return [_source_in(folder, name) for name in self.params]

    def save(self, folder: Path) -> list[str]:
        """Writes the files; returns `sources(folder)`. Raises OutputError."""
        ensure_directory(folder)
        for name, text in self.files.items():
            ensure_directory((folder / name).parent)
            _write_exactly(folder / name, text)
        return self.sources(folder)

    def changed_originals(self) -> dict[Path, str]:
        """Returns the user's files that would change, with their new text. Raises InputError if they cannot express them."""
        if self.overlay_reason:
            raise InputError(f"your files cannot express the new values: {self.overlay_reason}; save a copy instead")
        paths = {path: self.files[name] for name, path in self.originals.items()}
        return {path: text for path, text in paths.items() if path.read_bytes().decode("utf-8") != text}


def overwrite(files: Mapping[Path, str]) -> None:
    """Writes new texts into existing files. Raises OutputError."""
    for path, text in files.items():
        _write_exactly(path, text)


def _source_in(folder: Path, name: str) -> str:
    if name.startswith("="):
        return name[1:]
    file, at, namespace = name.partition("@")
    return f"{folder if file == '.' else folder / file}{at}{namespace}"


def _write_exactly(path: Path, text: str) -> None:
    """Writes without converting line ends."""
    if "\r" not in text:
        write_text(path, text)
        return
    try:
        path.write_bytes(text.encode("utf-8"))
    except OSError as exc:
        raise OutputError(f"cannot write {path}: {exc.strerror or exc}", path=str(path)) from exc


def rewrite_parameters(
    sources: Sequence[Source],
    values: Mapping[str, Any],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
    overlay: str = OVERLAY_FILE,
) -> RewrittenFiles:
    """Copies of the files of `sources` with `values` (full name -> value) in them.

    `overrides` and `distro` of the command line are written too: the new files alone give the same configuration. `overlay`
    names the overlay file. Raises ParameterError for invalid values.
    """
    target = load_configuration(
        sources,
        overrides=[*overrides, *(f"{name}={value_text(value)}" for name, value in values.items())],
        distro=distro,
        allow_missing=allow_missing,
    )
    named = [str(s) for s in sources if not isinstance(s, Mapping)]
    of_nav2 = distro if distro in NAV2_DISTROS else None  # no file can say it
    try:
        base = load_configuration(sources, distro=of_nav2, allow_missing=allow_missing)
    except ParameterError:  # valid only with the overrides
        return _with_overlay(
            named,
            overlay,
            tuple(
                ValueChange(name, None, p.value, "", True)
                for name, p in _by_name(target).items()
                if name in values or _from_command_line(target, name)
            ),
            "your files cannot be loaded without the values of the command line",
        )
    changes = tuple(_changes(base, target))
    rewriter = _Rewriter(
        base, SourceCopies(named), own_keys(read_sources(sources, distro=of_nav2, substitute=allow_missing))
    )
    reason = rewriter.apply(changes)
    changes = tuple(replace(c, place="", added=True) if c.name in rewriter.added else c for c in changes)
    made = RewrittenFiles(
        rewriter.copies.files(), rewriter.copies.params, changes, originals=rewriter.copies.originals()
    )
    if not reason:
        environment = [s for s in sources if isinstance(s, Mapping)]
        reason = _difference(made, environment, target, of_nav2, allow_missing)
    return _with_overlay(named, overlay, changes, reason) if reason else made


def _with_overlay(named: Sequence[str], overlay: str, changes: tuple[ValueChange, ...], reason: str) -> RewrittenFiles:
    """Unchanged copies, and a file with the new values."""
    tree: dict[str, Any] = {}
    for change in changes:
        *namespaces, last = change.name.split("/")
        at = tree
        for part in namespaces:
            at = at.setdefault(part, {})
        at[last] = change.new
    lines = [
        "# New values. Load this file after the others. The values are in a separate file because",
        f"# {reason}.",
        *block_lines(tree),
    ]
    copies = SourceCopies(named)
    params = copies.params if copies.movable else tuple(f"={name}" for name in named)
    files = copies.files() if copies.movable else {}
    originals = copies.originals() if copies.movable else {}
    return RewrittenFiles({**files, overlay: "\n".join(lines) + "\n"}, (*params, overlay), changes, reason, originals)


def _by_name(configuration: Configuration) -> dict[str, Parameter]:
    return {p.name: p for p in parameters_of(configuration)}


def _from_command_line(configuration: Configuration, name: str) -> bool:
    origin = configuration.origins.get(name)
    return origin is not None and origin.file.startswith("--")


def _changes(base: Configuration, target: Configuration) -> Iterator[ValueChange]:
    before = _by_name(base)
    for name, parameter in _by_name(target).items():
        old = before.get(name)
        if parameter.remark or parameter.value is None or (old is not None and old.value == parameter.value):
            continue
        if parameter.origin is None and (old is None or old.origin is None):
            continue  # nobody sets it: it follows another parameter
        origin = old.origin if old is not None else None
        place = f"{origin.file}:{origin.line}" if origin is not None and origin.line else ""
        yield ValueChange(name, old.value if old is not None else None, parameter.value, place, origin is None)


def _difference(
    made: RewrittenFiles, environment: Sequence[Source], target: Configuration, distro: str | None, allow_missing: bool
) -> str:
    """Why the new files do not give the target configuration; empty if they do."""
    with tempfile.TemporaryDirectory(prefix="navstack-") as name:
        sources: list[Source] = [*made.save(Path(name)), *environment]
        try:
            again = load_configuration(sources, distro=distro, allow_missing=allow_missing)
        except NavError:
            return "the edited files could not be loaded"
    if same_parameters(again, target):
        return ""
    return "the layout of your files does not allow these values"


class _Rewriter:
    """Applies changes to the copies of the files."""

    def __init__(self, base: Configuration, copies: SourceCopies, own: Mapping[str, OwnKey] | None = None) -> None:
        self.base = base
        self.copies = copies
        self.own = own
        """Parameters of Nav2 by their names here; None for files of move_base."""
        self.added: set[str] = set()
        """Names of the parameters that get a new line."""
        self._sharing: dict[Location, list[str]] = {}
        """Parameters by their origin: one value in a file may set several of them."""
        for p in parameters_of(base):
            if p.origin is not None:
                self._sharing.setdefault(p.origin, []).append(p.name)
        self._namespaces = _namespaces_by_place(base)

    def apply(self, changes: Sequence[ValueChange]) -> str:
        """Edits the copies; the reason if that is impossible, or an empty string."""
        if not self.copies.movable:
            return "a launch file refers to other files by its own location"
        new = {c.name: c.new for c in changes}
        present = {p.name: p.value for p in parameters_of(self.base)}
        replaced: set[str] = set()
        for change in changes:
            if change.name in replaced:
                continue
            origin = self.base.origins.get(change.name)
            sharing = self._sharing[origin] if origin is not None else []
            agree = all(new.get(n, present[n]) == change.new for n in sharing)
            value = self._typed(change)
            if origin is not None and agree:
                done = self._replace(origin, value)
                replaced |= set(sharing) if done else set()
            else:
                done = False
            if not done and not self._add(replace(change, new=value)):
                return (
                    f"they have no place for {change.name}"
                    if self.own is None
                    else f"Nav2 has no place for {change.name}"
                )
        return ""

    def _own_key(self, name: str) -> OwnKey | None:
        """The parameter of Nav2; goal checkers are also listed below the controller that uses them."""
        own = self.own or {}
        return own.get(name) or own.get(name.partition("/")[2])

    def _typed(self, change: ValueChange) -> Any:
        """The new value with the type that the file needs."""
        own = self._own_key(change.name)
        typed = own.typed(change.new) if own is not None else change.new
        return change.new if typed is None else typed

    def _replace(self, origin: Location, value: Any) -> bool:
        """Replaces the value at its origin; False if that is not a scalar in a file."""
        copy = self.copies.by_shown.get(origin.file)
        if copy is None or isinstance(value, (list, dict)):
            return False
        return copy.editor.replace(origin.line, origin.column, value)

    def _add(self, change: ValueChange) -> bool:
        """Adds a line, in a mapping that sets parameters of this namespace only; False if there is none."""
        if isinstance(change.new, (list, dict)):
            return False
        if self.own is not None and not change.name.startswith("navstack/"):
            own = self._own_key(change.name)
            return own is not None and self._add_own(change, own)
        namespace, _, name = change.name.rpartition("/")
        path = [name]
        # the namespace itself, or the nearest one above that has a mapping
        while True:
            for copy, mapping in self._mappings_of(namespace):
                if copy.editor.add(mapping, path, change.new):
                    self.added.add(change.name)
                    return True
            if not namespace:
                return False
            namespace, _, part = namespace.rpartition("/")
            path.insert(0, part)

    def _add_own(self, change: ValueChange, own: OwnKey) -> bool:
        """Adds a parameter of Nav2 next to one of the nearest block of its node, nested or dotted as that one."""
        for at, name in own.neighbors():
            copy = self.copies.by_shown.get(at.file)
            pair = (
                next((p for p in copy.editor.pairs() if p.at == (at.line, at.column)), None)
                if copy is not None
                else None
            )
            if copy is None or pair is None or not name.endswith(pair.key.value):
                continue
            above = name[: len(name) - len(pair.key.value)]
            if not own.name.startswith(above):
                continue
            rest = own.name[len(above) :]
            dotted = any("." in key.value for key, _ in pair.mapping.value)
            if copy.editor.add(pair.mapping, [rest] if dotted else rest.split("."), change.new):
                self.added.add(change.name)
                return True
        return False

    def _mappings_of(self, namespace: str) -> Iterator[tuple[SourceCopy, Any]]:
        """Mappings whose keys all belong to this namespace alone, those of the last file first."""
        for copy in reversed(self.copies.by_shown.values()):
            used: dict[int, list[set[str]]] = {}
            mappings: dict[int, Any] = {}
            for pair in copy.editor.pairs():
                namespaces = self._namespaces.get((copy.shown, *pair.at), set())
                used.setdefault(id(pair.mapping), []).append(namespaces)
                if namespaces == {namespace}:
                    mappings.setdefault(id(pair.mapping), pair.mapping)
            # not in a mapping with keys that set parameters of other namespaces too
            yield from ((copy, m) for number, m in mappings.items() if all(n <= {namespace} for n in used[number]))


def _namespaces_by_place(configuration: Configuration) -> dict[tuple[str, int, int], set[str]]:
    """Place of a key (file, line, column) -> the namespaces that it sets parameters in."""
    found: dict[tuple[str, int, int], set[str]] = {}

    def walk(space: Any) -> None:
        for child in space.children.values():
            found.setdefault(tuple(child.at), set()).add(space.path)
            if hasattr(child, "children"):
                walk(child)

    walk(configuration.tree)
    return found
