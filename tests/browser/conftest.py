"""The live page in a real Chromium: Debian's package, driven by Playwright.

These tests run with NAVSTACK_BROWSER_TESTS=1, and fail without it then. One browser per worker; the server runs in a
thread of the test, so that a test can look into the session.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from navstack.live import Gate, LiveServer, Options, Origin, ServerThread, Session, Stage
from navstack.map_io import map_path
from navstack.scenario import Scenario, load_scenario

WANTED = os.environ.get("NAVSTACK_BROWSER_TESTS") == "1"
CHROMIUM = os.environ.get("NAVSTACK_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
TIMEOUT_MS = 180_000
"""Longest wait for something on the page: far more than it takes, also on a busy machine."""
CORRIDOR = "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[4.8, 7.45, 0.0]]\n"
"""A goal 4 m away, in the corridor of the office."""


WATCH_MESSAGES = """() => {
    window.messages = [];
    new MutationObserver((changes) => changes.forEach((change) => change.addedNodes.forEach((item) => {
        if (item.classList.contains('error')) window.messages.push(item.textContent);
    }))).observe(document.getElementById('toasts'), { childList: true });
}"""


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    if CHROMIUM is None:
        message = "no Chromium: install it with tools/install_chromium.sh, or name one in NAVSTACK_CHROMIUM"
        pytest.fail(message) if WANTED else pytest.skip(message)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        message = "no playwright: pip install '.[test]'"
        pytest.fail(message) if WANTED else pytest.skip(message)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-dev-shm-usage"])
        yield browser
        browser.close()


class Live:
    """A running server."""

    def __init__(
        self,
        stage: Stage,
        *,
        read_only: bool = False,
        port: int = 0,
        host: str = "127.0.0.1",
        prepare: Callable[[Any], Stage] | None = None,
    ) -> None:
        """`prepare` is called when the server runs, and returns the stage."""
        self.stage = stage
        self.session: Session = stage.main
        self._thread = ServerThread(LiveServer(prepare or stage, Gate(host), read_only=read_only), host, port)
        self.address, self.call, self.stop = self._thread.address, self._thread.call, self._thread.stop

    @property
    def port(self) -> int:
        return int(self.address.split(":")[2].split("/")[0])


@pytest.fixture
def scenario(tmp_path: Path) -> Callable[[str], Scenario]:
    """Loads a scenario from its text."""

    def load(text: str = CORRIDOR) -> Scenario:
        file = tmp_path / "scenario.yaml"
        file.write_text(text, encoding="utf-8")
        return load_scenario(file)

    return load


@pytest.fixture
def live(scenario: Callable[[str], Scenario], tmp_path: Path) -> Iterator[Callable[..., Live]]:
    """Starts servers: `live(text, speed=..)` on a scenario's text; `ahead` is simulated before the page opens (s)."""
    started: list[Live] = []

    def start(
        text: str = CORRIDOR,
        *,
        speed: float | None = 20.0,
        stage: Stage | None = None,
        paused: bool = False,
        ahead: float = 0.0,
        **others: Any,
    ) -> Live:
        if stage is None:
            session = Session(scenario(text), origin=Origin(map_path("office"), ("turtlebot",)), speed=speed)
            while session.time < ahead and not session.is_done:
                session.step_once()
            session.pause(paused)
            stage = Stage([session], Options(save_to=tmp_path / "saved"))
        made = Live(stage, **others)
        started.append(made)
        return made

    yield start
    for server in started:
        server.stop()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens pages: `open_page(live)`. At the end: no error on a console, no request to another host, no unexpected message.

    The texts of error messages that a test provokes stand in `page.expected`.
    """
    contexts: list[Any] = []
    pages: list[Any] = []
    problems: list[str] = []

    def open_(live: Live, *, size: tuple[int, int] = (1280, 800), **context: Any) -> Any:
        made = browser.new_context(viewport={"width": size[0], "height": size[1]}, **context)
        made.set_default_timeout(TIMEOUT_MS)
        contexts.append(made)
        page = made.new_page()
        page.on("console", lambda m: problems.append(f"console: {m.text}") if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: problems.append(f"error: {error}"))
        origin = live.address.split("?")[0]
        allowed = (origin, "data:", "blob:", origin.replace("http", "ws", 1))
        page.on("request", lambda r: None if r.url.startswith(allowed) else problems.append(f"request: {r.url}"))
        page.goto(live.address)
        page.wait_for_function("() => window.navstack?.store.main?.pose && window.navstack.scene.frames > 0")
        page.problems = problems
        page.expected = []
        page.evaluate(WATCH_MESSAGES)
        pages.append(page)
        return page

    yield open_
    for page in pages:
        texts = [] if page.is_closed() else page.evaluate("() => window.messages ?? []")
        problems += [f"message: {text}" for text in texts if not any(part in text for part in page.expected)]
    for context in contexts:
        context.close()
    assert problems == []


def at(page: Any, x: float, y: float) -> tuple[float, float]:
    """Position on the page of a point of the map (m)."""
    u, v = page.evaluate(f"window.navstack.camera.toScreen({x}, {y})")
    box = page.locator("#scene").bounding_box()
    return box["x"] + u, box["y"] + v


def drag(page: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drags the mouse between two points of the map (m)."""
    page.mouse.move(*at(page, *start))
    page.mouse.down()
    page.mouse.move(*at(page, *end), steps=4)
    page.mouse.up()


def wait_until(page: Any, condition: str) -> None:
    """Waits for a condition in JavaScript; `side` is the session as the page knows it."""
    page.wait_for_function(f"() => {{ const side = window.navstack.store.main; return {condition}; }}")


def value(page: Any, expression: str) -> Any:
    """An expression in JavaScript with `side`."""
    return page.evaluate(f"() => {{ const side = window.navstack.store.main; return {expression}; }}")
