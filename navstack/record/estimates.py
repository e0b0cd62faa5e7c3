"""The estimates of a localizer while a run is recorded, and the check of their table."""

from __future__ import annotations

from array import array
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.plugins import Localizer
from navstack.record.format import table

MAX_DRAWN: Final = 200
"""Largest number of possible poses of one estimate that are recorded."""
MAX_POSES: Final = 1_000_000
"""Largest number of recorded possible poses (16 MB)."""
COVARIANCE: Final = ("xx", "xy", "xyaw", "yy", "yyaw", "yawyaw")
ESTIMATE_TABLE: Final[list[tuple[str, str]]] = [
    *((name, "<f8") for name in ("t", "x", "y", "yaw", *COVARIANCE)),
    *[("count", "<i4"), ("lost", "<i4"), ("explained", "<f8"), ("first", "<i8"), ("drawn", "<i4")],
]
"""Columns of the table `estimates`."""


class EstimateBuffer:
    """Collects estimates. When the possible poses exceed MAX_POSES, those of every second estimate are dropped, and so on."""

    def __init__(self, most: int = MAX_POSES) -> None:
        self._most = most
        self._rows = array("d")
        self._count = 0
        self._clouds: dict[int, NDArray[np.float32]] = {}
        self._every = 1
        self._last = -np.inf

    def __len__(self) -> int:
        return self._count

    def take(self, localizer: Localizer) -> None:
        """Add the last estimate of a localizer, unless it has been added."""
        estimate = localizer.estimate
        if estimate is None or estimate.stamp <= self._last:
            return
        self._last = estimate.stamp
        status = localizer.status
        poses, weights = localizer.possible_poses()
        lost = not estimate.details.get("certain", True) if status is None else status.lost
        explained = estimate.details.get("explained")
        c = np.asarray(estimate.covariance, np.float64)
        row, self._count = self._count, self._count + 1
        values = (*estimate.pose, c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2])
        known = np.nan if explained is None else float(explained)
        self._rows.extend((estimate.stamp, *values, float(len(poses)), float(lost), known))
        if row % self._every == 0:
            self._clouds[row] = _drawn(poses, weights)
            while self._every < 1 << 40 and sum(map(len, self._clouds.values())) > self._most:
                self._every *= 2
                self._clouds = {at: cloud for at, cloud in self._clouds.items() if at % self._every == 0}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the table `estimates` and the array `particles`."""
        counts = np.array([len(self._clouds.get(row, ())) for row in range(self._count)], np.int64)
        values = np.array(self._rows, np.float64).reshape(self._count, -1)
        names = [name for name, _ in ESTIMATE_TABLE if name not in ("first", "drawn")]
        data: dict[str, Any] = {name: values[:, i] for i, name in enumerate(names)}
        data |= {"first": np.cumsum(counts) - counts, "drawn": counts}
        clouds = [np.empty((0, 4), "<f4"), *(self._clouds[row] for row in sorted(self._clouds))]
        return {"estimates": table(ESTIMATE_TABLE, data, self._count), "particles": np.concatenate(clouds)}


def _drawn(poses: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return at most MAX_DRAWN of the poses, evenly spread over their order, with their weights."""
    chosen = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MAX_DRAWN)).astype(np.intp))
    return np.column_stack((poses[chosen], weights[chosen])).astype("<f4")


def check_estimates(arrays: dict[str, NDArray[Any]]) -> None:
    """Raises ValueError unless the estimates have the columns of `ESTIMATE_TABLE`, finite poses, ordered times and particles."""
    rows, particles = arrays.get("estimates"), arrays.get("particles")
    if rows is None and particles is None:
        return
    if rows is None or particles is None:
        raise ValueError("estimates and particles belong together")
    if rows.ndim != 1 or rows.dtype != np.dtype(ESTIMATE_TABLE):
        raise ValueError("estimates does not have the columns of this version")
    if particles.dtype != np.dtype("<f4") or particles.ndim != 2 or particles.shape[1] != 4:
        raise ValueError(f"particles has the type {particles.dtype} and shape {particles.shape}")
    if not np.isfinite(particles).all():
        raise ValueError("particles has a value that is not finite")
    for name in ("t", "x", "y", "yaw", *COVARIANCE):
        if not np.isfinite(rows[name]).all():
            raise ValueError(f"estimates.{name} has a value that is not finite")
    if (np.diff(rows["t"]) < 0.0).any():
        raise ValueError("the times of estimates decrease")
    first, drawn = rows["first"], rows["drawn"]
    if len(rows) and not (
        first.min() >= 0 and drawn.min() >= 0 and (first <= len(particles) - drawn.astype(np.int64)).all()
    ):
        raise ValueError("estimates refers to particles that do not exist")
