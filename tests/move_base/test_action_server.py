from __future__ import annotations

import pytest

from navstack.core import GoalTransitionError, InputError, Pose2D
from navstack.move_base import Goal, GoalStatus, SimpleActionServer, goals
from navstack.move_base.goals import GoalHandle

S = GoalStatus


def goal(name: str, stamp: float = 1.0) -> Goal:
    return Goal(Pose2D(1.0, 2.0), "map", name, stamp)


@pytest.fixture
def server() -> SimpleActionServer:
    return SimpleActionServer()


def test_submit_accept_and_end(server: SimpleActionServer) -> None:
    heard: list[tuple[str, GoalStatus, str]] = []
    server = SimpleActionServer(lambda handle, now: heard.append((handle.id, handle.status, handle.text)))
    a = server.submit(goal("a"), 1.0)
    assert (a.status, a.is_done, server.is_new_goal_available) == (S.PENDING, False, True)
    with pytest.raises(InputError, match="PENDING"):
        _ = a.result
    assert server.accept(2.0) is a
    assert (a.status, server.is_active, server.is_new_goal_available) == (S.ACTIVE, True, False)
    server.set_succeeded(3.0, "Goal reached.")
    assert (a.status, a.is_done, server.is_active) == (S.SUCCEEDED, True, False)
    assert (a.result.sent_at, a.result.accepted_at, a.result.ended_at, a.result.time_s) == (1.0, 2.0, 3.0, 2.0)
    assert heard == [
        ("a", S.PENDING, ""),
        ("a", S.ACTIVE, "This goal has been accepted by the simple action server"),
        ("a", S.SUCCEEDED, "Goal reached."),
    ]


def test_calls_without_a_goal(server: SimpleActionServer) -> None:
    with pytest.raises(GoalTransitionError):
        server.accept(0.0)
    with pytest.raises(GoalTransitionError):
        server.set_aborted(0.0, "")
    server.submit(goal("a"), 0.0)
    server.accept(0.0)
    server.set_aborted(0.0, "")
    with pytest.raises(GoalTransitionError):
        server.set_succeeded(0.0, "")


def test_a_new_goal_replaces_the_current_one_when_it_is_accepted(server: SimpleActionServer) -> None:
    a = server.submit(goal("a", 1.0), 1.0)
    server.accept(1.0)
    b = server.submit(goal("b", 2.0), 2.0)
    assert (a.status, b.status, server.preempt_requested) == (S.ACTIVE, S.PENDING, True)
    server.accept(3.0)
    assert (a.status, a.text) == (S.PREEMPTED, goals.REPLACED)
    assert a.result.error_name == "REPLACED"
    assert (b.status, server.preempt_requested) == (S.ACTIVE, False)


def test_a_newer_goal_recalls_the_waiting_goal(server: SimpleActionServer) -> None:
    a, b = server.submit(goal("a", 1.0), 1.0), server.submit(goal("b", 2.0), 2.0)
    assert (a.status, a.text, a.result.error_name) == (S.RECALLED, goals.REPLACED, "REPLACED")
    assert server.next is b


@pytest.mark.parametrize("waiting", [False, True])
def test_a_goal_with_an_older_stamp_is_recalled(server: SimpleActionServer, waiting: bool) -> None:
    first = server.submit(goal("a", 5.0), 5.0)
    if not waiting:
        server.accept(5.0)
    late = server.submit(goal("b", 4.9), 6.0)
    assert (late.status, late.text) == (S.RECALLED, goals.REPLACED)
    assert first.status is (S.PENDING if waiting else S.ACTIVE)
    same = server.submit(goal("c", 5.0), 6.0)
    assert same.status is S.PENDING


def test_a_goal_stamped_before_an_ended_goal_is_recalled(server: SimpleActionServer) -> None:
    server.submit(goal("a", 5.0), 5.0)
    server.accept(5.0)
    server.set_succeeded(5.5, "")
    assert server.submit(goal("b", 4.0), 6.0).status is S.RECALLED


def test_the_same_id_is_the_same_goal(server: SimpleActionServer) -> None:
    a = server.submit(goal("a"), 1.0)
    assert server.submit(goal("a", 9.0), 2.0) is a
    assert server.find("a") is a


def test_cancel_all(server: SimpleActionServer) -> None:
    a = server.submit(goal("a", 1.0), 1.0)
    server.accept(1.0)
    b = server.submit(goal("b", 2.0), 2.0)
    assert server.cancel(3.0) == [a, b]
    assert (a.status, b.status, server.preempt_requested) == (S.PREEMPTING, S.RECALLING, True)
    # the executor receives the waiting goal already canceled
    server.accept(3.2)
    assert (a.status, b.status, server.preempt_requested) == (S.PREEMPTED, S.PREEMPTING, True)
    server.set_preempted(3.2)
    assert (b.status, b.text, b.result.error_name) == (S.PREEMPTED, "", "CANCELED")


def test_cancel_by_id(server: SimpleActionServer) -> None:
    a = server.submit(goal("a", 1.0), 1.0)
    server.accept(1.0)
    b = server.submit(goal("b", 2.0), 2.0)
    assert server.cancel(3.0, "b") == [b]
    assert (a.status, b.status) == (S.ACTIVE, S.RECALLING)
    assert server.cancel(3.0, "b") == [b]  # no change
    assert b.status is S.RECALLING


def test_cancel_before_arrival(server: SimpleActionServer) -> None:
    assert server.cancel(1.0, "later") == []
    later = server.submit(goal("later", 2.0), 2.0)
    assert (later.status, later.text) == (S.RECALLED, "")
    assert not server.is_new_goal_available


def test_cancel_by_time(server: SimpleActionServer) -> None:
    a = server.submit(goal("a", 1.0), 1.0)
    server.accept(1.0)
    b = server.submit(goal("b", 2.0), 2.0)
    assert server.cancel(3.0, stamp=1.5) == [a]
    assert (a.status, b.status) == (S.PREEMPTING, S.PENDING)
    # later goals with an earlier stamp are recalled on arrival
    early = server.submit(goal("early", 1.5), 3.0)
    assert (early.status, early.text) == (S.RECALLED, goals.CANCELED_BEFORE)
    server.cancel(4.0, stamp=1.0)
    assert server.last_cancel == 1.5


def test_cancel_by_id_and_time(server: SimpleActionServer) -> None:
    a = server.submit(goal("a", 1.0), 1.0)
    server.accept(1.0)
    b = server.submit(goal("b", 2.0), 2.0)
    assert server.cancel(3.0, "b", 1.0) == [a, b]


def test_ended_goals_leave_the_list_after_five_seconds(server: SimpleActionServer) -> None:
    for n in range(3):
        server.submit(goal(str(n), float(n)), float(n))
        server.accept(float(n))
        server.set_succeeded(float(n), "")
    assert [h.id for h in server.statuses()] == ["0", "1", "2"]
    server.prune(6.5)
    assert [h.id for h in server.statuses()] == ["2"]
    assert server.find("0") is None


def test_a_thousand_goals_at_once(server: SimpleActionServer) -> None:
    handles: list[GoalHandle] = [server.submit(goal(str(n), 1.0), 1.0) for n in range(1000)]
    assert [h.status for h in handles[:-1]] == [S.RECALLED] * 999
    assert server.next is handles[-1]
    server.prune(100.0)
    assert len(server.statuses()) == 1
