"""Read YAML as rosparam does, with file, line and column of every key and value.

Built on the parser events of PyYAML instead of its constructors: a file cannot create objects, the reader does not recurse,
and files that expand beyond the limits are rejected. Uses libyaml's parser where available.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from yaml.reader import ReaderError

from navstack.core.bounded_reading import NotRegularFileError, TooLargeError, read_bytes
from navstack.core.files import resolved
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.yaml_builder import NodeBuilder, RejectedYamlError
from navstack.parameters.yaml_nodes import DictNode, ListNode, Node, ScalarNode, plain, relocate, shortened
from navstack.parameters.yaml_scalars import scalar

MAX_BYTES = 1_000_000
MAX_TABBED_BYTES = 64_000
"""Files with tabs up to this size use the Python parser, which reports tabs as ROS does."""

__all__ = [
    "MAX_BYTES",
    "DictNode",
    "ListNode",
    "Node",
    "ScalarNode",
    "YamlFile",
    "edited_files",
    "parse_value",
    "parse_yaml",
    "plain",
    "read_yaml",
    "relocate",
    "scalar",
]


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
        line = data.count(b"\n", 0, exc.start) + 1
        column = exc.start - data.rfind(b"\n", 0, exc.start)
        at = Location(name, line, column)
        message = f"the byte 0x{data[exc.start]:02x} is not valid UTF-8; save the file as UTF-8"
        return YamlFile(DictNode({}, Location(name)), [finding("error", "not-utf8", at, "", message)])
    return parse_yaml(text, name, any_key=any_key)


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
