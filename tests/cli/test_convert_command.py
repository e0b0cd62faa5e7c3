"""`navstack params convert` and `navstack explain migration`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from navstack.cli.app import run
from navstack.cli.convert import verification_notes
from navstack.core import Difference, Interval
from navstack.explain import explain_migration
from navstack.parameters import load_configuration
from tests.cli.test_wrong_input import Outcome, navstack  # noqa: F401  (a fixture)

FILES = ["conversion.md", "nav2_params.yaml", "navigate_to_pose.xml", "navstack.yaml"]


def test_files_and_report(navstack, tmp_path: Path) -> None:  # noqa: F811
    done: Outcome = navstack("params", "convert", "turtlebot", "--to", "nav2", "--out", "nav2")
    assert done.code == 0
    assert sorted(p.name for p in (tmp_path / "nav2").iterdir()) == FILES
    assert done.out.startswith("Nav2 jazzy: ")
    assert "turtlebot/dwa_local_planner_params.yaml:36: DWAPlannerROS/scaling_speed: the footprint" in done.out
    assert f'"{tmp_path}/nav2/navigate_to_pose.xml"' in (tmp_path / "nav2" / "nav2_params.yaml").read_text("utf-8")
    back: Outcome = navstack(
        "params", "convert", "nav2/nav2_params.yaml", "--to", "move_base", "--out", "back", "--json"
    )
    assert back.code == 0
    assert json.loads(back.out)["target"] == "move_base"
    assert load_configuration(["back/move_base_params.yaml"]).local_planner.name == "dwa"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("turtlebot", "--to", "nav3"), 'error: --to "nav3" is no target; did you mean nav2?'),
        (
            ("turtlebot", "--to", "nav2", "--distro", "humbel"),
            'error: unknown distribution "humbel" of Nav2; did you mean humble?',
        ),
        (("nowhere.yaml", "--to", "nav2"), 'nowhere.yaml: "nowhere.yaml" is not a file'),
        (("nowhere.yaml", "--to", "move_base"), 'nowhere.yaml: "nowhere.yaml" is not a file'),
        (("turtlebot", "--to", "move_base"), "error: turtlebot is of move_base already"),
        (("turtlebot", "--to", "nav2", "--set", "controller_frequency=-1"), "controller_frequency"),
    ],
)
def test_wrong_input(navstack, tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:  # noqa: F811
    done: Outcome = navstack("params", "convert", *arguments, "--out", "out")
    assert done.code == 2
    assert message in done.err
    assert done.err.count("error: ") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_in_use(navstack, tmp_path: Path) -> None:  # noqa: F811
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine", encoding="utf-8")
    done: Outcome = navstack("params", "convert", "turtlebot", "--to", "nav2", "--out", "out")
    assert (done.code, [p.name for p in (tmp_path / "out").iterdir()]) == (2, ["mine.txt"])
    assert "--out out is not empty" in done.err
    assert navstack("params", "convert", "turtlebot", "--to", "nav2", "--out", "out", "--force").code == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted([*FILES, "mine.txt"])


@pytest.mark.slow
def test_verification_drives_both(navstack) -> None:  # noqa: F811
    verify = ("--verify", "--count", "2", "--processes", "1")
    done: Outcome = navstack("params", "convert", "turtlebot", "--to", "nav2", "--out", "nav2", *verify)
    assert done.code == 0
    rows = [line.split() for line in done.out.splitlines() if line.strip().startswith("office")]
    assert [row[2:5] for row in rows] == [["1", "1", "1"]] * 2  # pairs, both succeed
    assert "beyond the noise" in done.err


def measure(name: str, a: float, b: float, low: float, high: float) -> dict[str, Any]:
    difference = Difference(Interval(b - a, low, high, 6), pairs=6, higher=6, lower=0, p_value=0.03)
    return {"measure": name, "a": Interval(a, a, a, 6), "b": Interval(b, b, b, 6), "difference": difference}


def drives(original: str, converted: str) -> list[dict[str, Any]]:
    """A run of each scenario; `x` is a failure."""
    pairs = enumerate(zip(original, converted, strict=True))
    return [{"scenario": f"s{k}", "A": {"success": a != "x"}, "B": {"success": b != "x"}} for k, (a, b) in pairs]


JERK, TIME = measure("jerk", 1.7, 5.4, 3.1, 4.2), measure("time", 30.0, 31.0, -0.5, 2.5)


@pytest.mark.parametrize(
    ("original", "converted", "rows", "notes"),
    [
        ("......", "......", [TIME], ["no measure of the drive differs beyond the noise"]),
        ("...", "...", [], ["with fewer than 6 scenarios only large differences show, so give --count"]),
        ("......", "x.x...", [TIME], ["fails in 2 of 6 drives in which the original succeeds"]),
        ("x.....", "......", [TIME], ["succeeds in 1 of 6 drives in which the original fails"]),
        (
            "x.....",
            ".x....",
            [TIME, JERK],
            [
                "fails in 1 of 6 drives in which the original succeeds, and succeeds in 1 in which it fails",
                "changes the drive beyond the noise: jerk 1.70 -> 5.40 (by 3.700 [3.100, 4.200])",
            ],
        ),
        ("xxxxxx", "xxxxxx", [JERK], ["jerk 1.70 -> 5.40"]),
    ],
)
def test_what_a_verification_shows(original: str, converted: str, rows: list[dict[str, Any]], notes: list[str]) -> None:
    found = verification_notes(drives(original, converted), rows)
    assert len(found) == len(notes)
    assert all(part in note for part, note in zip(notes, found, strict=True))
    assert not any("time" in note for note in found)


def test_migration_names_the_places() -> None:
    report = explain_migration(["turtlebot"], "humble")
    points = {p.title: p for p in report.points}
    assert len(points) + len(report.others) == 10
    ((text, at),) = points["limits and braking"].places
    assert text == "DWAPlannerROS/acc_lim_x = 1.0"
    assert at is not None
    assert str(at).startswith("turtlebot/dwa_local_planner_params.yaml:16:")
    assert {"replanning rate", "integers for doubles", "footprint", "progress check"} == set(report.others)


def test_migration_finds_what_the_file_has(tmp_path: Path) -> None:
    text = "base_local_planner: dwa\nplanner_frequency: 2\n"
    text += "global_costmap: {plugins: [], robot_radius: 0.2}\n"
    text += "local_costmap: {rolling_window: true, plugins: [], footprint: [[1, 1], [-1, 1], [-1, -1], [1, -1]]}\n"
    file = tmp_path / "move_base_params.yaml"
    file.write_text(text, encoding="utf-8")
    points = {p.title: p for p in explain_migration([str(file)]).points}
    assert str(points["replanning rate"].places[0][1]) == f"{file}:2:20"
    assert points["footprint"].places[0][1] is not None
    assert "2" in points["replanning rate"].fix
    assert "max_vel_theta" in points["limits and braking"].cause
    assert "base frame" not in points
    assert "progress check" in points


def test_migration_prints_one_line_about_the_others(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "migration", "turtlebot"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines[-1] == (
        "4 of 10 do not apply to this robot: replanning rate, integers for doubles, footprint, progress check"
    )
    assert run(["explain", "migration", "turtlebot", "--json"]) == 0
    assert len(json.loads(capfd.readouterr().out)["points"]) == 6
