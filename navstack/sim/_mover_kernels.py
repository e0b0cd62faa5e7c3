# pyright: basic
"""Where discs on tracks are."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def place_on_tracks(corners, first_corner, corner_at, speed, begin, radius, time):
    """(k, 3) x, y, radius (m) at `time` (s) of k discs.

    `corners` (m, 2) of all round trips, one after the other, each closed by its first corner; those of disc k are
    `first_corner[k]` .. `first_corner[k + 1] - 1`. `corner_at` (m,) = how far along its trip a corner lies (m).
    """
    count = speed.shape[0]
    discs = np.empty((count, 3))
    for k in range(count):
        low, high = first_corner[k], first_corner[k + 1] - 1
        length = corner_at[high]
        at = (begin[k] + speed[k] * time) % length
        # the leg that holds `at`: corner_at[low] <= at < corner_at[high]
        while high - low > 1:
            middle = (low + high) // 2
            if corner_at[middle] <= at:
                low = middle
            else:
                high = middle
        leg = corner_at[high] - corner_at[low]
        share = min(max((at - corner_at[low]) / leg, 0.0), 1.0) if leg > 0.0 else 0.0
        discs[k, 0] = corners[low, 0] + share * (corners[high, 0] - corners[low, 0])
        discs[k, 1] = corners[low, 1] + share * (corners[high, 1] - corners[low, 1])
        discs[k, 2] = radius[k]
    return discs
