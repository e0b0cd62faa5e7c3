"""Errors of docking, with the codes of Nav2's actions DockRobot and UndockRobot (nav2_msgs). Each names the state and the try."""

from __future__ import annotations

from navstack.core import NavError


class DockingError(NavError):
    """The robot could not dock or undock."""

    code = 999
    name = "UNKNOWN"


class DockNotInDatabaseError(DockingError):
    """No dock of this name is known."""

    code = 901
    name = "DOCK_NOT_IN_DB"


class DockNotValidError(DockingError):
    """The dock has no type, an unknown one, or a pose in an unknown frame."""

    code = 902
    name = "DOCK_NOT_VALID"


class FailedToStageError(DockingError):
    """The robot did not reach the staging pose."""

    code = 903
    name = "FAILED_TO_STAGE"


class FailedToDetectDockError(DockingError):
    """The dock was not detected, or no longer."""

    code = 904
    name = "FAILED_TO_DETECT_DOCK"


class FailedToControlError(DockingError):
    """The robot did not arrive: the way is blocked, or it took too long."""

    code = 905
    name = "FAILED_TO_CONTROL"


class FailedToChargeError(DockingError):
    """The robot is docked, but its battery is not charged."""

    code = 906
    name = "FAILED_TO_CHARGE"


class DockingTimeoutError(DockingError):
    """Docking or undocking took longer than its time limit."""

    code = 907
    name = "TIMEOUT"
