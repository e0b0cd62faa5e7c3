"""follow: a timed trajectory or a path, with a tracking controller."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.base import Motion, braking_speed, turning
from navstack.behaviors.errors import InvalidMotionError, TrackingLostError
from navstack.behaviors.timing import MotionLimits, fitted, from_path, require_feasible
from navstack.behaviors.trajectory import Trajectory
from navstack.core import Path, Pose2D, RobotState, Transform2D, angle_between, normalize_angle
from navstack.parameters import MotionParams
from navstack.plugins import BehaviorContext, BehaviorStep

# --- tracking controllers ---------------------------------------------------------------------------------------------
#
# Tracking controllers of a base that cannot move sideways: from the error to the reference to a velocity.
#
# The error (x, y, yaw) is the reference pose in the robot's frame: x along, y to the left.
#
# - `kanayama`: v = vr cos yaw + k_x x, w = wr + vr (k_y y + k_theta sin yaw). Kanayama, Kimura, Miyazaki, Noguchi, A stable
#   tracking control method for an autonomous mobile robot, ICRA 1990.
# - `samson`: v = vr cos yaw + k1 x, w = wr + b vr sinc(yaw) y + k1 yaw with k1 = 2 damping sqrt(wr² + b vr²), b the stiffness.
#   Samson, Time-varying feedback stabilization of car-like wheeled mobile robots, 1993, with the gains of De Luca, Oriolo,
#   Vendittelli, Control of wheeled mobile robots: an experimental overview, 2001.
#
# Kanayama's is the default: on curves driven at 0.4 m/s by a base with a lag of 0.1 s its errors are smaller (its gain along the
# path does not fall with the speed), with slip and noise they are the same (docs/tutorials/motions.md has the figures). Both have
# the same damping at every speed, k_theta / (2 sqrt(k_y)) and `damping`. Samson's corrects the heading also on a turn without
# speed, and converges from a heading error of pi, where Kanayama's sine is 0.


class TrackingError(NamedTuple):
    """The reference in the robot's frame."""

    x: float
    """m ahead."""
    y: float
    """m to the left."""
    yaw: float
    """rad."""

    @property
    def distance(self) -> float:
        """Distance to the reference (m)."""
        return math.hypot(self.x, self.y)


def tracking_error(pose: Pose2D, reference: Pose2D) -> TrackingError:
    """Return the error of a robot at `pose`; both in one frame."""
    dx, dy = reference.x - pose.x, reference.y - pose.y
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return TrackingError(c * dx + s * dy, c * dy - s * dx, normalize_angle(reference.yaw - pose.yaw))


def track(error: TrackingError, speed: float, turn_rate: float, params: MotionParams) -> tuple[float, float]:
    """Return the speed (m/s) and turn rate (rad/s) for an error and the reference's own speed and turn rate.

    A negative speed drives backwards; the reference's heading is always that of the robot's front.
    """
    if params.tracking == "kanayama":
        v = speed * math.cos(error.yaw) + params.k_x * error.x
        # driving backwards, the sign of the heading's gain changes with the direction
        w = turn_rate + speed * params.k_y * error.y + abs(speed) * params.k_theta * math.sin(error.yaw)
        return v, w
    gain = 2.0 * params.damping * math.sqrt(turn_rate * turn_rate + params.stiffness * speed * speed)
    sinc = math.sin(error.yaw) / error.yaw if abs(error.yaw) > 1e-6 else 1.0
    return (
        speed * math.cos(error.yaw) + gain * error.x,
        turn_rate + params.stiffness * speed * sinc * error.y + gain * error.yaw,
    )


def steering_to_line(on_line: Pose2D, speed: float, max_turn_rate: float, params: MotionParams) -> float:
    """Return the turn rate (rad/s) that keeps a robot at `on_line` (line's frame) on the line, at `speed` (m/s)."""
    # the reference is the point of the line next to the robot
    error = TrackingError(0.0, -on_line.y * math.cos(on_line.yaw), -on_line.yaw)
    _, rate = track(error, speed, 0.0, params)
    return min(max(rate, -max_turn_rate), max_turn_rate)


# --- the motions ------------------------------------------------------------------------------------------------------

SETTLE_S: Final = 2.0
"""Time after the end of a trajectory in which the robot comes to rest (s)."""
DEFAULT_ACCELERATION: Final = 1.0
"""For a robot without a limit of acceleration (m/s², rad/s²)."""


class FollowTrajectory(Motion):
    """Follows a timed trajectory. The robot first turns to its initial heading; then the clock of the trajectory starts.

    The trajectory is in the frame `measured_in`, or with `here` moved so that it begins at the robot. The reference of a cycle is
    that of its middle: a command is held for the cycle.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        params: MotionParams | None = None,
        name: str = "follow",
        *,
        here: bool = False,
        measured_in: str = "map",
        check_feasibility: bool = True,
        fit: bool = False,
    ) -> None:
        """`fit`: stretch its time, from rest to rest, to what the robot can do; see `fitted`."""
        super().__init__(name, params)
        self.trajectory = trajectory
        """As given; after the first step in the motion's frame."""
        self.measured_in, self.here, self.check_feasibility = measured_in, here, check_feasibility
        self.fit = fit
        self.errors: list[tuple[float, TrackingError]] = []
        """Time on the trajectory's clock (s) and error of each cycle, as the robot knows it."""
        self._given = self._original = trajectory
        self._clock: float | None = None
        self._now = 0.0

    def describe(self) -> dict[str, Any]:
        """Return the trajectory in the frame in which it is followed."""
        return {"follow": self.trajectory.name or "trajectory", "trajectory": self.trajectory.as_dict()}

    @property
    def clock(self) -> float | None:
        """Time at which the trajectory's clock started (s); None before."""
        return self._clock

    @property
    def limits(self) -> MotionLimits:
        """Speeds and accelerations."""
        limits = super().limits
        fastest = min(limits.max_speed, self.params.follow_speed or math.inf)
        return replace(limits, max_speed=fastest)

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the pose of the first step. Raises InfeasibleTrajectoryError for a trajectory the robot cannot follow."""
        super().start(context, now)
        if self.fit:
            self._given = fitted(self._original, _finite(self.limits))
        self.trajectory, self._clock, self.errors = self._given, None, []
        if self.check_feasibility:
            require_feasible(self._given, self.limits)

    def prepare(self, pose: Pose2D, state: RobotState) -> float:
        """Place the trajectory. Raises InvalidMotionError if it begins too far away, or aside of a car."""
        del state
        if self.here:
            self.trajectory = self._given.moved_to(pose, self.frame)
        else:
            self.trajectory = replace(self._given, frame=self.frame)
        away = pose.distance_to(self.trajectory.start)
        if away > self.params.max_tracking_error:
            x, y, yaw = self.trajectory.start
            raise InvalidMotionError(
                f"{self.name}: the trajectory begins at ({x:.2f}, {y:.2f}, {yaw:.2f}) in {self.frame}, {away:.2f} m from the "
                f"robot; drive there first, or begin it at the robot",
                distance_m=away,
            )
        self.target = self.trajectory.end
        count = max(2, math.ceil(self.trajectory.length / 0.05))
        times = np.linspace(0.0, self.trajectory.duration, count)
        self.reference = Path(self.trajectory.poses(times), self.frame)
        limits = self.limits
        aside = abs(angle_between(pose.yaw, self.trajectory.start.yaw))
        if aside > self.params.tolerance_radian:
            self.require_turning(
                f"{self.name}, which begins {math.degrees(aside):.1f} degrees from the robot's heading"
            )
        turn = aside / min(self.params.speed_radian, limits.max_turn_rate)
        return turn + self.trajectory.duration + SETTLE_S

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step."""
        self._now = now
        if self._clock is None:
            step = self._align(pose, state)
            if step is not None:
                return step
            self._clock = now
        t = now - self._clock
        end = self.trajectory.duration
        error = tracking_error(pose, self.trajectory.at(t).pose)
        self.errors.append((t, error))
        data = {
            "clock_s": self._clock,
            "time_s": t,
            "left_s": max(end - t, 0.0),
            "error_m": error.distance,
            "error_rad": error.yaw,
        }
        if error.distance > self.params.max_tracking_error:
            raise TrackingLostError(
                f"{self.name} is {error.distance:.2f} m from the trajectory after {t:.1f} of {end:.1f} s, more than "
                f"max_tracking_error, {self.params.max_tracking_error:g} m",
                **data,
            )
        if t >= end and (self.is_standing(state) or t >= end + SETTLE_S):
            return self.done(data | self.error_summary())
        reference = (
            self.trajectory.at(t + 0.5 * self.dt) if t + 0.5 * self.dt < end else self.trajectory.at(end + self.dt)
        )
        speed, rate = track(error, reference.speed, reference.turn_rate, self.params)
        note = (
            f"{t:.2f} of {end:.2f} s: reference {reference.speed:.3f} m/s, {reference.turn_rate:.3f} rad/s; error "
            f"{error.x:+.3f} m along, {error.y:+.3f} m across, {math.degrees(error.yaw):+.1f} degrees"
        )
        return self.running(*self._saturated(speed, rate), data, note)

    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return the trajectory from the current time on, seen from the robot."""
        trajectory, costmap = self.trajectory, self.context.local_costmap
        if self._clock is None and not whole:
            left = angle_between(pose.yaw, trajectory.start.yaw)
            reach = min(abs(left), self.params.speed_radian * self.params.simulate_ahead_time)
            return turning(math.copysign(reach, left))
        first = 0.0 if self._clock is None else now - self._clock
        last = trajectory.duration if whole else min(first + self.params.simulate_ahead_time, trajectory.duration)
        step = 0.5 * costmap.master.geometry.resolution
        # a bound of the way of the corners, to the samples: the heading may turn fast where the robot is slow
        ways = np.hypot(*np.diff(trajectory.position[:, :2], axis=0).T)
        ways += costmap.footprint.circumscribed_radius * np.abs(np.diff(trajectory.yaw))
        passed = np.concatenate((np.zeros(1), np.cumsum(ways)))
        begin, end = np.interp((first, max(last, first)), trajectory.t, passed).tolist()
        count = max(2, math.ceil((end - begin) / step) + 1)
        poses = trajectory.poses(np.interp(np.linspace(begin, end, count), passed, trajectory.t))
        seen = Transform2D(*pose).inverse().apply_poses(poses)
        return np.concatenate((np.zeros((1, 3)), seen))

    def error_summary(self) -> dict[str, float]:
        """Return mean and largest distance from the trajectory (m), as the robot knows it."""
        distances = [error.distance for _, error in self.errors] or [0.0]
        return {"error_mean_m": float(np.mean(distances)), "error_max_m": max(distances)}

    def summary(self) -> str:
        """Return the time followed and the errors."""
        t = 0.0 if self._clock is None else min(self._now - self._clock, self.trajectory.duration)
        found = self.error_summary()
        return (
            f"{self.name}: followed {self._given.name or 'the trajectory'} for {t:.1f} of {self._given.duration:.1f} s, mean "
            f"error {100.0 * found['error_mean_m']:.2f} cm, largest {100.0 * found['error_max_m']:.2f} cm"
        )

    def _align(self, pose: Pose2D, state: RobotState) -> BehaviorStep | None:
        """Return a step of the turn to the initial heading; None at its end."""
        limits, p = self.limits, self.params
        left = angle_between(pose.yaw, self.trajectory.start.yaw)
        if abs(left) <= p.tolerance_radian and self.is_standing(state):
            return None
        fastest = min(p.speed_radian, limits.max_turn_rate, 0.5 * math.pi * p.frequency)
        rate = min(fastest, braking_speed(abs(left), limits.max_turn_acceleration, self.dt))
        if abs(left) <= p.tolerance_radian:
            rate = 0.0
        note = f"turning to the initial heading, {math.degrees(left):.1f} degrees left"
        return self.running(0.0, math.copysign(rate, left), {"left_s": self.trajectory.duration}, note)

    def _saturated(self, speed: float, rate: float) -> tuple[float, float]:
        """Return speed and turn rate within the limits; one factor keeps the curvature."""
        limits = self.limits
        over = max(abs(speed) / limits.max_speed, abs(rate) / limits.max_turn_rate, 1.0)
        return speed / over, rate / over


class FollowPath(FollowTrajectory):
    """Follows a path without times: it is smoothed and timed within the robot's limits, then followed."""

    def __init__(
        self,
        path: Path,
        params: MotionParams | None = None,
        name: str = "follow_path",
        *,
        here: bool = False,
        measured_in: str = "map",
        smoothing_m: float = 0.05,
    ) -> None:
        """`path` in the frame `measured_in`; `smoothing_m` as in `from_path`. Raises InvalidTrajectoryError."""
        self._path, self._smoothing = path, smoothing_m
        slow = MotionLimits(0.1, 1.0, DEFAULT_ACCELERATION, DEFAULT_ACCELERATION)
        trajectory = from_path(path, slow, smoothing_m=smoothing_m)  # checks the path; timed again at the start
        super().__init__(trajectory, params, name, here=here, measured_in=measured_in, check_feasibility=False)

    def start(self, context: BehaviorContext, now: float) -> None:
        """Time the path within the limits of the robot. Raises InfeasibleTrajectoryError."""
        self._context = context
        self._given = from_path(self._path, _finite(self.limits), smoothing_m=self._smoothing, name=self.name)
        super().start(context, now)


def _finite(limits: MotionLimits) -> MotionLimits:
    """Return limits with finite accelerations."""
    return replace(
        limits,
        max_acceleration=min(limits.max_acceleration, DEFAULT_ACCELERATION),
        max_turn_acceleration=min(limits.max_turn_acceleration, 2.0 * DEFAULT_ACCELERATION),
    )
