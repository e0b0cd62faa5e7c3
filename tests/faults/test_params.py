"""Common mistakes in parameters: one clear message each, no traceback, exit code 2."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from navstack.core import ParameterError
from navstack.parameters import check_parameters, load_configuration, packaged_folder

FILES = {
    "missing": (None, "not a file, folder or packaged set"),
    "empty plugin list entry": ("local_costmap:\n  plugins:\n    -\n", "entry 1"),
    "tab": ("local_costmap:\n\twidth: 3\n", "tab"),
    "list": ("- a\n", "name: value"),
    "word": ("turtlebot\n", "name: value"),
    "unclosed": ("footprint: [[1, 2]\n", "invalid YAML"),
    "number key": ("1: a\n", "parameter name must be text"),
    "python object": ("a: !!python/object/apply:os.system ['true']\n", "tag"),
    "two documents": ("a: 1\n---\nb: 1\n", "second document"),
    "typo in a type": ("local_costmap:\n  plugins: [{name: i, type: costmap_2d::InflatonLayer}]\n", "InflationLayer"),
    "negative radius": ("local_costmap: {robot_radius: -1}\n", "at least 0"),
    "footprint of two points": ("footprint: [[1, 1], [2, 2]]\n", "three points"),
    "list that is none": ("local_costmap: {plugins: inflation}\n", "not a list"),
    "text for a number": ("DWAPlannerROS: {max_vel_x: fast}\n", "write a number"),
    "not a number": ("DWAPlannerROS: {max_vel_x: .nan}\n", "write a number"),
    "infinite": ("DWAPlannerROS: {sim_time: .inf}\n", "finite"),
    "unknown planner": ("base_global_planner: nafvn/NavfnROS\n", "navfn/NavfnROS"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", FILES)
def test_one_clear_message(case: str, tmp_path: Path) -> None:
    text, words = FILES[case]
    path = tmp_path / "wrong.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_configuration(["turtlebot", str(path)])
    message = caught.value.message
    assert words in message
    assert str(path) in message
    assert "Traceback" not in message and "pydantic" not in message
    assert caught.value.code == 9003 or caught.value.code == 9004


def test_an_unknown_key_is_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("DWAPlannerROS: {max_vel_xx: 0.3}\n")
    loaded = load_configuration(["turtlebot", str(path)])
    (warning,) = [f for f in loaded.findings if f.severity == "warning"]
    assert (warning.line, warning.column, warning.suggestion) == (1, 17, "max_vel_x")


@pytest.mark.parametrize("name", ["a.yaml", "a.launch"])
def test_a_file_without_permission(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / name
    path.write_text("a: 1\n")

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("navstack.core.bounded_reading.os.open", refuse)
    (found,) = check_parameters([str(path)])
    assert found.rule == "cannot-read"
    assert "Permission denied" in found.message


def test_a_read_only_folder_is_enough(tmp_path: Path) -> None:
    folder = tmp_path / "p"
    folder.mkdir()
    for file in packaged_folder("turtlebot").iterdir():
        if file.suffix == ".yaml":
            (folder / file.name).write_text(file.read_text(encoding="utf-8"))
    folder.chmod(0o555)
    try:
        assert load_configuration([str(folder)]).navstack.ros_distro == "indigo"
    finally:
        folder.chmod(0o755)


def test_files_that_are_devices_or_folders_do_not_hang(tmp_path: Path) -> None:
    fifo = tmp_path / "move_base_params.yaml"
    os.mkfifo(fifo)
    assert [f.rule for f in check_parameters([str(fifo)])] == ["cannot-read"]
    assert [f.rule for f in check_parameters(["/dev/zero"])] == ["cannot-read"]
    os.mkfifo(tmp_path / "a.launch")
    assert [f.rule for f in check_parameters([str(tmp_path / "a.launch")])] == ["cannot-read"]
    folder = tmp_path / "costmap_common_params.yaml.d"
    folder.mkdir()
    assert {f.rule for f in check_parameters([str(folder)])} == {"no-source"}
