"""New values in copies of the user's files."""

from __future__ import annotations

import difflib
import shutil
from pathlib import Path

import pytest

from navstack.parameters import packaged_folder
from navstack.parameters.configuration import load_configuration
from navstack.parameters.report import same_parameters
from navstack.parameters.yaml_editor import value_text
from navstack.parameters.yaml_rewrite import OVERLAY_FILE, rewrite_parameters
from navstack.studies.search_space import Value
from navstack.studies.search_space_parser import default_space

RADII = ("global_costmap/inflation_layer/inflation_radius", "local_costmap/inflation_layer/inflation_radius")


def changed_lines(before: str, after: str) -> list[str]:
    lines = difflib.ndiff(before.splitlines(keepends=True), after.splitlines(keepends=True))
    return [line[0] + line[2:].strip() for line in lines if line[0] in "+-"]


def check(sources: list[str], values: dict[str, Value], out: Path, **options: object) -> None:
    """The new files give the same configuration as the overrides."""
    made = rewrite_parameters(sources, values, **options)  # type: ignore[arg-type]
    overrides = [*options.get("overrides", ()), *(f"{n}={value_text(v)}" for n, v in values.items())]  # type: ignore[misc]
    want = load_configuration(sources, overrides=overrides, distro=options.get("distro"))  # type: ignore[arg-type]
    assert same_parameters(load_configuration(made.save(out)), want)


def test_only_the_changed_values_are_edited(tmp_path: Path) -> None:
    values: dict[str, Value] = {"DWAPlannerROS/sim_time": 2.5, "DWAPlannerROS/max_vel_theta": 1.0}
    values |= dict.fromkeys(RADII, 0.6)
    made = rewrite_parameters(["turtlebot"], values)
    folder = packaged_folder("turtlebot")
    changed = {n: c for n, text in made.files.items() if (c := changed_lines((folder / n).read_text(), text))}
    assert changed == {
        "costmap_common_params.yaml": ["-inflation_radius: 0.5     # m", "+inflation_radius: 0.6     # m"],
        "dwa_local_planner_params.yaml": [
            "-max_rot_vel: 5.0          # rad/s, now max_vel_theta",  # the previous name in the user's file stays
            "+max_rot_vel: 1.0          # rad/s, now max_vel_theta",
            "-sim_time: 1.0             # s",
            "+sim_time: 2.5             # s",
        ],
    }
    assert not made.overlay_reason
    check(["turtlebot"], values, tmp_path / "out")


@pytest.mark.slow
def test_a_shared_value_changed_for_one_costmap_gets_a_new_line(tmp_path: Path) -> None:
    values: dict[str, Value] = {RADII[0]: 0.7, "global_costmap/inflation_layer/cost_scaling_factor": 3.0}
    made = rewrite_parameters(["turtlebot"], values)
    folder = packaged_folder("turtlebot")
    assert made.files["costmap_common_params.yaml"] == (folder / "costmap_common_params.yaml").read_text()
    assert made.files["global_costmap_params.yaml"].endswith(
        "  inflation_layer:\n    cost_scaling_factor: 3.0\n    inflation_radius: 0.7\n"
    )
    check(["turtlebot"], values, tmp_path / "out")


def test_changed_defaults_get_new_lines_and_overrides_are_written_too(tmp_path: Path) -> None:
    values: dict[str, Value] = {"DWAPlannerROS/twirling_scale": 0.5, "DWAPlannerROS/controller_frequency": 10.0}
    options = {"overrides": ["DWAPlannerROS/occdist_scale=0.1"], "distro": "noetic"}
    made = rewrite_parameters(["turtlebot"], values, **options)  # type: ignore[arg-type]
    assert "ros_distro: noetic" in made.files["navstack.yaml"]
    assert "controller_frequency: 5.0   # Hz" in made.files["move_base_params.yaml"]  # that of move_base stays
    assert made.files["dwa_local_planner_params.yaml"].endswith("  twirling_scale: 0.5\n  controller_frequency: 10.0\n")
    check(["turtlebot"], values, tmp_path / "out", **options)


MINE = """# my robot
DWAPlannerROS: {sim_time: 1.0, max_vel_x: 0.5}   # flow style
local_costmap:
   inflation_layer:   # mine
      inflation_radius: &r 0.4  # anchored
global_costmap:
   inflation_layer: {inflation_radius: *r}
base_local_planner: 'dwa_local_planner/DWAPlannerROS'"""


@pytest.mark.slow
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_flow_style_anchors_line_ends_and_no_last_newline(tmp_path: Path, newline: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_bytes(MINE.replace("\n", newline).encode())
    values: dict[str, Value] = {
        "DWAPlannerROS/sim_time": 2.0,
        "DWAPlannerROS/vx_samples": 9,
        **dict.fromkeys(RADII, 0.55),
    }
    made = rewrite_parameters(["turtlebot", str(file)], values)
    assert not made.overlay_reason
    assert made.params == ("1", "2/mine.yaml")
    text = made.files["2/mine.yaml"]
    assert text == MINE.replace("\n", newline).replace("sim_time: 1.0", "sim_time: 2.0").replace(
        "&r 0.4", "&r 0.55"
    ).replace("max_vel_x: 0.5}", "max_vel_x: 0.5}")
    assert "vx_samples: 9" in made.files["1/dwa_local_planner_params.yaml"]
    check(["turtlebot", str(file)], values, tmp_path / "out")


def test_byte_order_mark_and_a_file_without_a_last_newline(tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    shutil.copytree(packaged_folder("turtlebot"), folder)
    planner = folder / "dwa_local_planner_params.yaml"
    planner.write_bytes(b"\xef\xbb\xbf" + planner.read_bytes().rstrip(b"\n"))
    values: dict[str, Value] = {"DWAPlannerROS/sim_time": 2.0, "DWAPlannerROS/twirling_scale": 0.5}
    made = rewrite_parameters([str(folder)], values)
    assert made.files[planner.name].startswith("\ufeff")
    assert made.files[planner.name].endswith("global_frame_id: odom\n  twirling_scale: 0.5")
    check([str(folder)], values, tmp_path / "out")


@pytest.mark.slow
def test_a_costmap_level_value_is_edited_where_it_applies(tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    shutil.copytree(packaged_folder("turtlebot"), folder)
    costmap = folder / "local_costmap_params.yaml"
    costmap.write_text(costmap.read_text() + "  inflation_radius: 0.9  # over the layer's\n")
    values: dict[str, Value] = {"local_costmap/inflation_radius": 0.45}
    made = rewrite_parameters([str(folder)], values)
    assert "inflation_radius: 0.45  # over the layer's" in made.files[costmap.name]
    check([str(folder)], values, tmp_path / "out")


def test_launch_files_get_an_overlay(data_dir: Path, tmp_path: Path) -> None:
    launch = tmp_path / "robot.launch"
    shutil.copytree(packaged_folder("turtlebot"), tmp_path / "param")
    files = "".join(
        f'<rosparam file="$(dirname)/param/{f.name}" command="load" {"ns=" + chr(34) + ns + chr(34) if ns else ""}/>'
        for f in sorted((tmp_path / "param").iterdir())
        for ns in (("global_costmap", "local_costmap") if "common" in f.name else ("",))
    )
    launch.write_text(f'<launch><node pkg="move_base" type="move_base" name="move_base">{files}</node></launch>')
    values: dict[str, Value] = {"DWAPlannerROS/sim_time": 2.0}
    made = rewrite_parameters([str(launch)], values)
    assert "launch" in made.overlay_reason
    assert list(made.files) == [OVERLAY_FILE]
    sources = made.save(tmp_path / "out")
    assert sources == [str(launch), str(tmp_path / "out" / OVERLAY_FILE)]
    want = load_configuration([str(launch)], overrides=["DWAPlannerROS/sim_time=2.0"])
    assert same_parameters(load_configuration(sources), want)


ROBOTS = (["jackal_barn_fast_dwa"], ["turtlebot2/param"], ["pr2_stage"])


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot[0])
def test_published_robots(data_dir: Path, tmp_path: Path, robot: list[str]) -> None:
    sources = [str(data_dir / "params" / name) for name in robot]
    space = default_space(load_configuration(sources))
    candidate = {d.name: d.at(0.37) for d in space}
    made = rewrite_parameters(sources, space.settings(candidate))
    assert not made.overlay_reason
    want = load_configuration(sources, overrides=space.overrides(candidate))
    assert same_parameters(load_configuration(made.save(tmp_path / "out")), want)
