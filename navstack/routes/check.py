"""Checks of a route graph: what cannot be reached, one-way traps, edges through walls or too narrow for the footprint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint, OccupancyGrid, Pose2D
from navstack.routes.from_map import FreeSpace
from navstack.routes.graph import RouteGraph

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GraphFinding:
    """Something wrong with a graph."""

    rule: str
    severity: Literal["error", "warning"]
    message: str
    nodes: tuple[int, ...] = ()
    """Ids."""
    edges: tuple[int, ...] = ()
    """Ids."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        ids = {"nodes": list(self.nodes), "edges": list(self.edges)}
        return {"rule": self.rule, "severity": self.severity, "message": self.message, **ids}


def check_graph(
    graph: RouteGraph,
    grid: OccupancyGrid | None = None,
    footprint: Footprint | None = None,
    *,
    allow_unknown: bool = False,
) -> list[GraphFinding]:
    """Return what is wrong with a graph: its connections, costs and ids; with a map and a footprint also its edges' room.

    Errors: nodes without edges, nodes that cannot be reached, one-way traps, edges through obstacles, off the map or too narrow.
    Warnings: parts that are not connected, edges that only fit along their direction, useless edges, notes of the file.
    """
    found = [*_connections(graph), *_edges(graph)]
    if grid is not None:
        found += _room(graph, grid, footprint or Footprint.from_radius(1e-3), allow_unknown)
    found += [GraphFinding("note", "warning", note) for note in graph.notes]
    return sorted(found, key=lambda finding: finding.severity != "error")


def _connections(graph: RouteGraph) -> Iterator[GraphFinding]:
    from scipy.sparse import csr_matrix  # slow import
    from scipy.sparse.csgraph import connected_components

    count = len(graph)
    matrix = csr_matrix((np.ones(graph.edge_count), (graph.starts, graph.ends)), (count, count))
    with_edges = np.zeros(count, np.bool_)
    with_edges[graph.starts] = with_edges[graph.ends] = True
    if not with_edges.all():
        yield _of_nodes(graph, ~with_edges, "no-edges", "error", "have no edges", "connect or remove them")
    _, parts = connected_components(matrix, directed=False)
    sizes = np.bincount(parts[with_edges], minlength=parts.max() + 1)
    main = int(sizes.argmax())
    for part in np.nonzero(sizes)[0].tolist():
        if part != main:
            where = f"have no edge to the other {count - int(sizes[part])} nodes"
            yield _of_nodes(
                graph,
                (parts == part) & with_edges,
                "separate",
                "warning",
                where,
                "connect them if a robot is to go there",
            )
    _, cycles = connected_components(matrix, directed=True, connection="strong")
    for part in np.nonzero(sizes)[0].tolist():
        inside = (parts == part) & with_edges
        core = cycles == np.bincount(cycles[inside]).argmax()
        reached = _reached(graph, core)
        back = _reached(graph, core, backwards=True)
        if (inside & ~reached).any():
            yield _of_nodes(
                graph,
                inside & ~reached,
                "unreachable",
                "error",
                "cannot be reached from the others",
                "add edges that lead there",
            )
        if (inside & reached & ~back).any():
            yield _of_nodes(
                graph,
                inside & reached & ~back,
                "one-way-trap",
                "error",
                "can be reached, but no edge leads back",
                "add edges back",
            )


def _reached(graph: RouteGraph, begin: NDArray[np.bool_], *, backwards: bool = False) -> NDArray[np.bool_]:
    """Return (n,) True for the nodes that edges lead to from the nodes `begin`, these included."""
    sources, targets = (graph.ends, graph.starts) if backwards else (graph.starts, graph.ends)
    order = np.argsort(sources, kind="stable")
    first = np.searchsorted(sources[order], np.arange(len(graph) + 1)).tolist()
    targets = targets[order].tolist()
    reached = begin.copy()
    waiting = np.nonzero(begin)[0].tolist()
    while waiting:
        node = waiting.pop()
        for other in targets[first[node] : first[node + 1]]:
            if not reached[other]:
                reached[other] = True
                waiting.append(other)
    return reached


def _edges(graph: RouteGraph) -> Iterator[GraphFinding]:
    loops = graph.starts == graph.ends
    if loops.any():
        yield _of_edges(graph, loops, "loop", "warning", "end where they start", "remove them")
    costless = ~graph.overridable & ~(graph.costs > 0.0)
    if costless.any():
        yield _of_edges(
            graph,
            costless,
            "no-cost",
            "error",
            "have no cost, and no scorer may give them one",
            "write cost, or overridable: true",
        )


def _room(graph: RouteGraph, grid: OccupancyGrid, footprint: Footprint, allow_unknown: bool) -> Iterator[GraphFinding]:
    space = FreeSpace.of(grid, allow_unknown=allow_unknown)
    cells = space.to_cells(graph.xy.astype(np.float64))
    ny, nx = space.occupied.shape
    off = (cells < 1.0).any(axis=1) | (cells[:, 0] > nx - 1) | (cells[:, 1] > ny - 1)
    outside = off[graph.starts] | off[graph.ends]
    if outside.any():
        yield _of_edges(
            graph, outside, "off-the-map", "error", "leave the map", "move their nodes, or check origin and frame"
        )
    inside = np.nonzero(~outside)[0]
    a, b = cells[graph.starts[inside]], cells[graph.ends[inside]]
    clearance = np.full(graph.edge_count, np.inf)
    clearance[inside] = space.clearances(a, b)
    wall = clearance <= 0.0
    if wall.any() and not allow_unknown:
        known = FreeSpace.of(grid, allow_unknown=True)
        free = np.full(graph.edge_count, 0.0)
        free[inside] = known.clearances(a, b)
        unknown = wall & (free > 0.0)
        if unknown.any():
            yield _of_edges(
                graph, unknown, "unknown", "error", "run through unknown space", "move them, or allow unknown space"
            )
        wall &= ~unknown
    if wall.any():
        yield _of_edges(
            graph, wall, "wall", "error", "run through an obstacle of the map", "move their nodes, or remove them"
        )
    narrow = (clearance > 0.0) & (clearance < footprint.inscribed_radius)
    open_ = (clearance >= footprint.inscribed_radius) & (clearance < footprint.circumscribed_radius)
    tight = np.zeros(graph.edge_count, np.bool_)
    for edge in np.nonzero(open_)[0].tolist():
        fits = _fits_along(space, footprint, cells[graph.starts[edge]], cells[graph.ends[edge]])
        (tight if fits else narrow)[edge] = True
    if narrow.any():
        least = float(clearance[narrow].min())
        room = f"least clearance {least:.3f} m, inscribed radius {footprint.inscribed_radius:.3f} m"
        what = f"are too narrow for the footprint ({room})"
        yield _of_edges(graph, narrow, "too-narrow", "error", what, "move their nodes, or remove them")
    if tight.any():
        what = f"fit only along their direction: the robot cannot turn there (it needs {footprint.circumscribed_radius:.3f} m)"
        yield _of_edges(graph, tight, "no-room-to-turn", "warning", what, "keep nodes with turns out of them")


def _fits_along(space: FreeSpace, footprint: Footprint, a: Points, b: Points) -> bool:
    """Return True if the footprint, heading along the segment from `a` to `b` (cells), touches no obstacle."""
    yaw = float(np.arctan2(*(b - a)[::-1]))
    size = space.resolution
    outlines = [footprint.at(Pose2D(float(p[0]) * size, float(p[1]) * size, yaw)) / size for p in (a, b)]
    swept = shapely.MultiPoint(np.concatenate(outlines)).convex_hull
    x0, y0, x1, y1 = (int(v) for v in swept.bounds)
    ys, xs = np.nonzero(space.occupied[max(y0, 0) : y1 + 1, max(x0, 0) : x1 + 1])
    xs, ys = xs + max(x0, 0), ys + max(y0, 0)
    return not bool(shapely.intersects(swept, shapely.box(xs, ys, xs + 1, ys + 1)).any())


def _of_nodes(
    graph: RouteGraph, chosen: NDArray[np.bool_], rule: str, severity: Any, what: str, fix: str
) -> GraphFinding:
    ids = tuple(graph.node_ids[chosen].tolist())
    x, y = graph.xy[int(chosen.argmax())].tolist()
    return GraphFinding(
        rule,
        severity,
        f"{_listed('node', ids)} at ({x:.2f}, {y:.2f}){' ..' if len(ids) > 1 else ''} {_verb(what, ids)}; {fix}",
        ids,
    )


def _of_edges(
    graph: RouteGraph, chosen: NDArray[np.bool_], rule: str, severity: Any, what: str, fix: str
) -> GraphFinding:
    ids = tuple(graph.edge_ids[chosen].tolist())
    edge = int(chosen.argmax())
    a, b = int(graph.node_ids[graph.starts[edge]]), int(graph.node_ids[graph.ends[edge]])
    between = f"(from node {a} to {b}{', ..' if len(ids) > 1 else ''})"
    return GraphFinding(rule, severity, f"{_listed('edge', ids)} {between} {_verb(what, ids)}; {fix}", (), ids)


def _listed(kind: str, ids: tuple[int, ...]) -> str:
    some = ", ".join(map(str, ids[:6])) + (", .." if len(ids) > 6 else "")
    return f"{kind} {some}" if len(ids) == 1 else f"{len(ids)} {kind}s ({some})"


def _verb(what: str, ids: tuple[int, ...]) -> str:
    """Return the words for one or several."""
    first, _, rest = what.partition(" ")
    singular = {
        "have": "has",
        "are": "is",
        "end": "ends",
        "leave": "leaves",
        "run": "runs",
        "fit": "fits",
        "can": "can",
    }
    return f"{singular.get(first, first)} {rest}" if len(ids) == 1 else what
