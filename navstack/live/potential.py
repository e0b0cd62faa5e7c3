"""The potential of the global planner, on the present costmap, as a small image."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from navstack.core.errors import NavError
from navstack.live.frame import Frame
from navstack.live.session import Session
from navstack.move_base import plugin_calls

LONGEST_SIDE: Final = 256
"""Cells of the image along its longer side."""
UNREACHED: Final = 255


class PotentialView:
    """The potential of the present plan as one page knows it."""

    def __init__(self) -> None:
        self._shown = (-1, -1)

    def update(self, session: Session, frame: Frame) -> dict[str, Any] | None:
        """Returns the entry of the header after a new plan: an image (ny, nx) u1, 0 lowest .. 254 highest, 255 unreached.

        Plans again with a planner of its own, so that the run is not disturbed. None if the planner has no potential.
        """
        key = (session.restarts, session.history.plan_count)
        move_base = session.run.move_base
        if key == self._shown or move_base.goal_pose is None or move_base.plan is None:
            return None
        self._shown = key
        planner = type(move_base.global_planner)(move_base.global_planner.params)
        costmap = move_base.global_costmap
        start = session.run.robot.pose
        try:
            plan = plugin_calls.make_plan(
                planner, costmap.master, start, move_base.goal_pose, costmap.footprint, keep_potential=True
            )
        except NavError:
            return None
        if plan.potential is None:
            return None
        geometry = costmap.master.geometry
        stride = -(-max(plan.potential.shape) // LONGEST_SIDE)
        values = plan.potential[::stride, ::stride].astype(np.float64)
        reached = np.isfinite(values) & (values < 1e9)
        highest = float(values[reached].max()) if reached.any() else 1.0
        image = np.where(reached, np.minimum(values / max(highest, 1e-9) * 254.0, 254.0), UNREACHED)
        return {
            "nx": image.shape[1],
            "ny": image.shape[0],
            "resolution": geometry.resolution * stride,
            "origin": [geometry.origin_x, geometry.origin_y],
            "highest": round(highest, 2),
            "blob": frame.blob(image.astype(np.uint8)),
        }
