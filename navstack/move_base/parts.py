"""The parts of `MoveBase` and their connections."""

from __future__ import annotations

from dataclasses import dataclass

from navstack.move_base.action_server import SimpleActionServer
from navstack.move_base.command_output import CommandOutput
from navstack.move_base.control_cycle import ControlCycle
from navstack.move_base.costmap_updater import CostmapUpdater
from navstack.move_base.goal_lifecycle import GoalLifecycle
from navstack.move_base.motion_runner import MotionRunner
from navstack.move_base.navigation import Navigation
from navstack.move_base.plan_requests import PlanRequests
from navstack.move_base.planning import Planning
from navstack.move_base.recovery_sequence import RecoverySequence
from navstack.move_base.schedule import Schedule
from navstack.move_base.stale_sensors import StaleSensorCheck
from navstack.move_base.states import Action


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The parts of one `MoveBase`."""

    navigation: Navigation
    server: SimpleActionServer
    planning: Planning
    costmaps: CostmapUpdater
    command: CommandOutput
    goals: GoalLifecycle
    plan_requests: PlanRequests
    recovery: RecoverySequence
    control: ControlCycle
    motions: MotionRunner


def connect_parts(
    navigation: Navigation,
    planning: Planning,
    update_frequencies: tuple[float | None, float | None],
    recovery_time_limit_s: float,
) -> Parts:
    """Create the parts and connect the actions of the state machine to them.

    `update_frequencies` (Hz) are those of the global and the local costmap; None for the costmap's parameter. Raises
    a ParameterError if the parameters of a recovery behavior do not fit the costmaps.
    """
    server = SimpleActionServer(navigation.events.status)
    costmaps = CostmapUpdater(navigation, *update_frequencies)
    command = CommandOutput(navigation)
    goals = GoalLifecycle(navigation, server, planning)
    plan_requests = PlanRequests(navigation, planning, costmaps)
    sensors = StaleSensorCheck(navigation, costmaps)
    schedule = Schedule(navigation.params.controller_frequency)
    recovery = RecoverySequence(navigation, schedule, command, costmaps, goals, sensors, recovery_time_limit_s)
    control = ControlCycle(navigation, schedule, command, costmaps, goals, sensors, plan_requests, recovery)
    motions = MotionRunner(navigation, server, command, costmaps, lambda: recovery.context)
    parts = Parts(navigation, server, planning, costmaps, command, goals, plan_requests, recovery, control, motions)
    _connect_actions(parts)
    return parts


def _connect_actions(parts: Parts) -> None:
    navigation, costmaps, control, plans = parts.navigation, parts.costmaps, parts.control, parts.plan_requests.schedule

    def reset_timers(now: float) -> None:
        plans.reset_patience(now)
        control.reset_control_patience(now)

    navigation.finish = parts.goals.finish
    navigation.actions = {
        Action.STOP: parts.command.stop,
        Action.STOP_IF_MOVING: parts.command.stop_if_moving,
        Action.WAKE_PLANNER: plans.wake,
        Action.STOP_PLANNER: plans.stop,
        Action.RESET_TIMERS: reset_timers,
        Action.RESET_PLAN_PATIENCE: plans.reset_patience,
        Action.RESET_CONTROL_PATIENCE: control.reset_control_patience,
        Action.RESET_OSCILLATION: control.reset_oscillation,
        Action.START_RECOVERY: parts.recovery.start_next,
        Action.DROP_RECOVERY: parts.recovery.runner.drop,
        Action.START_COSTMAPS: lambda now: costmaps.enable(True, now),
        Action.STOP_COSTMAPS: lambda now: costmaps.enable(not navigation.params.shutdown_costmaps, now),
    }
