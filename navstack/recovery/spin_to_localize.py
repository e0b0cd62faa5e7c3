"""spin_to_localize: turn in place until the robot is localized.

A lost robot that turns sees more of its surroundings, and its localizer compares each scan with the possible poses. Nav2 and
move_base have no such behavior; its motion is that of Nav2's spin.
"""

from __future__ import annotations

import math

from navstack.core import RobotState
from navstack.core.parameters import param
from navstack.interfaces import RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.spin import Spin, SpinParams


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

    It fails if the robot is still lost after the turn. A robot that does not report whether it is lost makes the whole turn. The
    footprint is checked as by spin.
    """

    Params = SpinToLocalizeParams

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start from the heading of the first step. Raises CannotTurnError for a base with a turning radius."""
        super().start(context, now)
        self._localization = context.localization

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return the next command. Raises CollisionAheadError or SpinTimeoutError."""
        status = self._localization()
        if status is not None and not status.lost:
            turned = math.degrees(self.progress.turned)
            text = f"{self.name}: the robot is localized, after a turn of {turned:.0f} degrees"
            return RecoveryStep(RecoveryStatus.DONE, text=text, data={"turned_rad": self.progress.turned})
        step = super().step(state, now)
        if step.status is not RecoveryStatus.DONE or status is None:
            return step
        text = f"{step.text}, and the robot is still lost: {status.text}"
        return RecoveryStep(RecoveryStatus.FAILED, text=text, data=step.data)
