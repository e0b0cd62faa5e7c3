"""The notebook of the examples: its cells run one after the other, and what it learns drives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("gymnasium")

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "learning" / "first_policy.ipynb"


@pytest.mark.slow
def test_its_policy_crosses_worlds_that_it_has_not_seen(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code), "save it without outputs"
    names: dict[str, Any] = {}
    try:
        for number, cell in enumerate(code):
            exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, code cell {number}", "exec"), names)
        assert names["plt"].get_fignums()
    finally:
        names["plt"].close("all")
    assert (names["picture"] == (31, 119, 180)).all(axis=2).sum() > 50  # the way
    assert names["crossed"].mean() >= 0.75
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("policy") and "1/1 goals" in line and line.endswith("0 collisions") for line in lines)
    assert sum(line.startswith("dwa") and "1/1 goals" in line for line in lines) == 3
    assert not names["file"].exists()
