"""The parameters that a roslaunch file sets for its move_base node.

Supported: launch, group, arg, include, node, param, rosparam, remap, `if` and `unless`, and the substitutions arg, find, env,
optenv, anon and dirname. `$(find package)` is searched next to the file: in the folders above it, by the name of the package
and by the rest of the path. Nothing is executed: `$(eval ..)` and `command=` are rejected.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from navstack.core.bounded_reading import read_bytes, shortened
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.launch_substitution import find_file, is_expression, launch_argument, param_value, substitute
from navstack.parameters.launch_xml import Element, RejectedLaunchFileError, read_launch_xml
from navstack.parameters.tree import Space, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import MAX_BYTES, DictNode, Node, ScalarNode, parse_value, read_yaml, relocate

MAX_INCLUDES = 50
MAX_GROWTH = 10_000_000
"""Characters that the substitutions of a launch file and its includes may add."""

__all__ = ["LaunchReader", "launch_argument"]


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

    def read(self, path: Path, shown: str, arguments: Mapping[str, str]) -> Space | None:
        """Return the namespace of the move_base node; None if there is no such node or the file cannot be read."""
        root = self._parse(path, shown)
        if root is None:
            return None
        scope = _Scope(path, shown, passed=arguments)
        self._children(root, scope)
        self._report(shown, [name for name in arguments if name not in scope.arguments], arguments)
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
        if not self._nodes:
            message = "the launch file starts no move_base node; name the launch file that starts it"
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
                continue

    def _element(self, element: Element, scope: _Scope) -> None:
        match element.tag:
            case "arg":
                self._arg(element, scope)
            case "group":
                namespace = self._namespace(element, scope)
                arguments = dict(scope.arguments)
                self._children(
                    element, _Scope(scope.path, scope.shown, namespace, arguments, scope.passed, scope.private)
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
            message = _expression_message(text, element) if is_expression(text) else str(exc)
            self.add_finding("error", "launch", self._at(element, scope), message)
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
            scope.arguments[name] = self._get(element, "default", scope)

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
            message = f"{_short(name)} was not found, so its include is skipped"
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
        inner = _Scope(scope.path, scope.shown, scope.namespace, dict(scope.arguments))
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
        self._children(element, _Scope(scope.path, scope.shown, private, dict(scope.arguments), scope.passed, private))

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
                self.add_finding("info", "launch", at, f"{name} is ignored because {source}= is not supported")
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
            message = (
                f"{_short(text)} was not found; place it next to the launch file, in a folder named like its package"
            )
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


def _short(text: str) -> str:
    """A value in a message."""
    return shortened(text, 200)


def _expression_message(text: str, element: Element) -> str:
    """What to do about a Python expression in an attribute of an element."""
    name = element.attributes.get("name", "")
    if element.tag == "arg" and "default" in element.attributes:
        what, fix = f"the default of the argument {name}", f"add {name}:=VALUE after the launch file"
    elif element.tag == "rosparam":
        what = "the file of <rosparam>"
        fix = "write its path, or name the file after the launch file as FILE@NAMESPACE"
    else:
        what, fix = f"a value of <{element.tag}>", "write its value"
    return f"{what} is a Python expression, {_short(text.strip())}, which is not evaluated; {fix}"


def _shown_name(scope: _Scope, path: Path) -> str:
    """The name of a file in messages, relative if the launch file's is."""
    shown = Path(scope.shown)
    if shown.is_absolute():
        return str(path)
    try:
        return os.path.relpath(path)
    except ValueError:
        return str(path)
