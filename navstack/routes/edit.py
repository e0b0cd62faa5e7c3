"""A route graph while a person edits it: nodes and edges come and go one at a time, and every step can be undone."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from navstack.core import InputError, short_repr
from navstack.routes.errors import InvalidGraphError
from navstack.routes.graph import FAR_M, MAX_ID, Metadata, Operation, RouteGraph, id_notes

MAX_NODES: Final = 10_000
"""Most nodes of a graph that is edited."""
MAX_EDGES: Final = 60_000
"""Most edges of a graph that is edited."""
UNDO_STEPS: Final = 100
ATTRIBUTES: Final = ("speed_limit", "penalty", "class", "cost", "overridable")
"""What `set_attributes` changes; the first three are metadata of the edge."""
_RANGES: Final[dict[str, tuple[float, float, str]]] = {
    "speed_limit": (0.0, 100.0, "a share of the full speed above 0, at most 1, or percent up to 100"),
    "penalty": (0.0, 1e6, "a number from 0 to 1e6"),
    "cost": (0.0, 1e6, "a number from 0 to 1e6"),
}


@dataclass(frozen=True, slots=True)
class DraftNode:
    """A node: position (m, float32 as in the graph), metadata and operations."""

    x: float
    y: float
    metadata: Metadata = field(default_factory=dict[str, Any])
    operations: tuple[Operation, ...] = ()


@dataclass(frozen=True, slots=True)
class DraftEdge:
    """A directed edge between two ids."""

    start: int
    end: int
    cost: float = 0.0
    overridable: bool = True
    metadata: Metadata = field(default_factory=dict[str, Any])
    operations: tuple[Operation, ...] = ()


class GraphDraft:
    """The nodes and edges of a graph by id. A method that raises has changed nothing. `graph` is the graph so far.

    Unlike a graph, a draft may have no nodes or no edges yet.
    """

    def __init__(self, graph: RouteGraph | None = None) -> None:
        """Begin with the nodes and edges of `graph`. Raises InvalidGraphError for one that is too large or has an id twice."""
        self.nodes: dict[int, DraftNode] = {}
        self.edges: dict[int, DraftEdge] = {}
        self.name = ""
        self.frame = "map"
        self.version = 0
        """Grows with every change."""
        self._before: deque[tuple[dict[int, DraftNode], dict[int, DraftEdge]]] = deque(maxlen=UNDO_STEPS)
        if graph is not None:
            self._take(graph)

    @property
    def can_undo(self) -> bool:
        """True if there is a change to undo."""
        return bool(self._before)

    def replace_by(self, graph: RouteGraph) -> None:
        """Begin again with another graph; `undo` brings the former one back. Raises InvalidGraphError as the constructor."""
        taken = GraphDraft(graph)
        self._keep()
        self.nodes, self.edges, self.name, self.frame = taken.nodes, taken.edges, taken.name, taken.frame

    def add_node(self, x: float, y: float) -> int:
        """Add a node at a position (m) and return its id. Raises InputError."""
        position = _position(x, y)
        if len(self.nodes) >= MAX_NODES:
            raise InputError(f"the graph has {MAX_NODES} nodes, the most that can be edited; delete some")
        node = self._free_ids(1)
        self._keep()
        self.nodes[node] = DraftNode(*position)
        return node

    def move_node(self, node: int, x: float, y: float) -> None:
        """Move a node to a position (m). Raises InputError, and InvalidGraphError for a node that is not there."""
        position, found = _position(x, y), self._node(node)
        # the clearance belongs to the old position, for the node and for its edges
        moved = replace(found, x=position[0], y=position[1], metadata=_without_clearance(found.metadata))
        self._keep()
        self.nodes[node] = moved
        for number, edge in self.edges.items():
            if node in (edge.start, edge.end) and "clearance" in edge.metadata:
                self.edges[number] = replace(edge, metadata=_without_clearance(edge.metadata))

    def connect(self, start: int, end: int, *, both_ways: bool = False) -> list[int]:
        """Add an edge from a node to another one, with `both_ways` also back, and return the ids of the new edges.

        A direction that is connected already is left as it is. Raises InputError if nothing is left to add, InvalidGraphError
        for a node that is not there.
        """
        self._node(start)
        self._node(end)
        if start == end:
            raise InputError(f"an edge cannot lead from node {start} to itself; choose another node", node=start)
        there = {(edge.start, edge.end): number for number, edge in self.edges.items()}
        wanted = [(start, end), (end, start)] if both_ways else [(start, end)]
        new = [pair for pair in wanted if pair not in there]
        if not new:
            edge = there[start, end]
            both = " both ways" if both_ways else ""
            raise InputError(
                f"edge {edge} connects node {start} to {end}{both} already; select it to change it", edge=edge
            )
        if len(self.edges) + len(new) > MAX_EDGES:
            raise InputError(
                f"the graph has {len(self.edges)} edges, and at most {MAX_EDGES} can be edited; delete some"
            )
        first = self._free_ids(len(new))
        self._keep()
        for number, (a, b) in enumerate(new, first):
            self.edges[number] = DraftEdge(a, b)
        return list(range(first, first + len(new)))

    def delete(self, nodes: Collection[int] = (), edges: Collection[int] = ()) -> None:
        """Delete nodes with all of their edges, and edges. Raises InputError, and InvalidGraphError for an unknown id."""
        if not nodes and not edges:
            raise InputError("nothing is selected to delete; select a node or an edge")
        for node in nodes:
            self._node(node)
        for edge in edges:
            self._edge(edge)
        gone_nodes, gone_edges = set(nodes), set(edges)
        self._keep()
        self.nodes = {number: node for number, node in self.nodes.items() if number not in gone_nodes}
        self.edges = {
            number: edge
            for number, edge in self.edges.items()
            if number not in gone_edges and not {edge.start, edge.end} & gone_nodes
        }

    def set_attributes(self, edges: Collection[int], values: Mapping[str, Any]) -> None:
        """Set ATTRIBUTES of edges; None removes one. Raises InputError, and InvalidGraphError for an edge that is not there."""
        if not edges or not values:
            raise InputError("no edge is selected, or no attribute is given; select an edge and give one")
        checked = {name: _attribute(name, value) for name, value in values.items()}
        changed: dict[int, DraftEdge] = {}
        for number in edges:
            edge = self._edge(number)
            metadata = {key: value for key, value in edge.metadata.items() if key not in checked}
            metadata |= {k: v for k, v in checked.items() if v is not None and k not in ("cost", "overridable")}
            if "cost" in checked:
                edge = replace(edge, cost=float(np.float32(checked["cost"] or 0.0)))
            if "overridable" in checked:
                edge = replace(edge, overridable=checked["overridable"] is not False)
            changed[number] = replace(edge, metadata=metadata)
        self._keep()
        self.edges.update(changed)

    def undo(self) -> None:
        """Take the last change back. Raises InputError if there is none."""
        if not self._before:
            raise InputError("there is no change to undo")
        self.nodes, self.edges = self._before.pop()
        self.version += 1

    def graph(self) -> RouteGraph:
        """Return the graph so far. Raises InvalidGraphError without nodes or edges."""
        for what, found, fix in (("nodes", self.nodes, "add some"), ("edges", self.edges, "connect two nodes")):
            if not found:
                raise InvalidGraphError(f"the graph has no {what} yet; {fix}")
        index = {node: k for k, node in enumerate(self.nodes)}
        nodes, edges = list(self.nodes.values()), list(self.edges.values())
        return RouteGraph(
            np.array(list(self.nodes), np.int64),
            np.array([(node.x, node.y) for node in nodes], np.float32),
            np.array(list(self.edges), np.int64),
            np.array([index[edge.start] for edge in edges], np.int32),
            np.array([index[edge.end] for edge in edges], np.int32),
            costs=np.array([edge.cost for edge in edges], np.float32),
            overridable=np.array([edge.overridable for edge in edges], np.bool_),
            node_metadata={k: node.metadata for k, node in enumerate(nodes) if node.metadata},
            edge_metadata={k: edge.metadata for k, edge in enumerate(edges) if edge.metadata},
            node_operations={k: node.operations for k, node in enumerate(nodes) if node.operations},
            edge_operations={k: edge.operations for k, edge in enumerate(edges) if edge.operations},
            name=self.name,
            frame=self.frame,
            notes=id_notes(max(self.nodes), max(self.edges)),
        )

    # --- inside -------------------------------------------------------------------------------------------------------

    def _take(self, graph: RouteGraph) -> None:
        if len(graph) > MAX_NODES or graph.edge_count > MAX_EDGES:
            raise InvalidGraphError(
                f"the graph has {len(graph)} nodes and {graph.edge_count} edges; at most {MAX_NODES} nodes and {MAX_EDGES} "
                "edges can be edited; take a part of it"
            )
        if len(graph.index_of_edge) != graph.edge_count:
            ids, counts = np.unique(graph.edge_ids, return_counts=True)
            raise InvalidGraphError(
                f"edge id {int(ids[counts.argmax()])} is there twice; give every edge its own id before you edit the graph",
                edge=int(ids[counts.argmax()]),
            )
        ids = graph.node_ids.tolist()
        for k, (node, (x, y)) in enumerate(zip(ids, graph.xy.tolist(), strict=True)):
            self.nodes[node] = DraftNode(x, y, graph.node_metadata.get(k, {}), graph.node_operations.get(k, ()))
        for k, edge in enumerate(graph.edge_ids.tolist()):
            self.edges[edge] = DraftEdge(
                ids[graph.starts[k]],
                ids[graph.ends[k]],
                float(graph.costs[k]),
                bool(graph.overridable[k]),
                graph.edge_metadata.get(k, {}),
                graph.edge_operations.get(k, ()),
            )
        self.name, self.frame = graph.name, graph.frame

    def _keep(self) -> None:
        self._before.append((dict(self.nodes), dict(self.edges)))
        self.version += 1

    def _free_ids(self, count: int) -> int:
        """Return the first of `count` ids above all others."""
        first = max(max(self.nodes, default=-1), max(self.edges, default=-1)) + 1
        if first + count - 1 > MAX_ID:
            raise InputError(f"the largest id is {first - 1}, and ids end at {MAX_ID}; number the graph from 0 again")
        return first

    def _node(self, node: int) -> DraftNode:
        if node not in self.nodes:
            raise InvalidGraphError(f"the graph has no node {node}; it may have been deleted", node=node)
        return self.nodes[node]

    def _edge(self, edge: int) -> DraftEdge:
        if edge not in self.edges:
            raise InvalidGraphError(f"the graph has no edge {edge}; it may have been deleted", edge=edge)
        return self.edges[edge]


def _position(x: float, y: float) -> tuple[float, float]:
    if not (math.isfinite(x) and math.isfinite(y) and max(abs(x), abs(y)) <= FAR_M):
        raise InputError(f"({x:g}, {y:g}) is no position; give finite numbers up to {FAR_M:g} m", x=x, y=y)
    return float(np.float32(x)), float(np.float32(y))


def _without_clearance(metadata: Metadata) -> Metadata:
    return {key: value for key, value in metadata.items() if key != "clearance"}


def _attribute(name: str, value: Any) -> float | bool | str | None:
    if name not in ATTRIBUTES:
        raise InputError(f'"{name}" is not an attribute of an edge; known: {", ".join(ATTRIBUTES)}', name=name)
    if value is None:
        return None
    wanted = "true or false" if name == "overridable" else "a text of 1 to 80 characters"
    if name == "overridable":
        good = isinstance(value, bool)
    elif name == "class":
        good = isinstance(value, str) and 0 < len(value) <= 80 and value.isprintable()
    else:
        low, high, wanted = _RANGES[name]
        good = isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high
        good = good and (name != "speed_limit" or value > 0.0)
    if not good:
        raise InputError(f"{name} is {short_repr(value)}; give {wanted}", name=name)
    return value
