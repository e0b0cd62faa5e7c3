"""GeoJSON files of route graphs (nav2_route's format), read with the place of every mistake, and written.

    {"type": "FeatureCollection", "name": "floor", "features": [
      {"type": "Feature", "properties": {"id": 0, "frame": "map"}, "geometry": {"type": "Point", "coordinates": [1.0, 2.0]}},
      {"type": "Feature", "properties": {"id": 7, "startid": 0, "endid": 1, "metadata": {"speed_limit": 50.0}},
       "geometry": {"type": "MultiLineString", "coordinates": [[[1.0, 2.0], [4.0, 2.0]]]}}]}

A Point is a node, a LineString or MultiLineString a directed edge; lines of edges are for drawing only.
"""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from json.decoder import JSONDecodeError
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

import numpy as np

from navstack.core import Pose2D, TooLargeError, normalize_angle, read_bytes, short_repr, write_text
from navstack.routes.errors import InvalidGraphError
from navstack.routes.graph import FAR_M, MAX_ID, TRIGGERS, Metadata, Operation, RouteGraph, id_notes

MAX_BYTES: Final = 2_000_000_000
"""Largest file: about 1e6 nodes with 4e6 edges have 0.7 GB."""
_FLOAT32: Final = float(np.finfo(np.float32).max)
_LINES: Final = ("LineString", "MultiLineString")
_SPACE: Final = " \t\n\r"
_MAX_DEPTH: Final = 32
"""Deepest nesting of metadata."""


class _Feature(NamedTuple):
    """A feature of the file, and where it begins and ends (characters)."""

    number: int
    value: Any
    begin: int
    end: int


class _Reader:
    """The text of a file, with messages that name the place."""

    def __init__(self, text: str, shown: str) -> None:
        self.text = text
        self.shown = shown
        self.decoder = json.JSONDecoder()
        self.tags: dict[str, Any] = {}
        """The members of the collection, without the features."""

    def fail(self, at: int, message: str, **data: Any) -> NoReturn:
        """Raise InvalidGraphError for a position (characters)."""
        line = self.text.count("\n", 0, at) + 1
        column = at - self.text.rfind("\n", 0, at)
        raise InvalidGraphError(
            f"{self.shown}:{line}:{column}: {message}", file=self.shown, line=line, column=column, **data
        )

    def fail_in(self, feature: _Feature, path: str, message: str) -> NoReturn:
        """Raise InvalidGraphError for a member of a feature, such as `properties.id`."""
        at = feature.begin
        for key in path.split("."):
            found = self.text.find(f'"{key}"', at, feature.end)
            at = at if found < 0 else found
        self.fail(at, f"feature {feature.number}: {message}", feature=feature.number, key=path)

    def features(self) -> Iterator[_Feature]:
        """Yield the features one after another, without a tree of the whole file."""
        at = self.skip(0)
        if self.text[at : at + 1] != "{":
            self.fail(at, 'the file is not a JSON object; write {"type": "FeatureCollection", "features": [..]}')
        at = self.skip(at + 1)
        seen = False
        while self.text[at : at + 1] != "}":
            key, at = self.value(at)
            if not isinstance(key, str):
                self.fail(at, f"{short_repr(key)} is not the name of a member; write a text in quotes")
            at = self.skip(at)
            if self.text[at : at + 1] != ":":
                self.fail(at, f'a colon is missing after "{key}"')
            at = self.skip(at + 1)
            if key == "features":
                if seen:
                    self.fail(at, "the file has features twice; put all of them into one list")
                seen = True
                if self.text[at : at + 1] != "[":
                    self.fail(at, 'features is not a list; write "features": [..]')
                at = yield from self._items(at)
            else:
                self.tags[key], at = self.value(at)
            at = self.skip(at)
            if self.text[at : at + 1] == ",":
                at = self.skip(at + 1)
            elif self.text[at : at + 1] != "}":
                self.fail(at, "a comma or } is missing; the file may be cut off")
        if self.skip(at + 1) < len(self.text):
            self.fail(self.skip(at + 1), "the file has more text after the object; remove it")
        if not seen:
            self.fail(at, 'the file has no features; add "features": [..] with nodes (Point) and edges (LineString)')

    def _items(self, at: int) -> Iterator[_Feature]:
        at, number = self.skip(at + 1), 0
        while self.text[at : at + 1] != "]":
            begin = at
            value, at = self.value(at)
            yield _Feature(number, value, begin, at)
            number += 1
            at = self.skip(at)
            if self.text[at : at + 1] == ",":
                at = self.skip(at + 1)
            elif self.text[at : at + 1] != "]":
                self.fail(at, f"a comma or ] is missing after feature {number - 1}; the file may be cut off")
        return at + 1

    def value(self, at: int) -> tuple[Any, int]:
        try:
            return self.decoder.raw_decode(self.text, at)
        except JSONDecodeError as exc:
            self.fail(exc.pos, f"this is not JSON: {exc.msg}; the file may be cut off or edited by hand")
        except RecursionError:
            self.fail(at, f"the value is nested more than {_MAX_DEPTH} levels deep; flatten it")
        except ValueError:
            self.fail(at, "a number has too many digits; write a number that a float can hold")

    def skip(self, at: int) -> int:
        """Return the position of the next character that is no space."""
        text, end = self.text, len(self.text)
        while at < end and text[at] in _SPACE:
            at += 1
        return at


def _text_of(path: str | os.PathLike[str]) -> str:
    shown = os.fspath(path)
    try:
        data = read_bytes(Path(path), MAX_BYTES)
    except TooLargeError as exc:
        raise InvalidGraphError(f"{shown} {exc.strerror}; split it", file=shown) from None
    except OSError as exc:
        raise InvalidGraphError(f"{shown} cannot be read: {exc.strerror or exc}", file=shown) from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        raise InvalidGraphError(f"{shown} is not UTF-8 (byte {exc.start}); save it as UTF-8", file=shown) from None


def load_points(path: str | os.PathLike[str]) -> dict[str, Pose2D]:
    """Read the points of a GeoJSON file as poses by name: `name`, else `id`, else the number; `yaw` (rad) of the properties.

    Other features are ignored. Raises InvalidGraphError as `load_graph`.
    """
    reader = _Reader(_text_of(path), os.fspath(path))
    points = _Nodes(reader)
    found: dict[str, Pose2D] = {}
    for feature in reader.features():
        if _geometry(reader, feature) != "Point":
            continue
        x, y = points.position(feature)
        properties = feature.value.get("properties") or {}
        if not isinstance(properties, dict):
            reader.fail_in(feature, "properties", f"properties is {short_repr(properties)}; write an object")
        name = str(properties.get("name", properties.get("id", feature.number)))
        if name in found:
            reader.fail_in(
                feature, "properties.name", f"the name {name} is that of another point, too; give every point its own"
            )
        found[name] = Pose2D(
            x, y, normalize_angle(points.number(feature, properties.get("yaw", 0.0), "properties.yaw"))
        )
    if not found:
        raise InvalidGraphError(
            f"{os.fspath(path)}: there are no points; add features of type Point", file=os.fspath(path)
        )
    return found


def load_graph(path: str | os.PathLike[str]) -> RouteGraph:
    """Read a GeoJSON file of nav2_route. `notes` of the graph has what a reader should know (ids, ignored features).

    Raises InvalidGraphError, whose message begins with file:line:column, for a file that cannot be read, is no such JSON, or
    has wrong types, numbers that are not finite, ids twice, edges without their nodes, or no nodes or edges.
    """
    return parse_graph(_text_of(path), os.fspath(path))


def parse_graph(text: str, shown: str = "graph") -> RouteGraph:
    """Return the graph of a GeoJSON text; `shown` is the file in messages. Raises InvalidGraphError as `load_graph`."""
    reader = _Reader(text, shown)
    nodes, edges = _Nodes(reader), _Edges(reader)
    ignored: dict[str, int] = {}
    for feature in reader.features():
        kind = _geometry(reader, feature)
        if kind == "Point":
            nodes.add(feature)
        elif kind in _LINES:
            edges.add(feature)
        else:
            ignored[kind] = ignored.get(kind, 0) + 1
    for what, found in (
        ("nodes (Point features)", nodes.ids),
        ("edges (LineString or MultiLineString features)", edges.ids),
    ):
        if not found:
            raise InvalidGraphError(f"{shown}: the graph has no {what}; add some", file=shown)
    starts, ends = edges.resolve(nodes.ids)
    notes = [*id_notes(max(nodes.ids), max(edges.ids)), *edges.notes()]
    notes += [f"{count} feature{'s' * (count != 1)} of type {kind} ignored" for kind, count in ignored.items()]
    xy = np.array(nodes.xy, np.float64)
    if np.abs(xy).max() > FAR_M:
        step = float(np.spacing(np.abs(xy).max().astype(np.float32)))
        notes.append(
            f"positions reach {np.abs(xy).max():.0f} m: as float32, as in Nav2, they are rounded to {step:g} m; "
            "give them in the map's frame"
        )
    name = reader.tags.get("name", "")
    return RouteGraph(
        np.fromiter(nodes.ids, np.int64, len(nodes.ids)),
        xy.astype(np.float32),
        np.fromiter(edges.ids, np.int64, len(edges.ids)),
        starts,
        ends,
        costs=np.array(edges.costs, np.float32),
        overridable=np.array(edges.overridable, np.bool_),
        node_metadata=nodes.metadata,
        edge_metadata=edges.metadata,
        node_operations=nodes.operations,
        edge_operations=edges.operations,
        name=name if isinstance(name, str) else "",
        frame=nodes.frame or "map",
        notes=notes,
    )


def _geometry(reader: _Reader, feature: _Feature) -> str:
    """Return the type of the geometry of a feature."""
    value = feature.value
    if not isinstance(value, dict) or not isinstance(value.get("geometry"), dict):
        what = "is not an object" if not isinstance(value, dict) else "has no geometry"
        reader.fail_in(
            feature, "geometry", f'it {what}; write {{"type": "Feature", "properties": {{..}}, "geometry": {{..}}}}'
        )
    kind = value["geometry"].get("type")
    if not isinstance(kind, str):
        reader.fail_in(
            feature, "geometry.type", f"the type of the geometry is {short_repr(kind)}; write Point or MultiLineString"
        )
    return kind


class _Items(ABC):
    """What nodes and edges share: ids, metadata, operations."""

    what = ""

    def __init__(self, reader: _Reader) -> None:
        self.reader = reader
        self.count = 0
        self.metadata: dict[int, Metadata] = {}
        self.operations: dict[int, tuple[Operation, ...]] = {}

    def common(self, feature: _Feature) -> dict[str, Any]:
        """Read id, metadata and operations; return the properties."""
        properties = feature.value.get("properties")
        if not isinstance(properties, dict):
            self.reader.fail_in(feature, "properties", f'properties is {short_repr(properties)}; write {{"id": 1}}')
        number = self.id_of(feature, properties, "id")
        self.add_id(feature, number)
        index, self.count = self.count, self.count + 1
        if "metadata" in properties:
            self.metadata[index] = self._metadata(feature, properties["metadata"], "properties.metadata")
        if properties.get("operations"):
            self.operations[index] = tuple(self._operations(feature, properties["operations"]))
        return properties

    @abstractmethod
    def add_id(self, feature: _Feature, number: int) -> None:
        """Keep the id of the next item."""

    def id_of(self, feature: _Feature, properties: dict[str, Any], key: str) -> int:
        """Return an id of the properties."""
        value = properties.get(key)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= MAX_ID:
            problem = f"{key} is {short_repr(value)}" if key in properties else f"{key} is missing"
            self.reader.fail_in(feature, f"properties.{key}", f"{problem}; write a whole number from 0 to {MAX_ID}")
        return value

    def number(self, feature: _Feature, value: Any, path: str) -> float:
        """Return a finite number that float32 can hold."""
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _FLOAT32:
            self.reader.fail_in(feature, path, f"{path.rsplit('.')[-1]} is {short_repr(value)}; write a finite number")
        return float(value)

    def _metadata(self, feature: _Feature, value: Any, path: str) -> Metadata:
        if not isinstance(value, dict):
            self.reader.fail_in(
                feature, path, f'metadata is {short_repr(value)}; write an object such as {{"speed_limit": 50.0}}'
            )
        self._check(feature, value, path, 0)
        return value

    def _check(self, feature: _Feature, value: Any, path: str, depth: int) -> None:
        if depth > _MAX_DEPTH:
            self.reader.fail_in(feature, path, f"metadata is nested more than {_MAX_DEPTH} levels deep; flatten it")
        if isinstance(value, dict):
            for key, item in value.items():
                self._check(feature, item, f"{path}.{key}", depth + 1)
        elif isinstance(value, list):
            for item in value:
                self._check(feature, item, path, depth + 1)
        elif value is None or (isinstance(value, (int, float)) and not abs(value) <= _FLOAT32):
            self.reader.fail_in(
                feature,
                path,
                f"{path.rsplit('.')[-1]} is {short_repr(value)}; write a finite number, a boolean or a text",
            )

    def _operations(self, feature: _Feature, value: Any) -> Iterator[Operation]:
        path, form = "properties.operations", '{"name": {"type": .., "trigger": "NODE", "metadata": {..}}}'
        if isinstance(value, list):  # Nav2 iterates over either
            value = {str(i): item for i, item in enumerate(value)}
        if not isinstance(value, dict):
            self.reader.fail_in(feature, path, f"operations is {short_repr(value)}; write {form}")
        for name, item in value.items():
            if not isinstance(item, dict) or not isinstance(item.get("type"), str):
                self.reader.fail_in(feature, f"{path}.{name}", f"the operation {name} has no type; write {form}")
            trigger = item.get("trigger")
            if trigger not in TRIGGERS:
                self.reader.fail_in(
                    feature,
                    f"{path}.{name}.trigger",
                    f"the trigger of {name} is {short_repr(trigger)}; write {', '.join(TRIGGERS[:2])} or {TRIGGERS[2]}",
                )
            yield Operation(
                name,
                item["type"],
                trigger,
                self._metadata(feature, item.get("metadata", {}), f"{path}.{name}.metadata"),
            )


class _Nodes(_Items):
    what = "node"

    def __init__(self, reader: _Reader) -> None:
        super().__init__(reader)
        self.ids: dict[int, int] = {}
        """Index by id."""
        self.xy: list[tuple[float, float]] = []
        self.frame: str | None = None

    def add_id(self, feature: _Feature, number: int) -> None:
        """Keep an id. Raises InvalidGraphError for one that is there."""
        if number in self.ids:
            self.reader.fail_in(
                feature, "properties.id", f"the id {number} is that of another node, too; give every node its own"
            )
        self.ids[number] = len(self.ids)

    def position(self, feature: _Feature) -> tuple[float, float]:
        """Return the coordinates of a point (m)."""
        at = feature.value["geometry"].get("coordinates")
        if not isinstance(at, list) or len(at) not in (2, 3):
            self.reader.fail_in(
                feature, "geometry.coordinates", f"the coordinates are {short_repr(at)}; write [x, y] (m)"
            )
        x, y = (self.number(feature, value, "geometry.coordinates") for value in at[:2])
        return x, y

    def add(self, feature: _Feature) -> None:
        """Read a node."""
        properties = self.common(feature)
        self.xy.append(self.position(feature))
        frame = properties.get("frame", "map") or "map"
        if not isinstance(frame, str):
            self.reader.fail_in(
                feature, "properties.frame", f'frame is {short_repr(frame)}; write a name such as "map"'
            )
        if self.frame is not None and frame != self.frame:
            self.reader.fail_in(
                feature,
                "properties.frame",
                f'frame is "{frame}", that of the nodes before is "{self.frame}"; give all in one frame',
            )
        self.frame = frame


class _Edges(_Items):
    what = "edge"

    def __init__(self, reader: _Reader) -> None:
        super().__init__(reader)
        self.ids: list[int] = []
        self._twice: dict[int, str] = {}
        """Where ids are that stand there a second time."""
        self._seen: set[int] = set()
        self.links: list[tuple[int, int]] = []
        self.costs: list[float] = []
        self.overridable: list[bool] = []
        self._where: list[tuple[int, int, int]] = []

    def add_id(self, feature: _Feature, number: int) -> None:
        """Keep an id. Nav2 takes one twice, and one of its own graphs has some: both edges are closed together."""
        if number in self._seen:
            self._twice.setdefault(number, f"feature {feature.number}")
        self._seen.add(number)
        self.ids.append(number)

    def notes(self) -> list[str]:
        """Return the note for ids that are there twice."""
        if not self._twice:
            return []
        number, where = next(iter(self._twice.items()))
        count = len(self._twice)
        what = f"{count} edge id{'s are' if count > 1 else ' is'} there twice (first: {number}, {where})"
        return [f"{what}: such edges are closed, opened and blocked together; give every edge its own id"]

    def add(self, feature: _Feature) -> None:
        """Read an edge; its nodes may come later."""
        properties = self.common(feature)
        self.links.append((self.id_of(feature, properties, "startid"), self.id_of(feature, properties, "endid")))
        cost = self.number(feature, properties.get("cost", 0.0), "properties.cost")
        if cost < 0.0:
            self.reader.fail_in(feature, "properties.cost", f"cost is {cost:g}; write a cost of 0 or more")
        self.costs.append(cost)
        free = properties.get("overridable", True)
        if not isinstance(free, bool):
            self.reader.fail_in(
                feature, "properties.overridable", f"overridable is {short_repr(free)}; write true or false"
            )
        self.overridable.append(free)
        self._where.append((feature.number, feature.begin, feature.end))

    def resolve(self, nodes: dict[int, int]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Return the indices of the start and the end nodes."""
        for (start, end), (number, begin, stop), edge in zip(self.links, self._where, self.ids, strict=True):
            for key, node in (("startid", start), ("endid", end)):
                if node not in nodes:
                    self.reader.fail_in(
                        _Feature(number, None, begin, stop),
                        f"properties.{key}",
                        f"{key} of edge {edge} is {node}, but there is no node {node}; add it or remove the edge",
                    )
        links = np.array([(nodes[a], nodes[b]) for a, b in self.links], np.int32)
        return links[:, 0], links[:, 1]


def graph_text(graph: RouteGraph) -> str:
    """Return the GeoJSON text of a graph, a feature per line. Positions and costs are float32 and come back exactly."""
    head = {"type": "FeatureCollection", "name": graph.name or "graph"}
    lines = [json.dumps(head)[:-1] + ', "features": [']
    features: list[dict[str, Any]] = []
    points = [[_short(x), _short(y)] for x, y in graph.xy]
    for i, node in enumerate(graph.node_ids.tolist()):
        properties = {
            "id": node,
            "frame": graph.frame,
            **_extras(graph.node_metadata.get(i), graph.node_operations.get(i)),
        }
        features.append(_feature(properties, "Point", points[i]))
    for k, edge in enumerate(graph.edge_ids.tolist()):
        a, b = int(graph.starts[k]), int(graph.ends[k])
        properties = {"id": edge, "startid": int(graph.node_ids[a]), "endid": int(graph.node_ids[b])}
        if graph.costs[k] > 0.0 or not graph.overridable[k]:
            properties |= {"cost": _short(graph.costs[k]), "overridable": bool(graph.overridable[k])}
        properties |= _extras(graph.edge_metadata.get(k), graph.edge_operations.get(k))
        features.append(_feature(properties, "MultiLineString", [[points[a], points[b]]]))
    lines.append(",\n".join(json.dumps(feature, allow_nan=False) for feature in features))
    return "\n".join([*lines, "]}", ""])


def save_graph(graph: RouteGraph, path: str | os.PathLike[str]) -> None:
    """Write the GeoJSON file of a graph, which nav2_route and `load_graph` read. Raises OutputError."""
    write_text(Path(path), graph_text(graph))


def _feature(properties: dict[str, Any], kind: str, coordinates: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def _extras(metadata: Metadata | None, operations: tuple[Operation, ...] | None) -> dict[str, Any]:
    extras: dict[str, Any] = {"metadata": metadata} if metadata else {}
    if operations:
        extras["operations"] = {
            o.name: {"type": o.type, "trigger": o.trigger, **({"metadata": o.metadata} if o.metadata else {})}
            for o in operations
        }
    return extras


def _short(value: np.float32 | float) -> float:
    """Return the shortest decimal number that is this float32."""
    return float(np.format_float_positional(np.float32(value), unique=True))
