# pyright: basic
"""Rollouts of velocity sequences."""

from __future__ import annotations

import math

from navstack.core import kernel


@kernel
def constrain(velocities, start, low, high, acceleration, dt, radius):
    """Make `velocities` (K, T, 3) drivable, in place: acceleration from `start`, then limits, then the turning radius.

    `low`, `high`, `acceleration` (3,) per axis, `dt` seconds between two velocities. `radius`: the smallest turning
    radius (m), 0 for a robot that turns in place.
    """
    for k in range(velocities.shape[0]):
        for i in range(velocities.shape[1]):
            for axis in range(3):
                before = start[axis] if i == 0 else velocities[k, i - 1, axis]
                change = acceleration[axis] * dt
                value = min(max(velocities[k, i, axis], before - change), before + change)
                velocities[k, i, axis] = min(max(value, low[axis]), high[axis])
            if radius > 0.0:
                most = math.hypot(velocities[k, i, 0], velocities[k, i, 1]) / radius
                velocities[k, i, 2] = min(max(velocities[k, i, 2], -most), most)


@kernel
def integrate(velocities, pose, dt, poses):
    """Write the poses before each Euler step of `velocities` (K, T, 3) to `poses` (K, T, 3); the first is `pose`."""
    for k in range(velocities.shape[0]):
        x, y, yaw = pose[0], pose[1], pose[2]
        for i in range(velocities.shape[1]):
            poses[k, i, 0] = x
            poses[k, i, 1] = y
            poses[k, i, 2] = yaw
            vx, vy = velocities[k, i, 0], velocities[k, i, 1]
            c, s = math.cos(yaw), math.sin(yaw)
            x += (vx * c - vy * s) * dt
            y += (vx * s + vy * c) * dt
            yaw += velocities[k, i, 2] * dt
