"""Obstacles whose poses are a function of time, so that runs stay reproducible: on tracks, replayed persons, and doors.

`TimedShapes` places the shapes of a scenario; a `Mover` is anything else that moves discs.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, kernel
from navstack.sim.shapes import DoorMotion, OnTrack, ReplayMotion, Shape
from navstack.sim.solids import Solids, pack_outlines, place_polygons


@kernel
def find_on_track(corners, corner_at, low, high, at):
    """Position x, y (m) after `at` meters of the round trip with corners `low` .. `high`, and the direction of the leg."""
    # binary search for the leg: corner_at[low] <= at < corner_at[high]
    while high - low > 1:
        middle = (low + high) // 2
        if corner_at[middle] <= at:
            low = middle
        else:
            high = middle
    leg = corner_at[high] - corner_at[low]
    share = min(max((at - corner_at[low]) / leg, 0.0), 1.0) if leg > 0.0 else 0.0
    dx, dy = corners[high, 0] - corners[low, 0], corners[high, 1] - corners[low, 1]
    return corners[low, 0] + share * dx, corners[low, 1] + share * dy, dx, dy


@kernel
def place_on_tracks(corners, first_corner, corner_at, speed, start_offset, radius, time):
    """(k, 3) x, y, radius (m) at `time` (s) of k discs.

    `corners` (m, 2) of all round trips, concatenated, each closed by its first corner; those of disc k are `first_corner[k]` ..
    `first_corner[k + 1] - 1`. `corner_at` (m,): distance of each corner along its trip (m).
    """
    count = speed.shape[0]
    discs = np.empty((count, 3))
    for k in range(count):
        low, high = first_corner[k], first_corner[k + 1] - 1
        at = (start_offset[k] + speed[k] * time) % corner_at[high]
        discs[k, 0], discs[k, 1], _, _ = find_on_track(corners, corner_at, low, high, at)
        discs[k, 2] = radius[k]
    return discs


@kernel
def headings_on_tracks(corners, first_corner, corner_at, speed, start_offset, time):
    """(k,) direction of motion (rad) of each of k objects at `time` (s); arguments as in `place_on_tracks`."""
    headings = np.empty(speed.shape[0])
    for k in range(speed.shape[0]):
        low, high = first_corner[k], first_corner[k + 1] - 1
        at = (start_offset[k] + speed[k] * time) % corner_at[high]
        _, _, dx, dy = find_on_track(corners, corner_at, low, high, at)
        headings[k] = math.atan2(dy, dx) if speed[k] >= 0.0 else math.atan2(-dy, -dx)
    return headings


@kernel
def place_replayed(points, first, radius, time, discs):
    """Writes x, y, radius (m) of k persons at `time` (s) to `discs` (k, 3); x and y are NaN while one is absent.

    `points` (m, 3): recorded t, x, y of all, concatenated; those of person k are `first[k]` .. `first[k + 1] - 1`.
    """
    for k in range(radius.shape[0]):
        low, high = first[k], first[k + 1] - 1
        discs[k, 0], discs[k, 1], discs[k, 2] = math.nan, math.nan, radius[k]
        if time < points[low, 0] or time > points[high, 0]:
            continue
        while high - low > 1:
            middle = (low + high) // 2
            if points[middle, 0] <= time:
                low = middle
            else:
                high = middle
        span = points[high, 0] - points[low, 0]
        share = (time - points[low, 0]) / span if span > 0.0 else 0.0
        discs[k, 0] = points[low, 1] + share * (points[high, 1] - points[low, 1])
        discs[k, 1] = points[low, 2] + share * (points[high, 2] - points[low, 2])


class Mover(Protocol):
    """Round obstacles whose positions are a function of time."""

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s); k is constant."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A track that a disc follows at constant speed, without end."""

    points: Sequence[Sequence[float]]
    """(m, 2) corners of the track in the map (m)."""
    speed: float
    """m/s; negative: in the reverse direction."""
    radius: float
    """Radius of the disc (m)."""
    closed: bool = False
    """True: from the last corner straight to the first; false: back and forth."""
    start_offset: float = 0.0
    """Position on the track at time 0 (m)."""


class TrackedDiscs:
    """Discs on tracks, all placed in one pass."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        """Raises InputError for a track without length or with numbers that are not finite."""
        trips: list[NDArray[np.float64]] = []
        corner_distances: list[NDArray[np.float64]] = []
        for number, track in enumerate(tracks, 1):
            points: NDArray[np.float64] | None = None
            with suppress(ValueError, TypeError):  # rows of different lengths, or not numbers
                points = np.array(track.points, np.float64)
            if (
                points is None
                or points.ndim != 2
                or points.shape[1] != 2
                or len(points) < 2
                or not np.isfinite(points).all()
            ):
                raise InputError(f"track {number} needs at least two points [x, y] of finite numbers", track=number)
            if not (np.isfinite([track.speed, track.radius, track.start_offset]).all() and track.radius > 0.0):
                raise InputError(
                    f"track {number}: speed, start_offset and a radius above 0 must be finite numbers", track=number
                )
            # closed tracks and back-and-forth tracks both become round trips
            trip = np.vstack((points, points[:1] if track.closed else points[-2::-1]))
            distances = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(trip, axis=0).T))))
            if distances[-1] <= 0.0:
                raise InputError(f"track {number} has no length; give at least two different points", track=number)
            trips.append(trip)
            corner_distances.append(distances)
        self._radius = np.array([track.radius for track in tracks], np.float64)
        self._speed = np.array([track.speed for track in tracks], np.float64)
        self._start_offset = np.array([track.start_offset for track in tracks], np.float64)
        self._first_corner = np.concatenate(([0], np.cumsum([len(trip) for trip in trips], dtype=np.int64)))
        self._corners = np.concatenate([np.empty((0, 2)), *trips])
        self._corner_at = np.concatenate([np.empty(0), *corner_distances])

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s), in the order of the tracks."""
        return place_on_tracks(
            self._corners,
            self._first_corner,
            self._corner_at,
            self._speed,
            self._start_offset,
            self._radius,
            float(time),
        )

    def headings(self, time: float) -> NDArray[np.float64]:
        """(k,) direction of motion (rad) of each at `time` (s)."""
        return headings_on_tracks(
            self._corners, self._first_corner, self._corner_at, self._speed, self._start_offset, float(time)
        )


class Replays:
    """Persons at recorded positions, all placed in one pass."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        """`shapes`: discs with the motion of a replay."""
        points = [shape.motion.points for shape in shapes if isinstance(shape.motion, ReplayMotion)]
        self._points = np.concatenate([np.empty((0, 3)), *(np.array(each, np.float64) for each in points)])
        self._first = np.cumsum([0, *(len(each) for each in points)], dtype=np.int64)
        self._radius = np.array([shape.radius for shape in shapes], np.float64)

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s); NaN while absent."""
        discs = np.empty((len(self._radius), 3))
        place_replayed(self._points, self._first, self._radius, float(time), discs)
        return discs


_NO_DISCS: Final = np.empty((0, 3))


class TimedShapes:
    """Shapes on tracks, replayed persons and the shapes of `SINGLY_MOVED`. Their poses depend on time only."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        """Selects the moving shapes among `shapes`; `discs` and `polygons` list them in the order of `at`."""
        self._on_tracks = [s for s in shapes if isinstance(s.motion, OnTrack) and s.radius is not None]
        self.replayed = [s for s in shapes if isinstance(s.motion, ReplayMotion)]
        self.discs = [*self._on_tracks, *self.replayed]
        on_track = [s for s in shapes if isinstance(s.motion, OnTrack) and s.radius is None]
        self._singly = [SINGLY_MOVED[type(s.motion)](s) for s in shapes if type(s.motion) in SINGLY_MOVED]
        self.polygons = [*on_track, *(moved.shape for moved in self._singly)]
        self._replays = Replays(self.replayed)
        on_tracks = [*self._on_tracks, *on_track]
        self._tracked = TrackedDiscs([_track(shape) for shape in on_tracks])
        motions = [shape.motion for shape in on_tracks if isinstance(shape.motion, OnTrack)]
        self._along = np.array([motion.heading == "along" for motion in motions], np.bool_)
        self._spin = np.array([motion.spin for motion in motions], np.float64)
        self._offset = np.array([shape.pose for shape in on_tracks], np.float64).reshape(-1, 3)
        self._turns = bool(self._along.any()) or bool(self._offset[:, :2].any())
        outlines = [np.array(shape.outline(), np.float64) for shape in on_track]
        outlines += [moved.outline for moved in self._singly]
        self._outlines, self._first, self._centers = pack_outlines(outlines)
        self._tops = np.array([shape.top for shape in (*self.discs, *self.polygons)], np.float64)

    def __len__(self) -> int:
        return len(self.discs) + len(self.polygons)

    def at(self, time: float) -> Solids:
        """Returns all of them at `time` (s)."""
        poses = self._poses_on_tracks(time)
        discs = _NO_DISCS
        count = len(self._on_tracks)
        if count:
            discs = poses[:count].copy()
            discs[:, 2] = [shape.radius for shape in self._on_tracks]
        if self.replayed:
            discs = np.concatenate((discs, self._replays.discs(time)))
        poses = np.concatenate((poses[count:], np.array([moved.pose(time) for moved in self._singly]).reshape(-1, 3)))
        corners, circles = place_polygons(self._outlines, self._first, self._centers, poses)
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


class SinglyMoved(Protocol):
    """A polygon whose pose is a function of time."""

    @property
    def shape(self) -> Shape:
        """The shape as it is written."""
        ...

    @property
    def outline(self) -> NDArray[np.float64]:
        """(n, 2) corners that `pose` displaces (m)."""
        ...

    def pose(self, time: float) -> tuple[float, float, float]:
        """Returns x, y, yaw of the outline in the map at `time` (s) (m, rad)."""
        ...


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


def _track(shape: Shape) -> Track:
    assert isinstance(shape.motion, OnTrack)
    motion = shape.motion
    # the radius is not used for polygons
    return Track(motion.points, motion.speed, shape.radius or 1.0, motion.closed, motion.start_offset)


SINGLY_MOVED: Final[dict[type[Any], Callable[[Shape], SinglyMoved]]] = {DoorMotion: Door}
"""Motion of a shape -> what gives its poses. A further motion of polygons is its parameters in `shapes` and an entry here."""
