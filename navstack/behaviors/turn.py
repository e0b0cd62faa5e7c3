"""Turns in place: rotate_recovery of move_base, spin of Nav2, spin_to_localize, and the motion turn."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.base import (
    STEP_RAD,
    Motion,
    Nav2Behavior,
    Nav2Params,
    TimedBehavior,
    blocks,
    braking_speed,
    describe_obstacle,
    first_obstacle,
    turning,
)
from navstack.behaviors.errors import CannotTurnError, InvalidMotionError, SpinTimeoutError
from navstack.core import (
    CollisionAheadError,
    ParameterError,
    Pose2D,
    RobotState,
    Twist2D,
    angle_between,
    normalize_angle,
    turn_cost,
)
from navstack.parameters import MotionParams
from navstack.plugins import RECOVERY_BEHAVIORS, BehaviorContext, BehaviorStatus, BehaviorStep, ParamModel, param

P = TypeVar("P")

FULL_TURN: Final = 2.0 * math.pi
TURN_TOLERANCE: Final = 0.1
"""rad; limits the robot's yaw_goal_tolerance, so that a wide one does not shorten the turn."""


class TurnProgress:
    """The angle turned since the first step, counted beyond a full turn."""

    def __init__(self) -> None:
        self.turned = 0.0
        """rad, counter-clockwise."""
        self._yaw: float | None = None

    def update(self, yaw: float) -> None:
        """Add the turn to the heading `yaw` (rad)."""
        if self._yaw is not None:
            self.turned += angle_between(self._yaw, yaw)
        self._yaw = yaw


class TurningBehavior(TimedBehavior[P]):
    """A turn in place as a recovery: it counts the angle, and refuses a base with a turning radius."""

    turns_in_place: ClassVar[bool] = True

    def __init__(self, name: str, params: P) -> None:
        super().__init__(name, params)
        self.progress = TurnProgress()

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the heading of the first step. Raises CannotTurnError for a base with a turning radius."""
        radius = context.local_planner.limits.min_turning_radius
        if radius > 0.0:
            raise CannotTurnError(
                f"{self.name} turns in place, which a base with a turning radius of {radius:g} m cannot; leave it out of "
                "recovery_behaviors, or set clearing_rotation_allowed to false",
                min_turning_radius_m=radius,
            )
        super().start(context, now)
        self.progress = TurnProgress()

    def blocked_turn(self, pose: Pose2D, angle: float, step: float = STEP_RAD) -> tuple[int | None, float] | None:
        """Return the cost that blocks a turn by `angle` (rad) on the local costmap, and the angle before it; None if free.

        The whole turn is checked in one call, every `step` (rad).
        """
        costmap = self.context.local_costmap
        cost, after = turn_cost(costmap.master, costmap.footprint, pose, angle, step=step)
        return (cost, after) if blocks(cost) else None


# --- rotate_recovery --------------------------------------------------------------------------------------------------


class RotateRecoveryParams(ParamModel):
    """Namespace: the instance's name. The local planner's limits apply to the turn (parity 19)."""

    sim_granularity: float = param(0.017, "angle between two collision checks", unit="rad", gt=0.0)
    frequency: float = param(20.0, "rate of the commands", unit="Hz", gt=0.0)
    max_rotational_vel: float = param(
        1.0,
        "maximum rotational speed, limited by the local planner's; a slow turn shows the sensors more (name and value of "
        "Nav2's spin)",
        unit="rad/s",
        gt=0.0,
        ros_differs="ROS has no such parameter and uses TrajectoryPlannerROS/max_vel_theta, by default 1.0",
    )


@RECOVERY_BEHAVIORS.register("rotate_recovery", aliases=("rotate_recovery/RotateRecovery",))
class RotateRecovery(TurningBehavior[RotateRecoveryParams]):
    """Turns by 2 pi, counter-clockwise, at `sqrt(2 * acceleration * remaining angle)` within the planner's limits.

    Before each command the whole footprint is checked along the rest of the turn on the local costmap.

    Source: rotate_recovery/src/rotate_recovery.cpp. ROS differs: there, limits and tolerance are those of TrajectoryPlannerROS
    even under DWA, only the footprint's edges are checked, and the robot continues to turn at the end.
    """

    Params = RotateRecoveryParams

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.frequency

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command."""
        del state, now
        self.progress.update(pose.yaw)
        turned = self.progress.turned
        data = {"turned_rad": turned}
        limits, p = self.context.local_planner.limits, self.params
        left = FULL_TURN - turned
        if left <= min(TURN_TOLERANCE, limits.yaw_goal_tolerance):
            return BehaviorStep(BehaviorStatus.DONE, text="Rotate recovery behavior finished.", data=data)
        # a robot cannot follow more than half a turn per step
        fastest = min(limits.max_vel_theta, p.max_rotational_vel, 0.5 * math.pi * p.frequency)
        slowest = min(abs(limits.min_vel_theta), fastest)
        speed = min(max(math.sqrt(2.0 * limits.acc_lim_theta * left), slowest), fastest)
        text = "" if self.has_begun else "Rotate recovery behavior started."
        return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(0.0, 0.0, speed), text, data)

    def checked(self, step: BehaviorStep, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the step. Raises CollisionAheadError if the footprint collides in the rest of the turn."""
        del state, now
        left = FULL_TURN - self.progress.turned
        blocked = self.blocked_turn(pose, left, self.params.sim_granularity)
        if blocked is not None:
            cost, after = blocked
            raise CollisionAheadError(
                "Rotate recovery can't rotate in place because there is a potential collision: the footprint hits "
                f"{describe_obstacle(cost)} after {math.degrees(after):.0f} of the remaining {math.degrees(left):.0f} degrees",
                cost=cost,
                turned_rad=self.progress.turned,
                left_rad=left,
                collision_after_rad=after,
            )
        return step


# --- spin -------------------------------------------------------------------------------------------------------------


class SpinParams(Nav2Params):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    spin_dist: float = param(1.57, "angle to turn, clockwise if negative", unit="rad")
    max_rotational_vel: float = param(
        1.0, "maximum rotational speed, limited by the local planner's", unit="rad/s", gt=0.0
    )
    min_rotational_vel: float = param(0.4, "minimum rotational speed", unit="rad/s", ge=0.0)
    rotational_acc_lim: float = param(3.2, "deceleration at the end of the turn", unit="rad/s²", gt=0.0)


@RECOVERY_BEHAVIORS.register("spin", aliases=("nav2_behaviors/Spin", "nav2_recoveries/Spin"))
class Spin(TurningBehavior[SpinParams], Nav2Behavior[SpinParams]):
    """Turns by `spin_dist`. Before each command the whole footprint is checked along the turn on the local costmap.

    Source of behavior and names: Nav2 (nav2_behaviors/Spin, nav2_behavior_tree's Spin node). move_base has rotate_recovery
    instead, which always makes a full turn.
    """

    Params = SpinParams
    timeout = SpinTimeoutError

    def check(self, context: BehaviorContext) -> None:
        """Raise ParameterError if the turn cannot end within time_allowance, even at full speed."""
        p = self.params
        fastest = min(context.local_planner.limits.max_vel_theta, p.max_rotational_vel)
        needed = abs(p.spin_dist) / fastest if fastest > 0.0 else math.inf
        if needed > p.time_allowance:
            raise ParameterError(
                f"{self.name}: a turn of {abs(p.spin_dist):g} rad at {fastest:g} rad/s takes at least {needed:.1f} s, longer "
                f"than its time_allowance of {p.time_allowance:g} s; raise it or max_rotational_vel, or reduce spin_dist"
            )

    @property
    def left(self) -> float:
        """The angle to turn in the direction of `spin_dist` (rad); negative beyond it."""
        return abs(self.params.spin_dist) - math.copysign(1.0, self.params.spin_dist) * self.progress.turned

    @property
    def fastest(self) -> float:
        """The largest speed (rad/s)."""
        return min(self.context.local_planner.limits.max_vel_theta, self.params.max_rotational_vel)

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command."""
        del state, now
        p = self.params
        self.progress.update(pose.yaw)
        turned, left, fastest = self.progress.turned, self.left, self.fastest
        data = {"turned_rad": turned, "left_rad": max(0.0, left)}
        slowest = min(p.min_rotational_vel, fastest)
        # the command holds for a whole period: stop at the nearest step
        if left <= 0.5 * slowest / p.cycle_frequency or left <= 1e-6:
            text = f"{self.name}: turned {math.degrees(turned):.0f} degrees"
            return BehaviorStep(BehaviorStatus.DONE, text=text, data=data)
        speed = min(max(math.sqrt(2.0 * p.rotational_acc_lim * left), slowest), fastest, left * p.cycle_frequency)
        text = "" if self.has_begun else f"{self.name}: turning {math.degrees(p.spin_dist):.0f} degrees"
        twist = Twist2D(0.0, 0.0, math.copysign(1.0, p.spin_dist) * speed)
        return BehaviorStep(BehaviorStatus.RUNNING, twist, text, data)

    def check_way(self, pose: Pose2D, now: float, data: dict[str, float]) -> None:
        """Raise CollisionAheadError if the footprint collides in the turn ahead."""
        first, left = not self.has_begun, self.left
        sign = math.copysign(1.0, self.params.spin_dist)
        reach = min(left, self.fastest * self.params.simulate_ahead_time)
        turned, target = math.degrees(data["turned_rad"]), math.degrees(self.params.spin_dist)
        so_far = f"{self.name} stopped after {turned:.0f} of {target:.0f} degrees: the footprint hits"
        blocked = self.blocked_turn(pose, sign * reach)
        if blocked is not None:
            cost, after = blocked[0], abs(blocked[1])
            raise CollisionAheadError(
                f"{so_far} {describe_obstacle(cost)} after another {math.degrees(after):.0f} degrees",
                cost=cost,
                collision_after_rad=after,
                **data,
            )
        ahead = turning(sign * (left if first else reach), even=False)
        obstacle = first_obstacle(self.context, pose, now, ahead, seen=False, excuse=False)
        if obstacle is not None:
            after = float(abs(ahead[obstacle.index, 2]))
            raise CollisionAheadError(
                f"{so_far} an obstacle of the {obstacle.costmap} after another {math.degrees(after):.0f} degrees",
                cost=obstacle.cost,
                collision_after_rad=after,
                costmap=obstacle.costmap,
                **data,
            )

    def summary(self) -> str:
        """Return the angle turned."""
        turned, target = math.degrees(self.progress.turned), math.degrees(self.params.spin_dist)
        return f"{self.name}: turned {turned:.0f} of {target:.0f} degrees"


# --- spin_to_localize -------------------------------------------------------------------------------------------------


class SpinToLocalizeParams(SpinParams):
    """Namespace: the instance's name. Those of spin, with a full turn, slow enough for the scans."""

    spin_dist: float = param(6.2832, "largest angle to turn, clockwise if negative", unit="rad")
    max_rotational_vel: float = param(
        0.6, "maximum rotational speed, limited by the local planner's", unit="rad/s", gt=0.0
    )
    time_allowance: float = param(30.0, "time limit of the motion", unit="s", gt=0.0)


@RECOVERY_BEHAVIORS.register("spin_to_localize")
class SpinToLocalize(Spin):
    """Turns by at most `spin_dist`, and ends as soon as the robot is not lost: immediately if it is localized.

    A lost robot that turns sees more of its surroundings, and its localizer compares each scan with the possible poses. Nav2 and
    move_base have no such behavior; its motion is that of Nav2's spin, and the footprint is checked as by it.

    It fails if the robot is still lost after the turn. A robot that does not report whether it is lost makes the whole turn.
    """

    Params = SpinToLocalizeParams

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command."""
        status = self.context.localization()
        if status is not None and not status.lost:
            turned = math.degrees(self.progress.turned)
            text = f"{self.name}: the robot is localized, after a turn of {turned:.0f} degrees"
            return BehaviorStep(BehaviorStatus.DONE, text=text, data={"turned_rad": self.progress.turned})
        step = super().command(pose, state, now)
        if step.status is not BehaviorStatus.DONE or status is None:
            return step
        text = f"{step.text}, and the robot is still lost: {status.text}"
        return BehaviorStep(BehaviorStatus.FAILED, text=text, data=step.data)


# --- turn -------------------------------------------------------------------------------------------------------------


class Turn(Motion):
    """Turns by `angle` (rad), clockwise if negative, more than a full turn too, and stops within `tolerance_radian`.

    Source of the names and of the idea: the node RadianTurn of the ROS tutorials. ROS differs: that node turns to the angle
    modulo a full turn, the shorter way, and misses targets near 0 because it does not wrap the difference; its variant for larger
    angles adds up the tolerance of each part. Here the angle is counted beyond full turns.
    """

    def __init__(
        self, angle: float, params: MotionParams | None = None, name: str = "turn", *, shortest: bool = False
    ) -> None:
        """`shortest`: turn to the same heading by at most half a turn. Raises InvalidMotionError if `angle` is not finite."""
        super().__init__(name, params)
        if not math.isfinite(angle):
            raise InvalidMotionError(f"the angle {angle} of {name} is not finite", angle=angle)
        self.angle = normalize_angle(angle) if shortest else angle
        self._progress = TurnProgress()

    def describe(self) -> dict[str, Any]:
        """Return the angle (rad)."""
        return {"turn": self.angle}

    def prepare(self, pose: Pose2D, state: RobotState) -> float:
        """Start from the heading of `pose`. Raises InvalidMotionError for a base with a turning radius."""
        del state
        self.require_turning(self.name)
        self._progress = TurnProgress()
        self.target = Pose2D(pose.x, pose.y, normalize_angle(pose.yaw + self.angle))
        self.reference = self.line(pose, self.target)
        limits = self.limits
        speed = self._fastest()
        return abs(self.angle) / speed + 2.0 * speed / limits.max_turn_acceleration

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step."""
        del now
        self._progress.update(pose.yaw)
        done = self._progress.turned
        left = self.angle - done
        data = {"turned_rad": done, "left_rad": abs(left)}
        limits, p = self.limits, self.params
        slow = abs(self._ramp.last.wz) <= limits.max_turn_acceleration * self.dt
        if abs(left) <= p.tolerance_radian and slow:
            if self.is_standing(state):
                return self.done(data)
            return self.running(0.0, 0.0, data, f"stopping, {math.degrees(left):.1f} degrees from the target")
        fastest = self._fastest()
        rate = math.copysign(min(fastest, braking_speed(abs(left), limits.max_turn_acceleration, self.dt)), left)
        what = "turning" if abs(rate) == fastest else "braking for the target"
        turned, angle = math.degrees(done), math.degrees(self.angle)
        return self.running(0.0, rate, data, f"{what}: turned {turned:.1f} of {angle:.1f} degrees")

    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return the rest of the turn, or what `simulate_ahead_time` covers."""
        del pose, now
        left = self.angle - self._progress.turned
        reach = abs(left) if whole else min(abs(left), self._fastest() * self.params.simulate_ahead_time)
        return turning(math.copysign(reach, left))

    def summary(self) -> str:
        """Return the angle turned."""
        turned, angle = math.degrees(self._progress.turned), math.degrees(self.angle)
        return f"{self.name}: turned {turned:.1f} of {angle:.1f} degrees"

    def _fastest(self) -> float:
        # a robot cannot be followed through more than half a turn per cycle
        return min(self.params.speed_radian, self.limits.max_turn_rate, 0.5 * math.pi * self.params.frequency)
