"""The guard around every call into a plugin, a costmap or the robot: the result is valid, or the call raises a NavError.

A plugin may raise any exception and return any value. `call` turns exceptions into an InternalError that names the plugin,
its file and line; a `check` is what a result must be, and all of them are here, but for the steps of a behavior, which
`BehaviorRunner` checks for robots without a goal manager, too, and what layers do to the grid, which `LayeredCostmap` checks
after each layer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, TypeVar, TypeVarTuple, overload

import numpy as np

from navstack.core import (
    Costmap,
    Footprint,
    InputError,
    InternalError,
    NavError,
    Path,
    PlanningError,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.plugins import (
    CommandLimits,
    ControlInput,
    GlobalPlanner,
    Inflation,
    LocalizationStatus,
    LocalPlan,
    LocalPlanner,
    Plan,
    Robot,
    broken_contract,
    name_of,
    plugin_error,
    shown,
)

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


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
        raise broken_contract(planner, f"returned a plan {frames}")
    return plan


def lookup_transform(robot: Robot, target: str, source: str, now: float, tolerance_s: float) -> Transform2D:
    """Return the transform from the frame `source` to the frame `target` at `now` (s), at most `tolerance_s` old.

    Raises NavError.
    """
    return call(robot, _lookup, robot, target, source, now, tolerance_s, check=checked_transform)


def _lookup(robot: Robot, target: str, source: str, now: float, tolerance_s: float) -> Transform2D:
    return robot.frames.lookup(target, source, now, tolerance_s)


def compute_command(planner: LocalPlanner, inputs: ControlInput, limits: CommandLimits) -> LocalPlan:
    """Return the local planner's command, which is finite and keeps the `limits`. Raises NavError."""
    plan = call(planner, planner.compute_command, inputs, check=checked_local_plan)
    limits.check(planner, plan.command, inputs.state.velocity)
    return plan


def brake(planner: LocalPlanner, inputs: ControlInput, limits: CommandLimits) -> LocalPlan | None:
    """Return the local planner's command to brake; None to stop at once. Raises NavError."""
    plan = call(planner, planner.brake, inputs, check=checked_braking)
    if plan is not None:
        limits.check(planner, plan.command, inputs.state.velocity)
    return plan


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
        return broken_contract(plugin, self.problem)


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


def checked_transform(transform: Any) -> Transform2D:
    """Return a transform if it is finite."""
    if not isinstance(transform, Transform2D):
        raise WrongResultError(f"returned a {type(transform).__name__}, not a Transform2D")
    if not isfinite(transform[0] + transform[1] + transform[2]):
        raise WrongResultError(f"returned the transform {tuple(transform)}, which is not finite")
    return transform


def checked_flag(value: Any) -> bool:
    """Return a truth value: True or False, not what counts as one."""
    if value is True or value is False:
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    raise WrongResultError(f"returned {shown(value)}, a {type(value).__name__}, not True or False")


def checked_plan(plan: Any) -> Plan:
    """Return a plan if it is not empty and finite."""
    if plan is None:
        raise WrongResultError("returned None instead of a plan or an error", PlanningError)
    if not isinstance(plan, Plan):
        raise WrongResultError(f"returned a {type(plan).__name__}, not a Plan")
    path = checked_path(plan.path)
    if path is not plan.path:
        plan = replace(plan, path=path)
    if len(plan.path) == 0:
        raise WrongResultError("returned an empty plan", PlanningError)
    if not isinstance(plan.goal, Pose2D) or not all(map(_is_number, (*plan.goal, plan.cost, plan.goal_moved_m))):
        raise WrongResultError("returned a plan whose goal is no Pose2D, or whose goal or cost are no numbers")
    if not np.isfinite(plan.path.poses).all() or not plan.goal.is_finite():
        raise WrongResultError("returned a plan that is not finite")
    _check_array("a plan with a potential", plan.potential, 2)
    _check_notes(plan.notes)
    return plan


def checked_path(path: Any) -> Path:
    """Return a path of any length if its poses are an array (n, 3) of numbers, as float64."""
    if not isinstance(path, Path):
        raise WrongResultError(f"returned a plan with a path of type {type(path).__name__}, not Path")
    poses: Any = path.poses
    if not isinstance(poses, np.ndarray) or poses.dtype.kind not in "fiu" or poses.ndim != 2 or poses.shape[1] != 3:
        kind = f"{poses.dtype} of shape {poses.shape}" if isinstance(poses, np.ndarray) else type(poses).__name__
        raise WrongResultError(f"returned a path whose poses are {kind}, not float64 of shape (n, 3)")
    frame: Any = path.frame
    if not isinstance(frame, str):
        raise WrongResultError(f"returned a path in a frame of type {type(frame).__name__}, not str")
    return path if poses.dtype == np.float64 else Path(poses.astype(np.float64), path.frame)


def checked_local_plan(plan: Any) -> LocalPlan:
    """Return a local plan if its command is finite, and the arrays that explain it are arrays."""
    if not isinstance(plan, LocalPlan):
        raise WrongResultError(f"returned a {type(plan).__name__}, not a LocalPlan")
    twist: Any = plan.command
    # a finite sum of floats has finite terms; the terms of another one may be finite all the same
    if not isinstance(twist, Twist2D) or not (
        (type(twist[0]) is type(twist[1]) is type(twist[2]) is float and isfinite(twist[0] + twist[1] + twist[2]))
        or (all(map(_is_number, twist)) and twist.is_finite())
    ):
        raise WrongResultError(f"commands {twist}, which is not a Twist2D of three finite numbers")
    if plan.samples is not None:
        _check_array("a LocalPlan with samples", plan.samples, 2)
        _check_array("a LocalPlan with costs", plan.costs, 2)
        _check_array("a LocalPlan with totals", plan.totals, 1)
        _check_array("a LocalPlan with rejected_by", plan.rejected_by, 1)
        if not plan.best < len(plan.samples):
            raise WrongResultError(f"selects sample {plan.best} of {len(plan.samples)}")
    _check_array("a LocalPlan with a trajectory", plan.trajectory, 2)
    if plan.local_plan is not None:
        checked_path(plan.local_plan)
    if plan.notes:
        _check_notes(plan.notes)
    if type(plan.mode) is not str:
        raise WrongResultError(f"returned a LocalPlan with a mode of type {type(plan.mode).__name__}, not str")
    return plan


def checked_braking(plan: Any) -> LocalPlan | None:
    """Return a local plan that brakes if its command is finite; None to stop at once."""
    return None if plan is None else checked_local_plan(plan)


def checked_inflation(inflation: Any) -> Inflation | None:
    """Return what a layer writes around obstacles; None for a layer that does not inflate."""
    if inflation is None or (
        isinstance(inflation, Inflation)
        and (
            type(inflation[0]) is type(inflation[1]) is type(inflation[2]) is float  # nearly always
            or all(map(_is_number, inflation))
        )
    ):
        return inflation
    raise WrongResultError(f"has an inflation {shown(inflation)}, not an Inflation of three numbers or None")


def checked_speed_limit(limit: Any) -> float | None:
    """Return a speed limit (m/s); None without a limit."""
    if limit is None or (_is_number(limit) and limit == limit):
        return limit
    raise WrongResultError(f"returned the speed limit {shown(limit)}, not a speed (m/s) or None")


def checked_window(window: Any) -> Window:
    """Return the window of the cells that a costmap has updated."""
    if isinstance(window, Window):
        return window
    raise WrongResultError(f"returned a {type(window).__name__}, not a Window")


def checked_problems(problems: Any) -> tuple[NavError, ...]:
    """Return why sensors of a costmap are not used."""
    found = tuple(problems)
    for problem in found:
        if not isinstance(problem, NavError):
            raise WrongResultError(f"reports a problem of type {type(problem).__name__}, not a NavError")
    return found


def check_plugin(plugin: Any, kind: type) -> None:
    """Raise InputError unless `plugin` is None or of the given kind."""
    if plugin is not None and not isinstance(plugin, kind):
        raise InputError(f"{type(plugin).__name__} is not a {kind.__name__}; the previous one remains in use")


def _is_number(value: Any) -> bool:
    """Return True for a real number, NaN and infinity included."""
    return isinstance(value, (float, int, np.floating, np.integer)) and not isinstance(value, bool)


def _check_array(what: str, value: Any, dimensions: int) -> None:
    if value is None:
        return
    if not isinstance(value, np.ndarray) or value.ndim != dimensions or value.dtype.kind not in "fiub":
        kind = f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise WrongResultError(f"returned {what} that is {kind}, not an array of numbers of {dimensions} dimension(s)")


def _check_notes(notes: Any) -> None:
    if not isinstance(notes, Sequence) or not all(isinstance(note, str) for note in notes):
        raise WrongResultError(f"returned notes that are not sentences: {shown(notes)}")
