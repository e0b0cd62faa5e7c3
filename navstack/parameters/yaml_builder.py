"""PyYAML's parser events -> located nodes, within limits on depth, size and aliases."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import yaml

from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.yaml_nodes import DictNode, ListNode, Node, ScalarNode, plain, shortened
from navstack.parameters.yaml_scalars import (
    BOOL,
    DEGREES,
    EXPONENT,
    FLOAT,
    INT,
    MERGE,
    NULL,
    RADIANS,
    STR,
    construct,
    resolve,
)

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
