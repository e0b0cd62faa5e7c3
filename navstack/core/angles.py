"""Angles in radians, counter-clockwise, yaw in (-pi, pi]."""

from __future__ import annotations

import math


def normalize_angle(angle: float) -> float:
    """Return `angle` (rad) normalized to (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    remainder = math.remainder(angle, 2.0 * math.pi)  # [-pi, pi]
    return math.pi if remainder <= -math.pi else remainder


def angle_between(start: float, end: float) -> float:
    """Return the shortest rotation (rad, in (-pi, pi]) from the heading `start` to the heading `end`."""
    return normalize_angle(end - start)
