"""Regulated pure pursuit: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController.

S. Macenski et al., "Regulated Pure Pursuit for Robot Path Tracking", 2023. The robot drives the arc through a point of the path
ahead of it, the carrot: slower in curves, near obstacles and near the goal. It turns in place if the carrot is far off its
heading, and at the goal.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from navstack.core import Path, Pose2D, Twist2D, angle_between, normalize_angle
from navstack.core.errors import NoValidControlError
from navstack.core.overlap import is_nearly_round, leads_away, without_lethal
from navstack.core.parameters import ParamModel
from navstack.interfaces import ControlInput, LocalPlan, VelocityLimits
from navstack.local_planner import _carrot_kernels as kernels
from navstack.local_planner.path_follower import Following, PathFollower, check_speed
from navstack.local_planner.regulated_pure_pursuit import regulation
from navstack.local_planner.regulated_pure_pursuit.arc_check import (
    ArcCheck,
    Scene,
    extent_of_check,
    free_arc,
    nearest_free_heading,
)
from navstack.local_planner.regulated_pure_pursuit.params import RegulatedPurePursuitParams
from navstack.local_planner.regulated_pure_pursuit.speed import regulated_speed
from navstack.local_planner.turning import limited_turning_speed, turning_speed
from navstack.plugins import LOCAL_PLANNERS

NEARER = (0.75, 0.5, 0.25)
"""Shares of the lookahead that are tried if the arc to the carrot collides."""


class _Carrot(NamedTuple):
    """A point of the path in the robot's frame (m)."""

    x: float
    y: float

    @property
    def distance(self) -> float:
        return math.hypot(self.x, self.y)


class _Aim(NamedTuple):
    """Where to steer to."""

    ahead: _Carrot
    """Its side is the direction of driving; the check for collisions ends there."""
    steer: _Carrot
    """Gives the curvature."""
    sign: float
    """1 forward, -1 backward."""


_Found: TypeAlias = tuple[Twist2D, Any, list[str]]
"""A command, the poses on its way, and what limits it."""


@LOCAL_PLANNERS.register(
    "regulated_pure_pursuit", aliases=("nav2_regulated_pure_pursuit_controller/RegulatedPurePursuitController",)
)
class RegulatedPurePursuit(PathFollower):
    """Follows a path by regulated pure pursuit.

    State between cycles: the plan, the goal checker, the last command. With `as_nav2`, the deliberate differences from Nav2 are
    off (parity page).
    """

    Params: ClassVar[type[ParamModel]] = RegulatedPurePursuitParams
    params: Any

    def __init__(self, params: RegulatedPurePursuitParams, *, as_nav2: bool = False) -> None:
        super().__init__(params)
        self.as_nav2 = as_nav2
        self.carrot: tuple[float, float] | None = None
        """The point last steered to, in the robot's frame (m)."""
        self._last: Twist2D | None = None
        self._away = False
        """True while the robot turns to a heading from which its arc is free."""
        self._check_arc = ArcCheck()
        self._point = np.empty(3)
        self.set_limits()

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        p = self.params
        return VelocityLimits(
            max_vel_x=self._v_max,
            min_vel_x=min(max(p.lowest_speed, -self._v_max), 0.0) if self._reverses else 0.0,
            max_vel_y=0.0,
            min_vel_y=0.0,
            max_vel_trans=self._v_max,
            min_vel_trans=0.0,
            max_vel_theta=max(self._w_max, -self._w_min, self._turn_max),
            min_vel_theta=0.0,
            acc_lim_x=min(p.max_linear_accel, -p.max_linear_decel),
            acc_lim_y=0.0,
            acc_lim_theta=min(p.max_angular_accel, -p.max_angular_decel),
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
            min_turning_radius=p.min_turning_r,
        )

    @property
    def _reverses(self) -> bool:
        # ROS differs: in Nav2, use_rotate_to_heading does not keep it from reversing
        return self.params.allow_reversing and (self.as_nav2 or not self.params.use_rotate_to_heading)

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        p = self.params
        turning = math.inf if max_vel_theta is None else max_vel_theta
        self._v_max = p.max_linear_vel if max_vel_trans is None else min(p.max_linear_vel, max_vel_trans)
        self._w_max, self._w_min = min(p.max_angular_vel, turning), max(p.min_angular_vel, -turning)
        self._turn_max = min(p.rotate_to_heading_angular_vel, turning)

    # --- the command ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Reset the previous goal and the last command."""
        super().reset()
        self._last, self._away = None, False

    def arrived(self) -> None:
        """Start the next goal from rest."""
        self._last = Twist2D()

    def take_over(self, velocity: Twist2D) -> None:
        """Accelerate from there."""
        self._last = velocity

    def follow(self, now: Following) -> LocalPlan:
        """Steer to the carrot, or turn in place. Raises NoValidControlError if the motion collides."""
        if self._last is None:
            self._last = Twist2D() if self.as_nav2 else now.state.velocity
        aim = self._aim(now, 1.0)
        if aim.sign < 0.0 and self.params.lowest_speed >= 0.0 and not self.as_nav2:
            # ROS differs: Nav2 commands zero, and the robot stands still without a reason
            raise NoValidControlError(
                f"the path is behind the robot, and min_linear_vel = {self.params.min_linear_vel:g} m/s allows no backward "
                "speed; set it below 0, or allow_reversing to false",
                carrot=[aim.ahead.x, aim.ahead.y],
            )
        turn, mode, notes = self._turn(now, aim)
        found = self._turn_away(now, aim) if self._away and turn is None else None
        if found is None:
            if turn is not None:
                command = self._turning_command(turn, now.state.velocity.wz)
            else:
                command, notes = self._arc(now, aim)
            try:
                found = command, self._check(now, command, aim.ahead, notes), notes
            except NoValidControlError:
                found = self._turn_away(now, aim) or self._to_nearer_carrot(now)
                if found is None:
                    # ROS differs: the robot is stopped now, and Nav2 goes on from its last command
                    self._last = self._last if self.as_nav2 else None
                    raise
        command, trajectory, notes = found
        self._last = command
        return LocalPlan(
            command,
            mode,
            trajectory=trajectory,
            local_plan=Path(now.path.poses, now.costmap.frame),
            notes=tuple(notes),
        )

    def brake(self, inputs: ControlInput) -> LocalPlan | None:
        """Brake on the arc of the last command, with `use_cancel_deceleration`; None at rest, and before an obstacle.

        ROS differs: Nav2 brakes from the measured speed, and not before a turn in place has ended.
        """
        p, last = self.params, self._last
        if not p.use_cancel_deceleration or last is None:
            return None
        v = regulation.towards_zero(last.vx, p.cancel_deceleration * self.period)
        if last.vx != 0.0:
            command = Twist2D(v, 0.0, last.wz * v / last.vx)
        else:
            command = Twist2D(0.0, 0.0, regulation.towards_zero(last.wz, -p.max_angular_decel * self.period))
        if command == Twist2D():
            self._last = command
            return None
        hit, poses = self._collision(Scene.of(inputs), command, abs(command.vx) / p.cancel_deceleration, math.inf)
        if hit >= 0:
            return None
        self._last = command
        note = f"the goal is canceled: braking with {p.cancel_deceleration:g} m/s²"
        return LocalPlan(command, "brake", trajectory=poses, notes=(note,))

    def _lookahead(self, now: Following) -> float:
        p = self.params
        if not p.use_velocity_scaled_lookahead_dist:
            return p.lookahead_dist
        return min(max(abs(now.state.velocity.vx) * p.lookahead_time, p.min_lookahead_dist), p.max_lookahead_dist)

    def _aim(self, now: Following, share: float) -> _Aim:
        """Where to steer to, with a share of the lookahead."""
        p = self.params
        ahead = steer = self._carrot(now, share * self._lookahead(now), beyond=False)
        if p.use_fixed_curvature_lookahead:
            beyond = p.interpolate_curvature_after_goal and (len(now.path.poses) > 1 or self.as_nav2)
            steer = self._carrot(now, share * p.curvature_lookahead_dist, beyond=beyond)
        self.carrot = (steer.x, steer.y)
        return _Aim(ahead, steer, -1.0 if self._reverses and ahead.x < 0.0 else 1.0)

    def _carrot(self, now: Following, distance: float, *, beyond: bool) -> _Carrot:
        pose, poses = now.state.pose, now.path.poses
        # ROS differs: Nav2 counts from the first pose of the local path, not from the robot
        passed = 0.0 if self.as_nav2 else kernels.passed_length(poses, float(pose.x), float(pose.y), -distance)
        kernels.point_ahead(poses, float(distance + passed), beyond, self._point)
        dx, dy = float(self._point[0]) - pose.x, float(self._point[1]) - pose.y
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        return _Carrot(c * dx + s * dy, c * dy - s * dx)

    # --- turning in place -------------------------------------------------------------------------------------------

    def _turn(self, now: Following, aim: _Aim) -> tuple[float | None, str, list[str]]:
        """The angle (rad) to turn in place by, None to drive; mode and reason."""
        p = self.params
        if not p.use_rotate_to_heading:
            return None, "follow", []
        if now.at_position:
            error = angle_between(now.state.pose.yaw, float(now.path.poses[-1, 2]))
            return (
                error,
                "rotate_to_goal",
                [f"at the goal's position, {error:+.2f} rad to its heading: turning in place"],
            )
        steer = aim.steer
        error = math.atan2(steer.y, steer.x)
        if aim.sign < 0.0:
            error = normalize_angle(error + math.pi)
        if abs(error) <= p.rotate_to_heading_min_angle:
            return None, "follow", []
        reason = (
            f"the carrot, {steer.distance:.2f} m ahead, is {error:+.2f} rad off the heading, more than "
            f"rotate_to_heading_min_angle {p.rotate_to_heading_min_angle:g}: turning in place"
        )
        return error, "follow", [reason]

    def _turning_command(self, error: float, measured: float) -> Twist2D:
        p = self.params
        assert self._last is not None
        if self.as_nav2:
            return Twist2D(0.0, 0.0, turning_speed(error, self._turn_max, p.max_angular_accel, measured, self.period))
        # ROS differs: from the last command, so that the acceleration holds from command to command
        speed = limited_turning_speed(error, self._turn_max, p.max_angular_accel, self._last.wz, self.period)
        if not p.use_dynamic_window:
            return Twist2D(0.0, 0.0, speed)
        # ROS differs: brakes first, where Nav2 stops at once
        slower = -p.max_linear_decel * self.period
        return Twist2D(math.copysign(max(abs(self._last.vx) - slower, 0.0), self._last.vx), 0.0, speed)

    # --- driving an arc ---------------------------------------------------------------------------------------------

    def _arc(self, now: Following, aim: _Aim, top: float = math.inf) -> tuple[Twist2D, list[str]]:
        """The command on the arc to the carrot, at most with the speed `top` (m/s), and what limits it."""
        p, sign = self.params, aim.sign
        curvature = regulation.curvature_to(aim.steer.x, aim.steer.y)
        notes: list[str] = []
        if p.min_turning_r > 0.0 and abs(curvature) * p.min_turning_r > 1.0:
            notes.append(f"the arc to the carrot has a radius of {1.0 / abs(curvature):.2f} m, under min_turning_r")
            curvature = math.copysign(1.0 / p.min_turning_r, curvature)
        speed = sign * min(regulated_speed(p, now, self._v_max, curvature, notes, as_nav2=self.as_nav2), top)
        if p.use_dynamic_window:
            return self._windowed(speed, curvature, sign, notes), notes
        turning = speed * curvature
        if not self.as_nav2 and not self._w_min <= turning <= self._w_max:
            # ROS differs: Nav2 does not limit the turning speed here
            bound = self._w_max if turning > 0.0 else self._w_min
            notes.append(f"slowed to {bound / curvature:.2f} m/s by the turning speed {bound:g} rad/s")
            speed, turning = (bound / curvature, bound) if bound != 0.0 else (0.0, 0.0)
        return Twist2D(speed, 0.0, turning), notes

    def _windowed(self, speed: float, curvature: float, sign: float, notes: list[str]) -> Twist2D:
        """The command within one period's acceleration of the last one that is nearest to the arc."""
        p = self.params
        assert self._last is not None
        period = self.period
        limits = regulation.WindowLimits(
            max(p.min_linear_vel, -self._v_max),
            self._v_max,
            self._w_min,
            self._w_max,
            p.max_linear_accel * period,
            -p.max_linear_decel * period,
            p.max_angular_accel * period,
            -p.max_angular_decel * period,
        )
        window = regulation.dynamic_window(self._last.vx, self._last.wz, speed, limits, sign)
        v, w = regulation.nearest_to_arc(window, curvature, sign)
        if p.min_turning_r > 0.0:
            v, w = regulation.held_to_radius(v, w, self._last.vx, window, p.min_turning_r)
        if abs(v - speed) > 1e-9 or abs(w - speed * curvature) > 1e-9:
            notes.append(
                f"the accelerations allow {window.v_min:.2f} .. {window.v_max:.2f} m/s and {window.w_min:.2f} .. "
                f"{window.w_max:.2f} rad/s now"
            )
        return Twist2D(v, 0.0, w)

    def _turn_away(self, now: Following, aim: _Aim) -> _Found | None:
        """A turn in place to the nearest heading from which the arc to the carrot is free; None without one.

        Once begun, it ends where the arc is free up to the carrot. A driving robot stops first. ROS differs: Nav2 stops.
        """
        p, begun = self.params, self._away
        self._away = False
        drives = abs(now.state.velocity.vx) > p.max_linear_accel * self.period + 1e-9
        if self.as_nav2 or drives or not (p.use_rotate_to_heading or self.may_turn):
            return None
        scene, reach = Scene.of(now), aim.ahead.distance
        if begun and free_arc(self._check_arc, scene, aim.steer, reach) is not None:
            return None
        turned = nearest_free_heading(self._check_arc, scene, aim.steer, reach, p.rotate_to_heading_min_angle)
        if turned is None:
            return None
        command = self._turning_command(turned, now.state.velocity.wz)
        notes = [f"the arc to the carrot collides: turning by {turned:+.2f} rad, to where it is free"]
        try:
            trajectory = self._check(now, command, aim.ahead, notes)
        except NoValidControlError:
            return None
        self._away = True
        return command, trajectory, notes

    def _to_nearer_carrot(self, now: Following) -> _Found | None:
        """The command to the farthest nearer carrot whose arc is free; None without one.

        The plan is free along the path, the arc to the carrot cuts its corners. A base with a turning radius cannot turn in
        place to wait for another plan, so it keeps closer to the path, and slower: it reaches the carrot at the end of the check.
        ROS differs: Nav2 stops.
        """
        p = self.params
        duration = p.max_allowed_time_to_collision_up_to_carrot
        if self.as_nav2 or p.turning_radius == 0.0 or duration == 0.0:
            return None
        scene, carrot = Scene.of(now), self.carrot
        for share in NEARER:
            aim = self._aim(now, share)
            command, notes = self._arc(now, aim, aim.steer.distance / duration)
            hit, poses = self._collision(scene, command, duration, math.inf)
            if hit < 0:
                notes.append(f"the arc to the carrot collides: steering to one {aim.steer.distance:.2f} m ahead")
                return command, poses, notes
        self.carrot = carrot
        return None

    # --- collisions -------------------------------------------------------------------------------------------------

    def _check(self, now: Following, command: Twist2D, ahead: _Carrot, notes: list[str]) -> Any:
        """The poses (n, 3) on the way of the command; raises NoValidControlError if one collides."""
        p = self.params
        if not p.use_collision_detection:
            return None
        scene = Scene.of(now)
        pose = scene.pose
        extent = extent_of_check(p, now, command, ahead.distance)
        hit, poses = self._collision(scene, command, *extent)
        if hit < 0:
            return poses
        if hit > 0 and command.vx == 0.0 and is_nearly_round(now.footprint) and not self.as_nav2:
            return poses[
                :hit
            ]  # ROS differs: in Nav2 the corners of its polygon keep a round robot from turning in place
        if hit == 0 and not self.as_nav2:
            # ROS differs: in Nav2 a robot that overlaps an obstacle never leaves it
            free = scene._replace(costmap=without_lethal(scene.costmap))
            blocked, way = self._collision(free, command, *extent)
            if blocked < 0 and leads_away(scene.costmap, scene.footprint, way):
                notes.append("the footprint overlaps an obstacle; the command leads away from it")
                return way
        at = Pose2D(*poses[hit].tolist())
        where = "where it stands" if hit == 0 else f"after {pose.distance_to(at):.2f} m"
        plan = LocalPlan(Twist2D(), local_plan=Path(now.path.poses, now.costmap.frame), notes=tuple(notes))
        raise NoValidControlError(
            f"the robot would collide {where}, at ({at.x:.2f}, {at.y:.2f}), with the command vx {command.vx:.2f}, wz "
            f"{command.wz:.2f}; the path is blocked or too close to an obstacle there",
            at=list(at),
            command=list(command),
            plan=plan,
        )

    def _collision(
        self, scene: Scene, command: Twist2D, duration: float, reach: float
    ) -> tuple[int, NDArray[np.float64]]:
        return self._check_arc.first_collision(scene, command, duration, reach, as_nav2=self.as_nav2)
