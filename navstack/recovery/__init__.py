"""Recovery behaviours: what the robot does when it does not get on."""

from navstack.recovery.clear_costmap import ClearCostmapRecovery, ClearCostmapRecoveryParams
from navstack.recovery.move_slow_and_clear import MoveSlowAndClear, MoveSlowAndClearParams
from navstack.recovery.rotate import RotateRecovery, RotateRecoveryParams

__all__ = [
    "ClearCostmapRecovery",
    "ClearCostmapRecoveryParams",
    "MoveSlowAndClear",
    "MoveSlowAndClearParams",
    "RotateRecovery",
    "RotateRecoveryParams",
]
