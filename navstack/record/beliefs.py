"""What the robot believed: the estimates of its localizer, and the possible poses among which it chose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D
from navstack.record.estimates import COVARIANCE, ESTIMATE_TABLE
from navstack.record.reader import Record


@dataclass(frozen=True, slots=True, eq=False)
class RecordedEstimate:
    """One estimate of a localizer."""

    t: float
    """Stamp of the scan (s)."""
    pose: Pose2D
    """Of the base, in the map."""
    covariance: NDArray[np.float64]
    """(3, 3) of x, y, yaw (m, rad)."""
    count: int
    """Number of particles or hypotheses."""
    lost: bool
    """The robot knew that it does not know where it is."""
    explained: float
    """Share of the scan that the estimate explains; NaN if the localizer does not say."""
    particles: NDArray[np.float32]
    """(k, 4) x, y, yaw (map) and weight of possible poses, at most MAX_DRAWN of them."""


def estimates_of(record: Record) -> NDArray[np.void]:
    """Return the table `estimates`, empty for a run without a localizer."""
    found = record.arrays.get("estimates")
    return np.zeros(0, ESTIMATE_TABLE) if found is None else found


def recorded_estimate(record: Record, row: int) -> RecordedEstimate:
    """Return a row of the table."""
    e = estimates_of(record)[row]
    covariance = np.empty((3, 3))
    covariance[np.triu_indices(3)] = [float(e[name]) for name in COVARIANCE]
    covariance[np.tril_indices(3)] = covariance.T[np.tril_indices(3)]
    first, drawn = int(e["first"]), int(e["drawn"])
    return RecordedEstimate(
        float(e["t"]),
        Pose2D(float(e["x"]), float(e["y"]), float(e["yaw"])),
        covariance,
        int(e["count"]),
        bool(e["lost"]),
        float(e["explained"]),
        record.arrays["particles"][first : first + drawn],
    )


def estimate_at(record: Record, t: float) -> RecordedEstimate | None:
    """Return the last estimate not later than `t` (s); None before the first one, and for a run without a localizer."""
    row = int(np.searchsorted(estimates_of(record)["t"], t, side="right")) - 1
    return recorded_estimate(record, row) if row >= 0 else None


def moved(record: Record, found: RecordedEstimate, t: float) -> RecordedEstimate:
    """Return an estimate with its possible poses where they are at `t` (s), by the odometry since its scan."""
    odometry = record.odom_poses
    then, now = (Transform2D(*odometry[record.index_at(time)].tolist()) for time in (found.t, t))
    step = then.inverse() @ now
    cloud = found.particles.astype(np.float64)
    c, s = np.cos(cloud[:, 2]), np.sin(cloud[:, 2])
    x, y = cloud[:, 0] + c * step.x - s * step.y, cloud[:, 1] + s * step.x + c * step.y
    particles = np.column_stack((x, y, cloud[:, 2] + step.yaw, cloud[:, 3])).astype(np.float32)
    return replace(found, pose=Pose2D(*(Transform2D(*found.pose) @ step)), particles=particles)


def believed_poses(record: Record) -> NDArray[np.float64]:
    """Return where the robot took itself to be at each sample: (n, 3) x, y, yaw in the global frame."""
    frame, odometry = record.map_to_odom, record.odom_poses
    c, s = np.cos(frame[:, 2]), np.sin(frame[:, 2])
    x = frame[:, 0] + c * odometry[:, 0] - s * odometry[:, 1]
    y = frame[:, 1] + s * odometry[:, 0] + c * odometry[:, 1]
    yaw = frame[:, 2] + odometry[:, 2]
    return np.column_stack((x, y, np.arctan2(np.sin(yaw), np.cos(yaw))))
