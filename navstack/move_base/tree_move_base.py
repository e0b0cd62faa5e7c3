"""A goal manager whose goals are driven by a behavior tree, as by Nav2's bt_navigator.

The tree replaces the states of move_base: it is ticked once in each control cycle and decides when to plan, follow, recover and
end. Everything else is `MoveBase`: goals and their server, costmaps, checks of the sensors, commands, events.

Source: nav2_bt_navigator (navigators/navigate_to_pose.cpp), nav2_controller (controller_server.cpp).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from navstack.behavior_trees import Action, BehaviorTree, StampedPose, Status, find_tree
from navstack.behaviors import BehaviorEnd
from navstack.core import ControlError, NavError
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.checks import check_progress
from navstack.move_base.errors import BusyError, NoProgressError
from navstack.move_base.goals import GoalStatus
from navstack.move_base.move_base import MoveBase
from navstack.move_base.planning import PlanAnswer
from navstack.move_base.plugin_calls import call, checked_flag
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.states import Mode, NavEvent, NavState, Outcome, Trigger
from navstack.move_base.tree_servers import BehaviorServer, TaskServer, TreeServers
from navstack.plugins import Behavior, BehaviorStatus

TREE_FAILED: Final = "The behavior tree failed."
"""Text of a goal that ends by a FAILURE of the tree."""
_NAMES: Final = {
    1: "GOAL_REJECTED",
    100: "UNKNOWN",
    103: "INVALID_PATH",
    104: "PATIENCE_EXCEEDED",
    105: "FAILED_TO_MAKE_PROGRESS",
    106: "NO_VALID_CONTROL",
    107: "CONTROLLER_TIMED_OUT",
    200: "UNKNOWN",
    202: "TF_ERROR",
    203: "START_OUTSIDE_MAP",
    204: "GOAL_OUTSIDE_MAP",
    205: "START_OCCUPIED",
    206: "GOAL_OCCUPIED",
    207: "TIMEOUT",
    208: "NO_VALID_PATH",
    400: "UNKNOWN",
    401: "TF_ERROR",
    402: "NO_VALID_GRAPH",
    403: "INDETERMINANT_NODES_ON_GRAPH",
    404: "TIMEOUT",
    405: "NO_VALID_ROUTE",
    406: "OPERATION_FAILED",
    407: "INVALID_EDGE_SCORER_USE",
    501: "INVALID_SMOOTHER",
    503: "SMOOTHED_PATH_IN_COLLISION",
    505: "INVALID_PATH",
}
"""Symbols of nav2_msgs by code; those of ComputePathThroughPoses are 100 higher."""
_SHOWN: Final = {
    Mode.PLANNING: NavEvent.CYCLE,
    Mode.CONTROLLING: NavEvent.PLAN_TAKEN,
    Mode.CLEARING: NavEvent.RECOVERY_BEGINS,
}
"""The event that records show for a change to a mode."""


class TreeFailedError(NavError):
    """The behavior tree of a goal failed. `code` and `name` of an error are those of Nav2's result, 9000 if no server failed."""

    code = 9062
    name = "TREE_FAILED"

    def __init__(self, message: str, *, error_code: int = NavError.code, **data: Any) -> None:
        super().__init__(message, error_code=error_code, **data)
        # a code of the instance: it is that of the server that failed
        self.__dict__["code"] = error_code
        self.__dict__["name"] = _NAMES.get(error_code - 100 if 300 <= error_code < 400 else error_code, "UNKNOWN")

    def __reduce__(self) -> tuple[Any, ...]:
        return (_rebuild, (self.message, self.data))


def _rebuild(message: str, data: dict[str, Any]) -> TreeFailedError:
    return TreeFailedError(message, **data)


class MissingServerError(NavError):
    """A behavior tree has nodes whose action server or service navstack does not offer."""

    code = 9063
    name = "MISSING_SERVER"


class TreeMoveBase(MoveBase):
    """Drives a robot to one goal at a time, as its behavior tree says; until `use_tree`, as the states of move_base do."""

    tree: BehaviorTree
    """The tree; its `explain` tells what it did for the last goal."""
    tree_source: str | os.PathLike[str] | None = None
    """What the tree was read from; None while the states of move_base drive."""

    behavior_servers: Mapping[str, BehaviorServer] = {}
    """Further servers of its trees that move the robot, by name; set them before `use_tree`."""
    task_servers: Mapping[str, TaskServer] = {}
    """Further servers of its trees that do not, by name; set them before `use_tree`."""
    tree_behaviors: Sequence[Behavior] = ()
    """Behaviors besides the recoveries, whose parameters those of its trees have; set them before `use_tree`."""

    def use_states(self) -> None:
        """Let the states of move_base drive the next goals. Raises BusyError while a goal is driven."""
        self._check_idle()
        self.tree_source = None

    def _check_idle(self) -> None:
        if self._goal is not None:
            raise BusyError("a goal is driven; its behavior tree can be changed when it has ended")

    def use_tree(self, source: str | os.PathLike[str], *, distro: str | None = None) -> None:
        """Read the tree of the next goals: a file, or the text of one.

        Raises BehaviorTreeError with file, line and column, and BusyError while a goal is driven; nothing has changed then.
        """
        servers = TreeServers(
            self.robot,
            self.global_costmap,
            self.local_costmap,
            planning=self._planning,
            costmaps=self._costmaps,
            output=self._output,
            events=self._events,
            recoveries=self._recoveries,
            behaviors=self.tree_behaviors,
            further=self.behavior_servers,
            tasks=self.task_servers,
        )
        tree = BehaviorTree(source, servers=servers, distro=distro)
        self._check_idle()
        self.tree = tree
        self.tree_source, self._servers = source, servers
        self._warn_of_missing_servers()
        self._tree_error: NavError | None = None
        self._tree_planner = self._local_planner
        self._of_tree: ActiveGoal | None = None

    def _warn_of_missing_servers(self) -> None:
        """Say before the first goal which nodes will fail, because navstack has nothing for them to act on."""
        actions = [item for item in self.tree.nodes if isinstance(item, Action)]
        for error in self._servers.prepare(actions):
            self._events.warn(self.last_tick.time, error.message, error)
        lacking = [item for item in actions if not self._servers.offers(item)]
        if not lacking:
            return
        kinds = ", ".join(dict.fromkeys(item.type for item in lacking))
        they = "this node fails" if len(lacking) == 1 else "these nodes fail"
        text = (
            f"the behavior tree {Path(self.tree.name).name} uses {kinds}, which navstack offers to no tree, so that {they}; "
            "take it out of the tree, or let a Fallback go on without it"
        )
        self._events.warn(self.last_tick.time, text, MissingServerError(text, nodes=[item.path for item in lacking]))

    def drive_by(self, tree: str) -> None:
        """Let a tree drive the next goals, as a goal of Nav2 names it: a file, or a packaged one; empty: the states of move_base.

        Nothing is read if it drives already. Raises as `use_tree`.
        """
        source = find_tree(tree) if tree else None
        if source == self.tree_source:
            return
        if source is None:
            self.use_states()
        else:
            self.use_tree(source)

    @property
    def _is_by_tree(self) -> bool:
        return self.tree_source is not None

    # --- update cycle -------------------------------------------------------------------------------------------------

    def next_due(self, now: float) -> float:
        """Return the next time (s) at which `tick` has work: the tree is ticked in every control cycle."""
        due = super().next_due(now)
        return due if self._goal is None or not self._is_by_tree else max(now, min(due, self._cycles.due))

    def _take_answer(self, answer: PlanAnswer, now: float) -> None:
        if not self._is_by_tree:
            super()._take_answer(answer, now)
            return
        goal = self._goal
        if goal is not None and answer.goal_id == goal.handle.id:
            self._servers.goal, self._servers.now = goal, now
            self._servers.take_answer(answer)

    def _request_plan_if_due(self, now: float) -> None:
        if not self._is_by_tree:
            super()._request_plan_if_due(now)
            return
        self._plans.stop(now)  # the tree requests plans

    def _recover_or_control(self, now: float) -> None:
        if not self._is_by_tree:
            super()._recover_or_control(now)
            return
        if self._servers.is_moving:
            self._servers.observe(self._output.tick.scans)
        if now >= self._cycles.due - EPSILON_S:
            self._cycles.advance(now)
            if not self._must_end(now) and self._goal is not None:
                self._run_tree(self._goal, now)
        if self._goal is None or self._recoveries.running is None or self.lost.is_lost:
            return
        if self._servers.behavior_begins:
            self._servers.behavior_begins = False
            self._step_behavior(self._goal, now)
        elif self._recoveries.advance(now)[1]:
            self._step_behavior(self._goal, now)

    def _run_tree(self, goal: ActiveGoal, now: float) -> None:
        """Tick the tree, then follow the path that it has chosen."""
        tree, servers = self.tree, self._servers
        self._plans.stop(now)
        servers.global_planner, servers.local_planner = self._global_planner, self._local_planner
        servers.begin(goal, now)
        if self._of_tree is not goal:
            self._begin_goal(goal)
        if self._tree_planner is not self._local_planner:
            self._tree_planner = self._local_planner
            servers.refresh_plan()
        if self._track(goal, now) and self._recoveries.followed:
            self._follow_up(now)
        if self.lost.is_lost and self._waits_for_pose(goal, now):
            return
        try:
            status = tree.tick(now)
        except NavError as exc:
            self._fail_tree(exc, now)
            return
        if status is Status.RUNNING:
            self._show(
                Mode.CLEARING if servers.is_moving else Mode.CONTROLLING if servers.following else Mode.PLANNING, now
            )
            if servers.following is not None:
                self._follow(goal, now)
            elif not servers.is_moving:
                self._output.stop_if_moving(now)
        elif status is Status.SUCCESS:
            self._show(Mode.CONTROLLING, now)
            self._apply(NavEvent.GOAL_REACHED, now)
        else:
            self._fail_tree(self._error_of_tree(goal), now)

    def _begin_goal(self, goal: ActiveGoal) -> None:
        """Give the tree a new goal; a tree that runs goes on with it, as in Nav2."""
        sent, tree = goal.handle.goal, self.tree
        if self._of_tree is None:
            tree.trace.clear()
        self._of_tree = goal
        x, y, yaw = sent.pose
        pose = StampedPose(x, y, yaw, sent.frame, self._servers.now)
        tree.blackboard["number_recoveries"] = 0
        tree.blackboard["goal"] = pose
        tree.blackboard["goals"] = [pose]

    def _error_of_tree(self, goal: ActiveGoal) -> NavError:
        """Return the reason for the FAILURE of the tree: as in Nav2, the least error code on the blackboard."""
        tree = self.tree
        codes = [
            value
            for key, value in tree.blackboard.items()
            if key.endswith("error_code") and isinstance(value, int) and value > 0
        ]
        code = min(codes, default=self._servers.last_code or NavError.code)
        cause = self._servers.errors.get(code)
        leaf = tree.trace.cause_below(tree.root)
        where = f" (last: {leaf.path})" if leaf is not None else ""
        count = len(goal.statistics.recoveries)
        text = f"{TREE_FAILED[:-1]} after {count} {'recovery' if count == 1 else 'recoveries'}{where}"
        reason = cause.message if cause is not None else leaf.message if leaf is not None else ""
        if reason:
            text += f": {reason}"
        return TreeFailedError(text, error_code=code, cause=None if cause is None else cause.as_dict())

    def _fail_tree(self, error: NavError, now: float) -> None:
        self._tree_error = error
        self._show(Mode.CLEARING, now)
        self._apply(NavEvent.RECOVERIES_EXHAUSTED, now, error)

    def _finish_goal(self, outcome: Outcome, now: float) -> None:
        """Halt the tree and end the goal; its result holds what the tree did."""
        if not self._is_by_tree:
            super()._finish_goal(outcome, now)
            return
        goal, tree, error = self._goal, self.tree, self._tree_error
        self._tree_error = None
        text = tree.explain() if self._of_tree is not None else ""
        retries = [str(retry) for retry in tree.trace.retries]
        if self._of_tree is not None:
            try:
                tree.halt()
            except NavError as exc:  # a script of the tree
                self._events.warn(now, exc.message, exc)
        self._recoveries.runner.drop(now)
        self._planning.abandon()
        self._servers.forget()
        self._of_tree = None
        if goal is not None and text:
            self._events.info(now, text, tree=tree.name, retries=retries)
        if goal is None or error is None:
            super()._finish_goal(outcome, now)
            return
        self._goal = None
        result = goal.result(GoalStatus.ABORTED, TREE_FAILED, error, now)
        result.data["tree"] = text.splitlines()
        self.server.set_aborted(now, TREE_FAILED, result)

    def _drop_recovery(self, now: float) -> None:
        """Do nothing with a tree: it decides which behavior runs, also after a new goal; the end of the goal halts it."""
        if not self._is_by_tree:
            super()._drop_recovery(now)

    @property
    def _has_recovery(self) -> bool:
        """False with a tree: a robot that is lost stops and waits; the recoveries are those of the tree."""
        return not self._is_by_tree and super()._has_recovery

    def _show(self, mode: Mode, now: float) -> None:
        """Publish a change of the mode, for records."""
        before = self._state
        if before.mode is not mode:
            self._state = NavState(mode, Trigger.CONTROLLING_R)
            if self.listeners:
                self._events.publish(now, "state", *before.change(self._state, _SHOWN[mode]))

    # --- controller ---------------------------------------------------------------------------------------------------

    def _follow(self, goal: ActiveGoal, now: float) -> None:
        """Send a command along the path, or end it as Nav2's controller server does."""
        servers, planner, plan = self._servers, self._local_planner, self._servers.plan
        assert plan is not None
        if servers.follow_started:
            servers.follow_started = False
            goal.stale_since = None
            self._reset_timers(now)
            self._reset_oscillation(now)
        verdict = self._sensors.check(goal, plan, self._params.controller_patience, now)
        if verdict is not None:
            self._output.stop_if_moving(now)
            if verdict.error is not None:
                servers.abort_following(107, verdict.error)
            return
        try:
            inputs = self._inputs.at(plan, now)
            if call(planner, planner.goal_reached, inputs, check=checked_flag):
                servers.finish_following()
                return
            self._check_progress(goal, now)
            local_plan = self._compute_command(inputs, now)
        except NoProgressError as exc:
            goal.statistics.add_failed_command(exc, now)
            self._events.failure(now, "control_failed", exc)
            servers.abort_following(105, exc)
        except NavError as exc:
            self._fail_following(goal, exc, now)
        else:
            goal.statistics.commands += 1
            goal.last_valid_control = now
            self._local_plan = self._output.tick.local_plan = local_plan
            self._output.send(local_plan.command, now)

    def _check_progress(self, goal: ActiveGoal, now: float) -> None:
        """Raise NoProgressError if oscillation_timeout or the progress checker ends."""
        timeout, distance = self._params.oscillation_timeout, self._params.oscillation_distance
        if timeout > 0.0 and now >= goal.last_progress + timeout - EPSILON_S:
            text = f"the robot moved less than {distance:g} m in {timeout:g} s"
            raise NoProgressError(text, oscillation_timeout=timeout, oscillation_distance=distance, pose=self._pose)
        checker = self._progress_checker
        if checker is not None and self._pose is not None:
            error = check_progress(checker, self._pose, now)
            if error is not None:
                raise NoProgressError(error.message, **error.data) from error

    def _fail_following(self, goal: ActiveGoal, error: NavError, now: float) -> None:
        goal.statistics.add_failed_command(error, now)
        self._events.failure(now, "control_failed", error)
        self._output.stop_if_moving(now)
        patience = self._params.controller_patience
        if now < goal.last_valid_control + patience - EPSILON_S:
            return
        own = error.code if 100 <= error.code < 200 else 100
        if patience <= 0.0:
            self._servers.abort_following(own, error)
            return
        text = f"no command for controller_patience ({patience:g} s): {error.message}"
        self._servers.abort_following(104, ControlError(text, **error.data))

    # --- behaviors ----------------------------------------------------------------------------------------------------

    def _step_behavior(self, goal: ActiveGoal, now: float) -> None:
        runner = self._recoveries.runner
        behavior = runner.running
        assert behavior is not None
        if self._is_stale(goal, now):
            return
        end = self._recoveries.check_time_limit(behavior, now)
        if end is not None:
            self._end_recovery(end, now)
        else:
            self._step_recovery(behavior, now)

    def _publish_recovery(
        self, behavior: Behavior, status: BehaviorStatus, text: str, data: dict[str, Any], now: float
    ) -> None:
        if self._is_by_tree:
            self._servers.publish_step(behavior, status, text, data)
        else:
            super()._publish_recovery(behavior, status, text, data, now)

    def _end_recovery(self, end: BehaviorEnd, now: float) -> None:
        if not self._is_by_tree:
            super()._end_recovery(end, now)
            return
        self._recoveries.follow(end.behavior)
        self._servers.end_behavior(end)
