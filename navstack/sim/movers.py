"""Round obstacles that move by themselves: where they are is a function of time alone, so a run stays reproducible."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.sim._mover_kernels import headings_on_tracks, place_on_tracks


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A way that a disc follows at constant speed, for ever."""

    points: Sequence[Sequence[float]]
    """(m, 2) corners of the way in the map (m)."""
    speed: float
    """m/s; negative: the other way round."""
    radius: float
    """Of the disc, m."""
    closed: bool = False
    """True: from the last corner straight to the first and round again; false: there and back."""
    begin: float = 0.0
    """How far along the way it starts, m."""


class TrackedDiscs:
    """Discs on tracks, all of them placed in one pass."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        """Raises InputError for a track without length or with numbers that are not finite."""
        trips: list[NDArray[np.float64]] = []
        ways: list[NDArray[np.float64]] = []
        for number, track in enumerate(tracks, 1):
            points: NDArray[np.float64] | None = None
            with suppress(ValueError, TypeError):  # not even a table
                points = np.array(track.points, np.float64)
            if (
                points is None
                or points.ndim != 2
                or points.shape[1] != 2
                or len(points) < 2
                or not np.isfinite(points).all()
            ):
                raise InputError(f"track {number} needs at least two points [x, y] of finite numbers", track=number)
            if not (np.isfinite([track.speed, track.radius, track.begin]).all() and track.radius > 0.0):
                raise InputError(
                    f"track {number}: speed, begin and a radius above 0 must be finite numbers", track=number
                )
            # a round trip in either case
            trip = np.vstack((points, points[:1] if track.closed else points[-2::-1]))
            way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(trip, axis=0).T))))
            if way[-1] <= 0.0:
                raise InputError(f"track {number} has no length: its points are all one", track=number)
            trips.append(trip)
            ways.append(way)
        self._radius = np.array([track.radius for track in tracks], np.float64)
        self._speed = np.array([track.speed for track in tracks], np.float64)
        self._begin = np.array([track.begin for track in tracks], np.float64)
        self._first_corner = np.concatenate(([0], np.cumsum([len(trip) for trip in trips], dtype=np.int64)))
        self._corners = np.concatenate([np.empty((0, 2)), *trips])
        self._corner_at = np.concatenate([np.empty(0), *ways])

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s), in the order of the tracks."""
        return place_on_tracks(
            self._corners, self._first_corner, self._corner_at, self._speed, self._begin, self._radius, float(time)
        )

    def headings(self, time: float) -> NDArray[np.float64]:
        """(k,) direction (rad) in which each moves at `time` (s)."""
        return headings_on_tracks(
            self._corners, self._first_corner, self._corner_at, self._speed, self._begin, float(time)
        )
