"""`navstack tune` on a file of Nav2: the weights of its controller are searched and written back among the user's comments."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

from navstack.cli.app import run
from navstack.parameters import load_configuration, packaged_folder
from tests.studies.room import make_room

FILE = "nav2_params.yaml"
_MPPI = """    FollowPath:
      plugin: "nav2_mppi_controller::MPPIController"
      batch_size: 200
      time_steps: 30
      model_dt: 0.05
      vx_max: 0.5                 # m/s
      wz_max: 1.0
      motion_model: "DiffDrive"
      critics: ["ConstraintCritic", "CostCritic", "GoalCritic", "GoalAngleCritic", "PathFollowCritic"]
      GoalCritic:
        cost_weight: 0.0          # mine
      PathFollowCritic: {cost_weight: 0.0}  # and mine

"""


def robot(controller: str) -> str:
    """A robot of Nav2 that stands still, because nothing draws it to its goal."""
    text = (packaged_folder("nav2_turtlebot") / FILE).read_text("utf-8")
    if controller == "DWB":
        return re.sub(r"((?:PathDist|GoalDist|GoalAlign)\.scale: )[\d.]+", r"\g<1>0.0", text)
    return re.sub(r"    FollowPath:\n(.|\n)*?\n(?=planner_server)", _MPPI, text)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "searched", "written"),
    [
        ("DWB", ("DWBLocalPlanner/GoalDist/scale=10:40", "DWBLocalPlanner/PathDist/scale=10:40"), "GoalDist.scale"),
        (
            "MPPI",
            ("MPPIController/PathFollowCritic/cost_weight=3:9", "MPPIController/GoalCritic/cost_weight=3:9"),
            "mine",
        ),
    ],
)
def test_weights_are_searched_and_written_into_the_file(
    controller: str, searched: tuple[str, str], written: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "robot" / FILE
    source.parent.mkdir()
    source.write_text(robot(controller), encoding="utf-8")
    before = source.read_text("utf-8")
    options = ["--suite", str(make_room(tmp_path)), "--trials", "3", "--workers", "1", "--held-out", "0"]
    options += [part for name in searched for part in ("--param", name)]
    code = run(["tune", "--params", str(source), *options, "--out", str(tmp_path / "out"), "--json"])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    document = json.loads(captured.out)
    assert source.read_text("utf-8") == before  # the user's own file stays
    (tuned,) = (tmp_path / "out").rglob(FILE)
    text = tuned.read_text("utf-8")
    assert text != before, document
    changed = [(a, b) for a, b in zip(before.splitlines(), text.splitlines(), strict=True) if a != b]
    assert 1 <= len(changed) <= 2
    for old, new in changed:
        assert old.partition("#")[2] == new.partition("#")[2]
    assert any(written in new for _, new in changed)
    assert yaml.safe_load(text).keys() == yaml.safe_load(before).keys()
    assert load_configuration([str(tuned)]).local_planner.name == load_configuration([str(source)]).local_planner.name
