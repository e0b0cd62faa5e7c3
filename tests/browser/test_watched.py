"""A program steps the simulation: the page shows its episodes, and sets the pace only."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

from navstack.live import Options, Stage, WatchedSession
from navstack.scenario import Run
from tests.browser.conftest import CORRIDOR, wait_until


def test_the_page_pauses_the_program_and_shows_its_next_episode(scenario: Any, live: Any, open_page: Any) -> None:
    first = scenario(CORRIDOR)
    run = Run(first, record=False, measure=False)
    session = WatchedSession(first, run, speed=4.0)
    server = live(stage=Stage([session], Options(fixed=True)))
    ended = threading.Event()

    def episode(run: Run) -> None:
        def step() -> None:
            run.step()
            session.history.add(run)

        while not ended.is_set():
            session.carry_out(step)

    program = threading.Thread(target=episode, args=(run,), daemon=True)
    program.start()
    page = open_page(server)
    wait_until(page, "side.t > 0.5")
    assert [page.locator(f"#{name}").is_disabled() for name in ("timeline", "back", "restart", "tool-goal")] == [
        True
    ] * 4
    page.click("#play")
    wait_until(page, "side.paused")
    cycles = session.cycles
    page.click("#step")
    wait_until(page, f"side.cycle === {cycles + 1}")
    page.click("#play")
    wait_until(page, "!side.paused && side.t > 1.0")
    second = Run(first, record=False, measure=False)
    ended.set()
    program.join(30.0)
    session.carry_out(lambda: session.show(replace(first, name="another"), second))
    page.wait_for_function("() => document.title.startsWith('another') && window.navstack.store.main?.pose?.[0] < 0.9")
