"""Shapes of trajectories: their path, or an arc for a rotation in place."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.plot import colors

Shapes = dict[int, NDArray[np.float64]]
_IN_PLACE_M: Final = 0.02
"""A trajectory with a smaller extent is a rotation in place."""


def trajectory_shapes(
    poses: NDArray[np.float64], counts: NDArray[np.int64], robot: Pose2D, radius: float
) -> dict[int, NDArray[np.float64]]:
    """Returns, by row, the points (n, 3) to draw for each trajectory of `poses` (K, T, 3).

    Rotations in place become arcs around the robot, each with a larger radius than the one before.
    """
    shapes: Shapes = {}
    arcs = 0
    for k in np.flatnonzero(counts > 0).tolist():
        path = poses[k, : counts[k]]
        if np.ptp(path[:, 0]) + np.ptp(path[:, 1]) > _IN_PLACE_M:
            shapes[k] = path
            continue
        angle = float(np.unwrap(path[:, 2])[-1] - path[0, 2])
        around = path[0, 2] + np.linspace(0.0, angle, 40)
        reach = radius * (1.1 + 0.035 * arcs)
        arcs += 1
        shapes[k] = np.column_stack((robot.x + reach * np.cos(around), robot.y + reach * np.sin(around), around))
    return shapes


def draw_arrow_head(axes: Any, path: NDArray[np.float64]) -> None:
    """Draws an arrow head at the end of a path (n, 2+)."""
    apart = np.flatnonzero(np.hypot(*(path[:, :2] - path[-1, :2]).T) > 1e-3)
    if not len(apart):
        return
    axes.annotate(
        "",
        xy=tuple(path[-1, :2]),
        xytext=tuple(path[apart[-1], :2]),
        arrowprops={
            "arrowstyle": "-|>,head_length=0.6,head_width=0.35",
            "color": colors.BLACK,
            "lw": 2.0,
            "shrinkB": 0,
        },
        zorder=5.6,
        annotation_clip=True,
    )
