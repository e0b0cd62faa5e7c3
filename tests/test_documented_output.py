"""The output quoted in README.md, docs/concepts/diagnostics.md and docs/tutorials/nav2.md is that of the commands."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from navstack.cli import output
from navstack.cli.app import run

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 116
"""Width of the terminal in the documents."""


def sessions(page: str) -> list[tuple[str, list[str]]]:
    """(command, quoted lines) of every block that begins with `$ navstack`."""
    found: list[tuple[str, list[str]]] = []
    for block in re.findall(r"```\n(\$ navstack .+?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL):
        for line in block.splitlines():
            if line.startswith("$ "):
                found += [(command.strip(), []) for command in line[2:].split(";")]
            elif line.strip():
                found[-1][1].append(line)
    return found


def words(text: str) -> str:
    return " ".join(text.split())


def first_run() -> list[str]:
    """The table below the README's run command."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return [line for line in text.splitlines() if "  SUCCEEDED  " in line]


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Output of each command of the pages, run in one folder after `navstack simulate`."""
    import contextlib
    import io

    outputs: dict[str, str] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("documented"))
        patch.setenv("COLUMNS", str(WIDTH))
        for command in dict.fromkeys(["navstack simulate", *(c for p in PAGES for c, _ in sessions(p))]):
            out = io.StringIO()
            output.stdout.cache_clear()
            with contextlib.redirect_stdout(out):
                assert run(shlex.split(command)[1:]) in (0, 1), command
            outputs[command] = out.getvalue()
    output.stdout.cache_clear()
    return outputs


PAGES = ("README.md", "docs/concepts/diagnostics.md", "docs/tutorials/nav2.md")


@pytest.mark.slow
def test_the_first_run(printed: dict[str, str]) -> None:
    assert len(first_run()) == 3
    shown = {words(line) for line in printed["navstack simulate"].splitlines()}
    assert {words(line) for line in first_run()} <= shown


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_quoted_lines_are_printed(page: str, printed: dict[str, str]) -> None:
    """In this order; `..` stands for omitted text, line breaks do not matter."""
    assert sessions(page)
    for command, lines in sessions(page):
        text, at = words(printed[command]), 0
        for part in filter(None, (part.strip(" ;()") for part in re.split(r"\.\.(?!\.)", words("\n".join(lines))))):
            found = text.find(part, at)
            assert found >= 0, f"{command} does not print: {part}"
            at = found + len(part)
