"""Round obstacles that move by themselves: where they are is a function of time alone, so a run stays reproducible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError


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
        corners: list[NDArray[np.float64]] = []
        for number, track in enumerate(tracks, 1):
            points = np.array(track.points, np.float64)
            if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
                raise InputError(f"track {number} needs at least two points [x, y] of finite numbers", track=number)
            if not (np.isfinite([track.speed, track.radius, track.begin]).all() and track.radius > 0.0):
                raise InputError(
                    f"track {number}: speed, begin and a radius above 0 must be finite numbers", track=number
                )
            # a round trip in either case
            trip = np.vstack((points, points[:1] if track.closed else points[-2::-1]))
            if np.hypot(*np.diff(trip, axis=0).T).sum() <= 0.0:
                raise InputError(f"track {number} has no length: its points are all one", track=number)
            corners.append(trip)
        self._radius = np.array([track.radius for track in tracks], np.float64)
        self._speed = np.array([track.speed for track in tracks], np.float64)
        self._begin = np.array([track.begin for track in tracks], np.float64)
        # all legs of all tracks in one line, so that one search finds the leg of every disc
        legs = [np.diff(trip, axis=0) for trip in corners]
        lengths = [np.hypot(leg[:, 0], leg[:, 1]) for leg in legs]
        self._length = np.array([length.sum() for length in lengths], np.float64)
        self._line_begin = np.concatenate(([0.0], np.cumsum(self._length)))[:-1]
        counts = np.array([len(leg) for leg in legs], np.int64)
        self._last_leg = np.cumsum(counts) - 1
        self._first_leg = self._last_leg - counts + 1
        self._leg = np.concatenate([np.empty((0, 2)), *legs])
        self._corner = np.concatenate([np.empty((0, 2)), *(trip[:-1] for trip in corners)])
        self._leg_length = np.concatenate([np.empty(0), *lengths])
        self._leg_begin = np.concatenate(
            [
                np.empty(0),
                *(at + np.cumsum(length) - length for at, length in zip(self._line_begin, lengths, strict=True)),
            ]
        )

    def discs(self, time: float) -> NDArray[np.float64]:
        """(k, 3) x, y, radius in the map (m) at `time` (s), in the order of the tracks."""
        line = self._line_begin + (self._begin + self._speed * time) % self._length
        leg = np.searchsorted(self._leg_begin, line, side="right") - 1
        leg = np.clip(leg, self._first_leg, self._last_leg)  # rounding must not send a disc to its neighbour's track
        length = self._leg_length[leg]
        share = np.divide(line - self._leg_begin[leg], length, out=np.zeros(len(line)), where=length > 0.0)
        at = self._corner[leg] + np.clip(share, 0.0, 1.0)[:, None] * self._leg[leg]
        return np.column_stack((at, self._radius))
