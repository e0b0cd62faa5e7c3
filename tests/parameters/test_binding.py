"""A namespace -> its model: which value counts, and findings about values that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import pytest

from navstack.parameters import Finding, Space, read_sources
from navstack.parameters.binding import Binder
from navstack.plugins import ParamModel, PluginSpec, param


class Inner(ParamModel):
    depth: float = param(1.0, "an inner value", unit="m")


class Child(ParamModel):
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"reach"})
    reach: float = param(2.5, "climbs")
    topic: str = param("", "name")


class Model(ParamModel):
    RENAMED: ClassVar[Mapping[str, str]] = {"old_speed": "speed", "older_speed": "speed"}
    NO_EFFECT: ClassVar[Mapping[str, str]] = {"dead": "nobody reads it"}
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"rate"})
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset({"radius"})
    FROM_NAVSTACK: ClassVar[frozenset[str]] = frozenset({"ros_distro"})
    CHILD_FIELD: ClassVar[str | None] = "sources"

    speed: float = param(0.5, "speed", unit="m/s", ge=0.0, le=5.0)
    rate: float = param(20.0, "rate", gt=0.0)
    radius: float = param(0.55, "radius", ge=0.0)
    samples: int = param(3, "samples", ge=1)
    on: bool = param(True, "switch")
    mode: Literal["a", "b"] = param("a", "mode")
    global_frame: str = param("map", "frame")
    names: str = param("", "names of children")
    pair: tuple[float, float] = param((0.0, 0.0), "two numbers")
    points: list[list[float]] | str = param("[]", "points")
    maybe: float | None = param(None, "may be absent")
    plugins: list[PluginSpec] | None = param(None, "a list")
    inner: Inner = param(Inner(), "a namespace")
    ros_distro: str = param("noetic", "ours")
    sources: dict[str, Child] = param({}, "children")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        return dict.fromkeys(str(values.get("names", "")).split(), Child)


def bind(text: dict[str, Any], path: str = "", **navstack: Any) -> tuple[Any, list[Finding]]:
    read = read_sources([text])
    space: Space = read.root
    for name in path.split("/") if path else ():
        found = space.space(name)
        assert found is not None
        space = found
    findings: list[Finding] = []
    return Binder(findings, navstack).bind(Model, space), findings


def test_defaults_cause_no_findings() -> None:
    made, findings = bind({})
    assert made == Model()
    assert findings == []


def test_ints_are_accepted_for_floats_and_whole_floats_for_ints() -> None:
    made, findings = bind({"speed": 1, "samples": 4.0})
    assert (made.speed, made.samples) == (1.0, 4)
    assert type(made.samples) is int
    assert findings == []


def test_a_fractional_int_is_rounded_as_in_roscpp() -> None:
    made, findings = bind({"samples": 4.5})
    assert made.samples == 5
    assert [(f.severity, f.rule, f.suggestion) for f in findings] == [("warning", "rounded", "5")]


def test_a_former_name_is_used_and_the_current_one_suggested() -> None:
    made, findings = bind({"old_speed": 0.7})
    assert made.speed == 0.7
    assert [(f.severity, f.rule, f.suggestion) for f in findings] == [("info", "renamed", "speed")]


def test_the_current_name_takes_precedence_over_a_former_one() -> None:
    made, _ = bind({"old_speed": 0.7, "speed": 0.3})
    assert made.speed == 0.3


def test_search_covers_the_enclosing_namespaces() -> None:
    assert bind({"rate": 5.0, "a": {"b": {}}, "x": 1})[0].rate == 5.0
    assert bind({"rate": 5.0, "a": {"b": {"speed": 1.0}}}, "a/b")[0].rate == 5.0
    assert bind({"rate": 5.0, "a": {"rate": 6.0, "b": {"speed": 1.0}}}, "a/b")[0].rate == 6.0
    assert bind({"speed": 5.0, "a": {"b": {"names": "x"}}}, "a/b")[0].speed == 0.5


def test_the_enclosing_namespace_overrides_with_a_note() -> None:
    made, findings = bind({"radius": 1.0, "a": {"radius": 0.2}}, "a")
    assert made.radius == 1.0
    assert [(f.severity, f.rule, f.key) for f in findings] == [("info", "overridden-by-parent", "a/radius")]
    assert "1" in findings[0].message and "0.2" in findings[0].message


def test_a_search_from_below_finds_the_overriding_value() -> None:
    class Layer(Model):
        FROM_PARENT: ClassVar[frozenset[str]] = frozenset({"reach"})
        reach: float = param(2.5, "range")

    read = read_sources([{"reach": 9.0, "a": {"reach": 1.0, "names": "s"}}])
    space = read.root.space("a")
    assert space is not None
    made: Any = Binder([]).bind(Layer, space)
    assert made.reach == 9.0
    assert made.sources["s"].reach == 9.0


def test_children_nested_namespaces_and_navstack_fields() -> None:
    made, findings = bind(
        {"names": "s t", "s": {"topic": "/scan"}, "reach": 4.0, "inner": {"depth": 2}}, ros_distro="indigo"
    )
    assert made.sources == {"s": Child(topic="/scan", reach=4.0), "t": Child(reach=4.0)}
    assert made.inner.depth == 2.0
    assert made.ros_distro == "indigo"
    assert findings == []


def test_the_leading_slash_of_a_frame_is_removed() -> None:
    assert bind({"global_frame": "/map"})[0].global_frame == "map"


def test_lists_tuples_unions_and_entries() -> None:
    made, findings = bind(
        {"pair": [1, 2], "points": [[1, 2], [3, 4.5]], "maybe": 3, "plugins": [{"name": "a", "type": "b"}]}
    )
    assert (made.pair, made.points, made.maybe) == ((1.0, 2.0), [[1.0, 2.0], [3.0, 4.5]], 3.0)
    assert made.plugins == [PluginSpec(name="a", type="b")]
    assert bind({"points": "[[1, 2]]"})[0].points == "[[1, 2]]"
    assert findings == []


@pytest.mark.parametrize(
    ("values", "rule", "key", "words"),
    [
        ({"speed": "fast"}, "wrong-type", "speed", ('"fast"', "a number", "0.5")),
        ({"speed": True}, "wrong-type", "speed", ("true", "a number")),
        ({"speed": None}, "wrong-type", "speed", ("no value",)),
        ({"speed": [1]}, "wrong-type", "speed", ("list",)),
        ({"speed": float("nan")}, "wrong-type", "speed", ("nan",)),
        ({"speed": float("inf")}, "wrong-type", "speed", ("inf",)),
        ({"speed": "1.5"}, "wrong-type", "speed", ("quotes",)),
        ({"speed": 7.0}, "out-of-range", "speed", ("7", "at least 0 and at most 5 m/s")),
        ({"speed": -1}, "out-of-range", "speed", ("-1", "at least 0")),
        ({"old_speed": 9.0}, "out-of-range", "old_speed", ("at most 5",)),
        ({"rate": 0.0}, "out-of-range", "rate", ("greater than 0",)),
        ({"samples": "3"}, "wrong-type", "samples", ("quotes",)),
        ({"samples": 0}, "out-of-range", "samples", ("at least 1",)),
        ({"samples": 2**63}, "out-of-range", "samples", ("9223372036854775808", "64 bits")),
        ({"on": 1}, "wrong-type", "on", ("true or false", "ROS ignores it")),
        ({"mode": "c"}, "wrong-value", "mode", ('"c"', '"a" or "b"')),
        ({"names": 3}, "wrong-type", "names", ("3", "text")),
        ({"pair": [1]}, "wrong-type", "pair", ()),
        ({"pair": [1, "x"]}, "wrong-type", "pair", ('"x"',)),
        ({"points": [[1, "x"]]}, "wrong-type", "points", ()),
        ({"inner": {"depth": "x"}}, "wrong-type", "inner/depth", ('"x"',)),
        ({"inner": 3}, "wrong-type", "inner", ("namespace", "3")),
        ({"names": "s", "s": 3}, "wrong-type", "s", ("namespace",)),
        ({"names": "s", "s": {"reach": "x"}}, "wrong-type", "s/reach", ('"x"',)),
        ({"plugins": [{"name": "a"}]}, "missing", "plugins[0]/type", ("type",)),
        ({"plugins": ["a"]}, "wrong-type", "plugins", ()),
    ],
)
def test_values_that_cannot_be_used(values: dict[str, Any], rule: str, key: str, words: tuple[str, ...]) -> None:
    _, findings = bind(values)
    errors = [f for f in findings if f.severity == "error"]
    assert {(f.rule, f.key) for f in errors} == {(rule, key)}
    for word in words:
        assert word in errors[0].message


def test_all_wrong_values_are_reported_together() -> None:
    _, findings = bind(
        {"speed": "x", "rate": -1, "samples": 0, "inner": {"depth": True}, "names": "s", "s": {"reach": "y"}}
    )
    assert sorted(f.key for f in findings) == ["inner/depth", "rate", "s/reach", "samples", "speed"]


def test_namespaces_not_in_use_get_warnings_only() -> None:
    read = read_sources([{"speed": "x", "samples": 7}])
    findings: list[Finding] = []
    made: Any = Binder(findings).bind(Model, read.root, strictness="warning")
    assert [f.severity for f in findings] == ["warning"]
    assert (made.speed, made.samples) == (0.5, 7)


def test_roslaunch_substitutions_left_in_a_value_are_reported() -> None:
    made, findings = bind({"global_frame": "$(arg prefix)map"})
    assert made is not None
    assert [(f.severity, f.rule) for f in findings] == [("warning", "unfilled")]


def test_fixed_values_replace_written_ones() -> None:
    read = read_sources([{"speed": "nonsense"}])
    made: Any = Binder([]).bind(Model, read.root, fixed={"speed": 1.0})
    assert made.speed == 1.0
