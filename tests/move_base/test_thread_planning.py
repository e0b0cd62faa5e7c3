"""A slow planner in its own thread, without sleeps: the threads synchronize by events."""

from __future__ import annotations

import threading
from collections.abc import Generator

import pytest

from navstack.core import LETHAL, Pose2D, Twist2D
from navstack.move_base import GoalHandle, GoalStatus, Mode, MoveBaseParams, ThreadPlanning
from navstack.move_base.errors import BusyError
from navstack.move_base.planning import MAX_HUNG

from .world import Bench, StraightPlanner, occupied

GOAL = Pose2D(4.0, 0.0, 0.0)
PATIENCE_S = 10.0
"""Timeout (s) of the tests with threads, in real time; far above the durations."""


class SlowPlanner(StraightPlanner):
    """Plans when the test releases it."""

    def __init__(self, **how: object) -> None:
        self.asked = threading.Semaphore(0)
        self.let = threading.Semaphore(0)
        self.threads: set[int] = set()
        self.looked_at: list[int] = []
        super().__init__(**how)  # type: ignore[arg-type]

    def make_plan(self, costmap, start, goal, **how):  # type: ignore[no-untyped-def]
        self.threads.add(threading.get_ident())
        self.asked.release()
        assert self.let.acquire(timeout=PATIENCE_S)
        self.looked_at.append(int(costmap.data[0, 0]))
        return super().make_plan(costmap, start, goal, **how)


class Live:
    """A bench with a planner in a thread."""

    def __init__(self, planner: SlowPlanner | None = None, **params: float) -> None:
        self.answered = threading.Semaphore(0)
        self.planning = ThreadPlanning(self.answered.release)
        self.planner = planner or SlowPlanner()
        self.bench = Bench(planner=self.planner, planning=self.planning, **params)

    def answer(self) -> None:
        """Release the planner for one plan and wait for it."""
        self.planner.let.release()
        assert self.answered.acquire(timeout=PATIENCE_S)

    def asked(self) -> None:
        """Wait until the planner works."""
        assert self.planner.asked.acquire(timeout=PATIENCE_S)


@pytest.fixture
def live() -> Generator[Live]:
    live = Live()
    yield live
    for _ in range(20):
        live.planner.let.release()
    assert live.planning.close(PATIENCE_S)


def test_control_continues_while_the_planner_works(live: Live) -> None:
    bench = live.bench
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(0.4)
    live.asked()
    assert bench.move_base.state is Mode.PLANNING
    live.answer()
    assert bench.move_base.next_due(0.4) == 0.4  # the answer ends the wait
    bench.run_to(1.2)
    live.asked()  # replanning at 1 Hz; the planner hangs
    assert bench.move_base.state is Mode.CONTROLLING
    commands = len(bench.robot.commands)
    bench.run_to(3.2)
    assert len(bench.robot.commands) - commands == 10
    assert bench.robot.twist.vx > 0.0
    assert len(live.planner.calls) == 1
    live.answer()
    bench.run_to(3.6)
    assert len(live.planner.calls) == 2
    assert len(bench.listener.of("plan")) == 2
    for _ in range(20):
        live.planner.let.release()
    bench.run(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert threading.get_ident() not in live.planner.threads
    assert len(live.planner.threads) == 1


def test_patience_ends_without_an_answer(live: Live) -> None:
    handle = live.bench.run(live.bench.move_base.send_goal(GOAL))
    assert handle.status is GoalStatus.ABORTED
    assert (handle.result.error_code, handle.result.error_name) == (207, "TIMEOUT")
    assert handle.result.ended_at == pytest.approx(5.2, abs=0.3)


def test_a_plan_for_a_former_goal_is_discarded(live: Live) -> None:
    bench = live.bench
    first = bench.move_base.send_goal(GOAL)
    bench.run_to(0.4)
    live.asked()
    second = bench.move_base.send_goal(Pose2D(1.0, 1.0))
    bench.run_to(1.0)
    assert first.status is GoalStatus.PREEMPTED
    # one call at a time: the second request waits for the first
    assert not live.planner.asked.acquire(blocking=False)
    live.planner.let.release()
    live.asked()
    live.answer()
    bench.run_to(1.4)
    assert bench.move_base.plan is not None
    assert bench.move_base.plan.goal == Pose2D(1.0, 1.0)
    assert len(bench.listener.of("plan")) == 1
    for _ in range(20):
        live.planner.let.release()
    assert bench.run(second).status is GoalStatus.SUCCEEDED


def test_it_plans_on_a_copy_of_the_costmap(live: Live) -> None:
    bench = live.bench
    bench.move_base.send_goal(GOAL)
    bench.run_to(0.0)
    live.asked()
    bench.global_costmap.master.data[0, 0] = LETHAL
    live.answer()
    assert live.planner.looked_at == [0]


def test_failures_are_returned() -> None:
    def leave(n: int) -> None:
        if n:
            raise SystemExit
        occupied(n)

    live = Live(SlowPlanner(behave=leave))
    handle = live.bench.move_base.send_goal(GOAL)
    for _ in range(2):
        live.bench.run_to(live.bench.robot.time + 0.2)
        live.asked()
        live.answer()
    live.bench.run_to(live.bench.robot.time + 0.2)
    names = [e.data["name"] for e in live.bench.listener.of("plan_failed")]
    assert names == ["GOAL_OCCUPIED", "INTERNAL"]
    assert not handle.is_done
    for _ in range(20):
        live.planner.let.release()
    assert live.planning.close(PATIENCE_S)


def test_make_plan_is_busy_while_the_planner_works(live: Live) -> None:
    bench = live.bench
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(0.2)
    live.asked()
    bench.move_base.cancel_goal(handle)
    bench.run(handle)
    assert bench.robot.twist == Twist2D()
    with pytest.raises(BusyError, match="an abandoned request"):
        bench.move_base.make_plan(GOAL)


def test_a_new_planner_does_not_wait_for_one_that_hangs(live: Live) -> None:
    bench = live.bench
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(0.2)
    live.asked()
    other = SlowPlanner()
    bench.move_base.reconfigure(global_planner=other)
    bench.run_to(0.6)
    for _ in range(20):
        other.let.release()
    assert live.answered.acquire(timeout=PATIENCE_S)
    assert bench.run(handle).status is GoalStatus.SUCCEEDED
    assert live.planner.calls == []


class HangingPlanner(StraightPlanner):
    """Never returns from the first `HangingPlanner.times` requests to any instance."""

    times = 0
    made = 0
    gate = threading.Event()
    at_work = threading.Semaphore(0)

    def __init__(self, params: object = None) -> None:
        super().__init__()
        type(self).made += 1

    def make_plan(self, costmap, start, goal, **how):  # type: ignore[no-untyped-def]
        kind = type(self)
        kind.times -= 1
        hangs = kind.times >= 0
        kind.at_work.release()
        if hangs:
            kind.gate.wait()
        return super().make_plan(costmap, start, goal, **how)


class Hung:
    """A bench with a planner that hangs several times before it plans."""

    def __init__(self, times: int) -> None:
        HangingPlanner.times, HangingPlanner.made = times, 0
        HangingPlanner.gate.clear()
        HangingPlanner.at_work = threading.Semaphore(0)
        self.answered = threading.Semaphore(0)
        self.planning = ThreadPlanning(self.answered.release, hang_timeout_s=8.0)
        self.bench = Bench(planner=HangingPlanner(), planning=self.planning)

    def run(self, handle: GoalHandle, hangs: int) -> GoalHandle:
        """Run until the goal ends; wait for the planner's thread while it works."""
        bench = self.bench
        hung = 0
        while not handle.is_done:
            bench.tick()
            while hung < hangs and HangingPlanner.at_work.acquire(blocking=False):
                hung += 1
            if hung >= hangs and self.planning.is_busy and self.planning.hung >= hangs:
                assert self.answered.acquire(timeout=PATIENCE_S)
            assert bench.robot.time < 300.0
        return handle


@pytest.fixture
def hung(request: pytest.FixtureRequest) -> Generator[Hung]:
    found = Hung(request.param)
    yield found
    HangingPlanner.gate.set()
    assert found.planning.close(PATIENCE_S)


@pytest.mark.parametrize("hung", [1], indirect=True)
def test_a_planner_that_hangs_is_replaced(hung: Hung) -> None:
    bench = hung.bench
    first = bench.move_base.send_goal(GOAL)
    bench.run_to(0.2)
    assert HangingPlanner.at_work.acquire(timeout=PATIENCE_S)
    bench.run(first)
    # the patience ends this goal, not the hang
    assert (first.status, first.result.error_name) == (GoalStatus.ABORTED, "TIMEOUT")
    assert first.result.ended_at < 6.0
    with pytest.raises(BusyError):
        bench.move_base.make_plan(GOAL)
    second = bench.move_base.send_goal(Pose2D(2.0, 0.0))
    while hung.planning.hung == 0:
        bench.tick()
    assert bench.robot.time == pytest.approx(8.0, abs=0.5)
    assert not second.is_done
    assert hung.run(second, 0).status is GoalStatus.SUCCEEDED
    assert (HangingPlanner.made, hung.planning.hung) == (2, 1)


@pytest.mark.parametrize("hung", [MAX_HUNG], indirect=True)
def test_a_planner_that_hangs_repeatedly_is_abandoned(hung: Hung) -> None:
    bench = hung.bench
    bench.move_base.reconfigure(MoveBaseParams(**(bench.move_base.params.model_dump() | {"planner_patience": 100.0})))
    goal = bench.move_base.send_goal(GOAL)
    for n in range(MAX_HUNG):
        bench.tick()
        assert HangingPlanner.at_work.acquire(timeout=PATIENCE_S)
        while hung.planning.hung == n:
            bench.tick()
    assert not goal.is_done
    messages = [e.text for e in bench.listener.of("plan_failed")]
    assert messages[0] == "the global planner has worked on one plan for more than 8 s: its thread was abandoned"
    assert (
        messages[-1] == f"the global planner hung {MAX_HUNG} times, for more than 8 s each: configure another planner"
    )
    # every request is now answered at once, and the goal ends
    bench.run(goal)
    assert (goal.status, goal.result.error_name) == (GoalStatus.ABORTED, "TIMEOUT")
    assert HangingPlanner.made == MAX_HUNG
    # a new planner receives requests again
    bench.move_base.reconfigure(global_planner=HangingPlanner())
    assert hung.run(bench.move_base.send_goal(Pose2D(1.0, 0.0)), 0).status is GoalStatus.SUCCEEDED
    assert hung.planning.hung == 0
