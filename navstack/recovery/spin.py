"""spin: turn in place by an angle.

Source of behaviour and names: Nav2 (nav2_behaviors/Spin, nav2_behavior_tree's Spin node). move_base's is rotate_recovery,
always a whole turn.
"""

from __future__ import annotations

import math

from navstack.core import RobotState, Twist2D, angle_between, describe_cost
from navstack.core.collision import turn_cost
from navstack.core.costs import LETHAL
from navstack.core.errors import CollisionAheadError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.errors import SpinTimeoutError


class SpinParams(ParamModel):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    spin_dist: float = param(1.57, "angle to turn by, clockwise when negative", unit="rad")
    time_allowance: float = param(10.0, "how long it may take", unit="s", gt=0.0)
    max_rotational_vel: float = param(1.0, "highest turning speed, the planner's permitting", unit="rad/s", gt=0.0)
    min_rotational_vel: float = param(0.4, "lowest turning speed", unit="rad/s", ge=0.0)
    rotational_acc_lim: float = param(3.2, "deceleration towards the end of the turn", unit="rad/s²", gt=0.0)
    simulate_ahead_time: float = param(2.0, "how far ahead to look for a collision, in time", unit="s", ge=0.0)
    cycle_frequency: float = param(10.0, "commands per second", unit="Hz", gt=0.0)
    disable_collision_checks: bool = param(False, "turn without looking")


@RECOVERY_BEHAVIORS.register("spin", aliases=("nav2_behaviors/Spin", "nav2_recoveries/Spin"))
class Spin(RecoveryBehavior):
    """Turns by `spin_dist`; before each command the whole outline is checked on the local costmap, as far as it will turn."""

    Params = SpinParams
    params: SpinParams

    def __init__(self, name: str, params: SpinParams) -> None:
        super().__init__(name, params)
        self._context: RecoveryContext | None = None
        self._began = 0.0
        self._turned = 0.0
        self._yaw: float | None = None

    @property
    def frequency(self) -> float:
        """Commands per second."""
        return self.params.cycle_frequency

    def start(self, context: RecoveryContext, now: float) -> None:
        """Turns from the heading at the first step."""
        self._context = context
        self._began = now
        self._turned = 0.0
        self._yaw = None

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """The next command; raises CollisionAheadError or SpinTimeoutError."""
        context = self._context
        assert context is not None
        p = self.params
        first = self._yaw is None
        if self._yaw is not None:
            self._turned += angle_between(self._yaw, state.pose.yaw)
        self._yaw = state.pose.yaw
        sign = math.copysign(1.0, p.spin_dist)
        left = abs(p.spin_dist) - sign * self._turned
        data = {"turned_rad": self._turned, "left_rad": max(0.0, left)}
        fastest = min(context.local_planner.limits.max_vel_theta, p.max_rotational_vel)
        slowest = min(p.min_rotational_vel, fastest)
        # the command holds for a whole period: stop at the step that comes nearest
        if left <= 0.5 * slowest / p.cycle_frequency or left <= 1e-6:
            text = f"{self.name}: turned {math.degrees(self._turned):.0f} degrees"
            return RecoveryStep(RecoveryStatus.DONE, text=text, data=data)
        if now - self._began > p.time_allowance:
            raise SpinTimeoutError(
                f"{self.name} turned {math.degrees(self._turned):.0f} of {math.degrees(p.spin_dist):.0f} degrees within "
                f"its time_allowance of {p.time_allowance:g} s",
                **data,
            )
        speed = min(max(math.sqrt(2.0 * p.rotational_acc_lim * left), slowest), fastest, left * p.cycle_frequency)
        if not p.disable_collision_checks:
            costmap = context.local_costmap
            arc = sign * min(left, fastest * p.simulate_ahead_time)
            cost, after = turn_cost(costmap.master, costmap.footprint, state.pose, arc)
            if cost is None or cost >= LETHAL:
                what = "the edge of the costmap" if cost is None else f"cost {describe_cost(cost)}"
                raise CollisionAheadError(
                    f"{self.name} stopped after {math.degrees(self._turned):.0f} of {math.degrees(p.spin_dist):.0f} "
                    f"degrees: {math.degrees(abs(after)):.0f} degrees further on the outline meets {what}",
                    cost=cost,
                    collision_after_rad=abs(after),
                    **data,
                )
        text = f"{self.name}: turning {math.degrees(p.spin_dist):.0f} degrees" if first else ""
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, sign * speed), text, data)
