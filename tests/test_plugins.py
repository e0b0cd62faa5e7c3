from __future__ import annotations

import pytest

from navstack.core.errors import UnknownPluginError
from navstack.plugins import GLOBAL_PLANNERS, REGISTRIES, Registry, normalize


class Thing:
    pass


class Other:
    pass


def registry() -> Registry[object]:
    fresh: Registry[object] = Registry("thing", "navstack.no_such_group", "navstack.core")
    fresh.add("thing", Thing, aliases=("things/ThingROS",))
    return fresh


def test_ros_spellings_are_one_name() -> None:
    things = registry()
    assert normalize("costmap_2d::StaticLayer") == "costmap_2d/StaticLayer"
    assert things.get("things::ThingROS").cls is Thing
    assert "things/ThingROS" in things
    assert "nothing" not in things


def test_a_registered_name_cannot_be_registered_again() -> None:
    with pytest.raises(ValueError, match="already registered"):
        registry().add("other", Other, aliases=("things/ThingROS",))


def test_an_unknown_name_suggests_a_plugin_and_lists_the_known_ones() -> None:
    with pytest.raises(UnknownPluginError, match=r'did you mean "things/ThingROS"\? known: thing') as caught:
        registry().get("things/ThingsROS")
    assert caught.value.data["known"] == ["thing"]


def test_every_kind_has_plugins_that_ros_names_find() -> None:
    for kind in REGISTRIES:
        assert list(kind), kind.kind
    assert GLOBAL_PLANNERS.get("navfn/NavfnROS").name == "navfn"
    with pytest.raises(UnknownPluginError, match="NavfnROS"):
        GLOBAL_PLANNERS.get("navfn/NavFnROS")


def test_plugins_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    class Point:
        name = "theirs"
        dist = None

        @staticmethod
        def load() -> type:
            return Other

    monkeypatch.setattr("navstack.plugins.entry_points", lambda group: [Point()] if group == "g" else [])
    things: Registry[object] = Registry("thing", "g", "navstack.core")
    assert things.get("theirs").cls is Other
    assert things.get("theirs").origin == "entry point"
