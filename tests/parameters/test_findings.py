"""Findings about the published robots, recorded in one reviewed file per robot.

After an intended change: `NAVSTACK_WRITE_FINDINGS=1 pytest tests/parameters/test_findings.py`, then read the difference.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from navstack.parameters.configuration import check_parameters
from tests.conftest import data_files
from tests.parameters.robots import launched

CHECKED_IN = Path(__file__).parent / "findings"
ROBOTS = sorted(p.name for p in data_files("params/*") if p.is_dir())
PARTS = {
    # folders with the files of several robots: the sources that a user names instead
    "linorobot": [
        [f"params/linorobot/{name}_params.yaml" for name in (*common, "base_local_planner_default", "move_base")]
        for common in [("costmap_common", "local_costmap", "global_costmap")]
    ],
    "turtlebot2": [["params/turtlebot2/param"]],
}


def sources_of(robot: str) -> list[list[str]]:
    """The folder, then its launch files."""
    launches = sorted(Path(f"params/{robot}/_launch").glob("*"))
    return [[f"params/{robot}"], *PARTS.get(robot, []), *(launched(p) for p in launches)]


def text_of(sources: list[list[str]]) -> str:
    """One section per way of loading, one line per finding."""
    lines: list[str] = []
    for one in sources:
        lines.append(f"# {' '.join(one)}")
        for f in check_parameters(one):
            hint = f" -> {f.suggestion}" if f.suggestion else ""
            # the list of what there is grows with every plugin
            message = re.sub(r"known: [^;]*", "known: ..", f.message)
            lines.append(f"{f.location}: {f.severity}: {message} ({f.rule}){hint}")
        lines.append("")
    return "\n".join(lines)


def compare(name: str, text: str) -> None:
    file = CHECKED_IN / f"{name}.txt"
    if os.environ.get("NAVSTACK_WRITE_FINDINGS"):
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(not ROBOTS, reason="no foreign data here: set NAVSTACK_DATA to their folder")
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_published_robot(robot: str, data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not (CHECKED_IN / f"{robot}.txt").exists() and not os.environ.get("NAVSTACK_WRITE_FINDINGS"):
        return  # another collection of robots: tests/test_configuration.py looks at those
    monkeypatch.chdir(data_dir)
    compare(robot, text_of(sources_of(robot)))


def test_the_misspelt_turtlebot(data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(data_dir)
    compare("params_misspelt", text_of([["params_misspelt"]]))
