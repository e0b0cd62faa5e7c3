# pyright: basic
"""nav2_controller::FeasiblePathHandler: prunes the plan, cuts it to the local costmap, and at cusps and turns in place."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, InvalidPathError, Path, Pose2D, Transform2D, angle_between, plain_kernel
from navstack.plugins import PATH_HANDLERS, LocalPath, ParamModel, PathHandler, PluginSection, param

# ----------------------------------------------------------------------------------------------------------------------
# The plan as DWA and trajectory rollout use it: pruned, cut to the local costmap, in the costmap's frame.


# pyright: basic


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


def out_of_reach(
    plan: NDArray[np.float64], robot: Pose2D, reach: float, limit: str = "half the local costmap"
) -> InvalidPathError:
    """The error of a plan without a pose nearer to the robot, in the plan's frame, than `reach` (m), which is the `limit`."""
    nearest = float(np.hypot(plan[:, 0] - robot.x, plan[:, 1] - robot.y).min())
    return InvalidPathError(
        f"the plan is out of reach: its nearest pose is {nearest:.2f} m from the robot, the controller follows poses within "
        f"{reach:.2f} m ({limit})",
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


@plain_kernel
def transform_nearby_plan(plan, begin, x, y, reach, tx, ty, tyaw, out):
    """Write the poses of `plan` near (x, y), transformed by (tx, ty, tyaw), to `out`. Returns (first index, count).

    From the first pose within `reach` (m) up to and including the first one beyond it (transformGlobalPlan of
    base_local_planner). The search starts at index `begin`; x and y are in the plan's frame.
    """
    limit = reach * reach
    first = begin
    while first < len(plan):
        dx, dy = x - plan[first, 0], y - plan[first, 1]
        if dx * dx + dy * dy <= limit:
            break
        first += 1
    c, s = math.cos(tyaw), math.sin(tyaw)
    count = 0
    while first + count < len(plan):
        px, py, yaw = plan[first + count, 0], plan[first + count, 1], plan[first + count, 2]
        out[count, 0] = tx + c * px - s * py
        out[count, 1] = ty + s * px + c * py
        yaw += tyaw
        if not (-math.pi < yaw <= math.pi):
            yaw = yaw - 2.0 * math.pi * math.ceil((yaw - math.pi) / (2.0 * math.pi))
        out[count, 2] = yaw
        count += 1
        dx, dy = x - px, y - py
        if dx * dx + dy * dy > limit:
            break
    return first, count


# pyright: basic


MOVED_M = 1e-4
"""Poses closer than this belong to a turn in place (m)."""


class FeasiblePathHandlerParams(PluginSection):
    """Which part of the plan the controller gets."""

    plugin: str = param("feasible", "type of the path handler")
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
        "distance to a cut at which the rest of the path follows; at a cusp the distance along the path counts, and a robot "
        "beyond the cusp has passed it",
        unit="m",
        ge=0.0,
    )
    inversion_yaw_tolerance: float = param(
        0.4, "angle to the heading of a cut at which the rest of the path follows", unit="rad", ge=0.0
    )
    minimum_rotation_angle: float = param(
        0.785, "accumulated turn at one place that counts as a turn in place", unit="rad", gt=0.0
    )
    reject_unit_path: bool = param(False, "a plan of a single pose is an error")


@PATH_HANDLERS.register("feasible")
class FeasiblePathHandler(PathHandler):
    """Hands out the plan from the pose closest to the robot on; poses behind that one are dropped permanently."""

    Params: ClassVar[type[ParamModel]] = FeasiblePathHandlerParams

    def __init__(self, params: FeasiblePathHandlerParams) -> None:
        self.params = params
        self._plan: NDArray[np.float64] | None = None
        """(n, 5) x, y, yaw, length of the plan up to the pose, length of the segment before it."""
        self._cuts: list[int] = []
        """Indices of the poses that the path is cut after."""
        self._begin = 0

    def set_plan(self, plan: Path) -> None:
        """Replace the plan and find its cuts."""
        check_path(plan)
        p = self.params
        poses = np.empty((len(plan), 5))
        poses[:, :3] = plan.poses
        poses[0, 4] = 0.0
        np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1]), out=poses[1:, 4])
        np.cumsum(poses[:, 4], out=poses[:, 3])
        self._plan = poses
        self._begin = 0
        self._cuts = []
        if p.enforce_path_inversion or p.enforce_path_rotation:
            self._cuts = self._find_cuts(poses)

    def local_path(self, robot: Pose2D, to_costmap: Transform2D, geometry: GridGeometry) -> LocalPath:
        """From the pose closest to the robot to `prune_distance`, the border of the costmap, or the next cut."""
        plan = self._plan
        if plan is None:
            raise no_plan()
        p = self.params
        at = robot if to_costmap.is_identity() else to_costmap.inverse().apply(robot)
        # half of (n - 0.5) cells, not of n, as getSizeInMeters returns it
        half = (max(geometry.nx, geometry.ny) - 0.5) * geometry.resolution / 2.0
        search = half if p.max_robot_pose_search_dist is None else p.max_robot_pose_search_dist
        first, end, at_cusp = self._piece(plan, at, search if search >= 0.0 else math.inf)
        if p.reject_unit_path and end - self._begin == 1:
            raise InvalidPathError(
                "the plan has a single pose, which reject_unit_path refuses; plan from the robot's pose, or set "
                "reject_unit_path to false",
                poses=1,
            )
        poses = np.empty((end - first, 3))
        count = int(
            cut_path(
                plan,
                first,
                float(p.prune_distance),
                float(to_costmap.x),
                float(to_costmap.y),
                float(to_costmap.yaw),
                float(geometry.origin_x),
                float(geometry.origin_y),
                float(geometry.resolution),
                geometry.nx,
                geometry.ny,
                poses,
            )
        )
        self._drop(plan, first, at)
        if count == 0:
            raise out_of_reach(plan, at, half)
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

    def _find_cuts(self, poses: NDArray[np.float64]) -> list[int]:
        """Return the indices of the poses that the path is cut after: cusps, and the ends of turns in place."""
        p = self.params
        found = np.empty(len(poses), np.int64)
        angle = p.minimum_rotation_angle if p.enforce_path_rotation else math.inf
        count = path_cuts(poses, p.enforce_path_inversion, angle, found)
        return found[:count].tolist()

    def _piece(self, plan: NDArray[np.float64], at: Pose2D, search: float) -> tuple[int, int, bool]:
        """The closest pose of the piece that the robot may follow, the index after its last pose, and whether that is a cut.

        The pieces on both sides of a cusp lie close together: only the first one that the robot has not finished counts.
        """
        while self._cuts:
            cut = self._cuts[0]
            first = int(closest_pose(plan[: cut + 1], self._begin, float(at.x), float(at.y), search))
            if not self._is_passed(plan, first, cut, at):
                return first, cut + 1, True
            self._cuts.pop(0)
            self._begin = cut
        return int(closest_pose(plan, self._begin, float(at.x), float(at.y), search)), len(plan), False

    def _drop(self, plan: NDArray[np.float64], first: int, at: Pose2D) -> None:
        """Drop the poses before `first`; called once per local path, whose robot is at `at` in the plan's frame."""
        del plan, at
        self._begin = first

    def _is_passed(self, plan: NDArray[np.float64], first: int, cut: int, at: Pose2D) -> bool:
        """True if the robot, closest to the pose `first`, is at the pose `cut`, or has driven past it."""
        p = self.params
        x, y, yaw, length, step = plan[cut].tolist()
        turned = abs(angle_between(at.yaw, yaw)) <= p.inversion_yaw_tolerance
        if turned and math.hypot(x - at.x, y - at.y) <= p.inversion_xy_tolerance:
            return True
        # Nav2 differs: there a robot that misses the cusp to the side turns back to it, again and again
        before = plan[cut - 1].tolist()
        if step <= MOVED_M or (first < cut - 1 and length - plan[first, 3] > p.inversion_xy_tolerance):
            return False
        beyond = ((at.x - x) * (x - before[0]) + (at.y - y) * (y - before[1])) / step
        return beyond >= (-p.inversion_xy_tolerance if turned else 0.0)


class Nav2FeasiblePathHandlerParams(FeasiblePathHandlerParams):
    """Parameters of Nav2's path handler, with its rules at cusps and turns in place."""

    plugin: str = param("nav2_controller::FeasiblePathHandler", "type of the path handler")
    prune_distance: float = param(
        2.0, "the local path ends this far along the plan beyond the pose closest to the robot", unit="m", ge=0.0
    )
    inversion_xy_tolerance: float = param(
        0.2, "distance to a cut at which the rest of the path follows", unit="m", ge=0.0
    )
    minimum_rotation_angle: float = param(
        0.785,
        "a turn in place of more than this angle is cut, before the pose that exceeds it; 0 = no turn is cut",
        unit="rad",
        ge=0.0,
    )


@PATH_HANDLERS.register("nav2_feasible", aliases=("nav2_controller/FeasiblePathHandler",))
class Nav2FeasiblePathHandler(FeasiblePathHandler):
    """As `feasible`, with Nav2's rules to the letter.

    A cut is passed only by a robot within both tolerances, and the rest follows in the next cycle, without the pose of the cut. A
    turn in place is cut before the pose at which it exceeds `minimum_rotation_angle`, not at its end.
    """

    Params: ClassVar[type[ParamModel]] = Nav2FeasiblePathHandlerParams

    def _find_cuts(self, poses: NDArray[np.float64]) -> list[int]:
        p = self.params
        angle = np.float32(p.minimum_rotation_angle if p.enforce_path_rotation else 0.0)
        cuts: list[int] = []
        begin = 0
        while (kept := int(first_piece(poses[begin:], p.enforce_path_inversion, angle))) < len(poses) - begin:
            begin += kept
            cuts.append(begin - 1)
        return cuts

    def _piece(self, plan: NDArray[np.float64], at: Pose2D, search: float) -> tuple[int, int, bool]:
        end = self._cuts[0] + 1 if self._cuts else len(plan)
        first = int(closest_pose(plan[:end], self._begin, float(at.x), float(at.y), search))
        return first, end, bool(self._cuts)

    def _drop(self, plan: NDArray[np.float64], first: int, at: Pose2D) -> None:
        self._begin = first
        if not self._cuts:
            return
        p = self.params
        x, y, yaw = plan[self._cuts[0], :3].tolist()
        # Nav2 compares in float32
        away = np.float32(np.hypot(np.float32(at.x - x), np.float32(at.y - y)))
        turned = np.float32(abs(angle_between(at.yaw, yaw)))
        if away <= np.float32(p.inversion_xy_tolerance) and turned <= np.float32(p.inversion_yaw_tolerance):
            self._begin = self._cuts.pop(0) + 1


@plain_kernel
def closest_pose(plan, begin, x, y, search):
    """Return the index of the pose of `plan` (n, 5) closest to (x, y), from `begin` on; the later one of equals.

    Poses up to the first one more than `search` (m) along the plan are considered. If the last pose of the plan is the closest,
    the one before it is returned: two are needed for a direction (nav2_controller's FeasiblePathHandler). Column 4: length of the
    segment before the pose (m).
    """
    best, nearest, length = begin, np.inf, 0.0
    for i in range(begin, len(plan)):
        if i > begin:
            length += plan[i, 4]
            if length > search:
                break
        distance = math.hypot(plan[i, 0] - x, plan[i, 1] - y)
        if distance <= nearest:
            best, nearest = i, distance
    return best - 1 if best == len(plan) - 1 and best > begin else best


@plain_kernel
def cut_path(plan, first, length, tx, ty, tyaw, origin_x, origin_y, resolution, nx, ny, out):
    """Write the poses of `plan` (n, 5) from `first` on, transformed by (tx, ty, tyaw), to `out` (m, 3). Returns how many.

    At most m poses, up to the last one that is at most `length` (m) along the plan from the first, or before the first one
    outside of a grid of nx x ny cells. Yaws are in (-pi, pi].
    """
    c, s = math.cos(tyaw), math.sin(tyaw)
    along = 0.0
    for count in range(len(out)):
        i = first + count
        if count > 0:
            along += plan[i, 4]
            if along > length:
                return count
        x = tx + c * plan[i, 0] - s * plan[i, 1]
        y = ty + s * plan[i, 0] + c * plan[i, 1]
        if not (x >= origin_x and y >= origin_y):
            return count
        if not ((x - origin_x) / resolution < nx and (y - origin_y) / resolution < ny):
            return count
        yaw = plan[i, 2] + tyaw
        if not (-math.pi < yaw <= math.pi):
            yaw = yaw - 2.0 * math.pi * math.ceil((yaw - math.pi) / (2.0 * math.pi))
        out[count, 0] = x
        out[count, 1] = y
        out[count, 2] = yaw
    return len(out)


@plain_kernel
def first_piece(plan, at_cusps, rotation):
    """Return how many poses of `plan` (n, 5) come before its first cut, n without one, in Nav2's float32 arithmetic.

    A cusp is cut after the pose where the path reverses, a turn in place before the pose at which it has turned by more than
    `rotation` (rad; 0: turns are not cut).
    """
    n = len(plan)
    if n < 3:
        return n
    turn_at = n
    before_x = before_y = np.float32(0.0)
    for i in range(n - 1):
        dx, dy = np.float32(plan[i + 1, 0] - plan[i, 0]), np.float32(plan[i + 1, 1] - plan[i, 1])
        moved = np.float32(math.hypot(dx, dy))
        if turn_at <= i + 1:
            break
        if at_cusps and moved > 1e-4:
            if i >= 1 and before_x * dx + before_y * dy < np.float32(0.0):
                return min(turn_at, i + 1)
            before_x, before_y = dx, dy
        if rotation >= np.float32(1e-6) and moved < 1e-4 and turn_at == n:
            turned = np.float32(0.0)
            for j in range(i, n - 1):
                angle = np.float64(np.float32(plan[j + 1, 2])) - np.float64(np.float32(plan[j, 2]))
                angle -= 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
                turned = np.float32(np.float64(turned) + abs(angle))
                if turned > rotation:
                    turn_at = j + 1
                    break
                if j + 2 >= n:
                    break
                ahead_x = np.float32(plan[j + 2, 0] - plan[j + 1, 0])
                ahead_y = np.float32(plan[j + 2, 1] - plan[j + 1, 1])
                if np.float32(math.hypot(ahead_x, ahead_y)) > 1e-4:
                    break
    return turn_at


@plain_kernel
def path_cuts(plan, at_cusps, rotation, out):
    """Write the indices of the poses at which `plan` (n, 5) reverses or turns in place to `out`. Returns how many.

    A cusp is a pose between two segments, each longer than 0.1 mm, of opposite directions. With `at_cusps` False, cusps are
    ignored. A turn in place is a sequence of poses within 0.1 mm that turns by at least `rotation` (rad); its last pose counts.
    """
    count = 0
    turned = 0.0
    before_x, before_y = 0.0, 0.0
    has_direction = False
    for i in range(1, len(plan)):
        dx, dy = plan[i, 0] - plan[i - 1, 0], plan[i, 1] - plan[i - 1, 1]
        if math.sqrt(dx * dx + dy * dy) > 1e-4:
            cut = abs(turned) >= rotation
            if at_cusps and has_direction and dx * before_x + dy * before_y < 0.0:
                cut = True
            if cut:
                out[count] = i - 1
                count += 1
            before_x, before_y, has_direction, turned = dx, dy, True, 0.0
        else:
            turn = plan[i, 2] - plan[i - 1, 2]
            turned += turn - 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
    return count
