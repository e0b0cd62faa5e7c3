"""Graceful controller: nav2_graceful_controller::GracefulController.

The robot drives to a target on its path by the smooth control law of Park and Kuipers. The farthest target that a simulated
trajectory reaches without a collision is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Path, Pose2D, Twist2D, angle_between
from navstack.core.collision import footprint_cost, overlaps_obstacle
from navstack.core.costs import LETHAL, UNKNOWN
from navstack.core.errors import NoValidControlError
from navstack.core.overlap import is_nearly_round, leads_away, without_lethal
from navstack.core.parameters import ParamModel
from navstack.interfaces import LocalPlan, VelocityLimits
from navstack.local_planner._carrot_kernels import point_ahead
from navstack.local_planner.graceful import _law_kernels as kernels
from navstack.local_planner.graceful._law_kernels import LAW
from navstack.local_planner.graceful.params import GracefulParams
from navstack.local_planner.path_follower import Following, PathFollower, check_speed
from navstack.plugins import LOCAL_PLANNERS

MOST_POINTS = 1500
"""Points of a simulated trajectory at most."""
SEARCH_COST = 253
"""Highest cost under the center of a pose that does not collide."""


class _Attempt(NamedTuple):
    """A trajectory that reaches its target."""

    command: Twist2D
    points: int
    cost: int
    seconds: float
    target: tuple[float, float, float]


@LOCAL_PLANNERS.register("graceful", aliases=("nav2_graceful_controller/GracefulController",))
class GracefulController(PathFollower):
    """Follows a path by a smooth control law.

    State between cycles: the plan, the goal checker, whether the initial turn is due, a final heading that was found. With
    `as_nav2`, the deliberate differences from Nav2 are off (parity page).
    """

    Params: ClassVar[type[ParamModel]] = GracefulParams
    params: Any

    def __init__(self, params: GracefulParams, *, as_nav2: bool = False) -> None:
        super().__init__(params)
        self.as_nav2 = as_nav2
        self.carrot: tuple[float, float] | None = None
        """The motion target, in the robot's frame (m)."""
        self._turn_due = True
        self._final_yaw: float | None = None
        self._law = np.zeros(1, LAW)
        self._out = np.empty((MOST_POINTS, 3))
        self._point, self._grid, self._start, self._target = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        self._command = np.empty(2)
        self.set_limits()

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        p = self.params
        return VelocityLimits(
            max_vel_x=self._v_max,
            min_vel_x=-self._v_max if self._backward else 0.0,
            max_vel_y=0.0,
            min_vel_y=0.0,
            max_vel_trans=self._v_max,
            min_vel_trans=0.0,
            max_vel_theta=self._w_max,
            min_vel_theta=0.0,
            acc_lim_x=p.deceleration_max,
            acc_lim_y=0.0,
            acc_lim_theta=p.deceleration_max,
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
        )

    @property
    def _backward(self) -> bool:
        return self.params.allow_backward and not self.params.initial_rotation

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        p = self.params
        self._v_max = p.v_linear_max if max_vel_trans is None else min(p.v_linear_max, max_vel_trans)
        self._w_max = p.v_angular_max if max_vel_theta is None else min(p.v_angular_max, max_vel_theta)
        for name, value in {
            "k_phi": p.k_phi,
            "k_delta": p.k_delta,
            "beta": p.beta,
            "exponent": getattr(p, "lambda"),
            "slowdown_radius": p.slowdown_radius,
            "deceleration": p.deceleration_max,
            "v_min": min(p.v_linear_min, self._v_max),
            "v_max": self._v_max,
            "v_full": max(self._v_max, 1e-3),
            "w_max": self._w_max,
            "w_min": min(p.v_angular_min_in_place, self._w_max),
            "rotation_gain": p.rotation_scaling_factor,
            "turn_tolerance": p.initial_rotation_tolerance,
            "scaling_speed": p.footprint_scaling_linear_vel,
            "scaling_factor": p.footprint_scaling_factor,
            "period": self.period,
            "checked": p.use_collision_detection,
            "as_nav2": self.as_nav2,
        }.items():
            self._law[name] = value

    # --- the command ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Reset the previous goal and a heading that was found for it."""
        super().reset()
        self._turn_due, self._final_yaw = True, None

    def follow(self, now: Following) -> LocalPlan:
        """Drive to the farthest target that can be reached. Raises NoValidControlError if none can."""
        # ROS differs: in Nav2 every new plan makes the turn due again
        if now.new_goal or (self.as_nav2 and now.new_plan):
            self._turn_due, self._final_yaw = True, None
        poses = self._oriented(now.path.poses)
        local = Path(now.path.poses, now.costmap.frame)
        if now.at_position:
            error = angle_between(now.state.pose.yaw, float(poses[-1, 2]))
            if self._may_turn(now, error):
                self.carrot = None
                w = float(kernels.turning_in_place(error, self._law[0]))
                note = f"at the goal's position, {error:+.2f} rad to its heading: turning in place"
                return LocalPlan(Twist2D(0.0, 0.0, w), "rotate_to_goal", local_plan=local, notes=(note,))
        self._prepare(now)
        tried = 0
        for tried, (target, along) in enumerate(self._targets(now, poses), 1):
            found = self._reach(now, target, along)
            if found is not None:
                return self._plan(now, found, (self._reason(now, found, along, tried),))
        leaving = self._leave(now, poses)
        if leaving is not None:
            return leaving
        self.carrot = None
        raise NoValidControlError(
            f"no trajectory to one of {tried} targets within max_lookahead {self.params.max_lookahead:g} m is free of "
            "collisions; the path is blocked or too close to an obstacle",
            targets=tried,
            plan=LocalPlan(Twist2D(), local_plan=local),
        )

    def _plan(self, now: Following, found: _Attempt, notes: tuple[str, ...]) -> LocalPlan:
        """The result for the trajectory that was simulated last."""
        self.carrot = _in_frame_of(now.state.pose, found.target)
        trajectory = np.concatenate((self._start[np.newaxis], self._out[: found.points]))
        local = Path(now.path.poses, now.costmap.frame)
        return LocalPlan(found.command, trajectory=trajectory, local_plan=local, notes=notes)

    def _leave(self, now: Following, poses: NDArray[np.float64]) -> LocalPlan | None:
        """Drive away from obstacles that the footprint overlaps at rest; None if it overlaps none, or there is no way.

        ROS differs: in Nav2 a robot that overlaps an obstacle never leaves it.
        """
        pose = now.state.pose
        checked = self.params.use_collision_detection and not self.as_nav2
        if not checked or not overlaps_obstacle(now.costmap, now.footprint, pose):
            return None
        free = replace(now, costmap=without_lethal(now.costmap))
        for target, along in self._targets(now, poses):
            if math.hypot(target[0] - pose.x, target[1] - pose.y) <= now.costmap.geometry.resolution:
                continue  # the robot is there: it would turn on the spot
            found = self._reach(free, target, along)
            if found is not None:
                held = [_driven(pose, found.command, share * self.period) for share in (0.0, 0.5, 1.0)]
                way = np.concatenate((np.array(held), self._out[: found.points]))
                if leads_away(now.costmap, now.footprint, way):
                    note = "the footprint overlaps an obstacle; the trajectory leads away from it"
                    return replace(self._plan(now, found, (note,)), mode="escape")
        return None

    def _reason(self, now: Following, found: _Attempt, along: float, tried: int) -> str:
        x, y, _ = found.target
        pose = now.state.pose
        bearing = angle_between(pose.yaw, math.atan2(y - pose.y, x - pose.x))
        text = f"target {along:.2f} m ahead on the path, {bearing:+.2f} rad off the heading"
        if tried > 1:
            text += f", because {tried - 1} farther ones collide"
        v, w = found.command.vx, found.command.wz
        if v == 0.0:
            return f"{text}: turning in place, for it is more than initial_rotation_tolerance"
        left = math.hypot(x - pose.x, y - pose.y) + float(self._law["beyond"][0])
        top = self._v_max
        limits = {
            "v_linear_max": top,
            f"the rest of the path of {left:.2f} m": min(
                top * left / self.params.slowdown_radius, math.sqrt(2.0 * left * self.params.deceleration_max)
            ),
        }
        if abs(w) >= self._w_max - 1e-9:
            limits["v_angular_max"] = abs(v)
        if abs(v) < min(limits.values()) - 1e-9:
            limits[f"the curvature of {w / v:+.2f} 1/m"] = abs(v)
        return f"{text}; {abs(v):.2f} m/s, limited by {min(limits, key=lambda k: limits[k])}"

    def _oriented(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """The path; with the direction of the next pose as heading if all poses between first and last have the same one."""
        if len(poses) < 3:
            return poses
        first = float(poses[1, 2])
        # ROS differs: Nav2 also takes a path that turns left for one without headings
        most = math.inf if self.as_nav2 else 1e-6
        if not all(-1e-6 <= angle_between(first, yaw) <= most for yaw in poses[2:-1, 2].tolist()):
            return poses
        poses = poses.copy()
        steps = np.diff(poses[:, :2], axis=0)
        poses[:-1, 2] = np.arctan2(steps[:, 1], steps[:, 0])
        return poses

    def _may_turn(self, now: Following, error: float) -> bool:
        """True if the robot can turn in place by `error` (rad)."""
        p = self.params
        if not p.use_collision_detection:
            return True
        pose = now.state.pose
        if self.as_nav2 and now.costmap.cost_at(pose.x, pose.y) is None:
            return True
        count = max(1, int(abs(error) / p.in_place_collision_resolution))
        if not (self.as_nav2 or is_nearly_round(now.footprint)):
            # ROS differs: no corner moves by more than a cell from check to check
            way = abs(error) * now.footprint.circumscribed_radius
            count = max(count, math.ceil(way / now.costmap.geometry.resolution))
        for i in range(1, count + 1):
            at = Pose2D(pose.x, pose.y, pose.yaw + error * i / count)
            cost = footprint_cost(now.costmap, now.footprint, at, interior=not self.as_nav2)
            if cost is None or cost == LETHAL or (cost == UNKNOWN and not now.track_unknown_space):
                return False
        return True

    # --- targets ----------------------------------------------------------------------------------------------------

    def _prepare(self, now: Following) -> None:
        geometry = now.costmap.geometry
        self._grid[:] = geometry.origin_x, geometry.origin_y, geometry.resolution
        self._start[:] = now.state.pose
        self._corners = np.ascontiguousarray(now.footprint.vertices.T)
        self._law["unknown_free"] = now.track_unknown_space
        self._law["corners_count"] = not (self.as_nav2 or is_nearly_round(now.footprint))

    def _targets(
        self, now: Following, poses: NDArray[np.float64]
    ) -> Iterator[tuple[tuple[float, float, float], float]]:
        """Targets from the farthest on, with their distance along the path (m)."""
        most = self.params.max_lookahead
        along = float(point_ahead(poses, float(most), False, self._point))
        yield (float(self._point[0]), float(self._point[1]), float(self._point[2])), along
        lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
        to_path = math.hypot(poses[0, 0] - now.state.pose.x, poses[0, 1] - now.state.pose.y)
        for i in range(len(poses) - 2, -1, -1):
            if to_path + lengths[i] <= most:
                x, y, yaw = poses[i].tolist()
                yield (x, y, yaw), float(lengths[i])

    def _reach(self, now: Following, target: tuple[float, float, float], along: float) -> _Attempt | None:
        """The trajectory to a target, None if there is none."""
        p, pose = self.params, now.state.pose
        x, y, yaw = target
        bearing = math.atan2(y - pose.y, x - pose.x)
        near = p.prefer_final_rotation and now.path.length < p.max_lookahead
        if near:
            yaw = bearing if self._final_yaw is None or self.as_nav2 else self._final_yaw
        ahead = math.cos(bearing - pose.yaw) > 0.0
        backward = self._backward and not ahead
        if backward:
            yaw += math.pi
        off = abs(angle_between(pose.yaw, bearing + (math.pi if backward else 0.0)))
        if off < p.initial_rotation_tolerance:
            self._turn_due = False
        self._law["turn_first"] = p.initial_rotation and self._turn_due
        self._law["backward"] = backward
        self._law["beyond"] = 0.0 if self.as_nav2 else max(0.0, now.path.remaining_m - along)
        found = self._lowering(now, (x, y, yaw))
        if self.as_nav2:
            if found is None and near and backward:  # a second attempt, for which Nav2 turns the target again
                return self._lowering(now, (x, y, yaw + math.pi))
            risky = near and found is not None and found.cost >= SEARCH_COST - p.obstacle_cost_margin
            return self._search_as_nav2(now, x, y, found) if risky else found
        # ROS differs: Nav2 does not search if the direct way collides
        risky = found is None or found.cost >= SEARCH_COST - p.obstacle_cost_margin
        if near and p.use_collision_detection and risky:
            found = self._search(now, x, y) or self._lowering(now, (x, y, yaw))
        return found

    def _search(self, now: Following, x: float, y: float) -> _Attempt | None:
        """The quickest trajectory with a safe final heading."""
        p = self.params
        best: _Attempt | None = None
        for i in range(math.ceil(2.0 * math.pi / p.final_rotation_search_step)):
            found = self._lowering(now, (x, y, -math.pi + i * p.final_rotation_search_step))
            safe = found is not None and found.cost < SEARCH_COST - p.obstacle_cost_margin
            # ROS differs: in Nav2 an unsafe heading that is as quick hides a safe one
            if found is not None and safe and (best is None or found.seconds < best.seconds):
                best = found
        if best is not None:
            self._final_yaw = best.target[2]
            best = self._lowering(now, best.target)
        return best

    def _search_as_nav2(self, now: Following, x: float, y: float, best: _Attempt | None) -> _Attempt | None:
        """The search with Nav2's defects: headings in the robot's frame, from the last one found on; hidden safe ones."""
        p, heading = self.params, now.state.pose.yaw
        turned = math.pi if bool(self._law["backward"][0]) else 0.0
        quickest = math.inf
        for i in range(math.ceil(2.0 * math.pi / p.final_rotation_search_step)):
            yaw = i * p.final_rotation_search_step + (self._final_yaw or 0.0)
            found = self._lowering(now, (x, y, heading + yaw + turned))
            if found is None or found.seconds >= quickest:
                continue
            quickest = found.seconds
            if found.cost < SEARCH_COST:
                best = found
                if self._final_yaw == yaw:
                    break
                self._final_yaw = yaw
        return best

    def _lowering(self, now: Following, target: tuple[float, float, float]) -> _Attempt | None:
        """The trajectory to a target at the highest speed at which it does not collide."""
        p = self.params
        speed = self._v_max
        self._target[:] = target
        while True:
            self._law["v_max"] = speed
            count, cost, seconds = kernels.simulate(
                now.costmap.data,
                self._grid,
                self._corners,
                self._start,
                self._target,
                self._law,
                self._out,
                self._command,
            )
            v, w = self._command.tolist()
            if count > 0 and self._holds(now, v, w):
                return _Attempt(Twist2D(v, 0.0, w), int(count), int(cost), float(seconds), target)
            speed -= p.footprint_scaling_step
            if speed < p.footprint_scaling_linear_vel or speed <= 0.0:
                return None

    def _holds(self, now: Following, v: float, w: float) -> bool:
        """True if the command does not collide while it is held, for one period.

        ROS differs: Nav2 checks only the simulated poses, of which the first is behind the robot's after a period.
        """
        if self.as_nav2 or not self.params.use_collision_detection:
            return True
        return bool(
            kernels.holds(
                now.costmap.data,
                self._grid,
                now.footprint.vertices,
                self._start,
                v,
                w,
                self.period,
                now.track_unknown_space,
            )
        )


def _driven(pose: Pose2D, command: Twist2D, seconds: float) -> Pose2D:
    """The pose after a command has been driven for some time."""
    turned, length = seconds * command.wz, seconds * command.vx
    heading = pose.yaw + 0.5 * turned
    return Pose2D(pose.x + length * math.cos(heading), pose.y + length * math.sin(heading), pose.yaw + turned)


def _in_frame_of(pose: Pose2D, target: tuple[float, float, float]) -> tuple[float, float]:
    dx, dy = target[0] - pose.x, target[1] - pose.y
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return c * dx + s * dy, c * dy - s * dx
