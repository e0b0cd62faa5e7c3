"""The session: time, interactions, rewind, saving. No web."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from navstack.core import InputError
from navstack.live.session import Session
from navstack.scenario import Scenario, load_scenario, run_scenario

Advance = Callable[..., None]


def test_a_run_without_interactions_gives_the_record_of_simulate(
    session: Session, run_to: Advance, office: Scenario, tmp_path: Path
) -> None:
    run_to(session)
    recorder = run_scenario(office).recorder
    assert recorder is not None
    mine = session.recorded().save(tmp_path / "live")["record"].read_bytes()
    assert mine == recorder.save(tmp_path / "simulate")["record"].read_bytes()


@pytest.mark.slow
def test_a_saved_session_drives_again_byte_for_byte(session: Session, run_to: Advance, tmp_path: Path) -> None:
    run_to(session, 2.0)
    session.interact({"kind": "put", "shape": {"name": "box", "box": [0.3, 0.3], "pose": [3.0, 7.5]}})
    run_to(session, 4.0)
    session.interact({"kind": "queue", "goals": [[2.0, 7.4, 0.0]]})
    session.interact({"kind": "drive", "velocity": [0.1, 0.0, 0.4], "seconds": 0.6})
    run_to(session)
    session.save_scenario(tmp_path / "saved.yaml")
    loaded = load_scenario(tmp_path / "saved.yaml")
    recorder = session.recorded()
    recorder.set_scenario(loaded.as_dict())
    again = run_scenario(loaded).recorder
    assert again is not None
    a, b = recorder.save(tmp_path / "a")["record"], again.save(tmp_path / "b")["record"]
    assert a.read_bytes() == b.read_bytes()


def test_rewind_and_continue(session: Session, run_to: Advance) -> None:
    run_to(session, 6.0)
    pose, end = session.run.robot.pose, session.time
    session.seek(2.0)
    session.finish_seek()
    assert 2.0 <= session.time < 2.5 and session.end == end
    run_to(session, end)
    assert session.run.robot.pose == pose


def test_after_a_rewind_interactions_are_done_again_or_dropped(session: Session, run_to: Advance) -> None:
    run_to(session, 3.0)
    session.interact({"kind": "goal", "pose": [2.0, 7.4, 3.0]})
    run_to(session, 5.0)
    pose = session.run.robot.pose
    for _ in range(2):
        session.seek(1.0)
        session.finish_seek()
        assert [item.kind for item in session.interactions] == ["goal"]
        run_to(session, 5.0)
        assert session.run.robot.pose == pose
    session.seek(1.0)
    session.finish_seek()
    session.interact({"kind": "cancel"})
    assert [item.kind for item in session.interactions] == ["cancel"] and session.end == session.time


def test_a_key_held_down_is_one_interaction(session: Session, run_to: Advance) -> None:
    run_to(session, 1.0)
    for _ in range(4):
        session.interact({"kind": "drive", "velocity": [0.1, 0.0, 0.2], "seconds": 0.5})
        session.step_once()
    assert len(session.interactions) == 1
    run_to(session)
    session.recorded()  # raises if the scenario gives another run


def test_a_parameter_takes_effect_in_the_next_cycle(session: Session, run_to: Advance) -> None:
    run_to(session, 5.0)
    assert session.run.move_base.command.vx > 0.3
    session.interact({"kind": "set", "values": {"DWAPlannerROS/max_vel_x": 0.2, "DWAPlannerROS/max_vel_trans": 0.2}})
    before = session.cycles
    session.step_once()
    assert session.cycles == before + 1
    assert session.run.move_base.local_planner.limits.max_vel_x == 0.2


def test_time_goes_evenly_and_never_in_a_rush(session: Session) -> None:
    ticks = count()
    for _ in range(30):
        session.advance(1.0 / 30.0, budget_s=1.0, timer=lambda: 0.001 * next(ticks))
    assert 0.9 <= session.clock <= 1.1 and session.time >= session.clock
    session.advance(100.0, budget_s=1e9, timer=lambda: 0.0)  # the laptop was asleep
    assert session.time < 1.7
    session.set_speed(None)
    session.advance(0.03, budget_s=0.01, timer=lambda: 0.001 * next(ticks))
    assert session.time > 1.9


def test_pause_step_and_wait(session: Session, run_to: Advance) -> None:
    session.pause(True)
    assert not session.advance(1.0, budget_s=1.0, timer=lambda: 0.0)
    session.step_once()
    first = session.time
    session.step_once()
    assert session.time > first
    run_to(session)
    end = session.time
    session.interact({"kind": "wait", "duration": 5.0})
    assert not session.is_done
    run_to(session)
    assert session.time >= end + 5.0


@pytest.mark.parametrize("speed", [0.0, -1.0, 1e9, float("nan")])
def test_a_wrong_speed_is_refused(session: Session, speed: float) -> None:
    with pytest.raises(InputError, match="not a factor"):
        session.set_speed(speed)
