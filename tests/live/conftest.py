"""Sessions for the tests of the live page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from navstack.live.checkpoints import Origin
from navstack.live.session import Session
from navstack.map_io import map_path
from navstack.scenario import Scenario, load_scenario

ORIGIN = Origin(map_path("office"), ("turtlebot",))


@pytest.fixture(scope="session")
def office_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scenario in the corridor of the office: a goal 4 m away."""
    file = tmp_path_factory.mktemp("live") / "corridor.yaml"
    file.write_text("map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[4.8, 7.45, 0.0]]\n", encoding="utf-8")
    return file


@pytest.fixture
def office(office_file: Path) -> Scenario:
    return load_scenario(office_file)


@pytest.fixture
def session(office: Scenario) -> Session:
    return Session(office, origin=ORIGIN)


@pytest.fixture
def run_to() -> Callable[[Session, float], None]:
    """A function that simulates up to a time, or to the end."""

    def advance(session: Session, until: float = float("inf")) -> None:
        while session.time < until and not session.is_done:
            session.step_once()

    return advance
