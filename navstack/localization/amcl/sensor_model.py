"""How well a scan fits the particles: the map, its distance field, and the three sensor models."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, OccupancyGrid, Transform2D
from navstack.localization import _field_kernels
from navstack.localization.amcl import _beam_kernels, _brushfire_kernels, _sensor_kernels
from navstack.localization.distance_field import OCCUPIED, distances_of, squared_cells
from navstack.parameters.models.amcl import AmclParams

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
    """Return the place of a map; with `half_cell` as in amcl, where cell (0, 0) is centred at the origin of the map."""
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
        self._field = np.zeros(1, _sensor_kernels.FIELD)
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
        """Return the distance field (ny, nx), metres."""
        table = np.empty((self._squares.shape[0] + 2, self._squares.shape[1] + 2))
        _field_kernels.look_up(self._squares, self._distances, table)
        return table[1:-1, 1:-1].astype(np.float32)

    def _step(self, count: int) -> int:
        # ROS differs: at least 1 also for the beam model, which never ends with fewer readings than beams there
        return max(1, (count - 1) // (self.params.laser_max_beams - 1))

    def _sum(self, particles: Array, readings: Readings, out: Array) -> None:
        beams = readings.end_points(readings.with_return()) / self.place.cell
        table = self._table("cube", readings.farthest, self._cube)
        _sensor_kernels.add_beams(particles, beams, table, self._field, out)

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
        _sensor_kernels.multiply_beams(particles, beams, table, self._field, out)

    def _kept(self, particles: Array, beams: Array) -> NDArray[np.bool_] | None:
        """Return the beams that enough particles explain; all of them if too many would be left out.

        None where amcl multiplies by the logarithm of 0.
        """
        params = self.params
        near = self._table("near", 0.0, lambda d, _: (d < params.beam_skip_distance).astype(np.float64))
        agreeing = np.empty(len(beams))
        _sensor_kernels.count_agreeing(particles, beams, near, self._field, agreeing)
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
        beam = np.zeros(1, _beam_kernels.BEAM)
        for name, value in zip(_beam_kernels.BEAM.names or (), self.place, strict=False):
            beam[name] = value
        for name in ("z_hit", "z_short", "z_max", "z_rand", "sigma_hit", "lambda_short"):
            beam[name] = getattr(params, f"laser_{name}")
        beam["farthest"] = readings.farthest
        _beam_kernels.add_ranges(particles, readings.sensor, np.ascontiguousarray(ranges), self._blocked, beam, out)

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
    _brushfire_kernels.brushfire(occupied, math.floor(farthest / cell), cell, *scratch, distances)
    values, index = np.unique(distances, return_inverse=True)
    if values[-1] < farthest:
        values = np.append(values, farthest)
    return index.reshape(grid.geometry.shape).astype(np.int32), values
