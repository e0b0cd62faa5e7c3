"""Where free space is narrow: the saddles of the distance to the nearest obstacle.

Between two obstacle cells lies a saddle of the distance field exactly when the circle over their connecting line holds no
other obstacle cell (an edge of the Gabriel graph); such edges are among those of the Delaunay triangulation, whose
triangles stand for the places between (their circumradius is the clearance there). Walking from triangle to triangle over
the widest edges first says how much wide space each side of a saddle leads to: where both lead to more, it is a narrow
place; where one does not, it is a roughness of a wall. Nothing here depends on the raster but the cells themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ADJACENT = 1.5
"""Cells nearer than this (cells) touch: a wall, not an opening."""


@dataclass(frozen=True, slots=True)
class NarrowPlace:
    """A narrow place, in cells: the two obstacle cells it lies between, and how far the narrowness stretches."""

    first: tuple[int, int]
    """ix, iy."""
    second: tuple[int, int]
    distance: float
    """Between their centres (cells)."""
    stretch: float
    """Length of the part that is as narrow, up to a cell (cells)."""
    bars: tuple[tuple[tuple[int, int], tuple[int, int]], ...]
    """All pairs of obstacle cells along that part, this one among them: whoever passes, passes between each."""


def narrow_places(
    blocked: NDArray[np.bool_],
    open_: NDArray[np.bool_],
    *,
    narrowest: float,
    widest: float,
    widening: float = 3.0,
    relative: float = 0.0,
    clutter: float = 0.0,
) -> list[NarrowPlace]:
    """The narrow places of a grid `blocked` (ny, nx), the narrowest first; all lengths in cells between cell centres.

    `open_`: cells that are known to be free; the middle of a narrow place lies in one. Kept are distances `narrowest` ..
    `widest` beyond which it gets wider on both sides, by `widening` and by the share `relative` at least. A group of
    obstacle cells smaller than `clutter` does not make a narrow place with what stands beside it: there is a way around it.
    """
    sites = _surface(blocked)
    if len(sites) < 2:
        return []
    return _Search(blocked, open_, sites, narrowest, widest, widening, relative, clutter).run()


def _surface(blocked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(n, 2) ix, iy of the blocked cells that have a neighbour that is not."""
    padded = np.pad(blocked, 1, constant_values=False)
    ny, nx = blocked.shape
    inside = np.ones_like(blocked)
    for dy in range(3):
        for dx in range(3):
            inside &= padded[dy : dy + ny, dx : dx + nx]
    rows, columns = np.nonzero(blocked & ~inside)
    return np.column_stack((columns, rows))


class _Search:
    """The triangulation, and the passes over its edges."""

    def __init__(
        self,
        blocked: NDArray[np.bool_],
        open_: NDArray[np.bool_],
        sites: NDArray[np.int64],
        narrowest: float,
        widest: float,
        widening: float,
        relative: float,
        clutter: float,
    ) -> None:
        from scipy import ndimage
        from scipy.spatial import Delaunay

        self.blocked, self.open = blocked, open_
        self.narrowest, self.widest, self.clutter = narrowest, widest, clutter
        self.widening, self.relative = widening, relative
        self.sites = sites
        # four points far outside: the hull, and all that lies beyond the last obstacle, becomes wide space
        ny, nx = blocked.shape
        far = 10.0 * (nx + ny)
        corners = np.array([[-far, -far], [far + 1.0, -far], [-far, far + 2.0], [far + 3.0, far + 1.0]])
        self.points = np.concatenate((sites.astype(np.float64), corners))
        mesh: Any = Delaunay(self.points)
        self.triangles: NDArray[np.int64] = mesh.simplices.astype(np.int64)
        neighbors: NDArray[np.int64] = mesh.neighbors.astype(np.int64)
        label: Any = ndimage.label
        labels, count = label(blocked, np.ones((3, 3), int))
        self.group: NDArray[np.int64] = labels[sites[:, 1], sites[:, 0]].astype(np.int64) - 1
        self._measure_groups(int(count))
        self._collect_edges(neighbors)

    def _measure_groups(self, count: int) -> None:
        self.boxes = np.empty((count, 4))
        self.boxes[:, :2], self.boxes[:, 2:] = np.inf, -np.inf
        for axis in (0, 1):
            np.minimum.at(self.boxes[:, axis], self.group, self.sites[:, axis])
            np.maximum.at(self.boxes[:, 2 + axis], self.group, self.sites[:, axis])

    def _collect_edges(self, neighbors: NDArray[np.int64]) -> None:
        """Every edge between two triangles: its ends, its sides, the clearance (cells) at which one gets across."""
        corner = self.points[self.triangles]
        a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
        sides = [np.hypot(*(b - c).T), np.hypot(*(c - a).T), np.hypot(*(a - b).T)]
        area = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
        self.radius = sides[0] * sides[1] * sides[2] / np.maximum(2.0 * area, 1e-12)
        mine, opposite = np.nonzero(neighbors > np.arange(len(neighbors))[:, None])
        other = neighbors[mine, opposite]
        p = self.triangles[mine, (opposite + 1) % 3]
        q = self.triangles[mine, (opposite + 2) % 3]
        tip = self.triangles[mine, opposite]
        far_tip = self.triangles[other].sum(axis=1) - p - q
        gabriel = np.ones(len(mine), bool)
        for apex in (tip, far_tip):
            to_p, to_q = self.points[p] - self.points[apex], self.points[q] - self.points[apex]
            gabriel &= (to_p * to_q).sum(axis=1) >= -1e-9
        real = (p < len(self.sites)) & (q < len(self.sites))
        span = self.points[p] - self.points[q]
        length = np.hypot(span[:, 0], span[:, 1])
        through = np.where(gabriel, length / 2.0, np.minimum(self.radius[mine], self.radius[other]))
        saddle = gabriel & real
        middle = (self.points[p] + self.points[q]) / 2.0
        ix, iy = (np.floor(middle[:, k] + 0.5).astype(np.int64) for k in (0, 1))
        ix, iy = ix.clip(0, self.blocked.shape[1] - 1), iy.clip(0, self.blocked.shape[0] - 1)
        # between touching cells, and inside of an obstacle, there is no way
        shut = saddle & ((length < _ADJACENT) | self.blocked[iy, ix])
        keep = ~shut
        self.p, self.q, self.mine, self.other = p[keep], q[keep], mine[keep], other[keep]
        self.through, self.length, self.middle = through[keep], length[keep], middle[keep]
        self.saddle = saddle[keep]
        self.opening = self.saddle & self.open[iy, ix][keep]
        self.wanted = self.opening & (self.length >= self.narrowest) & (self.length <= self.widest)

    def run(self) -> list[NarrowPlace]:
        """The narrow places, the narrowest first."""
        found = self._between_wide_spaces()
        beside_clutter = self._beside_clutter()
        places: list[NarrowPlace] = []
        for edge in found:
            stretch = self._stretch(edge)
            # of equal edges between the same two walls, each pass met another one first
            least = stretch[np.abs(self.length[stretch] - self.length[edge]) < 1e-9]
            if beside_clutter.isdisjoint(least.tolist()):
                places.append(self._placed(edge, stretch, least))
        return sorted(places, key=lambda place: (place.distance, place.first, place.second))

    def _between_wide_spaces(self) -> list[int]:
        """Saddles both sides of which lead to wider space without crossing anything narrower."""
        order = np.argsort(-self.through, kind="stable")
        union = _Union(len(self.triangles))
        peak: list[float] = self.radius.tolist()
        mine, other = self.mine.tolist(), self.other.tolist()
        wanted: list[bool] = self.wanted.tolist()
        found: list[int] = []
        enough = (self.through + np.maximum(self.widening / 2.0, self.relative * self.through)).tolist()
        for edge in order.tolist():
            a, b = union.find(mine[edge]), union.find(other[edge])
            if wanted[edge] and min(peak[a], peak[b]) >= enough[edge]:
                found.append(edge)
            if a != b:
                top = max(peak[a], peak[b])
                peak[union.join(a, b)] = top
        return found

    def _beside_clutter(self) -> set[int]:
        """Saddles at which a growing obstacle would take in one that is no more than clutter."""
        edges = np.flatnonzero(self.saddle)
        edges = edges[np.argsort(self.length[edges], kind="stable")]
        union = _Union(len(self.boxes))
        boxes: list[list[float]] = self.boxes.tolist()
        beside: set[int] = set()
        for edge in edges.tolist():
            a = union.find(int(self.group[self.p[edge]]))
            b = union.find(int(self.group[self.q[edge]]))
            if a == b:
                continue
            size = min(max(box[2] - box[0], box[3] - box[1]) + 1.0 for box in (boxes[a], boxes[b]))
            if size < self.clutter:
                beside.add(edge)
            one, two = boxes[a], boxes[b]
            root = union.join(a, b)
            boxes[root] = [min(one[0], two[0]), min(one[1], two[1]), max(one[2], two[2]), max(one[3], two[3])]
        return beside

    def _placed(self, edge: int, edges: NDArray[np.int64], least: NDArray[np.int64]) -> NarrowPlace:
        """In a corridor that is as narrow over a stretch, the middle of the stretch."""
        middles = self.middle[edges]
        low, high = middles.min(axis=0), middles.max(axis=0)
        off = np.hypot(*(self.middle[least] - (low + high) / 2.0).T)
        best = int(least[int(off.argmin())])
        stretch = float(np.hypot(*(high - low)))
        bars = tuple(sorted(self._ends(e) for e in edges.tolist()))
        return NarrowPlace(*self._ends(best), float(self.length[edge]), stretch, bars)

    def _ends(self, edge: int) -> tuple[tuple[int, int], tuple[int, int]]:
        first, second = sorted((x, y) for x, y in self.sites[[self.p[edge], self.q[edge]]].tolist())
        return first, second

    def _stretch(self, edge: int) -> NDArray[np.int64]:
        """The openings up to a cell wider that one gets to from `edge` in such narrowness, through nothing narrower."""
        least = float(self.through[edge]) - 1e-9
        limit = least + 0.5
        edges_of = self._edges_of()
        seen: set[int] = set()
        todo = [int(self.mine[edge]), int(self.other[edge])]
        found = {edge}
        while todo:
            triangle = todo.pop()
            if triangle in seen or self.radius[triangle] > limit:
                continue
            seen.add(triangle)
            for e in edges_of[0][edges_of[1][triangle] : edges_of[1][triangle + 1]].tolist():
                if self.through[e] < least:
                    continue
                if self.opening[e]:
                    found.add(e)
                todo += [int(self.mine[e]), int(self.other[e])]
        return np.array(sorted(found), np.int64)

    def _edges_of(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Edges of every triangle: those of triangle t are `edges[first[t] : first[t + 1]]`."""
        if not hasattr(self, "_by_triangle"):
            sides = np.concatenate((self.mine, self.other))
            order = np.argsort(sides, kind="stable")
            first = np.searchsorted(sides[order], np.arange(len(self.triangles) + 1))
            self._by_triangle = (order % len(self.mine), first)
        return self._by_triangle


class _Union:
    """Disjoint sets of 0 .. n - 1."""

    def __init__(self, n: int) -> None:
        self._parent = list(range(n))

    def find(self, x: int) -> int:
        """The representative of x's set."""
        parent = self._parent
        while parent[x] != x:
            parent[x] = parent[parent[x]]
            x = parent[x]
        return x

    def join(self, a: int, b: int) -> int:
        """Joins the sets of two representatives; the new one."""
        low, high = min(a, b), max(a, b)
        self._parent[high] = low
        return low
