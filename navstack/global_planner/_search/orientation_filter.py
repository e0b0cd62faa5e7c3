"""Headings for the points of a path (global_planner/src/orientation_filter.cpp)."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import angle_between, normalize_angle, normalize_angles

_MAX_TURN = 0.35
"""The last stretch with less than this turn per point (rad) is interpolated (FORWARD_THEN_INTERPOLATE)."""


class OrientationMode(IntEnum):
    """`orientation_mode` of global_planner."""

    NONE = 0
    FORWARD = 1
    INTERPOLATE = 2
    FORWARD_THEN_INTERPOLATE = 3
    BACKWARD = 4
    LEFTWARD = 5
    RIGHTWARD = 6


_OFFSETS = {
    OrientationMode.FORWARD: 0.0,
    OrientationMode.FORWARD_THEN_INTERPOLATE: 0.0,
    OrientationMode.BACKWARD: math.pi,
    OrientationMode.LEFTWARD: -math.pi / 2.0,
    OrientationMode.RIGHTWARD: math.pi / 2.0,
}


class OrientationFilter(NamedTuple):
    """How a planner sets the headings of its paths."""

    mode: OrientationMode = OrientationMode.NONE
    window: int = 1
    """`orientation_window_size` of global_planner."""
    sets_start: bool = False
    """Whether the first pose has the yaw of the start where the mode does not set it."""

    def apply(self, poses: NDArray[np.float64], start_yaw: float) -> None:
        """Write headings into `poses` (n, 3), see `orient`."""
        if self.sets_start:
            poses[0, 2] = start_yaw
        orient(poses, start_yaw, self.mode, self.window)


def orient(poses: NDArray[np.float64], start_yaw: float, mode: OrientationMode, window: int = 1) -> None:
    """Write headings into `poses` (n, 3). The last pose keeps its own.

    FORWARD: the direction from `window` points before to `window` points after; BACKWARD, LEFTWARD (the robot's left side is
    in front) and RIGHTWARD add an angle to it; INTERPOLATE turns evenly from `start_yaw` to the goal;
    FORWARD_THEN_INTERPOLATE does so on the last straight stretch only. NONE leaves `poses` unchanged.
    """
    n = len(poses)
    if mode == OrientationMode.NONE or n < 2:
        return
    if mode == OrientationMode.INTERPOLATE:
        poses[0, 2] = start_yaw
        _interpolate(poses, 0)
        return
    index = np.arange(n - 1)
    before, after = np.maximum(index - window, 0), np.minimum(index + window, n - 1)
    step = poses[after, :2] - poses[before, :2]
    poses[:-1, 2] = normalize_angles(np.arctan2(step[:, 1], step[:, 0]) + _OFFSETS[mode])
    if mode == OrientationMode.FORWARD_THEN_INTERPOLATE:
        i = max(n - 3, 0)
        last = float(poses[i, 2])
        while i > 0 and abs(angle_between(float(poses[i - 1, 2]), last)) <= _MAX_TURN:
            i -= 1
        poses[0, 2] = start_yaw
        _interpolate(poses, i)


def _interpolate(poses: NDArray[np.float64], first: int) -> None:
    begin, end = float(poses[first, 2]), float(poses[-1, 2])
    count = len(poses) - 1 - first
    if count > 0:
        turned = np.arange(count, dtype=np.float64) * (angle_between(begin, end) / count)
        poses[first:-1, 2] = normalize_angles(begin + turned)
        poses[-1, 2] = normalize_angle(end)
