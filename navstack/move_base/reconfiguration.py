"""Changes of parameters and planners at run time.

Source: move_base/src/move_base.cpp (reconfigureCB).
"""

from __future__ import annotations

from navstack.interfaces import GlobalPlanner, LocalPlanner
from navstack.move_base import plugin_calls
from navstack.move_base.navigation import Navigation
from navstack.move_base.parts import Parts
from navstack.move_base.progress import OscillationChecker
from navstack.move_base.recovery_sequence import context_of
from navstack.move_base.speed_limiter import SpeedLimiter
from navstack.move_base.states import Mode, NavEvent
from navstack.parameters.models.move_base import MoveBaseParams


def reconfigure(
    parts: Parts,
    params: MoveBaseParams | None,
    global_planner: GlobalPlanner | None,
    local_planner: LocalPlanner | None,
    now: float,
) -> None:
    """Change parameters and planners at `now` (s); see `MoveBase.reconfigure`. Either everything changes or nothing."""
    plugin_calls.check_plugin(global_planner, GlobalPlanner)
    plugin_calls.check_plugin(local_planner, LocalPlanner)
    navigation = parts.navigation
    params = params or navigation.params
    context = context_of(navigation, local_planner, params.controller_frequency)
    limiter = parts.control.speed_limiter
    if local_planner is not None:
        limiter = SpeedLimiter((navigation.local_costmap, navigation.global_costmap), local_planner)
    # nothing below raises
    parts.recovery.context = context
    _set_params(parts, params, now)
    if global_planner is None and local_planner is None:
        return
    if global_planner is not None:
        navigation.global_planner = global_planner
    if local_planner is not None:
        navigation.local_planner = local_planner
        parts.control.speed_limiter = limiter
        parts.recovery.followed.clear()  # the effects were on the previous planner
    parts.planning.abandon()
    navigation.drop_plans()
    _announce(navigation, now)
    navigation.apply(NavEvent.PLANNERS_CHANGED, now)


def _announce(navigation: Navigation, now: float) -> None:
    names = f"{type(navigation.global_planner).__name__}, {type(navigation.local_planner).__name__}"
    navigation.events.info(now, f"planners changed: {names}")


def _set_params(parts: Parts, params: MoveBaseParams, now: float) -> None:
    navigation = parts.navigation
    before, navigation.params = navigation.params, params
    if params.controller_frequency != before.controller_frequency:
        parts.control.schedule.set_frequency(params.controller_frequency, now)
        parts.recovery.runner.set_frequency(params.controller_frequency, now)
    may_plan = navigation.state.mode in (Mode.PLANNING, Mode.CONTROLLING)
    parts.plan_requests.schedule.set_params(params, now, may_plan=may_plan)
    if params.oscillation_distance != before.oscillation_distance and navigation.goal is not None:
        navigation.goal.progress = OscillationChecker(params.oscillation_distance)
    if params.sections != before.sections:
        parts.control.progress_checker = params.make_progress_checker()
    if params.shutdown_costmaps != before.shutdown_costmaps:
        parts.costmaps.enable(not navigation.is_idle or not params.shutdown_costmaps, now)
