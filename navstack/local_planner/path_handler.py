"""The plan as the local planner sees it: transformed into the costmap's frame, cut to its window, pruned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import Path, Pose2D, Transform2D
from navstack.core.errors import InvalidPathError
from navstack.core.grid import GridGeometry
from navstack.local_planner._path_kernels import transform_nearby_plan

PRUNE_DISTANCE_M = 1.0
"""Leading poses farther from the robot than this are passed, says prunePlan."""


class PathHandler:
    """Holds the plan being followed."""

    def __init__(self) -> None:
        self._plan: NDArray[np.float64] | None = None
        self._begin = 0
        self.frame = "map"

    def set(self, plan: Path) -> None:
        """Takes a plan; raises InvalidPathError when it is empty or not finite."""
        if len(plan) == 0:
            raise InvalidPathError("the plan is empty: there is nothing to follow", poses=0)
        if not np.isfinite(plan.poses).all():
            first = int(np.flatnonzero(~np.isfinite(plan.poses).all(axis=1))[0])
            raise InvalidPathError(
                f"pose {first} of the plan is not finite: {plan.poses[first].tolist()}",
                pose=first,
                value=plan.poses[first],
            )
        self._plan = np.array(plan.poses, np.float64, order="C")
        self._begin = 0
        self.frame = plan.frame

    def in_sight(
        self, robot: Pose2D, to_costmap: Transform2D, geometry: GridGeometry, *, prune: bool
    ) -> NDArray[np.float64]:
        """Poses (n, 3) in the costmap's frame: from the first within half the window of the robot until they leave it.

        With `prune`, leading poses more than 1 m away are dropped, for good. Raises InvalidPathError without a plan and when
        nothing of it is near.
        """
        plan = self._plan
        if plan is None:
            raise InvalidPathError("there is no plan to follow: call set_plan first", poses=0)
        reach = 0.5 * max(geometry.nx, geometry.ny) * geometry.resolution
        robot_in_plan = robot if to_costmap.is_identity() else to_costmap.inverse().apply(robot)
        out = np.empty((len(plan) - self._begin, 3))
        first, count = transform_nearby_plan(
            plan, self._begin, robot_in_plan.x, robot_in_plan.y, reach, to_costmap.x, to_costmap.y, to_costmap.yaw, out
        )
        seen = out[:count]
        if count == 0:
            nearest = float(np.hypot(plan[:, 0] - robot_in_plan.x, plan[:, 1] - robot_in_plan.y).min())
            raise InvalidPathError(
                f"the plan is out of reach: its nearest pose is {nearest:.2f} m from the robot, the local costmap sees "
                f"{reach:.2f} m",
                nearest_m=nearest,
                reach_m=reach,
            )
        if prune:
            near = np.hypot(seen[:, 0] - robot.x, seen[:, 1] - robot.y) < PRUNE_DISTANCE_M
            passed = int(near.argmax()) if near.any() else count
            if passed == count:
                raise InvalidPathError(
                    f"every pose of the plan in sight is more than {PRUNE_DISTANCE_M:g} m from the robot, and prune_plan "
                    "drops those",
                    reach_m=reach,
                )
            if passed:
                self._begin = first + passed
                seen = seen[passed:]
        return seen
