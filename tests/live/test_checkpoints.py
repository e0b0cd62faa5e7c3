"""Copies of a running simulation: exact, bounded, and dropped when they no longer belong to the run."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navstack.live import checkpoints as twin_module
from navstack.live import session as session_module
from navstack.live import stage as answers
from navstack.live.checkpoints import MAX_COUNT, Checkpoints, snapshot
from navstack.live.session import Session
from navstack.parameters import load_configuration
from navstack.scenario import Run, Scenario, load_scenario

Advance = Callable[..., None]

CROWD = """
map: office
start: [0.8, 7.45, 0.0]
goals: [[4.8, 7.45, 0.0], [0.8, 7.45, 3.1]]
sim: {odometry_noise: 0.02, localization_noise: 0.02}
shapes:
  - {name: walker, radius: 0.25, pose: [7.0, 7.2, 0.0], motion: {kind: pedestrian, goals: [[1.0, 7.4], [7.0, 7.2]]}}
  - {name: box, box: [0.3, 0.3], pose: [3.0, 7.9, 0.4]}
"""


def cycle_of(run: Run) -> tuple[float, ...]:
    robot, move_base = run.robot, run.move_base
    costs = int(np.sum(move_base.local_costmap.master.data, dtype=np.int64))
    return robot.time, *robot.pose, *move_base.command, robot.clearance, costs, run.path_length


def drive(run: Run, cycles: int) -> list[tuple[float, ...]]:
    return [cycle_of(run) for _ in range(cycles) if run.step()]


@pytest.fixture
def crowd(tmp_path: Any) -> Scenario:
    file = tmp_path / "crowd.yaml"
    file.write_text(CROWD, encoding="utf-8")
    return load_scenario(file)


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["base_local_planner=base_local_planner/TrajectoryPlannerROS"],
        ["base_local_planner=nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"],
        ["base_global_planner=global_planner/GlobalPlanner"],
    ],
    ids=lambda overrides: "".join(overrides).partition("=")[2].rpartition("/")[2].rpartition(":")[2] or "turtlebot",
)
def test_a_copy_continues_as_the_original(crowd: Scenario, overrides: list[str]) -> None:
    scenario = replace(crowd, configuration=load_configuration(["turtlebot"], overrides=overrides))
    run = Run(scenario, record=False, measure=False)
    drive(run, 30)
    copied = snapshot(run, shared=(scenario,))
    assert copied is not None
    original = drive(run, 60)
    assert len(original) == 60 and original[0] != original[-1]
    assert drive(copied.restore(), 60) == original
    assert drive(copied.restore(), 60) == original  # again: the copy is not used up


def test_arrays_that_share_memory_share_it_in_the_copy() -> None:
    owner = np.zeros((4, 5))
    records = np.zeros(3, [("x", np.float64), ("n", np.int64)])
    parts = SimpleNamespace(
        owner=owner, row=owner[1, ::2], flat=owner.reshape(-1)[5:], record=records[1], records=records
    )
    copied = snapshot(parts)
    assert copied is not None
    again = copied.restore()
    again.row[1] = 7.0
    again.record["n"] = 3
    assert again.owner[1, 2] == 7.0 and again.flat[2] == 7.0 and again.records["n"].tolist() == [0, 3, 0]
    assert owner.sum() == 0.0 and records["n"].sum() == 0


def test_what_cannot_be_written_is_kept_by_reference() -> None:
    frozen, marker = np.arange(5), object()
    frozen.flags.writeable = False
    shared = {"a": 1}
    copied = snapshot([frozen, frozen[1:3], marker, shared, MappingProxyType({"k": 2})], shared=(shared,))
    assert copied is not None
    first, second, third, fourth, fifth = copied.restore()
    assert first is frozen and second.base is frozen and third is marker and fourth is shared
    assert isinstance(fifth, MappingProxyType) and fifth == {"k": 2}


def test_functions_keep_the_variables_around_them() -> None:
    def counter(start: int) -> tuple[Callable[[], int], Callable[[], int]]:
        count = start

        def up() -> int:
            nonlocal count
            count += 1
            return count

        def itself() -> int:
            return count if up is None else up()

        return up, itself

    copied = snapshot(counter(5))
    assert copied is not None
    up, itself = copied.restore()
    assert [up(), itself(), up()] == [6, 7, 8]
    assert copied.restore()[0]() == 6


def test_a_part_that_cannot_be_copied() -> None:
    assert snapshot([1, threading.Lock()]) is None


@pytest.mark.slow
@given(st.lists(st.floats(0.5, 400.0), min_size=1, max_size=150))
def test_checkpoints_are_bounded_and_dense_in_the_recent_past(steps: list[float]) -> None:
    copied = snapshot(0)
    checkpoints, now = Checkpoints(), 0.0
    for number, step in enumerate(steps, 1):
        now += step
        checkpoints.keep(now, number, 0, None, copied)
    times = checkpoints.times
    assert len(times) == min(len(steps), MAX_COUNT) and times == sorted(times) and times[-1] == now
    # the way to simulate again is short in relation to how far one goes back
    for before, after in zip([0.0, *times], times, strict=False):
        assert after - before <= 0.7 * (now - before + 10.0) + max(steps)
    middle = times[len(times) // 2]
    checkpoints.drop_after(middle)
    assert checkpoints.times[-1] == middle
    assert checkpoints.last_before(middle - 0.01) is None or checkpoints.last_before(middle - 0.01).time < middle  # type: ignore[union-attr]


@pytest.fixture
def dense(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checkpoints every few cycles."""
    monkeypatch.setattr(session_module, "SPACING_SLOW", 4)
    monkeypatch.setattr(session_module, "SPACING_FAST", 4)


@pytest.mark.slow
@pytest.mark.usefixtures("dense")
def test_going_back_starts_at_a_checkpoint(session: Session, run_to: Advance) -> None:
    run_to(session, 8.0)
    session.interact({"kind": "put", "shape": {"name": "box", "box": [0.3, 0.3], "pose": [5.5, 7.9]}})
    run_to(session, 12.0)
    end, pose, digest = session.time, session.run.robot.pose, session.twin().digest
    for target in (9.0, 7.9, 3.0, 9.5):
        session.seek(target)
        assert 0.0 <= target - session.time < 2.0  # where it begins to simulate
        session.finish_seek()
        assert target <= session.time < target + 0.5
        assert [item.kind for item in session.interactions] == ["put"]
        assert [s.t for s in session.history.samples][-1] == session.time
    run_to(session, end)
    assert session.run.robot.pose == pose and session.twin().digest == digest
    session.recorded()  # raises if simulating from the start gives another run


@pytest.mark.slow
@pytest.mark.usefixtures("dense")
def test_explanations_from_a_checkpoint_are_those_of_the_whole_run(
    session: Session, run_to: Advance, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_to(session, 4.0)
    session.interact({"kind": "put", "shape": {"name": "box", "box": [0.3, 0.3], "pose": [5.5, 7.9]}})
    session.interact({"kind": "goal", "pose": [1.5, 7.4, 3.0]})
    run_to(session, 7.0)
    session.interact({"kind": "remove", "name": "box"})
    session.interact({"kind": "goal", "pose": [5.0, 7.5, 0.0]})
    run_to(session, 9.6)
    twin = session.twin()
    whole = twin.recorded().record()
    assert len(twin.checkpoints) > 5 and [sent for _, sent in twin.goals] == [0.0, 4.0, 7.0]
    monkeypatch.setattr(twin_module, "NEAR_S", 0.25)
    for time in (twin.until, 9.0, 7.03, 3.3):
        record = twin.record_for_command(time)
        assert len(record.times) < 12 < len(whole.times)
        assert answers.why_command(record, time) == answers.why_command(whole, time)
    for number in (1, 2, 3):
        record, name = twin.record_for_goal(number)
        assert (len(record.times) < len(whole.times)) == (number > 1)
        assert answers.what_happened(record, number, name) == answers.what_happened(whole, number)


@pytest.mark.slow
@pytest.mark.usefixtures("dense")
def test_checkpoints_of_a_dropped_future_are_not_used(session: Session, run_to: Advance) -> None:
    run_to(session, 6.0)
    session.seek(2.0)
    session.finish_seek()
    session.interact({"kind": "goal", "pose": [2.0, 7.4, 3.0]})
    for _ in range(5):
        session.interact({"kind": "drive", "velocity": [0.1, 0.0, 0.2], "seconds": 0.5})
        session.step_once()
    run_to(session, 7.0)
    digest, end = session.twin().digest, session.time
    session.seek(2.3)
    session.finish_seek()
    run_to(session, end)
    assert session.twin().digest == digest
    session.recorded()
    session.restart()
    assert session.time == 0.0 and session.interactions == []
    session.seek(0.0)
    session.finish_seek()
    run_to(session, 3.0)
    session.recorded()


@pytest.mark.usefixtures("dense")
def test_a_plugin_that_cannot_be_copied_is_simulated_from_the_start(session: Session, run_to: Advance) -> None:
    session.run.move_base.local_planner.lock = threading.Lock()  # type: ignore[attr-defined]
    run_to(session, 4.0)
    digest, end = session.twin().digest, session.time
    session.seek(1.0)
    assert session.time == 0.0
    session.finish_seek()
    run_to(session, end)
    assert session.twin().digest == digest
