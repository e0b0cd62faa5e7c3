"""One tree of exceptions: every failure carries a code, a message a user can act on, and the data behind it.

Codes are those of Nav2's action results where Nav2 has one (ComputePathToPose 2xx, FollowPath 1xx, Spin 7xx); what only
navstack knows starts at 9000.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np


def jsonable(value: Any) -> Any:
    """`value` with numpy scalars, arrays, tuples and paths turned into what `json` writes; not-a-number becomes None.

    An object that has `as_dict` is asked for it; of others remains what `str` says.
    """
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if isinstance(value, (set, frozenset)):
        # the order of a set of names differs from process to process
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
    """Base of everything navstack raises on purpose.

    `message` says what was wrong, with which value, and the way out. `data` holds what explains it, by name.
    `code` is the number of the result, `name` its symbol (as in Nav2's interfaces: `NO_VALID_PATH`).
    """

    code: ClassVar[int] = 9000
    name: ClassVar[str] = "UNKNOWN"

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(message)
        self.message = message
        self.data = data

    def as_dict(self) -> dict[str, Any]:
        """`{"code", "name", "message", ..data}`, ready for JSON."""
        return {**jsonable(self.data), "code": self.code, "name": self.name, "message": self.message}

    def __reduce__(self) -> tuple[Any, ...]:
        return (_rebuild, (type(self), self.message, self.data))


def _rebuild(cls: type[NavError], message: str, data: dict[str, Any]) -> NavError:
    return cls(message, **data)


# --- input ------------------------------------------------------------------------------------------------------------


class InputError(NavError):
    """What the user gave cannot be used: an argument, a file, a parameter."""

    code = 9001
    name = "INVALID_INPUT"


class MapError(InputError):
    """A map's YAML or image cannot be used."""

    code = 9002
    name = "INVALID_MAP"


class ParameterError(InputError):
    """Parameters cannot be used. `data["findings"]` lists every reason, with file, line and column."""

    code = 9003
    name = "INVALID_PARAMETERS"


class UnknownPluginError(ParameterError):
    """No plugin of that kind has that name. The message says what was meant and what there is."""

    code = 9004
    name = "UNKNOWN_PLUGIN"


class OutputError(InputError):
    """A result cannot be written where the user asked for it."""

    code = 9005
    name = "CANNOT_WRITE"


class RecordError(InputError):
    """A recorded run cannot be read."""

    code = 9006
    name = "INVALID_RECORD"


class ScenarioError(InputError):
    """A scenario file cannot be used. `data["findings"]` lists every reason, with file, line and column."""

    code = 9007
    name = "INVALID_SCENARIO"


# --- frames -----------------------------------------------------------------------------------------------------------


class FrameError(NavError):
    """Two frames are not connected, or not at that time."""

    code = 102
    name = "TF_ERROR"


# --- planning ---------------------------------------------------------------------------------------------------------


class PlanningError(NavError):
    """A global planner has no plan to give."""

    code = 200
    name = "PLANNING_FAILED"


class StartOutsideMapError(PlanningError):
    """The start lies outside the costmap."""

    code = 203
    name = "START_OUTSIDE_MAP"


class GoalOutsideMapError(PlanningError):
    """The goal lies outside the costmap."""

    code = 204
    name = "GOAL_OUTSIDE_MAP"


class StartOccupiedError(PlanningError):
    """The robot's centre cannot be where it starts."""

    code = 205
    name = "START_OCCUPIED"


class GoalOccupiedError(PlanningError):
    """The robot's centre cannot be where it is to go."""

    code = 206
    name = "GOAL_OCCUPIED"


class PlanningTimeoutError(PlanningError):
    """The planner took longer than it may."""

    code = 207
    name = "TIMEOUT"


class NoValidPathError(PlanningError):
    """Start and goal are free, but nothing connects them."""

    code = 208
    name = "NO_VALID_PATH"


# --- control ----------------------------------------------------------------------------------------------------------


class ControlError(NavError):
    """A local planner has no command to give."""

    code = 100
    name = "CONTROL_FAILED"


class InvalidPathError(ControlError):
    """The plan handed to the local planner cannot be followed: empty, not finite, or out of reach."""

    code = 103
    name = "INVALID_PATH"


class NoValidControlError(ControlError):
    """Every sampled velocity was rejected; `data` says by which critic."""

    code = 106
    name = "NO_VALID_CONTROL"


# --- recovery ---------------------------------------------------------------------------------------------------------


class RecoveryError(NavError):
    """A recovery behaviour could not do its work."""

    code = 700
    name = "RECOVERY_FAILED"


class CollisionAheadError(RecoveryError):
    """A recovery behaviour stopped because its motion would hit something."""

    code = 703
    name = "COLLISION_AHEAD"


# --- goals ------------------------------------------------------------------------------------------------------------


class GoalTransitionError(NavError):
    """A goal cannot go from its present status to the one asked for."""

    code = 9010
    name = "ILLEGAL_TRANSITION"


class InternalError(NavError):
    """A plugin broke its contract, or navstack has a bug."""

    code = 9099
    name = "INTERNAL"
