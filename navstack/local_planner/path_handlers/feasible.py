"""nav2_controller::FeasiblePathHandler: prunes the plan, cuts it to the local costmap, and at cusps and turns in place."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, Path, Pose2D, Transform2D, angle_between
from navstack.core.errors import InvalidPathError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import LocalPath, PathHandler, PluginSection
from navstack.local_planner._path_kernels import closest_pose, cut_path, path_cuts
from navstack.local_planner.nearby_plan import check_path, no_plan, out_of_reach
from navstack.plugins import PATH_HANDLERS

MOVED_M = 1e-4
"""Poses closer than this belong to a turn in place (m)."""


class FeasiblePathHandlerParams(PluginSection):
    """Which part of the plan the controller gets."""

    plugin: str = param("nav2_controller::FeasiblePathHandler", "type of the path handler")
    prune_distance: float = param(
        2.0, "the local path ends this far along the plan beyond the pose closest to the robot", unit="m", gt=0.0
    )
    max_robot_pose_search_dist: float | None = param(
        None,
        "the pose closest to the robot is searched this far along the plan; not set: half the larger side of the local "
        "costmap; negative: along the whole plan",
        unit="m",
    )
    enforce_path_inversion: bool = param(False, "cut the path at its first cusp until the robot is there")
    enforce_path_rotation: bool = param(False, "cut the path at its first turn in place until the robot is there")
    inversion_xy_tolerance: float = param(
        0.2,
        "distance to a cut at which the rest of the path follows",
        unit="m",
        ge=0.0,
        ros_differs="at a cusp the distance along the path counts, and a robot beyond the cusp has passed it",
    )
    inversion_yaw_tolerance: float = param(
        0.4, "angle to the heading of a cut at which the rest of the path follows", unit="rad", ge=0.0
    )
    minimum_rotation_angle: float = param(
        0.785, "accumulated turn at one place that counts as a turn in place", unit="rad", gt=0.0
    )
    reject_unit_path: bool = param(False, "a plan of a single pose is an error")


@PATH_HANDLERS.register("feasible", aliases=("nav2_controller/FeasiblePathHandler",))
class FeasiblePathHandler(PathHandler):
    """Hands out the plan from the pose closest to the robot on; poses behind that one are dropped permanently."""

    Params: ClassVar[type[ParamModel]] = FeasiblePathHandlerParams

    def __init__(self, params: FeasiblePathHandlerParams) -> None:
        self.params = params
        self._plan: NDArray[np.float64] | None = None
        """(n, 4) x, y, yaw, and length of the plan up to the pose."""
        self._cuts: list[int] = []
        """Indices of the poses that the path is cut after."""
        self._begin = 0
        self._window = np.empty(4)

    def set_plan(self, plan: Path) -> None:
        """Replace the plan and find its cuts."""
        check_path(plan)
        p = self.params
        if p.reject_unit_path and len(plan) == 1:
            raise InvalidPathError(
                "the plan has a single pose, which reject_unit_path refuses; plan from the robot's pose, or set "
                "reject_unit_path to false",
                poses=1,
            )
        poses = np.empty((len(plan), 4))
        poses[:, :3] = plan.poses
        poses[0, 3] = 0.0
        np.cumsum(np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1])), out=poses[1:, 3])
        self._plan = poses
        self._begin = 0
        self._cuts = []
        if p.enforce_path_inversion or p.enforce_path_rotation:
            found = np.empty(len(poses), np.int64)
            angle = p.minimum_rotation_angle if p.enforce_path_rotation else math.inf
            count = path_cuts(poses, p.enforce_path_inversion, angle, found)
            self._cuts = found[:count].tolist()

    def local_path(self, robot: Pose2D, to_costmap: Transform2D, geometry: GridGeometry) -> LocalPath:
        """From the pose closest to the robot to `prune_distance`, the border of the costmap, or the next cut."""
        plan = self._plan
        if plan is None:
            raise no_plan()
        p = self.params
        at = robot if to_costmap.is_identity() else to_costmap.inverse().apply(robot)
        half = 0.5 * max(geometry.nx, geometry.ny) * geometry.resolution
        search = half if p.max_robot_pose_search_dist is None else p.max_robot_pose_search_dist
        first, end, at_cusp = self._piece(plan, at, search if search >= 0.0 else math.inf)
        left, right, bottom, top = geometry.extent
        self._window[:] = left, bottom, right, top
        poses = np.empty((end - first, 3))
        length = plan[first, 3] + p.prune_distance
        count = int(
            cut_path(
                plan,
                first,
                length,
                float(to_costmap.x),
                float(to_costmap.y),
                float(to_costmap.yaw),
                self._window,
                poses,
            )
        )
        if count == 0:
            raise out_of_reach(plan, at, half)
        self._begin = first
        last = first + count - 1
        return LocalPath(
            poses[:count],
            length=float(plan[last, 3] - plan[first, 3]),
            remaining_m=float(plan[-1, 3] - plan[first, 3]),
            first=first,
            end=last + 1,
            ends_at_cusp=at_cusp and last + 1 == end,
            ends_at_goal=last + 1 == len(plan),
        )

    def _piece(self, plan: NDArray[np.float64], at: Pose2D, search: float) -> tuple[int, int, bool]:
        """The closest pose of the piece that the robot may follow, the index after its last pose, and whether that is a cut.

        The pieces on both sides of a cusp lie close together: only the first one that the robot has not finished counts.
        """
        begin = self._begin
        while self._cuts:
            cut = self._cuts[0]
            first = int(closest_pose(plan[: cut + 1], begin, float(at.x), float(at.y), search))
            if not self._is_passed(plan, first, cut, at):
                return first, cut + 1, True
            self._cuts.pop(0)
            begin = cut
        return int(closest_pose(plan, begin, float(at.x), float(at.y), search)), len(plan), False

    def _is_passed(self, plan: NDArray[np.float64], first: int, cut: int, at: Pose2D) -> bool:
        """True if the robot, closest to the pose `first`, is at the pose `cut`, or has driven past it."""
        p = self.params
        x, y, yaw, length = plan[cut].tolist()
        turned = abs(angle_between(at.yaw, yaw)) <= p.inversion_yaw_tolerance
        if turned and math.hypot(x - at.x, y - at.y) <= p.inversion_xy_tolerance:
            return True
        # ROS differs: in Nav2 a robot that misses the cusp to the side turns back to it, again and again
        before = plan[cut - 1].tolist()
        step = length - before[3]
        if step <= MOVED_M or (first < cut - 1 and length - plan[first, 3] > p.inversion_xy_tolerance):
            return False
        beyond = ((at.x - x) * (x - before[0]) + (at.y - y) * (y - before[1])) / step
        return beyond >= (-p.inversion_xy_tolerance if turned else 0.0)
