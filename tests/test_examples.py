"""The example plugins, built as wheels, installed into a fresh environment, and driven from the command line."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
PLUGINS = {
    "forbidden_disc_layer": ("costmap layer", "forbidden_disc"),
    "via_point_planner": ("global planner", "via_point"),
    "pursuit_controller": ("local planner", "pursuit"),
    "steady_turn_critic": ("critic", "steady_turn"),
    "nudge_recovery": ("recovery behavior", "nudge"),
}
DISC = (11.4, 7.0, 0.6)
"""x, y, radius (m) in examples/forbidden_disc_layer/forbidden_disc.yaml."""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a fresh environment with the examples; dependencies and navstack come from the current one."""
    folder = tmp_path_factory.mktemp("environment")
    wheels = tmp_path_factory.mktemp("wheels")
    venv.create(folder, with_pip=False)
    interpreter = folder / "bin" / "python"
    site = next((folder / "lib").glob("python*")) / "site-packages"
    link = f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n"
    (site / "present_environment.pth").write_text(link, encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check"]
    sources = [str(EXAMPLES / name) for name in PLUGINS]
    run([*pip, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(wheels), *sources])
    built = sorted(map(str, wheels.glob("*.whl")))
    assert len(built) == len(PLUGINS)
    run([*pip, "--python", str(interpreter), "install", "--no-deps", "--no-index", *built])
    return interpreter


def run(command: list[str], cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    out = subprocess.run(command, capture_output=True, text=True, cwd=cwd, env={**os.environ, "NO_COLOR": "1"})
    assert out.returncode == 0, f"{command}: {out.stdout}{out.stderr}"
    return out


def navstack(python: Path, *arguments: str | Path, cwd: Path | None = None) -> Any:
    """The JSON document of a command that succeeds."""
    return json.loads(run([str(python), "-W", "error", "-m", "navstack", *map(str, arguments), "--json"], cwd).stdout)


def parameters(name: str) -> list[str]:
    (file,) = (EXAMPLES / name).glob("*.yaml")
    return ["--params", "turtlebot", "--params", str(file)]


def distance_to_disc(plan: Any) -> float:
    return min(math.hypot(x - DISC[0], y - DISC[1]) for x, y, _ in plan["poses"])


def test_info_lists_them_with_their_origin(python: Path) -> None:
    plugins = navstack(python, "info")["plugins"]
    for folder, (kind, name) in PLUGINS.items():
        (found,) = [plugin for plugin in plugins[kind] if plugin["name"] == name]
        assert found["origin"] == folder.replace("_", "-")


def test_the_layer_keeps_the_plan_out_of_the_disc(python: Path) -> None:
    corridor = ("plan", "office", "--start", "0.8,7.45", "--goal", "22.2,7.45")
    assert distance_to_disc(navstack(python, *corridor)) < DISC[2]
    assert distance_to_disc(navstack(python, *corridor, *parameters("forbidden_disc_layer"))) > DISC[2] + 0.15


def test_the_global_planner_visits_its_via_point(python: Path) -> None:
    plan = navstack(
        python, "plan", "office", "--start", "0.8,7.45", "--goal", "6.2,12.0", *parameters("via_point_planner")
    )
    assert min(math.hypot(x - 11.4, y - 7.0) for x, y, _ in plan["poses"]) < 0.05


@pytest.mark.parametrize("name", ["pursuit_controller", "steady_turn_critic"])
def test_the_local_planner_and_the_critic_drive(python: Path, name: str, tmp_path: Path) -> None:
    goal = ("simulate", "office", "--start", "0.8,7.45", "--goal", "5.0,7.4")
    result = navstack(python, *goal, *parameters(name), "--out", tmp_path / "run")
    assert result["success"] and result["goals"][0]["state"] == "SUCCEEDED"


def test_the_recovery_behavior_runs(python: Path, tmp_path: Path) -> None:
    """A goal inside a wall: the behavior runs, then the goal is aborted."""
    arguments = ("simulate", "office", "--goal", "0.0,7.45", "--set", "planner_patience=1", "--out", tmp_path / "run")
    command = [str(python), "-m", "navstack", *map(str, arguments), *parameters("nudge_recovery"), "--json"]
    out = subprocess.run(command, capture_output=True, text=True)
    (goal,) = json.loads(out.stdout)["goals"]
    assert out.returncode == 1 and goal["state"] == "ABORTED" and goal["recoveries"] >= 1
    assert "nudge: turned to both sides" in (tmp_path / "run" / "run.log").read_text(encoding="utf-8")


def test_parameters_of_a_plugin_are_checked(python: Path) -> None:
    settings = [*parameters("forbidden_disc_layer"), "--set", "global_costmap/forbidden/radius=-1"]
    command = [str(python), "-m", "navstack", "check", *(s for s in settings if s != "--params"), "--json"]
    out = subprocess.run(command, capture_output=True, text=True)
    assert "global_costmap/forbidden/radius" in out.stdout and "error" in out.stdout


@pytest.mark.parametrize("name", PLUGINS)
def test_contract(python: Path, name: str, tmp_path: Path) -> None:
    """The suite of its kind runs from one line in a test file, as the documentation says."""
    kind, _ = PLUGINS[name]
    suite = {"costmap layer": "layer", "recovery behavior": "recovery"}.get(kind, kind.replace(" ", "_"))
    toml = (EXAMPLES / name / "pyproject.toml").read_text(encoding="utf-8")
    cls = toml.split(f'"{name}:' if f'"{name}:' in toml else ":")[1].split('"')[0]
    (tmp_path / "test_plugin.py").write_text(
        f"from navstack.testing import {suite}_contract\n"
        f"from {name} import {cls}\n\nTestContract = {suite}_contract({cls})\n",
        encoding="utf-8",
    )
    run([str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_plugin.py"], tmp_path)


@pytest.mark.parametrize("name", PLUGINS)
def test_examples_are_short(name: str) -> None:
    assert len((EXAMPLES / name / f"{name}.py").read_text(encoding="utf-8").splitlines()) <= 60


def test_without_its_package_the_name_is_unknown(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "navstack", "plan", "office", "--start", "0.8,7.45", "--goal", "22.2,7.45"]
    out = subprocess.run([*command, *parameters("forbidden_disc_layer")], capture_output=True, text=True, cwd=tmp_path)
    assert out.returncode == 2
    assert 'unknown costmap layer "forbidden_disc"' in " ".join(out.stderr.split())


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("[0-9]*.py")), ids=lambda path: path.stem)
def test_numbered_scripts_run_as_they_stand(script: Path, tmp_path: Path) -> None:
    assert len(script.read_text(encoding="utf-8").splitlines()) <= 30
    assert run([sys.executable, "-W", "error", str(script)], tmp_path).stdout
