"""The part of the plan that DWB scores, as Nav2 up to Kilted cuts it: by distances from the robot, from a little behind it on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, InvalidPathError, Path, Pose2D, Transform2D
from navstack.local_planner.path_handlers import check_path, no_plan, out_of_reach
from navstack.plugins import LocalPath, PathHandler


class PlanWindow(PathHandler):
    """Hands out the poses of the plan around the robot (DWBLocalPlanner::transformGlobalPlan).

    From the first one nearer than `prune_distance` until the first one farther than `forward_prune_distance`, both at most half
    of the local costmap; without `prune` or `shorten` that half alone. The first one is looked for in the next
    `forward_prune_distance` of the plan. With `prune`, poses before it are dropped permanently.

    Nav2 differs: where this finds no pose, Nav2 has no command. Here the first pose of the whole plan that is within both
    distances begins the window. A robot needs this whose behavior tree sends a path again of which it has driven a part, and one
    whose forward_prune_distance is below its prune_distance.
    """

    def __init__(self, *, prune: bool, prune_distance: float, shorten: bool, forward_prune_distance: float) -> None:
        self._prune, self._shorten = prune, shorten
        self._behind, self._ahead = prune_distance, forward_prune_distance
        self._plan: NDArray[np.float64] | None = None
        """(n, 4) x, y, yaw, and length of the plan up to the pose."""
        self._begin = 0

    def set_plan(self, plan: Path) -> None:
        """Replace the plan."""
        check_path(plan)
        poses = np.zeros((len(plan), 4))
        poses[:, :3] = plan.poses
        np.cumsum(np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1])), out=poses[1:, 3])
        self._plan, self._begin = poses, 0

    def local_path(self, robot: Pose2D, to_costmap: Transform2D, geometry: GridGeometry) -> LocalPath:
        """Return the poses around the robot. Raises InvalidPathError if there are none."""
        plan = self._plan
        if plan is None:
            raise no_plan()
        at = robot if to_costmap.is_identity() else to_costmap.inverse().apply(robot)
        half = 0.5 * max(geometry.nx, geometry.ny) * geometry.resolution
        first, end = self._window(plan, at, half)
        if first >= end:
            raise self._nothing(plan, at, half)
        if self._prune:
            self._begin = first
        poses = to_costmap.apply_poses(plan[first:end, :3])
        return LocalPath(
            poses,
            length=float(plan[end - 1, 3] - plan[first, 3]),
            remaining_m=float(plan[-1, 3] - plan[self._nearest(plan, at, first, end), 3]),
            first=first,
            end=end,
            ends_at_goal=end == len(plan),
        )

    def _window(self, plan: NDArray[np.float64], at: Pose2D, half: float) -> tuple[int, int]:
        """First index and the one after the last."""
        behind = min(half, self._behind) if self._prune else half
        ahead = min(half, self._ahead) if self._shorten else half
        rest = plan[self._begin :]
        distances = np.hypot(rest[:, 0] - at.x, rest[:, 1] - at.y)
        searched = int(np.searchsorted(rest[:, 3] - rest[0, 3], self._ahead, side="right"))
        near = np.flatnonzero(distances[:searched] < behind)
        first = int(near[0]) if len(near) else searched
        far = np.flatnonzero(distances[first:] > ahead)
        end = first + int(far[0]) if len(far) else len(rest)
        if first >= end:
            near = np.flatnonzero(distances < min(behind, ahead))
            if len(near):
                first = int(near[0])
                far = np.flatnonzero(distances[first:] > ahead)
                end = first + int(far[0]) if len(far) else len(rest)
        return self._begin + first, self._begin + end

    def _nearest(self, plan: NDArray[np.float64], at: Pose2D, first: int, end: int) -> int:
        """The pose of the window closest to the robot; the later one of equals."""
        distances = np.hypot(plan[first:end, 0] - at.x, plan[first:end, 1] - at.y)
        return end - 1 - int(np.argmin(distances[::-1]))

    def _nothing(self, plan: NDArray[np.float64], at: Pose2D, half: float) -> InvalidPathError:
        """The error of a robot without a pose of the plan around it."""
        limits = [(half, "half the local costmap")]
        limits += [(self._behind, "prune_distance")] if self._prune else []
        limits += [(self._ahead, "forward_prune_distance")] if self._shorten else []
        reach, limit = min(limits)
        return out_of_reach(plan[self._begin :, :3], at, reach, limit)
