"""Files of real robots and of nav2_bringup: each loads, or says in a sentence why not; every key is accounted for.

The folder is that of the foreign data, or `NAVSTACK_NAV2_PARAMS` with other files of the same kind.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import navstack as nav
from navstack.core import NavError, ParameterError
from navstack.parameters import check_parameters, load_configuration, read_yaml, same_parameters
from navstack.parameters.nav2.audit import audits_of, check_nodes, find_distro
from navstack.parameters.nav2.declared import NAV2_DISTROS
from navstack.parameters.nav2.document import is_nav2, read_nodes
from navstack.scenario.outcome import EXPLAIN_COLLISIONS
from tests.conftest import SHARED

FOLDER = Path(os.environ.get("NAVSTACK_NAV2_PARAMS") or SHARED / "data" / "nav2_params")
FILES = sorted(p for p in FOLDER.glob("*/*.yaml") if is_nav2(read_yaml(p).root))
BRINGUP = [p for p in FILES if p.parent.name == "nav2_bringup"]
MIXED = ("nav2_bringup_humble_multirobot_all",)
"""Files on the branch of one distribution with the keys of the next."""

PLAIN_TREE = """<root main_tree_to_execute="T"><BehaviorTree ID="T"><PipelineSequence>
  <RateController hz="1.0"><ComputePathToPose goal="{goal}" path="{path}" planner_id="GridBased"/></RateController>
  <FollowPath path="{path}" controller_id="FollowPath"/>
</PipelineSequence></BehaviorTree></root>"""

KNOWN = {
    "FollowPath.stateful": "a key of the goal checker in DWB's block",
    "static_layer": "left over: plugins does not list it",
    "transform_timeout": "no code ever declared it",
    "costmap_topic": "of Humble",
    "footprint_topic": "of Humble",
    "save_map_timeout": "of the map saver",
    "controller.simulation_step": "misspelt: simulation_time_step",
    "obstacle_layer.scan": "the layer has no observation_sources",
}
"""Keys in nav2_bringup's own files that its code ignores -> why."""


def name(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


@pytest.mark.skipif(bool(FILES), reason="the files are here")
def test_the_files_are_absent() -> None:
    pytest.skip("no files of Nav2: set NAVSTACK_NAV2_PARAMS to their folder")


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=name)
def test_a_file_loads_or_says_why_not(path: Path) -> None:
    found = check_parameters([str(path)])
    errors = [f for f in found if f.severity == "error"]
    for f in found:
        assert f.message and "\n" not in f.message and f.file
        assert f.line or not f.rule.startswith("nav2-") or f.rule in ("nav2-distro", "nav2-no-server"), f
    try:
        configuration = load_configuration([str(path)])
    except ParameterError as exc:
        assert errors and errors[0].message in exc.message
    else:
        assert not errors
        again = load_configuration([configuration.tree.as_dict()])
        assert same_parameters(configuration, again)


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_key_of_a_file_is_accounted_for(path: Path) -> None:
    """Each parameter is declared, belongs to a plugin of another package, or has a finding."""
    nodes = read_nodes([(str(path), read_yaml(path).root)], {}, [])
    assert nodes is not None
    audits = audits_of(nodes, find_distro(nodes).distro)
    keys = {f.key for f in check_nodes(nodes, audits.values())}
    for audit in audits.values():
        for param in audit.undeclared():
            parts = param.name.split(".")
            within = {audit.node.key(".".join(parts[:end])) for end in range(1, len(parts) + 1)} | {audit.node.name}
            assert within & keys, audit.node.key(param.name)


@pytest.mark.parametrize("path", BRINGUP, ids=name)
def test_the_distribution_of_nav2_bringup_is_found(path: Path) -> None:
    if path.stem in MIXED:
        pytest.skip("it has the keys of the next distribution")
    word = path.stem.removeprefix("nav2_bringup_").partition("_")[0]
    nodes = read_nodes([(str(path), read_yaml(path).root)], {}, [])
    assert nodes is not None
    assert NAV2_DISTROS[find_distro(nodes).distro] == ("lyrical" if word == "main" else word)


@pytest.mark.parametrize("path", BRINGUP, ids=name)
def test_nav2_bringup_has_no_undeclared_keys_but_the_known_ones(path: Path) -> None:
    nodes = read_nodes([(str(path), read_yaml(path).root)], {}, [])
    assert nodes is not None
    audits = audits_of(nodes, find_distro(nodes).distro)
    found = [f for f in check_nodes(nodes, audits.values()) if f.severity != "info"]
    unknown = [
        f for f in found if f.key.partition("/")[2] not in KNOWN and not f.message.startswith("goal_checker_plugins = ")
    ]
    assert [str(f) for f in unknown] == []


RELEASES = [p for p in BRINGUP if p.stem.removeprefix("nav2_bringup_") in (*NAV2_DISTROS, "main")]
"""The files that nav2_bringup installs for its own robot."""
ROBOTS = [p for p in FILES if p not in BRINGUP]


@pytest.mark.sampled(3)
@pytest.mark.slow
@pytest.mark.parametrize("place", ["office", "warehouse"])
@pytest.mark.parametrize("path", RELEASES, ids=name)
def test_nav2_bringup_of_every_distribution_drives(path: Path, place: str) -> None:
    result = nav.simulate(place, robot=load_configuration([str(path)]))
    assert [str(g.state) for g in result.goals] == ["SUCCEEDED"] * 3
    assert result.collisions == 0


@pytest.mark.sampled(3)
@pytest.mark.slow
@pytest.mark.parametrize("path", ROBOTS, ids=name)
def test_a_robot_reaches_its_goal_or_says_why_not(path: Path) -> None:
    """What keeps a robot from loading, from its start or from its goal is one sentence; a robot that touches anything has a
    warning about what explains contacts."""
    try:
        configuration = load_configuration([str(path)])
        result = nav.simulate("office", robot=configuration, goals=["office_2"], time_limit_s=300.0)
    except NavError as exc:
        assert exc.message and "Traceback" not in exc.message
        return
    (goal,) = result.goals
    assert str(goal.state) == "SUCCEEDED" or len(goal.message) > 20
    warned = {f.rule for f in configuration.findings if f.severity == "warning"}
    assert result.collisions == 0 or warned & EXPLAIN_COLLISIONS


@pytest.mark.slow
@pytest.mark.sampled(3)
@pytest.mark.parametrize("path", RELEASES, ids=name)
def test_the_tree_of_a_file_drives(path: Path, tmp_path: Path) -> None:
    """A tree next to the parameters, which they name: here one that plans each second and does not recover."""
    (tmp_path / "robot.yaml").write_bytes(path.read_bytes())
    (tmp_path / "plain.xml").write_text(PLAIN_TREE, encoding="utf-8")
    key = "default_bt_xml_filename" if "foxy" in path.stem else "default_nav_to_pose_bt_xml"
    navigator = tmp_path / "navigator.yaml"
    navigator.write_text(f"bt_navigator: {{ros__parameters: {{{key}: /opt/plain.xml}}}}\n", encoding="utf-8")
    configuration = load_configuration([str(tmp_path / "robot.yaml"), str(navigator)])
    assert configuration.navstack.behavior_tree == str(tmp_path / "plain.xml")
    result = nav.simulate("office", robot=configuration, goals=["office_2"])
    assert (str(result.goals[0].state), result.collisions) == ("SUCCEEDED", 0)
