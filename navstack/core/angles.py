"""Angles in radians, counter-clockwise, yaw in (-pi, pi]."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def normalize_angle(angle: float) -> float:
    """Return `angle` (rad) normalized to (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    remainder = math.remainder(angle, 2.0 * math.pi)  # [-pi, pi]
    return math.pi if remainder <= -math.pi else remainder


def normalize_angles(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an array of angles (rad) normalized to (-pi, pi]."""
    return -(np.remainder(-angles + np.pi, 2.0 * np.pi) - np.pi)


def angle_between(start: float, end: float) -> float:
    """Return the shortest rotation (rad, in (-pi, pi]) from the heading `start` to the heading `end`."""
    return normalize_angle(end - start)
