"""Any YAML gives a configuration or findings; what is written is what is read."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from navstack.core import ParameterError
from navstack.parameters import (
    Finding,
    as_yaml,
    check_parameters,
    load_configuration,
    packaged_sets,
    parameters_of,
    plain,
    same_parameters,
    value_text,
)
from navstack.parameters.yaml_reader import parse_yaml

PROPERTY = settings(deadline=None, max_examples=60)

NAMES = st.sampled_from(
    [
        "global_costmap",
        "local_costmap",
        "plugins",
        "obstacle_layer",
        "inflation_layer",
        "static_layer",
        "scan",
        "observation_sources",
        "footprint",
        "robot_radius",
        "DWAPlannerROS",
        "NavfnROS",
        "max_vel_x",
        "max_trans_vel",
        "critics",
        "recovery_behaviors",
        "conservative_reset",
        "navstack",
        "sim",
        "lasers",
        "laser",
        "ros_distro",
        "base_local_planner",
        "base_global_planner",
        "controller_frequency",
        "inflation_radius",
        "name",
        "type",
        "map_type",
        "static_map",
        "move_base",
        "a/b",
        "$(arg x)",
    ]
)
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-1000, 10**20),
    st.floats(width=32),
    st.text(max_size=8),
    st.sampled_from(
        ["dwa_local_planner/DWAPlannerROS", "costmap_2d::InflationLayer", "scan bump", "voxel", "[[0, 0]]", "[]"]
    ),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.one_of(NAMES, st.text(max_size=6)), inner, max_size=5)
    ),
    max_leaves=25,
)
TREES = st.dictionaries(st.one_of(NAMES, st.text(max_size=6)), VALUES, max_size=8)


def holds(findings: list[Finding]) -> None:
    """What every finding owes its reader."""
    for f in findings:
        assert f.severity in ("error", "warning", "info")
        assert f.rule and f.message.strip()
        assert f.line >= 0 and f.column >= 0
    assert findings == sorted(findings, key=lambda f: (f.file, f.line, f.column))


@pytest.mark.slow
@PROPERTY
@given(TREES)
def test_any_tree_gives_a_configuration_or_findings(tree: dict[str, Any]) -> None:
    findings = check_parameters([tree])
    holds(findings)
    errors = [f for f in findings if f.severity == "error"]
    try:
        load_configuration([tree])
    except ParameterError as exc:
        assert errors
        assert len(exc.message.splitlines()) == len(errors) + 1
    else:
        assert not errors


@pytest.mark.slow
@PROPERTY
@given(TREES)
def test_a_tree_laid_over_the_turtlebot_gives_a_configuration_or_findings(tree: dict[str, Any]) -> None:
    findings = check_parameters(["turtlebot", tree])
    holds(findings)


@PROPERTY
@given(st.text(max_size=300))
def test_any_text_gives_a_tree_or_findings(text: str) -> None:
    read = parse_yaml(text, "t.yaml")
    holds(sorted(read.findings, key=lambda f: (f.line, f.column)))
    if not read.root.items:
        return
    assert isinstance(plain(read.root), dict)


@PROPERTY
@given(st.text(alphabet="ab:- \n[]{}#&*!'\"|>?,\t1.~%@`<", max_size=60))
def test_yaml_that_is_nearly_right_reads_as_pyyaml_reads_it(text: str) -> None:
    read = parse_yaml(text, "t.yaml")
    if any(f.severity == "error" for f in read.findings):
        return
    try:
        expected = yaml.safe_load(text)
    except yaml.YAMLError:
        return  # libyaml is a little more lenient
    assert plain(read.root) == (expected or {})


@pytest.mark.slow
@PROPERTY
@given(
    st.recursive(
        st.one_of(st.booleans(), st.integers(-(10**9), 10**9), st.floats(allow_nan=False), st.text(max_size=10)),
        lambda inner: st.one_of(
            st.lists(inner, max_size=4),
            st.dictionaries(st.text(st.characters(codec="ascii"), max_size=8), inner, max_size=4),
        ),
        max_leaves=20,
    )
)
@example({"0E0": False})
def test_what_pyyaml_writes_is_read_back(value: Any) -> None:
    text = yaml.safe_dump({"a": value})
    read = parse_yaml(text, "t.yaml")
    assert [str(f) for f in read.findings] == []
    assert plain(read.root) == {"a": value}


@pytest.mark.slow
@PROPERTY
@given(st.binary(max_size=400))
def test_any_bytes_in_a_file(data: bytes) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "costmap_common_params.yaml"
        path.write_bytes(data)
        holds(check_parameters([folder]))
        holds(check_parameters([str(path)]))
        launch = Path(folder) / "a.launch"
        launch.write_bytes(data)
        holds(check_parameters([str(launch)]))


@pytest.mark.slow
@PROPERTY
@given(st.text(max_size=40))
def test_any_override_and_distro(text: str) -> None:
    holds(check_parameters(["turtlebot"], overrides=[text]))
    holds(check_parameters(["turtlebot"], distro=text))


@pytest.mark.slow
def test_a_megabyte_of_anything_is_taken_or_refused(tmp_path: Path) -> None:
    rng = random.Random(7)
    path = tmp_path / "move_base_params.yaml"
    alphabets = [
        "ab:- \n",
        "[]{},: \n",
        "&a*b: \n",
        "\ta: b\n",
        "0123456789.e:\n ",
        "'\"|>#\n a:",
        "".join(map(chr, range(32, 127))),
    ]
    for alphabet in alphabets:
        path.write_text("".join(rng.choices(alphabet, k=990_000)))
        holds(check_parameters([str(path)]))
    # well-formed ones: more parameters than any robot has, and as many namespaces
    for text in ("key_{0}: {0}\n", "space_{0}: {{max_vel_x: {0}}}\n"):
        path.write_text("".join(text.format(i) for i in range(4_500)))
        assert len(check_parameters([str(path)])) > 4_000


def test_every_packaged_set_loads_without_a_warning() -> None:
    for name in packaged_sets():
        assert [str(f) for f in load_configuration([name]).findings if f.severity != "info"] == []


SETTABLE = [
    p
    for p in parameters_of(load_configuration(["turtlebot"]))
    if isinstance(p.value, (int, float)) and not p.name.startswith("navstack/")
]
SETTINGS = st.lists(
    st.sampled_from(SETTABLE).flatmap(
        lambda p: st.tuples(
            st.just(p.name),
            st.booleans()
            if isinstance(p.value, bool)
            else st.floats(1e-9, 2.0)
            if isinstance(p.value, float)
            else st.integers(1, 16),
        )
    ),
    min_size=1,
    max_size=8,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(SETTINGS)
def test_whatever_loads_shows_and_loads_to_the_same(changes: list[tuple[str, Any]]) -> None:
    overrides = [f"{name}={value_text(value)}" for name, value in changes]
    try:
        loaded = load_configuration(["turtlebot"], overrides=overrides)
    except ParameterError:
        return
    for written_only in (False, True):
        text = as_yaml(parameters_of(loaded), written_only=written_only)
        assert same_parameters(loaded, load_configuration([plain(parse_yaml(text, "shown.yaml").root)]))
