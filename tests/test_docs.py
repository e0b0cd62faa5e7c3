"""The Python code on the documentation pages runs as it is printed."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import navstack.testing

pytestmark = pytest.mark.slow

DOCS = Path(__file__).resolve().parents[1] / "docs"
BLOCKS = [
    pytest.param(code, id=f"{page.relative_to(DOCS)}-{number}")
    for page in sorted(DOCS.rglob("*.md"))
    for number, code in enumerate(
        re.findall(r"^```python\n(.+?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    )
    if "import navstack as nav" in code
]


@pytest.mark.parametrize("code", BLOCKS)
def test_code_runs(code: str, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", "-c", code]
    out = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ)
    assert out.returncode == 0, out.stderr
    assert out.stdout


@pytest.mark.parametrize("name", ["planner", "layer", "recovery"])
def test_a_tutorial_shows_a_plugin_of_at_most_40_lines(name: str) -> None:
    """`test_code_runs` runs it."""
    text = (DOCS / "tutorials" / f"write_a_{name}.md").read_text("utf-8")
    code = re.findall(r"^```python\n(.+?)^```", text, re.DOTALL | re.MULTILINE)[0]
    assert ".register(" in code and "Params = " in code
    assert len([line for line in code.splitlines() if line.strip()]) <= 40
    # the tables and texts name what there is
    assert hasattr(navstack.testing, next(iter(re.findall(r"navstack\.testing\.(\w+)", text))))


def test_the_site_has_a_page_for_each_component_with_all_its_parameters() -> None:
    pytest.importorskip("mkdocs")
    spec = importlib.util.spec_from_file_location("parameter_pages", DOCS.parent / "tools/docs/parameter_pages.py")
    assert spec is not None and spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = hook
    spec.loader.exec_module(hook)
    text = (DOCS / "reference" / "parameters.md").read_text("utf-8")
    introduction, found = hook.components(text)
    rows = [row for row in text.splitlines() if row.startswith("| `")]
    pages = {component.file: component.page() for component in found}
    assert len(pages) == len(found) > 50  # no two components share a page
    assert sorted(row for component in found for row in component.rows) == sorted(rows)
    assert max(map(len, pages.values())) < len(text) / 6
    assert all(component.group for component in found)
    assert "inflation_radius" in pages["layer_inflation.md"]
    assert all(f"(parameters/{name})" in hook.overview(introduction, found) for name in pages)
    assert hook.anchors(found)["navstacksim"] == "navstack_sim.md"


def test_every_picture_of_the_gallery_is_there_and_drawn_by_a_tool() -> None:
    text = (DOCS / "gallery.md").read_text("utf-8")
    tools = "".join(file.read_text("utf-8") for file in (DOCS.parent / "tools" / "docs").glob("*pictures.py"))
    shown = re.findall(r"!\[.+?\]\(images/(\w+)\.(\w+)\)", text)
    assert len(shown) >= 12
    for stem, suffix in shown:
        assert (DOCS / "images" / f"{stem}.{suffix}").is_file()
        assert stem in tools


def test_there_are_blocks() -> None:
    assert len(BLOCKS) >= 4
