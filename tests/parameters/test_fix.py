"""`check --fix`: renamed and misspelt keys in the user's files, and nothing else."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.parameters import check_parameters, load_configuration
from navstack.parameters.binding import iter_names
from navstack.parameters.fix import KeyFixes, fix_keys
from navstack.parameters.report import same_parameters
from navstack.parameters.spelling import is_certain, nearest
from navstack.parameters.yaml_reader import edited_files
from navstack.plugins import LOCAL_PLANNERS
from tests.conftest import data_files

ROBOTS = [path for path in data_files("params/*") if path.is_dir()]

PLANNER = """\
# my robot
base_local_planner: dwa_local_planner/DWAPlannerROS   # noetic
DWAPlannerROS:
    max_trans_vel:  0.4      # was max_trans_vel
    'sim_tiem': 1.2
    planner_windows: 3
    max_vel_z: 0.1
controller_frequenzy: 8.0 # keep: controller_frequenzy
"""
FIXED = """\
# my robot
base_local_planner: dwa_local_planner/DWAPlannerROS   # noetic
DWAPlannerROS:
    max_vel_trans:  0.4      # was max_trans_vel
    'sim_time': 1.2
    planner_windows: 3
    max_vel_z: 0.1
controller_frequency: 8.0 # keep: controller_frequenzy
"""


def write(folder: Path, text: str, name: str = "planner.yaml") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def fixed(*sources: Path) -> KeyFixes:
    return fix_keys(["turtlebot", *map(str, sources)])


def test_keys_are_corrected_and_the_rest_stays(tmp_path: Path) -> None:
    path = write(tmp_path, PLANNER)
    made = fixed(path)
    assert path.read_text() == PLANNER
    made.save()
    assert path.read_text() == FIXED
    assert [(f.old, f.new, f.rule) for f in made.fixes] == [
        ("max_trans_vel", "max_vel_trans", "renamed"),
        ("sim_tiem", "sim_time", "unknown"),
        ("controller_frequenzy", "controller_frequency", "unknown"),
    ]
    assert [k.old for k in made.kept] == ["max_vel_z"]
    assert list(made.findings) == check_parameters(["turtlebot", str(path)])
    again = fixed(path)
    assert again.fixes == ()
    assert again.diff() == ""


@pytest.mark.parametrize("text", [f"\ufeff{PLANNER}", PLANNER.replace("\n", "\r\n"), PLANNER.rstrip("\n")])
def test_marks_and_line_ends_stay(text: str, tmp_path: Path) -> None:
    path = write(tmp_path, text)
    fixed(path).save()
    wanted = text
    for old, new in (
        ("    max_trans_vel", "    max_vel_trans"),
        ("sim_tiem", "sim_time"),
        ("\ncontroller_frequenzy", "\ncontroller_frequency"),
    ):
        wanted = wanted.replace(old, new, 1)
    assert path.read_bytes() == wanted.encode()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("DWAPlannerROS: {max_vel_z: 0.1}\n", "not nearer than others"),
        ("DWAPlannerROS: {max_trans_vel: 0.1, max_vel_trans: 0.2}\n", "both names are set"),
        ("DWAPlannerROS: {sim_tiem: 1.0, sim_time: 1.5}\n", "sim_time is set as well"),
        ("DWAPlannerROS: {&key sim_tiem: 1.0}\n", "anchor"),
        ("DWAPlannerROS: {sim_tiem: [1, 2]}\n", "sim_time would be an error"),
    ],
)
def test_unclear_keys_stay(text: str, reason: str, tmp_path: Path) -> None:
    path = write(tmp_path, text)
    made = fixed(path)
    assert made.fixes == ()
    assert len(made.kept) == 1
    assert reason in made.kept[0].reason
    made.save()
    assert path.read_text() == text


def test_one_wrong_value_does_not_stop_the_others(tmp_path: Path) -> None:
    path = write(tmp_path, "controller_frequenzy: 8.0\nDWAPlannerROS: {sim_tiem: [1, 2], max_trans_vel: 0.3}\n")
    fixed(path).save()
    assert path.read_text() == "controller_frequency: 8.0\nDWAPlannerROS: {sim_tiem: [1, 2], max_vel_trans: 0.3}\n"


def test_a_misspelt_namespace_and_its_keys(tmp_path: Path) -> None:
    path = write(tmp_path, "DWAPlanerROS:\n  sim_tiem: 1.4\nlocal_costmap/inflation_layer/inflation_radus: 0.4\n")
    made = fixed(path)
    made.save()
    text = path.read_text()
    assert text == "DWAPlannerROS:\n  sim_time: 1.4\nlocal_costmap/inflation_layer/inflation_radius: 0.4\n"
    configuration = load_configuration(["turtlebot", str(path)])
    assert configuration.local_planner.params.sim_time == 1.4


def test_packaged_and_launch_files_stay(tmp_path: Path) -> None:
    launch = tmp_path / "robot.launch"
    launch.write_text(
        '<launch><node pkg="move_base" type="move_base" name="move_base">\n<rosparam>\ncontroller_frequenzy: 5.0\n</rosparam>\n'
        '<rosparam file="planner.yaml" command="load" /></node></launch>'
    )
    path = write(tmp_path, "DWAPlannerROS: {sim_tiem: 1.0}\n")
    before = launch.read_text()
    made = fix_keys(["turtlebot", str(launch)])
    made.save()
    assert launch.read_text() == before
    assert path.read_text() == "DWAPlannerROS: {sim_time: 1.0}\n"
    assert ["launch file" in k.reason for k in made.kept] == [True]


def test_links_and_permissions_stay(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real = write(tmp_path / "real", PLANNER)
    real.chmod(0o640)
    link = tmp_path / "planner.yaml"
    link.symlink_to(real)
    fixed(link).save()
    assert link.is_symlink()
    assert real.read_text() == FIXED
    assert real.stat().st_mode & 0o777 == 0o640
    assert list((tmp_path / "real").iterdir()) == [real]


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS, ids=lambda path: path.name)
def test_keys_of_published_robots(robot: Path, tmp_path: Path) -> None:
    """Renamed keys keep their meaning, and a second correction changes nothing."""
    copy = tmp_path / robot.name
    shutil.copytree(robot, copy)
    for path in (copy, *copy.rglob("*")):
        path.chmod(0o755)
    made = fix_keys([str(copy)])
    made.save()
    assert fix_keys([str(copy)]).fixes == ()
    assert _errors([str(copy)]) <= _errors([str(robot)])
    if not _errors([str(copy)]) and all(fix.rule == "renamed" for fix in made.fixes):
        assert same_parameters(load_configuration([str(robot)]), load_configuration([str(copy)]))


def _errors(sources: list[str]) -> set[tuple[str, int]]:
    return {(Path(f.file).name, f.line) for f in check_parameters(sources) if f.severity == "error"}


def test_no_single_typo_is_corrected_to_another_parameter() -> None:
    names = sorted(set(iter_names(LOCAL_PLANNERS.get("dwa").cls.Params)))
    rng = random.Random(0)
    certain = 0
    for name in names * 4:
        i = rng.randrange(len(name))
        letter = rng.choice("abcdefghijklmnopqrstuvwxyz_")
        typo = rng.choice((name[:i] + name[i + 1 :], name[:i] + letter + name[i:], name[:i] + letter + name[i + 1 :]))
        found = nearest(typo, names)
        if typo not in names and found is not None and is_certain(typo, found, names):
            assert found == name, typo
            certain += 1
    assert certain > 2 * len(names)


def test_nothing_is_read_from_memory_afterwards(tmp_path: Path) -> None:
    path = write(tmp_path, "controller_frequency: 8.0\n")
    with edited_files({path: b"controller_frequency: 9.0\n"}):
        assert load_configuration(["turtlebot", str(path)]).move_base.controller_frequency == 9.0
    assert load_configuration(["turtlebot", str(path)]).move_base.controller_frequency == 8.0


def test_no_correction_is_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "turtlebot", str(write(tmp_path, "controller_frequency: 8.0\n")), "--diff"]) == 0
    shown = capfd.readouterr()
    assert shown.out == "" and "no key would be corrected" in shown.err


def test_the_command(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, PLANNER)
    assert run(["check", "turtlebot", str(path), "--diff"]) == 0
    shown = capfd.readouterr()
    lines = shown.out.splitlines()
    assert lines[:2] == [f"--- {path}", f"+++ {path}"]
    assert [line for line in lines[2:] if line.startswith(("-", "+"))] == [
        "-    max_trans_vel:  0.4      # was max_trans_vel",
        "-    'sim_tiem': 1.2",
        "+    max_vel_trans:  0.4      # was max_trans_vel",
        "+    'sim_time': 1.2",
        "-controller_frequenzy: 8.0 # keep: controller_frequenzy",
        "+controller_frequency: 8.0 # keep: controller_frequenzy",
    ]
    assert "max_vel_z is not changed" in shown.err.replace("\n", " ")
    assert path.read_text() == PLANNER
    assert run(["check", "turtlebot", str(path), "--diff", "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert [fix["new"] for fix in document["fixes"]] == ["max_vel_trans", "sim_time", "controller_frequency"]
    assert run(["check", "turtlebot", str(path), "--fix"]) == 0
    shown = capfd.readouterr().out
    assert f"{path}:4: max_trans_vel -> max_vel_trans (renamed)\n" in shown
    assert "3 keys corrected in 1 file\n" in shown
    assert path.read_text() == FIXED
    assert run(["check", "narrow_door", "--fix"]) == 2
    assert "is a scenario" in capfd.readouterr().err.replace("\n", " ")
