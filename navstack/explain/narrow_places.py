"""Narrow places of free space: saddles of the distance to the nearest obstacle.

The distance field has a saddle between two obstacle cells exactly if the circle over their connecting line contains no
other obstacle cell: an edge of the Gabriel graph. The Gabriel graph is part of the Delaunay triangulation, and the
circumradius of a triangle is the clearance at its circumcenter. A union-find over the triangles, from the widest edges to
the narrowest, gives the largest clearance that each side of a saddle leads to. If both sides lead to wider space, the
saddle is a narrow place; otherwise it is a rough wall. The shortest edge between two separate obstacles, if it is too
narrow for the robot, is a narrow place in any case: free-standing obstacles close together enclose no wide space. The
result depends on the cells only, not on their raster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ADJACENT = 1.5
"""Obstacle cells closer than this (cells) are neighbors: a wall, not a passage."""


@dataclass(frozen=True, slots=True)
class NarrowPlace:
    """A narrow place between two obstacle cells. Lengths in cells."""

    first: tuple[int, int]
    """ix, iy."""
    second: tuple[int, int]
    distance: float
    """Between the centers of the two cells."""
    stretch: float
    """Length of the part that is equally narrow, within one cell."""
    smaller: float
    """Size of the smaller of the two obstacles: the longer side of its box."""
    bars: tuple[tuple[tuple[int, int], tuple[int, int]], ...]
    """All pairs of obstacle cells along that part, including this pair; the robot passes between each of them."""


def narrow_places(
    blocked: NDArray[np.bool_],
    open_: NDArray[np.bool_],
    *,
    narrowest: float,
    widest: float,
    widening: float = 3.0,
    relative: float = 0.0,
    always: float = 0.0,
    smallest: float = 0.0,
) -> list[NarrowPlace]:
    """Return the narrow places of a grid `blocked` (ny, nx), the narrowest first. All lengths in cells between cell centers.

    `open_` (ny, nx) are the cells known to be free; the middle of a narrow place is one of them. The search is limited to
    distances from `narrowest` to `widest`. Space must widen on both sides, by `widening` and by the share `relative` at
    least, unless the place is the shortest connection of two obstacles (cells that touch, diagonally too, are one) and at most
    `always` long. Obstacles smaller than `smallest` form no narrow places.
    """
    sites = _surface(blocked)
    if len(sites) < 2:
        return []
    return _Search(blocked, open_, sites, narrowest, widest, widening, relative, always, smallest).run()


def _surface(blocked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (n, 2) ix, iy of the blocked cells with a neighbor that is not blocked."""
    padded = np.pad(blocked, 1, constant_values=False)
    ny, nx = blocked.shape
    inside = np.ones_like(blocked)
    for dy in range(3):
        for dx in range(3):
            inside &= padded[dy : dy + ny, dx : dx + nx]
    rows, columns = np.nonzero(blocked & ~inside)
    return np.column_stack((columns, rows))


class _Search:
    """The Delaunay triangulation of the obstacle cells, and the searches over its edges."""

    def __init__(
        self,
        blocked: NDArray[np.bool_],
        open_: NDArray[np.bool_],
        sites: NDArray[np.int64],
        narrowest: float,
        widest: float,
        widening: float,
        relative: float,
        always: float,
        smallest: float,
    ) -> None:
        from scipy import ndimage
        from scipy.spatial import Delaunay

        self.blocked, self.open = blocked, open_
        self.narrowest, self.widest = narrowest, widest
        self.always, self.smallest = always, smallest
        self.widening, self.relative = widening, relative
        self.sites = sites
        # four distant points, so that the space outside the convex hull of the obstacles counts as wide
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
        """Collect the edges between triangles: ends, adjacent triangles, and clearance for crossing them (cells)."""
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
        gabriel, strict = np.ones(len(mine), bool), np.ones(len(mine), bool)
        for apex in (tip, far_tip):
            to_p, to_q = self.points[p] - self.points[apex], self.points[q] - self.points[apex]
            within = (to_p * to_q).sum(axis=1)
            gabriel &= within >= -1e-9
            strict &= within > 1e-9
        real = (p < len(self.sites)) & (q < len(self.sites))
        span = self.points[p] - self.points[q]
        length = np.hypot(span[:, 0], span[:, 1])
        through = np.where(gabriel, length / 2.0, np.minimum(self.radius[mine], self.radius[other]))
        saddle = gabriel & real
        middle = (self.points[p] + self.points[q]) / 2.0
        ix, iy = (np.floor(middle[:, k] + 0.5).astype(np.int64) for k in (0, 1))
        ix, iy = ix.clip(0, self.blocked.shape[1] - 1), iy.clip(0, self.blocked.shape[0] - 1)
        # no passage between neighboring cells or inside an obstacle
        shut = saddle & ((length < _ADJACENT) | self.blocked[iy, ix])
        keep = ~shut
        self.p, self.q, self.mine, self.other = p[keep], q[keep], mine[keep], other[keep]
        self.through, self.length, self.middle = through[keep], length[keep], middle[keep]
        self.saddle, self.strict = saddle[keep], strict[keep]
        self.opening = self.saddle & self.open[iy, ix][keep]
        self.wanted = self.opening & (self.length >= self.narrowest) & (self.length <= self.widest)

    def run(self) -> list[NarrowPlace]:
        """Return the narrow places, the narrowest first."""
        size = self._obstacle_sizes()
        places: list[NarrowPlace] = []
        covered: set[int] = set()
        wide = self._between_wide_spaces()
        for number, edge in enumerate((*wide, *self._between_obstacles())):
            if number >= len(wide) and edge in covered:
                continue
            stretch = self._stretch(edge)
            covered.update(stretch.tolist())
            # the searches may visit equal edges between the same walls in different order
            least = stretch[np.abs(self.length[stretch] - self.length[edge]) < 1e-9]
            smaller = float(size[least].min())
            if smaller >= self.smallest:
                places.append(self._placed(edge, stretch, least, smaller))
        return sorted(places, key=lambda place: (place.distance, place.first, place.second))

    def _between_obstacles(self) -> list[int]:
        """Return the shortest saddles between every two obstacles, up to the length `always`."""
        # all of equal length, and none that another cell shares: the result must not depend on the triangulation
        edges = np.flatnonzero(self.saddle & self.strict)
        a, b = self.group[self.p[edges]], self.group[self.q[edges]]
        edges, a, b = (values[a != b] for values in (edges, a, b))
        _, pair = np.unique(np.minimum(a, b) * len(self.boxes) + np.maximum(a, b), return_inverse=True)
        least = np.full(pair.max(initial=-1) + 1, np.inf)
        np.minimum.at(least, pair, self.length[edges])
        shortest = edges[(self.length[edges] <= least[pair] + 1e-9) & (self.length[edges] <= self.always)]
        shortest = shortest[self.wanted[shortest]]
        return shortest[np.argsort(self.length[shortest], kind="stable")].tolist()

    def _between_wide_spaces(self) -> list[int]:
        """Saddles with wider space on both sides, reachable without crossing a narrower edge."""
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

    def _obstacle_sizes(self) -> NDArray[np.float64]:
        """Size of the smaller obstacle at every saddle: of its box, with all obstacles nearer to it than the saddle is long."""
        edges = np.flatnonzero(self.saddle)
        edges = edges[np.argsort(self.length[edges], kind="stable")]
        union = _Union(len(self.boxes))
        boxes: list[list[float]] = self.boxes.tolist()
        sizes = np.full(len(self.length), np.inf)
        for edge in edges.tolist():
            a = union.find(int(self.group[self.p[edge]]))
            b = union.find(int(self.group[self.q[edge]]))
            one, two = boxes[a], boxes[b]
            sizes[edge] = min(max(box[2] - box[0], box[3] - box[1]) + 1.0 for box in (one, two))
            if a != b:
                root = union.join(a, b)
                boxes[root] = [min(one[0], two[0]), min(one[1], two[1]), max(one[2], two[2]), max(one[3], two[3])]
        return sizes

    def _placed(self, edge: int, edges: NDArray[np.int64], least: NDArray[np.int64], smaller: float) -> NarrowPlace:
        """Return the narrow place of a stretch: its edge closest to the middle of the stretch."""
        middles = self.middle[edges]
        low, high = middles.min(axis=0), middles.max(axis=0)
        off = np.hypot(*(self.middle[least] - (low + high) / 2.0).T)
        best = int(least[int(off.argmin())])
        stretch = float(np.hypot(*(high - low)))
        bars = tuple(sorted(self._ends(e) for e in edges.tolist()))
        return NarrowPlace(*self._ends(best), float(self.length[edge]), stretch, smaller, bars)

    def _ends(self, edge: int) -> tuple[tuple[int, int], tuple[int, int]]:
        first, second = sorted((x, y) for x, y in self.sites[[self.p[edge], self.q[edge]]].tolist())
        return first, second

    def _stretch(self, edge: int) -> NDArray[np.int64]:
        """Openings connected with `edge` that are at most one cell wider, without crossing a narrower edge."""
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
        """Return (edges, first): the edges of triangle t are `edges[first[t] : first[t + 1]]`."""
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
        """Return the representative of the set of x."""
        parent = self._parent
        while parent[x] != x:
            parent[x] = parent[parent[x]]
            x = parent[x]
        return x

    def join(self, a: int, b: int) -> int:
        """Join the sets of two representatives and returns the new representative."""
        low, high = min(a, b), max(a, b)
        self._parent[high] = low
        return low
