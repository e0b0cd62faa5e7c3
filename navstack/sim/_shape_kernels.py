# pyright: basic
"""Placement of polygons at poses."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel


@kernel
def place_polygons(outlines, first, centres, poses):
    """Corners (m, 2) and bounding circles (p, 3) x, y, radius, in the map (m), of p polygons at `poses` (p, 3).

    `outlines` (m, 2): corners in the polygons' own frames, those of polygon k at `first[k]` .. `first[k + 1] - 1`; `centres`
    (p, 3): a bounding circle of each in its own frame.
    """
    corners = np.empty_like(outlines)
    circles = np.empty_like(centres)
    for k in range(centres.shape[0]):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(first[k], first[k + 1]):
            corners[i, 0] = poses[k, 0] + c * outlines[i, 0] - s * outlines[i, 1]
            corners[i, 1] = poses[k, 1] + s * outlines[i, 0] + c * outlines[i, 1]
        circles[k, 0] = poses[k, 0] + c * centres[k, 0] - s * centres[k, 1]
        circles[k, 1] = poses[k, 1] + s * centres[k, 0] + c * centres[k, 1]
        circles[k, 2] = centres[k, 2]
    return corners, circles
