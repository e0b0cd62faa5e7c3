"""What behaviors share: the first step and the time limit, commands within acceleration limits, the check of the way ahead."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.errors import InvalidMotionError, MotionCollisionError, MotionTimeoutError
from navstack.behaviors.timing import MotionLimits
from navstack.core import (
    LETHAL,
    NavError,
    Path,
    Pose2D,
    RecoveryError,
    RobotState,
    Transform2D,
    Twist2D,
    WheelDrive,
    describe_cost,
    excusing_overlap,
    footprint_cost,
    overlaps_obstacle,
)
from navstack.parameters import MotionParams
from navstack.plugins import (
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    CostmapServer,
    LocalPlan,
    ParamModel,
    param,
)

P = TypeVar("P")

LINE_STEP_M: Final = 0.05
STEP_RAD: Final = 0.017
"""Angle between two checks of a turn, as in rotate_recovery."""
STOPPED: Final = 0.01
"""Below this velocity the robot counts as standing (m/s, rad/s)."""


class TimedBehavior(Behavior[P]):
    """A behavior that counts from its first step and must end within a time. A subclass implements `begin` and `command`.

    A step is: the next command, or the end; then the time limit; then the way ahead.
    """

    timeout: ClassVar[type[NavError]] = RecoveryError
    """Raised after the time allowance."""

    def __init__(self, name: str, params: P) -> None:
        super().__init__(name, params)
        self.started_at = 0.0
        self.allowance = math.inf
        """s, from the start."""
        self.has_begun = False
        """True after the first step."""
        self._context: BehaviorContext | None = None

    @property
    def context(self) -> BehaviorContext:
        """Costmaps and local planner."""
        assert self._context is not None
        return self._context

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the pose of the first step."""
        self._context = context
        self.started_at, self.allowance, self.has_begun = now, math.inf, False
        self.target = self.reference = self.local_plan = None

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command. Raises the errors of the behavior."""
        pose = self.measured(state, now)
        if not self.has_begun:
            self.allowance = self.begin(pose, state, now)
        step = self.command(pose, state, now)
        if step.status is not BehaviorStatus.RUNNING:
            return step
        if now - self.started_at > self.allowance:
            raise self.timeout(f"{self.summary()} {self.within_allowance()}", **step.data)
        step = self.checked(step, pose, state, now)
        self.has_begun = True
        return step

    # --- for subclasses -----------------------------------------------------------------------------------------------

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Prepare the first step from `pose`; return the time allowance (s). May raise a NavError."""
        del pose, state, now
        return math.inf

    @abstractmethod
    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step from `pose`, before the checks; `has_begun` is False in the first one."""

    def checked(self, step: BehaviorStep, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the step if the way ahead is free. Otherwise return another one, or raise a CollisionAheadError."""
        del pose, state, now
        return step

    def measured(self, state: RobotState, now: float) -> Pose2D:
        """Return the robot's pose in the frame in which the behavior measures. Raises FrameError."""
        del now
        return state.pose

    def summary(self) -> str:
        """Return what the robot has done so far, for messages."""
        return self.name

    def within_allowance(self) -> str:
        """Return the end of the message of a time-out."""
        return f"within its time_allowance of {self.allowance:g} s"


# --- behaviors of Nav2 ------------------------------------------------------------------------------------------------


class Nav2Params(ParamModel):
    """Parameters of Nav2's behaviors; names and defaults as in Nav2."""

    time_allowance: float = param(10.0, "time limit of the motion", unit="s", gt=0.0)
    simulate_ahead_time: float = param(2.0, "time ahead to check for collisions", unit="s", ge=0.0)
    cycle_frequency: float = param(10.0, "rate of the commands", unit="Hz", gt=0.0)
    disable_collision_checks: bool = param(False, "move without collision checks")


N = TypeVar("N", bound=Nav2Params)


class Nav2Behavior(TimedBehavior[N]):
    """A behavior of Nav2 that moves the robot: at constant limits, without ramps; an obstacle ahead ends it at once.

    The whole footprint is checked on the local costmap within `simulate_ahead_time`, on the global costmap along the whole way
    before the first command, and within that time later.
    """

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.cycle_frequency

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Return the time allowance of the parameters."""
        del pose, state, now
        return self.params.time_allowance

    def checked(self, step: BehaviorStep, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the step if the way is free, or need not be. Raises CollisionAheadError."""
        if not self.params.disable_collision_checks:
            self.check_way(pose, now, step.data)
        return step

    @abstractmethod
    def check_way(self, pose: Pose2D, now: float, data: dict[str, float]) -> None:
        """Raise CollisionAheadError, with the step's data, for an obstacle ahead."""


# --- obstacles --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What ends a motion."""

    index: int
    """Index of the first pose at which the footprint is not free."""
    costmap: str
    cost: int | None
    """Cost under the footprint; None: it leaves the local costmap."""

    def __str__(self) -> str:
        if self.cost is None:
            return f"the edge of the {self.costmap}"
        return f"an obstacle of the {self.costmap} (cost {describe_cost(self.cost)})"


def blocks(cost: int | None) -> bool:
    """Return True for a footprint cost that is a collision: lethal, unknown, or None for the edge of the costmap."""
    return cost is None or cost >= LETHAL


def describe_obstacle(cost: int | None) -> str:
    """Return the obstacle behind such a cost, as Nav2's behaviors name it."""
    return "the edge of the costmap" if cost is None else f"cost {describe_cost(cost)}"


def straight(costmap: CostmapServer, distance: float, *, even: bool = True) -> NDArray[np.float64]:
    """Return poses (n, 3) in the base frame along a straight motion by `distance` (m), at most half a cell apart.

    The steps are equal, or half a cell and a rest if not `even`. Poses that are surely off the costmap are left out.
    """
    geometry = costmap.master.geometry
    reach = min(abs(distance), 2.0 * (geometry.width_m + geometry.height_m))
    along = _samples(reach, 0.5 * geometry.resolution, even)
    poses = np.zeros((len(along), 3))
    poses[:, 0] = np.copysign(along, distance)
    return poses


def turning(angle: float, *, even: bool = True) -> NDArray[np.float64]:
    """Return poses (n, 3) in the base frame along a turn in place by `angle` (rad), at most once around.

    They are at most STEP_RAD apart: in equal steps, or STEP_RAD and a rest if not `even`.
    """
    turned = _samples(min(abs(angle), 2.0 * math.pi), STEP_RAD, even)
    poses = np.zeros((len(turned), 3))
    poses[:, 2] = np.copysign(turned, angle)
    return poses


def _samples(size: float, step: float, even: bool) -> NDArray[np.float64]:
    """Return values from 0 to `size`, at most `step` apart."""
    if even:
        return np.linspace(0.0, size, max(1, math.ceil(size / step)) + 1)
    return np.minimum(np.arange(math.ceil(size / step) + 1) * step, size)


def first_obstacle(
    context: BehaviorContext,
    local: Pose2D,
    now: float,
    ahead: NDArray[np.float64],
    *,
    seen: bool = True,
    known: bool = True,
    excuse: bool = True,
) -> Obstacle | None:
    """Return the first pose at which the footprint is not free; None if all are.

    `ahead` (n, 3) are poses in the base frame, `local` is the robot in the local costmap's frame. On the local costmap lethal
    and unknown cells and its edge count; on the global costmap lethal cells, which the sensors may not see now, such as walls of
    the map behind the robot. Where the footprint overlaps lethal cells now, a motion that leads away from them is free, and no
    other; without `excuse`, none is. Without `seen` the local costmap is not checked, without `known` the global one.
    Raises FrameError without the robot's pose in the map.
    """
    costmaps: list[tuple[CostmapServer, NDArray[np.float64], bool]] = []
    if seen:
        costmaps.append((context.local_costmap, Transform2D(*local).apply_poses(ahead), True))
    if known:
        in_map = Transform2D(*context.global_costmap.robot_pose(now)).apply_poses(ahead)
        costmaps.append((context.global_costmap, in_map, False))
    masters = [excusing_overlap(c.master, c.footprint, poses) if excuse else c.master for c, poses, _ in costmaps]
    for k in range(len(ahead)):
        for (costmap, poses, unknown_counts), master in zip(costmaps, masters):
            pose = Pose2D(*poses[k].tolist())
            if not unknown_counts:
                if overlaps_obstacle(master, costmap.footprint, pose):
                    return Obstacle(k, costmap.name, LETHAL)
            elif blocks(cost := footprint_cost(master, costmap.footprint, pose)):
                return Obstacle(k, costmap.name, cost)
    return None


# --- speeds -----------------------------------------------------------------------------------------------------------


def braking_speed(distance: float, acceleration: float, dt: float) -> float:
    """Return the largest speed (m/s or rad/s) from which the robot stops within `distance` (m or rad, not negative).

    The speed is held for one cycle of `dt` (s), then falls by `acceleration`: v dt + v² / 2a = distance. So it stops in time
    whether the base follows a command at once or at that acceleration.
    """
    change = acceleration * dt
    if not math.isfinite(change):
        return distance / dt
    return math.sqrt(change * change + 2.0 * acceleration * max(distance, 0.0)) - change


class Ramp:
    """The last command, from which the next one differs by at most one cycle's acceleration."""

    def __init__(self, acceleration: float, turn_acceleration: float) -> None:
        """Limits in m/s² and rad/s²; inf for none."""
        self.acceleration, self.turn_acceleration = acceleration, turn_acceleration
        self.last = Twist2D()

    def begin(self, state: RobotState) -> None:
        """Start from the robot's velocity."""
        self.last = Twist2D(state.velocity.vx, 0.0, state.velocity.wz)

    def towards(self, speed: float, turn_rate: float, dt: float) -> Twist2D:
        """Return the command nearest to `speed` (m/s) and `turn_rate` (rad/s) that one cycle of `dt` (s) allows."""
        vx = _within(speed, self.last.vx, self.acceleration * dt)
        wz = _within(turn_rate, self.last.wz, self.turn_acceleration * dt)
        self.last = Twist2D(vx, 0.0, wz)
        return self.last

    def braked(self, dt: float) -> Twist2D:
        """Return the command that brakes as hard as the limits allow, on the arc of the last one."""
        vx, wz = self.last.vx, self.last.wz
        shares = [
            abs(value) / (limit * dt)
            for value, limit in ((vx, self.acceleration), (wz, self.turn_acceleration))
            if value
        ]
        slowest = max(shares, default=0.0)
        factor = 1.0 - 1.0 / slowest if slowest > 1.0 else 0.0
        self.last = Twist2D(factor * vx, 0.0, factor * wz)
        return self.last

    def stopping_time(self) -> float:
        """Return the time (s) to a standstill from the last command."""
        return max(abs(self.last.vx) / self.acceleration, abs(self.last.wz) / self.turn_acceleration)


def _within(value: float, last: float, change: float) -> float:
    return min(max(value, last - change), last + change)


# --- motions ----------------------------------------------------------------------------------------------------------


class Motion(TimedBehavior[MotionParams]):
    """A behavior of a base that drives along its heading, with ramps. A subclass implements `prepare`, `command` and `ahead`.

    Before each command the footprint is checked along the way that the robot covers within `simulate_ahead_time`, before the
    first one along the whole way on the global costmap. Before an obstacle the robot brakes within its acceleration limits, at
    once if it is closer than that, and the motion fails.
    """

    Params = MotionParams
    timeout = MotionTimeoutError

    def __init__(self, name: str, params: MotionParams | None = None) -> None:
        super().__init__(name, params or MotionParams())
        self.measured_in: str = self.params.frame
        """`odom` or `map`: the frame in which poses are measured."""
        self.min_turning_radius = 0.0
        """m; 0 for a base that can turn in place."""
        self.drive: WheelDrive | None = None
        """The wheels, if their speed is limited."""
        self.max_wheel_speed = math.inf
        """m/s at the rim."""
        self.dt = 0.0
        """Time for which the command of this step holds (s)."""
        self._ramp = Ramp(math.inf, math.inf)
        self._before = Twist2D()
        self._last_step = -math.inf
        self._failure: NavError | None = None
        self._data: dict[str, Any] = {}

    # --- for subclasses -----------------------------------------------------------------------------------------------

    @abstractmethod
    def prepare(self, pose: Pose2D, state: RobotState) -> float:
        """Lay the motion from `pose`; return its expected time (s). May raise a NavError."""

    @abstractmethod
    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return poses (n, 3) in the base frame, from here on: within `simulate_ahead_time`, or the `whole` rest."""

    # --- a behavior ---------------------------------------------------------------------------------------------------

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.frequency

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

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the pose of the first step."""
        super().start(context, now)
        limits = self.limits
        self._ramp = Ramp(limits.max_acceleration, limits.max_turn_acceleration)
        self._last_step, self._failure, self._data = -math.inf, None, {}
        self.frame = context.local_costmap.frame if self.measured_in == "odom" else context.global_costmap.frame

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command. Raises the errors of the motion."""
        self.dt = self.cycle(now)
        self._last_step = now
        if self._failure is not None:
            return self._brake(self._failure)
        return super().step(state, now)

    def cycle(self, now: float) -> float:
        """Return the time (s) for which the command at `now` (s) holds: as long as the last one, at most two periods."""
        period = 1.0 / self.params.frequency
        return min(now - self._last_step, 2.0 * period) if math.isfinite(self._last_step) else period

    def measured(self, state: RobotState, now: float) -> Pose2D:
        """Return the robot's pose in `frame`."""
        return state.pose if self.measured_in == "odom" else self.context.global_costmap.robot_pose(now)

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Lay the motion; return the time allowance. Raises MotionCollisionError for a known obstacle on the whole way."""
        self._ramp.begin(state)
        expected = self.prepare(pose, state)
        if not self.params.disable_collision_checks:
            poses = self.ahead(pose, now, whole=True)
            obstacle = first_obstacle(self.context, state.pose, now, poses, seen=False)
            if obstacle is not None:
                raise self._collision(obstacle, poses, {}, begun=False)
        return self.params.time_allowance or 2.0 * expected + 5.0

    def checked(self, step: BehaviorStep, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the step, or one that brakes before an obstacle. Raises MotionCollisionError if it is too close for that."""
        notes: tuple[str, ...] = tuple(step.data.pop("notes", ()))
        self._data = step.data
        poses = self.ahead(pose, now, whole=False)
        obstacle = None
        if not self.params.disable_collision_checks:
            obstacle = first_obstacle(self.context, state.pose, now, poses)
        if obstacle is not None:
            self._failure = self._collision(obstacle, poses, step.data)
            self._ramp.last = self._before  # the command of this step is not sent
            if obstacle.index <= self._stopping_index(poses):
                raise self._failure
            return self._brake(self._failure)
        seen = Transform2D(*state.pose).apply_poses(poses)
        self.local_plan = LocalPlan(step.twist, self.name, trajectory=seen, notes=notes)
        return step

    def within_allowance(self) -> str:
        """Return the end of the message of a time-out."""
        return f"within its time allowance of {self.allowance:.1f} s"

    # --- obstacles ----------------------------------------------------------------------------------------------------

    def _collision(
        self, obstacle: Obstacle, poses: NDArray[np.float64], data: dict[str, Any], *, begun: bool = True
    ) -> MotionCollisionError:
        until = poses[: obstacle.index + 1]
        meters = float(np.hypot(*np.diff(until[:, :2], axis=0).T).sum())
        turned = float(np.abs(np.diff(until[:, 2])).sum())
        after = f"{meters:.2f} m" if meters > 0.0 or turned == 0.0 else f"{math.degrees(turned):.0f} degrees"
        what = f"{self.summary()} and stopped" if begun else f"{self.name} did not start"
        return MotionCollisionError(
            f"{what}: the footprint hits {obstacle} after another {after}",
            cost=obstacle.cost,
            costmap=obstacle.costmap,
            collision_after_m=meters,
            collision_after_rad=turned,
            collision_ahead=[float(v) for v in poses[obstacle.index]],
            **data,
        )

    def _stopping_index(self, poses: NDArray[np.float64]) -> int:
        """Return the index of the pose at which the robot stands if it brakes now."""
        ramp = self._ramp
        last, time = ramp.last, ramp.stopping_time() + 2.0 * self.dt
        size = np.hypot(*np.diff(poses[:, :2], axis=0).T).cumsum()
        turn = np.abs(np.diff(poses[:, 2])).cumsum()
        beyond = (size > 0.5 * abs(last.vx) * time) | (turn > 0.5 * abs(last.wz) * time)
        return int(np.argmax(beyond)) + 1 if beyond.any() else len(poses)

    def _brake(self, failure: NavError) -> BehaviorStep:
        """Return a step of braking. Raises the failure once the robot stands."""
        if self._ramp.last.vx == 0.0 and self._ramp.last.wz == 0.0:
            raise failure
        twist = self._ramp.braked(self.dt)
        self.local_plan = LocalPlan(twist, self.name, notes=(f"braking: {failure.message}",))
        return BehaviorStep(BehaviorStatus.RUNNING, twist, data=dict(self._data))

    # --- results ------------------------------------------------------------------------------------------------------

    def running(self, speed: float, turn_rate: float, data: dict[str, Any], *notes: str) -> BehaviorStep:
        """Return a step towards a speed (m/s) and a turn rate (rad/s), with data, and sentences about its reasons."""
        self._before = self._ramp.last
        twist = self._ramp.towards(speed, turn_rate, self.dt)
        return BehaviorStep(BehaviorStatus.RUNNING, twist, data={**data, "notes": notes})

    def done(self, data: dict[str, Any]) -> BehaviorStep:
        """Return the last step."""
        return BehaviorStep(BehaviorStatus.DONE, text=self.summary(), data=data)

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
