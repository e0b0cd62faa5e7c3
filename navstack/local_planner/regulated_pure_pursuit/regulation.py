"""The formulas of regulated pure pursuit: curvature, speed, and the dynamic window around the last command.

Sources: S. Macenski et al., "Regulated Pure Pursuit for Robot Path Tracking", 2023; for the dynamic window, arXiv 2601.15006.
"""

from __future__ import annotations

import math
from typing import NamedTuple

NEAR_M2 = 0.001
"""Squared distance (m²) of a carrot up to which the robot drives straight."""
STRAIGHT = 1e-3
"""Curvatures below this (1/m) count as straight, speeds below this (m/s, rad/s) as rest."""
ROUNDING = 1e-9
"""Speeds below this (m/s, rad/s) are what rounding leaves of zero."""
EQUAL = 1e-4
"""Distances of two corners of a window to an arc that count as equal."""


def curvature_to(x: float, y: float) -> float:
    """Return the curvature (1/m) of the arc from the robot, along its heading, through the point (x, y) in its frame (m)."""
    squared = x * x + y * y
    return 2.0 * y / squared if squared > NEAR_M2 else 0.0


def speed_in_curve(speed: float, curvature: float, least_radius: float) -> float:
    """Return `speed` times radius / least_radius in curves of a smaller radius (m)."""
    tight = abs(curvature) * least_radius
    return speed / tight if tight > 1.0 else speed


def distance_from_cost(cost: float, inscribed_radius: float, factor: float) -> float:
    """Return the distance (m) to the obstacle that inflation gave a cost (1 .. 254) for, at the decay `factor` (1/m)."""
    return inscribed_radius + math.log(253.0 / cost) / factor


def speed_near_obstacle(speed: float, distance: float, scaling_dist: float, gain: float) -> float:
    """Return `speed` times gain * distance / scaling_dist within `scaling_dist` (m) of an obstacle."""
    return speed * gain * distance / scaling_dist if distance < scaling_dist else speed


def approach_speed(speed: float, left: float, distance: float, scaling_dist: float, least: float) -> float:
    """Return the speed (m/s) with `left` (m) of the path and `distance` (m) to its end left."""
    if left >= scaling_dist:
        return speed
    return min(speed, max(least, speed * distance / scaling_dist))


class Window(NamedTuple):
    """Velocities that can be commanded next (m/s, rad/s)."""

    v_min: float
    v_max: float
    w_min: float
    w_max: float


class WindowLimits(NamedTuple):
    """Limits of a dynamic window: speeds (m/s, rad/s), and changes within one period (positive)."""

    v_min: float
    v_max: float
    w_min: float
    w_max: float
    v_faster: float
    v_slower: float
    w_faster: float
    w_slower: float


def _reachable(last: float, faster: float, slower: float) -> tuple[float, float]:
    if last > STRAIGHT:
        return last - slower, last + faster
    if last < -STRAIGHT:
        return last - faster, last + slower
    return last - faster, last + faster


def dynamic_window(v: float, w: float, regulated: float, limits: WindowLimits, sign: float) -> Window:
    """Return what can be commanded after (v, w), at most as fast as the `regulated` speed in the direction `sign`."""
    v_low, v_high = _reachable(v, limits.v_faster, limits.v_slower)
    w_low, w_high = _reachable(w, limits.w_faster, limits.w_slower)
    v_low, v_high = max(v_low, limits.v_min), min(v_high, limits.v_max)
    w_low, w_high = max(w_low, limits.w_min), min(w_high, limits.w_max)
    low, high = (0.0, regulated) if sign >= 0.0 else (regulated, 0.0)
    # no overlap: the nearest bound of what can be reached
    if v_low > high:
        v_high = v_low
    elif v_high < low:
        v_low = v_high
    else:
        v_low, v_high = max(v_low, low), min(v_high, high)
    return Window(v_low, v_high, w_low, w_high)


def nearest_to_arc(window: Window, curvature: float, sign: float) -> tuple[float, float]:
    """Return the fastest velocity (v, w) of the window on the arc in the direction `sign`; without one, the nearest corner."""
    fastest = window.v_max if sign >= 0.0 else window.v_min
    if abs(curvature) < STRAIGHT:
        return fastest, min(max(0.0, window.w_min), window.w_max)
    by_speed = [(v, curvature * v) for v in (window.v_min, window.v_max)]
    by_turn = [(w / curvature, w) for w in (window.w_min, window.w_max)]
    on_arc = [c for c in by_speed if window.w_min <= c[1] <= window.w_max]
    on_arc += [c for c in by_turn if window.v_min <= c[0] <= window.v_max]
    if on_arc:
        return max(on_arc, key=lambda c: sign * c[0])
    corners = [(v, w) for v in (window.v_min, window.v_max) for w in (window.w_min, window.w_max)]
    scale = math.sqrt(curvature * curvature + 1.0)
    distances = [abs(curvature * v - w) / scale for v, w in corners]
    shortest = min(distances)
    near = [c for c, d in zip(corners, distances) if d <= shortest + EQUAL]
    return max(near, key=lambda c: sign * c[0])


def held_to_radius(v: float, w: float, last_v: float, window: Window, radius: float) -> tuple[float, float]:
    """Return the velocity (v, w), changed as little as possible, on a circle of at least `radius` (m).

    It turns less, and where the angular deceleration does not allow that, it brakes less: from a last velocity that keeps to
    the radius, one of both can always be commanded.
    """
    highest = abs(v) / radius * (1.0 + 1e-12)  # a velocity on the tightest arc may be off by rounding
    if abs(w) <= highest:
        return v, w
    turning = min(max(math.copysign(highest, w), window.w_min), window.w_max)
    if abs(turning) <= highest:
        return v, turning
    return math.copysign(abs(turning) * radius, last_v if last_v != 0.0 else v), turning


def towards_zero(value: float, change: float) -> float:
    """Return `value` nearer to zero by `change`, not beyond it."""
    left = abs(value) - change
    return math.copysign(left, value) if left > ROUNDING else 0.0
