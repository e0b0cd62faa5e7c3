"""Which inputs a localizer must not use, and why."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, LaserScan, Pose2D, Transform2D

FARTHEST_M: Final = 1e7
"""Odometry beyond this (m) is not that of a robot on earth; and near it, float64 still resolves nanometers."""


class Rejection(NamedTuple):
    """An input that was not used."""

    stamp: float
    reason: str


class InputCheck:
    """Keeps the stamps of the scans by frame, and what was rejected."""

    def __init__(self) -> None:
        self.stamps: dict[str, float] = {}
        """Stamp of the last scan of each frame (s)."""
        self.rejections: deque[Rejection] = deque(maxlen=100)
        """Inputs that were not used, with the reason."""

    def accept(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> bool:
        """Return True for a scan that may be used, and remember its stamp; otherwise the reason is in `rejections`."""
        reason = defect_of(odometry, scan, sensor, self.stamps.get(scan.frame))
        if reason:
            self.reject(scan.stamp, reason)
            return False
        self.stamps[scan.frame] = scan.stamp
        return True

    def reject(self, stamp: float, reason: str) -> None:
        """Note an input that was not used."""
        self.rejections.append(Rejection(stamp, reason))


def defect_of(odometry: Transform2D, scan: LaserScan, sensor: Transform2D, last: float | None) -> str:
    """Return what is wrong with a scan, its odometry or the pose of its sensor; empty if nothing is.

    `last`: stamp (s) of the last scan of the same frame.
    """
    if not all(map(math.isfinite, (*odometry, *sensor))):
        return f"the odometry {tuple(odometry)} or the sensor's pose {tuple(sensor)} is not finite"
    if max(map(abs, (*odometry, *sensor))) > FARTHEST_M:
        return f"the odometry {tuple(odometry)} or the sensor's pose {tuple(sensor)} is not a pose on earth"
    if not math.isfinite(scan.stamp):
        return f"the stamp of the scan is {scan.stamp}"
    if last is not None and scan.stamp <= last:
        return f"the scan at {scan.stamp} s is not newer than the last one of {scan.frame}, at {last} s"
    if not (math.isfinite(scan.range_max) and scan.range_max > 0.0 and scan.range_min >= 0.0):
        return f"the limits of the scan are {scan.range_min} to {scan.range_max} m"
    if not (math.isfinite(scan.angle_min) and math.isfinite(scan.angle_increment)):
        return f"the angles of the scan are {scan.angle_min} + i * {scan.angle_increment} rad"
    return ""


def require_covariance(pose: Pose2D, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance (3, 3) as float64. Raises InputError if it or the pose is none."""
    if not pose.is_finite():
        raise InputError(f"the initial pose {tuple(pose)} is not finite", argument="pose")
    if max(abs(pose.x), abs(pose.y)) > FARTHEST_M:
        raise InputError(f"the initial pose {tuple(pose)} is not a pose on earth", argument="pose")
    matrix = np.asarray(covariance, np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError("the covariance of the initial pose must be 3 x 3 finite numbers", argument="covariance")
    scale = float(np.abs(matrix).max())
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * scale):
        raise InputError("the covariance of the initial pose is not symmetric", argument="covariance")
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest < -1e-9 * scale:
        raise InputError(
            f"the covariance of the initial pose has the negative eigenvalue {lowest:.3g}", argument="covariance"
        )
    return matrix
