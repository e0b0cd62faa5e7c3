"""Running a localizer over a drive, and what came out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.core.errors import LogError
from navstack.drives.messages import DriveFrame
from navstack.interfaces import Localizer, PoseEstimate
from navstack.localization.metrics import PoseErrors, absolute_errors, pairs_by_distance, relative_errors

MAX_SNAPSHOTS: Final = 400
"""Most clouds of particles that a track keeps; of a longer drive every second one, and so on."""

SURE_M: Final = 0.5
"""A localizer that does not say whether it is lost counts as sure below this standard deviation of the position (m)."""

Cloud = Callable[[], NDArray[np.float64]]
"""Returns the possible poses (n, 3) of a localizer in the map: particles or hypotheses."""


@dataclass(slots=True, eq=False)
class Track:
    """The estimates of a localizer over a drive, one row per scan."""

    indices: NDArray[np.int64]
    """(n,) numbers of the scans in the drive."""
    stamps: NDArray[np.float64]
    """(n,) s."""
    poses: NDArray[np.float64]
    """(n, 3) estimated x, y, yaw in the map; NaN before the first estimate."""
    references: NDArray[np.float64]
    """(n, 3) reference poses; NaN where there is none."""
    particles: NDArray[np.int64]
    """(n,) number of particles or hypotheses."""
    lost: NDArray[np.bool_]
    """(n,) whether the localizer said that it does not know where it is."""
    explained: NDArray[np.float64]
    """(n,) share of the scan that the estimate explains; NaN if the localizer does not say."""
    clouds: dict[int, NDArray[np.float64]] = field(default_factory=dict[int, NDArray[np.float64]])
    """Possible poses (k, 3) at some rows."""
    ms_per_scan: float = math.nan
    """Processor time."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) rows with an estimate and a reference."""
        return np.asarray(np.isfinite(self.poses).all(axis=1) & np.isfinite(self.references).all(axis=1))

    @property
    def errors(self) -> NDArray[np.float64]:
        """(n,) distance between estimate and reference (m); NaN without one of them."""
        return np.hypot(self.poses[:, 0] - self.references[:, 0], self.poses[:, 1] - self.references[:, 1])

    def absolute(self) -> PoseErrors:
        """Return the absolute trajectory error of the rows with a reference, without alignment."""
        return absolute_errors(self.poses[self.known], self.references[self.known])

    def relations(self) -> PoseErrors:
        """Return the errors of the relations between consecutive rows with a reference."""
        count = int(self.known.sum())
        first = np.arange(max(count - 1, 0))
        return relative_errors(self.poses[self.known], self.references[self.known], first, first + 1)

    def relative(self, metres: float) -> PoseErrors:
        """Return the relative pose error over `metres` of the reference's path."""
        pairs = pairs_by_distance(self.references[self.known], metres)
        return relative_errors(self.poses[self.known], self.references[self.known], *pairs)

    def summary(self) -> dict[str, Any]:
        """Return the results for JSON: counts, and errors where there is a reference."""
        estimated = np.isfinite(self.poses).all(axis=1)
        document: dict[str, Any] = {
            "scans": len(self.indices),
            "with_estimate": int(estimated.sum()),
            "lost": int(self.lost.sum()),
            "particles_median": float(np.median(self.particles)) if len(self.particles) else None,
            "particles_max": int(self.particles.max()) if len(self.particles) else None,
            "ms_per_scan": self.ms_per_scan,
        }
        if self.known.sum() > 1:
            document |= {
                "ate": self.absolute().as_dict(),
                "relations": self.relations().as_dict(),
                "rpe_10m": self.relative(10.0).as_dict(),
            }
            document["sure_but_wrong"] = self.sure_but_wrong
        return document

    @property
    def sure_but_wrong(self) -> int:
        """Number of scans at which the localizer was sure although it was more than 0.5 m off."""
        return int((self.known & ~self.lost & (self.errors > 0.5)).sum())


def follow(
    frames: Iterable[DriveFrame],
    localizer: Localizer,
    *,
    initial_pose: Pose2D | None = None,
    globally: bool = False,
    cloud: Cloud | None = None,
) -> Track:
    """Run `localizer`, which has a map, over the scans of a drive.

    It starts at `initial_pose`, by default the reference of the first scan; with `globally`, without a pose. The estimate of a
    scan that did not count is the last one moved by the odometry. Raises LogError if there is no scan, or no pose to start from.
    """
    rows: list[tuple[int, float, tuple[float, ...], tuple[float, ...], int, bool, float]] = []
    clouds: dict[int, NDArray[np.float64]] = {}
    every, spent = 1, 0.0
    for n, frame in enumerate(frames):
        if n == 0:
            _start(localizer, frame, initial_pose, globally)
        began = time.process_time()
        localizer.update(frame.odometry, frame.scan, frame.sensor)
        spent += time.process_time() - began
        latest = localizer.estimate
        details = {} if latest is None else latest.details
        pose = (math.nan,) * 3 if latest is None else tuple(latest.map_to_odom @ frame.odometry)
        reference = (math.nan,) * 3 if frame.reference is None else tuple(frame.reference)
        if cloud is not None and n % every == 0:
            clouds[n] = cloud().astype(np.float64)
            if len(clouds) > MAX_SNAPSHOTS:
                every *= 2
                clouds = {row: poses for row, poses in clouds.items() if row % every == 0}
        count = details.get("particles", details.get("hypotheses", 0))
        lost = latest is None or not is_sure(latest)
        rows.append(
            (frame.index, frame.scan.stamp, pose, reference, int(count), lost, details.get("explained", math.nan))
        )
    if not rows:
        raise LogError("the drive has no scan with odometry before it, so there is nothing to localize")
    index, stamp, poses, references, count, lost, explained = zip(*rows, strict=True)
    return Track(
        np.array(index, np.int64),
        np.array(stamp, np.float64),
        np.array(poses, np.float64),
        np.array(references, np.float64),
        np.array(count, np.int64),
        np.array(lost, np.bool_),
        np.array(explained, np.float64),
        clouds,
        1e3 * spent / len(rows),
    )


def is_sure(estimate: PoseEstimate) -> bool:
    """Return whether the robot is localized: as the localizer reports, or else by the spread of its position."""
    details = estimate.details
    if "lost" in details or "certain" in details:
        return not details.get("lost", not details.get("certain", False))
    spread = math.sqrt(max(float(estimate.covariance[0, 0] + estimate.covariance[1, 1]), 0.0))
    return spread < SURE_M


def _start(localizer: Localizer, frame: DriveFrame, initial_pose: Pose2D | None, globally: bool) -> None:
    if globally:
        localizer.start_globally()
        return
    pose = frame.reference if initial_pose is None else initial_pose
    if pose is None:
        raise LogError(
            "the log has no reference pose to start from; give --initial-pose x,y,yaw, or --global to find the pose by a search"
        )
    localizer.set_pose(pose, np.diag([0.05**2, 0.05**2, 0.03**2]), math.inf)
