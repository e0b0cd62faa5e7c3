"""Parse a launch file to XML elements with locations, within limits on size and depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from navstack.core.bounded_reading import NotRegularFileError, TooLargeError, read_bytes
from navstack.parameters.findings import Location
from navstack.parameters.yaml_reader import MAX_BYTES

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
    top = _parse(data, shown)
    if top.tag != "launch":
        message = f"the root of the file is <{top.tag}>, not <launch>; name a launch file"
        raise RejectedLaunchFileError("xml", Location(shown, top.line, top.column), message)
    return top


def _parse(data: bytes, shown: str) -> Element:
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
