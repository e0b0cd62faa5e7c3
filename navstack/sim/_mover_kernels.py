# pyright: basic
"""Positions of objects on tracks."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel


@kernel
def find_on_track(corners, corner_at, low, high, at):
    """Position x, y (m) after `at` metres of the round trip with corners `low` .. `high`, and the direction of the leg."""
    # binary search for the leg: corner_at[low] <= at < corner_at[high]
    while high - low > 1:
        middle = (low + high) // 2
        if corner_at[middle] <= at:
            low = middle
        else:
            high = middle
    leg = corner_at[high] - corner_at[low]
    share = min(max((at - corner_at[low]) / leg, 0.0), 1.0) if leg > 0.0 else 0.0
    dx, dy = corners[high, 0] - corners[low, 0], corners[high, 1] - corners[low, 1]
    return corners[low, 0] + share * dx, corners[low, 1] + share * dy, dx, dy


@kernel
def place_on_tracks(corners, first_corner, corner_at, speed, start_offset, radius, time):
    """(k, 3) x, y, radius (m) at `time` (s) of k discs.

    `corners` (m, 2) of all round trips, concatenated, each closed by its first corner; those of disc k are `first_corner[k]` ..
    `first_corner[k + 1] - 1`. `corner_at` (m,): distance of each corner along its trip (m).
    """
    count = speed.shape[0]
    discs = np.empty((count, 3))
    for k in range(count):
        low, high = first_corner[k], first_corner[k + 1] - 1
        at = (start_offset[k] + speed[k] * time) % corner_at[high]
        discs[k, 0], discs[k, 1], _, _ = find_on_track(corners, corner_at, low, high, at)
        discs[k, 2] = radius[k]
    return discs


@kernel
def headings_on_tracks(corners, first_corner, corner_at, speed, start_offset, time):
    """(k,) direction of motion (rad) of each of k objects at `time` (s); arguments as in `place_on_tracks`."""
    headings = np.empty(speed.shape[0])
    for k in range(speed.shape[0]):
        low, high = first_corner[k], first_corner[k + 1] - 1
        at = (start_offset[k] + speed[k] * time) % corner_at[high]
        _, _, dx, dy = find_on_track(corners, corner_at, low, high, at)
        headings[k] = math.atan2(dy, dx) if speed[k] >= 0.0 else math.atan2(-dy, -dx)
    return headings
