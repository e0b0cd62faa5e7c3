"""The first-person view of a page: sent while it is shown, as often as the camera takes pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from navstack.live.messages import Frame, decode
from navstack.live.session import Session
from navstack.live.view import CAMERA_WIDTH, LAYERS, SessionView
from navstack.sim import camera


def picture_in(view: SessionView) -> Any:
    """The picture (ny, nx, 3) in the next frame, None without one."""
    frame = Frame({"type": "frame"})
    frame.header["side"] = view.frame(frame)
    header, blobs = decode(frame.encode())
    entry = header["side"].get("camera")
    return None if entry is None else np.frombuffer(blobs[entry["blob"]], np.uint8).reshape(entry["ny"], entry["nx"], 3)


def run_for(session: Session, seconds: float) -> None:
    end = session.time + seconds - 1e-9
    while session.time < end:
        session.advance(0.05, budget_s=10.0, timer=lambda: 0.0)


@pytest.fixture
def view(session: Session) -> SessionView:
    view = SessionView(session)
    view.set_layers(frozenset({"camera"}))
    return view


def test_the_picture_is_that_of_the_robot(session: Session, view: SessionView) -> None:
    picture = picture_in(view)
    assert picture.shape == (240, CAMERA_WIDTH, 3)
    assert np.array_equal(picture, session.run.robot.camera(width=CAMERA_WIDTH).rgb)


def test_pictures_come_at_the_rate_of_the_camera(session: Session, view: SessionView) -> None:
    times: list[float] = []
    for _ in range(20):
        if picture_in(view) is not None:
            times.append(session.time)
        run_for(session, 0.05)
    assert len(times) >= 5 and min(np.diff(times)) >= 0.1 - 1e-9


def test_an_obstacle_is_seen_while_the_time_stands(session: Session, view: SessionView) -> None:
    session.pause(True)
    before = picture_in(view)
    assert picture_in(view) is None
    session.interact({"kind": "put", "shape": {"name": "box", "box": [0.3, 0.3], "pose": [2.5, 7.45]}})
    assert (picture_in(view) != before).any()


def test_a_view_that_is_opened_again_gets_a_picture(view: SessionView) -> None:
    assert picture_in(view) is not None
    view.set_layers(frozenset())
    assert picture_in(view) is None
    view.set_layers(frozenset({"camera"}))
    assert picture_in(view) is not None


def test_nothing_is_rendered_for_the_other_layers(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: Any) -> None:
        raise AssertionError("a picture")

    monkeypatch.setattr(camera, "draw", forbidden)
    view = SessionView(session)
    view.set_layers(frozenset(LAYERS) - {"camera"})
    run_for(session, 0.5)
    assert picture_in(view) is None
    view.set_layers(frozenset(LAYERS))
    with pytest.raises(AssertionError, match="a picture"):
        picture_in(view)
