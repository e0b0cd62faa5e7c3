from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import GoalTransitionError, InternalError, Pose2D, Twist2D
from navstack.move_base import Goal, GoalStatus, Mode, SimpleActionServer
from navstack.move_base.states import Action, IndexRule, NavEvent, NavState, step
from navstack.plugins import LocalPlan, RecoveryStatus, RecoveryStep
from tests.move_base.world import Bench, StraightPlanner, TurnAndGo, Waiting, no_control, occupied

OURS = settings(deadline=None, max_examples=60)


@OURS
@given(st.lists(st.sampled_from(list(NavEvent)), max_size=200))
def test_any_row_of_events_leaves_a_state_that_makes_sense(events: list[NavEvent]) -> None:
    state = NavState()
    for event in events:
        try:
            after, row = step(state, event)
        except InternalError:
            continue
        assert after.recovery_index >= 0
        assert after.recovery_index - state.recovery_index <= (row.index_rule is IndexRule.NEXT)
        if row.outcome is not None:
            assert after.mode is Mode.IDLE
            assert state.mode is Mode.IDLE or Action.STOP in row.actions
        # the function is pure
        assert step(state, event) == (after, row)
        state = after


class ServerCalls:
    """What clients and an executor may do to a server, in any order."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, GoalStatus]] = []
        self.server = SimpleActionServer(lambda handle, now: self.heard.append((handle.id, handle.status)))
        self.handles: dict[str, Any] = {}

    def do(self, call: str, now: float, number: int) -> None:
        server = self.server
        if call == "submit":
            goal = Goal(Pose2D(0.0, 0.0), "map", f"g{number}", now - (number % 3) * 0.5)
            self.handles[goal.id] = server.submit(goal, now)
        elif call == "cancel":
            server.cancel(now, f"g{number}")
        elif call == "cancel all":
            server.cancel(now)
        elif call == "cancel before":
            server.cancel(now, None, now - number)
        elif call == "accept" and server.is_new_goal_available:
            server.accept(now)
        elif call in ("succeed", "abort", "preempt") and server.is_active:
            getattr(server, {"succeed": "set_succeeded", "abort": "set_aborted", "preempt": "set_preempted"}[call])(
                now, ""
            )


CALLS = [
    "submit",
    "submit",
    "submit",
    "cancel",
    "cancel all",
    "cancel before",
    "accept",
    "accept",
    "succeed",
    "abort",
    "preempt",
]


@OURS
@given(st.lists(st.tuples(st.sampled_from(CALLS), st.floats(0.0, 3.0), st.integers(0, 12)), max_size=80))
def test_any_calls_leave_every_goal_in_a_legal_state(calls: list[tuple[str, float, int]]) -> None:
    world = ServerCalls()
    now = 0.0
    for call, later, number in calls:
        now += later
        world.do(call, now, number)
        server = world.server
        alive = [h for h in server.statuses() if not h.is_done]
        # one current, one next, nobody else
        assert all(h is server.current or h is server.next for h in alive)
        assert sum(h.is_active for h in alive) <= 1
        assert server.next is None or server.next.status in (GoalStatus.PENDING, GoalStatus.RECALLING)
    # ending the current and the next goal ends every goal
    if world.server.is_active:
        world.server.set_aborted(now, "")
    if world.server.is_new_goal_available:
        world.server.accept(now)
        world.server.set_aborted(now, "")
    for handle in world.handles.values():
        assert handle.is_done
        assert handle.result.status is handle.status
        ends = [s for i, s in world.heard if i == handle.id and s.is_terminal]
        assert ends[-1] is handle.status
    try:
        world.server.set_succeeded(now, "")
    except GoalTransitionError:
        pass
    else:
        raise AssertionError("a goal ended twice")


@pytest.mark.slow
@OURS
@given(
    st.lists(st.booleans(), max_size=40),
    st.lists(st.integers(0, 3), max_size=40),
    st.lists(st.integers(0, 2), max_size=10),
    st.sampled_from([0.0, 1.0, 4.0]),
)
def test_whatever_fails_when_the_goal_ends_and_the_robot_stands(
    plans: list[bool], commands: list[int], steps: list[int], frequency: float
) -> None:
    def plan(n: int) -> None:
        if n < len(plans) and not plans[n]:
            occupied(n)

    def drive(n: int) -> Any:
        outcome = commands[n] if n < len(commands) else 0
        if outcome == 1:
            no_control(n)
        return LocalPlan(Twist2D()) if outcome == 2 else LocalPlan(Twist2D(0.1, 0.0, 0.4)) if outcome == 3 else None

    def recover(n: int) -> RecoveryStep | None:
        outcome = steps[n] if n < len(steps) else 0
        if outcome == 0:
            return RecoveryStep(RecoveryStatus.DONE, text="done")
        return RecoveryStep(RecoveryStatus.RUNNING if outcome == 1 else RecoveryStatus.FAILED, Twist2D(0.0, 0.0, 0.3))

    def run() -> tuple[Any, list[Any]]:
        bench = Bench(
            planner=StraightPlanner(plan),
            driver=TurnAndGo(drive),
            recoveries=[Waiting("a", 0.0, recover, 20.0), Waiting("b", 0.6)],
            planner_frequency=frequency,
            planner_patience=1.0,
            controller_patience=1.0,
            oscillation_timeout=3.0,
        )
        handle = bench.run(bench.move_base.send_goal(Pose2D(1.5, 0.7, -1.0)))
        assert handle.is_done
        assert bench.robot.twist == Twist2D()
        assert bench.move_base.state is Mode.IDLE
        assert bench.move_base.recovery is None
        gaps = [(b[0] - a[0], a[1]) for a, b in zip(bench.robot.commands, bench.robot.commands[1:], strict=False)]
        assert all(gap <= 0.4 + 1e-6 for gap, twist in gaps if twist != Twist2D())
        return handle.result, [(e.time, e.kind, e.text) for e in bench.listener.events]

    # twice the same, to the bit
    assert run() == run()
