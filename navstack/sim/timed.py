"""Shapes whose places are a function of time: on tracks, and doors."""

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
    """Discs and polygons on tracks, and doors, all placed in one pass. Where they are depends on time alone."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        """Takes those of `shapes` that move so; `discs` and `polygons` list them in the order of `at`."""
        self.discs = [s for s in shapes if isinstance(s.motion, OnTrack) and s.radius is not None]
        on_track = [s for s in shapes if isinstance(s.motion, OnTrack) and s.radius is None]
        self._doors = [Door(s) for s in shapes if isinstance(s.motion, DoorMotion)]
        self.polygons = [*on_track, *(door.shape for door in self._doors)]
        riding = [*self.discs, *on_track]
        self._tracked = TrackedDiscs([_track(shape) for shape in riding])
        motions = [shape.motion for shape in riding if isinstance(shape.motion, OnTrack)]
        self._along = np.array([motion.heading == "along" for motion in motions], np.bool_)
        self._spin = np.array([motion.spin for motion in motions], np.float64)
        self._offset = np.array([shape.pose for shape in riding], np.float64).reshape(-1, 3)
        self._turns = bool(self._along.any()) or bool(self._offset[:, :2].any())
        outlines = [np.array(shape.outline(), np.float64) for shape in on_track]
        outlines += [door.outline for door in self._doors]
        self._outlines, self._first, self._centres = packed(outlines)
        self._disc_tops = np.array([shape.top for shape in self.discs], np.float64)
        self._polygon_tops = np.array([shape.top for shape in self.polygons], np.float64)

    def __len__(self) -> int:
        return len(self.discs) + len(self.polygons)

    def at(self, time: float) -> Solids:
        """All of them at `time` (s)."""
        poses = self._riding(time)
        discs = _NO_DISCS
        count = len(self.discs)
        if count:
            discs = poses[:count].copy()
            discs[:, 2] = [shape.radius for shape in self.discs]
        poses = np.concatenate((poses[count:], np.array([door.pose(time) for door in self._doors]).reshape(-1, 3)))
        corners, circles = place_polygons(self._outlines, self._first, self._centres, poses)
        return Solids(discs, self._disc_tops, circles, corners, self._first, self._polygon_tops)

    def _riding(self, time: float) -> NDArray[np.float64]:
        """(k, 3) poses of what is on tracks: disc or polygon."""
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
    """Where one door is."""

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
        """0 closed .. 1 open at `time` (s)."""
        motion = self._motion
        # with a period, also what is still closing from the one before
        times = [time] if motion.period is None else [time % motion.period, time % motion.period + motion.period]
        most = 0.0
        for t in times:
            for begin, end in motion.open:
                if motion.moving_time == 0.0:
                    most = max(most, 1.0 if begin <= t < end else 0.0)
                else:
                    # one that is told to close before it is quite open turns back there
                    opened = min((min(t, end) - begin) / motion.moving_time, 1.0)
                    most = max(most, opened - max(t - end, 0.0) / motion.moving_time)
        return most

    def pose(self, time: float) -> tuple[float, float, float]:
        """By what the closed outline is moved at `time` (s): x, y, yaw (m, rad)."""
        share = self.openness(time)
        if self._motion.style == "sliding":
            return share * self._slide[0], share * self._slide[1], 0.0
        yaw = share * self._motion.angle
        (hx, hy), c, s = self._hinge, math.cos(yaw), math.sin(yaw)
        return hx - c * hx + s * hy, hy - s * hx - c * hy, yaw


def packed(
    outlines: Sequence[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Outlines one after the other: corners (m, 2), where each begins (p + 1,), a circle about each (p, 3) x, y, radius."""
    first = np.cumsum([0, *(len(outline) for outline in outlines)], dtype=np.int64)
    circles = np.empty((len(outlines), 3))
    for k, outline in enumerate(outlines):
        centre = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
        # rounding, when it is placed, must not put a corner outside
        circles[k] = *centre, float(np.hypot(*(outline - centre).T).max()) * (1.0 + 1e-9) + 1e-9
    return np.concatenate([np.empty((0, 2)), *outlines]), first, circles


def _track(shape: Shape) -> Track:
    assert isinstance(shape.motion, OnTrack)
    motion = shape.motion
    # a polygon has no radius, and nobody looks at the one that it is given here
    return Track(motion.points, motion.speed, shape.radius or 1.0, motion.closed, motion.begin)
