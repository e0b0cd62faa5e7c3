"""An occupancy grid from the scans of a log and known poses.

Source of the formula: Moravec and Elfes (High resolution maps from wide angle sonar, ICRA 1985), with log-odds as in Thrun et
al. (Probabilistic Robotics, chapter 9).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, LogError, OccupancyGrid, Transform2D, kernel, line_next, line_start
from navstack.localization import LoggedScan, scan_beams
from navstack.map_io import MAX_CELLS

MODEL = np.dtype([("resolution", "f8"), ("hit", "f4"), ("miss", "f4"), ("limit", "f4")])
"""Resolution (m) and what a hit adds to the log-odds of a cell, a miss takes away, and their largest absolute value."""


@kernel
def add_scan(
    odds: NDArray[np.float32],
    seen: NDArray[np.int32],
    number: int,
    eye: NDArray[np.float64],
    ends: NDArray[np.float64],
    model: NDArray[np.void],
) -> None:
    """Add one scan to the log-odds `odds` (ny, nx) float32; each cell changes once at most, and a hit wins over a miss.

    `seen` (ny, nx) int32: number of the last scan that changed a cell; `number`: of this scan, greater than all before; `eye`
    (2,): the sensor; `ends` (n, 3): ends of the beams and 1 for a return, 0 for none; both relative to the grid's corner (m).
    """
    m: Any = model[0]
    ny, nx = odds.shape
    flat, marks = odds.ravel(), seen.ravel()
    per = 1.0 / m.resolution
    x0, y0 = math.floor(eye[0] * per), math.floor(eye[1] * per)
    if not (0 <= x0 < nx and 0 <= y0 < ny):
        return
    for i in range(ends.shape[0]):
        x, y = math.floor(ends[i, 0] * per), math.floor(ends[i, 1] * per)
        if ends[i, 2] > 0.0 and 0 <= x < nx and 0 <= y < ny and marks[y * nx + x] != number:
            marks[y * nx + x] = number
            flat[y * nx + x] = min(flat[y * nx + x] + m.hit, m.limit)
    for i in range(ends.shape[0]):
        x, y = math.floor(ends[i, 0] * per), math.floor(ends[i, 1] * per)
        line = line_start(x0, y0, x, y, nx)
        cell, error = y0 * nx + x0, line[0] // 2
        cx = x0
        for _ in range(line[0]):
            if not 0 <= cell < ny * nx or abs(cell % nx - cx) > 1:
                break  # left the grid
            cx = cell % nx
            if marks[cell] != number:
                marks[cell] = number
                flat[cell] = max(flat[cell] - m.miss, -m.limit)
            cell, error = line_next(cell, error, line)


_MARGIN_M: Final = 1.0


@dataclass(frozen=True, slots=True)
class MappingModel:
    """How scans change the occupancy of cells; probabilities."""

    hit: float = 0.7
    """Occupancy of a cell after one beam has ended in it."""
    miss: float = 0.4
    """Occupancy of a cell after one beam has passed through it."""
    limit: float = 0.99
    """Greatest occupancy; 1 - limit is the smallest."""
    occupied: float = 0.6
    """From this occupancy on, a cell is occupied."""
    free: float = 0.45
    """Up to this occupancy, a cell is free."""
    max_range: float = 30.0
    """Longer beams end here and have no return (m)."""
    clear_without_return: bool = False
    """Whether beams without a return clear cells: true for a sensor that always sees what is within its range. Glass, black
    surfaces and mirrors give no return either."""


class _Bounds:
    """Smallest box around points (m)."""

    def __init__(self) -> None:
        self.low: NDArray[np.float64] = np.full(2, np.inf)
        self.high: NDArray[np.float64] = np.full(2, -np.inf)

    def add(self, points: NDArray[np.float64]) -> None:
        self.low = np.minimum(self.low, points.min(axis=0))
        self.high = np.maximum(self.high, points.max(axis=0))


def map_from_frames(
    frames: Callable[[], Iterable[LoggedScan]], *, resolution: float = 0.05, model: MappingModel | None = None
) -> tuple[OccupancyGrid, int]:
    """Return the grid that the scans with a reference pose give, and the number of these scans.

    `frames` returns the frames of the log; it is called twice, first for the size of the grid. A beam raises the log-odds of
    the cell where it ends and lowers those of the cells before it; a scan changes a cell once at most. Cells that no beam has
    touched are unknown. Raises LogError if no frame has a reference, or the grid would exceed the limit of maps.
    """
    m = model or MappingModel()
    bounds, count = _Bounds(), 0
    for _, eye, ends in _placed(frames(), m):
        count += 1
        bounds.add(eye[None])
        returned = ends[ends[:, 2] > 0.0, :2]
        if len(returned):
            bounds.add(returned)
    if count == 0:
        raise LogError(
            "no scan of the log has a reference pose, so there is no map without solving SLAM; use a log with corrected poses"
        )
    geometry = _geometry(bounds, resolution)
    odds, seen = np.zeros(geometry.shape, np.float32), np.zeros(geometry.shape, np.int32)
    settings = np.array([(resolution, _log_odds(m.hit), -_log_odds(m.miss), _log_odds(m.limit))], MODEL)
    corner = np.array([geometry.origin_x, geometry.origin_y])
    for number, (_, eye, ends) in enumerate(_placed(frames(), m), start=1):
        ends[:, :2] -= corner
        add_scan(odds, seen, number, eye - corner, ends, settings)
    cells = np.full(geometry.shape, -1, np.int8)
    cells[(seen > 0) & (odds <= _log_odds(m.free))] = 0
    cells[odds >= _log_odds(m.occupied)] = 100
    return OccupancyGrid(cells, geometry), count


class GrowingMap:
    """A grid to which scans with known poses are added one by one.

    With the same scans, its cells are those of `map_from_frames`, but for what beams without a return have cleared beyond the
    grid of their time.
    """

    def __init__(self, resolution: float, model: MappingModel | None = None) -> None:
        self._model = model or MappingModel()
        m = self._model
        self._settings = np.array([(resolution, _log_odds(m.hit), -_log_odds(m.miss), _log_odds(m.limit))], MODEL)
        self._resolution = resolution
        self._corner = 0, 0
        """Cell of the world at the grid's corner; cell (0, 0) of the world begins at (0, 0)."""
        self._odds, self._seen = np.zeros((0, 0), np.float32), np.zeros((0, 0), np.int32)
        self._bounds = _Bounds()
        self.count = 0
        """Number of scans."""

    def add(self, frame: LoggedScan) -> None:
        """Add a scan with a reference pose. Raises LogError if the grid would exceed the limit of maps."""
        for _, eye, ends in _placed([frame], self._model):
            self.count += 1
            self._bounds.add(eye[None])
            returned = ends[ends[:, 2] > 0.0, :2]
            if len(returned):
                self._bounds.add(returned)
            self._reach(_geometry(self._bounds, self._resolution))
            corner = np.array(self._corner) * self._resolution
            ends[:, :2] -= corner
            add_scan(self._odds, self._seen, self.count, eye - corner, ends, self._settings)

    def grid(self) -> OccupancyGrid:
        """Return the map. Raises LogError without a scan."""
        if not self.count:
            raise LogError("no scan has been added, so there is no map")
        geometry, m = _geometry(self._bounds, self._resolution), self._model
        x, y = self._cell(geometry)
        part = np.s_[y - self._corner[1] :, x - self._corner[0] :]
        odds = self._odds[part][: geometry.ny, : geometry.nx]
        seen = self._seen[part][: geometry.ny, : geometry.nx]
        cells = np.full(geometry.shape, -1, np.int8)
        cells[(seen > 0) & (odds <= _log_odds(m.free))] = 0
        cells[odds >= _log_odds(m.occupied)] = 100
        return OccupancyGrid(cells, geometry)

    def _cell(self, geometry: GridGeometry) -> tuple[int, int]:
        return round(geometry.origin_x / self._resolution), round(geometry.origin_y / self._resolution)

    def _reach(self, geometry: GridGeometry) -> None:
        """Grow the arrays, by a quarter more than needed, until they contain a geometry."""
        ny, nx = self._odds.shape
        (x, y), (x0, y0) = self._cell(geometry), self._corner
        if self.count > 1 and x >= x0 and y >= y0 and x + geometry.nx <= x0 + nx and y + geometry.ny <= y0 + ny:
            return
        more_x, more_y = geometry.nx // 4 + 1, geometry.ny // 4 + 1
        low = x - more_x, y - more_y
        shape = geometry.ny + 2 * more_y, geometry.nx + 2 * more_x
        odds, seen = np.zeros(shape, np.float32), np.zeros(shape, np.int32)
        if self.count > 1:
            # what is beyond the new geometry was never within the bounds
            top, left = max(y0, low[1]), max(x0, low[0])
            bottom, right = min(y0 + ny, low[1] + shape[0]), min(x0 + nx, low[0] + shape[1])
            there = np.s_[top - low[1] : bottom - low[1], left - low[0] : right - low[0]]
            here = np.s_[top - y0 : bottom - y0, left - x0 : right - x0]
            odds[there], seen[there] = self._odds[here], self._seen[here]
        self._odds, self._seen, self._corner = odds, seen, low


def _placed(
    frames: Iterable[LoggedScan], model: MappingModel
) -> Iterator[tuple[LoggedScan, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield the frames with a reference, with the sensor (2,) and the ends of the beams (n, 3) in the map (m)."""
    for frame in frames:
        if frame.reference is None:
            continue
        base = Transform2D(*frame.reference)
        scan = frame.scan
        if not model.clear_without_return:
            ranges = np.where(scan.ranges < scan.range_max, scan.ranges, np.float32(np.nan))
            scan = replace(scan, ranges=ranges)
        beams = scan_beams(scan, frame.sensor, model.max_range)
        ends = beams.ends.copy()
        ends[:, :2] = base.apply_points(ends[:, :2])
        yield frame, base.apply_points(beams.eye[None])[0], ends


def _geometry(bounds: _Bounds, resolution: float) -> GridGeometry:
    """Return the grid around the bounds, its corner a multiple of the resolution."""
    low = np.floor((bounds.low - _MARGIN_M) / resolution) * resolution
    ny, nx = (math.ceil(v) for v in ((bounds.high - low + _MARGIN_M) / resolution)[::-1].tolist())
    if nx * ny > MAX_CELLS:
        raise LogError(
            f"the map would have {nx} x {ny} cells, more than {MAX_CELLS // 10**6} million; use a coarser --resolution than "
            f"{resolution:g} m, or a shorter --max-range"
        )
    return GridGeometry(nx, ny, resolution, round(float(low[0]), 9), round(float(low[1]), 9))


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


@dataclass(frozen=True, slots=True)
class CellChange:
    """What one scan changed of a cell."""

    frame: LoggedScan
    hit: bool
    """True: a beam ended in the cell; False: one passed it, and none ended there."""
    occupancy: float
    """Of the cell afterwards, 0 to 1."""


def cell_changes(
    frames: Iterable[LoggedScan], grid: OccupancyGrid, x: float, y: float, model: MappingModel | None = None
) -> Iterator[CellChange]:
    """Yield the scans that changed the cell at (x, y) (m) of a map that `map_from_frames` made of the same frames.

    Raises LogError for a place outside the map.
    """
    m, g = model or MappingModel(), grid.geometry
    ix, iy = math.floor((x - g.origin_x) / g.resolution), math.floor((y - g.origin_y) / g.resolution)
    if not (0 <= ix < g.nx and 0 <= iy < g.ny):
        left, right, bottom, top = g.extent
        raise LogError(
            f"({x:g}, {y:g}) is outside the map, which covers x {left:g} .. {right:g}, y {bottom:g} .. {top:g} m"
        )
    odds, seen = np.zeros(g.shape, np.float32), np.zeros(g.shape, np.int32)
    settings = np.array([(g.resolution, _log_odds(m.hit), -_log_odds(m.miss), _log_odds(m.limit))], MODEL)
    corner = np.array([g.origin_x, g.origin_y])
    for number, (frame, eye, ends) in enumerate(_placed(frames, m), start=1):
        ends[:, :2] -= corner
        add_scan(odds, seen, number, eye - corner, ends, settings)
        if seen[iy, ix] == number:
            cells = np.floor(ends[:, :2] / g.resolution).astype(np.int64)
            hit = bool(((cells == (ix, iy)).all(axis=1) & (ends[:, 2] > 0.0)).any())
            yield CellChange(frame, hit, 1.0 / (1.0 + math.exp(-float(odds[iy, ix]))))
