"""`navstack params ..` and the options of `navstack check`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.parameters import load_configuration, same_parameters


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a former parameter name, a warning and a comment."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "move_base_params.yaml").write_text("base_local_planner: dwa\n", encoding="utf-8")
    (folder / "dwa_local_planner_params.yaml").write_text(
        "DWAPlannerROS:\n  max_trans_vel: 0.3  # slow\n  max_vel_y: 0.0\n  min_vel_y: 0.0\n", encoding="utf-8"
    )
    (folder / "costmap_common_params.yaml").write_text(
        "robot_radius: 0.2\nrolling_window: true\nplugins:\n"
        '  - {name: inflation, type: "costmap_2d::InflationLayer"}\ninflation: {inflation_radius: 0.5}\n',
        encoding="utf-8",
    )
    return folder


def test_show(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "show", "robot", "--set", "DWAPlannerROS/sim_time=2.5"]) == 0
    text = capfd.readouterr().out
    assert "max_vel_trans: 0.3" in text
    assert "# robot/dwa_local_planner_params.yaml:2" in text
    assert "# --set argument 1" in text
    shown = robot.parent / "shown.yaml"
    shown.write_text(text, encoding="utf-8")
    before = load_configuration(["robot"], overrides=["DWAPlannerROS/sim_time=2.5"])
    assert same_parameters(before, load_configuration(["shown.yaml"]))


def test_show_as_json(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "show", "robot", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)["parameters"]
    assert shown["DWAPlannerROS/max_vel_trans"] == {
        "value": 0.3,
        "unit": "m/s",
        "origin": {"file": "robot/dwa_local_planner_params.yaml", "line": 2, "column": 18},
    }
    assert shown["DWAPlannerROS/sim_time"]["origin"] is None


def test_diff(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "diff", "robot", "robot", "--json"]) == 0
    assert json.loads(capfd.readouterr().out) == {"differences": {}}
    assert run(["params", "diff", "robot", "turtlebot"]) == 0
    text = capfd.readouterr().out
    assert "DWAPlannerROS/max_vel_trans" in text
    assert "- 0.3 m/s" in text
    assert "+ 0.5 m/s" in text
    assert "differences" in text.splitlines()[-1]


def test_diff_lists_what_is_set_and_defaults_by_an_option(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (robot.parent / "other.yaml").write_text(
        "base_local_planner: base_local_planner/TrajectoryPlannerROS\nlocal_costmap: {width: 4.0}\n", encoding="utf-8"
    )
    names: list[set[str]] = []
    for flags in ([], ["--defaults"]):
        assert run(["params", "diff", "robot", "other.yaml", "--json", *flags]) == 0
        names.append(set(json.loads(capfd.readouterr().out)["differences"]))
    assert "local_costmap/width" in names[0] and "base_local_planner" in names[0]
    assert "TrajectoryPlannerROS/sim_granularity" in names[1] - names[0]
    assert run(["params", "diff", "robot", "other.yaml"]) == 0
    text = capfd.readouterr().out
    assert f"{len(names[0])} differences; {len(names[1] - names[0])} more" in text and "(--defaults lists them)" in text


def test_show_and_reference_of_a_name(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "show", "robot", "inflation_radius", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)["parameters"]
    assert set(shown) == {"global_costmap/inflation/inflation_radius", "local_costmap/inflation/inflation_radius"}
    assert run(["params", "show", "robot", "DWAPlannerROS/max_vel"]) == 0
    text = capfd.readouterr().out
    assert "max_vel_trans: 0.3" in text and "inflation_radius" not in text
    assert run(["params", "show", "robot", "inflation_radus"]) == 2
    assert "did you mean inflation_radius?" in capfd.readouterr().err
    assert run(["params", "reference", "inflation_radius"]) == 0
    text = capfd.readouterr().out
    assert "| `inflation_radius` |" in text and "cost_scaling_factor`" not in text and "## Layer inflation" in text
    assert run(["params", "reference", "DWAPlannerROS"]) == 0
    text = capfd.readouterr().out
    assert text.startswith("## Local planner dwa") and "| `sim_time` |" in text and text.count("\n## ") == 0
    assert run(["params", "reference", "nothing_like_it"]) == 2
    assert "in the name of no parameter" in capfd.readouterr().err


def test_migrate(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "migrate", "robot", "--out", "new"]) == 0
    assert "max_trans_vel -> max_vel_trans" in capfd.readouterr().out
    new = (robot.parent / "new" / "dwa_local_planner_params.yaml").read_text(encoding="utf-8")
    assert new == "DWAPlannerROS:\n  max_vel_trans: 0.3  # slow\n  max_vel_y: 0.0\n  min_vel_y: 0.0\n"
    assert same_parameters(load_configuration(["robot"]), load_configuration(["new"]))
    # existing files are not overwritten
    assert run(["params", "migrate", "robot", "--out", "robot"]) == 2
    assert "not empty" in capfd.readouterr().err


def test_migrate_to_one_file_gives_the_reason(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "migrate", "robot", "--out", "new", "--set", "DWAPlannerROS/sim_time=2.0"]) == 0
    assert "without your comments: values were changed on the command line" in capfd.readouterr().err
    assert load_configuration(["new"]).local_planner.params.sim_time == 2.0


@pytest.mark.slow
def test_schema_and_reference(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["params", "schema", "--out", "all.json"]) == 0
    assert "DWAPlannerROS" in json.loads((robot.parent / "all.json").read_text(encoding="utf-8"))["properties"]
    assert run(["params", "schema", "--namespace", "local_costmap/inflation_layer"]) == 0
    assert "inflation_radius" in json.loads(capfd.readouterr().out)["properties"]
    assert run(["params", "schema", "--namespace", "nope"]) == 2
    assert 'no schema of the namespace "nope"' in capfd.readouterr().err
    assert run(["params", "reference"]) == 0
    assert capfd.readouterr().out.startswith("# Parameters\n")


@pytest.mark.parametrize("command", ["show", "migrate"])
def test_wrong_parameters(command: str, robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    more = ["--out", "new"] if command == "migrate" else []
    assert run(["params", command, "robot", "--set", "DWAPlannerROS/sim_time=0", *more]) == 2
    assert "sim_time = 0 is out of range" in capfd.readouterr().err
    assert not (robot.parent / "new").exists()


def test_check_strictly(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "robot"]) == 0
    assert "0 errors, 2 warnings, " in capfd.readouterr().out  # no sensor, and the scale of ROS at 0.3 m/s
    assert run(["check", "robot", "--strict"]) == 2
    assert "2 errors, 0 warnings, " in capfd.readouterr().out
    assert run(["check", "robot", "--strict", "--json"]) == 2
    assert {f["severity"] for f in json.loads(capfd.readouterr().out)["findings"]} == {"error", "info"}
    # notes are not warnings
    assert run(["check", "turtlebot", "--strict"]) == 0


def test_allow_missing(robot: Path, capfd: pytest.CaptureFixture[str]) -> None:
    common = robot / "costmap_common_params.yaml"
    text = common.read_text(encoding="utf-8")
    common.write_text(
        text.replace("plugins:\n", "plugins:\n  - {name: depth, type: their/DepthLayer}\n"), encoding="utf-8"
    )
    plan = ["plan", "office", "--start", "0.8,7.45", "--goal", "2.0,7.45", "--params", "robot"]
    for command in (["check", "robot"], ["params", "show", "robot"], plan):
        assert run(command) == 2
        output = capfd.readouterr()
        assert "or leave depth out with --allow-missing" in output.out + output.err
    assert run(["check", "robot", "--allow-missing"]) == 0
    assert run(["params", "show", "robot", "--allow-missing"]) == 0
    assert "depth:" not in capfd.readouterr().out.partition("robot_radius")[2]
