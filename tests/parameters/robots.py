"""The published robots, each with the arguments that load it."""

from __future__ import annotations

import re
from pathlib import Path

from tests.conftest import data_files

ARGUMENTS = ["model:=burger", "name:=fetch", "config:=2d", "cmd_vel_topic:=cmd_vel", "odom_topic:=odom"]


def robots() -> list[list[str]]:
    """Sources of every folder and launch file; empty without the data."""
    folders = [[str(p)] for p in data_files("params/*") if p.is_dir()]
    launches = [launched(p) for p in data_files("params/*/_launch/*")]
    inner = [[str(p)] for p in data_files("params/turtlebot2/param")]
    return folders + launches + inner


def launched(file: Path) -> list[str]:
    """A launch file, with values for its arguments without default."""
    text = file.read_text(encoding="utf-8")
    return [str(file), *(a for a in ARGUMENTS if re.search(rf'<arg\s+name="{a.partition(":=")[0]}"', text))]


def name_of(sources: list[str]) -> str:
    """The name of a file of results, for example `jackal-move_base_DWA`."""
    parts = Path(sources[0]).parts
    at = parts.index("params")
    return "-".join(p for p in (parts[at + 1], *(Path(q).stem for q in parts[at + 2 :])) if p != "_launch")
