"""The sequence of recovery behaviors in the mode CLEARING, and their effects afterwards."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from navstack.core.errors import NavError
from navstack.interfaces import LocalPlanner, RecoveryBehavior, RecoveryContext, RecoveryStatus
from navstack.move_base import plugin_calls, status_messages
from navstack.move_base.command_output import CommandOutput
from navstack.move_base.costmap_updater import CostmapUpdater
from navstack.move_base.goal_lifecycle import GoalLifecycle
from navstack.move_base.navigation import Navigation
from navstack.move_base.recovery_runner import RecoveryEnd, RecoveryRunner
from navstack.move_base.schedule import Schedule
from navstack.move_base.stale_sensors import StaleSensorCheck
from navstack.move_base.states import NavEvent, Trigger

MAX_ROUNDS: Final = 3
"""How often the list of recoveries runs without a motion of oscillation_distance, even if the index is reset."""

_EXHAUSTED: Final = {
    Trigger.PLANNING_R: status_messages.LOG_NO_PLAN,
    Trigger.CONTROLLING_R: status_messages.LOG_NO_CONTROL,
    Trigger.OSCILLATION_R: status_messages.LOG_OSCILLATING,
    Trigger.LOST_R: status_messages.LOG_LOST,
}


class RecoverySequence:
    """Starts the next recovery behavior, steps it, and follows up on those that have ended."""

    def __init__(
        self,
        navigation: Navigation,
        control: Schedule,
        command: CommandOutput,
        costmaps: CostmapUpdater,
        goals: GoalLifecycle,
        sensors: StaleSensorCheck,
        time_limit_s: float,
    ) -> None:
        """Create the sequence. `control` is the schedule of the control cycle, which pauses during a recovery.

        Raises a ParameterError if the parameters of a recovery behavior do not fit the costmaps.
        """
        self.context = context_of(navigation)
        self._navigation = navigation
        self._command = command
        self._costmaps = costmaps
        self._goals = goals
        self._sensors = sensors
        self._control = control
        self.runner = RecoveryRunner(self._publish, navigation.params.controller_frequency, time_limit_s)
        self.followed: list[RecoveryBehavior] = []
        """Ended behaviors whose effects may last, such as lowered speed limits of the local planner."""

    def start_or_abort(self, now: float) -> None:
        """Start the next behavior in CLEARING, or end the goal if none remains."""
        navigation = self._navigation
        goal = navigation.goal
        assert goal is not None
        params = navigation.params
        recoveries = navigation.recoveries
        remaining = params.recovery_behavior_enabled and navigation.state.recovery_index < len(recoveries)
        if remaining and goal.rounds < MAX_ROUNDS * len(recoveries):
            navigation.apply(NavEvent.RECOVERY_BEGINS, now)
            return
        if remaining:
            text = (
                f"{goal.rounds} recoveries in a row did not move the robot by {params.oscillation_distance:g} m: "
                "the list is not repeated again"
            )
            navigation.events.warn(now, text)
        navigation.events.warn(now, _EXHAUSTED[navigation.state.trigger])
        navigation.apply(NavEvent.RECOVERIES_EXHAUSTED, now)

    def start_next(self, now: float) -> None:
        """Start the behavior at the present index and execute its first step."""
        navigation = self._navigation
        goal = navigation.goal
        assert goal is not None
        recovery = navigation.recoveries[navigation.state.recovery_index]
        goal.statistics.recoveries.append(recovery.name)
        goal.rounds += 1
        end = self.runner.start(recovery, self.context, now)
        self._end(end or self._step(recovery, now), now)

    def run(self, recovery: RecoveryBehavior, now: float) -> None:
        """Step the running behavior if due. Unlike C++, this also checks for cancels, new goals and stale sensors."""
        runner = self.runner
        check, step = runner.advance(now)
        if not check or self._goals.must_end(now) or runner.running is not recovery:
            return
        goal = self._navigation.goal
        if goal is None or self._sensors.is_stale(goal, now):
            return
        end = runner.check_time_limit(recovery, now)
        if end is None and step:
            end = self._step(recovery, now)
        self._end(end, now)

    def follow_up(self, now: float) -> None:
        """Follow up on ended behaviors whose effects last."""
        try:
            state = self._costmaps.local_state(now)
        except NavError:
            return
        for recovery in list(self.followed):
            try:
                lasts = plugin_calls.follow_up(recovery, state, now)
            except NavError as exc:
                self._navigation.events.warn(now, exc.message, exc)
                lasts = False
            if not lasts:
                self.followed.remove(recovery)

    def _step(self, recovery: RecoveryBehavior, now: float) -> RecoveryEnd | None:
        return self.runner.step(recovery, self._costmaps.local_state, self._command.send, now)

    def _end(self, end: RecoveryEnd | None, now: float) -> None:
        if end is None:
            return
        navigation = self._navigation
        recovery = end.recovery
        if end.error is not None and navigation.goal is not None:
            navigation.goal.statistics.add_failure(end.error, now)
        self._publish(recovery, end.status, end.text or f"{recovery.name} ends", end.data, now)
        if recovery not in self.followed:
            self.followed.append(recovery)
        started_at = self.runner.started_at
        navigation.apply(NavEvent.RECOVERY_ENDED, now)
        if now > started_at:
            # as ros::Rate after a long cycle: the next cycle is due now
            self._control.restart(started_at)
            self._control.advance(started_at)
            self._control.resume(now)

    def _publish(
        self, recovery: RecoveryBehavior, status: RecoveryStatus, text: str, data: dict[str, Any], now: float
    ) -> None:
        navigation = self._navigation
        navigation.events.recovery(
            now, recovery, status, text, data, navigation.state, total=len(navigation.recoveries)
        )


def context_of(
    navigation: Navigation, local_planner: LocalPlanner | None = None, controller_frequency: float | None = None
) -> RecoveryContext:
    """Return the context of recovery behaviors, after checking that their parameters fit it.

    Planner and frequency (Hz) default to the present ones. Raises a ParameterError for a behavior that does not fit.
    """
    context = RecoveryContext(
        navigation.global_costmap,
        navigation.local_costmap,
        local_planner or navigation.local_planner,
        controller_frequency or navigation.params.controller_frequency,
        partial(plugin_calls.localization_status, navigation.robot),
    )
    for recovery in navigation.recoveries:
        plugin_calls.call(recovery, recovery.check, context)
    return context
