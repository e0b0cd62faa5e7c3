"""How well a scan fits the particles: the map, its distance field, and the three sensor models."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, OccupancyGrid, Transform2D, kernel
from navstack.localization import field as _field_kernels
from navstack.localization.field import OCCUPIED, distances_of, squared_cells
from navstack.parameters import AmclParams

# ----------------------------------------------------------------------------------------------------------------------
# The beam model: each range against the range that a ray through the map has (amcl/src/amcl/map/map_range.c, amcl_laser.cpp).


BEAM = np.dtype(
    [
        ("map_center_x", np.float64),
        ("map_center_y", np.float64),
        ("map_cell", np.float64),
        ("map_shift_x", np.float64),
        ("map_shift_y", np.float64),
        ("z_hit", np.float64),
        ("z_short", np.float64),
        ("z_max", np.float64),
        ("z_rand", np.float64),
        ("sigma_hit", np.float64),
        ("lambda_short", np.float64),
        ("farthest", np.float64),
    ],
    align=True,
)
"""The map's place and the mixture, an array (1,). A point x (m) has the column `floor((x - map_center_x) / map_cell +
map_shift_x)`; `farthest` is the greatest range (m)."""


@kernel
def cast(
    blocked: NDArray[np.bool_], beam: NDArray[np.void], x: float, y: float, bearing: float, longest: float
) -> float:
    """Return the range (m) of a ray over cells that are not `blocked` (ny, nx), by Bresenham's line; at most `longest` (m)."""
    ny, nx = blocked.shape
    cell = beam[0]["map_cell"]
    center_x, center_y = beam[0]["map_center_x"], beam[0]["map_center_y"]
    x0 = math.floor((x - center_x) / cell + beam[0]["map_shift_x"])
    y0 = math.floor((y - center_y) / cell + beam[0]["map_shift_y"])
    x1 = math.floor((x + longest * math.cos(bearing) - center_x) / cell + beam[0]["map_shift_x"])
    y1 = math.floor((y + longest * math.sin(bearing) - center_y) / cell + beam[0]["map_shift_y"])
    steep = abs(y1 - y0) > abs(x1 - x0)
    a0, b0, a1, b1 = (y0, x0, y1, x1) if steep else (x0, y0, x1, y1)
    length, rise = abs(a1 - a0), abs(b1 - b0)
    step_a = 1 if a0 < a1 else -1
    step_b = 1 if b0 < b1 else -1
    error = 0
    a, b = a0, b0
    while True:
        ix, iy = (b, a) if steep else (a, b)
        if ix < 0 or iy < 0 or ix >= nx or iy >= ny or blocked[iy, ix]:
            return math.sqrt((a - a0) * (a - a0) + (b - b0) * (b - b0)) * cell
        if a == a1 + step_a:
            return longest
        a += step_a
        error += rise
        if 2 * error >= length:
            b += step_b
            error -= length


@kernel
def add_ranges(
    particles: NDArray[np.float64],
    laser: NDArray[np.float64],
    readings: NDArray[np.float64],
    blocked: NDArray[np.bool_],
    beam: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Add the cubed likelihoods of `readings` (m, 2; range, bearing) to `out` (n,); `laser` (3,) is in the base frame."""
    z_hit, z_short, z_max = beam[0]["z_hit"], beam[0]["z_short"], beam[0]["z_max"]
    farthest, decay = beam[0]["farthest"], beam[0]["lambda_short"]
    noise = beam[0]["z_rand"] / farthest
    spread = 2.0 * beam[0]["sigma_hit"] * beam[0]["sigma_hit"]
    for i in range(len(particles)):
        yaw = particles[i, 2]
        c, s = math.cos(yaw), math.sin(yaw)
        x = particles[i, 0] + c * laser[0] - s * laser[1]
        y = particles[i, 1] + s * laser[0] + c * laser[1]
        total = out[i]
        for k in range(len(readings)):
            reading = readings[k, 0]
            z = reading - cast(blocked, beam, x, y, yaw + laser[2] + readings[k, 1], farthest)
            p = z_hit * math.exp(-(z * z) / spread)
            if z < 0.0:
                p += z_short * decay * math.exp(-decay * reading)
            if reading == farthest:
                p += z_max
            elif reading < farthest:
                p += noise
            total += p * p * p
        out[i] = total


# ----------------------------------------------------------------------------------------------------------------------
# The distance field as amcl computes it, for comparisons (amcl/src/amcl/map/map_cspace.cpp).
#
# Labels spread over 4-neighbors from a binary heap; a cell keeps the first label that reaches it, which need not be that of the
# nearest occupied cell. The order of equal distances is that of libstdc++'s `push_heap` and `pop_heap`.


@kernel
def sift_up(heap: NDArray[np.int32], hole: int, cell: int, distances: NDArray[np.float64]) -> None:
    """Put `cell` into the heap at `hole` or above it."""
    parent = (hole - 1) // 2
    while hole > 0 and distances[heap[parent]] > distances[cell]:
        heap[hole] = heap[parent]
        hole = parent
        parent = (hole - 1) // 2
    heap[hole] = cell


@kernel
def drop_top(heap: NDArray[np.int32], size: int, distances: NDArray[np.float64]) -> None:
    """Remove the top of a heap of `size` cells."""
    size -= 1
    cell = heap[size]
    if size == 0:
        return
    hole = 0
    child = 0
    while child < (size - 1) // 2:
        child = 2 * (child + 1)
        if distances[heap[child]] > distances[heap[child - 1]]:
            child -= 1
        heap[hole] = heap[child]
        hole = child
    if size % 2 == 0 and child == (size - 2) // 2:
        child = 2 * (child + 1)
        heap[hole] = heap[child - 1]
        hole = child - 1
    sift_up(heap, hole, cell, distances)


@kernel
def brushfire(
    occupied: NDArray[np.bool_],
    radius: int,
    resolution: float,
    heap: NDArray[np.int32],
    sources: NDArray[np.int32],
    distances: NDArray[np.float64],
) -> None:
    """Fill `distances` (ny * nx,), which holds the greatest distance (m) everywhere, from the `occupied` cells (ny, nx).

    `heap` and `sources` are scratch arrays (ny * nx,).
    """
    ny, nx = occupied.shape
    sources[:] = -1
    size = 0
    for ix in range(nx):
        for iy in range(ny):
            if occupied[iy, ix]:
                cell = iy * nx + ix
                distances[cell] = 0.0
                sources[cell] = cell
                sift_up(heap, size, cell, distances)
                size += 1
    while size > 0:
        cell = heap[0]
        source = sources[cell]
        ix, iy = cell % nx, cell // nx
        for side in range(4):
            jx = ix + (-1 if side == 0 else 1 if side == 2 else 0)
            jy = iy + (-1 if side == 1 else 1 if side == 3 else 0)
            if jx < 0 or jy < 0 or jx >= nx or jy >= ny:
                continue
            other = jy * nx + jx
            if sources[other] != -1:
                continue
            dx, dy = abs(jx - source % nx), abs(jy - source // nx)
            distance = math.sqrt(dx * dx + dy * dy)
            if distance > radius:
                continue
            distances[other] = distance * resolution
            sources[other] = source
            sift_up(heap, size, other, distances)
            size += 1
        # as amcl: what is on top now is removed, which may be a neighbor that was just added
        drop_top(heap, size, distances)
        size -= 1


# ----------------------------------------------------------------------------------------------------------------------
# The sensor models of amcl: how well a scan fits each particle (amcl/src/amcl/sensors/amcl_laser.cpp).
#
# Beams are (forward, left) end points in the base frame in cells; tables hold a value per cell, with a border of one cell for
# everything off the map. `FIELD` places the table: a point x (m) has the column `(x - center_x) / cell + shift_x` of the table.


FIELD = np.dtype(
    [
        ("center_x", np.float64),
        ("center_y", np.float64),
        ("cell", np.float64),
        ("shift_x", np.float64),
        ("shift_y", np.float64),
    ],
    align=True,
)
BLOCK = 256


@kernel
def add_beams(
    particles: NDArray[np.float64],
    beams: NDArray[np.float64],
    table: NDArray[np.float64],
    field: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Add the table's values at the end points of `beams` (m, 2) to `out` (n,), for each of the `particles` (n, 3)."""
    ny, nx = table.shape
    flat = table.ravel()
    last_x, last_y = float(nx - 1), float(ny - 1)
    scale = 1.0 / field[0]["cell"]
    center_x, center_y = field[0]["center_x"], field[0]["center_y"]
    shift_x, shift_y = field[0]["shift_x"], field[0]["shift_y"]
    x = np.empty(BLOCK)
    y = np.empty(BLOCK)
    c = np.empty(BLOCK)
    s = np.empty(BLOCK)
    cells = np.empty(BLOCK, np.int32)
    for first in range(0, len(particles), BLOCK):
        size = min(BLOCK, len(particles) - first)
        for i in range(size):
            yaw = particles[first + i, 2]
            c[i], s[i] = math.cos(yaw), math.sin(yaw)
            x[i] = (particles[first + i, 0] - center_x) * scale + shift_x
            y[i] = (particles[first + i, 1] - center_y) * scale + shift_y
        block = out[first : first + size]
        for k in range(len(beams)):
            ahead, left = beams[k, 0], beams[k, 1]
            for i in range(size):
                column = min(max(x[i] + (c[i] * ahead - s[i] * left), 0.0), last_x)
                row = min(max(y[i] + (s[i] * ahead + c[i] * left), 0.0), last_y)
                cells[i] = np.int32(row) * np.int32(nx) + np.int32(column)
            for i in range(size):
                block[i] += flat[cells[i]]


@kernel
def multiply_beams(
    particles: NDArray[np.float64],
    beams: NDArray[np.float64],
    table: NDArray[np.float64],
    field: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Multiply `out` (n,) by the table's values at the end points of `beams`, as `add_beams` adds them.

    Products are taken in groups of beams, so that they do not underflow before the whole does.
    """
    logs = np.zeros(len(out))
    add_beams(particles, beams, table, field, logs)
    for i in range(len(out)):
        out[i] *= math.exp(logs[i])


@kernel
def count_agreeing(
    particles: NDArray[np.float64],
    beams: NDArray[np.float64],
    near: NDArray[np.float64],
    field: NDArray[np.void],
    out: NDArray[np.float64],
) -> None:
    """Count for each beam the particles that it agrees with: `near` is a table of ones and zeros, `out` (m,)."""
    agree = np.empty(len(particles))
    for k in range(len(beams)):
        agree[:] = 0.0
        add_beams(particles, beams[k : k + 1], near, field, agree)
        out[k] = agree.sum()


Array = NDArray[np.float64]


class Readings(NamedTuple):
    """A scan in the base frame."""

    ranges: Array
    """(m, 2): range (m; `farthest` for none, NaN for an invalid one), bearing from the sensor's x axis (rad)."""
    farthest: float
    """Greatest range (m)."""
    sensor: Array
    """(3,) pose of the sensor in the base frame; bearings are relative to it."""

    @classmethod
    def of(cls, scan: LaserScan, sensor: Transform2D, params: AmclParams) -> Readings:
        """Return the readings of a scan: too short ones have no return, ones beyond the greatest range are infinite."""
        farthest, nearest = float(scan.range_max), float(scan.range_min)
        if params.laser_max_range > 0.0:
            farthest = min(farthest, params.laser_max_range)
        if params.laser_min_range > 0.0:
            nearest = max(nearest, params.laser_min_range)
        readings = np.empty((len(scan.ranges), 2))
        readings[:, 0] = scan.ranges
        readings[:, 1] = scan.angle_min + scan.angle_increment * np.arange(len(readings))
        readings[readings[:, 0] > farthest, 0] = np.inf
        readings[readings[:, 0] <= nearest, 0] = farthest
        return cls(readings, farthest, np.array(sensor, np.float64))

    def every(self, step: int) -> Readings:
        """Return every `step`-th reading."""
        return self._replace(ranges=self.ranges[::step])

    def with_return(self) -> NDArray[np.bool_]:
        """(m,) True for readings that hit something."""
        return self.ranges[:, 0] < self.farthest

    def end_points(self, chosen: NDArray[np.bool_]) -> Array:
        """Return the end points (k, 2; m) of the chosen readings in the base frame."""
        x, y, yaw = self.sensor
        distance, angle = self.ranges[chosen, 0], yaw + self.ranges[chosen, 1]
        return np.column_stack((x + distance * np.cos(angle), y + distance * np.sin(angle)))


class MapPlace(NamedTuple):
    """Where the cells are: a point x has the column floor((x - center_x) / cell + shift_x)."""

    center_x: float
    center_y: float
    cell: float
    shift_x: float
    shift_y: float


def place_of(grid: OccupancyGrid, half_cell: bool) -> MapPlace:
    """Return the place of a map; with `half_cell` as in amcl, where cell (0, 0) is centered at the origin of the map."""
    g = grid.geometry
    if not half_cell:
        return MapPlace(g.origin_x, g.origin_y, g.resolution, 0.0, 0.0)
    columns, rows = g.nx // 2, g.ny // 2
    x, y = g.origin_x + columns * g.resolution, g.origin_y + rows * g.resolution
    return MapPlace(x, y, g.resolution, 0.5 + columns, 0.5 + rows)


class SensorModel:
    """The likelihood of scans on one map."""

    def __init__(self, params: AmclParams, grid: OccupancyGrid) -> None:
        self.params = params
        self._defects = frozenset(params.ros_defects)
        self.place = place_of(grid, "half_cell" in self._defects)
        self._blocked = grid.data != 0
        self._squares, self._distances = _field_of(grid, params, "distance_field" in self._defects)
        self._field = np.zeros(1, FIELD)
        for name, value in zip(("center_x", "center_y", "cell"), self.place, strict=False):
            self._field[name] = value
        self._field["shift_x"], self._field["shift_y"] = self.place.shift_x + 1.0, self.place.shift_y + 1.0
        self._tables: dict[tuple[str, float], Array] = {}

    def factors(self, particles: Array, readings: Readings, *, converged: bool) -> Array:
        """Return the likelihood (n,) of the readings at each of the `particles` (n, 3), up to a common factor."""
        out = np.ones(len(particles))
        count = len(readings.ranges)
        if self.params.laser_max_beams < 2 or count == 0:
            return out
        kind = self.params.laser_model_type
        if kind == "beam":
            self._add_ranges(particles, readings.every(self._step(count)), out)
        elif kind == "likelihood_field":
            readings = readings.every(self._step(count))
            self._sum(particles, readings, out)
        else:
            readings = readings.every(max(1, -(-count // self.params.laser_max_beams)))
            self._multiply(particles, readings, converged, out)
        return out

    def distances(self) -> NDArray[np.float32]:
        """Return the distance field (ny, nx), meters."""
        table = np.empty((self._squares.shape[0] + 2, self._squares.shape[1] + 2))
        _field_kernels.look_up(self._squares, self._distances, table)
        return table[1:-1, 1:-1].astype(np.float32)

    def _step(self, count: int) -> int:
        # ROS differs: at least 1 also for the beam model, which never ends with fewer readings than beams there
        return max(1, (count - 1) // (self.params.laser_max_beams - 1))

    def _sum(self, particles: Array, readings: Readings, out: Array) -> None:
        beams = readings.end_points(readings.with_return()) / self.place.cell
        table = self._table("cube", readings.farthest, self._cube)
        add_beams(particles, beams, table, self._field, out)

    def _multiply(self, particles: Array, readings: Readings, converged: bool, out: Array) -> None:
        valid = readings.with_return()
        beams = readings.end_points(valid) / self.place.cell
        if self.params.do_beamskip and converged:
            kept = self._kept(particles, beams)
            if kept is None:
                out[:] = 0.0
                return
            beams = beams[kept]
        table = self._table("log", readings.farthest, self._log)
        multiply_beams(particles, beams, table, self._field, out)

    def _kept(self, particles: Array, beams: Array) -> NDArray[np.bool_] | None:
        """Return the beams that enough particles explain; all of them if too many would be left out.

        None where amcl multiplies by the logarithm of 0.
        """
        params = self.params
        near = self._table("near", 0.0, lambda d, _: (d < params.beam_skip_distance).astype(np.float64))
        agreeing = np.empty(len(beams))
        count_agreeing(particles, beams, near, self._field, agreeing)
        kept = agreeing / len(particles) > params.beam_skip_threshold
        left_out = int((~kept).sum())
        every = np.ones(len(beams), np.bool_)
        if "beam_skip" in self._defects:
            missing = params.laser_max_beams - len(beams)
            if left_out + missing < params.laser_max_beams * params.beam_skip_error_threshold:
                return kept
            return every if missing == 0 else None
        # ROS differs: readings without a return say nothing about the share of beams that are explained
        return every if left_out >= len(beams) * params.beam_skip_error_threshold else kept

    def _add_ranges(self, particles: Array, readings: Readings, out: Array) -> None:
        params = self.params
        ranges = readings.ranges
        if "beam_nan" in self._defects:
            if np.isnan(ranges[:, 0]).any():
                out[:] = np.nan
                return
        else:
            # ROS differs: one invalid reading does not spoil the scan, and +inf is a reading without a return
            ranges = ranges[~np.isnan(ranges[:, 0])]
            ranges[:, 0] = np.minimum(ranges[:, 0], readings.farthest)
        beam = np.zeros(1, BEAM)
        for name, value in zip(BEAM.names or (), self.place, strict=False):
            beam[name] = value
        for name in ("z_hit", "z_short", "z_max", "z_rand", "sigma_hit", "lambda_short"):
            beam[name] = getattr(params, f"laser_{name}")
        beam["farthest"] = readings.farthest
        add_ranges(particles, readings.sensor, np.ascontiguousarray(ranges), self._blocked, beam, out)

    def _table(self, kind: str, farthest: float, value: Callable[[Array, float], Array]) -> Array:
        """Return the table (ny + 2, nx + 2) of a function of the distance, kept for the next scan."""
        table = self._tables.get((kind, farthest))
        if table is None:
            if len(self._tables) >= 6:
                self._tables.clear()  # a sensor whose range changes from scan to scan
            table = np.empty((self._squares.shape[0] + 2, self._squares.shape[1] + 2))
            _field_kernels.look_up(self._squares, value(self._distances, farthest), table)
            self._tables[kind, farthest] = table
        return table

    def _mixture(self, distances: Array, farthest: float) -> Array:
        sigma = self.params.laser_sigma_hit
        hit = self.params.laser_z_hit * np.exp(-(distances * distances) / (2.0 * sigma * sigma))
        return hit + self.params.laser_z_rand / farthest

    def _cube(self, distances: Array, farthest: float) -> Array:
        p = self._mixture(distances, farthest)
        return p * p * p

    def _log(self, distances: Array, farthest: float) -> Array:
        with np.errstate(divide="ignore"):
            return np.log(self._mixture(distances, farthest))


def _field_of(grid: OccupancyGrid, params: AmclParams, as_amcl: bool) -> tuple[NDArray[np.int32], Array]:
    """Return an index for each cell, (ny, nx), and the distance (m) of each index; the last index is beyond the field."""
    farthest, cell = params.laser_likelihood_max_dist, grid.geometry.resolution
    if not as_amcl:
        squares, radius = squared_cells(grid, farthest)
        return squares, distances_of(radius, cell, farthest)
    size = grid.data.size
    distances = np.full(size, farthest)
    scratch = np.empty(size, np.int32), np.empty(size, np.int32)
    occupied = grid.data == OCCUPIED
    brushfire(occupied, math.floor(farthest / cell), cell, *scratch, distances)
    values, index = np.unique(distances, return_inverse=True)
    if values[-1] < farthest:
        values = np.append(values, farthest)
    return index.reshape(grid.geometry.shape).astype(np.int32), values
