"""What the simulated robot drives among: the occupied cells of a map, discs and polygons."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint, GridGeometry, OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.sim import _body_kernels as body
from navstack.sim._clearance_kernels import clearances
from navstack.sim._lidar_kernels import free_rectangles, free_squares
from navstack.sim._shape_kernels import place_polygons
from navstack.sim.crowd import Crowd
from navstack.sim.shapes import LOW, PedestrianMotion, Shape, Still
from navstack.sim.solids import Solids, discs_only, joined
from navstack.sim.timed import TimedShapes, packed

OCCUPIED = 100
"""A cell of a map is a wall from this value on: what the static layer takes as lethal by default."""

_POINT = np.zeros((1, 2))


class Mover(Protocol):
    """Round obstacles whose places are a function of time."""

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s); always the same k."""
        ...


class World:
    """A map, discs and polygons, in the map's frame (m).

    Occupied cells are solid squares. Unknown cells, and everything outside the map, are empty: they hide nothing and hurt
    nothing. The grid may be turned (`origin_yaw`). A world has no state: people, whose ways depend on the robot's, are
    walked by whoever drives it (`crowd`).
    """

    def __init__(
        self,
        map: OccupancyGrid | None = None,
        discs: NDArray[np.float64] | Sequence[Sequence[float]] = (),
        movers: Sequence[Mover] = (),
        low_discs: NDArray[np.float64] | Sequence[Sequence[float]] = (),
        shapes: Sequence[Shape] = (),
    ) -> None:
        """`discs` (n, 3): x, y, radius (m) of what stands still; without a map the ground is empty. `low_discs` likewise,
        but no higher than `LOW`: thresholds, feet of chairs. A lidar above does not see them; a robot runs into them all
        the same. `shapes`: anything else, standing or moving.

        Raises InputError for discs that are not finite or have no radius, and for tracks without length.
        """
        self.map = map if map is not None else OccupancyGrid(np.zeros((1, 1), np.int8), GridGeometry(1, 1, 1.0))
        geometry = self.map.geometry
        self.grid: NDArray[np.float64] = np.array(
            [geometry.origin_x, geometry.origin_y, self.map.origin_yaw, geometry.resolution]
        )
        """[origin x, origin y, origin yaw, resolution] for the kernels."""
        self._tables = _tables_of(self.map.data >= OCCUPIED)
        self.squares: NDArray[np.uint8] = self._tables.squares
        """(4, ny, nx): the free squares of every cell, one in each quadrant; 0 = occupied."""
        self.movers = tuple(movers)
        self.shapes = tuple(shapes)
        """As given."""
        self.people = [shape for shape in shapes if isinstance(shape.motion, PedestrianMotion)]
        self._low = _checked_discs(low_discs)
        self._timed = TimedShapes(shapes)
        self._is_timed = bool(self.movers) or len(self._timed) > 0
        self.moves = self._is_timed or bool(self.people)
        """True when not everything stays where it is."""
        self._still = [shape for shape in shapes if isinstance(shape.motion, Still)]
        self._shape_solids = _standing(self._still)
        self._solids = self._standing(_checked_discs(discs))
        self._last: tuple[float, Solids] | None = None
        self._layout: Solids | None = None

    @property
    def leaps(self) -> NDArray[np.uint8]:
        """(8, ny, nx): free rectangles for rays (`free_rectangles`), made when the first ray is cast."""
        return self._tables.leaps

    def solids_at(self, time: float) -> Solids:
        """All discs and polygons at `time` (s), but for people: low discs, others that stand, movers, shapes on tracks."""
        if not self._is_timed:
            return self._solids
        if self._last is not None and self._last[0] == time:
            return self._last[1]
        still = self._solids
        discs = [still.discs, *(mover.discs(time) for mover in self.movers)]
        timed = self._timed.at(time) if len(self._timed) else None
        if timed is not None:
            discs.append(timed.discs)
        if self._layout is None:
            # heights, and which corner is whose, are the same at all times
            parts = [still, *(discs_only(d, np.full(len(d), math.inf)) for d in discs[1 : 1 + len(self.movers)])]
            solids = joined(parts if timed is None else [*parts, timed])
            self._layout = solids
        else:
            solids = self._layout._replace(discs=np.concatenate(discs))
            if timed is not None and len(timed.circles):
                solids = solids._replace(
                    circles=np.concatenate((still.circles, timed.circles)),
                    corners=np.concatenate((still.corners, timed.corners)),
                )
        self._last = time, solids
        return solids

    def discs_at(self, time: float) -> NDArray[np.float64]:
        """(n, 3) x, y, radius (m) of the round ones among `solids_at`, in its order. Not to be written to."""
        return self.solids_at(time).discs

    def crowd(self, seed: int) -> Crowd | None:
        """The people of this world at the start of a run with that seed; None when there are none."""
        return Crowd(self.people, seed) if self.people else None

    def put_discs(self, discs: NDArray[np.float64] | Sequence[Sequence[float]]) -> None:
        """Replaces the round obstacles that stand still, except low ones and shapes: for whoever moves things step by step."""
        self._solids = self._standing(_checked_discs(discs))
        self._last = self._layout = None

    def _standing(self, discs: NDArray[np.float64]) -> Solids:
        tops = np.concatenate((np.full(len(self._low), LOW), np.full(len(discs), math.inf)))
        round_ones = discs_only(np.concatenate((self._low, discs)), tops)
        return joined([round_ones, self._shape_solids]) if self._still else round_ones

    def name_of(self, kind: str, index: int) -> str:
        """What a scenario calls that disc or polygon (as `described` gives kind and index), "" for what has no name."""
        named: list[Shape | None]
        if kind == "polygon":
            named = [*(shape for shape in self._still if shape.radius is None), *self._timed.polygons]
        elif kind == "disc":
            standing = [shape for shape in self._still if shape.radius is not None]
            moving = [*self._timed.discs, *self.people]
            movers = len(self.discs_at(0.0)) - len(self._solids.discs) - len(self._timed.discs)
            named = [None] * (len(self._solids.discs) - len(standing))
            named += [*standing, *([None] * movers), *moving]
        else:
            return ""
        shape = named[index]
        return shape.name if shape is not None else ""

    def contains(self, pose: Pose2D) -> bool:
        """True for a position on the map, whichever way it is turned; whatever the yaw."""
        geometry = self.map.geometry
        c, s = math.cos(self.map.origin_yaw), math.sin(self.map.origin_yaw)
        dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
        return 0.0 <= c * dx + s * dy < geometry.width_m and 0.0 <= c * dy - s * dx < geometry.height_m

    def is_free(self, footprint: Footprint, pose: Pose2D, time: float = 0.0) -> bool:
        """True when the outline at `pose` meets neither an occupied cell nor anything of `solids_at` that `time` (s)."""
        return self.collision(footprint, pose, time) is None

    def collision(
        self, footprint: Footprint, pose: Pose2D, time: float = 0.0, solids: Solids | None = None
    ) -> tuple[str, int, float, float] | None:
        """What the outline at `pose` meets, as `described` says it; None when it is free.

        `solids`: what there is beside the map, when the caller knows better than `solids_at(time)`. Raises InputError for
        a pose that is not finite, which would meet nothing.
        """
        _check_finite(pose)
        solids = self.solids_at(time) if solids is None else solids
        count = len(solids.discs) + len(solids.circles)
        hit = int(
            body.find_collision(
                self.squares,
                self.grid,
                solids,
                np.arange(count),
                count,
                footprint.vertices.copy(),
                footprint.circumscribed_radius,
                float(pose.x),
                float(pose.y),
                float(pose.yaw),
                np.empty_like(footprint.vertices),
            )
        )
        return None if hit == -1 else self.described(hit, solids)

    def touched(self, points: NDArray[np.float64], reach: float, solids: Solids) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 2) (m, map frame) have an occupied cell or one of `solids` within `reach` (m).

        Cells are looked for on two rings of 16 points around each: good for those not much smaller than `reach`.
        """
        x, y = points[:, 0], points[:, 1]
        discs = solids.discs
        away = np.hypot(x[:, None] - discs[:, 0], y[:, None] - discs[:, 1]) - discs[:, 2]
        found = (away < reach).any(axis=1)
        for k, (cx, cy, radius) in enumerate(solids.circles.tolist()):
            if bool((np.hypot(x - cx, y - cy) < radius + reach).any()):
                polygon = shapely.Polygon(solids.polygon(k))
                found = found | (shapely.distance(shapely.points(points), polygon) < reach)
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

    def described(self, hit: int, solids: Solids) -> tuple[str, int, float, float]:
        """A kernel's answer in words: what was hit and where its centre is (m).

        ("map", iy * nx + ix, x, y), ("disc", index, x, y) or ("polygon", index, x, y).
        """
        if hit < 0:
            index = -2 - hit
            if index < len(solids.discs):
                return "disc", index, float(solids.discs[index, 0]), float(solids.discs[index, 1])
            index -= len(solids.discs)
            return "polygon", index, float(solids.circles[index, 0]), float(solids.circles[index, 1])
        geometry = self.map.geometry
        iy, ix = divmod(hit, geometry.nx)
        u, v = (ix + 0.5) * geometry.resolution, (iy + 0.5) * geometry.resolution
        c, s = math.cos(self.map.origin_yaw), math.sin(self.map.origin_yaw)
        return "map", hit, geometry.origin_x + c * u - s * v, geometry.origin_y + s * u + c * v

    def clearance(
        self, pose: Pose2D, footprint: Footprint | None = None, time: float = 0.0, solids: Solids | None = None
    ) -> float:
        """Distance (m) from the position, or from the outline there, to the nearest obstacle at `time` (s); exact.

        0 in collision, inf when there is no obstacle at all. `solids` and InputError as of `collision`.
        """
        _check_finite(pose)
        solids = self.solids_at(time) if solids is None else solids
        return float(self.clearances(np.array([pose], np.float64), footprint, solids)[0])

    def clearances(
        self, poses: NDArray[np.float64], footprint: Footprint | None, solids: Solids
    ) -> NDArray[np.float64]:
        """(n,) m: `clearance` at each of the poses (n, 3) (m, rad, map frame), all finite, among `solids`."""
        outline = _POINT if footprint is None else footprint.vertices.copy()
        out = np.empty(len(poses))
        clearances(
            self.squares,
            self.grid,
            solids.discs,
            solids.circles,
            solids.corners,
            solids.first,
            outline,
            poses,
            out,
        )
        return out


def _standing(shapes: Sequence[Shape]) -> Solids:
    """Shapes where their poses are."""
    discs = [(*shape.pose[:2], shape.radius) for shape in shapes if shape.radius is not None]
    polygons = [shape for shape in shapes if shape.radius is None]
    outlines, first, centres = packed([np.array(shape.outline(), np.float64) for shape in polygons])
    poses = np.array([shape.pose for shape in polygons], np.float64).reshape(-1, 3)
    corners, circles = place_polygons(outlines, first, centres, poses)
    return Solids(
        np.array(discs, np.float64).reshape(-1, 3),
        np.array([shape.top for shape in shapes if shape.radius is not None], np.float64),
        circles,
        corners,
        first,
        np.array([shape.top for shape in polygons], np.float64),
    )


class _Tables:
    """What the kernels need of a map's occupied cells."""

    def __init__(self, occupied: NDArray[np.bool_]) -> None:
        self.squares = free_squares(occupied)

    @cached_property
    def leaps(self) -> NDArray[np.uint8]:
        return free_rectangles(self.squares)


_TABLES: dict[bytes, _Tables] = {}
"""By what the map holds: those of the maps used last, since many runs share one."""
_MAPS_KEPT = 4


def _tables_of(occupied: NDArray[np.bool_]) -> _Tables:
    key = hashlib.blake2b(np.packbits(occupied).tobytes(), key=repr(occupied.shape).encode()).digest()
    tables = _TABLES.pop(key, None)
    if tables is None:
        tables = _Tables(occupied)
    _TABLES[key] = tables  # the newest last
    if len(_TABLES) > _MAPS_KEPT:
        del _TABLES[next(iter(_TABLES))]
    return tables


def _check_finite(pose: Pose2D) -> None:
    if not pose.is_finite():
        raise InputError(f"the pose {tuple(pose)} is not finite", pose=pose)


def _checked_discs(discs: NDArray[np.float64] | Sequence[Sequence[float]]) -> NDArray[np.float64]:
    try:
        array = np.array(discs, np.float64).reshape(len(discs), 3)
    except (ValueError, TypeError) as exc:
        raise InputError(
            "round obstacles are rows x, y, radius in metres; give each three numbers", obstacles=list(discs)
        ) from exc
    for x, y, r in array:
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(r) and r > 0.0):
            raise InputError(
                f"the obstacle {x:g},{y:g},{r:g} is none: give x, y and a radius above 0, in metres",
                obstacle=[float(x), float(y), float(r)],
            )
    return array
