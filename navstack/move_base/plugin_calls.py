"""The guard around every call into a plugin, a costmap or the robot: the result is valid, or the call raises a NavError.

A plugin may raise any exception and return any value. `call` turns exceptions into an InternalError that names the plugin,
its file and line; a `check` is what a result must be, and all of them are here, but for the steps of a behavior, which
`BehaviorRunner` checks for robots without a goal manager, too.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from math import isfinite
from pathlib import Path as FilePath
from types import TracebackType
from typing import Any, Final, TypeVar, TypeVarTuple, overload

import numpy as np

from navstack.core import (
    Costmap,
    Footprint,
    InputError,
    InternalError,
    NavError,
    PlanningError,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
)
from navstack.plugins import (
    GlobalPlanner,
    LocalizationStatus,
    LocalPlan,
    LocalPlanner,
    Plan,
    Robot,
    VelocityLimits,
)

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

_LIBRARIES: Final = frozenset(
    {*sys.stdlib_module_names, "numpy", "numba", "scipy", "shapely", "pydantic", "pydantic_core"}
)
"""Packages whose frames are skipped in the search for the line of a plugin that raised."""


@overload
def call(plugin: object, method: Callable[[*Ts], T], *args: *Ts) -> T: ...


@overload
def call(plugin: object, method: Callable[[*Ts], Any], *args: *Ts, check: Callable[[Any], T]) -> T: ...


def call(plugin: object, method: Callable[[*Ts], Any], *args: *Ts, check: Callable[[Any], Any] | None = None) -> Any:
    """Call a method of a plugin and return its result, as `check(result)` returns it.

    Raises NavErrors of the plugin unchanged, any other exception and a wrong result as an InternalError.
    """
    try:
        value = method(*args)
        return value if check is None else check(value)
    except NavError:
        raise
    except WrongResultError as exc:
        raise exc.of(plugin) from None
    except Exception as exc:
        raise plugin_error(plugin, exc) from exc


def make_plan(
    planner: GlobalPlanner,
    costmap: Costmap,
    start: Pose2D,
    goal: Pose2D,
    footprint: Footprint | None,
    *,
    keep_potential: bool = False,
) -> Plan:
    """Return a plan that is not empty, is finite and in the costmap's frame. Raises NavError."""

    def request() -> Plan:
        return planner.make_plan(costmap, start, goal, footprint=footprint, keep_potential=keep_potential)

    plan = call(planner, request, check=checked_plan)
    if plan.path.frame != costmap.frame:
        frames = f'in the frame "{plan.path.frame}", not in the costmap\'s frame "{costmap.frame}"'
        raise _broken_contract(planner, f"returned a plan {frames}")
    return plan


def lookup_transform(robot: Robot, target: str, source: str, now: float, tolerance_s: float) -> Transform2D:
    """Return the transform from the frame `source` to the frame `target` at `now` (s), at most `tolerance_s` old.

    Raises NavError.
    """
    return call(robot, _lookup, robot, target, source, now, tolerance_s)


def _lookup(robot: Robot, target: str, source: str, now: float, tolerance_s: float) -> Transform2D:
    return robot.frames.lookup(target, source, now, tolerance_s)


def limits_of(planner: LocalPlanner) -> VelocityLimits:
    """Return the present limits of the local planner. Raises NavError."""
    return call(planner, getattr, planner, "limits", check=checked_limits)


def localization_status(robot: Robot) -> LocalizationStatus | None:
    """Return whether the robot is lost; None for a robot that does not report it. Raises NavError."""
    return call(robot, getattr, robot, "localization_status", None, check=checked_status)


# --- checks of results ------------------------------------------------------------------------------------------------


class WrongResultError(Exception):
    """What is wrong with the result of a plugin. `call` turns it into a NavError that names the plugin."""

    def __init__(self, problem: str, kind: type[NavError] = InternalError, **data: Any) -> None:
        """`problem` follows the name of the plugin, or contains it as {plugin}."""
        super().__init__(problem)
        self.problem = problem
        self.kind = kind
        self.data = data

    def of(self, plugin: object) -> NavError:
        """Return the error with the name of the plugin."""
        name = name_of(plugin)
        if self.data:
            return self.kind(self.problem.replace("{plugin}", name), **self.data)
        if self.kind is not InternalError:
            return self.kind(f"{name} {self.problem}", planner=name)
        return _broken_contract(plugin, self.problem)


def checked_pose(pose: Any) -> Pose2D:
    """Return the robot's pose if it is finite."""
    if not isinstance(pose, Pose2D):
        raise WrongResultError(f"returned a {type(pose).__name__}, not a Pose2D")
    # a finite sum has finite terms; the terms of another one may be finite all the same
    if not isfinite(pose[0] + pose[1] + pose[2]) and not pose.is_finite():
        raise WrongResultError(f"the robot's pose {tuple(pose)} in {{plugin}} is not finite", pose=pose)
    return pose


def checked_state(state: Any) -> RobotState:
    """Return the robot's odometry if its velocity is finite."""
    if not isinstance(state, RobotState):
        raise WrongResultError(f"returned a {type(state).__name__}, not a RobotState")
    velocity = state.velocity
    if not isfinite(velocity[0] + velocity[1] + velocity[2]) and not velocity.is_finite():
        text = f"the robot's velocity {tuple(velocity)} is not finite"
        raise WrongResultError(text, velocity=velocity, pose=state.pose)
    return state


def checked_status(status: Any) -> LocalizationStatus | None:
    """Return whether the robot is lost; None for a robot that does not report it."""
    if status is None or isinstance(status, LocalizationStatus):
        return status
    raise WrongResultError(f"has a localization_status of type {type(status).__name__}, not LocalizationStatus")


def checked_plan(plan: Any) -> Plan:
    """Return a plan if it is not empty and finite."""
    if plan is None:
        raise WrongResultError("returned None instead of a plan or an error", PlanningError)
    if not isinstance(plan, Plan):
        raise WrongResultError(f"returned a {type(plan).__name__}, not a Plan")
    if len(plan.path) == 0:
        raise WrongResultError("returned an empty plan", PlanningError)
    if not np.isfinite(plan.path.poses).all() or not plan.goal.is_finite():
        raise WrongResultError("returned a plan that is not finite")
    return plan


def checked_limits(limits: Any) -> VelocityLimits:
    """Return the limits of a local planner."""
    if not isinstance(limits, VelocityLimits):
        raise WrongResultError(f"has limits of type {type(limits).__name__}, not VelocityLimits")
    return limits


def checked_local_plan(plan: Any) -> LocalPlan:
    """Return a local plan if its command is finite."""
    if not isinstance(plan, LocalPlan):
        raise WrongResultError(f"returned a {type(plan).__name__}, not a LocalPlan")
    twist: Any = plan.command
    try:
        # see checked_pose
        valid = isinstance(twist, Twist2D) and (isfinite(twist[0] + twist[1] + twist[2]) or twist.is_finite())
    except TypeError:  # a component is not a number
        valid = False
    if not valid:
        raise WrongResultError(f"commands {twist}, which is not a Twist2D of three finite numbers")
    return plan


def checked_braking(plan: Any) -> LocalPlan | None:
    """Return a local plan that brakes if its command is finite; None to stop at once."""
    return None if plan is None else checked_local_plan(plan)


def check_plugin(plugin: Any, kind: type) -> None:
    """Raise InputError unless `plugin` is None or of the given kind."""
    if plugin is not None and not isinstance(plugin, kind):
        raise InputError(f"{type(plugin).__name__} is not a {kind.__name__}; the previous one remains in use")


def _broken_contract(plugin: object, problem: str) -> InternalError:
    name = name_of(plugin)
    return InternalError(f"{name} {problem}; please report this to its author", plugin=name)


# --- errors -----------------------------------------------------------------------------------------------------------


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
    """Return the module name and the summary of every frame below this module, the deepest last."""
    found: list[tuple[str, traceback.FrameSummary]] = []
    for (frame, _), at in zip(traceback.walk_tb(trace), traceback.extract_tb(trace)):
        module = str(frame.f_globals.get("__name__", ""))
        if module != __name__:
            found.append(
                (module, traceback.FrameSummary(_relative(at.filename), at.lineno, at.name, line=at.line or ""))
            )
    return found


def _relative(file: str) -> str:
    """Return a file name relative to the longest entry of `sys.path` that contains it."""
    roots = [root for root in sys.path if root and FilePath(file).is_relative_to(root)]
    return FilePath(file).relative_to(max(roots, key=len)).as_posix() if roots else file
