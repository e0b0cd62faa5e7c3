"""Hand-checked relations between poses of a log, and the errors of a trajectory by them.

Format and measure: Kümmerle et al. (On measuring the accuracy of SLAM algorithms, Autonomous Robots 27, 2009). A line has
`stamp1 stamp2 x y z roll pitch yaw`: the pose of the robot at `stamp2` as seen from its pose at `stamp1` (s, m, rad).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.bounded_reading import shortened
from navstack.core.errors import LogError
from navstack.drives.lines import read_lines
from navstack.localization.metrics import PoseErrors, Poses, relation_errors, wrapped

EXACT_S: Final = 5e-4
"""A pose this near to the stamp of a relation (s) is taken as it is."""
_FIELDS: Final = 8
_LEVEL_RAD: Final = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Relative poses (n, 3) between the times `first` and `second` (n,), in seconds of the log's own clock."""

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    poses: Poses


@dataclass(frozen=True, slots=True)
class RelationResult:
    """The errors of a trajectory by a file of relations."""

    errors: PoseErrors
    square_m2: tuple[float, float]
    """Mean and standard deviation of the squares of the errors of position (m²)."""
    square_rad2: tuple[float, float]
    """The same of the heading (rad²)."""
    interpolated: int
    """Relations of which at least one pose was interpolated between two estimates."""
    outside: int
    """Relations outside the times of the trajectory, which do not count."""

    def as_dict(self) -> dict[str, Any]:
        """Return the values by name."""
        return {
            **self.errors.as_dict(),
            "square_m2": {"mean": self.square_m2[0], "std": self.square_m2[1]},
            "square_rad2": {"mean": self.square_rad2[0], "std": self.square_rad2[1]},
            "interpolated": self.interpolated,
            "outside": self.outside,
        }


def read_relations(path: Path) -> Relations:
    """Read a file of relations; `#` begins a comment. Raises LogError for a line without eight numbers, or of a tilted robot."""
    rows: list[list[float]] = []
    for number, text in read_lines(path):
        fields = text.partition("#")[0].split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError:
            row = []
        if len(row) != _FIELDS or not all(map(math.isfinite, row)):
            raise LogError(
                f'{path}:{number}: "{shortened(text.strip(), 80)}" is no relation; a line has eight numbers: '
                "stamp1 stamp2 x y z roll pitch yaw",
                file=str(path),
                line=number,
            )
        if max(abs(row[5]), abs(row[6])) > _LEVEL_RAD:
            raise LogError(
                f"{path}:{number}: roll {row[5]:g} and pitch {row[6]:g} rad: only relations on level ground can be compared",
                file=str(path),
                line=number,
            )
        rows.append(row)
    if not rows:
        raise LogError(f"{path} has no relation; a line is stamp1 stamp2 x y z roll pitch yaw", file=str(path))
    table = np.array(rows)
    return Relations(table[:, 0], table[:, 1], np.column_stack((table[:, 2:4], wrapped(table[:, 7]))))


def errors_by_relations(relations: Relations, stamps: NDArray[np.float64], poses: Poses) -> RelationResult:
    """Return the errors of a trajectory, poses (n, 3) at increasing stamps (n,) in the time of the relations (s).

    Between two poses, the trajectory is interpolated linearly. Raises LogError if it covers no relation.
    """
    known = np.isfinite(poses).all(axis=1)
    stamps, poses = stamps[known], poses[known]
    inside = np.zeros(len(relations.first), np.bool_)
    if len(stamps):
        first, last = stamps[0] - EXACT_S, stamps[-1] + EXACT_S
        inside = (np.minimum(relations.first, relations.second) >= first) & (
            np.maximum(relations.first, relations.second) <= last
        )
    if not inside.any():
        covered = f"{stamps[0]:.3f} .. {stamps[-1]:.3f} s" if len(stamps) else "nothing"
        low, high = float(relations.first.min()), float(relations.second.max())
        raise LogError(
            f"no relation lies within the trajectory: the relations have the times {low:.3f} .. {high:.3f} s, the trajectory "
            f"covers {covered}; the file belongs to another log, or the log has lost its times"
        )
    a, exact_a = poses_at(relations.first[inside], stamps, poses)
    b, exact_b = poses_at(relations.second[inside], stamps, poses)
    errors, moved, turned = relation_errors(a, b, relations.poses[inside])
    return RelationResult(
        errors,
        _mean_and_std(moved**2),
        _mean_and_std(turned**2),
        int((~(exact_a & exact_b)).sum()),
        int((~inside).sum()),
    )


def poses_at(times: NDArray[np.float64], stamps: NDArray[np.float64], poses: Poses) -> tuple[Poses, NDArray[np.bool_]]:
    """Return the poses (m, 3) at `times` (m,), and whether the trajectory has a pose at each of them."""
    columns = [np.interp(times, stamps, poses[:, 0]), np.interp(times, stamps, poses[:, 1])]
    yaw = np.interp(times, stamps, np.unwrap(poses[:, 2]))
    after = np.clip(np.searchsorted(stamps, times), 0, len(stamps) - 1)
    near = np.minimum(np.abs(times - stamps[np.maximum(after - 1, 0)]), np.abs(times - stamps[after]))
    return np.column_stack((*columns, wrapped(yaw))), near <= EXACT_S


def _mean_and_std(values: NDArray[np.float64]) -> tuple[float, float]:
    return float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else 0.0
