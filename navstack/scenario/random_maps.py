"""Random maps: rooms, mazes, scattered discs, caves. Free cells are 0, occupied 100; a wall one cell wide encloses them."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.sim import OCCUPIED

RESOLUTION: Final = 0.05
WALL: Final = 2
"""Thickness of inner walls, in cells."""


def rooms(rng: np.random.Generator, width_m: float, height_m: float, door_m: tuple[float, float]) -> OccupancyGrid:
    """Divides rooms recursively; each wall has a door whose width (m) is drawn from `door_m`. All rooms are connected."""
    walls = _empty(width_m, height_m)
    smallest = max(1.5, 2.0 * door_m[1])

    def cut(x0: int, y0: int, x1: int, y1: int) -> None:
        wide, high = (x1 - x0) * RESOLUTION, (y1 - y0) * RESOLUTION
        across, room = wide > high, max(wide, high)
        if room < 2.0 * smallest:
            return
        door = round(rng.uniform(*door_m) / RESOLUTION)
        # a view whose rows run along the wall
        view = walls[y0 - 1 : y1 + 1, x0:x1] if across else walls[y0:y1, x0 - 1 : x1 + 1].T
        for _ in range(20):
            at = round((smallest + rng.random() * (room - 2.0 * smallest)) / RESOLUTION)
            ends = view[[0, -1], max(at - door, 0) : at + WALL + door]
            if ends.all():  # no door of another wall near the ends
                break
        else:
            return
        length = len(view) - 2
        gap = 2 + int(rng.integers(max(1, length - door - 4)))
        view[1 : 1 + gap, at : at + WALL] = True
        view[1 + gap + door :, at : at + WALL] = True
        if across:
            cut(x0, y0, x0 + at, y1)
            cut(x0 + at + WALL, y0, x1, y1)
        else:
            cut(x0, y0, x1, y0 + at)
            cut(x0, y0 + at + WALL, x1, y1)

    cut(1, 1, walls.shape[1] - 1, walls.shape[0] - 1)
    return _grid(walls)


def maze(rng: np.random.Generator, width_m: float, height_m: float, lane_m: float, loops: float = 0.1) -> OccupancyGrid:
    """A maze with lanes `lane_m` wide; the share `loops` of the walls not needed for a spanning tree is removed."""
    lane = round(lane_m / RESOLUTION)
    pitch = lane + WALL
    columns, lines = max(2, int(width_m / RESOLUTION) // pitch), max(2, int(height_m / RESOLUTION) // pitch)
    walls = np.ones((lines * pitch + WALL, columns * pitch + WALL), np.bool_)

    def room(i: int, j: int) -> tuple[slice, slice]:
        return slice(WALL + j * pitch, WALL + j * pitch + lane), slice(WALL + i * pitch, WALL + i * pitch + lane)

    def open_between(a: tuple[int, int], b: tuple[int, int]) -> None:
        (i, j), (k, _) = min(a, b), max(a, b)
        rows, cols = room(i, j)
        if k > i:
            walls[rows, cols.stop : cols.stop + WALL] = False
        else:
            walls[rows.stop : rows.stop + WALL, cols] = False

    def neighbors(i: int, j: int) -> list[tuple[int, int]]:
        around = ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
        return [(k, m) for k, m in around if 0 <= k < columns and 0 <= m < lines]

    for i in range(columns):
        for j in range(lines):
            walls[room(i, j)] = False
    stack = [(0, 0)]
    seen = {(0, 0)}
    while stack:
        choices = [cell for cell in neighbors(*stack[-1]) if cell not in seen]
        if not choices:
            stack.pop()
            continue
        chosen = choices[int(rng.integers(len(choices)))]
        open_between(stack[-1], chosen)
        seen.add(chosen)
        stack.append(chosen)
    for i in range(columns):
        for j in range(lines):
            for other in neighbors(i, j):
                if other > (i, j) and rng.random() < loops:
                    open_between((i, j), other)
    return _grid(walls)


def discs(
    rng: np.random.Generator, width_m: float, height_m: float, per_m2: float, radius_m: tuple[float, float]
) -> OccupancyGrid:
    """Scatters `per_m2` discs per square meter; their radii (m) are drawn from `radius_m`."""
    walls = _empty(width_m, height_m)
    ny, nx = walls.shape
    x = (np.arange(nx) + 0.5) * RESOLUTION
    y = (np.arange(ny) + 0.5) * RESOLUTION
    for _ in range(round(per_m2 * width_m * height_m)):
        cx, cy, r = rng.uniform(0.0, width_m), rng.uniform(0.0, height_m), rng.uniform(*radius_m)
        walls |= (x[None, :] - cx) ** 2 + (y[:, None] - cy) ** 2 < r * r
    return _grid(walls)


def caves(rng: np.random.Generator, width_m: float, height_m: float, fill: float, rounds: int = 4) -> OccupancyGrid:
    """Runs the cellular automaton of the BARN worlds on squares of 0.15 m.

    Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020: cells are filled with probability
    `fill`; in each round a cell with at least five filled neighbors is filled, one with fewer than two is cleared.
    """
    coarse = 3
    shape = (math.ceil(height_m / RESOLUTION / coarse), math.ceil(width_m / RESOLUTION / coarse))
    filled = rng.random(shape) < fill
    for _ in range(rounds):
        padded = np.pad(filled.astype(np.int64), 1)
        around = -filled.astype(np.int64)
        for dy in range(3):
            for dx in range(3):
                around += padded[dy : dy + shape[0], dx : dx + shape[1]]
        filled = (filled & (around >= 2)) | (around >= 5)
    walls = np.kron(filled, np.ones((coarse, coarse), np.bool_))
    return _grid(walls)


def _empty(width_m: float, height_m: float) -> NDArray[np.bool_]:
    """Returns an empty map with its enclosing wall."""
    walls = np.zeros((round(height_m / RESOLUTION), round(width_m / RESOLUTION)), np.bool_)
    return _enclosed(walls)


def _enclosed(walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
    walls[[0, -1], :] = True
    walls[:, [0, -1]] = True
    return walls


def _grid(walls: NDArray[np.bool_]) -> OccupancyGrid:
    _enclosed(walls)
    ny, nx = walls.shape
    data = np.where(walls, 100, 0).astype(np.int8)
    data.setflags(write=False)
    return OccupancyGrid(data, GridGeometry(nx, ny, RESOLUTION))


class FreeSpace:
    """The free cells of a map at least `clearance_m` from every occupied cell, by 8-connected region."""

    def __init__(self, grid: OccupancyGrid, clearance_m: float) -> None:
        from scipy import ndimage

        self._geometry = grid.geometry
        resolution = grid.geometry.resolution
        # distances are between centers: half a cell's diagonal is subtracted to be safe
        cells: Any = ndimage.distance_transform_edt(grid.data < OCCUPIED)
        distance = cells * resolution - 0.71 * resolution
        free = (distance >= clearance_m) & (grid.data == 0)
        labeled: Any = ndimage.label(free, np.ones((3, 3)))
        labels, count = labeled
        sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
        self._regions: list[NDArray[np.int64]] = []
        """Cells (n, 2) ix, iy of each region, the largest region first."""
        for label in np.argsort(-sizes, kind="stable").tolist():
            iy, ix = np.nonzero(labels == label + 1)
            self._regions.append(np.column_stack((ix, iy)))

    @property
    def is_empty(self) -> bool:
        """True if the robot fits nowhere."""
        return not self._regions

    def draw(self, rng: np.random.Generator, region: int = 0) -> Pose2D:
        """Draws a pose with any yaw in a region; 0 is the largest."""
        cells = self._regions[region]
        ix, iy = cells[int(rng.integers(len(cells)))].tolist()
        x, y = self._geometry.cell_to_world(ix, iy)
        return Pose2D(round(x, 3), round(y, 3), round(rng.uniform(-math.pi, math.pi), 4))

    def draw_pair(
        self, rng: np.random.Generator, min_distance_m: float, max_distance_m: float, *, across: bool = False
    ) -> tuple[Pose2D, Pose2D]:
        """Draws two poses within a range of Euclidean distance; after 100 failed attempts, the last two drawn.

        Both are in the largest region; with `across`, in two different regions if there are several.
        """
        sizes = np.array([len(cells) for cells in self._regions])
        shares = sizes / sizes.sum()
        start = goal = self.draw(rng)
        for _ in range(100):
            first = second = 0
            if across and len(self._regions) > 1:
                first, second = rng.choice(len(sizes), 2, replace=False, p=shares).tolist()
            start, goal = self.draw(rng, first), self.draw(rng, second)
            if min_distance_m <= start.distance_to(goal) <= max_distance_m:
                break
        return start, goal
