"""A route graph from a map: the skeleton of the space where the robot fits, as straight edges, with their clearance.

The skeleton keeps the connections of that space: two places that the robot's circle can drive between are connected in the graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, OccupancyGrid
from navstack.routes.clearance import ridge, segment_clearances, square_distances, thin
from navstack.routes.errors import InvalidGraphError
from navstack.routes.graph import Metadata, RouteGraph, id_notes

OCCUPIED = 65
"""Occupancy (percent) of an obstacle, as map_server's default threshold."""
_CENTERED = 0.8
"""An edge keeps this share of the smallest clearance of the cells that it replaces."""

Cell = tuple[int, int]
Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """Obstacles of a map and the distances to them, in cells; around the map is a border of obstacles."""

    occupied: NDArray[np.bool_]
    distances: NDArray[np.float64]
    resolution: float
    to_map: Callable[[Points], Points]
    """Returns the positions (m) of points (n, 2) in cells."""
    to_cells: Callable[[Points], Points]
    frame: str

    @staticmethod
    def of(grid: OccupancyGrid, *, allow_unknown: bool = False) -> FreeSpace:
        """Return the free space of a map; unknown cells are obstacles unless `allow_unknown`."""
        blocked = grid.data >= OCCUPIED
        if not allow_unknown:
            blocked |= grid.data < 0
        occupied = np.pad(blocked, 1, constant_values=True)
        distances = np.zeros(occupied.shape)
        square_distances(occupied, distances)
        g, yaw = grid.geometry, grid.origin_yaw
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        corner = np.array([g.origin_x, g.origin_y])
        return FreeSpace(
            occupied,
            distances,
            g.resolution,
            lambda cells: (cells - 1.0) * g.resolution @ turn + corner,
            lambda points: (points - corner) @ turn.T / g.resolution + 1.0,
            grid.frame,
        )

    def clearances(self, starts: Points, ends: Points) -> NDArray[np.float64]:
        """Return the distances (m) from segments between points (k, 2) in cells to the nearest obstacle."""
        found = np.zeros(len(starts))
        segment_clearances(self.occupied, self.distances, np.hstack([starts, ends]), found)
        return found * self.resolution


def graph_from_map(
    grid: OccupancyGrid, radius: float, *, allow_unknown: bool = False, spacing: float = 5.0, name: str = ""
) -> RouteGraph:
    """Return a graph whose edges keep `radius` (m) from obstacles, both ways, at most `spacing` (m) long.

    Take the radius of the circle around the footprint, so that the robot can turn everywhere. The metadata of nodes and edges
    has their `clearance` (m). A part of the space in which the robot can only turn has no node. Raises InputError, and
    InvalidGraphError for a map without space.
    """
    if not (math.isfinite(radius) and radius > 0.0 and math.isfinite(spacing) and spacing > 0.0):
        raise InputError(
            f"radius ({radius} m) and spacing ({spacing} m) must be above 0", radius=radius, spacing=spacing
        )
    space = FreeSpace.of(grid, allow_unknown=allow_unknown)
    cells = radius / space.resolution
    # between two such cells the way keeps the radius: a step of sqrt(2) past a corner comes nearer by this
    needed = math.sqrt(cells * cells + 0.5) + 1e-4
    skeleton = _Skeleton(space, needed)
    lines: list[NDArray[np.float64]] = []
    for chain in skeleton.chains():
        lines += _straight(space, np.array(chain, np.float64) + 0.5, needed, spacing / space.resolution)
    if not lines:
        raise InvalidGraphError(
            f"the map has no way that keeps {radius:g} m from obstacles; reduce the clearance, or allow unknown space",
            radius=radius,
        )
    return _graph_of(space, lines, name)


class _Skeleton:
    """Cells of the skeleton, as chains from junction to junction."""

    def __init__(self, space: FreeSpace, needed: float) -> None:
        """`needed` is the smallest distance of a cell to obstacles (cells)."""
        self.distances = space.distances
        free = space.distances >= needed
        anchors = np.zeros(free.shape, np.bool_)
        ridge(space.distances, needed, anchors)
        order = np.nonzero(free.reshape(-1))[0]
        order = order[np.argsort(space.distances.reshape(-1)[order], kind="stable")]
        kept = free.copy()
        thin(kept, anchors, order, False)
        thin(kept, np.zeros_like(anchors), order, True)  # ridges that are two cells wide
        self.cells: set[Cell] = {(x, y) for y, x in np.argwhere(kept).tolist()}
        self._prune()
        self._extend(free)

    def neighbors(self, cell: Cell) -> list[Cell]:
        """Return the cells of the skeleton beside a cell; diagonal ones only where no way around the corner is there."""
        x, y = cell
        cells = self.cells
        found = [c for c in ((x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)) if c in cells]
        for dx, dy in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            if (x + dx, y + dy) in cells and (x + dx, y) not in cells and (x, y + dy) not in cells:
                found.append((x + dx, y + dy))
        return found

    def chains(self) -> list[list[Cell]]:
        """Return the chains of cells between junctions and ends, and closed ones."""
        links = {cell: self.neighbors(cell) for cell in sorted(self.cells)}
        knots = [cell for cell, others in links.items() if len(others) != 2]
        found: list[list[Cell]] = []
        done: set[tuple[Cell, Cell]] = set()
        seen: set[Cell] = set(knots)
        for knot in knots:
            for step in links[knot]:
                if (knot, step) in done:
                    continue
                chain = self._follow(links, knot, step)
                done |= {(chain[0], chain[1]), (chain[-1], chain[-2])}
                seen.update(chain)
                found.append(chain)
        for cell, others in links.items():
            if cell not in seen:
                chain = self._follow(links, cell, others[0], closed=True)
                seen.update(chain)
                found.append(chain)
        return found

    @staticmethod
    def _follow(links: dict[Cell, list[Cell]], start: Cell, step: Cell, *, closed: bool = False) -> list[Cell]:
        chain = [start, step]
        while len(links[chain[-1]]) == 2 and not (closed and chain[-1] == start):
            a, b = links[chain[-1]]
            chain.append(b if a == chain[-2] else a)
        return chain

    def _prune(self) -> None:
        """Remove side branches that end within the circle around their junction: the walls' roughness makes them."""
        while True:
            removed: set[Cell] = set()
            for chain in self.chains():
                ends = [len(self.neighbors(chain[0])), len(self.neighbors(chain[-1]))]
                if sorted(ends)[0] != 1 or sorted(ends)[1] < 3:
                    continue
                chain = chain if ends[1] == 1 else chain[::-1]
                (x0, y0), (x1, y1) = chain[0], chain[-1]
                if math.hypot(x1 - x0, y1 - y0) < self.distances[y0, x0]:
                    removed.update(chain[1:])
            if not removed:
                return
            self.cells -= removed

    def _extend(self, free: NDArray[np.bool_]) -> None:
        """Give a part that is one cell, such as a square room, a straight line to its farthest corner in sight."""
        alone = [cell for cell in sorted(self.cells) if not self.neighbors(cell)]
        if not alone:
            return
        from scipy.ndimage import find_objects, label  # slow import

        labels, _ = cast("tuple[NDArray[np.int32], int]", label(free, np.ones((3, 3))))
        boxes = find_objects(labels)
        for x, y in alone:
            part = int(labels[y, x])
            box = boxes[part - 1]
            ys, xs = np.nonzero(labels[box] == part)
            ys, xs = ys + box[0].start, xs + box[1].start
            for k in np.argsort(-np.hypot(xs - x, ys - y), kind="stable")[:256].tolist():
                line = _cells_between((x, y), (int(xs[k]), int(ys[k])))
                if len(line) > 1 and all(free[cy, cx] for cx, cy in line):
                    self.cells.update(line)
                    break


def _cells_between(a: Cell, b: Cell) -> list[Cell]:
    count = max(abs(b[0] - a[0]), abs(b[1] - a[1]))
    return (
        [(a[0] + round((b[0] - a[0]) * k / count), a[1] + round((b[1] - a[1]) * k / count)) for k in range(count + 1)]
        if count
        else [a]
    )


def _straight(space: FreeSpace, chain: Points, needed: float, longest: float) -> list[Points]:
    """Return the segments (2, 2) in cells that replace a chain (n, 2) of cells: as few as keep their distance to obstacles."""
    radius = math.sqrt(max(needed * needed - 0.5, 0.0))
    own = space.distances[chain[:, 1].astype(np.int64), chain[:, 0].astype(np.int64)]
    waiting = [(0, len(chain) - 1)]
    done: list[Points] = []
    while waiting:
        pairs = np.array(waiting)
        starts, ends = chain[pairs[:, 0]], chain[pairs[:, 1]]
        found = space.clearances(starts, ends) / space.resolution
        split: list[tuple[int, int]] = []
        for (i, j), clearance, a, b in zip(waiting, found.tolist(), starts, ends, strict=True):
            long = float(np.hypot(*(b - a)))
            if j - i == 1 or (
                0.0 < long <= longest and clearance >= max(radius, _CENTERED * float(own[i : j + 1].min()))
            ):
                done.append(np.array([a, b]))
                continue
            away = chain[i + 1 : j] - a
            aside = np.abs(away[:, 0] * (b - a)[1] - away[:, 1] * (b - a)[0]) if long > 0.0 else np.hypot(*away.T)
            # the farthest cell from the line; of a straight chain the middle
            k = int(aside.argmax()) if aside.max() > max(long, 1.0) else (j - i) // 2 - 1
            split += [(i, i + 1 + k), (i + 1 + k, j)]
        waiting = split
    return done


def _graph_of(space: FreeSpace, lines: list[Points], name: str) -> RouteGraph:
    segments = np.array(lines)
    places, index = np.unique(segments.reshape(-1, 2), axis=0, return_inverse=True)
    pairs = np.unique(np.sort(index.reshape(-1, 2), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    xy = space.to_map(places).astype(np.float32)
    exact = space.to_cells(xy.astype(np.float64))
    clearances = space.clearances(exact[pairs[:, 0]], exact[pairs[:, 1]])
    of_nodes = space.clearances(exact, exact)
    links = np.stack([pairs, pairs[:, ::-1]], axis=1).reshape(-1, 2)
    count = len(places)

    def metadata(values: NDArray[np.float64]) -> dict[int, Metadata]:
        return {i: {"clearance": math.floor(value * 1e4) / 1e4} for i, value in enumerate(values.tolist())}

    return RouteGraph(
        np.arange(count, dtype=np.int64),
        xy,
        np.arange(count, count + len(links), dtype=np.int64),
        links[:, 0].astype(np.int32),
        links[:, 1].astype(np.int32),
        node_metadata=metadata(of_nodes),
        edge_metadata=metadata(np.repeat(clearances, 2)),
        frame=space.frame,
        name=name,
        notes=id_notes(count + len(links) - 1),
    )
