"""Exceptions. Each one has a numeric code, a message that says how to fix the problem, and data for programs.

The codes are those of Nav2's action results (ComputePathToPose 2xx, FollowPath 1xx, Spin 7xx); errors without a counterpart in
Nav2 start at 9000.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np


def jsonable(value: Any) -> Any:
    """Return `value` with numpy scalars, arrays, tuples and sets converted for `json`; NaN and infinity become None.

    Other objects are converted with `as_dict` if they have it, otherwise with `str`.
    """
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if isinstance(value, (set, frozenset)):
        # the order of a set of strings differs between processes
        return sorted((jsonable(v) for v in value), key=repr)
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int, bool)):
        return value
    as_dict = getattr(value, "as_dict", None)
    return jsonable(as_dict()) if callable(as_dict) else str(value)


class NavError(Exception):
    """Base class of all errors that navstack raises.

    `message` describes the problem, the value and how to fix it. `data` contains the details by name. `code` is the number of
    the result, `name` its symbol (as in Nav2's interfaces: `NO_VALID_PATH`).
    """

    code: ClassVar[int] = 9000
    name: ClassVar[str] = "UNKNOWN"

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(message)
        self.message = message
        self.data = data

    def as_dict(self) -> dict[str, Any]:
        """Return `{"code", "name", "message", ..data}` for JSON."""
        return {**jsonable(self.data), "code": self.code, "name": self.name, "message": self.message}

    def __reduce__(self) -> tuple[Any, ...]:
        return (_rebuild, (type(self), self.message, self.data))


def _rebuild(cls: type[NavError], message: str, data: dict[str, Any]) -> NavError:
    return cls(message, **data)


# --- input ------------------------------------------------------------------------------------------------------------


class InputError(NavError):
    """An argument, a file or a parameter is invalid."""

    code = 9001
    name = "INVALID_INPUT"


class MapError(InputError):
    """The YAML file or the image of a map is invalid."""

    code = 9002
    name = "INVALID_MAP"


class ParameterError(InputError):
    """Parameters are invalid. `data["findings"]` lists the problems with file, line and column."""

    code = 9003
    name = "INVALID_PARAMETERS"


class UnknownPluginError(ParameterError):
    """No plugin of this kind has this name. The message suggests similar names."""

    code = 9004
    name = "UNKNOWN_PLUGIN"


class OutputError(InputError):
    """A result cannot be written to the given path."""

    code = 9005
    name = "CANNOT_WRITE"


class RecordError(InputError):
    """A recorded run cannot be read."""

    code = 9006
    name = "INVALID_RECORD"


class ScenarioError(InputError):
    """A scenario file is invalid. `data["findings"]` lists the problems with file, line and column."""

    code = 9007
    name = "INVALID_SCENARIO"


class NotSupportedError(InputError):
    """navstack has no part that does what was asked; the message names an alternative."""

    code = 9008
    name = "NOT_SUPPORTED"


class LogError(InputError):
    """A recorded log (bag, MCAP) cannot be read, or lacks what was asked for. `data["offset"]` is the byte, if known."""

    code = 9009
    name = "INVALID_LOG"


# --- frames -----------------------------------------------------------------------------------------------------------


class FrameError(NavError):
    """Two frames are not connected at the requested time."""

    code = 102
    name = "TF_ERROR"


# --- sensors ----------------------------------------------------------------------------------------------------------


class BlindSensorError(NavError):
    """The messages of a sensor arrive, but hold nothing that could show an obstacle."""

    code = 9026
    name = "SENSOR_BLIND"


# --- planning ---------------------------------------------------------------------------------------------------------


class PlanningError(NavError):
    """A global planner found no plan."""

    code = 200
    name = "PLANNING_FAILED"


class StartOutsideMapError(PlanningError):
    """The start is outside the costmap."""

    code = 203
    name = "START_OUTSIDE_MAP"


class GoalOutsideMapError(PlanningError):
    """The goal is outside the costmap."""

    code = 204
    name = "GOAL_OUTSIDE_MAP"


class StartOccupiedError(PlanningError):
    """The cell of the start is occupied."""

    code = 205
    name = "START_OCCUPIED"


class GoalOccupiedError(PlanningError):
    """The cell of the goal is occupied."""

    code = 206
    name = "GOAL_OCCUPIED"


class PlanningTimeoutError(PlanningError):
    """The planner exceeded its time limit."""

    code = 207
    name = "TIMEOUT"


class NoValidPathError(PlanningError):
    """Start and goal are free, but no path connects them."""

    code = 208
    name = "NO_VALID_PATH"


# --- control ----------------------------------------------------------------------------------------------------------


class ControlError(NavError):
    """A local planner found no command."""

    code = 100
    name = "CONTROL_FAILED"


class InvalidPathError(ControlError):
    """The local planner cannot follow the plan: it is empty, not finite, or too far away."""

    code = 103
    name = "INVALID_PATH"


class NoValidControlError(ControlError):
    """All velocity samples were rejected; `data` contains the critics that rejected them."""

    code = 106
    name = "NO_VALID_CONTROL"


# --- recovery ---------------------------------------------------------------------------------------------------------


class RecoveryError(NavError):
    """A recovery behavior failed."""

    code = 700
    name = "RECOVERY_FAILED"


class CollisionAheadError(RecoveryError):
    """A recovery behavior stopped because its motion would cause a collision."""

    code = 703
    name = "COLLISION_AHEAD"


# --- goals ------------------------------------------------------------------------------------------------------------


class GoalTransitionError(NavError):
    """A goal cannot change from its current status to the requested one."""

    code = 9010
    name = "ILLEGAL_TRANSITION"


class InternalError(NavError):
    """A plugin violated its contract, or navstack has a bug."""

    code = 9099
    name = "INTERNAL"
