"""spin: turn in place by an angle.

Source of behavior and names: Nav2 (nav2_behaviors/Spin, nav2_behavior_tree's Spin node). move_base has rotate_recovery
instead, which always makes a full turn.
"""

from __future__ import annotations

import math

from navstack.core import Pose2D, RobotState, Twist2D
from navstack.core.collision import turn_cost
from navstack.core.costs import LETHAL
from navstack.core.errors import CollisionAheadError, ParameterError
from navstack.core.parameters import param
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.errors import SpinTimeoutError
from navstack.recovery.motion import (
    MotionParams,
    TurnProgress,
    blocks,
    describe_obstacle,
    known_obstacle_after,
    require_turning,
)


class SpinParams(MotionParams):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    spin_dist: float = param(1.57, "angle to turn, clockwise if negative", unit="rad")
    max_rotational_vel: float = param(
        1.0, "maximum rotational speed, limited by the local planner's", unit="rad/s", gt=0.0
    )
    min_rotational_vel: float = param(0.4, "minimum rotational speed", unit="rad/s", ge=0.0)
    rotational_acc_lim: float = param(3.2, "deceleration at the end of the turn", unit="rad/s²", gt=0.0)


@RECOVERY_BEHAVIORS.register("spin", aliases=("nav2_behaviors/Spin", "nav2_recoveries/Spin"))
class Spin(RecoveryBehavior):
    """Turns by `spin_dist`. Before each command the whole footprint is checked along the turn on the local costmap."""

    Params = SpinParams
    turns_in_place = True
    params: SpinParams

    def __init__(self, name: str, params: SpinParams) -> None:
        super().__init__(name, params)
        self._context: RecoveryContext | None = None
        self._started_at = 0.0
        self.progress = TurnProgress()

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.cycle_frequency

    def check(self, context: RecoveryContext) -> None:
        """Raise ParameterError if the turn cannot end within time_allowance, even at full speed."""
        p = self.params
        fastest = min(context.local_planner.limits.max_vel_theta, p.max_rotational_vel)
        needed = abs(p.spin_dist) / fastest if fastest > 0.0 else math.inf
        if needed > p.time_allowance:
            raise ParameterError(
                f"{self.name}: a turn of {abs(p.spin_dist):g} rad at {fastest:g} rad/s takes at least {needed:.1f} s, longer "
                f"than its time_allowance of {p.time_allowance:g} s; raise it or max_rotational_vel, or reduce spin_dist"
            )

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start from the heading of the first step. Raises CannotTurnError for a base with a turning radius."""
        require_turning(context, self.name)
        self._context = context
        self._started_at = now
        self.progress = TurnProgress()

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return the next command. Raises CollisionAheadError or SpinTimeoutError."""
        context = self._context
        assert context is not None
        p = self.params
        first = self.progress.update(state.pose.yaw)
        turned = self.progress.turned
        sign = math.copysign(1.0, p.spin_dist)
        left = abs(p.spin_dist) - sign * turned
        data = {"turned_rad": turned, "left_rad": max(0.0, left)}
        fastest = min(context.local_planner.limits.max_vel_theta, p.max_rotational_vel)
        slowest = min(p.min_rotational_vel, fastest)
        # the command holds for a whole period: stop at the nearest step
        if left <= 0.5 * slowest / p.cycle_frequency or left <= 1e-6:
            text = f"{self.name}: turned {math.degrees(turned):.0f} degrees"
            return RecoveryStep(RecoveryStatus.DONE, text=text, data=data)
        if now - self._started_at > p.time_allowance:
            raise SpinTimeoutError(
                f"{self.name} turned {math.degrees(turned):.0f} of {math.degrees(p.spin_dist):.0f} degrees within "
                f"its time_allowance of {p.time_allowance:g} s",
                **data,
            )
        speed = min(max(math.sqrt(2.0 * p.rotational_acc_lim * left), slowest), fastest, left * p.cycle_frequency)
        if not p.disable_collision_checks:
            self._check_turn(context, state.pose, sign * min(left, fastest * p.simulate_ahead_time), data)
            self._check_known(
                context, now, sign * (left if first else min(left, fastest * p.simulate_ahead_time)), data
            )
        text = f"{self.name}: turning {math.degrees(p.spin_dist):.0f} degrees" if first else ""
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, sign * speed), text, data)

    def _check_turn(self, context: RecoveryContext, pose: Pose2D, angle: float, data: dict[str, float]) -> None:
        """Raise CollisionAheadError if the footprint collides while it turns by `angle` (rad)."""
        costmap = context.local_costmap
        cost, after = turn_cost(costmap.master, costmap.footprint, pose, angle)
        if blocks(cost):
            turned, target = math.degrees(data["turned_rad"]), math.degrees(self.params.spin_dist)
            raise CollisionAheadError(
                f"{self.name} stopped after {turned:.0f} of {target:.0f} degrees: the footprint hits "
                f"{describe_obstacle(cost)} after another {math.degrees(abs(after)):.0f} degrees",
                cost=cost,
                collision_after_rad=abs(after),
                **data,
            )

    def _check_known(self, context: RecoveryContext, now: float, angle: float, data: dict[str, float]) -> None:
        """Raise CollisionAheadError if the turn by `angle` (rad) hits an obstacle of the global costmap."""
        after = known_obstacle_after(context, now, 0.0, angle, step=0.017)
        if after is not None:
            costmap = context.global_costmap
            raise CollisionAheadError(
                f"{self.name} stopped after {math.degrees(data['turned_rad']):.0f} of "
                f"{math.degrees(self.params.spin_dist):.0f} degrees: the footprint hits an obstacle of the {costmap.name} "
                f"after another {math.degrees(after):.0f} degrees",
                cost=LETHAL,
                collision_after_rad=after,
                costmap=costmap.name,
                **data,
            )
