"""Edit keys and values in the text of a YAML file: layout and comments stay as they are.

PyYAML locates each node; only the characters of the key or value are replaced. `check --fix`, `migrate` and `tune` edit with it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import yaml

from navstack.parameters.yaml_reader import scalar

_BYTE_ORDER_MARK: Final = "\ufeff"
_PLAIN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*\Z")
_ANCHORS: Final = re.compile(r"(?:&\S+\s+)+")


class Pair(NamedTuple):
    """A key and its value in a mapping, as nodes of PyYAML."""

    mapping: Any
    key: Any
    value: Any

    @property
    def at(self) -> tuple[int, int]:
        """Line and column of the key, from 1."""
        return _line_and_column(self.key.start_mark)


class YamlEditor:
    """Collects edits of one YAML file."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._root = _compose(text)
        self._replaced: dict[tuple[int, int], str] = {}
        """Start and end (characters) -> new text."""
        self._added: dict[int, tuple[Any, dict[str, Any]]] = {}
        """id of a mapping -> the mapping and the values to add to it, as a tree of namespaces."""

    def pairs(self) -> list[Pair]:
        """The pairs of all mappings, from the top; none if the text is not a YAML mapping."""
        return list(_pairs(self._root)) if self._root is not None else []

    def replace(self, line: int, column: int, value: Any) -> bool:
        """Replaces the scalar at a position (from 1); False if no scalar starts there."""
        for pair in self.pairs():
            node = pair.value
            if node.id == "scalar" and _line_and_column(node.start_mark) == (line, column):
                start, end = node.start_mark.index, node.end_mark.index
                anchors = _ANCHORS.match(self._text[start:end])
                start += len(anchors[0]) if anchors else 0
                self._replaced.setdefault((start, end), value_text(value))
                return True
        return False

    def rename(self, line: int, column: int, old: str, new: str) -> str:
        """Replaces the last part of a key at a position (from 1; column 0: the only such key of the line).

        Returns why that is impossible, empty if it is done.
        """
        column += 1 if column and line == 1 and self._text.startswith(_BYTE_ORDER_MARK) else 0
        found = [
            p for p in self.pairs() if p.at[0] == line and column in (0, p.at[1]) and _last_part(p.key.value) == old
        ]
        if len(found) != 1:
            return "the key is not a plain key of the file (it may come from an alias)"
        mapping, key, _ = found[0]
        wanted = key.value[: len(key.value) - len(old)] + new
        if any(k.value == wanted for k, _ in mapping.value):
            return f"{new} is set as well; remove one of them"
        start, end = key.start_mark.index, key.end_mark.index
        at = self._text.rfind(old, start, end)
        if self._text[start:end].strip("'\"") != key.value or at < 0:
            return "the key is written with an anchor, a tag or escapes"
        self._replaced[at, at + len(old)] = new
        return ""

    def add(self, mapping: Any, path: Sequence[str], value: Any) -> bool:
        """Adds a value to a mapping, in the namespaces `path[:-1]` below it; False if the key exists already."""
        *namespaces, name = path
        while namespaces:
            inner = next((v for k, v in mapping.value if k.value == namespaces[0]), None)
            if inner is None:
                break
            if inner.id != "mapping":
                return False
            mapping = inner
            namespaces.pop(0)
        if not mapping.value or (not namespaces and any(k.value == name for k, _ in mapping.value)):
            return False
        at = self._added.setdefault(id(mapping), (mapping, {}))[1]
        for namespace in namespaces:
            at = at.setdefault(namespace, {})
        at[name] = value
        return True

    def text(self) -> str:
        """The text with all edits."""
        edits = [(start, end, new) for (start, end), new in self._replaced.items()]
        edits += [self._insertion(mapping, tree) for mapping, tree in self._added.values()]
        text = self._text
        # from the end, so that positions stay valid; of edits at one position, the last first
        for i in sorted(range(len(edits)), key=lambda i: (edits[i][0], i), reverse=True):
            start, end, new = edits[i]
            text = text[:start] + new + text[end:]
        return text

    def _insertion(self, mapping: Any, tree: Mapping[str, Any]) -> tuple[int, int, str]:
        end = _content_end(mapping)
        if mapping.flow_style:
            return end, end, f", {_flow_text(tree)}"
        newline = "\r\n" if "\r\n" in self._text else "\n"
        indent = " " * mapping.value[0][0].start_mark.column
        lines = newline.join(indent + line for line in block_lines(tree))
        line_end = self._text.find("\n", end)
        if line_end < 0:
            return len(self._text), len(self._text), newline + lines
        return line_end + 1, line_end + 1, lines + newline


def block_lines(tree: Mapping[str, Any], depth: int = 0) -> Iterator[str]:
    """The lines of nested namespaces in block style."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield f"{'  ' * depth}{key}:"
            yield from block_lines(value, depth + 1)
        else:
            yield f"{'  ' * depth}{key}: {value_text(value)}"


def _flow_text(tree: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{k}: {{{_flow_text(v)}}}" if isinstance(v, dict) else f"{k}: {value_text(v)}" for k, v in tree.items()
    )


def _compose(text: str) -> Any:
    """The root node; its marks count the characters of `text`. None for text that is not a YAML mapping."""
    # a byte order mark is one character, and PyYAML does not count it: a space takes its place
    padding = " " if text.startswith(_BYTE_ORDER_MARK) else ""
    try:
        root: Any = yaml.compose(padding + text.removeprefix(_BYTE_ORDER_MARK), yaml.SafeLoader)
    except yaml.YAMLError:
        return None
    return root if root is not None and root.id == "mapping" else None


def _pairs(mapping: Any) -> Iterator[Pair]:
    for key, value in mapping.value:
        yield Pair(mapping, key, value)
        if value.id == "mapping":
            yield from _pairs(value)


def _last_part(key: Any) -> str:
    return key.rstrip("/").rpartition("/")[2] if isinstance(key, str) else ""


def _line_and_column(mark: Any) -> tuple[int, int]:
    return mark.line + 1, mark.column + 1


def _content_end(node: Any) -> int:
    """The position behind the last character of a node's content."""
    while node.value and node.id == "mapping":
        key, value = node.value[-1]
        if value.id == "scalar" and value.value == "" and value.start_mark.index <= key.end_mark.index:
            return key.end_mark.index
        if value.id == "scalar" or value.flow_style:
            return value.end_mark.index
        node = value
    if node.id == "sequence" and node.value and not node.flow_style:
        return _content_end(node.value[-1])
    return node.end_mark.index


# --- values as text ----------------------------------------------------------------------------------------------------


def value_text(value: Any) -> str:
    """Return a value as one line of YAML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        text = repr(value)
        # without a point, PyYAML takes 1e-05 as text: the launch files of ROS load and write parameters with it
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{text_of(str(k))}: {value_text(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(value_text(v) for v in value) + "]"
    return "null" if value is None else text_of(str(value))


def text_of(text: str) -> str:
    """Return a text as YAML, quoted where a plain scalar would be ambiguous."""
    if _PLAIN.match(text) and scalar(text) == text:
        return text
    dumped: str = yaml.safe_dump(text, default_style='"', width=1_000_000)
    return dumped.strip()
