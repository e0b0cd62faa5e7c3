"""Calls into plugins that may break their contract: what comes back is good, or it is a NavError.

A plugin may raise anything and return anything; none of it may end a tick or move the robot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D
from navstack.core.errors import InputError, InternalError, NavError, PlanningError
from navstack.interfaces import (
    ControlInput,
    GlobalPlanner,
    LocalPlan,
    LocalPlanner,
    Plan,
    RecoveryBehavior,
    RecoveryStep,
)


def internal(what: str, problem: BaseException | str) -> InternalError:
    """A plugin's misbehaviour as an error: `what` did it."""
    if isinstance(problem, BaseException):
        said = str(problem)
        detail = f"{type(problem).__name__}: {said}" if said else type(problem).__name__
        return InternalError(f"{what} raised {detail}; please report this to its author", plugin=what)
    return InternalError(f"{what} {problem}; please report this to its author", plugin=what)


def _name(plugin: object) -> str:
    return type(plugin).__name__


def make_plan(
    planner: GlobalPlanner, costmap: Costmap, start: Pose2D, goal: Pose2D, footprint: Footprint | None
) -> Plan:
    """A plan that is one: not empty, finite, in the costmap's frame. Raises NavError otherwise."""
    try:
        plan: Any = planner.make_plan(costmap, start, goal, footprint=footprint)
    except NavError:
        raise
    except Exception as exc:
        raise internal(_name(planner), exc) from exc
    if plan is None:
        raise PlanningError(f"{_name(planner)} returned no plan and no reason", planner=_name(planner))
    if not isinstance(plan, Plan):
        raise internal(_name(planner), f"returned a {type(plan).__name__}, not a Plan")
    if len(plan.path) == 0:
        raise PlanningError(f"{_name(planner)} returned an empty plan", planner=_name(planner))
    if not np.isfinite(plan.path.poses).all() or not plan.goal.is_finite():
        raise internal(_name(planner), "returned a plan that is not finite")
    if plan.path.frame != costmap.frame:
        raise internal(
            _name(planner), f'returned a plan in the frame "{plan.path.frame}", not the costmap\'s "{costmap.frame}"'
        )
    return plan


def compute_command(planner: LocalPlanner, inputs: ControlInput) -> LocalPlan:
    """A local plan with a finite command. Raises NavError otherwise."""
    try:
        plan: Any = planner.compute_command(inputs)
    except NavError:
        raise
    except Exception as exc:
        raise internal(_name(planner), exc) from exc
    if not isinstance(plan, LocalPlan):
        raise internal(_name(planner), f"returned a {type(plan).__name__}, not a LocalPlan")
    if not _is_command(plan.command):
        raise _no_command(_name(planner), plan.command)
    return plan


def goal_reached(planner: LocalPlanner, inputs: ControlInput) -> bool:
    """The local planner's word; raises NavError when it has none."""
    try:
        return bool(planner.goal_reached(inputs))
    except NavError:
        raise
    except Exception as exc:
        raise internal(_name(planner), exc) from exc


def recovery_step(recovery: RecoveryBehavior, state: RobotState, now: float) -> RecoveryStep:
    """A step with a finite twist. Raises NavError otherwise."""
    try:
        step: Any = recovery.step(state, now)
    except NavError:
        raise
    except Exception as exc:
        raise internal(recovery.name, exc) from exc
    if not isinstance(step, RecoveryStep):
        raise internal(recovery.name, f"returned a {type(step).__name__}, not a RecoveryStep")
    if not _is_command(step.twist):
        raise _no_command(recovery.name, step.twist)
    return step


def _is_command(twist: Any) -> bool:
    try:
        return isinstance(twist, Twist2D) and twist.is_finite()
    except TypeError:  # a component is no number
        return False


def _no_command(who: str, twist: Any) -> InternalError:
    return internal(who, f"wants to command {twist}, which is not a Twist2D of three finite numbers")


def check_plugin(given: Any, kind: type) -> None:
    """Raises InputError for what is neither None nor of that kind."""
    if given is not None and not isinstance(given, kind):
        raise InputError(f"{type(given).__name__} is no {kind.__name__}; the old one is kept")
