"""Every call into a plugin, a costmap or the robot: the result is valid, or the call raises a NavError.

A plugin may raise any exception and return any value. `call` turns exceptions into an InternalError that names the plugin,
its file and line; the functions below also check what a plugin returns. Those of the control cycle do not use `call`, which
costs 0.07 us: with it, the goal manager takes 5 % longer.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path as FilePath
from types import TracebackType
from typing import Any, Final, TypeVar, TypeVarTuple

import numpy as np

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Transform2D, Twist2D
from navstack.core.errors import InputError, InternalError, NavError, PlanningError
from navstack.interfaces import (
    ControlInput,
    CostmapServer,
    GlobalPlanner,
    LocalizationStatus,
    LocalPlan,
    LocalPlanner,
    Plan,
    RecoveryBehavior,
    RecoveryContext,
    RecoveryStep,
    Robot,
    VelocityLimits,
)

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

DEFAULT_TOLERANCE_S: Final = 0.3
"""Default of transform_tolerance of a costmap."""

_LIBRARIES: Final = frozenset(
    {*sys.stdlib_module_names, "numpy", "numba", "scipy", "shapely", "pydantic", "pydantic_core"}
)
"""Packages whose frames are skipped in the search for the line of a plugin that raised."""


def call(plugin: object, method: Callable[[*Ts], T], *args: *Ts) -> T:
    """Call a method of a plugin. Raises NavErrors of the plugin unchanged, any other exception as an InternalError."""
    try:
        return method(*args)
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(plugin, exc) from exc


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
    """Return the module name and the summary of every frame below `call`, the deepest last."""
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


def _broken_contract(plugin: object, problem: str) -> InternalError:
    name = name_of(plugin)
    return InternalError(f"{name} {problem}; please report this to its author", plugin=name)


# --- global planner ---------------------------------------------------------------------------------------------------


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

    def request() -> Any:
        return planner.make_plan(costmap, start, goal, footprint=footprint, keep_potential=keep_potential)

    plan = call(planner, request)
    name = name_of(planner)
    if plan is None:
        raise PlanningError(f"{name} returned None instead of a plan or an error", planner=name)
    if not isinstance(plan, Plan):
        raise _broken_contract(planner, f"returned a {type(plan).__name__}, not a Plan")
    if len(plan.path) == 0:
        raise PlanningError(f"{name} returned an empty plan", planner=name)
    if not np.isfinite(plan.path.poses).all() or not plan.goal.is_finite():
        raise _broken_contract(planner, "returned a plan that is not finite")
    if plan.path.frame != costmap.frame:
        frames = f'in the frame "{plan.path.frame}", not in the costmap\'s frame "{costmap.frame}"'
        raise _broken_contract(planner, f"returned a plan {frames}")
    return plan


# --- local planner ----------------------------------------------------------------------------------------------------


def set_plan(planner: LocalPlanner, plan: Plan) -> None:
    """Pass a plan to the local planner. Raises NavError if the planner rejects it."""
    call(planner, planner.set_plan, plan.path, plan.goal)


def compute_command(planner: LocalPlanner, inputs: ControlInput) -> LocalPlan:
    """Return a local plan with a finite command. Raises NavError."""
    return _checked_plan(planner, call(planner, planner.compute_command, inputs))


def brake(planner: LocalPlanner, inputs: ControlInput) -> LocalPlan | None:
    """Return a local plan with a finite command that brakes, None to stop at once. Raises NavError."""
    plan: Any = call(planner, planner.brake, inputs)
    return None if plan is None else _checked_plan(planner, plan)


def _checked_plan(planner: LocalPlanner, plan: Any) -> LocalPlan:
    if not isinstance(plan, LocalPlan):
        raise _broken_contract(planner, f"returned a {type(plan).__name__}, not a LocalPlan")
    _check_command(planner, plan.command)
    return plan


def goal_reached(planner: LocalPlanner, inputs: ControlInput) -> bool:
    """Return True if the local planner reports that the goal is reached. Raises NavError."""
    try:
        return bool(planner.goal_reached(inputs))
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(planner, exc) from exc


def limits_of(planner: LocalPlanner) -> VelocityLimits:
    """Return the present limits of the local planner. Raises NavError."""
    return call(planner, lambda: planner.limits)


def set_limits(planner: LocalPlanner, max_vel_trans: float | None, max_vel_theta: float | None) -> None:
    """Set the speed limits of the local planner (m/s, rad/s); None restores the limit of the parameters. Raises NavError."""
    call(planner, lambda: planner.set_limits(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta))


# --- recovery behaviors -----------------------------------------------------------------------------------------------


def start_recovery(recovery: RecoveryBehavior, context: RecoveryContext, now: float) -> float | None:
    """Start a recovery behavior at `now` (s); return the rate of its steps (Hz), None for the default. Raises NavError."""

    def start() -> float | None:
        recovery.start(context, now)
        return recovery.frequency

    return call(recovery, start)


def recovery_step(recovery: RecoveryBehavior, state: RobotState, now: float) -> RecoveryStep:
    """Return a step with a finite velocity. Raises NavError."""
    step: Any = call(recovery, recovery.step, state, now)
    if not isinstance(step, RecoveryStep):
        raise _broken_contract(recovery, f"returned a {type(step).__name__}, not a RecoveryStep")
    _check_command(recovery, step.twist)
    return step


def follow_up(recovery: RecoveryBehavior, state: RobotState, now: float) -> bool:
    """Return True while the effects of a recovery behavior last after its end. Raises NavError."""
    return bool(call(recovery, recovery.follow_up, state, now))


# --- costmaps and robot -----------------------------------------------------------------------------------------------


def robot_pose(costmap: CostmapServer, now: float) -> Pose2D:
    """Return the finite pose of the robot in the costmap's frame at `now` (s). Raises NavError."""
    try:
        pose = costmap.robot_pose(now)
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(costmap, exc) from exc
    if not pose.is_finite():
        raise InternalError(f"the robot's pose {tuple(pose)} in {costmap.name} is not finite", pose=pose)
    return pose


def is_current(costmap: CostmapServer, now: float) -> bool:
    """Return False if a sensor of the costmap is stale at `now` (s). Raises NavError."""
    try:
        return bool(costmap.is_current(now))
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(costmap, exc) from exc


def send_command(robot: Robot, twist: Twist2D) -> None:
    """Send a command to the robot. Raises NavError."""
    try:
        robot.command(twist)
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(robot, exc) from exc


def localization_status(robot: Robot) -> LocalizationStatus | None:
    """Return whether the robot is lost; None for a robot that does not report it. Raises NavError."""
    status = call(robot, lambda: getattr(robot, "localization_status", None))
    if status is None or isinstance(status, LocalizationStatus):
        return status
    raise _broken_contract(robot, f"has a localization_status of type {type(status).__name__}, not LocalizationStatus")


def robot_state(robot: Robot) -> RobotState:
    """Return the robot's odometry, with a finite velocity. Raises NavError."""
    try:
        state = robot.state()
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(robot, exc) from exc
    if not state.velocity.is_finite():
        raise InternalError(
            f"the robot's velocity {tuple(state.velocity)} is not finite", velocity=state.velocity, pose=state.pose
        )
    return state


def transform_tolerance(costmap: CostmapServer) -> float:
    """Return the largest age (s) of a transform that a costmap accepts; the default for a server without the parameter."""
    return float(getattr(getattr(costmap, "params", None), "transform_tolerance", DEFAULT_TOLERANCE_S))


def lookup_transform(robot: Robot, target: str, source: str, now: float, tolerance_s: float) -> Transform2D:
    """Return the transform from the frame `source` to the frame `target` at `now` (s), at most `tolerance_s` old.

    Raises NavError.
    """
    try:
        return robot.frames.lookup(target, source, now, tolerance_s)
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(robot, exc) from exc


# --- checks -----------------------------------------------------------------------------------------------------------


def check_plugin(plugin: Any, kind: type) -> None:
    """Raise InputError unless `plugin` is None or of the given kind."""
    if plugin is not None and not isinstance(plugin, kind):
        raise InputError(f"{type(plugin).__name__} is not a {kind.__name__}; the previous one remains in use")


def _check_command(plugin: object, twist: Any) -> None:
    try:
        valid = isinstance(twist, Twist2D) and twist.is_finite()
    except TypeError:  # a component is not a number
        valid = False
    if not valid:
        raise _broken_contract(plugin, f"commands {twist}, which is not a Twist2D of three finite numbers")
