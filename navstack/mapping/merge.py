"""Merge two maps of one place: find where the second lies in the first, and join their cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize

from navstack.core import GridGeometry, InputError, OccupancyGrid, Transform2D, angle_between
from navstack.mapping.edit import cell_centers, grid_axes, resample, wall_direction

_image: Any = ndimage  # its stubs do not know what most functions return
_COARSE_CELLS: Final = 250
"""The search of all poses takes maps of at most this many cells on a side, or cells of 0.1 m."""
_STEP_RAD: Final = math.radians(3.0)
"""Between headings, of maps without a direction of walls."""
_SAME_M: Final = 1.0
_SAME_RAD: Final = math.radians(15.0)
"""Alignments nearer to each other than this are one."""
_KEPT: Final = 12
"""Alignments of the coarse search that are refined."""
_REACH_M: Final = 0.15
"""A wall of one map explains one of the other up to this distance (m), or 1.5 cells."""
_AGAINST: Final = 5.0
"""A wall in free space counts against an alignment this many times: maps of one place hardly contradict each other."""
LEAST_SHARE: Final = 0.85
"""Share of the walls in the common part that must agree,"""
LEAST_WALL_M: Final = 4.0
"""length of walls that must agree (m),"""
MOST_RIVAL: Final = 0.6
"""and largest score of the runner-up, as a share of the best one's."""


class Alignment(NamedTuple):
    """A pose of the frame of the second map in that of the first, and how well the maps agree there."""

    transform: Transform2D
    agree_m: float
    """Length of the walls of either map that the other explains (cells times their size, halved: m)."""
    contradict_m: float
    """Length of the walls of either map in free space of the other (m)."""

    @property
    def score(self) -> float:
        """Length that agrees, minus five times the length that contradicts (m)."""
        return self.agree_m - _AGAINST * self.contradict_m

    @property
    def share(self) -> float:
        """Share of the walls in the common part that agree."""
        total = self.agree_m + self.contradict_m
        return self.agree_m / total if total > 0.0 else 0.0

    def text(self) -> str:
        """Return one line."""
        t = self.transform
        return (
            f"at ({t.x:.2f}, {t.y:.2f}, {math.degrees(t.yaw):.1f}°) {self.agree_m:.1f} m of walls agree and "
            f"{self.contradict_m:.1f} m contradict ({self.share:.0%})"
        )


@dataclass(frozen=True, slots=True)
class Search:
    """The alignments that were found, best first, at most two; and why the first is not accepted."""

    found: tuple[Alignment, ...]
    refusal: str = ""


def merged(first: OccupancyGrid, second: OccupancyGrid, transform: Transform2D) -> OccupancyGrid:
    """Return both maps in the frame, resolution and axes of the first, `transform` being the pose of the second's frame in it.

    A cell is occupied if it is in either map, else free if it is in either. Raises InputError for maps with other values than
    0, 100 and -1, and for a transform that is not finite.
    """
    for grid in (first, second):
        if not np.isin(grid.data, (-1, 0, 100)).all():
            raise InputError(
                "only maps of free, occupied and unknown cells can be merged; save them in the mode trinary"
            )
    if not all(map(math.isfinite, transform)):
        raise InputError(f"the transform {tuple(transform)} is not finite", argument="transform")
    g, h = first.geometry, second.geometry
    # in the axes of the first map, its corner being the origin
    axes = grid_axes(first).inverse() @ transform @ grid_axes(second)
    corners = axes.apply_points(np.array([[0.0, 0.0], [h.width_m, 0.0], [0.0, h.height_m], [h.width_m, h.height_m]]))
    low = np.minimum(np.floor(corners.min(axis=0) / g.resolution + 0.05).astype(int), 0)
    high = np.maximum(np.ceil(corners.max(axis=0) / g.resolution - 0.05).astype(int), [g.nx, g.ny])
    nx, ny = (high - low).tolist()
    if nx * ny > 80_000_000:
        raise InputError(f"the maps together have {nx} x {ny} cells; check the transform {tuple(transform)}")
    corner = low * g.resolution
    other = resample(second, axes, GridGeometry(nx, ny, g.resolution, float(corner[0]), float(corner[1]))).data
    data = np.full((ny, nx), -1, np.int8)
    data[-low[1] : -low[1] + g.ny, -low[0] : -low[0] + g.nx] = first.data
    joined = np.where((data == 100) | (other == 100), 100, np.where((data == 0) | (other == 0), 0, -1)).astype(np.int8)
    at = grid_axes(first) @ Transform2D(float(corner[0]), float(corner[1]), 0.0)
    return OccupancyGrid(joined, GridGeometry(nx, ny, g.resolution, at.x, at.y), first.origin_yaw, first.frame)


def align(first: OccupancyGrid, second: OccupancyGrid) -> Search:
    """Search the pose of the second map's frame in the first's by their walls and free space, in all poses.

    For each heading, all positions are rated at once by a correlation (FFT): walls on walls count for an alignment, walls in
    free space against it. The best ones are refined in full resolution. The first is refused (`refusal`) if hardly any walls
    agree, too many contradict, or another alignment is nearly as good. Raises InputError for maps without walls.
    """
    for name, grid in (("first", first), ("second", second)):
        if not (grid.data == 100).any():
            raise InputError(f"the {name} map has no occupied cell, so it cannot be aligned; give the transform")
    pair = _Pair(first, second)
    refined = sorted((pair.refined(pose) for pose in pair.coarse()), key=lambda a: -a.score)
    found: list[Alignment] = []
    for each in refined:
        if all(not _same(each.transform, other.transform) for other in found):
            found.append(each)
    best, rivals = found[0], found[1:2]
    refusal = ""
    if best.share < LEAST_SHARE or best.agree_m < LEAST_WALL_M:
        refusal = (
            f"the maps do not fit together: {best.text()}; at least {LEAST_SHARE:.0%} and {LEAST_WALL_M:g} m must agree"
        )
    elif rivals and rivals[0].score > MOST_RIVAL * best.score:
        refusal = f"two alignments are nearly equal: {best.text()}; {rivals[0].text()}"
    return Search((best, *rivals), refusal)


def compare(first: OccupancyGrid, second: OccupancyGrid, transform: Transform2D) -> Alignment:
    """Return how well the maps agree at an alignment."""
    return _Pair(first, second).rated(transform)


def _same(one: Transform2D, other: Transform2D) -> bool:
    apart = math.hypot(one.x - other.x, one.y - other.y)
    return apart < _SAME_M and abs(angle_between(one.yaw, other.yaw)) < _SAME_RAD


class _Walls:
    """What the rating needs of a map."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self.grid = grid
        self.axes = grid_axes(grid).inverse()
        iy, ix = np.nonzero(grid.data == 100)
        self.points = cell_centers(grid, iy, ix)
        self.distance = np.asarray(_image.distance_transform_edt(grid.data != 100)) * grid.geometry.resolution
        self.reach = max(_REACH_M, 1.5 * grid.geometry.resolution)

    def look_up(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the distance to the nearest wall (n,) (m), infinite off the map, and whether the cell is free, for points."""
        g = self.grid.geometry
        cells = self.axes.apply_points(points) / g.resolution
        ix, iy = np.floor(cells).astype(np.int64).T
        inside = (ix >= 0) & (iy >= 0) & (ix < g.nx) & (iy < g.ny)
        distance, free = np.full(len(points), np.inf), np.zeros(len(points), bool)
        # between the centers of the cells, so that equal cells of both maps fall onto each other exactly
        distance[inside] = _image.map_coordinates(self.distance, cells[inside, ::-1].T - 0.5, order=1, mode="nearest")
        free[inside] = self.grid.data[iy[inside], ix[inside]] == 0
        return distance, free


class _Pair:
    def __init__(self, first: OccupancyGrid, second: OccupancyGrid) -> None:
        self.first, self.second = _Walls(first), _Walls(second)

    def rated(self, transform: Transform2D) -> Alignment:
        agree = contradict = 0.0
        for walls, other, moved in (
            (self.second, self.first, transform),
            (self.first, self.second, transform.inverse()),
        ):
            distance, free = other.look_up(moved.apply_points(walls.points))
            near = distance <= other.reach
            cell = 0.5 * walls.grid.geometry.resolution
            agree += cell * float(near.sum())
            contradict += cell * float((free & ~near).sum())
        return Alignment(transform, agree, contradict)

    def refined(self, start: Transform2D) -> Alignment:
        """Return the best alignment near `start`: the walls of the second map moved onto those of the first."""
        every = max(1, len(self.second.points) // 4000)
        points = self.second.points[::every]
        middle = points.mean(axis=0)

        def pose(change: NDArray[np.float64]) -> Transform2D:
            # turned about the middle of the walls, so that position and heading do not depend on each other
            dx, dy, turn = change.tolist()
            around = Transform2D(float(middle[0]), float(middle[1]), 0.0)
            return start @ around @ Transform2D(dx, dy, turn) @ around.inverse()

        def badness(change: NDArray[np.float64], sigma: float) -> float:
            distance, free = self.first.look_up(pose(change).apply_points(points))
            likely = np.exp(-0.5 * np.square(distance / sigma))
            return float((_AGAINST * free * (1.0 - likely) - likely).sum())

        found = np.zeros(3)
        for sigma in (0.3, max(0.08, self.first.grid.geometry.resolution)):
            simplex = found + np.array([[0.0, 0.0, 0.0], [sigma, 0.0, 0.0], [0.0, sigma, 0.0], [0.0, 0.0, 0.1 * sigma]])
            result: Any = optimize.minimize(
                badness,
                found,
                (sigma,),
                method="Nelder-Mead",
                options={"initial_simplex": simplex, "maxfev": 150, "xatol": 1e-3, "fatol": 1e-2},
            )
            found = result.x
        return self.rated(pose(found))

    def coarse(self) -> list[Transform2D]:
        """Return the best alignments on a coarse grid, best first."""
        grids = self.first.grid, self.second.grid
        cell = max(0.1, *(max(g.geometry.width_m, g.geometry.height_m) / _COARSE_CELLS for g in grids))
        fixed = _Coarse.of(self.first, Transform2D(), cell)
        found: list[tuple[float, Transform2D]] = []
        for yaw in self._headings():
            turned = _Coarse.of(self.second, Transform2D(0.0, 0.0, yaw), cell)
            size: Any = [fft.next_fast_len(a + b) for a, b in zip(fixed.walls.shape, turned.walls.shape, strict=True)]

            def transformed(image: NDArray[np.float32], size: Any = size) -> Any:
                return fft.rfft2(image, size)

            spectrum = transformed(fixed.gain) * np.conj(transformed(turned.walls))
            spectrum -= _AGAINST * transformed(fixed.walls) * np.conj(transformed(turned.free))
            rated: Any = fft.irfft2(spectrum, size)
            for _ in range(4):
                row, column = np.unravel_index(int(rated.argmax()), rated.shape)
                best = float(rated[row, column])
                dy = int(row) - (size[0] if row > fixed.walls.shape[0] else 0)
                dx = int(column) - (size[1] if column > fixed.walls.shape[1] else 0)
                x = fixed.x - turned.x + dx * cell
                y = fixed.y - turned.y + dy * cell
                found.append((best, Transform2D(x, y, yaw)))
                wide = round(_SAME_M / cell)
                rows = np.arange(row - wide, row + wide + 1) % size[0]
                columns = np.arange(column - wide, column + wide + 1) % size[1]
                rated[np.ix_(rows, columns)] = -np.inf
        found.sort(key=lambda each: -each[0])
        kept: list[Transform2D] = []
        for _, pose in found:
            if len(kept) < _KEPT and all(not _same(pose, other) for other in kept):
                kept.append(pose)
        return kept

    def _headings(self) -> list[float]:
        try:
            turn = wall_direction(self.first.grid) - wall_direction(self.second.grid)
        except InputError:
            return np.arange(-math.pi, math.pi, _STEP_RAD).tolist()
        return [math.remainder(turn + k * 0.5 * math.pi, 2.0 * math.pi) for k in range(4)]


@dataclass(frozen=True, slots=True)
class _Coarse:
    """A map turned and in coarse cells (ny, nx), with its lower left corner (m)."""

    x: float
    y: float
    walls: NDArray[np.float32]
    free: NDArray[np.float32]
    gain: NDArray[np.float32]
    """What a wall of the other map adds here: 1 at a wall and next to it, -5 in free space."""

    @classmethod
    def of(cls, walls: _Walls, turn: Transform2D, cell: float) -> _Coarse:
        """Return the map `walls` turned by `turn`."""
        iy, ix = np.nonzero(walls.grid.data == 0)
        occupied = turn.apply_points(walls.points)
        free = turn.apply_points(cell_centers(walls.grid, iy, ix))
        both = np.vstack((occupied, free))
        low = both.min(axis=0) - 2.0 * cell
        nx, ny = (np.ceil((both.max(axis=0) - low) / cell).astype(int) + 3).tolist()

        def counted(points: NDArray[np.float64]) -> NDArray[np.bool_]:
            at = ((points - low) / cell).astype(np.int64)
            return np.bincount(at[:, 1] * nx + at[:, 0], minlength=nx * ny).reshape(ny, nx) > 0

        wall = counted(occupied)
        near = _image.binary_dilation(wall)
        open_ = counted(free) & ~near
        gain = near.astype(np.float32) - np.float32(_AGAINST) * open_
        return cls(float(low[0]), float(low[1]), wall.astype(np.float32), open_.astype(np.float32), gain)
