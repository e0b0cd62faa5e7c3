"""Edit a map: crop, turn to its walls, remove specks, fill holes, draw areas, make a keepout mask."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from navstack.core import GridGeometry, InputError, OccupancyGrid, Pose2D, Transform2D
from navstack.coverage import read_field

_image: Any = ndimage  # its stubs do not know what most functions return
_EIGHT: Final = np.ones((3, 3), bool)
_MOST_CELLS: Final = 80_000_000
"""As the largest image of `map_io`."""
_STANDS_OUT: Final = 1.15
"""The projections on the walls' axes are this much more concentrated than on the median of all axes."""


def grid_axes(grid: OccupancyGrid) -> Transform2D:
    """Return the pose of the corner and the axes of a map in its frame."""
    return Transform2D(grid.geometry.origin_x, grid.geometry.origin_y, grid.origin_yaw)


def cell_centers(grid: OccupancyGrid, iy: NDArray[np.int64], ix: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the centers (n, 2) of cells in the frame of the map (m)."""
    return grid_axes(grid).apply_points((np.column_stack((ix, iy)).astype(np.float64) + 0.5) * grid.geometry.resolution)


def crop(
    grid: OccupancyGrid, box: tuple[float, float, float, float] | None = None, margin: float = 0.0
) -> OccupancyGrid:
    """Return the part of a map in a box (min x, min y, max x, max y; m, map frame), by default around what is known.

    The box is grown by `margin` (m) and limited to the map; of a turned map, all cells that it reaches are kept. Raises
    InputError if nothing is left.
    """
    g = grid.geometry
    if box is None:
        iy, ix = np.nonzero(grid.data != -1)
        if len(iy) == 0:
            raise InputError("the map has no known cell, so there is nothing to crop to; give a box")
        low, high = np.array([ix.min(), iy.min()]), np.array([ix.max(), iy.max()]) + 1
        grow = math.ceil(margin / g.resolution - 1e-9)
        low, high = low - grow, high + grow
    else:
        x0, y0, x1, y1 = box
        corners = np.array([[x0, y0], [x1, y0], [x0, y1], [x1, y1]])
        inside = grid_axes(grid).inverse().apply_points(corners)
        low = np.floor((inside.min(axis=0) - margin) / g.resolution + 1e-9)
        high = np.ceil((inside.max(axis=0) + margin) / g.resolution - 1e-9)
    size = np.array([g.nx, g.ny])
    x0, y0 = np.clip(low, 0, size).astype(int).tolist()
    x1, y1 = np.clip(high, 0, size).astype(int).tolist()
    if x1 <= x0 or y1 <= y0:
        left, right, bottom, top = g.extent
        raise InputError(
            f"the box {box} contains no cell of the map (x {left:.2f} to {right:.2f}, y {bottom:.2f} to {top:.2f}); give its "
            "corners in meters in the frame of the map",
            argument="box",
        )
    corner = grid_axes(grid).apply(Pose2D(x0 * g.resolution, y0 * g.resolution))
    geometry = GridGeometry(x1 - x0, y1 - y0, g.resolution, corner.x, corner.y)
    return replace(grid, data=np.ascontiguousarray(grid.data[y0:y1, x0:x1]), geometry=geometry)


def wall_direction(grid: OccupancyGrid) -> float:
    """Return the direction of most walls, in (-pi/4, pi/4] (rad, map frame): two walls at a right angle have the same one.

    On the axes of the walls, the projections of the occupied cells lie most closely together: the sum of the squares of their
    histograms is largest. Raises InputError if no direction stands out.
    """
    iy, ix = np.nonzero(grid.data == 100)
    every = max(1, len(iy) // 20_000)
    points = (np.column_stack((ix, iy)).astype(np.float64) + 0.5)[::every]

    def concentration(angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        total = 0.0
        for along in (c * points[:, 0] + s * points[:, 1], c * points[:, 1] - s * points[:, 0]):
            counts = np.bincount((along - along.min()).astype(np.int64))
            total += float(np.square(counts).sum())
        return total

    if len(points) >= 20:
        coarse = np.radians(np.arange(-45.0, 45.0, 0.5))
        found = np.array([concentration(angle) for angle in coarse])
        best = float(coarse[found.argmax()])
        if found.max() >= _STANDS_OUT * np.median(found):
            near = best + np.radians(np.arange(-0.5, 0.501, 0.05))
            fine = np.array([concentration(angle) for angle in near])
            # several neighbors may be equal to within a cell: their middle
            top = near[fine >= fine.max() - 0.02 * (fine.max() - np.median(found))]
            angle = float(top.mean()) + grid.origin_yaw
            return angle - 0.5 * math.pi * math.ceil(angle / (0.5 * math.pi) - 0.5)
    raise InputError(
        f"no direction of walls stands out among the {len(iy)} occupied cells; give the angle instead",
        argument="rotate",
    )


def rotate(grid: OccupancyGrid, angle: float) -> OccupancyGrid:
    """Return the map turned by `angle` (rad, counter-clockwise) about the origin of its frame, with axes along its frame.

    A cell of the result takes the value of most of nine points in it; it is occupied from four on, so that no wall gets a
    gap. In maps with other values than 0, 100 and -1, it takes that of its center. A pose p in the map becomes
    `Transform2D(0, 0, angle).apply(p)`. Raises InputError for an angle that is none, and a result that is too large.
    """
    if not math.isfinite(angle):
        raise InputError(f"the angle {angle} is not finite", argument="angle")
    g = grid.geometry
    axes = Transform2D(0.0, 0.0, angle) @ grid_axes(grid)
    corners = axes.apply_points(np.array([[0.0, 0.0], [g.width_m, 0.0], [0.0, g.height_m], [g.width_m, g.height_m]]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    nx, ny = (max(1, math.ceil(extent / g.resolution - 1e-6)) for extent in (high - low).tolist())
    return resample(grid, axes, GridGeometry(nx, ny, g.resolution, *low.tolist()))


def resample(grid: OccupancyGrid, axes: Transform2D, geometry: GridGeometry) -> OccupancyGrid:
    """Return the map with its corner and axes at `axes`, in the cells of `geometry`; unknown beyond it. See `rotate`."""
    if geometry.nx * geometry.ny > _MOST_CELLS:
        raise InputError(
            f"a map of {geometry.nx} x {geometry.ny} cells is larger than {_MOST_CELLS:,} cells; crop it first"
        )
    trinary = bool(np.isin(grid.data, (-1, 0, 100)).all())
    shape = geometry.shape
    counts = {value: np.zeros(shape, np.int8) for value in (100, 0)}
    result = np.full(shape, -1, np.int8)
    inverse = axes.inverse()
    c, s, per = math.cos(inverse.yaw), math.sin(inverse.yaw), 1.0 / grid.geometry.resolution
    offsets = (1.0 / 6.0, 0.5, 5.0 / 6.0) if trinary else (0.5,)
    for v in offsets:
        y = geometry.origin_y + (np.arange(geometry.ny)[:, None] + v) * geometry.resolution
        for u in offsets:
            x = geometry.origin_x + (np.arange(geometry.nx)[None, :] + u) * geometry.resolution
            # a point on the border of a cell belongs to one side whatever the last bit says
            ix = np.floor((inverse.x + c * x - s * y) * per + 1e-9).astype(np.int64)
            iy = np.floor((inverse.y + s * x + c * y) * per + 1e-9).astype(np.int64)
            inside = (ix >= 0) & (iy >= 0) & (ix < grid.geometry.nx) & (iy < grid.geometry.ny)
            found = np.full(shape, -1, np.int8)
            found[inside] = grid.data[iy[inside], ix[inside]]
            result = found
            for value, count in counts.items():
                count += found == value
    if trinary:
        result = np.where(counts[0] >= 5, 0, -1).astype(np.int8)
        result[counts[100] >= 4] = 100
    return OccupancyGrid(result, geometry, 0.0, grid.frame, grid.raw)


def remove_specks(grid: OccupancyGrid, area: float) -> tuple[OccupancyGrid, int]:
    """Return the map without groups of occupied cells smaller than `area` (m²), and their number.

    They become free where most cells around them are, and unknown elsewhere.
    """
    return _without(grid, 100, area, (0, -1))


def fill_holes(grid: OccupancyGrid, area: float) -> tuple[OccupancyGrid, int]:
    """Return the map without unknown groups of cells smaller than `area` (m²), and their number.

    They become what most of the known cells around them are: free or occupied.
    """
    return _without(grid, -1, area, (0, 100))


def _without(grid: OccupancyGrid, value: int, area: float, others: tuple[int, int]) -> tuple[OccupancyGrid, int]:
    """Replace small groups of `value` by the first of `others` where most neighbors with either value have it."""
    if not (math.isfinite(area) and area > 0.0):
        raise InputError(f"the area {area:g} must be above 0 m²", argument="area", value=area)
    labels, count = _image.label(grid.data == value, _EIGHT)
    labels = np.asarray(labels)
    limit = area / grid.geometry.resolution**2
    small = np.nonzero(np.bincount(labels.ravel(), minlength=count + 1)[1:] < limit - 1e-9)[0] + 1
    data = grid.data.copy()
    boxes = _image.find_objects(labels)
    for label in small.tolist():
        ys, xs = boxes[label - 1]
        box = slice(max(0, ys.start - 1), ys.stop + 1), slice(max(0, xs.start - 1), xs.stop + 1)
        own = labels[box] == label
        around = grid.data[box][_image.binary_dilation(own, _EIGHT) & ~own]
        first, second = (int((around == other).sum()) for other in others)
        data[box][own] = others[0] if first >= second else others[1]
    return replace(grid, data=data), len(small)


def paint(grid: OccupancyGrid, file: Path, value: int) -> OccupancyGrid:
    """Return the map with `value` in every cell that the polygons of a GeoJSON file (m, map frame) reach.

    Raises InputError if they reach no cell, CoverageError for a file that is none.
    """
    return replace(grid, data=np.where(reached(grid, file), value, grid.data).astype(np.int8))


def keepout_mask(grid: OccupancyGrid, files: list[Path]) -> OccupancyGrid:
    """Return a mask for Nav2's keepout filter: 100 in the cells that the polygons of GeoJSON files reach, 0 elsewhere."""
    data = np.zeros(grid.geometry.shape, np.int8)
    for file in files:
        data[reached(grid, file)] = 100
    return replace(grid, data=data, raw=False)


def reached(grid: OccupancyGrid, file: Path) -> NDArray[np.bool_]:
    """Return the cells (ny, nx) that the polygons of a GeoJSON file overlap. Raises InputError if there are none."""
    field = read_field(file)
    g = grid.geometry
    inverse = grid_axes(grid).inverse()
    cells = shapely.transform(field, lambda points: inverse.apply_points(points) / g.resolution)
    found = np.zeros(g.shape, bool)
    x0, y0, x1, y1 = cells.bounds
    columns = np.arange(max(0, math.floor(x0)), min(g.nx, math.ceil(x1)))
    rows = np.arange(max(0, math.floor(y0)), min(g.ny, math.ceil(y1)))
    if len(columns) and len(rows):
        shapely.prepare(cells)
        x, y = np.meshgrid(columns, rows)
        squares: Any = shapely.box(x, y, x + 1.0, y + 1.0)
        # a polygon that only touches the border of a cell does not reach it
        near = shapely.intersects(cells.buffer(-1e-6), squares)
        found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = near
    if not found.any():
        x0, y0, x1, y1 = field.bounds
        left, right, bottom, top = g.extent
        raise InputError(
            f"{file}: the polygons (x {x0:.2f} to {x1:.2f}, y {y0:.2f} to {y1:.2f}) reach no cell of the map (x {left:.2f} to "
            f"{right:.2f}, y {bottom:.2f} to {top:.2f}); give corners in meters in the frame of the map",
            argument=str(file),
        )
    return found
