"""A route graph: nodes at positions, directed edges with costs, metadata and operations, as arrays."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import short_repr
from navstack.routes.errors import InvalidGraphError

Metadata = dict[str, Any]
"""Values of a JSON object: numbers, booleans, texts, lists and objects."""
Trigger = Literal["NODE", "ON_ENTER", "ON_EXIT"]
TRIGGERS: Final = ("NODE", "ON_ENTER", "ON_EXIT")
MAX_ID: Final = 2**32 - 1
"""Nav2 keeps ids as uint32 in the graph."""
MAX_ID_IN_MESSAGES: Final = 2**16 - 1
"""Nav2's requests and feedback have uint16 ids."""
FAR_M: Final = 1e5
"""Positions are float32, as in Nav2: farther away than this (m) their steps are 8 mm and more."""


@dataclass(frozen=True, slots=True)
class Operation:
    """What happens at a node, or when the robot enters or leaves an edge."""

    name: str
    type: str
    trigger: Trigger
    metadata: Metadata = field(default_factory=dict[str, Any])


class RouteGraph:
    """Nodes and directed edges. Indices are positions in the arrays, ids are the numbers of the file.

    Edges are sorted by their start node, in the order of the file per node: those of node i are `first[i]` to `first[i + 1]`.
    """

    def __init__(
        self,
        node_ids: NDArray[np.int64],
        xy: NDArray[np.float32],
        edge_ids: NDArray[np.int64],
        starts: NDArray[np.int32],
        ends: NDArray[np.int32],
        *,
        costs: NDArray[np.float32] | None = None,
        overridable: NDArray[np.bool_] | None = None,
        node_metadata: Mapping[int, Metadata] | None = None,
        edge_metadata: Mapping[int, Metadata] | None = None,
        node_operations: Mapping[int, Sequence[Operation]] | None = None,
        edge_operations: Mapping[int, Sequence[Operation]] | None = None,
        name: str = "",
        frame: str = "map",
        notes: Sequence[str] = (),
    ) -> None:
        """Create a graph of checked arrays; `starts` and `ends` are indices of nodes, metadata and operations go by index.

        `build_graph` and `load_graph` check what they read. `costs` are those of edges whose cost is fixed (`overridable`
        False), or that no scorer is there for.
        """
        order = np.argsort(starts, kind="stable")
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order))
        self.node_ids = node_ids
        """(n,) ids."""
        self.xy = np.ascontiguousarray(xy, np.float32)
        """(n, 2) float32 positions (m), as in Nav2."""
        self.edge_ids = edge_ids[order]
        """(m,) ids."""
        self.starts = starts[order].astype(np.int32)
        """(m,) index of the start node."""
        self.ends = ends[order].astype(np.int32)
        """(m,) index of the end node."""
        self.first = np.searchsorted(self.starts, np.arange(len(node_ids) + 1)).astype(np.int64)
        """(n + 1,) index of the first edge of each node."""
        self.costs = np.zeros(len(order), np.float32) if costs is None else costs[order]
        """(m,) cost of the file, 0 without one."""
        self.overridable = np.ones(len(order), np.bool_) if overridable is None else overridable[order]
        """(m,) True if scorers replace the cost."""
        self.node_metadata: dict[int, Metadata] = dict(node_metadata or {})
        self.edge_metadata: dict[int, Metadata] = {int(place[k]): v for k, v in (edge_metadata or {}).items()}
        self.node_operations = {k: tuple(v) for k, v in (node_operations or {}).items()}
        self.edge_operations = {int(place[k]): tuple(v) for k, v in (edge_operations or {}).items()}
        self.name = name
        self.frame = frame
        self.notes = tuple(notes)
        """What a reader should know, such as ids that Nav2's messages cannot carry."""

    def __len__(self) -> int:
        return len(self.node_ids)

    @property
    def edge_count(self) -> int:
        """Number of directed edges."""
        return len(self.edge_ids)

    @cached_property
    def index_of_node(self) -> dict[int, int]:
        """Index by id."""
        return {node: i for i, node in enumerate(self.node_ids.tolist())}

    @cached_property
    def index_of_edge(self) -> dict[int, int]:
        """Index by id; the first of edges with one id."""
        ids = self.edge_ids.tolist()
        return {edge: i for i, edge in zip(range(len(ids) - 1, -1, -1), reversed(ids))}

    def edges_of(self, ids: Collection[int]) -> NDArray[np.intp]:
        """Return the indices of all edges with these ids; ids that are not there are left out."""
        return (
            np.nonzero(np.isin(self.edge_ids, np.fromiter(ids, np.int64, len(ids))))[0] if ids else np.zeros(0, np.intp)
        )

    @cached_property
    def lengths(self) -> NDArray[np.float32]:
        """(m,) float32 lengths of the edges (m)."""
        d = self.xy[self.ends] - self.xy[self.starts]
        return np.hypot(d[:, 0], d[:, 1])

    def node(self, node_id: int) -> int:
        """Return the index of a node. Raises InvalidGraphError for an unknown id."""
        found = self.index_of_node.get(node_id)
        if found is None:
            raise InvalidGraphError(f"the graph{self._named} has no node {node_id}; {self._ids()}", node=node_id)
        return found

    def edge(self, edge_id: int) -> int:
        """Return the index of an edge. Raises InvalidGraphError for an unknown id."""
        found = self.index_of_edge.get(edge_id)
        if found is None:
            count = self.edge_count
            some = ", ".join(map(str, self.edge_ids[:5].tolist()))
            raise InvalidGraphError(
                f"the graph{self._named} has no edge {edge_id}; its {count} edges are {some}{', ..' if count > 5 else ''}",
                edge=edge_id,
            )
        return found

    def numbers(self, tag: str, default: float) -> NDArray[np.float32]:
        """(m,) float32 of a number in the metadata of the edges. Raises InvalidGraphError for another type."""
        values = np.full(self.edge_count, default, np.float32)
        for edge, metadata in self.edge_metadata.items():
            if tag in metadata:
                value = metadata[tag]
                if isinstance(value, bool) or not isinstance(value, (int, float)):
                    raise InvalidGraphError(
                        f"{tag} of edge {self.edge_ids[edge]} is {short_repr(value)}; write a number",
                        edge=int(self.edge_ids[edge]),
                        key=tag,
                    )
                values[edge] = value
        return values

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(min x, min y, max x, max y) of the nodes (m)."""
        low, high = self.xy.min(axis=0).tolist(), self.xy.max(axis=0).tolist()
        return low[0], low[1], high[0], high[1]

    @property
    def _named(self) -> str:
        return f" {self.name}" if self.name else ""

    def _ids(self) -> str:
        count = len(self)
        some = ", ".join(map(str, sorted(self.node_ids.tolist())[:5]))
        return f"its {count} nodes are {some}{', ..' if count > 5 else ''}"

    def __repr__(self) -> str:
        name = f"{self.name}: " if self.name else ""
        return f"RouteGraph({name}{len(self)} nodes, {self.edge_count} edges, frame {self.frame!r})"


def build_graph(
    nodes: Mapping[int, tuple[float, float]],
    edges: Iterable[tuple[int, int]],
    *,
    both_ways: bool = False,
    frame: str = "map",
    name: str = "",
) -> RouteGraph:
    """Return the graph of positions (m) by id, and pairs (start id, end id); edges get the ids that follow those of the nodes.

    With `both_ways`, each pair makes two edges. Raises InvalidGraphError.

        build_graph({0: (0.0, 0.0), 1: (4.0, 0.0)}, [(0, 1)], both_ways=True)
    """
    index = {node: i for i, node in enumerate(nodes)}
    pairs: list[tuple[int, int]] = []
    for start, end in edges:
        for node in (start, end):
            if node not in index:
                raise InvalidGraphError(
                    f"the edge ({start}, {end}) names the node {node}, which is not there; add it", node=node
                )
        pairs.append((index[start], index[end]))
        if both_ways:
            pairs.append((index[end], index[start]))
    if not index or not pairs:
        raise InvalidGraphError("a graph needs at least one node and one edge")
    for node, (x, y) in nodes.items():
        if not 0 <= node <= MAX_ID or not (math.isfinite(x) and math.isfinite(y)):
            raise InvalidGraphError(
                f"node {node} at ({x}, {y}) is no node; ids are 0 to {MAX_ID}, positions are finite (m)", node=node
            )
    links = np.array(pairs, np.int32)
    first_id = max(index) + 1
    return RouteGraph(
        np.array(list(index), np.int64),
        np.array(list(nodes.values()), np.float32),
        np.arange(first_id, first_id + len(links), dtype=np.int64),
        links[:, 0],
        links[:, 1],
        frame=frame,
        name=name,
        notes=id_notes(max(index), first_id + len(links) - 1),
    )


def id_notes(*largest: int) -> tuple[str, ...]:
    """Return the note for ids that Nav2's messages cannot carry."""
    top = max(largest)
    if top <= MAX_ID_IN_MESSAGES:
        return ()
    limit = f"Nav2's requests and feedback have ids up to {MAX_ID_IN_MESSAGES} (uint16)"
    return (f"the largest id is {top}: {limit} and would name other nodes; navstack has no such limit",)
