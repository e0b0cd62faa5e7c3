"""The parameters that a roslaunch file sets for its move_base node.

Supported: launch, group, arg, include, node, param, rosparam, remap, `if` and `unless`, and the substitutions arg, find, env,
optenv, anon, dirname and eval. `$(find package)` is searched near the file (`navstack.parameters.packages`). Nothing is
executed: `$(eval ..)` is evaluated by its syntax tree, and of `command=` only the xacro file is taken note of.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.parsers import expat

from navstack.core import NotRegularFileError, TooLargeError, is_file, read_bytes, shortened
from navstack.parameters.expressions import MATH, evaluate
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.packages import package_file, why_missing
from navstack.parameters.tree import Space, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import MAX_BYTES, DictNode, Node, ScalarNode, parse_value, read_yaml, relocate

# ----------------------------------------------------------------------------------------------------------------------
# Substitutions of launch files: `$(arg ..)`, `$(find ..)`, `$(env ..)`; nothing is executed.


MAX_EXPANDED = 1_000_000
"""Longest text with its substitutions (characters): arguments that repeat each other grow without end."""
_SUBSTITUTION = re.compile(r"\$\(\s*([a-z]+)((?:\s+[^()]*)?)\)")
_USED = re.compile(r"""\$\(\s*arg\s+([^\s()]+)\s*\)|\barg\(\s*["']([^"']+)["']\s*\)""")
_ARGUMENT = re.compile(r"([A-Za-z_][A-Za-z0-9_/]*):=(.*)\Z", re.DOTALL)


def launch_argument(text: str) -> tuple[str, str] | None:
    """Split an argument of roslaunch's command line: `model:=burger` -> ("model", "burger"); None for other texts."""
    found = _ARGUMENT.match(text)
    return (found[1], found[2]) if found else None


def is_expression(text: str) -> bool:
    """Return True for `$(eval ..)`: a Python expression, which may contain parentheses."""
    return re.match(r"\s*\$\(\s*eval\b", text) is not None


def substitute(text: str, arguments: Mapping[str, str], folder: Path) -> str:
    """Replace the substitutions of a text except `$(find ..)`; raise ValueError for one that cannot be replaced.

    `folder` is that of the launch file. A text that grows beyond a million characters is a ValueError as well.
    """
    if is_expression(text):
        return _evaluated(text, arguments, folder)

    length = len(text)

    def bounded(found: re.Match[str]) -> str:
        nonlocal length
        filled = value(found)
        length += len(filled) - len(found[0])
        if length > MAX_EXPANDED:
            raise ValueError(
                f"a text is longer than {MAX_EXPANDED:,} characters after its substitutions ({found[0]} is one of them); "
                "shorten the arguments that it uses"
            )
        return filled

    def value(found: re.Match[str]) -> str:
        command, rest = found[1], found[2].split()
        match command, rest:
            case "arg", [name]:
                if name in arguments:
                    return arguments[name]
                raise ValueError(f"the argument {name} has no value; add {name}:=VALUE after the launch file")
            case "find", [_]:
                return found[0]
            case "env", [name]:
                if name in os.environ:
                    return os.environ[name]
                raise ValueError(f"the environment variable {name} is not set; set it or write the value")
            case "optenv", [name, *default]:
                return os.environ.get(name, " ".join(default))
            case "anon", [name]:
                return name
            case "dirname", []:
                return str(folder)
            case _:
                raise ValueError(f"{found[0]} is not supported; write its value")

    return _SUBSTITUTION.sub(bounded, text)


def _evaluated(text: str, arguments: Mapping[str, str], folder: Path) -> str:
    """Evaluate `$(eval ..)` as roslaunch does; a package that it finds stays `$(find package)`. Raise ValueError."""
    written = text.strip()
    if not written.endswith(")"):
        raise ValueError(f"{shortened(written, 200)} must be the whole value: $(eval ..) cannot be followed by text")

    def filled(command: str, *values: Any) -> str:
        return substitute(f"$({command} {' '.join(str(value) for value in values)})", arguments, folder)

    def argument(name: str) -> Any:
        return param_value(filled("arg", name), "auto")

    def find(package: str) -> str:
        return f"$(find {package})"

    functions: dict[str, Any] = {"find": find, "arg": argument, "dirname": lambda: str(folder)}
    functions |= {name: partial(filled, name) for name in ("env", "optenv", "anon")}
    names = {**MATH, **{name: param_value(value, "auto") for name, value in arguments.items()}, **functions}
    try:
        return str(evaluate(written.partition("eval")[2][:-1], names))
    except ValueError as exc:
        fix = "" if ";" in str(exc) else "; write its value"
        raise ValueError(f"{shortened(written, 200)} cannot be evaluated: {exc}{fix}") from exc


def find_file(text: str, launch: Path) -> Path | None:
    """Return the file that a path of a launch file names; `$(find package)` is a package near the file."""
    found = _SUBSTITUTION.match(text)
    if found is None or found[1] != "find":
        path = Path(text)
        path = path if path.is_absolute() else launch.parent / path
        return path if is_file(path) else None
    return package_file(found[2].strip(), parts_of(text[found.end() :]), launch)


def _why_not_found(text: str, launch: Path) -> tuple[str, str]:
    """Say why `find_file` finds nothing, and what to do."""
    found = _SUBSTITUTION.match(text)
    if found is None or found[1] != "find":
        where = "" if Path(text).is_absolute() else " from the folder of the launch file"
        return f"no such file{where}", "add the file or correct its path"
    return why_missing(found[2].strip(), parts_of(text[found.end() :]), launch)


def param_value(text: str, kind: str) -> Any:
    """Convert the value of a `<param>` to its type as roslaunch does; raise ValueError."""
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


# ----------------------------------------------------------------------------------------------------------------------
# Parse a launch file to XML elements with locations, within limits on size and depth.


MAX_DEPTH = 50


@dataclass(slots=True)
class Element:
    """An XML element and its location."""

    tag: str
    attributes: dict[str, str]
    line: int
    column: int
    children: list[Element] = field(default_factory=list["Element"])
    text: str = ""
    text_line: int = 0


class RejectedLaunchFileError(Exception):
    """The file cannot be read: rule, location and message."""

    def __init__(self, rule: str, at: Location, message: str) -> None:
        super().__init__(message)
        self.rule, self.at, self.message = rule, at, message


class _RejectedXmlError(Exception):
    """The XML contains what launch files do not need."""


def read_launch_xml(path: Path, shown: str) -> Element:
    """Return the `<launch>` element of a file; raise RejectedLaunchFileError. `shown` is its name in messages."""
    try:
        data = read_bytes(path, MAX_BYTES)
    except TooLargeError as exc:
        message = f"{shown} {exc.strerror}, too large for a launch file"
        raise RejectedLaunchFileError("too-large", Location(shown), message) from exc
    except NotRegularFileError as exc:
        message = f"{shown} {exc.strerror}; name a launch file"
        raise RejectedLaunchFileError("cannot-read", Location(shown), message) from exc
    except (OSError, ValueError) as exc:
        message = f"{shown} cannot be read: {getattr(exc, 'strerror', None) or exc}"
        raise RejectedLaunchFileError("cannot-read", Location(shown), message) from exc
    top = parse_xml(data, shown)
    if top.tag != "launch":
        message = f"the root of the file is <{top.tag}>, not <launch>; name a launch file"
        raise RejectedLaunchFileError("xml", Location(shown, top.line, top.column), message)
    return top


def parse_xml(data: bytes, shown: str) -> Element:
    """Return the top element of an XML text; raise RejectedLaunchFileError."""
    root = Element("", {}, 1, 1)
    stack = [root]
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > MAX_DEPTH:
            raise _RejectedXmlError(f"it is nested more than {MAX_DEPTH} levels deep")
        made = Element(tag, attributes, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
        stack[-1].children.append(made)
        stack.append(made)

    def text(data: str) -> None:
        top = stack[-1]
        if not top.text:
            top.text_line = parser.CurrentLineNumber
        top.text += data

    def reject(*_: Any) -> None:
        raise _RejectedXmlError("it declares a document type or an entity, which launch files do not need")

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = reject
    try:
        parser.Parse(data, True)
    except expat.ExpatError as exc:
        at = Location(shown, exc.lineno, exc.offset + 1)
        raise RejectedLaunchFileError("xml", at, f"invalid XML: {expat.errors.messages[exc.code]}") from exc
    except _RejectedXmlError as exc:
        at = Location(shown, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
        raise RejectedLaunchFileError("xml", at, f"{shown} is rejected: {exc}") from exc
    except (ValueError, LookupError) as exc:
        raise RejectedLaunchFileError("xml", Location(shown), f"{shown} cannot be read as XML: {exc}") from exc
    return root.children[0]


MAX_INCLUDES = 50
MAX_GROWTH = 10_000_000
"""Characters that the substitutions of a launch file and its includes may add."""


class _SkipElement(Exception):
    """An element cannot be read; a finding gives the reason."""


@dataclass(slots=True)
class _Scope:
    """The environment of an element: its file, namespace and arguments."""

    path: Path
    shown: str
    namespace: tuple[str, ...] = ()
    arguments: dict[str, str] = field(default_factory=dict[str, str])
    passed: Mapping[str, str] = field(default_factory=dict[str, str])
    """Arguments passed to the file."""
    private: tuple[str, ...] | None = None
    """The node of private names; None outside of a node."""
    broken: dict[str, Finding] = field(default_factory=dict[str, Finding])
    """Arguments whose default cannot be filled in: what is wrong with it."""


class LaunchReader:
    """Reads a launch file with its includes and returns the parameters below its move_base node."""

    def __init__(self, findings: list[Finding], files: list[str]) -> None:
        self.findings = findings
        self.files = files
        self._server = Space("", Location(""))
        self._nodes: list[tuple[tuple[str, ...], Location]] = []
        self._includes = 0
        self._growth = 0
        self._remaps: list[tuple[str, str, Location]] = []
        self._skipped: list[str] = []
        """Includes that were not found."""
        self._broken: list[Finding] = []
        """Defaults of arguments that cannot be filled in, as long as nothing of move_base needs them."""
        self._has_gaps = False
        """True if a group, an include or a node is skipped because of an error."""
        self.descriptions: list[tuple[Path, dict[str, str]]] = []
        """URDF and xacro files that the launch files name, each with its arguments."""

    def read(self, path: Path, shown: str, arguments: Mapping[str, str]) -> Space | None:
        """Return the namespace of the move_base node; None if there is no such node or the file cannot be read."""
        root = self._parse(path, shown)
        if root is None:
            return None
        scope = _Scope(path, shown, passed=arguments)
        self._children(root, scope)
        self._report(shown, [name for name in arguments if name not in scope.arguments], arguments)
        for found in self._broken:
            message = f"{found.message}. roslaunch needs it, the parameters of move_base do not"
            self.findings.append(replace(found, severity="warning", message=message))
        if not self._nodes:
            return None
        space: Space | None = self._server
        for name in self._nodes[0][0]:
            space = space.space(name) if space is not None else None
        return space or Space("", Location(shown))

    def _report(self, shown: str, unused: list[str], arguments: Mapping[str, str]) -> None:
        at = Location(shown)
        for name in sorted(unused):
            message = (
                f"{name}:={_short(arguments[name])} has no effect: the launch file has no argument {name}; remove it"
            )
            self.add_finding("warning", "launch", at, message)
        if not self._nodes and self._has_gaps:
            return  # the node may be in what was skipped, which has an error
        if not self._nodes:
            message = "the launch file starts no move_base node; "
            if self._skipped:
                missing = ", ".join(self._skipped[:3])
                message += f"what it includes was not found and may start it: {missing}; put that in place, or "
            message += "name the launch file that starts it"
            self.add_finding("error", "launch", at, message)
            return
        if len(self._nodes) > 1:
            names = ", ".join("/".join(n) for n, _ in self._nodes)
            message = f"the launch file starts several move_base nodes ({names}); the first one is loaded"
            self.add_finding("warning", "launch", self._nodes[1][1], message)
        for source, target, there in self._remaps:
            message = (
                f"the remapping of the topic {source} to {target} is ignored; topics are used as written in the YAML"
            )
            self.add_finding("info", "remap", there, message)

    def add_finding(self, severity: Severity, rule: str, at: Location, message: str) -> None:
        """Add a finding about the launch file."""
        self.findings.append(finding(severity, rule, at, "", message))

    def _parse(self, path: Path, shown: str) -> Element | None:
        try:
            root = read_launch_xml(path, shown)
        except RejectedLaunchFileError as exc:
            self.add_finding("error", exc.rule, exc.at, exc.message)
            root = None
            if exc.rule == "cannot-read":
                return None
        self.files.append(shown)
        return root

    # --- elements -----------------------------------------------------------------------------------------------------

    def _children(self, element: Element, scope: _Scope) -> None:
        for child in element.children:
            try:
                if self._is_active(child, scope):
                    self._element(child, scope)
            except _SkipElement:
                self._has_gaps |= child.tag in ("group", "include", "node")

    def _element(self, element: Element, scope: _Scope) -> None:
        match element.tag:
            case "arg":
                self._arg(element, scope)
            case "group":
                namespace = self._namespace(element, scope)
                arguments = dict(scope.arguments)
                self._children(
                    element, replace(scope, namespace=namespace, arguments=arguments, broken=dict(scope.broken))
                )
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
                    self._remaps.append((source, target, self._at(element, scope)))
            case _:
                pass

    def _at(self, element: Element, scope: _Scope) -> Location:
        return Location(scope.shown, element.line, element.column)

    def _is_active(self, element: Element, scope: _Scope) -> bool:
        """Evaluate `if` and `unless`."""
        for name, wanted in (("if", True), ("unless", False)):
            if name not in element.attributes:
                continue
            value = self._get(element, name, scope).strip().lower()
            if value not in ("true", "false", "1", "0"):
                message = (
                    f'{name}="{_short(value)}" of <{element.tag}> is neither true nor false, so the element is skipped; '
                    "write true or false"
                )
                self.add_finding("error", "launch", self._at(element, scope), message)
                return False
            if (value in ("true", "1")) is not wanted:
                return False
        return True

    def _get(self, element: Element, name: str, scope: _Scope, default: str | None = None) -> str:
        """An attribute after substitution."""
        value = element.attributes.get(name, default)
        if value is None:
            message = f"<{element.tag}> lacks the attribute {name}; add it"
            self.add_finding("error", "launch", self._at(element, scope), message)
            raise _SkipElement
        return self._substitute(value, element, scope)

    def _substitute(self, text: str, element: Element, scope: _Scope) -> str:
        try:
            filled = substitute(text, scope.arguments, scope.path.parent.absolute())
            self._growth += max(0, len(filled) - len(text))
            if self._growth > MAX_GROWTH:
                raise ValueError(
                    f"the substitutions of the launch file add more than {MAX_GROWTH:,} characters; shorten its arguments"
                )
            return filled
        except ValueError as exc:
            cause = next((scope.broken[name] for name in _arguments_in(text) if name in scope.broken), None)
            if cause is None:
                message = f"{_value_of(element)}: {exc}" if is_expression(text) else str(exc)
                self.add_finding("error", "launch", self._at(element, scope), message)
            elif cause in self._broken:
                self._broken.remove(cause)
                self.findings.append(cause)
            raise _SkipElement from exc

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
            self._default(name, element, scope)

    def _default(self, name: str, element: Element, scope: _Scope) -> None:
        """Set an argument to its default. One that cannot be filled in is an error where it is used."""
        before = len(self.findings)
        needed = next(
            (scope.broken[n] for n in _arguments_in(element.attributes["default"]) if n in scope.broken), None
        )
        if needed is not None:
            scope.broken[name] = needed
            return
        try:
            scope.arguments[name] = self._get(element, "default", scope)
            scope.broken.pop(name, None)
        except _SkipElement:
            [found] = self.findings[before:]
            del self.findings[before:]
            scope.broken[name] = found
            self._broken.append(found)

    def _include(self, element: Element, scope: _Scope) -> None:
        before = len(self.findings)
        try:
            text = self._get(element, "file", scope)
        except _SkipElement:
            del self.findings[before:]
            text = ""
        path = find_file(text, scope.path) if text else None
        if path is None:
            name = text or element.attributes.get("file", "")
            why, _ = _why_not_found(name, scope.path)
            message = f"{_short(name)} was not found ({why}), so its include is skipped"
            self._skipped.append(f"{_short(name)} ({why})")
            self.add_finding("info", "launch", self._at(element, scope), message)
            return
        self._includes += 1
        if self._includes > MAX_INCLUDES:
            message = f"more than {MAX_INCLUDES} files are included, so the files probably include each other; remove the cycle"
            self.add_finding("error", "launch", self._at(element, scope), message)
            return
        passed = self._passed(element, scope)
        shown = _shown_name(scope, path)
        root = self._parse(path, shown)
        if root is not None:
            self._children(root, _Scope(path, shown, self._namespace(element, scope), passed=passed))

    def _passed(self, element: Element, scope: _Scope) -> dict[str, str]:
        """The arguments that an include passes on."""
        passed = dict(scope.arguments) if element.attributes.get("pass_all_args") == "true" else {}
        inner = replace(scope, arguments=dict(scope.arguments), passed={}, private=None, broken=dict(scope.broken))
        for child in element.children:
            if child.tag == "arg" and self._is_active(child, scope):
                self._arg(child, inner)
                name = child.attributes.get("name", "")
                if name in inner.arguments:
                    passed[name] = inner.arguments[name]
        return passed

    def _node(self, element: Element, scope: _Scope) -> None:
        kind = element.attributes.get("type", "")
        is_move_base = "move_base" in (kind, element.attributes.get("pkg", "")) and kind.startswith("move_base")
        if not is_move_base:
            return
        name = self._get(element, "name", scope)
        private = (*self._namespace(element, scope), *parts_of(name))
        self._nodes.append((private, self._at(element, scope)))
        inner = replace(scope, namespace=private, arguments=dict(scope.arguments), private=private)
        self._children(element, replace(inner, broken=dict(scope.broken)))

    # --- parameters ---------------------------------------------------------------------------------------------------

    def _target(self, element: Element, scope: _Scope, name: str) -> tuple[tuple[str, ...], str]:
        """The namespace and the last name of a parameter."""
        names = parts_of(name.removeprefix("~"))
        if not names:
            message = f'name = "{_short(name)}" is not a parameter name; correct it'
            self.add_finding("error", "launch", self._at(element, scope), message)
            raise _SkipElement
        if name.startswith("/"):
            return tuple(names[:-1]), names[-1]
        return (*self._namespace(element, scope), *names[:-1]), names[-1]

    def _space(self, names: tuple[str, ...], at: Location) -> Space:
        space = self._server
        for name in names:
            space = descend(space, name, at, self.findings)
        return space

    def _param(self, element: Element, scope: _Scope) -> None:
        at = self._at(element, scope)
        name = self._get(element, "name", scope)
        for source in ("textfile", "binfile", "command"):
            if source in element.attributes:
                before = len(self.findings)
                try:
                    text = self._get(element, source, scope)
                except _SkipElement:
                    # not a parameter of move_base, so what is wrong with it is no error
                    self.findings[before:] = [replace(f, severity="info") for f in self.findings[before:]]
                    self.add_finding(
                        "info", "launch", at, f"{_short(name)} is not made: its {source} cannot be filled in"
                    )
                    return
                self._generated(name, source, text, at, scope)
                return
        text = self._get(element, "value", scope)
        kind = element.attributes.get("type", "auto")
        try:
            value = param_value(text, kind)
        except ValueError:
            message = f'{_short(name)} = "{_short(text)}" does not have its type {kind}; correct the value or the type'
            self.add_finding("error", "launch", at, message)
            return
        namespace, last = self._target(element, scope, name)
        node: Node = ScalarNode(value, at, isinstance(value, str), text)
        if kind == "yaml":
            made, findings = parse_value(text, scope.shown)
            self.findings += findings
            if made is None:
                return
            relocate(made, at)
            node = made
        put(self._space(namespace, at), last, at, node, self.findings)

    def _generated(self, name: str, source: str, text: str, at: Location, scope: _Scope) -> None:
        """Report a parameter that a file or a program would make; keep the robot's description that it names."""
        try:
            words = shlex.split(text) if source == "command" else [text]
        except ValueError:
            words = text.split()
        named = next((word for word in words if word.endswith((".xacro", ".urdf"))), None)
        if named is None:
            message = f"{name} is ignored: {source}={_short(text)} is not supported; write its value"
            self.add_finding("info", "launch", at, message)
            return
        path = find_file(named, scope.path)
        if path is None:
            why, _ = _why_not_found(named, scope.path)
            self.add_finding("info", "launch", at, f"{name} is not made, because {_short(named)} was not found: {why}")
            return
        given = dict(found for word in words if (found := launch_argument(word)) is not None)
        self.descriptions.append((path, given))
        how = "the command line is not executed" if source == "command" else "the file is not loaded"
        message = f"{name} is not made ({how}); the simulated sensors are taken from {_shown_name(scope, path)}"
        self.add_finding("info", "launch", at, message)

    def _rosparam(self, element: Element, scope: _Scope) -> None:
        at = self._at(element, scope)
        if self._get(element, "command", scope, "load") != "load":
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
            message = "<rosparam> contains one value instead of `name: value` lines; name its parameter with param="
            self.add_finding("error", "launch", root.at, message)

    def _rosparam_content(self, element: Element, scope: _Scope) -> Node | None:
        fill = element.attributes.get("subst_value", "false").lower() in ("true", "1")
        if "file" in element.attributes:
            return self._rosparam_file(element, scope, fill)
        text = self._substitute(element.text, element, scope) if fill else element.text
        # keeps the line numbers of the launch file
        return self._yaml("\n" * (element.text_line - 1) + text, scope.shown)

    def _rosparam_file(self, element: Element, scope: _Scope, fill: bool) -> Node | None:
        text = self._get(element, "file", scope)
        path = find_file(text, scope.path)
        if path is None:
            why, fix = _why_not_found(text, scope.path)
            message = f"{_short(text)} was not found: {why}; {fix}"
            self.add_finding("error", "launch", self._at(element, scope), message)
            return None
        shown = _shown_name(scope, path)
        if not fill:
            read = read_yaml(path, shown)
            self.findings += read.findings
            self.files.append(shown)
            return read.root
        try:
            content = read_bytes(path, MAX_BYTES).decode("utf-8-sig", "replace")
        except OSError as exc:
            message = f"{shown} cannot be read: {exc.strerror or exc}"
            self.add_finding("error", "cannot-read", Location(shown), message)
            return None
        self.files.append(shown)
        return self._yaml(self._substitute(content, element, scope), shown)

    def _yaml(self, text: str, shown: str) -> Node | None:
        node, findings = parse_value(text, shown)
        self.findings += findings
        return node


def _arguments_in(text: str) -> list[str]:
    """Return the names of the arguments that a text uses."""
    return [first or second for first, second in _USED.findall(text)]


def _short(text: str) -> str:
    """A value in a message."""
    return shortened(text, 200)


def _value_of(element: Element) -> str:
    """What a value of an element is, for a message."""
    if element.tag == "arg" and "default" in element.attributes:
        return f"the default of the argument {element.attributes.get('name', '')}"
    return "the file of <rosparam>" if element.tag == "rosparam" else f"a value of <{element.tag}>"


def _shown_name(scope: _Scope, path: Path) -> str:
    """The name of a file in messages, relative if the launch file's is."""
    shown = Path(scope.shown)
    if shown.is_absolute():
        return str(path)
    try:
        return os.path.relpath(path)
    except ValueError:
        return str(path)
