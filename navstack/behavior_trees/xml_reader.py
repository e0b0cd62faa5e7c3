"""Read the XML of behavior trees: elements with their position in the file, and files that include others.

The parser is expat. Declarations of entities are refused, and depth, size and number of files are bounded, so that no file
makes it hang or fill the memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

from navstack.behavior_trees.errors import BehaviorTreeError
from navstack.core import read_bytes

MAX_BYTES: Final = 10_000_000
MAX_FILES: Final = 100
MAX_DEPTH: Final = 256
"""Deepest nesting of elements, as in BehaviorTree.CPP."""
MAX_ELEMENTS: Final = 100_000


@dataclass(slots=True)
class Source:
    """The text of a file, to find the position of an attribute."""

    name: str
    """As messages show it."""
    data: bytes = b""


@dataclass(slots=True, eq=False)
class Element:
    """An element of the XML."""

    tag: str
    attributes: dict[str, str]
    source: Source
    line: int
    column: int
    offset: int
    """Byte at which it begins."""
    children: list[Element] = field(default_factory=list["Element"])

    @property
    def where(self) -> str:
        """`file:line:column`."""
        return f"{self.source.name}:{self.line}:{self.column}"

    def position_of(self, attribute: str) -> tuple[int, int]:
        """Return line and column of an attribute; those of the element if it is not found."""
        found = re.compile(rb"\s(" + re.escape(attribute.encode()) + rb")\s*=").search(self.source.data, self.offset)
        if found is None:
            return self.line, self.column
        before = self.source.data[self.offset : found.start(1)]
        rows = before.count(b"\n")
        if rows == 0:
            return self.line, self.column + len(before.decode("utf-8", "replace"))
        return self.line + rows, len(before[before.rfind(b"\n") + 1 :].decode("utf-8", "replace")) + 1

    def error(self, message: str, attribute: str | None = None, **data: object) -> BehaviorTreeError:
        """Return an error at the element, or at one of its attributes."""
        line, column = self.position_of(attribute) if attribute is not None else (self.line, self.column)
        return located(message, self.source, line, column, **data)

    def named(self, tag: str) -> Iterator[Element]:
        """Yield the children of a tag."""
        return (child for child in self.children if child.tag == tag)


def located(message: str, source: Source, line: int, column: int, **data: object) -> BehaviorTreeError:
    """Return an error at a position of a file."""
    text = f"{source.name}:{line}:{column}: {message}"
    return BehaviorTreeError(text, file=source.name, line=line, column=column, **data)


def parse_xml(data: bytes, name: str) -> Element:
    """Return the root element of an XML text. Raises BehaviorTreeError with the position."""
    source = Source(name, data)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    root: list[Element] = []
    path: list[Element] = []
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        element = Element(tag, attributes, source, line, column, parser.CurrentByteIndex)
        if len(path) > MAX_DEPTH:
            raise element.error(f"elements are nested more than {MAX_DEPTH} deep; move a part into a <SubTree>")
        if count > MAX_ELEMENTS:
            raise element.error(f"the file has more than {MAX_ELEMENTS} elements")
        (path[-1].children if path else root).append(element)
        path.append(element)

    def end(tag: str) -> None:
        del tag
        path.pop()

    def refuse_entity(name: str, *rest: object) -> None:
        del rest
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        raise located(f'the entity "{name}" is declared; write its text instead', source, line, column)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = refuse_entity
    try:
        parser.Parse(data, True)
    except expat.ExpatError as exc:
        reason = expat.ErrorString(exc.code)
        fixes = {"no element found": "the file is empty or ends too early"}
        text = f"this is not valid XML: {fixes.get(reason, reason)}"
        raise located(text, source, exc.lineno, exc.offset + 1) from None
    except (ValueError, LookupError) as exc:  # an encoding that Python does not know
        raise located(f"this is not valid XML: {exc}; save the file as UTF-8", source, 1, 1) from None
    return root[0]


class Documents:
    """The files of one tree: the first one and all that it includes."""

    def __init__(self, packages: Mapping[str, Path] | None = None) -> None:
        """Create a reader; `packages` are the folders of ROS packages that includes name with `ros_pkg`."""
        self.roots: list[Element] = []
        """Root elements; an included file before the one that includes it."""
        self._packages = packages or {}
        self._read: set[Path] = set()
        self._open: list[Path] = []

    def read_text(self, text: str, name: str, folder: Path) -> Element:
        """Read a text, and the files that it includes relative to `folder`."""
        return self._take(text.encode("utf-8", "surrogatepass"), name, folder)

    def read_file(self, path: Path) -> Element:
        """Read a file and the files that it includes. Raises BehaviorTreeError."""
        try:
            data = read_bytes(path, MAX_BYTES)
        except (OSError, ValueError) as exc:
            text = f"{path}: the behavior tree cannot be read: {getattr(exc, 'strerror', None) or exc}"
            raise BehaviorTreeError(text, file=str(path)) from None
        resolved = path.resolve()
        self._read.add(resolved)
        self._open.append(resolved)
        root = self._take(data, str(path), path.parent)
        self._open.pop()
        return root

    def _take(self, data: bytes, name: str, folder: Path) -> Element:
        root = parse_xml(data, name)
        if root.tag != "root":
            raise root.error(f'the first element is <{root.tag}>; a behavior tree begins with <root BTCPP_format="4">')
        for include in root.named("include"):
            self._include(include, folder)
        self.roots.append(root)
        return root

    def _include(self, include: Element, folder: Path) -> None:
        given = include.attributes.get("path")
        if not given:
            raise include.error('<include> has no path; write <include path="file.xml"/>')
        package = include.attributes.get("ros_pkg")
        path = Path(given)
        if package is not None and not path.is_absolute():
            if package not in self._packages:
                text = f'the ROS package "{package}" is not known here; write the path of the file, or pass packages={{..}}'
                raise include.error(text, "ros_pkg", package=package)
            folder = self._packages[package]
        path = folder / path
        try:
            resolved = path.resolve()
            is_file = path.is_file()
        except (OSError, ValueError, RuntimeError) as exc:
            raise include.error(f"the file {given!r:.200} cannot be included: {exc}", "path") from None
        if resolved in self._open:
            raise include.error(f"{given} includes itself, directly or by other files; remove one <include>", "path")
        if not is_file:
            raise include.error(f"the file {path} does not exist; paths are relative to the file that includes", "path")
        if resolved in self._read:
            return
        if len(self._read) >= MAX_FILES:
            raise include.error(f"more than {MAX_FILES} files are included", "path")
        self.read_file(path)
