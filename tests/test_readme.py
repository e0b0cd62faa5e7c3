"""The README's commands and Python run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

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


def test_every_command_named_is_there() -> None:
    from navstack.cli import explain
    from navstack.cli.app import app

    known = {command.name for command in (*app.registered_commands, *app.registered_groups)}
    named = set(re.findall(r"^navstack ([a-z]+)", README, re.MULTILINE))
    assert named <= known
    assert known <= named, f"not in the README: {known - named}"
    explained = {command.name for command in explain.app.registered_commands}
    assert explained <= set(re.findall(r"^navstack explain ([a-z]+)", README, re.MULTILINE))


@pytest.mark.parametrize("index", range(README.count("```python\n")))
def test_python_runs_as_it_stands(index: int, tmp_path: Path) -> None:
    code = re.findall(r"```python\n(.+?)```", README, re.DOTALL)[index]
    out = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True, env=os.environ
    )
    assert out.returncode == 0, out.stderr
    assert "SUCCEEDED" in out.stdout
