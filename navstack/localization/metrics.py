"""Errors of a trajectory against a reference: absolute, relative, and by relations between poses.

Relations: Kümmerle et al. (On measuring the accuracy of SLAM algorithms, Autonomous Robots 27, 2009). Poses are arrays (n, 3) of
x, y (m), yaw (rad); rows of the estimate and the reference belong together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core import normalize_angles

Poses = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Statistics of non-negative errors."""

    count: int
    rms: float
    mean: float
    std: float
    median: float
    p95: float
    max: float

    @classmethod
    def of(cls, errors: NDArray[np.float64]) -> ErrorStatistics:
        """Return the statistics of errors (n,); NaN for none."""
        if len(errors) == 0:
            return cls(0, *[float("nan")] * 6)
        return cls(
            len(errors),
            float(np.sqrt(np.mean(errors**2))),
            float(errors.mean()),
            float(errors.std(ddof=1)) if len(errors) > 1 else 0.0,
            float(np.median(errors)),
            float(np.quantile(errors, 0.95)),
            float(errors.max()),
        )

    def as_dict(self) -> dict[str, float]:
        """Return the values by name."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """Errors of position (m) and of heading (rad)."""

    position: ErrorStatistics
    heading: ErrorStatistics

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Return the statistics by name."""
        return {"position_m": self.position.as_dict(), "heading_rad": self.heading.as_dict()}


def absolute_errors(estimate: Poses, reference: Poses) -> PoseErrors:
    """Return the absolute trajectory error (ATE), without alignment: a localizer has no frame of its own."""
    difference = estimate - reference
    return _errors(np.hypot(difference[:, 0], difference[:, 1]), difference[:, 2])


def relative_errors(estimate: Poses, reference: Poses, first: NDArray[np.intp], second: NDArray[np.intp]) -> PoseErrors:
    """Return the errors of the relations between rows `first[k]` and `second[k]`: (r_k)^-1 e_k of the relative poses."""
    return relation_errors(estimate[first], estimate[second], between(reference[first], reference[second]))[0]


def relation_errors(
    first: Poses, second: Poses, relations: Poses
) -> tuple[PoseErrors, NDArray[np.float64], NDArray[np.float64]]:
    """Return the errors of poses `second` as seen from `first` against known relations, and each error (m, rad).

    e = d (-) d*: the pose by the estimates as seen from that of the relation (Kümmerle et al. 2009).
    """
    wrong = between(relations, between(first, second))
    moved, turned = np.hypot(wrong[:, 0], wrong[:, 1]), np.abs(wrong[:, 2])
    return _errors(moved, turned), moved, turned


def pairs_by_distance(reference: Poses, meters: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return, for each row, the first later row after `meters` of the reference's path, for those that have one."""
    steps = np.hypot(*np.diff(reference[:, :2], axis=0).T)
    driven = np.concatenate(([0.0], np.cumsum(steps)))
    second = np.searchsorted(driven, driven + meters)
    first = np.arange(len(reference))
    known = (second < len(reference)) & (second > first)
    return first[known], second[known]


def between(first: Poses, second: Poses) -> Poses:
    """Return the poses (n, 3) of `second` relative to `first`, row by row."""
    c, s = np.cos(first[:, 2]), np.sin(first[:, 2])
    dx, dy = second[:, 0] - first[:, 0], second[:, 1] - first[:, 1]
    return np.column_stack((c * dx + s * dy, c * dy - s * dx, normalize_angles(second[:, 2] - first[:, 2])))


def _errors(position: NDArray[np.float64], heading: NDArray[np.float64]) -> PoseErrors:
    return PoseErrors(ErrorStatistics.of(position), ErrorStatistics.of(np.abs(normalize_angles(heading))))
