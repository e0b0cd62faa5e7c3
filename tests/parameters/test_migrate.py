"""Migration to current names."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core import ParameterError
from navstack.parameters.configuration import load_configuration
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.report import SINGLE_FILE, Migration, migrate, same_parameters
from tests.parameters.robots import name_of, robots

ROBOTS = [["turtlebot"], *robots()]
IDS = ["packaged", *(name_of(r) for r in ROBOTS[1:])]


def written(migration: Migration, folder: Path) -> Configuration:
    for name, text in migration.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return load_configuration([str(folder)])


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("sources", ROBOTS, ids=IDS)
def test_the_same_configuration(sources: list[str], tmp_path: Path) -> None:
    try:
        before = load_configuration(sources)
    except ParameterError:
        with pytest.raises(ParameterError):
            migrate(sources)
        return
    after = written(migrate(sources), tmp_path)
    assert same_parameters(before, after)
    assert [f for f in after.findings if f.rule in ("renamed", "pre-hydro")] == []


def test_only_names_change_and_comments_are_kept(tmp_path: Path) -> None:
    folder = tmp_path / "old"
    folder.mkdir()
    move_base = "# my robot\nbase_local_planner: dwa  # the best\n"
    (folder / "move_base_params.yaml").write_text(move_base, encoding="utf-8")
    old = 'DWAPlannerROS:\n  max_trans_vel: 0.5  # as max_trans_vel was called\n  "max_rot_vel": 1.5\n'
    (folder / "dwa_local_planner_params.yaml").write_text(old, encoding="utf-8")
    costmap = (
        "robot_radius: 0.2\nrolling_window: true\nplugins:\n"
        "  - {name: i, type: 'costmap_2d::InflationLayer'}\ni: {inflation_radius: 0.5}\n"
    )
    (folder / "costmap_common_params.yaml").write_text(costmap, encoding="utf-8")
    migration = migrate([str(folder)])
    assert migration.renamed == (("max_trans_vel", "max_vel_trans"), ("max_rot_vel", "max_vel_theta"))
    assert migration.why_whole == ""
    new = 'DWAPlannerROS:\n  max_vel_trans: 0.5  # as max_trans_vel was called\n  "max_vel_theta": 1.5\n'
    assert migration.files["dwa_local_planner_params.yaml"] == new
    assert migration.files["move_base_params.yaml"] == move_base
    assert same_parameters(load_configuration([str(folder)]), written(migration, tmp_path / "new"))


def test_a_single_file_is_written_as_values(tmp_path: Path) -> None:
    migration = migrate(["turtlebot"], overrides=["DWAPlannerROS/max_vel_x=0.3"])
    assert list(migration.files) == [SINGLE_FILE]
    assert "command line" in migration.why_whole
    assert written(migration, tmp_path).local_planner.params.max_vel_x == 0.3
