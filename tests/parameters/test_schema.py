"""JSON Schema: accepts what loads and rejects what does not."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pytest
import yaml

from navstack.parameters.configuration import load_configuration
from navstack.parameters.report import as_yaml, json_schema, parameters_of

SCHEMA = json_schema()
TYPES: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


def problems(value: Any, schema: Mapping[str, Any], at: str = "") -> list[str]:
    """The errors of a JSON Schema validator, for the keywords that this schema uses."""
    if "$ref" in schema:
        return problems(value, SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]], at)
    if "anyOf" in schema:
        return min((problems(value, s, at) for s in schema["anyOf"]), key=len)
    kind = schema.get("type")
    if kind is not None and (
        not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind in ("integer", "number"))
    ):
        return [f"{at}: {value!r} is no {kind}"]
    found: list[str] = []
    if "enum" in schema and value not in schema["enum"]:
        found.append(f"{at}: {value!r} is none of {schema['enum']}")
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        low, over = schema.get("minimum"), schema.get("exclusiveMinimum")
        high, under = schema.get("maximum"), schema.get("exclusiveMaximum")
        bad = (low is not None and value < low) or (over is not None and value <= over)
        if bad or (high is not None and value > high) or (under is not None and value >= under):
            found.append(f"{at}: {value} is out of range")
    if isinstance(value, list) and "items" in schema:
        found += [p for i, v in enumerate(value) for p in problems(v, schema["items"], f"{at}[{i}]")]
    if isinstance(value, dict):
        known, more = schema.get("properties", {}), schema.get("additionalProperties", True)
        for key, v in value.items():
            below = known.get(key, more)
            if below is False:
                found.append(f"{at}/{key}: unknown")
            elif isinstance(below, Mapping):
                found += problems(v, below, f"{at}/{key}")
    return found


def test_every_reference_resolves() -> None:
    text = json.dumps(SCHEMA)
    used = {part.partition('"')[0] for part in text.split('"#/$defs/')[1:]}
    assert used <= set(SCHEMA["$defs"])
    assert SCHEMA["$schema"].endswith("2020-12/schema")


def test_it_accepts_the_written_yaml() -> None:
    shown = yaml.safe_load(as_yaml(parameters_of(load_configuration(["turtlebot"]))))
    assert problems(shown, SCHEMA) == []


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ({"DWAPlannerROS": {"max_trans_vel": 0.5}}, None),
        ({"DWAPlannerROS": {"vthea_samples": 5}}, "/DWAPlannerROS/vthea_samples: 5 is no object"),
        ({"DWAPlannerROS": {"sim_time": 0.0}}, "/DWAPlannerROS/sim_time: 0.0 is out of range"),
        ({"DWAPlannerROS": {"use_dwa": 1}}, "/DWAPlannerROS/use_dwa: 1 is no boolean"),
        ({"DWAPlannerROS": {"ros_distro": "indigo"}}, "/DWAPlannerROS/ros_distro: 'indigo' is no object"),
        ({"navstack": {"ros_distro": "kinetic"}}, "/navstack/ros_distro: 'kinetic' is none of ['noetic', 'indigo']"),
        ({"local_costmap": {"inflation_layer": {"enable": True}}}, "/local_costmap/inflation_layer/enable: unknown"),
        ({"local_costmap": {"mine": {"anything": 1}}}, None),
        (
            {"local_costmap": {"obstacle_layer": {"laser": {"data_type": "LaserScan", "marking": "yes"}}}},
            "/local_costmap/obstacle_layer/laser/marking: 'yes' is no boolean",
        ),
        ({"controler_frequency": 5.0}, "/controler_frequency: 5.0 is no object"),
        ({"my_recovery": {"speed": 1}}, None),
    ],
)
def test_errors_of_the_schema(document: dict[str, Any], problem: str | None) -> None:
    assert problems(document, SCHEMA) == ([problem] if problem else [])


def test_former_names_are_deprecated() -> None:
    dwa = SCHEMA["$defs"]["DWAParams"]["properties"]
    assert dwa["vtheta_samples"]["deprecated"] is True
    assert dwa["vtheta_samples"]["minimum"] == 1
    assert "vth_samples" in dwa["vtheta_samples"]["description"]
    assert dwa["stop_time_buffer"]["deprecated"] is True
