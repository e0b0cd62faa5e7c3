"""The golden data of Nav2's layers and planners, reached through a nav2_params.yaml, whose classes select the same plugins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from navstack.parameters import load_configuration
from navstack.plugins import GLOBAL_PLANNERS, Layer, Plugin
from tests.golden.nav2_w3 import needs_data, values_of
from tests.golden.test_nav2_layers import JOBS, assert_equal_steps, nested, source_of
from tests.golden.test_nav2_planners import JOBS as PLANS

pytestmark = [needs_data, pytest.mark.slow]
ROBOT = Path(__file__).parents[1] / "parameters" / "nav2_robot.yaml"
WITH_SOURCES = ("ObstacleLayer", "VoxelLayer")


def blocks_of(job: dict[str, Any]) -> dict[str, Any]:
    """The parameters of a global costmap, as a file of Nav2 has them."""
    params = job["params"]
    made = {key: value for key, value in params.items() if "." not in key}
    made["plugins"] = [name for name, _ in job["layers"]]
    for name, kind in job["layers"]:
        made[name] = block_of(f"nav2_costmap_2d::{kind}", nested(params, name), job)
    return made


def block_of(kind: str, own: dict[str, Any], job: dict[str, Any]) -> dict[str, Any]:
    block: dict[str, Any] = {"plugin": kind, **{key: value for key, value in own.items() if "." not in key}}
    if kind.endswith(WITH_SOURCES):
        block |= {"observation_sources": "points", "points": source_of(job)}
    for inner in own.get("plugins", ()):
        inside = nested(own, inner)
        block[inner] = block_of(inside.pop("plugin"), inside, job)
    return block


def written(folder: Path, node: dict[str, Any]) -> list[str]:
    """The robot of the tests and a file that replaces a part of it."""
    path = folder / "more.yaml"
    path.write_text(yaml.safe_dump(node), encoding="utf-8")
    return [str(ROBOT), str(path)]


def with_defects(layer: Plugin[Layer]) -> Plugin[Layer]:
    """The layer with the defects of Nav2 that the golden data have; a file cannot ask for them."""
    if "nav2_compatible" not in type(layer.params).model_fields:
        return layer
    return replace(layer, params=layer.params.model_copy(update={"nav2_compatible": True}))


@pytest.mark.sampled
@pytest.mark.parametrize("name", sorted(JOBS))
def test_layers_of_a_file(name: str, tmp_path: Path) -> None:
    node = {"global_costmap": {"global_costmap": {"ros__parameters": blocks_of(JOBS[name])}}}
    loaded = load_configuration(written(tmp_path, node), distro="lyrical").global_costmap
    assert [layer.name for layer in loaded.layers] == [name for name, _ in JOBS[name]["layers"]]
    assert_equal_steps(name, [with_defects(layer) for layer in loaded.layers])


@pytest.mark.sampled
@pytest.mark.parametrize("name", sorted(PLANS))
def test_planners_of_a_file(name: str, tmp_path: Path) -> None:
    """The planner and the parameters whose plans are compared with Nav2's."""
    job = PLANS[name]
    parameters = {"GridBased.plugin": job["plugin"], "GridBased.tolerance": 0.5, **job["params"]}
    node = {"planner_server": {"ros__parameters": parameters}}
    loaded = load_configuration(written(tmp_path, node), distro="lyrical").global_planner
    cls = GLOBAL_PLANNERS.get(job["plugin"]).cls
    assert loaded.cls is cls and loaded.params == cls.Params(**values_of(job))
