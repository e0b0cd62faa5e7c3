"""The plan as DWA and trajectory rollout use it: pruned, cut to the local costmap, in the costmap's frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import Path, Pose2D, Transform2D
from navstack.core.errors import InvalidPathError
from navstack.core.grid import GridGeometry
from navstack.local_planner._path_kernels import transform_nearby_plan

PRUNE_DISTANCE_M = 1.0
"""Leading poses farther from the robot than this count as passed (prunePlan of base_local_planner)."""


def check_path(plan: Path) -> None:
    """Raise InvalidPathError if a plan is empty or not finite."""
    if len(plan) == 0:
        raise InvalidPathError("the plan is empty: a local planner needs at least one pose to follow", poses=0)
    if not np.isfinite(plan.poses).all():
        first = int(np.flatnonzero(~np.isfinite(plan.poses).all(axis=1))[0])
        raise InvalidPathError(
            f"pose {first} of the plan is not finite: {plan.poses[first].tolist()}",
            pose=first,
            value=plan.poses[first],
        )


def no_plan() -> InvalidPathError:
    """The error of a local planner without a plan."""
    return InvalidPathError("the local planner has no plan to follow: call set_plan first", poses=0)


def out_of_reach(plan: NDArray[np.float64], robot: Pose2D, reach: float) -> InvalidPathError:
    """The error of a plan without a pose near the robot, which is given in the plan's frame; `reach` (m) is half the window."""
    nearest = float(np.hypot(plan[:, 0] - robot.x, plan[:, 1] - robot.y).min())
    return InvalidPathError(
        f"the plan is out of reach: its nearest pose is {nearest:.2f} m from the robot, the local costmap covers "
        f"{reach:.2f} m",
        nearest_m=nearest,
        reach_m=reach,
    )


class NearbyPlan:
    """Holds the plan that is being followed."""

    def __init__(self) -> None:
        self._plan: NDArray[np.float64] | None = None
        self._begin = 0

    def set_plan(self, plan: Path) -> None:
        """Replace the plan; raises InvalidPathError if it is empty or not finite."""
        check_path(plan)
        self._plan = np.array(plan.poses, np.float64, order="C")
        self._begin = 0

    def nearby_plan(
        self, robot: Pose2D, to_costmap: Transform2D, geometry: GridGeometry, *, prune: bool
    ) -> NDArray[np.float64]:
        """Poses (n, 3) in the costmap's frame: from the first within half the window of the robot until they leave it.

        `prune` drops leading poses more than PRUNE_DISTANCE_M away permanently. Raises InvalidPathError without a plan and if
        no pose of it is near.
        """
        plan = self._plan
        if plan is None:
            raise no_plan()
        reach = 0.5 * max(geometry.nx, geometry.ny) * geometry.resolution
        robot_in_plan = robot if to_costmap.is_identity() else to_costmap.inverse().apply(robot)
        out = np.empty((len(plan) - self._begin, 3))
        first, count = transform_nearby_plan(
            plan, self._begin, robot_in_plan.x, robot_in_plan.y, reach, to_costmap.x, to_costmap.y, to_costmap.yaw, out
        )
        nearby = out[:count]
        if count == 0:
            raise out_of_reach(plan, robot_in_plan, reach)
        if prune:
            near = np.hypot(nearby[:, 0] - robot.x, nearby[:, 1] - robot.y) < PRUNE_DISTANCE_M
            passed = int(near.argmax()) if near.any() else count
            if passed == count:
                raise InvalidPathError(
                    f"all poses of the plan in the local costmap are more than {PRUNE_DISTANCE_M:g} m from the robot; "
                    "prune_plan drops such poses",
                    reach_m=reach,
                )
            if passed:
                self._begin = first + passed
                nearby = nearby[passed:]
        return nearby
