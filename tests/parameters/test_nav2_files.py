"""Files of real robots and of nav2_bringup: each loads, or says in a sentence why not; every key is accounted for.

The folder is that of the foreign data, or `NAVSTACK_NAV2_PARAMS` with other files of the same kind.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from navstack.core import ParameterError
from navstack.parameters import Configuration, check_parameters, load_configuration, read_yaml, same_parameters
from navstack.parameters.nav2.audit import audits_of, check_nodes, find_distro
from navstack.parameters.nav2.declared import NAV2_DISTROS
from navstack.parameters.nav2.document import is_nav2, read_nodes
from tests.conftest import SHARED

FOLDER = Path(os.environ.get("NAVSTACK_NAV2_PARAMS") or SHARED / "data" / "nav2_params")
FILES = sorted(p for p in FOLDER.glob("*/*.yaml") if is_nav2(read_yaml(p).root))
BRINGUP = [p for p in FILES if p.parent.name == "nav2_bringup"]
MIXED = ("nav2_bringup_humble_multirobot_all",)
"""Files on the branch of one distribution with the keys of the next."""

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


def drivable() -> list[Path]:
    return [p for p in BRINGUP if re.search(r"_(jazzy|kilted|lyrical)$", p.stem)]


@pytest.mark.slow
@pytest.mark.parametrize("path", drivable(), ids=name)
def test_nav2_bringup_drives_through_the_office(path: Path) -> None:
    import navstack as nav

    robot: Configuration = load_configuration([str(path)])
    result = nav.simulate("office", robot=robot)
    assert [str(g.state) for g in result.goals] == ["SUCCEEDED"] * 3
    assert result.collisions == 0
