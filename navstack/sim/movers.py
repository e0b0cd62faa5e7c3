"""Round obstacles on tracks. Their positions are a function of time only, so runs stay reproducible."""

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
