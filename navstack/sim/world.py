"""What the simulated robot drives among: the occupied cells of a map, discs and polygons."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, GridGeometry, InputError, OccupancyGrid, Pose2D
from navstack.sim.collision import clearances, find_collision, find_near
from navstack.sim.crowd import Crowd
from navstack.sim.map_cells import cell_tables
from navstack.sim.movers import Mover, TimedShapes
from navstack.sim.shapes import LOW, PedestrianMotion, Shape, Still
from navstack.sim.solids import Solids, concatenate_solids, pack_outlines, place_polygons, solids_from_discs

OCCUPIED = 100
"""Cells of a map with at least this value are walls; the static layer's default lethal threshold."""

FAR_M = 1e6
"""Coordinate of a place from where a robot has no influence (m)."""

_POINT = np.zeros((1, 2))
_DIRECTIONS = np.arange(16) * (math.pi / 8.0)
_CIRCLE: NDArray[np.float64] = np.column_stack((np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)))
_RINGS: NDArray[np.float64] = np.concatenate((np.zeros((1, 2)), 0.5 * _CIRCLE, _CIRCLE))
"""(33, 2) samples of the unit disc: its center and two rings."""


class World:
    """A map, discs and polygons, in the map frame (m).

    Occupied cells are solid squares. Unknown cells, and everything outside the map, are empty. The grid may be rotated
    (`origin_yaw`). A world has no state: the simulated robot advances the pedestrians, whose motion depends on it (`crowd`).
    """

    def __init__(
        self,
        map: OccupancyGrid | None = None,
        discs: NDArray[np.float64] | Sequence[Sequence[float]] = (),
        movers: Sequence[Mover] = (),
        low_discs: NDArray[np.float64] | Sequence[Sequence[float]] = (),
        shapes: Sequence[Shape] = (),
    ) -> None:
        """`discs` (n, 3): x, y, radius (m) of static obstacles. `low_discs` likewise, of height `LOW`: a lidar mounted higher
        does not see them, but the robot collides with them. `shapes`: further obstacles, static or moving. Without a map, the
        ground is empty.

        Raises InputError for discs that are not finite or have no radius, and for tracks without length.
        """
        self.map = map if map is not None else OccupancyGrid(np.zeros((1, 1), np.int8), GridGeometry(1, 1, 1.0))
        geometry = self.map.geometry
        self.grid: NDArray[np.float64] = np.array(
            [geometry.origin_x, geometry.origin_y, self.map.origin_yaw, geometry.resolution]
        )
        """[origin x, origin y, origin yaw, resolution] for the kernels."""
        self._tables = cell_tables(self.map.data >= OCCUPIED)
        self.squares: NDArray[np.uint8] = self._tables.squares
        """(4, ny, nx): free squares of every cell, one per quadrant; 0 = occupied."""
        self.movers = tuple(movers)
        self.shapes = tuple(shapes)
        self.people = [shape for shape in shapes if isinstance(shape.motion, PedestrianMotion)]
        self._low = _checked_discs(low_discs)
        self._timed = TimedShapes(shapes)
        self._is_timed = bool(self.movers) or len(self._timed) > 0
        self.moves = self._is_timed or bool(self.people)
        """True if any obstacle moves."""
        self.replayed = self._timed.replayed
        self.persons = [*self.replayed, *self.people]
        """All persons, in their order among the discs of the simulated robot, where they are the last."""
        self._still = [shape for shape in shapes if isinstance(shape.motion, Still)]
        self._shape_solids = _static_solids(self._still)
        self._solids = self._with_static(_checked_discs(discs))
        self._last: tuple[float, Solids] | None = None
        self._layout: Solids | None = None

    @property
    def leaps(self) -> NDArray[np.uint8]:
        """(8, ny, nx): free rectangles for rays (`free_rectangles`), computed for the first ray."""
        return self._tables.leaps

    def solids_at(self, time: float) -> Solids:
        """Returns all discs and polygons at `time` (s) except pedestrians: low discs, static discs, movers, moving shapes."""
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
            # heights and the polygons' corner counts are constant
            parts = [still, *(solids_from_discs(d, np.full(len(d), math.inf)) for d in discs[1 : 1 + len(self.movers)])]
            solids = concatenate_solids(parts if timed is None else [*parts, timed])
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
        """Returns the discs (n, 3) x, y, radius (m) of `solids_at`. Read-only."""
        return self.solids_at(time).discs

    def crowd(self, seed: int, before: Crowd | None = None) -> Crowd | None:
        """Returns the pedestrians at the start of a run with this seed, None if there are none; those in `before` continue."""
        return Crowd(self.people, seed, before) if self.people else None

    def crowd_without_robot(self, seed: int, arrivals: NDArray[np.int64], steps: int, frequency: float) -> Crowd | None:
        """Returns the pedestrians of a run with this seed without a robot, each with this number of `arrivals` (p,), if it has
        them within twice the `steps` of physics at the `frequency` (Hz).
        """
        crowd = self.crowd(seed)
        if crowd is None:
            return None
        crowd.count_arrivals(arrivals)
        nowhere = np.array([FAR_M, FAR_M, 0.0, 0.0, 0.0])
        for step in range(1, 2 * steps + 1):
            solids = self.solids_at(step / frequency)
            crowd.step(1.0 / frequency, self.squares, self.grid, solids, nowhere)
            if step % 50 == 0 and (crowd.arrivals >= arrivals).all():
                break
        return crowd

    def put_discs(self, discs: NDArray[np.float64] | Sequence[Sequence[float]]) -> None:
        """Replaces the static discs, except low discs and shapes: moves obstacles step by step."""
        self._solids = self._with_static(_checked_discs(discs))
        self._last = self._layout = None

    def _with_static(self, discs: NDArray[np.float64]) -> Solids:
        """Returns the low discs, `discs` and the static shapes."""
        tops = np.concatenate((np.full(len(self._low), LOW), np.full(len(discs), math.inf)))
        solids = solids_from_discs(np.concatenate((self._low, discs)), tops)
        return concatenate_solids([solids, self._shape_solids]) if self._still else solids

    @property
    def polygons(self) -> list[Shape]:
        """The shapes of the polygons in `solids_at`, in this order."""
        return [*(shape for shape in self._still if shape.radius is None), *self._timed.polygons]

    def name_of(self, kind: str, index: int) -> str:
        """Returns the name of a disc or polygon (kind and index as from `identify`), "" if it has none."""
        named: list[Shape | None]
        if kind == "polygon":
            named = [*self.polygons]
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
        """True for a position on the map; the yaw of the pose is ignored."""
        geometry = self.map.geometry
        c, s = math.cos(self.map.origin_yaw), math.sin(self.map.origin_yaw)
        dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
        return 0.0 <= c * dx + s * dy < geometry.width_m and 0.0 <= c * dy - s * dx < geometry.height_m

    def is_free(self, footprint: Footprint, pose: Pose2D, time: float = 0.0) -> bool:
        """True if the footprint at `pose` collides with neither the map nor the solids at `time` (s)."""
        return self.collision(footprint, pose, time) is None

    def collision(
        self, footprint: Footprint, pose: Pose2D, time: float = 0.0, solids: Solids | None = None
    ) -> tuple[str, int, float, float] | None:
        """Returns what the footprint at `pose` collides with, as from `identify`; None if it is free.

        `solids` replace `solids_at(time)`. Raises InputError for a pose that is not finite.
        """
        _check_finite(pose)
        solids = self.solids_at(time) if solids is None else solids
        count = len(solids.discs) + len(solids.circles)
        hit = int(
            find_collision(
                self.squares,
                self.grid,
                solids.geometry,
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
        return None if hit == -1 else self.identify(hit, solids)

    def near_obstacle(self, points: NDArray[np.float64], reach: float, solids: Solids) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 2) (m, map frame) are within `reach` (m) of an occupied cell or one of `solids`.

        Cells are sampled on two rings of 16 points around each point: exact enough if they are not much smaller than `reach`.
        """
        found = np.zeros(len(points), np.bool_)
        find_near(points, reach, reach * _RINGS, self.squares, self.grid, solids.geometry, found)
        return found

    def identify(self, hit: int, solids: Solids) -> tuple[str, int, float, float]:
        """Decodes a result of `find_collision`: kind, index and center x, y (m) of the obstacle.

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
        """Returns the exact distance (m) from the position, or the footprint there, to the nearest obstacle at `time` (s).

        0 in collision, inf without obstacles. `solids` and InputError as in `collision`.
        """
        _check_finite(pose)
        solids = self.solids_at(time) if solids is None else solids
        return float(self.clearances(np.array([pose], np.float64), footprint, solids)[0])

    def clearances(
        self, poses: NDArray[np.float64], footprint: Footprint | None, solids: Solids
    ) -> NDArray[np.float64]:
        """(n,) `clearance` (m) at each of the poses (n, 3) (m, rad, map frame), all finite, among `solids`."""
        vertices = _POINT if footprint is None else footprint.vertices.copy()
        out = np.empty(len(poses))
        clearances(
            self.squares,
            self.grid,
            solids.discs,
            solids.circles,
            solids.corners,
            solids.first,
            vertices,
            poses,
            out,
        )
        return out


def _static_solids(shapes: Sequence[Shape]) -> Solids:
    """Returns shapes at their poses."""
    discs = [(*shape.pose[:2], shape.radius) for shape in shapes if shape.radius is not None]
    polygons = [shape for shape in shapes if shape.radius is None]
    outlines, first, centers = pack_outlines([np.array(shape.outline(), np.float64) for shape in polygons])
    poses = np.array([shape.pose for shape in polygons], np.float64).reshape(-1, 3)
    corners, circles = place_polygons(outlines, first, centers, poses)
    tops = [shape.top for shape in (*(s for s in shapes if s.radius is not None), *polygons)]
    return Solids(np.array(discs, np.float64).reshape(-1, 3), circles, corners, first, np.array(tops, np.float64))


def _check_finite(pose: Pose2D) -> None:
    if not pose.is_finite():
        raise InputError(f"the pose {tuple(pose)} is not finite", pose=pose)


def _checked_discs(discs: NDArray[np.float64] | Sequence[Sequence[float]]) -> NDArray[np.float64]:
    try:
        array = np.array(discs, np.float64).reshape(len(discs), 3)
    except (ValueError, TypeError) as exc:
        raise InputError(
            "an obstacle is not a row of three numbers; give x, y, radius in meters", obstacles=list(discs)
        ) from exc
    for x, y, r in array:
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(r) and r > 0.0):
            raise InputError(
                f"the obstacle {x:g},{y:g},{r:g} is invalid; give finite x and y and a radius above 0, in meters",
                obstacle=[float(x), float(y), float(r)],
            )
    return array
