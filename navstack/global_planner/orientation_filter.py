"""Headings for a path of points (global_planner/src/orientation_filter.cpp)."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from navstack.core import angle_between, normalize_angle

_STRAIGHT = 0.35
"""The last stretch that turns less than this per point (rad) is interpolated (FORWARD_THEN_INTERPOLATE)."""


class OrientationMode(IntEnum):
    """`orientation_mode` of global_planner."""

    NONE = 0
    FORWARD = 1
    INTERPOLATE = 2
    FORWARD_THEN_INTERPOLATE = 3
    BACKWARD = 4
    LEFTWARD = 5
    RIGHTWARD = 6


_TURN = {
    OrientationMode.FORWARD: 0.0,
    OrientationMode.FORWARD_THEN_INTERPOLATE: 0.0,
    OrientationMode.BACKWARD: math.pi,
    OrientationMode.LEFTWARD: -math.pi / 2.0,
    OrientationMode.RIGHTWARD: math.pi / 2.0,
}


def orient(poses: NDArray[np.float64], start_yaw: float, mode: OrientationMode, window: int = 1) -> None:
    """Writes headings into `poses` (n, 3), whose last keeps its own; that of the first is `start_yaw` where it interpolates.

    FORWARD looks along the path, from `window` points before to `window` points after; BACKWARD, LEFTWARD (the robot's left
    side leads) and RIGHTWARD turn that; INTERPOLATE turns evenly from start to goal; FORWARD_THEN_INTERPOLATE does so on
    the last straight stretch only. NONE leaves all as they are.
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
    poses[:-1, 2] = _wrapped(np.arctan2(step[:, 1], step[:, 0]) + _TURN[mode])
    if mode == OrientationMode.FORWARD_THEN_INTERPOLATE:
        i = max(n - 3, 0)
        last = float(poses[i, 2])
        while i > 0 and abs(angle_between(float(poses[i - 1, 2]), last)) <= _STRAIGHT:
            i -= 1
        poses[0, 2] = start_yaw
        _interpolate(poses, i)


def _interpolate(poses: NDArray[np.float64], first: int) -> None:
    begin, end = float(poses[first, 2]), float(poses[-1, 2])
    count = len(poses) - 1 - first
    if count > 0:
        turned = np.arange(count, dtype=np.float64) * (angle_between(begin, end) / count)
        poses[first:-1, 2] = _wrapped(begin + turned)
        poses[-1, 2] = normalize_angle(end)


def _wrapped(yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    return -((-yaw + np.pi) % (2.0 * np.pi) - np.pi)
