"""Recovery behaviors: what the robot does if planning or control fails, or if it makes no progress."""

from navstack.recovery.back_up import BackUp, BackUpParams
from navstack.recovery.clear_costmap import ClearCostmapRecovery, ClearCostmapRecoveryParams
from navstack.recovery.drive_on_heading import DriveOnHeading, DriveOnHeadingParams
from navstack.recovery.move_slow_and_clear import MoveSlowAndClear, MoveSlowAndClearParams
from navstack.recovery.rotate import RotateRecovery, RotateRecoveryParams
from navstack.recovery.spin import Spin, SpinParams
from navstack.recovery.spin_to_localize import SpinToLocalize, SpinToLocalizeParams
from navstack.recovery.wait import Wait, WaitParams

__all__ = [
    "BackUp",
    "BackUpParams",
    "ClearCostmapRecovery",
    "ClearCostmapRecoveryParams",
    "DriveOnHeading",
    "DriveOnHeadingParams",
    "MoveSlowAndClear",
    "MoveSlowAndClearParams",
    "RotateRecovery",
    "RotateRecoveryParams",
    "Spin",
    "SpinParams",
    "SpinToLocalize",
    "SpinToLocalizeParams",
    "Wait",
    "WaitParams",
]
