"""The documentation of the state machine: page and picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.move_base import ROWS, Mode, document_markdown
from navstack.move_base.states import Action, NavEvent
from navstack.plot.states import edges

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_page_is_current() -> None:
    assert (DOCS / "reference" / "states.md").read_text(encoding="utf-8") == document_markdown(), (
        "run: navstack info --states docs/reference/states.md, and docs/images/states.png"
    )
    assert (DOCS / "images" / "states.png").is_file()


def test_the_page_lists_all_events_and_actions() -> None:
    lines = document_markdown().split("\n")
    for name in (*NavEvent.__members__, *Action.__members__):
        assert any(line.startswith(f"| {name} |") for line in lines), name
    assert sum(line.startswith(tuple(f"| {m.name} | " for m in Mode)) for line in lines) == len(ROWS)


def test_the_picture_has_every_event() -> None:
    own, common, loops = edges()
    for row in ROWS:
        name = row.event.name
        shown = (
            name in own.get((row.mode, row.to), [])
            or (row.mode is not Mode.IDLE and name in common.get((Mode.PLANNING, row.to), []))
            or (row.mode is row.to and name in loops[row.mode])
        )
        assert shown, row


@pytest.mark.slow
def test_the_command_writes_picture_and_page(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "states.png"
    assert run(["info", "--states", str(picture), "--json"]) == 0
    assert json.loads(capfd.readouterr().out) == {"states": str(picture)}
    with Image.open(picture) as image:
        assert min(image.size) > 600
    assert run(["info", "--states", str(tmp_path / "s.md")]) == 0
    assert (tmp_path / "s.md").read_text(encoding="utf-8") == document_markdown()
    assert run(["info", "--states", str(tmp_path / "s.gif")]) == 2
