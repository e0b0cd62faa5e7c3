"""Read YAML as rosparam does, with file, line and column of every key and value.

Built on the parser events of PyYAML instead of its constructors: a file cannot create objects, the reader does not recurse,
and files that expand beyond the limits are rejected. Uses libyaml's parser where available.
"""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from yaml.constructor import SafeConstructor
from yaml.reader import ReaderError

from navstack.core import NotRegularFileError, TooLargeError, read_bytes, resolved
from navstack.parameters.expressions import evaluate
from navstack.parameters.findings import Finding, Location, finding

# ----------------------------------------------------------------------------------------------------------------------
# YAML values with their locations.


@dataclass(slots=True)
class ScalarNode:
    """A scalar: text, number, boolean or None."""

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
    """Number of values in it, itself included."""


@dataclass(slots=True)
class DictNode:
    """A mapping: key -> (location of the key, value)."""

    items: dict[str, tuple[Location, Node]]
    at: Location
    size: int = 1
    """Number of values in it, itself included."""


Node = ScalarNode | ListNode | DictNode


def plain(node: Node) -> Any:
    """Return the node as Python values."""
    if isinstance(node, ScalarNode):
        return node.value
    if isinstance(node, ListNode):
        return [plain(n) for n in node.items]
    return {k: plain(n) for k, (_, n) in node.items.items()}


def relocate(node: Node, at: Location) -> None:
    """Set the location of a node and of everything in it: an argument or attribute has one location."""
    node.at = at
    if isinstance(node, ListNode):
        for item in node.items:
            relocate(item, at)
    elif isinstance(node, DictNode):
        for key, (_, item) in node.items.items():
            node.items[key] = (at, item)
            relocate(item, at)


def shortened(text: str) -> str:
    """Return a text for a message, cut to 40 characters."""
    return text if len(text) <= 40 else text[:37] + "..."


# ----------------------------------------------------------------------------------------------------------------------
# YAML scalars as rosparam reads them: YAML 1.1, exponents without a dot, angles in degrees and radians.


MAX_NUMBER_CHARS = 100
"""A longer plain scalar is text: reading it as a number takes quadratic time."""

INT, FLOAT, BOOL = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float", "tag:yaml.org,2002:bool"
NULL, STR, MERGE = "tag:yaml.org,2002:null", "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"
EXPONENT, DEGREES, RADIANS = "exponent", "!degrees", "!radians"
_TEXTS = frozenset({STR, "tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:value", "!"})

# YAML 1.1 wants a dot in a float; rosparam also reads 1e-3 as a number
_EXPONENT_PATTERN = re.compile(r"[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+\Z")
_DEG = re.compile(r"deg\([^)]*\)\Z")
_RAD = re.compile(r"rad\([^)]*\)\Z")

_RESOLVERS: dict[str | None, list[tuple[str, re.Pattern[str]]]] = yaml.SafeLoader.yaml_implicit_resolvers  # type: ignore[assignment]
_CONSTRUCTOR: Any = SafeConstructor()


def _arithmetic(text: str) -> float:
    """Evaluate the arithmetic that rosparam allows in `rad(..)`: `pi/2`, `-2*pi`. Raise ValueError for anything else."""
    if len(text) > MAX_NUMBER_CHARS:
        raise ValueError(text)
    value = evaluate(text, {"pi": math.pi})
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(text)
    return float(value)


def _degrees(text: str) -> float:
    text = text.strip()
    return math.radians(float(text[4:-1] if _DEG.match(text) else text))


def _radians(text: str) -> float:
    text = text.strip()
    return _arithmetic(text[4:-1] if _RAD.match(text) else text)


def resolve(text: str) -> str:
    """Return the tag of a plain scalar."""
    if not text:
        return NULL
    if len(text) > MAX_NUMBER_CHARS:
        return STR
    for tag, pattern in _RESOLVERS.get(text[0], ()):
        if pattern.match(text):
            return tag
    first = text[0]
    if first in "+-.0123456789" and _EXPONENT_PATTERN.match(text):
        return EXPONENT
    if first == "d" and _DEG.match(text):
        return DEGREES
    if first == "r" and _RAD.match(text):
        return RADIANS
    return STR


def construct(tag: str, text: str) -> Any:
    """Return the value of a scalar; raise ValueError if the text does not fit the tag, LookupError for an unknown tag."""
    if tag in _TEXTS:
        return text
    if tag in (INT, FLOAT):
        if len(text) > MAX_NUMBER_CHARS:
            raise ValueError(text)
        node = yaml.ScalarNode(tag, text)
        return _CONSTRUCTOR.construct_yaml_int(node) if tag == INT else _CONSTRUCTOR.construct_yaml_float(node)
    if tag == EXPONENT:
        return float(text.replace("_", ""))
    if tag == BOOL:
        try:
            return SafeConstructor.bool_values[text.lower()]
        except KeyError as exc:
            raise ValueError(text) from exc
    if tag == NULL:
        return None
    if tag == DEGREES:
        return _degrees(text)
    if tag == RADIANS:
        return _radians(text)
    raise LookupError(tag)


def scalar(text: str) -> Any:
    """Return the value of a plain scalar; text that cannot be converted stays text."""
    try:
        return construct(resolve(text), text)
    except (ValueError, LookupError):
        return text


# ----------------------------------------------------------------------------------------------------------------------
# PyYAML's parser events -> located nodes, within limits on depth, size and aliases.


MAX_DEPTH = 50
MAX_VALUES = 20_000
MAX_ALIASED = 10_000

_MAP, _SEQ = "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"
_KEY_TAGS = (STR, "!", EXPONENT, DEGREES, RADIANS)
"""Tags of keys that YAML 1.1 reads as text; rosparam reads more notations as numbers in values."""
_KINDS = {INT: "a number", FLOAT: "a number", BOOL: "a boolean", NULL: "null"}


class RejectedYamlError(Exception):
    """The file cannot be read: rule, location and message."""

    def __init__(self, rule: str, line: int, column: int, message: str) -> None:
        super().__init__(message)
        self.rule, self.line, self.column, self.message = rule, line, column, message


def _rejected(rule: str, mark: Any, message: str) -> RejectedYamlError:
    return RejectedYamlError(rule, mark.line + 1, mark.column + 1, message)


@dataclass(slots=True)
class _Open:
    """A container that is being read."""

    node: ListNode | DictNode
    anchor: str | None
    key: tuple[str, Location] | None = None
    merged: list[DictNode] = field(default_factory=list[DictNode])
    """Mappings merged by `<<`."""


class NodeBuilder:
    """Builds the nodes of one document. `feed` raises RejectedYamlError."""

    def __init__(self, file: str, *, any_key: bool = False) -> None:
        self._any_key = any_key
        self.file = file
        self.findings: list[Finding] = []
        self.root: Node | None = None
        self._stack: list[_Open] = []
        self._anchors: dict[str, Node | None] = {}
        self._values = 0
        self._aliased = 0
        self._documents = 0

    def feed(self, event: Any) -> None:
        """Process the next event."""
        kind = type(event)
        if kind is yaml.ScalarEvent:
            self._scalar(event)
        elif kind is yaml.MappingStartEvent or kind is yaml.SequenceStartEvent:
            self._open(event, kind is yaml.MappingStartEvent)
        elif kind is yaml.MappingEndEvent or kind is yaml.SequenceEndEvent:
            self._close()
        elif kind is yaml.AliasEvent:
            self._alias(event)
        elif kind is yaml.DocumentStartEvent:
            self._documents += 1
            if self._documents > 1:
                message = (
                    "a second document begins here (`---`), but ROS reads a single document per file; split the file"
                )
                raise _rejected("not-one-document", event.start_mark, message)

    def _place(self, mark: Any) -> Location:
        return Location(self.file, mark.line + 1, mark.column + 1)

    def _count(self, mark: Any) -> None:
        self._values += 1
        if self._values > MAX_VALUES:
            message = f"the file has more than {MAX_VALUES} values, too many for a parameter file; name the robot's YAML files"
            raise _rejected("too-large", mark, message)

    def _expects_key(self) -> bool:
        return bool(self._stack) and isinstance(self._stack[-1].node, DictNode) and self._stack[-1].key is None

    # --- scalars and keys ---------------------------------------------------------------------------------------------

    def _scalar(self, event: Any) -> None:
        text: str = event.value
        mark = event.start_mark
        self._count(mark)
        quoted = event.style in ("'", '"', "|", ">")
        if event.tag is None or (event.tag == "!" and event.implicit[0]):
            tag = STR if quoted else resolve(text)
        else:
            tag = event.tag
        if self._expects_key():
            self._key(text, tag, mark)
            return
        try:
            value = construct(tag, text)
        except ValueError:
            raise _rejected("not-a-value", mark, _wrong_value(tag, text)) from None
        except LookupError:
            raise _rejected("unknown-tag", mark, _unknown_tag(tag)) from None
        self._add(ScalarNode(value, self._place(mark), quoted, text), event.anchor)

    def _key(self, text: str, tag: str, mark: Any) -> None:
        if tag == MERGE:
            self._stack[-1].key = ("<<", self._place(mark))
            return
        if tag not in _KEY_TAGS and not self._any_key:
            kind = _KINDS.get(tag, "not text")
            message = (
                f'the key "{shortened(text)}" is {kind} in YAML, but a parameter name must be text; quote or rename it'
            )
            raise _rejected("key-not-text", mark, message)
        self._stack[-1].key = (text, self._place(mark))

    # --- containers ---------------------------------------------------------------------------------------------------

    def _open(self, event: Any, mapping: bool) -> None:
        mark = event.start_mark
        self._count(mark)
        if len(self._stack) >= MAX_DEPTH:
            message = f"the file is nested more than {MAX_DEPTH} levels deep, too deep for a parameter file"
            raise _rejected("too-deep", mark, message)
        if self._expects_key():
            raise _rejected(
                "key-not-text", mark, "a list or mapping is used as a key; the name of a parameter must be text"
            )
        if event.tag not in (None, "!", _MAP if mapping else _SEQ):
            raise _rejected("unknown-tag", mark, _unknown_tag(event.tag))
        at = self._place(mark)
        node = DictNode({}, at) if mapping else ListNode([], at)
        if event.anchor:
            self._anchors[event.anchor] = None
        self._stack.append(_Open(node, event.anchor))

    def _close(self) -> None:
        done = self._stack.pop()
        node = done.node
        if isinstance(node, DictNode):
            # explicit keys win over merged ones, earlier merged mappings over later ones (YAML's merge key)
            for merged in done.merged:
                for k, v in merged.items.items():
                    node.items.setdefault(k, v)
            node.size = 1 + sum(n.size for _, n in node.items.values())
        else:
            node.size = 1 + sum(n.size for n in node.items)
        self._add(node, done.anchor)

    def _alias(self, event: Any) -> None:
        mark = event.start_mark
        if self._expects_key():
            raise _rejected("key-not-text", mark, "an alias is used as a key; the name of a parameter must be text")
        if event.anchor not in self._anchors:
            raise _rejected(
                "yaml", mark, f"the alias *{event.anchor} has no anchor &{event.anchor} above it; add the anchor"
            )
        node = self._anchors[event.anchor]
        if node is None:
            raise _rejected(
                "yaml", mark, f"the alias *{event.anchor} is part of its own anchor, which has no end; remove it"
            )
        self._aliased += node.size
        if self._aliased > MAX_ALIASED:
            message = f"the aliases expand to more than {MAX_ALIASED} values, too many for a parameter file; write the values out"
            raise _rejected("alias-bomb", mark, message)
        self._add(node, None)

    # --- placing values -----------------------------------------------------------------------------------------------

    def _add(self, node: Node, anchor: str | None) -> None:
        if anchor:
            self._anchors[anchor] = node
        if not self._stack:
            self.root = node
            return
        top = self._stack[-1]
        if isinstance(top.node, ListNode):
            top.node.items.append(node)
            return
        assert top.key is not None
        (name, at), top.key = top.key, None
        if name == "<<":
            _merge(top, node, at)
            return
        before = top.node.items.pop(name, None)
        if before is not None:
            self._duplicate(name, at, before, node)
        top.node.items[name] = (at, node)

    def _duplicate(self, name: str, at: Location, before: tuple[Location, Node], node: Node) -> None:
        first_at, first = before
        if plain(first) == plain(node):
            severity, effect = "info", "with the same value; remove one of them"
        elif isinstance(first, DictNode) and isinstance(node, DictNode):
            severity, effect = "warning", "and the second replaces the first with everything under it; merge them"
        else:
            severity, effect = "warning", "and the second value is used; remove one of them"
        message = f"{name} is set twice (first on line {first_at.line}), {effect}"
        path = "/".join([*(o.key[0] for o in self._stack if o.key is not None), name])
        self.findings.append(finding(severity, "duplicated", at, path, message))


def _merge(top: _Open, node: Node, at: Location) -> None:
    sources = node.items if isinstance(node, ListNode) else [node]
    for source in sources:
        if not isinstance(source, DictNode):
            raise RejectedYamlError(
                "yaml", at.line, at.column, "the value of `<<` must be a mapping or a list of mappings"
            )
        top.merged.append(source)


def _wrong_value(tag: str, text: str) -> str:
    if tag == DEGREES:
        return f'"{shortened(text)}" is not an angle in degrees; write for example deg(90) or !degrees 90'
    if tag == RADIANS:
        return f'"{shortened(text)}" is not an angle in radians; write for example rad(pi/2) or !radians 1.57'
    return f'"{shortened(text)}" does not have the type of its tag; remove the tag or correct the value'


def _unknown_tag(tag: str) -> str:
    shown = tag.replace("tag:yaml.org,2002:", "!!")
    return f"the tag {shown} is not supported (only !degrees, !radians and the plain YAML types are); remove it"


MAX_BYTES = 1_000_000
MAX_TABBED_BYTES = 64_000
"""Files with tabs up to this size use the Python parser, which reports tabs as ROS does."""


_EDITED: ContextVar[Mapping[Path, bytes]] = ContextVar("_EDITED")


@contextmanager
def edited_files(contents: Mapping[Path, bytes]) -> Generator[None]:
    """Read these contents (by absolute path without links) instead of the files, to check an edit before it is written."""
    token = _EDITED.set(contents)
    try:
        yield
    finally:
        _EDITED.reset(token)


@dataclass(frozen=True, slots=True)
class YamlFile:
    """The content of a file, empty if it could not be read, and the findings."""

    root: DictNode
    findings: list[Finding]


def read_yaml(path: Path, shown: str | None = None, *, any_key: bool = False) -> YamlFile:
    """Read a parameter file; every problem becomes a finding. `shown` is its name in messages.

    `any_key`: keys that are numbers or booleans in YAML are taken as they are written.
    """
    name = shown or str(path)
    try:
        edited = _EDITED.get(None)
        data = edited.get(resolved(path)) if edited else None
        if data is None:
            data = read_bytes(path, MAX_BYTES)
    except TooLargeError as exc:
        return _unread(name, "too-large", f"{exc.strerror}, too large for a parameter file")
    except NotRegularFileError as exc:
        return _unread(name, "cannot-read", f"{exc.strerror}; name a YAML file")
    except (OSError, ValueError) as exc:
        return _unread(name, "cannot-read", f"cannot be read: {getattr(exc, 'strerror', None) or exc}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        if b"\0" in data[:1024] and data[:2] not in (b"\xff\xfe", b"\xfe\xff"):  # an image or an archive, not UTF-16
            return _unread(name, "not-utf8", "is not a text file; name a YAML file")
        line = data.count(b"\n", 0, exc.start) + 1
        column = exc.start - data.rfind(b"\n", 0, exc.start)
        at = Location(name, line, column)
        message = f"the byte 0x{data[exc.start]:02x} is not valid UTF-8; save the file as UTF-8"
        return YamlFile(DictNode({}, Location(name)), [finding("error", "not-utf8", at, "", message)])
    return parse_yaml(text, name, any_key=any_key)


def first_alias(path: Path) -> tuple[int, int] | None:
    """Return line and column of the first alias in a YAML file that can be read; None without one."""
    try:
        for event in yaml.parse(read_bytes(path, MAX_BYTES), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            if isinstance(event, yaml.AliasEvent):
                return event.start_mark.line + 1, event.start_mark.column + 1
    except (OSError, ValueError, yaml.YAMLError):
        return None  # reported when the file was read
    return None


def _unread(name: str, rule: str, problem: str) -> YamlFile:
    at = Location(name)
    return YamlFile(DictNode({}, at), [finding("error", rule, at, "", f"{name} {problem}")])


def parse_yaml(text: str, name: str, *, any_key: bool = False) -> YamlFile:
    """Read YAML text whose root is a mapping, or which is empty."""
    root, findings = parse_value(text, name, any_key=any_key)
    at = Location(name, 1, 1)
    if isinstance(root, DictNode):
        return YamlFile(root, findings)
    if root is not None and not (isinstance(root, ScalarNode) and root.value is None):
        content = "a list"
        if isinstance(root, ScalarNode):
            content = f'only the {"text" if isinstance(root.value, str) else "value"} "{shortened(root.text)}"'
        message = f"the file contains {content} instead of `name: value` lines; write parameters as `name: value`"
        if isinstance(root, ScalarNode) and root.text.endswith((".yaml", ".yml")):
            message += ", or name the file itself if this was a symbolic link"
        findings.append(finding("error", "not-a-mapping", root.at, "", message))
    return YamlFile(DictNode({}, at), findings)


def parse_value(text: str, name: str, *, any_key: bool = False) -> tuple[Node | None, list[Finding]]:
    """Read any YAML value; None for an empty document and for invalid YAML, which is reported in the findings."""
    builder = NodeBuilder(name, any_key=any_key)
    tabs = "\t" in text and len(text) <= MAX_TABBED_BYTES
    loader: Any = yaml.SafeLoader if tabs else getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        # the parsers silently end a document at NUL
        if "\0" in text:
            raise ReaderError(name, text.index("\0"), 0, "unicode", "special characters are not allowed")
        for event in yaml.parse(text, Loader=loader):
            builder.feed(event)
    except RejectedYamlError as exc:
        at = Location(name, exc.line, exc.column)
        return None, [*builder.findings, finding("error", exc.rule, at, "", exc.message)]
    except yaml.MarkedYAMLError as exc:
        return None, [*builder.findings, _syntax_error(exc, text, name)]
    except ReaderError as exc:
        position = exc.position
        before = text[:position]
        at = Location(name, before.count("\n") + 1, position - before.rfind("\n"))
        message = "the file contains a control character here, which YAML does not allow; remove it"
        return None, [*builder.findings, finding("error", "yaml", at, "", message)]
    return builder.root, builder.findings


def _syntax_error(exc: yaml.MarkedYAMLError, text: str, name: str) -> Finding:
    mark: Any = exc.problem_mark or exc.context_mark
    at = Location(name, mark.line + 1, mark.column + 1) if mark else Location(name)
    lines = text.splitlines()
    line = lines[at.line - 1] if 0 < at.line <= len(lines) else ""
    if "\t" in (exc.problem or "") or "\\t" in (exc.problem or "") or line[at.column - 1 : at.column] == "\t":
        message = "the line contains a tab, which YAML does not allow; replace its tabs by spaces"
        return finding("error", "tab", at, "", message)
    indent = line[: len(line) - len(line.lstrip())]
    if "\t" in indent:
        at = Location(name, at.line, indent.index("\t") + 1)
        message = "the line is indented with a tab, which YAML does not allow; indent it with spaces"
        return finding("error", "tab", at, "", message)
    problem = " ".join(str(part) for part in (exc.context, exc.problem) if part)
    message = f"invalid YAML: {problem}; check indentation, colons and brackets of this line and the one above"
    return finding("error", "yaml", at, "", message)
