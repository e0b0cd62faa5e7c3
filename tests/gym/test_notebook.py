"""The notebook of the examples: its cells run one after the other, and what it learns drives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("gymnasium")

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "learning" / "first_policy.ipynb"


@pytest.mark.slow
def test_its_policy_crosses_worlds_that_it_has_not_seen() -> None:
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code), "save it without outputs"
    names: dict[str, Any] = {}
    for number, cell in enumerate(code):
        exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, code cell {number}", "exec"), names)
    assert names["crossed"].mean() >= 0.75
