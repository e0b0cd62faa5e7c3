"""Every row of the outcome table with small parts, with its code and data; test_real_parts.py uses the real parts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import InputError, InternalError, InvalidPathError, Path, Pose2D, Transform2D, Twist2D
from navstack.move_base import GoalStatus, InlinePlanning, Mode, Trigger, goals, states
from navstack.move_base.states import NavEvent
from navstack.plugins import Plan

from .world import Bench, StraightPlanner, TurnAndGo, Waiting, no_control, occupied

S = GoalStatus
FAR = Pose2D(4.0, 0.0)


def test_reached() -> None:
    bench = Bench()
    handle = bench.run(bench.move_base.send_goal(Pose2D(1.0, 0.5, 1.0)))
    assert (handle.status, handle.text) == (S.SUCCEEDED, "Goal reached.")
    result = handle.result
    assert (result.error_code, result.error_name, result.message, result.recoveries) == (0, "NONE", "", 0)
    assert result.data["last_failure"] is None
    assert bench.robot.odom_pose.distance_to(handle.goal.pose) < 0.1
    assert bench.robot.twist == Twist2D()
    assert bench.move_base.state is Mode.IDLE


def test_canceled_while_driving() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(FAR)
    bench.run_to(1.05)
    assert bench.robot.twist != Twist2D()
    bench.move_base.cancel_goal(handle)
    assert handle.status is S.PREEMPTING
    bench.run(handle)
    assert (handle.status, handle.text) == (S.PREEMPTED, "")
    assert (bench.robot.time, bench.robot.twist) == (pytest.approx(1.2), Twist2D())
    assert handle.result.error_name == "CANCELED"


def test_canceled_before_acceptance() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(FAR)
    bench.move_base.cancel_goal(handle.id)
    assert handle.status is S.RECALLING
    bench.run(handle)
    assert (handle.status, handle.text, bench.robot.time) == (S.PREEMPTED, "", 0.0)
    assert not bench.planner.calls  # type: ignore[attr-defined]


def test_replaced_by_a_new_goal() -> None:
    bench = Bench()
    first = bench.move_base.send_goal(FAR)
    bench.run_to(2.0)
    second = bench.move_base.send_goal(Pose2D(0.0, 2.0))
    assert (first.status, second.status) == (S.ACTIVE, S.PENDING)
    bench.run(second)
    assert (first.status, first.text) == (S.PREEMPTED, goals.REPLACED)
    assert first.result.error_name == "REPLACED"
    assert second.status is S.SUCCEEDED


def test_recalled_for_a_newer_goal_or_an_older_stamp() -> None:
    bench = Bench()
    first = bench.move_base.send_goal(FAR)
    bench.run_to(2.05)
    waiting = bench.move_base.send_goal(Pose2D(1.0, 1.0))
    newest = bench.move_base.send_goal(Pose2D(0.0, 1.0))
    older = bench.move_base.send_goal(Pose2D(0.0, 1.0), stamp=-1.0)
    assert (waiting.status, waiting.text) == (S.RECALLED, goals.REPLACED)
    assert (older.status, older.text) == (S.RECALLED, goals.REPLACED)
    bench.run(newest)
    assert [h.status for h in (first, newest)] == [S.PREEMPTED, S.SUCCEEDED]


def test_stamped_before_the_last_cancel() -> None:
    bench = Bench()
    bench.run_to(3.0)
    bench.move_base.cancel_goals_at_and_before(2.5)
    handle = bench.move_base.send_goal(FAR, stamp=2.0)
    assert (handle.status, handle.text) == (S.RECALLED, goals.CANCELED_BEFORE)


@pytest.mark.parametrize(
    "orientation",
    [
        (0.0, 0.0, 0.0, 0.0),
        (math.nan, 0.0, 0.0, 1.0),
        (0.0, math.inf, 0.0, 1.0),
        (1e-4, 0.0, 0.0, 0.0),
        (0.1, 0.0, 0.0, 1.0),
        (1.0, 0.0, 0.0, 0.0),
    ],
)
@pytest.mark.parametrize("active", [False, True])
def test_bad_quaternion(orientation: tuple[float, float, float, float], active: bool) -> None:
    bench = Bench()
    if active:
        bench.move_base.send_goal(FAR)
        bench.run_to(2.0)
        assert bench.robot.twist.vx > 0.0
    handle = bench.move_base.send_goal(Pose2D(1.0, 1.0), orientation=orientation)
    bench.run(handle)
    assert (handle.status, handle.text) == (S.ABORTED, states.BAD_QUATERNION)
    assert (handle.result.error_code, handle.result.error_name) == (9013, "INVALID_GOAL")
    # parity 25: the robot is stopped, the planner too
    assert bench.robot.twist == Twist2D()
    calls = len(bench.planner.calls)  # type: ignore[attr-defined]
    bench.run_to(bench.robot.time + 3.0)
    assert len(bench.planner.calls) == calls  # type: ignore[attr-defined]
    good = bench.run(bench.move_base.send_goal(Pose2D(1.0, 0.5)))
    assert good.status is S.SUCCEEDED


def test_a_quaternion_about_z_may_have_any_length() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(Pose2D(1.0, 0.0), orientation=(0.0, 0.0, 3.0, 3.0))
    assert handle.goal.pose.yaw == pytest.approx(math.pi / 2.0)
    assert bench.run(handle).status is S.SUCCEEDED


def test_a_position_that_is_not_finite() -> None:
    bench = Bench()
    handle = bench.run(bench.move_base.send_goal(Pose2D(math.nan, 0.0)))
    assert (handle.status, handle.text) == (S.ABORTED, states.BAD_POSITION)
    nan_yaw = bench.run(bench.move_base.send_goal(Pose2D(0.0, 0.0, math.nan)))
    assert (nan_yaw.status, nan_yaw.text) == (S.ABORTED, states.BAD_QUATERNION)
    with pytest.raises(InputError, match="stamp"):
        bench.move_base.send_goal(FAR, stamp=math.nan)


def test_the_local_planner_rejects_the_plan() -> None:
    driver = TurnAndGo()
    driver.refuse = InvalidPathError("not for me")
    bench = Bench(driver=driver)
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.PLAN_REFUSED)
    assert (handle.result.error_code, handle.result.message) == (103, "not for me")


@pytest.mark.parametrize("enabled", [True, False])
def test_no_plan(enabled: bool) -> None:
    recoveries = [Waiting("a"), Waiting("b", 1.0)]
    bench = Bench(planner=StraightPlanner(occupied), recoveries=recoveries, recovery_behavior_enabled=enabled)
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.NO_PLAN)
    result = handle.result
    assert (result.error_code, result.error_name) == (206, "GOAL_OCCUPIED")
    assert result.recovery_names == (("a", "b") if enabled else ())
    assert result.data["failures"] == {"GOAL_OCCUPIED": result.data["failed_plans"]}
    assert result.data["last_failure"]["message"] == "the goal is in a wall"
    assert result.data["robot"] is not None
    assert result.message.startswith("the goal is in a wall (")
    # 5.0 patience ends, 5.2 a (one step), 5.4 .. 10.2 retries, 10.4 b (1 s), .. 16.4 retries, 16.6 abort
    assert result.time_s == pytest.approx(16.6 if enabled else 5.2)


def test_no_control() -> None:
    recoveries = [Waiting("a"), Waiting("b")]
    bench = Bench(driver=TurnAndGo(no_control), recoveries=recoveries)
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.NO_CONTROL)
    assert (handle.result.error_code, handle.result.error_name) == (106, "NO_VALID_CONTROL")
    assert handle.result.recovery_names == ("a", "b")
    # 3.0 s without a command; a recovery does not restart the patience (C++): every later failure recovers again
    began = [r.started[0] for r in recoveries]
    assert began == pytest.approx([3.2, 3.8])
    assert handle.result.time_s == pytest.approx(4.4)


def test_oscillation() -> None:
    bench = Bench(
        driver=TurnAndGo(lambda n: TurnAndGo.halt(n)),
        recoveries=[Waiting("a")],
    )
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.OSCILLATING)
    assert (handle.result.error_code, handle.result.error_name) == (105, "FAILED_TO_MAKE_PROGRESS")
    assert handle.result.recovery_names == ("a",)
    # 10 s without progress, recovered in the next cycle, another 10 s
    assert bench.move_base.recoveries[0].started == pytest.approx([10.2])  # type: ignore[attr-defined]
    assert handle.result.time_s == pytest.approx(20.4)


def test_turning_in_place_is_progress() -> None:
    # half a radian in 4 s: oscillation in C++ after 10 s
    bench = Bench(driver=TurnAndGo(lambda n: TurnAndGo.turn(0.1)), planner_frequency=0.0)
    bench.move_base.send_goal(FAR)
    bench.run_to(60.0)
    assert bench.move_base.state is Mode.CONTROLLING


def test_one_transition_a_cycle() -> None:
    """C++ continues to control in the cycle that detects the oscillation (parity 24)."""
    driver = TurnAndGo(lambda n: TurnAndGo.halt(n))
    bench = Bench(driver=driver, recoveries=[Waiting("a", 2.0)])
    bench.move_base.send_goal(FAR)
    bench.run_to(10.0)
    calls = driver.calls
    assert bench.move_base.state is Mode.CLEARING
    assert bench.move_base.trigger is Trigger.OSCILLATION_R
    bench.run_to(12.0)
    assert driver.calls == calls
    assert bench.robot.commands[-1][1] == Twist2D(0.0, 0.0, 0.5)


def test_stale_sensors() -> None:
    bench = Bench()
    bench.local_costmap.stale = lambda now: now >= 2.0
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.STALE_SENSORS)
    assert (handle.result.error_code, handle.result.error_name) == (9020, "SENSOR_DATA_STALE")
    assert handle.result.time_s == pytest.approx(5.0)
    # stopped immediately
    assert all(c == Twist2D() for t, c in bench.robot.commands if t >= 2.0)
    warned = [e.text for e in bench.listener.of("warning")]
    assert warned == [states.LOG_STALE.format(name="local_costmap")]
    assert handle.result.data["stale_cycles"] == 16


def test_sensors_that_recover_in_time() -> None:
    bench = Bench()
    bench.local_costmap.stale = lambda now: 2.0 <= now < 4.5
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert handle.status is S.SUCCEEDED
    assert {c for t, c in bench.robot.commands if 2.0 <= t < 4.5} == {Twist2D()}


def test_sensors_become_stale_during_a_recovery() -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[Waiting("turn", 60.0, frequency=20.0)])
    bench.local_costmap.stale = lambda now: now >= 10.0
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert handle.text == states.STALE_SENSORS
    assert handle.result.time_s == pytest.approx(13.0)
    assert all(c == Twist2D() for t, c in bench.robot.commands if t >= 10.0)
    assert any(c != Twist2D() for t, c in bench.robot.commands if 9.9 <= t < 10.0)


def test_shutdown() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(FAR)
    bench.run_to(2.0)
    waiting = bench.move_base.send_goal(Pose2D(1.0, 1.0))
    bench.move_base.shutdown()
    for h in (handle, waiting):
        assert (h.status, h.text, h.result.error_name) == (S.ABORTED, states.KILLED, "SHUTDOWN")
    assert bench.robot.twist == Twist2D()
    late = bench.run(bench.move_base.send_goal(FAR))
    assert (late.status, late.text) == (S.ABORTED, states.KILLED)


def test_a_bug_in_the_state_machine_ends_the_goal() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(FAR)
    bench.run_to(2.0)
    bench.move_base._apply(NavEvent.RECOVERY_ENDED, 2.0)  # illegal while driving
    assert (handle.status, handle.text) == (S.ABORTED, states.BAD_STATE)
    assert (handle.result.error_code, bench.robot.twist) == (9099, Twist2D())
    assert bench.run(bench.move_base.send_goal(Pose2D(1.0, 0.0))).status is S.SUCCEEDED


def test_a_robot_that_rejects_commands() -> None:
    bench = Bench()

    def broken(what: str) -> None:
        if what == "command" and bench.robot.time >= 2.0:
            raise OSError("cable")

    bench.robot.broken = broken
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.DRIVER_FAILED)
    assert "cable" in handle.result.message


# --- goals in other frames --------------------------------------------------------------------------------------------


def test_a_goal_in_another_frame_is_transformed_at_acceptance() -> None:
    bench = Bench(start=Pose2D(1.0, 1.0, math.pi / 2.0), map_to_odom=Transform2D(0.5, 0.0, 0.0))
    handle = bench.move_base.send_goal(Pose2D(1.0, 0.0), "/base_link")
    bench.tick()
    assert bench.move_base.goal_pose == pytest.approx((1.5, 2.0, math.pi / 2.0))
    bench.run(handle)
    assert handle.status is S.SUCCEEDED
    assert bench.robot.odom_pose == pytest.approx((1.0, 2.0, math.pi / 2.0), abs=0.1)


def test_a_goal_in_an_unknown_frame() -> None:
    bench = Bench(recoveries=[Waiting("a")])
    handle = bench.run(bench.move_base.send_goal(Pose2D(1.0, 0.0), "moon"))
    assert (handle.status, handle.text) == (S.ABORTED, states.NO_PLAN)
    assert (handle.result.error_code, handle.result.error_name) == (102, "TF_ERROR")
    assert "moon" in handle.result.message


def test_a_frame_may_arrive_after_the_goal() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(Pose2D(1.0, 0.0), "dock")
    bench.run_to(2.0)
    bench.robot.frames.set_static("map", "dock", Transform2D(0.5, 0.0, 0.0))
    assert bench.run(handle).status is S.SUCCEEDED
    assert bench.robot.odom_pose.x == pytest.approx(1.5, abs=0.1)


def test_the_global_frame_changes_while_driving() -> None:
    bench = Bench()
    handle = bench.move_base.send_goal(Pose2D(3.0, 0.0))
    bench.run_to(2.0)
    bench.robot.frames.set_static("map2", "map", Transform2D(1.0, 0.0, 0.0))
    bench.global_costmap.frame = bench.global_costmap.master.frame = "map2"
    bench.run(handle)
    assert handle.status is S.SUCCEEDED
    assert bench.driver.plans[-1].frame == "map2"  # type: ignore[attr-defined]
    assert bench.driver.goal.x == pytest.approx(4.0)  # type: ignore[attr-defined]
    assert bench.robot.odom_pose.x == pytest.approx(3.0, abs=0.1)


# --- recoveries -------------------------------------------------------------------------------------------------------


def test_a_plan_resets_the_index_after_planning_recoveries() -> None:
    planner = StraightPlanner(lambda n: occupied(n) if n < 60 else None)
    bench = Bench(planner=planner, recoveries=[Waiting("a"), Waiting("b"), Waiting("c")])
    handle = bench.move_base.send_goal(Pose2D(4.0, 0.0))
    seen: list[int] = []
    while not handle.is_done:
        bench.tick()
        seen.append(bench.move_base.recovery_index)
    assert handle.status is S.SUCCEEDED
    assert handle.result.recovery_names == ("a", "b")
    assert max(seen) == 2
    assert seen[-1] == 0


def test_a_failure_of_another_kind_continues_in_the_list() -> None:
    planner = StraightPlanner(lambda n: occupied(n) if n < 26 else None)
    driver = TurnAndGo(no_control)
    bench = Bench(planner=planner, driver=driver, recoveries=[Waiting("a"), Waiting("b"), Waiting("c")])
    handle = bench.run(bench.move_base.send_goal(FAR))
    # the plan after "a" resets the index, since "a" was a planning recovery; the next three are control recoveries
    assert handle.result.recovery_names == ("a", "a", "b", "c")
    assert handle.text == states.NO_CONTROL


def test_alternating_recoveries_end() -> None:
    """Plans reset the index between planning and control recoveries: in C++ such a goal never ends."""

    def planner(n: int) -> None:
        if n % 3:
            occupied(n)

    bench = Bench(
        planner=StraightPlanner(planner),
        driver=TurnAndGo(no_control),
        recoveries=[Waiting("a"), Waiting("b")],
        max_planning_retries=0,
        controller_patience=0.0,
    )
    handle = bench.run(bench.move_base.send_goal(FAR), limit=60.0)
    assert handle.status is S.ABORTED
    assert len(handle.result.recovery_names) <= 3 * 2


@pytest.mark.parametrize(("retries", "failures"), [(0, 1), (3, 4), (-1, 26)])
def test_max_planning_retries(retries: int, failures: int) -> None:
    bench = Bench(planner=StraightPlanner(occupied), max_planning_retries=retries)
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert handle.result.data["failed_plans"] == failures
    assert handle.result.time_s == pytest.approx(0.2 * failures)


def test_a_failed_replan_is_ignored_while_driving() -> None:
    planner = StraightPlanner(lambda n: occupied(n) if n else None)
    bench = Bench(planner=planner)
    handle = bench.run(bench.move_base.send_goal(Pose2D(3.0, 0.0)))
    assert handle.status is S.SUCCEEDED
    assert handle.result.data["failed_plans"] > 3
    assert handle.result.data["plans"] == 1


def test_without_planner_frequency_it_plans_once_and_when_control_fails() -> None:
    driver = TurnAndGo(lambda n: no_control(n) if n == 10 else None)
    planner = StraightPlanner()
    bench = Bench(planner=planner, driver=driver, planner_frequency=0.0)
    handle = bench.run(bench.move_base.send_goal(Pose2D(3.0, 0.0)))
    assert handle.status is S.SUCCEEDED
    assert len(planner.calls) == 2


@pytest.mark.parametrize("frequency", [None, 20.0, 2.0])
@pytest.mark.parametrize("moment", [5.35, 6.0, 7.01, 9.99])
def test_a_cancel_during_a_recovery_takes_effect_within_a_cycle(frequency: float | None, moment: float) -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[Waiting("turn", 30.0, frequency=frequency)])
    handle = bench.move_base.send_goal(FAR)
    bench.run_to(moment)
    assert (bench.move_base.state, bench.move_base.recovery) == (Mode.CLEARING, "turn")
    bench.move_base.cancel_goal(handle)
    bench.run(handle)
    assert handle.status is S.PREEMPTED
    assert bench.robot.time <= moment + 0.2 + 1e-6
    assert (bench.robot.twist, bench.move_base.recovery) == (Twist2D(), None)


def test_a_new_goal_during_a_recovery() -> None:
    planner = StraightPlanner(lambda n: occupied(n) if n < 26 else None)
    bench = Bench(planner=planner, recoveries=[Waiting("turn", 30.0, frequency=20.0)])
    first = bench.move_base.send_goal(FAR)
    bench.run_to(7.0)
    second = bench.move_base.send_goal(Pose2D(1.0, 0.0))
    bench.run(second)
    assert (first.status, second.status) == (S.PREEMPTED, S.SUCCEEDED)
    assert first.result.recovery_names == ("turn",)
    assert second.result.recoveries == 0
    # accepted within one cycle, driving one period later
    accepted = second.result.accepted_at
    assert accepted is not None
    assert accepted <= 7.2 + 1e-6
    turning = [t for t, c in bench.robot.commands if c == Twist2D(0.0, 0.0, 0.5)]
    assert max(turning) <= accepted


# --- slow planners ----------------------------------------------------------------------------------------------------


def test_a_plan_arrives_after_the_planning_time() -> None:
    bench = Bench(planning=InlinePlanning(1.3), planner_frequency=0.0)
    handle = bench.run(bench.move_base.send_goal(Pose2D(2.0, 0.0)))
    assert handle.status is S.SUCCEEDED
    assert [e.time for e in bench.listener.of("plan")] == pytest.approx([1.3])
    moving = [t for t, c in bench.robot.commands if c != Twist2D()]
    assert moving[0] == pytest.approx(1.4)


def test_a_planner_slower_than_its_patience_still_reaches_the_goal() -> None:
    bench = Bench(planning=InlinePlanning(7.0), recoveries=[Waiting("a")], planner_frequency=0.0)
    handle = bench.run(bench.move_base.send_goal(Pose2D(2.0, 0.0)))
    assert handle.status is S.SUCCEEDED
    assert handle.result.recovery_names == ("a",)
    assert handle.result.data["failures"] == {"TIMEOUT": 1}


def test_a_planner_that_never_answers() -> None:
    bench = Bench(planning=InlinePlanning(math.inf), recoveries=[Waiting("a")])
    handle = bench.run(bench.move_base.send_goal(FAR))
    assert (handle.status, handle.text) == (S.ABORTED, states.NO_PLAN)
    assert (handle.result.error_code, handle.result.error_name) == (207, "TIMEOUT")


def test_a_plan_for_a_former_goal_is_discarded() -> None:
    bench = Bench(planning=InlinePlanning(1.0), planner_frequency=0.0)
    bench.move_base.send_goal(Pose2D(4.0, 0.0))
    bench.run_to(0.5)
    second = bench.move_base.send_goal(Pose2D(0.0, 2.0))
    bench.run(second)
    assert second.status is S.SUCCEEDED
    assert [plan.poses[-1, 0] for plan in bench.driver.plans] == [0.0]  # type: ignore[attr-defined]


# --- other --------------------------------------------------------------------------------------------------------------


def test_costmaps_keep_their_own_schedules() -> None:
    bench = Bench()
    bench.run_to(2.01)
    handle = bench.move_base.send_goal(Pose2D(1.0, 0.0))
    bench.run(handle)
    end = bench.robot.time
    assert bench.global_costmap.updates == pytest.approx([float(k) for k in range(int(end) + 1)])
    assert bench.local_costmap.updates == pytest.approx([0.2 * k for k in range(len(bench.local_costmap.updates))])
    assert bench.local_costmap.updates[-1] >= end - 0.2


def test_shutdown_costmaps() -> None:
    bench = Bench(shutdown_costmaps=True)
    bench.run_to(3.0)
    assert not bench.local_costmap.updates
    assert bench.move_base.next_due(3.0) == math.inf
    handle = bench.run(bench.move_base.send_goal(Pose2D(1.0, 0.0)))
    assert handle.status is S.SUCCEEDED
    count = len(bench.local_costmap.updates)
    assert bench.local_costmap.updates[0] == bench.global_costmap.updates[0] == 3.0
    bench.move_base.tick(bench.robot.time + 1.0)
    assert len(bench.local_costmap.updates) == count


def test_time_that_runs_backwards_is_rejected() -> None:
    bench = Bench()
    bench.move_base.tick(1.0)
    for bad in (0.5, math.nan, math.inf):
        with pytest.raises(InputError, match="time must not run backwards"):
            bench.move_base.tick(bad)


def test_ticks_in_between_change_nothing() -> None:
    def drive(extra: bool) -> list[tuple[float, Twist2D]]:
        bench = Bench(planner=StraightPlanner(lambda n: occupied(n) if n in range(2, 9) else None))
        handle = bench.move_base.send_goal(Pose2D(3.0, 1.0, 0.5))
        while not handle.is_done:
            if extra:
                due = bench.move_base.next_due(bench.robot.time)
                while bench.robot.time < due - 0.03:
                    bench.robot.advance_to(bench.robot.time + 0.02)
                    bench.move_base.tick(bench.robot.time)
            bench.tick()
        return bench.robot.commands

    plain, often = drive(False), drive(True)
    assert [t for t, _ in plain] == pytest.approx([t for t, _ in often])
    assert np.allclose([c for _, c in plain], [c for _, c in often], rtol=0.0, atol=1e-6)


def test_feedback() -> None:
    bench = Bench()
    idle = bench.move_base.feedback
    assert (idle.mode, idle.recoveries, idle.navigation_time) == (Mode.IDLE, 0, 0.0)
    handle = bench.move_base.send_goal(Pose2D(3.0, 0.0))
    bench.run_to(2.2)
    feedback = bench.move_base.feedback
    assert feedback.mode is Mode.CONTROLLING
    assert feedback.navigation_time == pytest.approx(2.2)
    assert feedback.pose == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    assert feedback.distance_remaining == pytest.approx(2.0, abs=0.06)
    assert feedback.estimated_time_remaining == pytest.approx(4.4, abs=0.3)
    bench.run(handle)
    assert [e.data["pose"][0] for e in bench.listener.of("feedback")] == sorted(
        e.data["pose"][0] for e in bench.listener.of("feedback")
    )


def test_the_result_of_a_tick() -> None:
    bench = Bench()
    bench.move_base.send_goal(Pose2D(3.0, 0.0))
    bench.tick()
    turn = bench.move_base.last_tick
    assert turn.plan is bench.move_base.plan is not None
    assert turn.global_window is not None
    assert turn.local_window is not None
    assert (turn.local_plan, turn.command) == (None, Twist2D())
    bench.tick()
    turn = bench.move_base.last_tick
    assert turn.time == pytest.approx(0.2)
    assert (turn.plan, turn.global_window) == (None, None)
    assert turn.local_plan is bench.move_base.local_plan is not None
    assert turn.command == bench.move_base.command == turn.local_plan.command


def test_plans_in_another_frame_or_not_finite_are_rejected() -> None:
    wrong = Plan(Path(np.zeros((2, 3)), "odom"), 0.0, Pose2D(0.0, 0.0))
    nan = Plan(Path(np.full((2, 3), np.nan), "map"), 0.0, Pose2D(0.0, 0.0))
    empty = Plan(Path(np.zeros((0, 3)), "map"), 0.0, Pose2D(0.0, 0.0))
    for plan, code in ((wrong, 9099), (nan, 9099), ("a plan", 9099), (empty, 200)):
        bench = Bench(planner=StraightPlanner(lambda n, plan=plan: plan))
        handle = bench.run(bench.move_base.send_goal(FAR))
        assert (handle.text, handle.result.error_code) == (states.NO_PLAN, code)


def test_results_are_plain_data() -> None:
    import json

    bench = Bench(planner=StraightPlanner(occupied))
    handle = bench.run(bench.move_base.send_goal(FAR))
    document = json.loads(json.dumps(handle.result.as_dict()))
    assert document["state"] == "ABORTED"
    assert document["data"]["error"]["code"] == 206
    assert isinstance(handle.result.data["error"]["message"], str)
    assert InternalError.code == 9099


@pytest.mark.parametrize("own", [True, False])
def test_a_time_limit_ends_a_goal_without_end(own: bool) -> None:
    # oscillation_timeout 0: in C++ the robot spins until a cancel
    bench = Bench(driver=TurnAndGo(lambda n: TurnAndGo.turn(0.5)), oscillation_timeout=0.0)
    if not own:
        bench.move_base.goal_time_limit_s = 20.0
    handle = bench.run(bench.move_base.send_goal(FAR, time_limit_s=20.0 if own else None))
    assert (handle.status, handle.text) == (S.ABORTED, states.TIME_LIMIT)
    assert (handle.result.error_code, handle.result.error_name) == (9016, "GOAL_TIME_LIMIT")
    assert handle.result.message == "the goal was not reached within its time limit of 20 s"
    assert handle.result.time_s == pytest.approx(20.0, abs=0.01)
    assert bench.robot.twist == Twist2D()


def test_a_time_limit_counts_from_acceptance_and_also_ends_a_recovery() -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[Waiting("long", 60.0, frequency=20.0)])
    bench.run_to(3.0)
    handle = bench.run(bench.move_base.send_goal(FAR, time_limit_s=10.0))
    assert handle.text == states.TIME_LIMIT
    assert handle.result.ended_at == pytest.approx(13.0, abs=0.21)
    assert handle.result.recovery_names == ("long",)
    assert bench.robot.twist == Twist2D()
    with pytest.raises(InputError, match="a positive time in seconds, not -1"):
        bench.move_base.send_goal(FAR, time_limit_s=-1)
    assert bench.run(bench.move_base.send_goal(FAR, time_limit_s=math.inf)).text == states.NO_PLAN


def test_the_stopwatch_measures_every_call_of_a_planner_also_one_that_fails() -> None:
    reads: list[float] = []

    def stopwatch() -> float:
        reads.append(0.25 * len(reads) ** 2)
        return reads[-1]

    planner, driver = (
        StraightPlanner(lambda n: occupied(n) if n == 0 else None),
        TurnAndGo(lambda n: no_control(n) if n == 0 else None),
    )
    bench = Bench(planner=planner, driver=driver, stopwatch=stopwatch)
    handle = bench.move_base.send_goal(FAR)
    planning: list[float] = []
    control: list[float] = []
    while not handle.is_done:
        bench.tick()
        tick = bench.move_base.last_tick
        planning += [] if tick.planning_s is None else [tick.planning_s]
        control += [] if tick.control_s is None else [tick.control_s]
    assert (len(planning), len(control)) == (len(planner.calls), driver.calls)
    assert planning[0] == reads[1] - reads[0] and len(reads) == 2 * (len(planning) + len(control))
    assert Bench().move_base.last_tick.planning_s is None
