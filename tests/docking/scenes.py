"""Measurements of a reflector, for tests of docking."""

from __future__ import annotations

import math

import numpy as np
import shapely

from navstack.core import DockDetection, LaserScan, Pose2D, Transform2D


def reflector_scan(
    marker: Pose2D,
    stamp: float = 0.0,
    *,
    length: float = 0.2,
    angle: float = 2.36,
    noise: float = 0.0,
    beams: int = 720,
    seed: int = 0,
    wall_m: float | None = 3.0,
) -> LaserScan:
    """The scan of a lidar at the origin that sees a V-shaped reflector, and behind it a wall, by shapely's intersections."""
    half = 0.5 * angle
    ends = [(-length * math.cos(half), side * length * math.sin(half), 0.0) for side in (1.0, -1.0)]
    (ax, ay, _), (bx, by, _) = Transform2D(*marker).apply_poses(np.array(ends)).tolist()
    things = [shapely.LineString([(ax, ay), (marker.x, marker.y), (bx, by)])]
    if wall_m is not None:
        things.append(shapely.LineString([(wall_m, -20.0), (wall_m, 20.0)]))
    world = shapely.union_all(things)
    rng = np.random.default_rng(seed)
    first, step = -0.75 * math.pi, 1.5 * math.pi / beams
    ranges = np.full(beams, np.inf, np.float32)
    for k in range(beams):
        bearing = first + k * step
        ray = shapely.LineString([(0.0, 0.0), (10.0 * math.cos(bearing), 10.0 * math.sin(bearing))])
        hit = shapely.intersection(world, ray)
        if not hit.is_empty:
            ranges[k] = shapely.Point(0.0, 0.0).distance(hit) + noise * rng.standard_normal()
    return LaserScan(ranges, first, step, 0.05, 10.0, stamp, "base_laser_link")


def tag_pose(marker: Pose2D, stamp: float = 0.0) -> DockDetection:
    """The detection of a tag."""
    return DockDetection.of_heading(marker.x, marker.y, marker.yaw, stamp, "dock_camera", "detected_dock_pose")
