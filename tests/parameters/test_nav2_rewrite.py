"""New values in files of Nav2: they go to the user's own keys, with Nav2's types."""

from __future__ import annotations

import difflib
import pickle
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from navstack.parameters import load_configuration, packaged_folder, packaged_sets, parameters_of, rewrite_parameters
from navstack.parameters.nav2.own_keys import own_keys
from navstack.parameters.sources import read_sources

FILE = "nav2_params.yaml"
NAV2 = "nav2_turtlebot"


def rewritten(values: dict[str, Any], folder: Path, sources: tuple[str, ...] = (NAV2,)) -> list[str]:
    """Changed lines of the only Nav2 file; the saved copy has the values."""
    made = rewrite_parameters(sources, values)
    assert made.overlay_reason == ""
    again = {p.name: p.value for p in parameters_of(load_configuration(made.save(folder)))}
    assert {name: again[name] for name in values} == values
    before = made.originals[FILE].read_text("utf-8")
    lines = difflib.ndiff(before.splitlines(), made.files[FILE].splitlines())
    return [line[0] + line[2:].strip() for line in lines if line[0] in "+-"]


def test_values_are_replaced_at_the_dotted_keys_of_the_user_and_stay_doubles(tmp_path: Path) -> None:
    values = {"DWBLocalPlanner/PathDist/scale": 20, "DWBLocalPlanner/vx_samples": 12}
    assert rewritten(values, tmp_path) == [
        "-vx_samples: 20",
        "+vx_samples: 12",
        "-PathDist.scale: 32.0        # stay on the path",
        "+PathDist.scale: 20.0        # stay on the path",
    ]


def test_absent_parameters_are_added_in_their_block_under_the_names_of_nav2(tmp_path: Path) -> None:
    values = {
        "DWBLocalPlanner/PathDist/aggregation_type": "sum",
        "DWBLocalPlanner/time_granularity": 3e-05,
        "NavfnPlanner/use_astar": True,
        "NavfnPlanner/tolerance": 0.3,
        "controller_patience": 2,
    }
    assert rewritten(values, tmp_path) == [
        "-failure_tolerance: 0.3        # s without a valid command until the tree recovers",
        "+failure_tolerance: 2.0        # s without a valid command until the tree recovers",
        "+time_granularity: 3.0e-05",  # PyYAML takes 3e-05 as text
        "+PathDist.aggregation_type: sum",
        "-tolerance: 0.5              # m",
        "+tolerance: 0.3              # m",
        "+use_astar: true",
    ]
    parameters = yaml.safe_load((tmp_path / FILE).read_text("utf-8"))["controller_server"]["ros__parameters"]
    assert parameters["FollowPath"]["time_granularity"] == 3e-05


def test_a_block_of_nested_keys_gets_a_nested_key(tmp_path: Path) -> None:
    text = (packaged_folder(NAV2) / FILE).read_text("utf-8")
    nested = re.sub(r"^( +)(\w+)\.(\w+: [\d.]+).*$", r"\1\2: {\3}", text, flags=re.MULTILINE)
    nested = re.sub(r"^ +\w+: \{forward_point_distance.*\n", "", nested, flags=re.MULTILINE)
    (tmp_path / FILE).write_text(nested, encoding="utf-8")
    values = {"DWBLocalPlanner/PathDist/scale": 20.0, "DWBLocalPlanner/GoalDist/aggregation_type": "sum"}
    values |= {"DWBLocalPlanner/Oscillation/oscillation_reset_dist": 0.1}
    assert rewritten(values, tmp_path / "out", (str(tmp_path),)) == [
        "-PathDist: {scale: 32.0}",
        "+PathDist: {scale: 20.0}",
        "-GoalDist: {scale: 24.0}",
        "+GoalDist: {scale: 24.0, aggregation_type: sum}",
        "+Oscillation:",
        "+oscillation_reset_dist: 0.1",
    ]


def test_a_named_distribution_is_kept() -> None:
    made = rewrite_parameters([NAV2], {"DWBLocalPlanner/sim_time": 2.0}, distro="kilted")
    assert made.overlay_reason == ""
    assert "sim_time: 2.0               # s" in made.files[FILE]


def test_what_nav2_has_no_parameter_for_goes_to_an_overlay() -> None:
    made = rewrite_parameters([NAV2], {"planner_patience": 7.0})
    assert made.overlay_reason == "Nav2 has no place for planner_patience"
    assert made.files["overlay.yaml"].endswith("planner_patience: 7.0\n")


def test_integers_of_nav2_stay_integers() -> None:
    keys = own_keys(read_sources([NAV2]))
    assert keys is not None
    assert keys["DWBLocalPlanner/vx_samples"].typed(8.0) == 8
    assert isinstance(keys["DWBLocalPlanner/vx_samples"].typed(8.0), int)
    assert keys["DWBLocalPlanner/vx_samples"].typed(8.5) is None
    assert isinstance(keys["DWBLocalPlanner/sim_time"].typed(2), float)
    assert (
        keys["local_costmap/inflation_layer/inflation_radius"].text == "local_costmap.inflation_layer.inflation_radius"
    )


def test_sources_of_move_base_have_no_keys_of_nav2() -> None:
    assert own_keys(read_sources(["turtlebot"])) is None


def test_the_packaged_robot_of_nav2_is_read_with_its_simulated_base() -> None:
    assert NAV2 in packaged_sets()
    read = read_sources([NAV2])
    assert [Path(f).name for f in read.files] == [FILE, "navstack.yaml"]
    robot = load_configuration([NAV2])
    assert [f for f in robot.findings if f.severity != "info"] == []
    assert robot.local_planner.name == "dwb"
    assert robot.navstack.sim.lasers == ["laser"]
    assert robot.nav2_ids["FollowPath"] == "DWBLocalPlanner" and robot.nav2_ids["GridBased"] == "NavfnPlanner"


def test_a_robot_with_dwb_can_be_sent_to_other_processes() -> None:
    robot = load_configuration([NAV2])
    again = pickle.loads(pickle.dumps(robot))
    assert again.local_planner == robot.local_planner
    assert again.local_planner.params.make_critics()[5].params.scale == 32.0


@pytest.mark.slow
def test_the_packaged_robot_of_nav2_reaches_every_goal_of_the_office() -> None:
    import navstack as nav

    result = nav.simulate("office", robot=NAV2, seed=0)
    assert [goal.state for goal in result.goals] == ["SUCCEEDED"] * 3
