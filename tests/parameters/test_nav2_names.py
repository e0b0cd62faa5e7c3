"""Files written for Nav2: names of plugins, their instances and nodes."""

from __future__ import annotations

import pytest

from navstack.parameters.configuration import check_parameters, load_configuration


@pytest.mark.parametrize("written", ["nav2_smac_planner::SmacPlannerHybrid", "smac_planner_hybrid", "smac_hybrid"])
@pytest.mark.parametrize("section", ["SmacPlannerHybrid", "smac_hybrid", "smac_planner_hybrid", "GridBased"])
def test_a_planner_by_each_name(written: str, section: str) -> None:
    found = load_configuration(
        ["turtlebot", {"base_global_planner": written, section: {"minimum_turning_radius": 1.5}}]
    )
    assert found.global_planner.name == "smac_hybrid"
    assert found.global_planner.params.minimum_turning_radius == 1.5


def test_a_smoother_by_the_name_of_nav2s_instance() -> None:
    found = load_configuration(
        ["turtlebot", {"base_smoother": "nav2_smoother::SimpleSmoother", "simple_smoother": {"max_its": 7}}]
    )
    assert found.smoother is not None and found.smoother.params.max_its == 7


def test_a_section_that_is_not_in_use_is_reported_once() -> None:
    sections = {"GridBased": {"minimum_turning_radius": -1.0}, "FollowPath": {"model_dt": 0.1}}
    found = [f for f in check_parameters(["turtlebot", sections]) if f.key.startswith(tuple(sections))]
    assert [(f.rule, f.key) for f in found] == [("not-in-use", "FollowPath"), ("not-in-use", "GridBased")]


def test_nodes_of_nav2() -> None:
    node = {"ros__parameters": {"planner_plugins": ["GridBased"], "GridBased": {"plugin": "smac_hybrid"}}}
    (found,) = [f for f in check_parameters(["turtlebot", {"planner_server": node}]) if f.key == "planner_server"]
    assert found.message == (
        "planner_server is a node of Nav2, so its 2 parameters have no effect; in move_base, base_global_planner names the "
        "planner, whose section (GridBased) belongs at the root"
    )
