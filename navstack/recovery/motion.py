"""What the recovery behaviors that move the robot share: parameters, progress of a turn, and collision messages."""

from __future__ import annotations

from navstack.core import angle_between, describe_cost
from navstack.core.costs import LETHAL
from navstack.core.parameters import ParamModel, param


class MotionParams(ParamModel):
    """Parameters of Nav2's motions; names and defaults as in Nav2."""

    time_allowance: float = param(10.0, "time limit of the motion", unit="s", gt=0.0)
    simulate_ahead_time: float = param(2.0, "time ahead to check for collisions", unit="s", ge=0.0)
    cycle_frequency: float = param(10.0, "rate of the commands", unit="Hz", gt=0.0)
    disable_collision_checks: bool = param(False, "move without collision checks")


class TurnProgress:
    """The angle turned since the first step, counted beyond a full turn."""

    def __init__(self) -> None:
        self.turned = 0.0
        """rad, counter-clockwise."""
        self._yaw: float | None = None

    def update(self, yaw: float) -> bool:
        """Add the turn to the heading `yaw` (rad); return True in the first step."""
        first = self._yaw is None
        if self._yaw is not None:
            self.turned += angle_between(self._yaw, yaw)
        self._yaw = yaw
        return first


def blocks(cost: int | None) -> bool:
    """Return True for a footprint cost that is a collision: lethal, or None for the edge of the costmap."""
    return cost is None or cost >= LETHAL


def describe_obstacle(cost: int | None) -> str:
    """Return the obstacle behind such a cost, for messages."""
    return "the edge of the costmap" if cost is None else f"cost {describe_cost(cost)}"
