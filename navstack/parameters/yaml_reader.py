"""YAML as rosparam reads it, with file, line and column of every key and value.

Built on PyYAML's parser events, not on its constructors: nothing in a file can make an object, the reader does not
recurse, and files that would blow up are refused. libyaml's parser is used where it is there.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from yaml.constructor import SafeConstructor
from yaml.reader import ReaderError

from navstack.core.files import exists
from navstack.parameters.findings import Finding, Location, finding

MAX_BYTES = 1_000_000
MAX_DEPTH = 50
MAX_VALUES = 20_000
MAX_ALIASED = 10_000
MAX_NUMBER_CHARS = 100
"""A longer plain scalar is text, whatever it looks like: reading it as a number takes quadratic time."""
MAX_TABBED_BYTES = 64_000
"""Files with tabs up to this size go through the Python parser, whose verdict on tabs is the one ROS users get."""


@dataclass(slots=True)
class ScalarNode:
    """A value: text, number, truth value or None."""

    value: Any
    at: Location
    quoted: bool = False
    text: str = ""
    """As written."""
    size: int = 1


@dataclass(slots=True)
class ListNode:
    """A sequence."""

    items: list[Node]
    at: Location
    size: int = 1


@dataclass(slots=True)
class DictNode:
    """A mapping: key -> (where the key stands, value)."""

    items: dict[str, tuple[Location, Node]]
    at: Location
    size: int = 1


Node = ScalarNode | ListNode | DictNode


def plain(node: Node) -> Any:
    """The node as Python values."""
    if isinstance(node, ScalarNode):
        return node.value
    if isinstance(node, ListNode):
        return [plain(n) for n in node.items]
    return {k: plain(n) for k, (_, n) in node.items.items()}


def relocate(node: Node, at: Location) -> None:
    """Everything in an argument or attribute stands where that stands."""
    node.at = at
    if isinstance(node, ListNode):
        for item in node.items:
            relocate(item, at)
    elif isinstance(node, DictNode):
        for key, (_, item) in node.items.items():
            node.items[key] = (at, item)
            relocate(item, at)


class _Refused(Exception):
    """The file cannot be read: where and why."""

    def __init__(self, rule: str, line: int, column: int, message: str) -> None:
        super().__init__(message)
        self.rule, self.line, self.column, self.message = rule, line, column, message


# --- scalars ----------------------------------------------------------------------------------------------------------

_INT, _FLOAT, _BOOL = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float", "tag:yaml.org,2002:bool"
_NULL, _STR, _MERGE = "tag:yaml.org,2002:null", "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"
_TEXTS = frozenset({_STR, "tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:value", "!"})
_MAP, _SEQ = "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"

# YAML 1.1 wants a dot in a float; rosparam also reads 1e-3 as the number everybody means
_EXPONENT = re.compile(r"[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+\Z")
_DEG = re.compile(r"deg\([^)]*\)\Z")
_RAD = re.compile(r"rad\([^)]*\)\Z")

_RESOLVERS: dict[str | None, list[tuple[str, re.Pattern[str]]]] = yaml.SafeLoader.yaml_implicit_resolvers  # type: ignore[assignment]
_MAKER: Any = SafeConstructor()
_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}


def _arithmetic(text: str) -> float:
    """`pi/2`, `-2*pi`: what rosparam evaluates in `rad(..)`, and no more. Raises ValueError."""
    if len(text) > MAX_NUMBER_CHARS:
        raise ValueError(text)

    def value(node: ast.AST) -> float:
        match node:
            case ast.Expression(body):
                return value(body)
            case ast.Constant(v) if isinstance(v, (int, float)) and not isinstance(v, bool):
                return float(v)
            case ast.Name("pi"):
                return math.pi
            case ast.Attribute(ast.Name("math"), "pi"):
                return math.pi
            case ast.BinOp(left, op, right) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(left), value(right))
            case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(operand))
            case _:
                raise ValueError(text)

    try:
        return value(ast.parse(text.strip(), mode="eval"))
    except (SyntaxError, ZeroDivisionError, OverflowError, RecursionError, MemoryError) as exc:
        raise ValueError(text) from exc


def _degrees(text: str) -> float:
    text = text.strip()
    return math.radians(float(text[4:-1] if _DEG.match(text) else text))


def _radians(text: str) -> float:
    text = text.strip()
    return _arithmetic(text[4:-1] if _RAD.match(text) else text)


def _resolve(text: str) -> str:
    """Tag of a plain scalar."""
    if not text:
        return _NULL
    if len(text) > MAX_NUMBER_CHARS:
        return _STR
    for tag, pattern in _RESOLVERS.get(text[0], ()):
        if pattern.match(text):
            return tag
    first = text[0]
    if first in "+-.0123456789" and _EXPONENT.match(text):
        return "exponent"
    if first == "d" and _DEG.match(text):
        return "!degrees"
    if first == "r" and _RAD.match(text):
        return "!radians"
    return _STR


def _make(tag: str, text: str) -> Any:
    """The value of a scalar; raises ValueError when the text is not what the tag says."""
    if tag in _TEXTS:
        return text
    if tag in (_INT, _FLOAT):
        if len(text) > MAX_NUMBER_CHARS:
            raise ValueError(text)
        node = yaml.ScalarNode(tag, text)
        return _MAKER.construct_yaml_int(node) if tag == _INT else _MAKER.construct_yaml_float(node)
    if tag == "exponent":
        return float(text.replace("_", ""))
    if tag == _BOOL:
        try:
            return SafeConstructor.bool_values[text.lower()]
        except KeyError as exc:
            raise ValueError(text) from exc
    if tag == _NULL:
        return None
    if tag == "!degrees":
        return _degrees(text)
    if tag == "!radians":
        return _radians(text)
    raise LookupError(tag)


def scalar(text: str) -> Any:
    """The value of a plain scalar, as YAML would have it; text that is no number after all stays text."""
    try:
        return _make(_resolve(text), text)
    except (ValueError, LookupError):
        return text


# --- structure --------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Open:
    """A container that is being read."""

    node: ListNode | DictNode
    anchor: str | None
    key: tuple[str, Location] | None = None
    merged: list[DictNode] = field(default_factory=list[DictNode])
    """Mappings brought in by `<<`."""


class _Builder:
    """Parser events -> nodes."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.findings: list[Finding] = []
        self.stack: list[_Open] = []
        self.anchors: dict[str, Node | None] = {}
        self.root: Node | None = None
        self.values = 0
        self.aliased = 0
        self.documents = 0

    def place(self, mark: Any) -> Location:
        return Location(self.file, mark.line + 1, mark.column + 1)

    def refuse(self, rule: str, mark: Any, message: str) -> _Refused:
        return _Refused(rule, mark.line + 1, mark.column + 1, message)

    def feed(self, event: Any) -> None:
        kind = type(event)
        if kind is yaml.ScalarEvent:
            self.scalar(event)
        elif kind is yaml.MappingStartEvent or kind is yaml.SequenceStartEvent:
            self.open(event, kind is yaml.MappingStartEvent)
        elif kind is yaml.MappingEndEvent or kind is yaml.SequenceEndEvent:
            self.close()
        elif kind is yaml.AliasEvent:
            self.alias(event)
        elif kind is yaml.DocumentStartEvent:
            self.documents += 1
            if self.documents > 1:
                raise self.refuse(
                    "not-one-document",
                    event.start_mark,
                    "a second document begins here (`---`); ROS reads files of one document only: split the file",
                )

    def count(self, mark: Any) -> None:
        self.values += 1
        if self.values > MAX_VALUES:
            raise self.refuse(
                "too-large",
                mark,
                f"more than {MAX_VALUES} values: this is no parameter file; name the YAML files of the robot",
            )

    def wants_key(self) -> bool:
        return bool(self.stack) and isinstance(self.stack[-1].node, DictNode) and self.stack[-1].key is None

    def scalar(self, event: Any) -> None:
        text: str = event.value
        mark = event.start_mark
        self.count(mark)
        quoted = event.style in ("'", '"', "|", ">")
        if event.tag is None or (event.tag == "!" and event.implicit[0]):
            tag = _STR if quoted else _resolve(text)
        else:
            tag = event.tag
        if self.wants_key():
            self.key(text, tag, mark)
            return
        try:
            value = _make(tag, text)
        except ValueError:
            raise self.refuse("not-a-value", mark, self.not_a_value(tag, text)) from None
        except LookupError:
            raise self.refuse("unknown-tag", mark, self.unknown_tag(tag)) from None
        self.add(ScalarNode(value, self.place(mark), quoted, text), event.anchor)

    @staticmethod
    def not_a_value(tag: str, text: str) -> str:
        shown = text if len(text) <= 40 else text[:37] + "..."
        if tag == "!degrees":
            return f'"{shown}" is no angle in degrees; write for example deg(90) or !degrees 90'
        if tag == "!radians":
            return f'"{shown}" is no angle in radians; write for example rad(pi/2) or !radians 1.57'
        return f'"{shown}" is not of the type that its tag says; take the tag away or write the value plainly'

    @staticmethod
    def unknown_tag(tag: str) -> str:
        shown = tag.replace("tag:yaml.org,2002:", "!!")
        return f"the tag {shown} is not read here (only !degrees, !radians and YAML's plain types are); take it away"

    def key(self, text: str, tag: str, mark: Any) -> None:
        if tag == _MERGE:
            self.stack[-1].key = ("<<", self.place(mark))
            return
        if tag not in (_STR, "!"):
            kind = {_INT: "a number", _FLOAT: "a number", "exponent": "a number", _BOOL: "a truth value"}.get(tag)
            kind = kind or ("nothing" if tag == _NULL else "no text")
            shown = text if len(text) <= 40 else text[:37] + "..."
            raise self.refuse(
                "key-not-text",
                mark,
                f'the key "{shown}" is {kind} to YAML, and a parameter\'s name must be text; rename it or put it in quotes',
            )
        self.stack[-1].key = (text, self.place(mark))

    def open(self, event: Any, mapping: bool) -> None:
        mark = event.start_mark
        self.count(mark)
        if len(self.stack) >= MAX_DEPTH:
            raise self.refuse("too-deep", mark, f"more than {MAX_DEPTH} levels deep: this is no parameter file")
        if self.wants_key():
            raise self.refuse("key-not-text", mark, "a list or mapping stands where a parameter's name must stand")
        if event.tag not in (None, "!", _MAP if mapping else _SEQ):
            raise self.refuse("unknown-tag", mark, self.unknown_tag(event.tag))
        at = self.place(mark)
        node = DictNode({}, at) if mapping else ListNode([], at)
        if event.anchor:
            self.anchors[event.anchor] = None
        self.stack.append(_Open(node, event.anchor))

    def close(self) -> None:
        done = self.stack.pop()
        node = done.node
        if isinstance(node, DictNode):
            # explicit keys win over merged ones, earlier merged mappings over later ones (YAML's merge key)
            for brought in done.merged:
                for k, v in brought.items.items():
                    node.items.setdefault(k, v)
            node.size = 1 + sum(n.size for _, n in node.items.values())
        else:
            node.size = 1 + sum(n.size for n in node.items)
        self.add(node, done.anchor)

    def alias(self, event: Any) -> None:
        mark = event.start_mark
        if self.wants_key():
            raise self.refuse("key-not-text", mark, "an alias stands where a parameter's name must stand")
        if event.anchor not in self.anchors:
            raise self.refuse("yaml", mark, f"the alias *{event.anchor} has no anchor &{event.anchor} above it")
        node = self.anchors[event.anchor]
        if node is None:
            raise self.refuse("yaml", mark, f"the alias *{event.anchor} stands inside what it means: it has no end")
        self.aliased += node.size
        if self.aliased > MAX_ALIASED:
            raise self.refuse(
                "alias-bomb",
                mark,
                f"aliases stand for more than {MAX_ALIASED} values: this is no parameter file; write the values out",
            )
        self.add(node, None)

    def add(self, node: Node, anchor: str | None) -> None:
        if anchor:
            self.anchors[anchor] = node
        if not self.stack:
            self.root = node
            return
        top = self.stack[-1]
        if isinstance(top.node, ListNode):
            top.node.items.append(node)
            return
        assert top.key is not None
        (name, at), top.key = top.key, None
        if name == "<<":
            self.merge(top, node, at)
            return
        before = top.node.items.pop(name, None)
        if before is not None:
            self.duplicate(name, at, before, node)
        top.node.items[name] = (at, node)

    def merge(self, top: _Open, node: Node, at: Location) -> None:
        sources = node.items if isinstance(node, ListNode) else [node]
        for source in sources:
            if not isinstance(source, DictNode):
                raise _Refused("yaml", at.line, at.column, "`<<` takes a mapping or a list of mappings")
            top.merged.append(source)

    def duplicate(self, name: str, at: Location, before: tuple[Location, Node], node: Node) -> None:
        first_at, first = before
        if plain(first) == plain(node):
            severity, end = "info", "with the same value; remove one"
        elif isinstance(first, DictNode) and isinstance(node, DictNode):
            severity, end = "warning", "only the last counts and all that stands under the first is lost; make them one"
        else:
            severity, end = "warning", "only the last counts; remove one"
        message = f"{name} is given twice (first on line {first_at.line}), {end}"
        path = "/".join([*(o.key[0] for o in self.stack if o.key is not None), name])
        self.findings.append(finding(severity, "duplicated", at, path, message))


@dataclass(frozen=True, slots=True)
class YamlFile:
    """A file as read; without content where it could not be."""

    root: DictNode
    findings: list[Finding]


def read_yaml(path: Path, shown: str | None = None) -> YamlFile:
    """Reads a parameter file; everything wrong with it becomes findings. `shown` is its name in messages."""
    name = shown or str(path)
    # a pipe or a device would never end
    if exists(path) and not path.is_file():
        return _unread(name, "cannot-read", "is no file; name a YAML file")
    try:
        # one byte more than allowed tells a file that is too large without reading it all
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as exc:
        return _unread(name, "cannot-read", f"cannot be read: {exc.strerror or exc}")
    if len(data) > MAX_BYTES:
        return _unread(name, "too-large", f"is larger than {MAX_BYTES // 1_000_000} MB: this is no parameter file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        line = data.count(b"\n", 0, exc.start) + 1
        column = exc.start - data.rfind(b"\n", 0, exc.start)
        at = Location(name, line, column)
        message = f"the byte 0x{data[exc.start]:02x} is not UTF-8 text; save the file as UTF-8"
        return YamlFile(DictNode({}, Location(name)), [finding("error", "not-utf8", at, "", message)])
    return parse_yaml(text, name)


def _unread(name: str, rule: str, message: str) -> YamlFile:
    at = Location(name)
    return YamlFile(DictNode({}, at), [finding("error", rule, at, "", f"{name} {message}")])


def parse_yaml(text: str, name: str) -> YamlFile:
    """Reads YAML text whose root is a mapping, or nothing."""
    root, findings = parse_value(text, name)
    at = Location(name, 1, 1)
    if isinstance(root, DictNode):
        return YamlFile(root, findings)
    if root is not None and not (isinstance(root, ScalarNode) and root.value is None):
        kind = "a list" if isinstance(root, ListNode) else f'only the {_kind(root)} "{_short(root.text)}"'
        message = f"the file holds {kind}, not `name: value` lines, so there is nothing to load"
        if isinstance(root, ScalarNode) and root.text.endswith((".yaml", ".yml")):
            message += "; it may have been a symbolic link: name the file it means"
        findings.append(finding("error", "not-a-mapping", root.at, "", message))
    return YamlFile(DictNode({}, at), findings)


def _kind(node: ScalarNode) -> str:
    return "text" if isinstance(node.value, str) else "value"


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def parse_value(text: str, name: str) -> tuple[Node | None, list[Finding]]:
    """Any YAML value; None for an empty document and where the text is not YAML, which is then among the findings."""
    builder = _Builder(name)
    tabs = "\t" in text and len(text) <= MAX_TABBED_BYTES
    loader: Any = yaml.SafeLoader if tabs else getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        # the parsers end a document at NUL without a word
        if "\0" in text:
            raise ReaderError(name, text.index("\0"), 0, "unicode", "special characters are not allowed")
        for event in yaml.parse(text, Loader=loader):
            builder.feed(event)
    except _Refused as exc:
        at = Location(name, exc.line, exc.column)
        return None, [*builder.findings, finding("error", exc.rule, at, "", exc.message)]
    except yaml.MarkedYAMLError as exc:
        return None, [*builder.findings, _syntax(exc, text, name)]
    except ReaderError as exc:
        position = exc.position
        before = text[:position]
        at = Location(name, before.count("\n") + 1, position - before.rfind("\n"))
        message = "a control character stands here, which YAML does not allow; remove it"
        return None, [*builder.findings, finding("error", "yaml", at, "", message)]
    return builder.root, builder.findings


def _syntax(exc: yaml.MarkedYAMLError, text: str, name: str) -> Finding:
    mark: Any = exc.problem_mark or exc.context_mark
    at = Location(name, mark.line + 1, mark.column + 1) if mark else Location(name)
    lines = text.splitlines()
    line = lines[at.line - 1] if 0 < at.line <= len(lines) else ""
    if "\t" in (exc.problem or "") or "\\t" in (exc.problem or "") or line[at.column - 1 : at.column] == "\t":
        message = "a tab stands here, which YAML does not allow; replace the tabs of this line by spaces"
        return finding("error", "tab", at, "", message)
    indent = line[: len(line) - len(line.lstrip())]
    if "\t" in indent:
        at = Location(name, at.line, indent.index("\t") + 1)
        message = "the line is indented with a tab, which YAML does not allow; indent with spaces"
        return finding("error", "tab", at, "", message)
    problem = " ".join(str(part) for part in (exc.context, exc.problem) if part)
    message = f"this is not YAML: {problem}; look at this line and the one above (indentation, colons, brackets)"
    return finding("error", "yaml", at, "", message)
