"""The examples work as a user has them: installed beside navstack, known by their entry points."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "forbidden_disc_layer"
MODULE = EXAMPLE / "forbidden_disc_layer.py"
README = (ROOT / "README.md").read_text(encoding="utf-8")
DISC = (11.4, 7.0, 0.6)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as an installer leaves it: the module, and the metadata that its pyproject.toml asks for."""
    folder = tmp_path_factory.mktemp("site")
    project: Any = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (folder / MODULE.name).write_bytes(MODULE.read_bytes())
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n", encoding="utf-8"
    )
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(groups), encoding="utf-8")
    return folder


def navstack(*arguments: str, path: Path | None) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(path) if path else ""}
    command = [sys.executable, "-W", "error", "-m", "navstack", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=env, cwd=EXAMPLE)


def planned(path: Path, *more: str) -> Any:
    out = navstack("plan", "office", "--start", "0.8,7.45", "--goal", "22.2,7.45", "--json", *more, path=path)
    assert out.returncode == 0, out.stderr
    return json.loads(out.stdout)


def nearest_to_disc(plan: Any) -> float:
    return min(math.hypot(x - DISC[0], y - DISC[1]) for x, y, _ in plan["poses"])


def test_a_plan_keeps_out_of_the_disc(site: Path) -> None:
    """The way along the corridor leads over the disc; with the layer the whole robot stays out (inscribed radius 0.2 m)."""
    without = planned(site)
    with_layer = planned(site, "--params", "turtlebot", "--params", "forbidden_disc.yaml")
    assert nearest_to_disc(without) < DISC[2]
    assert nearest_to_disc(with_layer) > DISC[2] + 0.15
    smaller = planned(
        site, "--params", "turtlebot", "--params", "forbidden_disc.yaml", "--set", "global_costmap/forbidden/radius=0.2"
    )
    assert 0.35 < nearest_to_disc(smaller) < nearest_to_disc(with_layer)


def test_its_parameters_are_checked_like_any_other(site: Path) -> None:
    out = navstack(
        "check", "turtlebot", "forbidden_disc.yaml", "--set", "global_costmap/forbidden/radius=-1", "--json", path=site
    )
    assert "global_costmap/forbidden/radius" in out.stdout
    assert "error" in out.stdout


def test_info_says_where_it_comes_from(site: Path) -> None:
    out = navstack("info", "--json", path=site)
    layers = json.loads(out.stdout)["plugins"]["costmap layer"]
    (found,) = [layer for layer in layers if layer["name"] == "forbidden_disc"]
    assert found["origin"] == "forbidden-disc-layer"
    assert all(layer["origin"] == "navstack" for layer in layers if layer is not found)


def test_without_it_the_name_is_unknown() -> None:
    out = navstack(
        "plan", "office", "--start", "0.8,7.45", "--goal", "22.2,7.45", "--params", "turtlebot", "--params",
        "forbidden_disc.yaml", path=None,
    )  # fmt: skip
    assert out.returncode == 2
    assert 'no costmap layer "forbidden_disc"' in out.stderr.replace("\n", " ")


def test_the_readme_shows_the_files_as_they_are() -> None:
    for file, language in ((MODULE, "py"), (EXAMPLE / "forbidden_disc.yaml", "yaml")):
        assert f"```{language}\n{file.read_text(encoding='utf-8')}```" in README, file.name
    entry = '[project.entry-points."navstack.layers"]\nforbidden_disc = "forbidden_disc_layer:ForbiddenDiscLayer"\n'
    assert entry in (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8")
    assert entry in README
