"""What all motions share: frames, limits, time limit, collision checks and the last command."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Path, Pose2D, RobotState, Transform2D, Twist2D
from navstack.core.errors import NavError
from navstack.core.parameters import ParamModel
from navstack.interfaces import LocalPlan, Motion, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.kinematics import WheelDrive
from navstack.motion.errors import InvalidMotionError, MotionCollisionError, MotionTimeoutError
from navstack.motion.obstacles import Obstacle, first_obstacle
from navstack.motion.ramp import Ramp
from navstack.motion.timing import MotionLimits
from navstack.parameters.models.motion import MotionParams

LINE_STEP_M = 0.05
STOPPED = 0.01
"""Below this velocity the robot counts as standing (m/s, rad/s)."""


class BasicMotion(Motion):
    """A motion of a base that drives along its heading. A subclass implements `begin` and `command`.

    Before each command the footprint is checked along the way that the robot covers within `simulate_ahead_time`, before the
    first one along the whole way on the global costmap. Before an obstacle the robot brakes within its acceleration limits, at
    once if it is closer than that, and the motion fails.
    """

    Params: ClassVar[type[ParamModel]] = MotionParams
    params: MotionParams

    def __init__(self, name: str, params: MotionParams) -> None:
        super().__init__(name, params)
        self.measured_in = params.frame
        """`odom` or `map`: the frame in which poses are measured."""
        self.min_turning_radius = 0.0
        """m; 0 for a base that can turn in place."""
        self.drive: WheelDrive | None = None
        """The wheels, if their speed is limited."""
        self.max_wheel_speed = math.inf
        """m/s at the rim."""
        self._context: RecoveryContext | None = None
        self._ramp = Ramp(math.inf, math.inf)
        self._started_at = 0.0
        self._last_step = -math.inf
        self._allowance = math.inf
        self._is_begun = False
        self._failure: NavError | None = None
        self._data: dict[str, Any] = {}

    # --- for subclasses -----------------------------------------------------------------------------------------------

    @abstractmethod
    def begin(self, pose: Pose2D, state: RobotState) -> float:
        """Prepare the motion from `pose` (its own frame); return its expected time (s). May raise a NavError."""

    @abstractmethod
    def command(self, pose: Pose2D, state: RobotState, now: float, dt: float) -> RecoveryStep:
        """Return the next step from `pose` (its own frame), before the collision check; `dt` (s) is the cycle."""

    @abstractmethod
    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return poses (n, 3) in the base frame, from here on: within `simulate_ahead_time`, or the `whole` rest."""

    def summary(self) -> str:
        """Return what the robot has done so far, for messages."""
        return self.name

    # --- a recovery behavior ------------------------------------------------------------------------------------------

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.frequency

    @property
    def context(self) -> RecoveryContext:
        """Costmaps and local planner."""
        assert self._context is not None
        return self._context

    @property
    def limits(self) -> MotionLimits:
        """Speeds and accelerations: those of the local planner and of the parameters."""
        limits, p = self.context.local_planner.limits, self.params
        return MotionLimits(
            limits.max_vel_trans,
            limits.max_vel_theta,
            min(_limit(limits.acc_lim_x), p.acc_lim_x or math.inf),
            min(_limit(limits.acc_lim_theta), p.acc_lim_theta or math.inf),
            max(self.min_turning_radius, limits.min_turning_radius),
            self.drive,
            self.max_wheel_speed,
        )

    def require_turning(self, what: str) -> None:
        """Raise InvalidMotionError if the base has a turning radius, for `what` turns in place."""
        radius = self.limits.min_turning_radius
        if radius > 0.0:
            raise InvalidMotionError(
                f"{what}: a base with a turning radius of {radius:.2f} m cannot turn in place; send a goal instead",
                min_turning_radius_m=radius,
            )

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start from the pose of the first step."""
        self._context = context
        limits = self.limits
        self._ramp = Ramp(limits.max_acceleration, limits.max_turn_acceleration)
        self._started_at, self._last_step = now, -math.inf
        self._is_begun, self._failure, self._data = False, None, {}
        self.target = self.reference = self.local_plan = None
        self.frame = context.local_costmap.frame if self.measured_in == "odom" else context.global_costmap.frame

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return the next command. Raises the errors of the motion."""
        pose = state.pose if self.measured_in == "odom" else self.context.global_costmap.robot_pose(now)
        period = 1.0 / self.params.frequency
        dt = min(now - self._last_step, 2.0 * period) if math.isfinite(self._last_step) else period
        self._last_step = now
        first = not self._is_begun
        if first:
            self._ramp.begin(state)
            expected = self.begin(pose, state)
            self._allowance = self.params.time_allowance or 2.0 * expected + 5.0
            self._is_begun = True
            self._check_known(pose, state, now)
        if self._failure is not None:
            return self._brake(state, dt)
        before = self._ramp.last
        step = self.command(pose, state, now, dt)
        if step.status is not RecoveryStatus.RUNNING:
            return step
        if now - self._started_at > self._allowance:
            raise MotionTimeoutError(
                f"{self.summary()} within its time allowance of {self._allowance:.1f} s", **step.data
            )
        notes: tuple[str, ...] = tuple(step.data.pop("notes", ()))
        self._data = step.data
        poses = self.ahead(pose, now, whole=False)
        obstacle = None
        if not self.params.disable_collision_checks:
            obstacle = first_obstacle(self.context, state.pose, now, poses)
        if obstacle is not None:
            self._failure = self._collision(obstacle, poses, step.data)
            self._ramp.last = before  # the command of this step is not sent
            if obstacle.index <= self._stopping_index(poses, dt):
                raise self._failure
            return self._brake(state, dt)
        self.local_plan = LocalPlan(
            step.twist, self.name, trajectory=Transform2D(*state.pose).apply_poses(poses), notes=notes
        )
        return step

    # --- obstacles ----------------------------------------------------------------------------------------------------

    def _check_known(self, pose: Pose2D, state: RobotState, now: float) -> None:
        """Raise MotionCollisionError for an obstacle of the global costmap on the whole way."""
        if self.params.disable_collision_checks:
            return
        poses = self.ahead(pose, now, whole=True)
        obstacle = first_obstacle(self.context, state.pose, now, poses, known_only=True)
        if obstacle is not None:
            raise self._collision(obstacle, poses, {}, begun=False)

    def _collision(
        self, obstacle: Obstacle, poses: NDArray[np.float64], data: dict[str, Any], *, begun: bool = True
    ) -> MotionCollisionError:
        until = poses[: obstacle.index + 1]
        metres = float(np.hypot(*np.diff(until[:, :2], axis=0).T).sum())
        turned = float(np.abs(np.diff(until[:, 2])).sum())
        after = f"{metres:.2f} m" if metres > 0.0 or turned == 0.0 else f"{math.degrees(turned):.0f} degrees"
        what = f"{self.summary()} and stopped" if begun else f"{self.name} did not start"
        return MotionCollisionError(
            f"{what}: the footprint hits {obstacle} after another {after}",
            cost=obstacle.cost,
            costmap=obstacle.costmap,
            collision_after_m=metres,
            collision_after_rad=turned,
            **{key: value for key, value in data.items() if key != "notes"},
        )

    def _stopping_index(self, poses: NDArray[np.float64], dt: float) -> int:
        """Return the index of the pose at which the robot stands if it brakes now."""
        ramp = self._ramp
        last, time = ramp.last, ramp.stopping_time() + 2.0 * dt
        size = np.hypot(*np.diff(poses[:, :2], axis=0).T).cumsum()
        turn = np.abs(np.diff(poses[:, 2])).cumsum()
        beyond = (size > 0.5 * abs(last.vx) * time) | (turn > 0.5 * abs(last.wz) * time)
        return int(np.argmax(beyond)) + 1 if beyond.any() else len(poses)

    def _brake(self, state: RobotState, dt: float) -> RecoveryStep:
        """Return a step of braking. Raises the failure once the robot stands."""
        assert self._failure is not None
        if self._ramp.last.vx == 0.0 and self._ramp.last.wz == 0.0:
            raise self._failure
        twist = self._ramp.braked(dt)
        self.local_plan = LocalPlan(twist, self.name, notes=(f"braking: {self._failure.message}",))
        return RecoveryStep(RecoveryStatus.RUNNING, twist, data=dict(self._data))

    # --- results ------------------------------------------------------------------------------------------------------

    def running(self, twist: Twist2D, data: dict[str, Any], *notes: str) -> RecoveryStep:
        """Return a step with a command, data, and sentences about its reasons."""
        return RecoveryStep(RecoveryStatus.RUNNING, twist, data={**data, "notes": notes})

    def done(self, data: dict[str, Any]) -> RecoveryStep:
        """Return the last step."""
        return RecoveryStep(RecoveryStatus.DONE, text=self.summary(), data=data)

    def is_standing(self, state: RobotState) -> bool:
        """Return True if the robot stands."""
        return abs(state.velocity.vx) <= STOPPED and abs(state.velocity.wz) <= STOPPED

    def line(self, start: Pose2D, end: Pose2D) -> Path:
        """Return a straight path in the motion's frame, with a pose every LINE_STEP_M; the last one has the heading of `end`."""
        count = max(2, math.ceil(start.distance_to(end) / LINE_STEP_M) + 1)
        poses = np.linspace(start, Pose2D(end.x, end.y, start.yaw), count)
        poses[-1, 2] = end.yaw
        return Path(poses, self.frame)


def _limit(value: float) -> float:
    """Return a limit of the local planner; 0 stands for none."""
    return value if value > 0.0 else math.inf
