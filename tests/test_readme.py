"""The README's commands and Python run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from navstack.cli.app import command_tree

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(marker: str) -> str:
    found = re.search(rf"<!-- {marker} -->\n```bash\n(.+?)\n```", README, re.DOTALL)
    assert found, f"README.md has no command marked {marker}"
    return found[1]


def test_ci_runs_the_readmes_test_command() -> None:
    assert block("test") in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_the_run_command_ends_in_the_main_job() -> None:
    *_, last = block("run").split(" && ")
    assert last == ".venv/bin/navstack simulate"


def test_the_commands_named_exist_and_the_page_of_commands_has_all() -> None:
    from navstack.cli.app import COMMANDS as KNOWN
    from navstack.cli.app import EXPLAIN_COMMANDS

    assert set(re.findall(r"^navstack ([a-z0-9-]+)", README, re.MULTILINE)) <= set(KNOWN)
    assert set(KNOWN) <= set(re.findall(r"^navstack ([a-z0-9-]+)", COMMANDS, re.MULTILINE))
    assert set(EXPLAIN_COMMANDS) <= set(re.findall(r"^navstack explain ([a-z]+)", COMMANDS, re.MULTILINE))


@pytest.mark.slow
@pytest.mark.parametrize("index", range(README.count("```python\n")))
def test_python_runs_as_it_stands(index: int, tmp_path: Path) -> None:
    code = re.findall(r"```python\n(.+?)```", README, re.DOTALL)[index]
    out = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True, env=os.environ
    )
    assert out.returncode == 0, out.stderr
    assert "SUCCEEDED" in out.stdout


COMMANDS = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")


def _command(words: list[str]) -> Any:
    """The command that a line of the documents calls: `bench barn DIR ..` -> barn's."""
    found: Any = command_tree()
    for word in words:
        known = getattr(found, "commands", {})
        if word not in known:
            break
        found = known[word]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("line", re.findall(r"^navstack (.+?)(?: {2,}#.*)?$", README + COMMANDS, re.MULTILINE))
def test_the_documents_name_no_option_that_is_not_there(line: str) -> None:
    command = _command(line.split())
    there = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    assert set(re.findall(r"--[a-z-]+", line)) <= there, command.name


def test_the_command_line_page_has_every_command() -> None:
    def leaves(command: Any, path: str) -> set[str]:
        under = getattr(command, "commands", None)
        return {path} if under is None else {leaf for n, c in under.items() for leaf in leaves(c, f"{path} {n}")}

    for path in leaves(command_tree(), "navstack"):
        assert re.search(rf"^{path} ", COMMANDS, re.MULTILINE), path


PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES)
def test_files_that_the_documents_name_are_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    beside = (ROOT / page).parent
    for name in re.findall(r"\]\((?!https?:)([\w./-]+)\)", text):
        assert (beside / name).is_file(), name
    for name in re.findall(r"`((?:docs|navstack|tests|tools|examples)/[\w./-]+)`", text):
        is_parameter = page == "docs/reference/parameters.md"  # a section such as `navstack/motion`
        is_environment = re.search(r"-v\d+$", name) is not None  # an id such as `navstack/LocalControl-v0`
        assert is_parameter or is_environment or (ROOT / name).exists(), name
