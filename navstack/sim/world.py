"""What the simulated robot drives among: the occupied cells of a map, and round obstacles."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, GridGeometry, OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.sim import _body_kernels as body
from navstack.sim._clearance_kernels import clearance
from navstack.sim._lidar_kernels import free_squares

OCCUPIED = 100
"""A cell of a map is a wall from this value on: what the static layer takes as lethal by default."""


class Mover(Protocol):
    """Round obstacles whose places are a function of time."""

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s); always the same k."""
        ...


class World:
    """A map and discs, in the map's frame (m).

    Occupied cells are solid squares. Unknown cells, and everything outside the map, are empty: they hide nothing and hurt
    nothing. The grid may be turned (`origin_yaw`).
    """

    def __init__(
        self,
        map: OccupancyGrid | None = None,
        discs: NDArray[np.float64] | Sequence[Sequence[float]] = (),
        movers: Sequence[Mover] = (),
        low_discs: NDArray[np.float64] | Sequence[Sequence[float]] = (),
    ) -> None:
        """`discs` (n, 3): x, y, radius (m) of what stands still; without a map the ground is empty. `low_discs` likewise,
        but no lidar sees them: thresholds, feet of chairs. A robot runs into them all the same.

        Raises InputError for discs that are not finite or have no radius.
        """
        self.map = map if map is not None else OccupancyGrid(np.zeros((1, 1), np.int8), GridGeometry(1, 1, 1.0))
        geometry = self.map.geometry
        self.grid: NDArray[np.float64] = np.array(
            [geometry.origin_x, geometry.origin_y, self.map.origin_yaw, geometry.resolution]
        )
        """[origin x, origin y, origin yaw, resolution] for the kernels."""
        self.squares: NDArray[np.uint8] = _squares_of(self.map.data >= OCCUPIED)
        """(4, ny, nx): the free squares of every cell, one in each quadrant; 0 = occupied."""
        self.movers = tuple(movers)
        self._low = _checked_discs(low_discs)
        self._discs = np.concatenate([self._low, _checked_discs(discs)])

    @property
    def moves(self) -> bool:
        """True when the discs are not the same at all times."""
        return bool(self.movers)

    def discs_at(self, time: float) -> NDArray[np.float64]:
        """(n, 3) x, y, radius (m) of all round obstacles at `time` (s): low ones, others that stand, movers.

        Not to be written to.
        """
        if not self.movers:
            return self._discs
        return np.concatenate([self._discs, *(mover.discs(time) for mover in self.movers)])

    def put_discs(self, discs: NDArray[np.float64] | Sequence[Sequence[float]]) -> None:
        """Replaces the round obstacles that stand still, except low ones: for whoever moves things step by step."""
        self._discs = np.concatenate([self._low, _checked_discs(discs)])

    def in_sight(self, discs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Those of `discs`, as `discs_at` gave them, that a lidar sees: all but the low ones."""
        return discs[len(self._low) :] if len(self._low) else discs

    def contains(self, pose: Pose2D) -> bool:
        """True for a position on the map."""
        geometry = self.map.geometry
        c, s = math.cos(self.map.origin_yaw), math.sin(self.map.origin_yaw)
        dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
        return 0.0 <= c * dx + s * dy < geometry.width_m and 0.0 <= c * dy - s * dx < geometry.height_m

    def is_free(self, footprint: Footprint, pose: Pose2D, time: float = 0.0) -> bool:
        """True when the outline at `pose` meets neither an occupied cell nor a disc at `time` (s)."""
        return self.contact(footprint, pose, time) is None

    def contact(self, footprint: Footprint, pose: Pose2D, time: float = 0.0) -> tuple[str, int, float, float] | None:
        """What the outline at `pose` meets: ("map", iy * nx + ix, x, y) or ("disc", index, x, y) with its centre (m)."""
        discs = self.discs_at(time)
        hit = int(
            body.find_contact(
                self.squares,
                self.grid,
                discs,
                np.arange(len(discs)),
                len(discs),
                footprint.vertices.copy(),
                footprint.circumscribed_radius,
                float(pose.x),
                float(pose.y),
                float(pose.yaw),
                np.empty_like(footprint.vertices),
            )
        )
        return None if hit == -1 else self.described(hit, discs)

    def touched(self, points: NDArray[np.float64], reach: float, discs: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 2) (m, map frame) have an occupied cell or one of `discs` within `reach` (m).

        Cells are looked for on two rings of 16 points around each: good for those not much smaller than `reach`.
        """
        x, y = points[:, 0], points[:, 1]
        away = np.hypot(x[:, None] - discs[:, 0], y[:, None] - discs[:, 1]) - discs[:, 2]
        found = (away < reach).any(axis=1)
        resolution, (_, ny, nx) = self.map.geometry.resolution, self.squares.shape
        c, s = math.cos(self.map.origin_yaw), math.sin(self.map.origin_yaw)
        dx, dy = x - self.map.geometry.origin_x, y - self.map.geometry.origin_y
        ring = np.arange(16) * (math.pi / 8.0)
        rings = np.concatenate(([0.0], 0.5 * reach * np.cos(ring), reach * np.cos(ring)))
        gx = ((c * dx + s * dy)[:, None] + rings) / resolution
        rings = np.concatenate(([0.0], 0.5 * reach * np.sin(ring), reach * np.sin(ring)))
        gy = ((c * dy - s * dx)[:, None] + rings) / resolution
        inside = (gx >= 0.0) & (gy >= 0.0) & (gx < nx) & (gy < ny)
        ix, iy = np.where(inside, gx, 0.0).astype(np.int64), np.where(inside, gy, 0.0).astype(np.int64)
        return found | (inside & (self.squares[0, iy, ix] == 0)).any(axis=1)

    def described(self, hit: int, discs: NDArray[np.float64]) -> tuple[str, int, float, float]:
        """A kernel's answer in words: kind, index, and the centre of what was hit (m)."""
        if hit < 0:
            index = -2 - hit
            return "disc", index, float(discs[index, 0]), float(discs[index, 1])
        geometry = self.map.geometry
        iy, ix = divmod(hit, geometry.nx)
        u, v = (ix + 0.5) * geometry.resolution, (iy + 0.5) * geometry.resolution
        c, s = math.cos(self.map.origin_yaw), math.sin(self.map.origin_yaw)
        return "map", hit, geometry.origin_x + c * u - s * v, geometry.origin_y + s * u + c * v

    def clearance(self, pose: Pose2D, footprint: Footprint | None = None, time: float = 0.0) -> float:
        """Distance (m) from the position, or from the outline there, to the nearest obstacle at `time` (s); exact.

        0 in contact, inf when there is no obstacle at all.
        """
        outline = np.zeros((1, 2)) if footprint is None else footprint.vertices.copy()
        x, y, yaw = float(pose.x), float(pose.y), float(pose.yaw)
        return float(clearance(self.squares, self.grid, self.discs_at(time), outline, x, y, yaw))


_SQUARES: dict[bytes, NDArray[np.uint8]] = {}
"""By what the map holds: those of the maps used last, since many runs share one."""
_MAPS_KEPT = 4


def _squares_of(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    key = hashlib.blake2b(np.packbits(occupied), key=repr(occupied.shape).encode()).digest()
    squares = _SQUARES.pop(key, None)
    if squares is None:
        squares = free_squares(occupied)
    _SQUARES[key] = squares  # the newest last
    if len(_SQUARES) > _MAPS_KEPT:
        del _SQUARES[next(iter(_SQUARES))]
    return squares


def _checked_discs(discs: NDArray[np.float64] | Sequence[Sequence[float]]) -> NDArray[np.float64]:
    try:
        array = np.array(discs, np.float64).reshape(len(discs), 3)
    except ValueError as exc:
        raise InputError("round obstacles are rows x, y, radius (m)", obstacles=list(discs)) from exc
    for x, y, r in array:
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(r) and r > 0.0):
            raise InputError(
                f"the obstacle {x:g},{y:g},{r:g} is none: give x, y and a radius above 0, in metres",
                obstacle=[float(x), float(y), float(r)],
            )
    return array
