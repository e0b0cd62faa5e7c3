"""Effective parameters: written, loaded again, compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import ParameterError
from navstack.parameters.configuration import load_configuration
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.report import as_dict, as_yaml, parameters_of, same_parameters
from navstack.parameters.yaml_editor import value_text
from navstack.parameters.yaml_reader import parse_value, plain
from navstack.plugins import ParamModel
from tests.parameters.robots import name_of, robots
from tests.parameters.test_configuration import robot

ROBOTS = [["turtlebot"], *robots()]
IDS = ["packaged", *(name_of(r) for r in ROBOTS[1:])]


def shown(loaded: Configuration, tmp_path: Path, **options: Any) -> Configuration:
    file = tmp_path / "shown.yaml"
    file.write_text(as_yaml(parameters_of(loaded), ["a header"], **options), encoding="utf-8")
    return load_configuration([str(file)])


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("sources", ROBOTS, ids=IDS)
def test_the_yaml_loads_to_the_same_configuration(sources: list[str], tmp_path: Path) -> None:
    loaded = None
    for overrides in ([], ["base_local_planner=dwa", "base_global_planner=navfn"]):
        try:
            loaded = load_configuration(sources, overrides=overrides, allow_missing=True)
            break
        except ParameterError:
            continue  # its errors are recorded in tests/parameters/findings
    if loaded is None:
        assert name_of(sources) != "packaged"
        return
    assert same_parameters(loaded, shown(loaded, tmp_path))
    assert same_parameters(loaded, shown(loaded, tmp_path, written_only=True))


def test_defaults_are_written_as_well(tmp_path: Path) -> None:
    loaded = load_configuration([robot()])
    again = shown(loaded, tmp_path)
    assert same_parameters(loaded, again)
    assert not same_parameters(loaded, load_configuration([robot()], overrides=["DWAPlannerROS/sim_time=1.0"]))


def test_every_field_of_every_component_in_use_is_listed() -> None:
    loaded = load_configuration(["turtlebot"])
    names = {p.name for p in parameters_of(loaded)}
    parts: list[tuple[str, ParamModel]] = [("", loaded.move_base), ("navstack", loaded.navstack)]
    parts.append(("navstack/motion", loaded.navstack.motion))
    parts.append(("navstack/sim/wheels", loaded.navstack.sim.wheels))
    parts += [("global_costmap", loaded.global_costmap.params), ("local_costmap", loaded.local_costmap.params)]
    for choice in (
        *loaded.global_costmap.layers,
        *loaded.local_costmap.layers,
        loaded.global_planner,
        loaded.local_planner,
        *loaded.recoveries,
    ):
        parts.append((choice.namespace, choice.params))
    for namespace, params in parts:
        for field in type(params).model_fields:
            if field in params.FROM_NAVSTACK or field in (params.CHILD_FIELD, "sim", "motion", "wheels"):
                continue
            assert f"{namespace}/{field}".strip("/") in names
    assert "local_costmap/obstacle_layer/scan/max_obstacle_height" in names
    assert "navstack/sim/laser/beams" in names


def test_every_value_has_its_origin() -> None:
    found = {
        p.name: p for p in parameters_of(load_configuration(["turtlebot"], overrides=["DWAPlannerROS/sim_time=2"]))
    }
    assert found["DWAPlannerROS/max_vel_trans"].origin_text == "turtlebot/dwa_local_planner_params.yaml:10"
    assert found["DWAPlannerROS/sim_time"].origin_text == "overrides[0]"
    assert found["DWAPlannerROS/twirling_scale"].origin_text == "default"
    assert found["global_costmap/plugins"].origin_text == "turtlebot/global_costmap_params.yaml:11"
    assert found["recovery_behaviors"].origin_text == "turtlebot/move_base_params.yaml:20"
    document = as_dict(found.values())
    assert document["DWAPlannerROS/max_vel_x"]["unit"] == "m/s"
    assert document["DWAPlannerROS/twirling_scale"]["origin"] is None


def test_a_value_that_would_override_a_layer_is_not_written() -> None:
    """costmap_2d copies track_unknown_space of a costmap to its layers."""
    loaded = load_configuration([robot()])
    text = as_yaml(parameters_of(loaded))
    assert "  # track_unknown_space: false" in text
    assert yaml.safe_load(text)["global_costmap"]["static_layer"]["track_unknown_space"] is True


def test_values_set_by_the_built_in_list_are_not_written() -> None:
    text = as_yaml(parameters_of(load_configuration([robot()])))
    assert "# reset_distance:" in text
    assert "reset_distance" not in yaml.safe_load(text).get("aggressive_reset", {})


VALUES = st.recursive(
    st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(min_size=1), inner, max_size=3),
    max_leaves=6,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(VALUES)
def test_every_value_reads_back(value: Any) -> None:
    node, findings = parse_value(value_text(value), "x")
    assert node is not None and not findings
    assert plain(node) == value
    assert type(plain(node)) is type(value)
