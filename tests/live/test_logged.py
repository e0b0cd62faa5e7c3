"""The record of a replay opens with a time line."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core import InputError, RecordError
from navstack.explain import explain_command
from navstack.live import messages
from navstack.live import stage as answers
from navstack.live.logged import LoggedSession
from navstack.live.messages import Frame
from navstack.live.stage import Options, Stage, world_frame
from navstack.live.view import LAYERS, SessionView
from navstack.record import Record
from tests.replay.test_replay import Maker, record_of, replayed


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """The record of a replay of 6 s: the robot drives towards a wall."""
    return record_of(replayed(Maker(tmp_path_factory.mktemp("logged") / "robot.bag").write()))


def advance(session: LoggedSession, until: float = float("inf")) -> None:
    while session.time < until and not session.is_done:
        session.step_once()


@pytest.mark.slow
def test_a_replay_has_a_time_line(record: Record) -> None:
    session = LoggedSession(record)
    stage = Stage([session], Options(fixed=True))
    assert session.paused and session.end == record.times[-1]
    view, frame = SessionView(session), Frame({"type": "frame"})
    view.set_layers(frozenset(LAYERS))
    world_frame(stage, server="1", read_only=False).encode()
    view.frame(frame)
    advance(session)
    assert session.time == record.times[-1] and session.is_done
    assert session.run.robot.pose == pytest.approx(record.pose_at(session.time))
    entries = view.frame(frame)
    frame.header["side"] = entries
    assert frame.encode()
    assert {"samples", "events", "trail", "plans", "costmaps", "scan", "trajectories"} <= entries.keys()
    assert entries["goals"]["under_way"] == [{"number": 1, "pose": [3.0, 0.0, 0.0], "state": "ACTIVE"}]
    assert entries["clock"] == entries["t"] and entries["length"] == pytest.approx(0.2 * session.time, abs=0.05)
    session.seek(3.0)
    session.finish_seek()
    assert 3.0 <= session.time < 3.3 and session.end == record.times[-1] and not session.is_done
    command = stage.prepare_slow(messages.read_request('{"type": "explain_command", "id": 7}'))().text
    assert command == answers.why_command(record, session.time)
    assert f"{explain_command(record, session.time).time:.3f}" in command
    happened = stage.prepare_slow(messages.read_request('{"type": "explain_goal", "id": 8, "number": 1}'))().text
    assert happened == answers.what_happened(record, 1)
    assert "robot at (0.60, 0.00)" in answers.why_cell(session, 4.02, 0.0, "global")
    for refused in ('{"type": "cancel", "id": 9}', '{"type": "restart", "id": 10}'):
        with pytest.raises(InputError, match="recorded run"):
            stage.request(messages.read_request(refused))
    with pytest.raises(InputError, match="only the time can be changed"):
        session.interact({"kind": "cancel"})


def test_a_log_that_has_changed_or_gone_is_noticed(record: Record, tmp_path: Path) -> None:
    other = Maker(tmp_path / "other.bag")
    other.goal = None
    stored = record.scenario["log"]
    changed = {**record.scenario, "log": {**stored, "path": str(other.write())}}
    session = LoggedSession(Record({**record.meta, "scenario": changed}, [], record.arrays))
    with pytest.raises(RecordError, match=r"the replay of the log is not that of the record \(its commands differ\)"):
        advance(session)
    gone = {**record.scenario, "log": {**stored, "path": str(tmp_path / "gone.bag")}}
    with pytest.raises(RecordError, match="which is needed again"):
        LoggedSession(Record({**record.meta, "scenario": gone}, [], record.arrays))
