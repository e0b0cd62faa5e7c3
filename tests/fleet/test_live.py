"""The session of a fleet: one robot is shown, and takes goals; what was done is done again after going back."""

from __future__ import annotations

import json

import pytest

from navstack.core import InputError
from navstack.fleet import make_fleet
from navstack.live import FleetSession, Options, Stage
from navstack.live import messages as live_messages
from navstack.live.messages import Frame
from navstack.live.stage import world_frame
from navstack.live.view import SessionView
from tests.fleet.stage import WEST, scenario

IDLE = scenario((1.0, 1.0, 0.0))


def drive(session: FleetSession, until: float) -> None:
    while session.time < until and session.advance(10.0, budget_s=10.0, timer=lambda: 0.0, limit=until):
        pass


@pytest.fixture
def session() -> FleetSession:
    return FleetSession(make_fleet({"idle": IDLE, "west": WEST}, seed=2), speed=None)


def test_goals_are_for_the_selected_robot(session: FleetSession) -> None:
    assert (session.robots, session.selected) == (("idle", "west"), "idle")
    drive(session, 1.0)
    session.interact({"kind": "goal", "pose": [3.0, 1.0, 0.0]})
    drive(session, 4.0)
    runs = session.together.runs
    assert runs["idle"].robot.pose.x > 1.5
    assert [list(sent.pose or ()) for sent in runs["idle"].goals.under_way] == [[3.0, 1.0, 0.0]]
    session.select("west")
    assert session.run is runs["west"]
    session.interact({"kind": "cancel"})
    drive(session, 8.0)
    assert [outcome.state for outcome in runs["west"].outcomes] == ["PREEMPTED"]
    with pytest.raises(InputError, match='there is no robot "north"; robots: idle, west'):
        session.select("north")


def test_going_back_does_again_what_was_done_to_every_robot(session: FleetSession) -> None:
    drive(session, 1.0)
    session.interact({"kind": "goal", "pose": [3.0, 1.0, 0.0]})
    drive(session, 2.0)
    session.select("west")
    session.interact({"kind": "cancel"})
    drive(session, 5.0)
    before = {name: list(run.robot.pose) for name, run in session.together.runs.items()}, session.time
    session.seek(0.5)
    session.finish_seek()
    assert session.time < 1.0
    session.seek(before[1])
    session.finish_seek()
    assert ({name: list(run.robot.pose) for name, run in session.together.runs.items()}, session.time) == before


def test_a_page_gets_the_robots_and_draws_the_others(session: FleetSession) -> None:
    stage = Stage([session], Options())
    drive(session, 1.0)
    header = world_frame(stage, server="1", read_only=False).header
    assert (header["robots"], header["robot"]) == (["idle", "west"], "idle")
    entries = SessionView(session).frame(Frame({"type": "frame"}))
    (polygon,) = entries["polygons"]
    assert polygon[0] == "west"
    x = polygon[1::2]
    at = session.together.runs["west"].robot.pose.x
    assert sum(x) / len(x) == pytest.approx(at, abs=0.15)
    assert entries["robots"] == [
        ["west", *(pytest.approx(v, abs=1e-3) for v in session.together.runs["west"].robot.pose), ""]
    ]
    request = live_messages.read_request(json.dumps({"type": "robot", "name": "west", "id": 3}))
    assert stage.request(request).ok
    assert session.selected == "west"
