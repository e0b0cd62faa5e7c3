"""What can be covered: where the footprint can stand, and what a tool reaches from there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import LETHAL, UNKNOWN, Costmap, Footprint, GridGeometry, Pose2D
from navstack.coverage.errors import InvalidCoverageRequestError, NothingToCoverError

CELLS_PER_TOOL: Final = 6.0
"""The grid on which coverage is measured has at least this many cells across the tool."""
ROUNDING_M: Final = 1e-3
"""Reach of a footprint beyond its outermost corner (m): coordinates on lines of centers are compared to 0.02 cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Area:
    """Where a footprint can stand, connected with the start, and what a round tool at its center reaches from there.

    The footprint fits at every heading there, because the robot turns in place. All arrays are `[iy, ix]`.
    """

    geometry: GridGeometry
    """Of `free` and `passable`; a position is the center of a cell."""
    free: NDArray[np.bool_]
    """Where the robot works: the footprint is free, and inside the polygon if there is one."""
    passable: NDArray[np.bool_]
    """Where the robot drives: as `free`, also outside the polygon, but never in its holes."""
    grid: GridGeometry
    """Of `reachable` and `blocked`: finer than `geometry` for narrow tools."""
    reachable: NDArray[np.bool_]
    """What the tool can cover: at most half its width away from a free position, and not an obstacle."""
    wanted: NDArray[np.bool_]
    """What is to be covered: known free space, inside the polygon if there is one."""
    operation_width: float
    """Width of the tool (m)."""
    footprint: Footprint
    start: Pose2D

    @property
    def cell_area(self) -> float:
        """Area of a cell of `reachable` (m²)."""
        return self.grid.resolution**2

    @property
    def reachable_m2(self) -> float:
        """Area that the tool can cover (m²)."""
        return int(self.reachable.sum()) * self.cell_area

    @property
    def wanted_m2(self) -> float:
        """Area that is to be covered (m²)."""
        return int(self.wanted.sum()) * self.cell_area

    def to_cells(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (n, 2) (m) in cells of `free`, whole at centers."""
        g = self.geometry
        return np.ascontiguousarray((points[:, :2] - (g.origin_x, g.origin_y)) / g.resolution - 0.5)

    def to_world(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (n, 2) in cells of `free` as points (m)."""
        g = self.geometry
        return (cells + 0.5) * g.resolution + (g.origin_x, g.origin_y)

    def to_grid(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (n, 2) (m) in cells of `reachable`, whole at centers."""
        g = self.grid
        return np.ascontiguousarray((points[:, :2] - (g.origin_x, g.origin_y)) / g.resolution - 0.5)


def distance_to(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the distance of each cell to the nearest one in `mask` (cells, from center to center); inf if it is empty."""
    from scipy import ndimage

    if not mask.any():
        return np.full(mask.shape, np.inf)
    found: Any = ndimage.distance_transform_edt(~mask)
    return found


def regions_of(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Return the number of its connected region for each cell, 0 outside `mask`, and how many there are; diagonals connect."""
    from scipy import ndimage

    found: Any = ndimage.label(mask, np.ones((3, 3), np.int8))
    return found[0], int(found[1])


def reach_of(footprint: Footprint, resolution: float, clearance: float) -> float:
    """Return how far (m) centers of cells must be from every obstacle for the footprint to be free on lines between them.

    `clearance` (m) is what the footprint keeps from obstacles.

    A line between three neighboring centers is nowhere farther than half a diagonal from one of them, so by Pythagoras the
    distance to an obstacle is at least the footprint's circumscribed radius there.
    """
    return math.hypot(footprint.circumscribed_radius + clearance, math.sqrt(0.5) * resolution) + ROUNDING_M


def near(blocked: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Return True for the cells whose center is less than `radius` (cells) from the square of a cell that is `blocked`.

    Cells outside the grid count as blocked. Exact, unlike a distance to centers.
    """
    if radius > min(blocked.shape):  # from everywhere the border is nearer
        return np.ones(blocked.shape, np.bool_)
    margin = math.ceil(radius) + 1
    padded = np.pad(blocked, margin, constant_values=True)
    ny, nx = padded.shape
    found = np.zeros_like(padded)
    for dy in range(margin + 1):
        gap = max(dy - 0.5, 0.0)
        if gap >= radius:
            break
        half = math.ceil(math.sqrt(radius * radius - gap * gap) + 0.5) - 1  # |dx| - 0.5 < the rest
        counts = np.zeros((ny, nx + 1), np.int32)
        np.cumsum(padded, axis=1, out=counts[:, 1:])
        low, high = np.maximum(np.arange(nx) - half, 0), np.minimum(np.arange(nx) + half + 1, nx)
        wide = counts[:, high] > counts[:, low]
        found[dy:] |= wide[: ny - dy]
        found[: ny - dy] |= wide[dy:]
    return found[margin:-margin, margin:-margin]


def make_area(
    costmap: Costmap,
    footprint: Footprint,
    start: Pose2D,
    operation_width: float,
    *,
    clearance: float = 0.0,
    polygon: shapely.Polygon | shapely.MultiPolygon | None = None,
    avoid: NDArray[np.bool_] | None = None,
) -> Area:
    """Return what a tool of `operation_width` (m) at the center of the robot can cover from `start`.

    Lethal and unknown cells of the costmap are obstacles. `polygon` (m, costmap's frame) limits the work: the footprint stays
    inside it and out of its holes. The footprint keeps `clearance` (m) from obstacles. `avoid` (ny, nx): positions where the
    robot must not stand. Raises NothingToCoverError and InvalidCoverageRequestError.
    """
    g = costmap.geometry
    obstacles = (costmap.data == LETHAL) | (costmap.data == UNKNOWN)
    radius = reach_of(footprint, g.resolution, clearance) / g.resolution
    outside = holes = None
    if polygon is not None:
        outside, holes = _outside(polygon, g)
    passable = ~near(obstacles if holes is None else obstacles | holes, radius)
    if avoid is not None:
        passable &= ~avoid
    free = passable
    if outside is not None:  # no sensor sees the border of a polygon, so no clearance from it
        free = passable & ~near(outside, reach_of(footprint, g.resolution, 0.0) / g.resolution)
    if not passable.any():
        raise _fits_nowhere(footprint, "on this map", "check robot_radius or footprint, and the thresholds of the map")
    cell = nearest_free(passable, g, start)
    labels, _ = regions_of(passable)
    connected = labels == labels[cell[1], cell[0]]
    free = free & connected
    if not free.any():
        where = "from the start" if polygon is None else "inside the polygon, or it cannot get there from the start"
        raise _fits_nowhere(footprint, where, "enlarge the polygon, or begin elsewhere")
    widest = 2.0 * float(distance_to(~np.pad(~obstacles, 1)).max()) * g.resolution
    if operation_width > widest:
        raise InvalidCoverageRequestError(
            f"operation_width is {operation_width:g} m, wider than the free space, {widest:.2f} m at most; give the width of "
            "the tool in meters",
            operation_width=operation_width,
            widest_m=widest,
        )
    factor = max(1, math.ceil(CELLS_PER_TOOL * g.resolution / operation_width))
    factor += 1 - factor % 2  # odd: the centers of `free` are centers of the finer grid
    grid = GridGeometry(g.nx * factor, g.ny * factor, g.resolution / factor, g.origin_x, g.origin_y)
    centers = np.ones(grid.shape, np.bool_)
    centers[factor // 2 :: factor, factor // 2 :: factor] = ~free
    reach = 0.5 * operation_width / grid.resolution
    wanted = ~obstacles if outside is None else ~(obstacles | outside)
    wanted = np.repeat(np.repeat(wanted, factor, axis=0), factor, axis=1) if factor > 1 else wanted
    reachable = (distance_to(~centers) <= reach) & wanted
    return Area(g, free, connected, grid, reachable, wanted, operation_width, footprint, start)


def nearest_free(free: NDArray[np.bool_], geometry: GridGeometry, pose: Pose2D) -> tuple[int, int]:
    """Return (ix, iy) of the free cell nearest to a pose, within half a meter. Raises InvalidCoverageRequestError."""
    ys, xs = np.nonzero(free)
    away = np.hypot(
        geometry.origin_x + (xs + 0.5) * geometry.resolution - pose.x,
        geometry.origin_y + (ys + 0.5) * geometry.resolution - pose.y,
    )
    best = int(np.argmin(away))
    if away[best] > max(0.5, 2.0 * geometry.resolution):
        raise InvalidCoverageRequestError(
            f"the start ({pose.x:.2f}, {pose.y:.2f}) is {away[best]:.2f} m from the nearest place where the footprint fits; "
            f"begin at ({geometry.origin_x + (xs[best] + 0.5) * geometry.resolution:.2f}, "
            f"{geometry.origin_y + (ys[best] + 0.5) * geometry.resolution:.2f})",
            distance_m=float(away[best]),
        )
    return int(xs[best]), int(ys[best])


def _outside(
    polygon: shapely.Polygon | shapely.MultiPolygon, g: GridGeometry
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the cells whose square is not inside the polygon, and those that touch one of its holes."""
    xs = g.origin_x + (np.arange(g.nx) + 0.5) * g.resolution
    ys = g.origin_y + (np.arange(g.ny) + 0.5) * g.resolution
    x, y = np.meshgrid(xs, ys)
    parts = [polygon] if isinstance(polygon, shapely.Polygon) else list(polygon.geoms)
    shells = shapely.union_all([shapely.Polygon(part.exterior) for part in parts])
    voids = shapely.union_all([shapely.Polygon(ring) for part in parts for ring in part.interiors])
    half = 0.5 * g.resolution * math.sqrt(2.0)
    inner = shells.buffer(-half) if not shells.is_empty else shells
    shapely.prepare(inner)
    outside = ~shapely.contains_xy(inner, x, y)
    holes = np.zeros(g.shape, np.bool_)
    if not voids.is_empty:
        grown = voids.buffer(half)
        shapely.prepare(grown)
        holes = shapely.contains_xy(grown, x, y)
    return outside | holes, holes


def roomy_start(costmap: Costmap, footprint: Footprint, *, clearance: float = 0.0) -> Pose2D:
    """Return a pose in the largest connected region where the footprint fits. Raises NothingToCoverError."""
    g = costmap.geometry
    obstacles = (costmap.data == LETHAL) | (costmap.data == UNKNOWN)
    free = ~near(obstacles, reach_of(footprint, g.resolution, clearance) / g.resolution)
    labels, number = regions_of(free)
    if not number:
        raise _fits_nowhere(footprint, "on this map", "check robot_radius or footprint, and the thresholds of the map")
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    ys, xs = np.nonzero(labels == int(sizes.argmax()))
    x, y = g.cell_to_world(int(xs[len(xs) // 2]), int(ys[len(ys) // 2]))
    return Pose2D(x, y, 0.0)


def _fits_nowhere(footprint: Footprint, where: str, fix: str) -> NothingToCoverError:
    radius = footprint.circumscribed_radius
    return NothingToCoverError(
        f"the footprint (circumscribed radius {radius:.2f} m) fits nowhere {where}; {fix}",
        circumscribed_radius_m=radius,
    )
