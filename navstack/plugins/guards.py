"""What stands between navstack and a plugin: its name, the error for what it raised, and the limits that its commands keep."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Mapping
from functools import wraps
from math import hypot, isfinite
from pathlib import Path as FilePath
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from navstack.core import InternalError, NavError, Pose2D, Transform2D, Twist2D
from navstack.plugins.rollouts import VelocityLimits

if TYPE_CHECKING:
    from navstack.plugins.local_planner import LocalPlanner

_LIBRARIES: Final = frozenset(
    {*sys.stdlib_module_names, "numpy", "numba", "scipy", "shapely", "pydantic", "pydantic_core"}
)
"""Packages whose frames are skipped in the search for the line of a plugin that raised."""
_GUARDS: Final = frozenset({__name__, "navstack.move_base.plugin_calls"})
"""Modules whose frames are not part of a plugin's traceback."""


def shown(value: object) -> str:
    """Return the beginning of a value's text for a message, whatever the value is."""
    try:
        return " ".join(f"{value!r:.100}".split())
    except Exception:
        return f"a {type(value).__name__}"


def broken_contract(plugin: object, problem: str) -> InternalError:
    """Return the error of a plugin that returned or did what it must not; `problem` follows its name."""
    name = name_of(plugin)
    return InternalError(f"{name} {problem}; please report this to its author", plugin=name)


def name_of(plugin: object) -> str:
    """Return the instance name of a recovery behavior or a costmap, the class name of any other plugin."""
    if isinstance(plugin, type):
        return plugin.__name__
    name = getattr(plugin, "name", None)
    return name if isinstance(name, str) else type(plugin).__name__


def plugin_error(plugin: object, exc: BaseException) -> InternalError:
    """Return an InternalError for an exception raised by a plugin.

    The message has the plugin's name, the exception, and the file and line of the deepest frame outside of the standard
    library and of navstack's dependencies. `data["traceback"]` has the traceback. File names are relative to their entry of
    `sys.path`, so that records do not depend on where a plugin is installed.
    """
    frames = _frames(exc.__traceback__)
    own = [frame for module, frame in frames if module.partition(".")[0] not in _LIBRARIES] or [f for _, f in frames]
    text = str(exc)
    exception = f"{type(exc).__name__}: {text}" if text else type(exc).__name__
    where = f"{own[-1].filename}:{own[-1].lineno}" if own else "unknown location"
    listing = traceback.format_list([frame for _, frame in frames]) + traceback.format_exception_only(exc)
    return InternalError(
        f"{name_of(plugin)} raised {exception} ({where})",
        plugin=name_of(plugin),
        exception=exception,
        location=where,
        traceback="".join(["Traceback (most recent call last):\n", *listing]),
    )


def _frames(trace: TracebackType | None) -> list[tuple[str, traceback.FrameSummary]]:
    """Return the module name and the summary of every frame but those of guards, the deepest last."""
    found: list[tuple[str, traceback.FrameSummary]] = []
    for (frame, _), at in zip(traceback.walk_tb(trace), traceback.extract_tb(trace)):
        module = str(frame.f_globals.get("__name__", ""))
        if module not in _GUARDS:
            found.append(
                (module, traceback.FrameSummary(_relative(at.filename), at.lineno, at.name, line=at.line or ""))
            )
    return found


def _relative(file: str) -> str:
    """Return a file name relative to the longest entry of `sys.path` that contains it."""
    roots = [root for root in sys.path if root and FilePath(file).is_relative_to(root)]
    return FilePath(file).relative_to(max(roots, key=len)).as_posix() if roots else file


# --- results of plugins that other plugins and the simulator call -----------------------------------------------------


def check_results(cls: type, checks: Mapping[str, Callable[[Any], str]]) -> None:
    """Let methods and properties that a class defines raise an InternalError instead of returning something wrong.

    A check returns what is wrong with a result, or "". Exceptions become an InternalError, too, which names the plugin; for
    `__init_subclass__` of a base class, so that no caller can forget it. MoveBase checks the plugins that it calls itself.
    """
    for name, check in checks.items():
        member = cls.__dict__.get(name)
        if isinstance(member, property) and member.fget is not None:
            setattr(cls, name, property(_checked(member.fget, name, check), member.fset, member.fdel, member.__doc__))
        elif callable(member) and not getattr(member, "__isabstractmethod__", False):
            setattr(cls, name, _checked(member, name, check))


def _checked(method: Callable[..., Any], name: str, check: Callable[[Any], str]) -> Callable[..., Any]:
    @wraps(method)
    def call(self: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            value = method(self, *args, **kwargs)
            problem = check(value)
        except NavError:
            raise
        except Exception as exc:
            raise plugin_error(self, exc) from exc
        if problem:
            raise broken_contract(self, f"returned {shown(value)} from {name}, {problem}")
        return value

    return call


def truth_problem(value: Any) -> str:
    """Return what is wrong with a truth value: only True and False are."""
    return "" if value is True or value is False or isinstance(value, np.bool_) else "which is not True or False"


def number_problem(value: Any) -> str:
    """Return what is wrong with a number, which may be infinite."""
    numbers = isinstance(value, (float, int, np.floating, np.integer)) and not isinstance(value, bool)
    return "" if numbers and value == value else "which is not a number"


def pose_problem(value: Any) -> str:
    """Return what is wrong with a pose."""
    if not isinstance(value, (Pose2D, Transform2D)):
        return "which is not a pose"
    return "" if isfinite(value[0] + value[1] + value[2]) else "which is not finite"


# --- commands ---------------------------------------------------------------------------------------------------------


def limits_of(planner: LocalPlanner) -> VelocityLimits:
    """Return the current limits of a local planner, which are numbers. Raises NavError."""
    try:
        limits: Any = planner.limits
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(planner, exc) from exc
    if not isinstance(limits, VelocityLimits):
        raise broken_contract(planner, f"has limits of type {type(limits).__name__}, not VelocityLimits")
    try:
        total: Any = sum(limits)  # one sum instead of thirteen tests
    except Exception:
        total = None
    if not isinstance(total, (float, int, np.floating)):
        raise broken_contract(planner, f"has limits that are not numbers: {shown(tuple(limits))}")
    return limits


SLACK: Final = 1.02
"""Commands may be faster by this factor than the limits: rounding, and the noise of the odometry."""
LINEAR_SLACK: Final = 0.02
"""m/s."""
ANGULAR_SLACK: Final = 0.05
"""rad/s."""
FASTEST: Final = 100.0
"""Fastest possible command (m/s and rad/s) of a robot without limits."""


class CommandLimits:
    """Compares commands with the limits of the robot, which are those of its local planner.

    A command that is faster is allowed if the robot moves as fast already: it brakes, or it was pushed. Limits that were
    lowered for a while do not count, since a robot needs time to brake.
    """

    def __init__(self, planner: LocalPlanner) -> None:
        self.planner = planner
        self._linear = self._angular = -1.0
        """Largest limits seen (m/s, rad/s)."""

    def check(self, plugin: object, command: Twist2D, velocity: Twist2D, own: tuple[float, float] = (0.0, 0.0)) -> None:
        """Raise InternalError for a command of `plugin` that is faster than the limits and the current `velocity`.

        `own`: linear and angular speed (m/s, rad/s) that the parameters of the plugin allow, whatever the limits are.
        """
        vx, vy, wz = command
        speed, turn = hypot(vx, vy), abs(wz)
        if speed <= self._linear and turn <= self._angular:
            return
        self._read()
        linear, angular = max(self._linear, own[0]), max(self._angular, own[1])
        allowed = max(linear, hypot(velocity[0], velocity[1])) * SLACK + LINEAR_SLACK
        allowed_turn = max(angular, abs(velocity[2])) * SLACK + ANGULAR_SLACK
        if not (speed <= allowed and turn <= allowed_turn):
            problem = (
                f"commands {speed:.3g} m/s and {turn:.3g} rad/s, beyond the limits of the robot ({linear:.3g} m/s, "
                f"{angular:.3g} rad/s)"
            )
            raise broken_contract(plugin, problem)

    def _read(self) -> None:
        limits = limits_of(self.planner)
        x = max(abs(limits.max_vel_x), abs(limits.min_vel_x))
        y = max(abs(limits.max_vel_y), abs(limits.min_vel_y))
        # `min` also replaces infinity
        self._linear = max(self._linear, min(max(hypot(x, y), abs(limits.max_vel_trans)), FASTEST))
        self._angular = max(self._angular, min(max(abs(limits.max_vel_theta), abs(limits.min_vel_theta)), FASTEST))


def own_speeds(params: Any) -> tuple[float, float]:
    """Return the largest speeds (m/s, rad/s) among the parameters of a plugin; 0 without any."""
    speeds = {"m/s": 0.0, "rad/s": 0.0}
    for name, field in getattr(type(params), "model_fields", {}).items():
        extra: Any = field.json_schema_extra
        unit = extra.get("unit") if isinstance(extra, dict) else None
        value: Any = getattr(params, name, None)
        if unit in speeds and isinstance(value, (int, float)):
            speeds[unit] = max(speeds[unit], abs(value))
    return speeds["m/s"], speeds["rad/s"]
