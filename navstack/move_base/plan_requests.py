"""Plan requests to the global planner, and what follows from the answers."""

from __future__ import annotations

from dataclasses import replace

from navstack.core.errors import NavError, PlanningTimeoutError
from navstack.core.path_turns import turn_note
from navstack.interfaces import GlobalPlanner, Plan
from navstack.move_base import plugin_calls
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.costmap_updater import CostmapUpdater
from navstack.move_base.goal_lifecycle import locate_goal
from navstack.move_base.navigation import Navigation
from navstack.move_base.occupied_cell import add_layer
from navstack.move_base.plan_schedule import PlanSchedule
from navstack.move_base.planning import PlanAnswer, Planning, PlanRequest
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.states import Mode, NavEvent


class PlanRequests:
    """Requests plans when they are due, and applies the answers."""

    def __init__(self, navigation: Navigation, planning: Planning, costmaps: CostmapUpdater) -> None:
        self._costmaps = costmaps
        self.schedule = PlanSchedule(navigation.params)
        self._navigation = navigation
        self._planning = planning

    @property
    def due(self) -> float:
        """Time of the next answer or request (s)."""
        planning = self._planning
        if planning.is_busy or self._navigation.state.mode is Mode.CLEARING:
            return planning.due
        return min(planning.due, self.schedule.due)

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Return True while that planner computes a plan."""
        return self._planning.is_using(planner)

    def receive(self, now: float) -> None:
        """Apply the answer of the pending request, if it has arrived."""
        answer = self._planning.poll(now)
        if answer is not None:
            self._apply(answer, now)

    def request_if_due(self, now: float) -> None:
        """Request a plan if one is due. An answer that is available at once is applied in this tick."""
        navigation = self._navigation
        goal = navigation.goal
        if goal is None or navigation.state.mode is Mode.CLEARING:
            return
        if self._planning.is_busy or not self.schedule.take_request(now):
            return
        try:
            request = self._request_for(goal, now)
        except NavError as exc:
            self._apply(PlanAnswer(goal.handle.id, now, None, exc), now)
            return
        self._planning.request(request)
        self.receive(now)

    def check_timeout(self, now: float) -> None:
        """Report a planner that has not answered within planner_patience.

        ROS differs: C++ waits without a limit. A late plan is still used.
        """
        goal = self._navigation.goal
        patience = self._navigation.params.planner_patience
        waited = self.schedule.waited(now)
        if goal is None or not self._planning.is_busy or waited < patience - EPSILON_S:
            return
        error = PlanningTimeoutError(
            f"the global planner has not answered for {waited:.1f} s (planner_patience {patience:g} s)", waited_s=waited
        )
        self._fail(goal, error, now)

    def _request_for(self, goal: ActiveGoal, now: float) -> PlanRequest:
        navigation = self._navigation
        if self._costmaps.global_error is not None:
            # ROS differs: it plans on a costmap that could not be updated, without its static map if need be
            raise self._costmaps.global_error
        pose = locate_goal(navigation, goal, now) if goal.pose is None else goal.pose
        costmap = navigation.global_costmap
        start = plugin_calls.robot_pose(costmap, now)
        return PlanRequest(
            navigation.global_planner, costmap.master, start, pose, costmap.footprint, goal.handle.id, now
        )

    def _apply(self, answer: PlanAnswer, now: float) -> None:
        """Apply an answer, unless it is for another goal or in the global costmap's former frame."""
        navigation = self._navigation
        goal = navigation.goal
        if goal is None or answer.goal_id != goal.handle.id:
            return
        if answer.plan is not None and answer.plan.path.frame == navigation.global_costmap.frame:
            self._succeed(goal, answer.plan, now)
        elif answer.error is not None:
            self._fail(goal, add_layer(navigation.global_costmap, answer.error), now)

    def _succeed(self, goal: ActiveGoal, plan: Plan, now: float) -> None:
        navigation = self._navigation
        goal.statistics.plans += 1
        note = turn_note(plan.path, navigation.local_planner.limits.min_turning_radius)
        if note is not None:
            plan = replace(plan, notes=(*plan.notes, note))
        if navigation.state.mode is not Mode.CLEARING:
            navigation.plan = navigation.new_plan = navigation.last_tick.plan = plan
        self.schedule.succeed()
        navigation.events.plan(now, plan)
        navigation.apply(NavEvent.PLAN_FOUND, now)

    def _fail(self, goal: ActiveGoal, error: NavError, now: float) -> None:
        navigation = self._navigation
        goal.statistics.add_failed_plan(error, now)
        navigation.events.failure(now, "plan_failed", error)
        exhausted = navigation.state.mode is Mode.PLANNING and self.schedule.fail(now)
        navigation.apply(NavEvent.PLANNING_EXHAUSTED if exhausted else NavEvent.PLAN_FAILED, now)
