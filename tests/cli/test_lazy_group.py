"""The table of commands agrees with the commands, and the help imports none of them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from navstack.cli.app import command_tree
from navstack.cli.lazy_group import LazyGroup


def _listed(group: Any, path: str = "navstack") -> Iterator[tuple[str, str, str]]:
    for name, command in group.commands.items():
        own = " ".join((command.help or "").split("\n\n")[0].split())
        if isinstance(group, LazyGroup):
            yield f"{path} {name}", group.table[name].help, own
        if isinstance(command, LazyGroup):
            yield from _listed(command, f"{path} {name}")


@pytest.mark.parametrize(("command", "listed", "own"), list(_listed(command_tree())), ids=lambda value: value[:30])
def test_the_table_of_commands_has_the_first_sentences_of_their_help(command: str, listed: str, own: str) -> None:
    assert listed == own, command


@pytest.mark.slow
def test_the_help_imports_no_command() -> None:
    code = "import sys; from navstack.cli.app import run; run(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Plan a path on a map" in done.stdout
    loaded = set(done.stderr.split())
    assert not {"numpy", "numba", "pydantic", "navstack.core", "navstack.cli.plan", "navstack.cli.ros1"} & loaded


def test_the_commands_load_without_the_extras() -> None:
    """Their help is there after `pip install .`, and a command that needs an extra says which one."""
    extras = ("aiohttp", "optuna", "dask", "distributed", "rosbags", "mcap", "foxglove", "gymnasium", "paho", "ruamel")
    code = f"""
import sys
sys.modules.update(dict.fromkeys({extras}))
from navstack.cli.app import command_tree, run
command_tree()
sys.exit(run(["live"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert "navstack live needs aiohttp, which is not installed; install the extra `live`" in " ".join(
        done.stderr.split()
    )
