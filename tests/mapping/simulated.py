"""Scans of a small world with exact beams, for tests of mapping."""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np
import shapely

from navstack.core import LaserScan, Transform2D
from navstack.localization import LoggedScan

WALLS = shapely.MultiLineString(
    [
        [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0)],
        [(3, 3), (9, 3), (9, 6), (3, 6), (3, 3)],
        [(0, 5), (1.2, 5)],
        [(7, 0), (7, 0.8)],
        [(12, 7), (10.9, 7.6)],
        [(4, 9), (4.4, 8.2), (5, 9)],
    ]
)
"""A corridor around a block, with niches that make its sides different."""


def scan_at(
    pose: Transform2D, stamp: float, rng: np.random.Generator, *, beams: int = 181, noise: float = 0.01
) -> LaserScan:
    """Return the scan of half a circle from a pose."""
    angles = np.linspace(-math.pi / 2.0, math.pi / 2.0, beams)
    ends = np.column_stack((np.cos(angles + pose.yaw), np.sin(angles + pose.yaw))) * 20.0 + [pose.x, pose.y]
    origin = shapely.Point(pose.x, pose.y)
    rays = shapely.linestrings(np.stack((np.broadcast_to([pose.x, pose.y], ends.shape), ends), axis=1))
    hits = shapely.distance(shapely.intersection(rays, WALLS), origin)
    ranges = (hits + rng.normal(0.0, noise, beams)).astype(np.float32)
    return LaserScan(ranges, -math.pi / 2.0, float(angles[1] - angles[0]), 0.05, 20.0, stamp)


@cache
def lap(laps: float = 1.2, seed: int = 0) -> tuple[tuple[LoggedScan, Transform2D], ...]:
    """Return the scans of a drive around the block with a drifting odometry, each with its true pose."""
    return tuple(_drive(laps, seed))


def _drive(laps: float, seed: int) -> Iterator[tuple[LoggedScan, Transform2D]]:
    rng = np.random.default_rng(seed)
    ring = shapely.Polygon([(1.5, 1.5), (10.5, 1.5), (10.5, 7.5), (1.5, 7.5)]).exterior
    odometry, last = Transform2D(), None
    for n in range(int(ring.length * laps / 0.15)):
        here, ahead = (ring.interpolate((n * 0.15 + d) % ring.length) for d in (0.0, 0.6))
        pose = Transform2D(here.x, here.y, math.atan2(ahead.y - here.y, ahead.x - here.x))
        if last is not None:
            x, y, yaw = last.inverse() @ pose
            odometry = odometry @ Transform2D(x * 1.03, y, yaw * 1.02 + 0.002 + rng.normal(0.0, 0.003))
        last = pose
        yield LoggedScan(n, scan_at(pose, 0.2 * n, rng), Transform2D(), odometry, None), pose
