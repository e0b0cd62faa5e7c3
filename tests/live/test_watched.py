"""A program steps the simulation: its steps wait for the page's time, and a page sets the pace only."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest

from navstack.core import InputError
from navstack.live import Options, Stage, WatchedSession, messages
from navstack.live.messages import Frame
from navstack.live.stage import world_frame
from navstack.live.view import LAYERS, SessionView
from navstack.scenario import Run, Scenario


@pytest.fixture
def program() -> Iterator[ThreadPoolExecutor]:
    """The thread of the program."""
    with ThreadPoolExecutor(1) as thread:
        yield thread


@pytest.fixture
def session(office: Scenario) -> WatchedSession:
    return WatchedSession(office, run_of(office))


def run_of(scenario: Scenario) -> Run:
    return Run(scenario, record=False, measure=False)


def advance(session: WatchedSession, elapsed_s: float) -> bool:
    return session.advance(elapsed_s, budget_s=1.0, timer=lambda: 0.0)


def asked(session: WatchedSession, program: ThreadPoolExecutor, action: Callable[[], Any]) -> Future[Any]:
    """The result of an action that the program hands over; it waits now."""
    done = program.submit(session.carry_out, action)
    while session._waiting.empty() and not done.done():
        threading.Event().wait(0.001)
    return done


def test_a_step_waits_for_its_time(session: WatchedSession, program: ThreadPoolExecutor) -> None:
    steps = [asked(session, program, session.run.step)]
    session.pause(True)
    assert not advance(session, 1.0) and not steps[0].done()
    session.pause(False)
    assert not advance(session, 0.0) and not steps[0].done()  # no time has passed
    while session.time == 0.0:
        advance(session, 0.02)
        if steps[-1].done():
            steps.append(asked(session, program, session.run.step))
    ahead = session.time
    assert advance(session, 0.5 * ahead) is False and session.time == ahead  # it is ahead of the clock
    assert session.clock == pytest.approx(0.5 * ahead, abs=0.05)
    session.step_once()
    assert session.paused and steps[-1].result(10.0) is True and session.cycles == len(steps)


def test_an_error_is_the_programs(session: WatchedSession, program: ThreadPoolExecutor) -> None:
    def refuse() -> None:
        raise InputError("the action is outside")

    done = asked(session, program, refuse)
    session.step_once()
    with pytest.raises(InputError, match="the action is outside"):
        done.result(10.0)
    assert session.cycles == 0
    waiting = program.submit(session.carry_out, session.run.step, alive=lambda: False)
    with pytest.raises(InputError, match="the server of the live page has ended"):
        waiting.result(10.0)
    session.step_once()
    assert session.cycles == 0  # nobody waits for that step any more


def test_another_episode_begins_in_another_world(session: WatchedSession) -> None:
    view = SessionView(session)
    view.set_layers(frozenset(LAYERS))
    for _ in range(8):
        session.run.step()
        session.history.add(session.run)
    assert view.frame(Frame({"type": "frame"}))["restarts"] == 1
    other = replace(session.scenario, name="second")
    worlds, run = session.worlds, run_of(other)
    session.show(other, run)
    assert session.worlds == worlds + 1 and session.time == run.robot.time and not session.history.samples
    stage = Stage([session], Options(fixed=True))
    header = world_frame(stage, server="1", read_only=False).header
    assert (header["name"], header["fixed"], header["rewinds"]) == ("second", True, False)
    assert view.frame(Frame({"type": "frame"}))["restarts"] == 2


def test_a_page_sets_the_pace_only(session: WatchedSession) -> None:
    stage = Stage([session], Options(fixed=True))

    def ask(text: str) -> Any:
        return stage.request(messages.read_request(text))

    ask('{"type": "speed", "id": 1, "factor": 4}')
    ask('{"type": "pause", "id": 2, "paused": true}')
    assert (session.speed, session.paused) == (4.0, True)
    for refused in (
        '{"type": "cancel", "id": 3}',
        '{"type": "restart", "id": 4}',
        '{"type": "seek", "id": 5, "time": 1.0}',
    ):
        with pytest.raises(InputError, match="a program steps this simulation"):
            ask(refused)
    for action in (session.restart, lambda: session.interact({"kind": "cancel"})):
        with pytest.raises(InputError, match="a program steps this simulation"):
            action()
    with pytest.raises(InputError, match="without a record"):
        stage.prepare_slow(messages.read_request('{"type": "explain_command", "id": 6}'))
    assert session.explained is session.run
