# pyright: basic
"""Points of scans and clouds in the costmap's frame. NaN, infinite values and points outside the map are handled here."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel


@kernel
def project_scan(ranges, directions, range_min, range_max, inf_range, x, y, yaw, height, out):
    """Write the points (x, y, z) float32 of a scan's valid beams in the global frame into `out`; return their number.

    `directions` (n, 2): cosine and sine of each beam. `inf_range` (m) replaces +inf unless it is NaN. `x`, `y`, `yaw`: pose
    of the sensor's frame. Rounds to float32 where ROS does: the points in laser_geometry, then the transform of the cloud in
    tf2, which converts a float32 quaternion to a float32 matrix.
    """
    count = 0
    qz, qw = np.float32(math.sin(0.5 * yaw)), np.float32(math.cos(0.5 * yaw))
    tz = qz + qz
    c, s = np.float32(1.0) - tz * qz, tz * qw
    tx, ty, z = np.float32(x), np.float32(y), np.float32(height)
    replace = not math.isnan(inf_range)
    for i in range(ranges.size):
        r = float(ranges[i])
        if replace and r == math.inf:
            r = float(inf_range)
        if r >= range_min and r < range_max:  # false for NaN
            px = np.float32(r * directions[i, 0])
            py = np.float32(r * directions[i, 1])
            out[count, 0] = (c * px - s * py) + tx
            out[count, 1] = (s * px + c * py) + ty
            out[count, 2] = z
            count += 1
    return count


@kernel
def project_points(points, x, y, yaw, min_height, max_height, out):
    """Write the points (n, 3) float32 between the two heights (m), in the global frame, into `out`; return their number."""
    count = 0
    qz, qw = np.float32(math.sin(0.5 * yaw)), np.float32(math.cos(0.5 * yaw))
    tz = qz + qz
    c, s = np.float32(1.0) - tz * qz, tz * qw
    tx, ty = np.float32(x), np.float32(y)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        if math.isfinite(px) and math.isfinite(py) and pz >= min_height and pz <= max_height:
            out[count, 0] = (c * px - s * py) + tx
            out[count, 1] = (s * px + c * py) + ty
            out[count, 2] = pz
            count += 1
    return count
