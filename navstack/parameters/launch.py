"""What a roslaunch file would put on the parameter server for its move_base node.

Read: launch, group, arg, include, node, param, rosparam, remap, `if` and `unless`, and the substitutions arg, find, env,
optenv, anon and dirname. `$(find package)` is looked for next to the file: in the folders above it, by the package's name
and by the rest of the path. Nothing is executed: `$(eval ..)` and `command=` are refused.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from navstack.core.files import exists, is_file
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.tree import Space, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import MAX_BYTES, DictNode, Node, ScalarNode, parse_value, read_yaml, relocate

MAX_INCLUDES = 50
FOLDERS_UP = 5
_SUBSTITUTION = re.compile(r"\$\(\s*([a-z]+)((?:\s+[^()]*)?)\)")
_ARGUMENT = re.compile(r"([A-Za-z_][A-Za-z0-9_/]*):=(.*)\Z", re.DOTALL)


def launch_argument(text: str) -> tuple[str, str] | None:
    """`model:=burger` -> ("model", "burger"), as on roslaunch's command line."""
    found = _ARGUMENT.match(text)
    return (found[1], found[2]) if found else None


@dataclass(slots=True)
class Element:
    """An XML element and where it stands."""

    tag: str
    attributes: dict[str, str]
    line: int
    column: int
    children: list[Element] = field(default_factory=list["Element"])
    text: str = ""
    text_line: int = 0


class _Stop(Exception):
    """This element cannot be read; a finding says why."""


@dataclass(slots=True)
class _Scope:
    """What an element sees: its file, the namespace, the arguments."""

    path: Path
    shown: str
    namespace: tuple[str, ...] = ()
    arguments: dict[str, str] = field(default_factory=dict[str, str])
    passed: Mapping[str, str] = field(default_factory=dict[str, str])
    """Arguments given from outside."""
    private: tuple[str, ...] | None = None
    """The node whose private names are meant."""


class LaunchReader:
    """One launch file with its includes -> the parameters below its move_base node."""

    def __init__(self, findings: list[Finding], files: list[str]) -> None:
        self.findings = findings
        self.files = files
        self.server = Space("", Location(""))
        self.nodes: list[tuple[tuple[str, ...], Location]] = []
        self.includes = 0
        self.remaps: list[tuple[str, str, Location]] = []

    def read(self, path: Path, shown: str, arguments: Mapping[str, str]) -> Space | None:
        """The namespace of the move_base node; None without one."""
        used = set(arguments)
        root = self._parse(path, shown)
        if root is None:
            return None
        scope = _Scope(path, shown, passed=arguments)
        self._children(root, scope)
        for name in sorted(used - scope.arguments.keys()):
            at = Location(shown)
            self.say(
                "warning",
                "launch",
                at,
                f"this launch file has no argument {name}; {name}:={arguments[name]} has no effect",
            )
        if not self.nodes:
            self.say(
                "error",
                "launch",
                Location(shown),
                "this launch file starts no move_base node; name the launch file that does",
            )
            return None
        if len(self.nodes) > 1:
            names = ", ".join("/".join(n) for n, _ in self.nodes)
            at = self.nodes[1][1]
            self.say("warning", "launch", at, f"there are several move_base nodes ({names}); the first is loaded")
        for source, target, at in self.remaps:
            message = f"the topic {source} is remapped to {target}; topics are taken here as the YAML writes them"
            self.say("info", "remap", at, message)
        space: Space | None = self.server
        for name in self.nodes[0][0]:
            space = space.space(name) if space is not None else None
        return space or Space("", Location(shown))

    def say(self, severity: Severity, rule: str, at: Location, message: str) -> None:
        """Adds a finding about the launch file."""
        self.findings.append(finding(severity, rule, at, "", message))

    # --- XML --------------------------------------------------------------------------------------------------------

    def _parse(self, path: Path, shown: str) -> Element | None:
        if exists(path) and not path.is_file():
            self.say("error", "cannot-read", Location(shown), f"{shown} is no file; name a launch file")
            return None
        try:
            with path.open("rb") as stream:
                data = stream.read(MAX_BYTES + 1)
        except OSError as exc:
            self.say("error", "cannot-read", Location(shown), f"{shown} cannot be read: {exc.strerror or exc}")
            return None
        self.files.append(shown)
        if len(data) > MAX_BYTES:
            self.say("error", "too-large", Location(shown), f"{shown} is larger than 1 MB: this is no launch file")
            return None
        root = Element("", {}, 1, 1)
        stack = [root]
        parser = expat.ParserCreate()

        def start(tag: str, attributes: dict[str, str]) -> None:
            if len(stack) > MAX_INCLUDES:
                raise _Stop("more than 50 levels deep")
            made = Element(tag, attributes, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
            stack[-1].children.append(made)
            stack.append(made)

        def text(data: str) -> None:
            top = stack[-1]
            if not top.text:
                top.text_line = parser.CurrentLineNumber
            top.text += data

        def refuse(*_: Any) -> None:
            raise _Stop("a document type or entity is declared, which launch files do not need")

        parser.buffer_text = True
        parser.StartElementHandler = start
        parser.EndElementHandler = lambda _: stack.pop()
        parser.CharacterDataHandler = text
        parser.StartDoctypeDeclHandler = refuse
        try:
            parser.Parse(data, True)
        except expat.ExpatError as exc:
            at = Location(shown, exc.lineno, exc.offset + 1)
            self.say("error", "xml", at, f"this is not XML: {expat.errors.messages[exc.code]}")
            return None
        except _Stop as exc:
            at = Location(shown, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
            self.say("error", "xml", at, f"{shown} is refused: {exc}")
            return None
        except (ValueError, LookupError) as exc:
            self.say("error", "xml", Location(shown), f"{shown} cannot be read as XML: {exc}")
            return None
        top = root.children[0]
        if top.tag != "launch":
            at = Location(shown, top.line, top.column)
            self.say("error", "xml", at, f"the file holds <{top.tag}>, not <launch>: it is no launch file")
            return None
        return top

    # --- elements ---------------------------------------------------------------------------------------------------

    def _children(self, element: Element, scope: _Scope) -> None:
        for child in element.children:
            try:
                if self._wanted(child, scope):
                    self._element(child, scope)
            except _Stop:
                continue

    def _element(self, element: Element, scope: _Scope) -> None:
        match element.tag:
            case "arg":
                self._arg(element, scope)
            case "group":
                inner = _Scope(
                    scope.path,
                    scope.shown,
                    self._namespace(element, scope),
                    dict(scope.arguments),
                    scope.passed,
                    scope.private,
                )
                self._children(element, inner)
            case "include":
                self._include(element, scope)
            case "node":
                self._node(element, scope)
            case "rosparam":
                self._rosparam(element, scope)
            case "param":
                self._param(element, scope)
            case "remap":
                source, target = self._get(element, "from", scope), self._get(element, "to", scope)
                if scope.private is not None and source.strip("/") != target.strip("/"):
                    self.remaps.append((source, target, self._at(element, scope)))
            case _:
                pass

    def _at(self, element: Element, scope: _Scope) -> Location:
        return Location(scope.shown, element.line, element.column)

    def _wanted(self, element: Element, scope: _Scope) -> bool:
        for name, meant in (("if", True), ("unless", False)):
            if name not in element.attributes:
                continue
            value = self._get(element, name, scope).strip().lower()
            if value not in ("true", "false", "1", "0"):
                message = f'{name}="{value}" of <{element.tag}> is neither true nor false; the element is left out'
                self.say("error", "launch", self._at(element, scope), message)
                return False
            if (value in ("true", "1")) is not meant:
                return False
        return True

    def _get(self, element: Element, name: str, scope: _Scope, default: str | None = None) -> str:
        """An attribute, substitutions made."""
        value = element.attributes.get(name, default)
        if value is None:
            self.say("error", "launch", self._at(element, scope), f"<{element.tag}> needs the attribute {name}")
            raise _Stop
        return self._substitute(value, element, scope)

    def _namespace(self, element: Element, scope: _Scope) -> tuple[str, ...]:
        text = self._get(element, "ns", scope, "")
        names = tuple(parts_of(text))
        return names if text.startswith("/") else (*scope.namespace, *names)

    def _arg(self, element: Element, scope: _Scope) -> None:
        name = self._get(element, "name", scope)
        if "value" in element.attributes:
            scope.arguments[name] = self._get(element, "value", scope)
        elif name in scope.passed:
            scope.arguments[name] = scope.passed[name]
        elif "default" in element.attributes:
            scope.arguments[name] = self._get(element, "default", scope)

    def _include(self, element: Element, scope: _Scope) -> None:
        quiet = len(self.findings)
        try:
            text = self._get(element, "file", scope)
        except _Stop:
            del self.findings[quiet:]
            text = ""
        path = self._find(text, scope) if text else None
        if path is None:
            what = text or element.attributes.get("file", "")
            self.say("info", "launch", self._at(element, scope), f"{what} is not here; what it includes is left out")
            return
        self.includes += 1
        if self.includes > MAX_INCLUDES:
            message = f"more than {MAX_INCLUDES} files are included: the files include each other"
            self.say("error", "launch", self._at(element, scope), message)
            return
        passed = dict(scope.arguments) if element.attributes.get("pass_all_args") == "true" else {}
        inner = _Scope(scope.path, scope.shown, scope.namespace, dict(scope.arguments))
        for child in element.children:
            if child.tag == "arg" and self._wanted(child, scope):
                self._arg(child, inner)
                name = child.attributes.get("name", "")
                if name in inner.arguments:
                    passed[name] = inner.arguments[name]
        shown = _beside(scope, path)
        root = self._parse(path, shown)
        if root is not None:
            self._children(root, _Scope(path, shown, self._namespace(element, scope), passed=passed))

    def _node(self, element: Element, scope: _Scope) -> None:
        kind = element.attributes.get("type", "")
        is_move_base = "move_base" in (kind, element.attributes.get("pkg", "")) and kind.startswith("move_base")
        if not is_move_base:
            return
        name = self._get(element, "name", scope)
        private = (*self._namespace(element, scope), *parts_of(name))
        self.nodes.append((private, self._at(element, scope)))
        self._children(element, _Scope(scope.path, scope.shown, private, dict(scope.arguments), scope.passed, private))

    def _target(self, element: Element, scope: _Scope, name: str) -> tuple[tuple[str, ...], str]:
        """The namespace and last name of a parameter."""
        names = parts_of(name.removeprefix("~"))
        if not names:
            self.say("error", "launch", self._at(element, scope), f'"{name}" is no parameter name')
            raise _Stop
        if name.startswith("/"):
            return tuple(names[:-1]), names[-1]
        return (*self._namespace(element, scope), *names[:-1]), names[-1]

    def _space(self, names: tuple[str, ...], at: Location) -> Space:
        space = self.server
        for name in names:
            space = descend(space, name, at, self.findings)
        return space

    def _param(self, element: Element, scope: _Scope) -> None:
        at = self._at(element, scope)
        name = self._get(element, "name", scope)
        for unread in ("textfile", "binfile", "command"):
            if unread in element.attributes:
                self.say("info", "launch", at, f"{name} comes from {unread}=, which is not read here")
                return
        text = self._get(element, "value", scope)
        try:
            value = _typed(text, element.attributes.get("type", "auto"))
        except ValueError:
            kind = element.attributes["type"]
            self.say("error", "launch", at, f'{name} = "{text}" is not of its type {kind}; correct one of them')
            return
        namespace, last = self._target(element, scope, name)
        node: Node = ScalarNode(value, at, isinstance(value, str), text)
        if element.attributes.get("type") == "yaml":
            made, findings = parse_value(text, scope.shown)
            self.findings += findings
            if made is None:
                return
            relocate(made, at)
            node = made
        put(self._space(namespace, at), last, at, node, self.findings)

    def _rosparam(self, element: Element, scope: _Scope) -> None:
        at = self._at(element, scope)
        command = self._get(element, "command", scope, "load")
        if command != "load":
            return
        root = self._rosparam_content(element, scope)
        name = self._get(element, "param", scope, "")
        if name:
            namespace, last = self._target(element, scope, name)
            if root is not None:
                put(self._space(namespace, at), last, at, root, self.findings)
            return
        if isinstance(root, DictNode):
            overlay(self._space(self._namespace(element, scope), at), root, self.findings)
        elif root is not None and not (isinstance(root, ScalarNode) and root.value is None):
            self.say("error", "launch", root.at, "this is one value, not `name: value` lines; say whose with param=")

    def _rosparam_content(self, element: Element, scope: _Scope) -> Node | None:
        fill = element.attributes.get("subst_value", "false").lower() in ("true", "1")
        at = self._at(element, scope)
        if "file" in element.attributes:
            text = self._get(element, "file", scope)
            path = self._find(text, scope)
            if path is None:
                message = f"{text} is not here; put it beside the launch file, under its package's name"
                self.say("error", "launch", at, message)
                return None
            shown = _beside(scope, path)
            if not fill:
                read = read_yaml(path, shown)
                self.findings += read.findings
                self.files.append(shown)
                return read.root
            content = path.read_bytes()[: MAX_BYTES + 1].decode("utf-8-sig", "replace")
            self.files.append(shown)
            node, findings = parse_value(self._substitute(content, element, scope), shown)
            self.findings += findings
            return node
        content = "\n" * (element.text_line - 1) + (
            self._substitute(element.text, element, scope) if fill else element.text
        )
        node, findings = parse_value(content, scope.shown)
        self.findings += findings
        return node

    # --- substitution -----------------------------------------------------------------------------------------------

    def _substitute(self, text: str, element: Element, scope: _Scope) -> str:
        def value(found: re.Match[str]) -> str:
            command, rest = found[1], found[2].split()
            match command, rest:
                case "arg", [name]:
                    if name in scope.arguments:
                        return scope.arguments[name]
                    problem = f"the argument {name} has no value; give it with {name}:=VALUE beside the launch file"
                case "find", [_]:
                    return found[0]
                case "env", [name]:
                    if name in os.environ:
                        return os.environ[name]
                    problem = f"the environment variable {name} is not set"
                case "optenv", [name, *default]:
                    return os.environ.get(name, " ".join(default))
                case "anon", [name]:
                    return name
                case "dirname", []:
                    return str(scope.path.parent)
                case _:
                    problem = f"{found[0]} is not evaluated here; write its value"
            self.say("error", "launch", self._at(element, scope), problem)
            raise _Stop

        return _SUBSTITUTION.sub(value, text)

    def _find(self, text: str, scope: _Scope) -> Path | None:
        """The file meant; `$(find package)` is looked for in the folders above the launch file."""
        found = _SUBSTITUTION.match(text)
        if found is None or found[1] != "find":
            path = Path(text)
            path = path if path.is_absolute() else scope.path.parent / path
            return path if is_file(path) else None
        package = found[2].strip()
        rest = parts_of(text[found.end() :])
        for path in _candidates(scope.path, package, rest):
            if is_file(path):
                return path
        return None


def _candidates(launch: Path, package: str, rest: list[str]) -> Iterator[Path]:
    """Places of `$(find package)/rest`: a workspace's layout first, then ones with folders left out."""
    folders = [launch.resolve().parent, *launch.resolve().parent.parents][:FOLDERS_UP]
    for folder in folders:
        yield folder.joinpath(package, *rest)
        yield folder.joinpath(*rest)
    # exported flat: package__launch__include__move_base.launch
    yield folders[0] / "__".join([package, *rest])
    for skipped in range(1, len(rest)):
        for folder in folders[: FOLDERS_UP - 2]:
            yield folder.joinpath(package, *rest[skipped:])
            yield folder.joinpath(*rest[skipped:])


def _beside(scope: _Scope, path: Path) -> str:
    """A file's name for messages, relative as the launch file's was."""
    shown = Path(scope.shown)
    if shown.is_absolute():
        return str(path)
    try:
        return os.path.relpath(path)
    except ValueError:
        return str(path)


def _typed(text: str, kind: str) -> Any:
    """A `<param>`'s value, as roslaunch converts it; raises ValueError."""
    match kind:
        case "str" | "string" | "yaml":
            return text
        case "int":
            return int(text)
        case "double":
            return float(text)
        case "bool" | "boolean":
            if text.strip().lower() in ("true", "1"):
                return True
            if text.strip().lower() in ("false", "0"):
                return False
            raise ValueError(text)
        case "auto":
            for convert in (int, float):
                try:
                    return convert(text)
                except ValueError:
                    continue
            lowered = text.strip().lower()
            return lowered == "true" if lowered in ("true", "false") else text
        case _:
            raise ValueError(text)
