"""Shapes whose poses are a function of time: shapes on tracks, and doors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.sim._shape_kernels import place_polygons
from navstack.sim.movers import Track, TrackedDiscs
from navstack.sim.shapes import DoorMotion, OnTrack, Shape
from navstack.sim.solids import Solids

_NO_DISCS: Final = np.empty((0, 3))


class TimedShapes:
    """Discs and polygons on tracks, and doors, all placed in one pass. Their poses depend on time only."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        """Selects the moving shapes among `shapes`; `discs` and `polygons` list them in the order of `at`."""
        self.discs = [s for s in shapes if isinstance(s.motion, OnTrack) and s.radius is not None]
        on_track = [s for s in shapes if isinstance(s.motion, OnTrack) and s.radius is None]
        self._doors = [Door(s) for s in shapes if isinstance(s.motion, DoorMotion)]
        self.polygons = [*on_track, *(door.shape for door in self._doors)]
        on_tracks = [*self.discs, *on_track]
        self._tracked = TrackedDiscs([_track(shape) for shape in on_tracks])
        motions = [shape.motion for shape in on_tracks if isinstance(shape.motion, OnTrack)]
        self._along = np.array([motion.heading == "along" for motion in motions], np.bool_)
        self._spin = np.array([motion.spin for motion in motions], np.float64)
        self._offset = np.array([shape.pose for shape in on_tracks], np.float64).reshape(-1, 3)
        self._turns = bool(self._along.any()) or bool(self._offset[:, :2].any())
        outlines = [np.array(shape.outline(), np.float64) for shape in on_track]
        outlines += [door.outline for door in self._doors]
        self._outlines, self._first, self._centres = pack_outlines(outlines)
        self._tops = np.array([shape.top for shape in (*self.discs, *self.polygons)], np.float64)

    def __len__(self) -> int:
        return len(self.discs) + len(self.polygons)

    def at(self, time: float) -> Solids:
        """Returns all of them at `time` (s)."""
        poses = self._poses_on_tracks(time)
        discs = _NO_DISCS
        count = len(self.discs)
        if count:
            discs = poses[:count].copy()
            discs[:, 2] = [shape.radius for shape in self.discs]
        poses = np.concatenate((poses[count:], np.array([door.pose(time) for door in self._doors]).reshape(-1, 3)))
        corners, circles = place_polygons(self._outlines, self._first, self._centres, poses)
        return Solids(discs, circles, corners, self._first, self._tops)

    def _poses_on_tracks(self, time: float) -> NDArray[np.float64]:
        """(k, 3) poses of the shapes on tracks."""
        tracked = self._tracked
        if not len(self._offset):
            return np.empty((0, 3))
        poses = tracked.discs(time)
        headings = np.where(self._along, tracked.headings(time), 0.0) if self._turns else 0.0
        c, s = np.cos(headings), np.sin(headings)
        poses[:, 0] += c * self._offset[:, 0] - s * self._offset[:, 1]
        poses[:, 1] += s * self._offset[:, 0] + c * self._offset[:, 1]
        poses[:, 2] = headings + self._offset[:, 2] + self._spin * time
        return poses


class Door:
    """The motion of a door."""

    def __init__(self, shape: Shape) -> None:
        assert isinstance(shape.motion, DoorMotion)
        self.shape = shape
        self._motion = shape.motion
        x, y, yaw = shape.pose
        c, s = math.cos(yaw), math.sin(yaw)
        self.outline: NDArray[np.float64] = np.array(
            [(x + c * u - s * v, y + s * u + c * v) for u, v in shape.outline()]
        )
        """(n, 2) closed, in the map."""
        ends = [(x + c * u - s * v, y + s * u + c * v) for u, v in shape.segment or [[0.0, 0.0], [0.0, 0.0]]]
        self._hinge = tuple(self._motion.hinge) if self._motion.hinge is not None else ends[0]
        aside = (ends[0][0] - ends[1][0], ends[0][1] - ends[1][1])
        self._slide = tuple(self._motion.slide) if self._motion.slide is not None else aside

    def openness(self, time: float) -> float:
        """Returns 0 (closed) .. 1 (open) at `time` (s)."""
        motion = self._motion
        # with a period, include the closing phase of the previous one
        times = [time] if motion.period is None else [time % motion.period, time % motion.period + motion.period]
        most = 0.0
        for t in times:
            for begin, end in motion.open:
                if motion.moving_time == 0.0:
                    most = max(most, 1.0 if begin <= t < end else 0.0)
                else:
                    # a door that closes before it is fully open reverses there
                    opened = min((min(t, end) - begin) / motion.moving_time, 1.0)
                    most = max(most, opened - max(t - end, 0.0) / motion.moving_time)
        return most

    def pose(self, time: float) -> tuple[float, float, float]:
        """Returns the displacement of the closed outline at `time` (s): x, y, yaw (m, rad)."""
        share = self.openness(time)
        if self._motion.style == "sliding":
            return share * self._slide[0], share * self._slide[1], 0.0
        yaw = share * self._motion.angle
        (hx, hy), c, s = self._hinge, math.cos(yaw), math.sin(yaw)
        return hx - c * hx + s * hy, hy - s * hx - c * hy, yaw


def pack_outlines(
    outlines: Sequence[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Concatenates outlines: corners (m, 2), index of each first corner (p + 1,), bounding circles (p, 3) x, y, radius."""
    first = np.cumsum([0, *(len(outline) for outline in outlines)], dtype=np.int64)
    circles = np.empty((len(outlines), 3))
    for k, outline in enumerate(outlines):
        centre = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
        # margin for the rounding of the corners when the polygon is placed
        circles[k] = *centre, float(np.hypot(*(outline - centre).T).max()) * (1.0 + 1e-9) + 1e-9
    return np.concatenate([np.empty((0, 2)), *outlines]), first, circles


def _track(shape: Shape) -> Track:
    assert isinstance(shape.motion, OnTrack)
    motion = shape.motion
    # the radius is not used for polygons
    return Track(motion.points, motion.speed, shape.radius or 1.0, motion.closed, motion.start_offset)
