"""Why a goal ended, where neither a planner nor a controller has a word for it."""

from __future__ import annotations

from navstack.core.errors import ControlError, InputError, NavError


class NoProgressError(ControlError):
    """The robot moves, or means to, and gets nowhere (ROS: oscillation)."""

    code = 105
    name = "FAILED_TO_MAKE_PROGRESS"


class GoalCanceledError(NavError):
    """Whoever sent the goal took it back."""

    code = 9011
    name = "CANCELED"


class GoalReplacedError(NavError):
    """Another goal took its place."""

    code = 9012
    name = "REPLACED"


class InvalidGoalError(InputError):
    """The goal's position or orientation is not one."""

    code = 9013
    name = "INVALID_GOAL"


class ShutdownError(NavError):
    """The goal manager was shut down."""

    code = 9014
    name = "SHUTDOWN"


class BusyError(NavError):
    """That cannot be done while there is a goal."""

    code = 9015
    name = "BUSY"


class GoalTimeLimitError(NavError):
    """The goal took longer than whoever sent it, or `navstack/goal_time_limit`, allows."""

    code = 9016
    name = "GOAL_TIME_LIMIT"


class StaleSensorsError(NavError):
    """A sensor that the local costmap relies on is silent for too long."""

    code = 9020
    name = "SENSOR_DATA_STALE"


class RecoveryTimeoutError(NavError):
    """A recovery behaviour did not end."""

    code = 9021
    name = "RECOVERY_TIMEOUT"
