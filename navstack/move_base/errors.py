"""Reasons for the end of a goal that do not come from a planner or a recovery behavior."""

from __future__ import annotations

from navstack.core import ControlError, InputError, NavError


class NoProgressError(ControlError):
    """The robot makes no progress (ROS: oscillation)."""

    code = 105
    name = "FAILED_TO_MAKE_PROGRESS"


class GoalCanceledError(NavError):
    """A client canceled the goal."""

    code = 9011
    name = "CANCELED"


class GoalReplacedError(NavError):
    """A new goal replaced the goal."""

    code = 9012
    name = "REPLACED"


class InvalidGoalError(InputError):
    """The goal's position is not finite, or its orientation is not a rotation about z."""

    code = 9013
    name = "INVALID_GOAL"


class ShutdownError(NavError):
    """The goal manager was shut down."""

    code = 9014
    name = "SHUTDOWN"


class BusyError(NavError):
    """The service is not available while a goal is active."""

    code = 9015
    name = "BUSY"


class GoalTimeLimitError(NavError):
    """The goal took longer than its own time limit or `navstack/goal_time_limit`."""

    code = 9016
    name = "GOAL_TIME_LIMIT"


class StaleSensorsError(NavError):
    """A sensor of the local costmap was stale for controller_patience."""

    code = 9020
    name = "SENSOR_DATA_STALE"


class OdometryError(NavError):
    """The odometry is impossible: a velocity far beyond the robot's limits, or a pose that jumps."""

    code = 9022
    name = "IMPOSSIBLE_ODOMETRY"


class StaleOdometryError(NavError):
    """The odometry is older than transform_tolerance: its velocity is not that of the robot now."""

    code = 9023
    name = "ODOMETRY_STALE"


class LostError(NavError):
    """The robot does not know where it is in the map."""

    code = 9025
    name = "LOST"


class RecoveryTimeoutError(NavError):
    """A recovery behavior did not end within its time limit."""

    code = 9021
    name = "RECOVERY_TIMEOUT"
