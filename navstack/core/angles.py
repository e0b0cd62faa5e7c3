"""Angles in radians, counter-clockwise, yaw in (-pi, pi]."""

from __future__ import annotations

import math


def normalize_angle(angle: float) -> float:
    """`angle` (rad) turned by whole circles into (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    turned = math.remainder(angle, 2.0 * math.pi)  # [-pi, pi]
    return math.pi if turned <= -math.pi else turned


def angle_between(start: float, end: float) -> float:
    """The shortest turn (rad, in (-pi, pi]) that takes the heading `start` to the heading `end`."""
    return normalize_angle(end - start)
