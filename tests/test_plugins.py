from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from navstack.cli.app import run as command
from navstack.core import UnknownPluginError
from navstack.plugins import BUILTIN, GLOBAL_PLANNERS, REGISTRIES, Plugin, Registry, normalize


class Thing:
    pass


class Other:
    pass


def registry() -> Registry[object]:
    fresh: Registry[object] = Registry("thing", "navstack.no_such_group")
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
    points = [EntryPoint("theirs", "tests.test_plugins:Other", "g"), EntryPoint("not_theirs", "nowhere:Nothing", "h")]
    monkeypatch.setattr("navstack.plugins.registry._entry_points", lambda: EntryPoints(points))
    things: Registry[object] = Registry("thing", "g")
    assert things.get("theirs").cls is Other
    assert things.get("theirs").origin == "entry point"


def test_entry_points_of_unknown_groups_are_reported(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    points = [
        EntryPoint("swirl", "nowhere:Swirl", "navstack.global_planer"),
        EntryPoint("glow", "nowhere:Glow", "navstack.foo"),
        EntryPoint("other", "nowhere:Other", "elsewhere.foo"),
    ]
    monkeypatch.setattr("navstack.plugins.registry._entry_points", lambda: EntryPoints(points))
    with pytest.raises(UnknownPluginError, match=r'group "navstack.global_planer" is unknown; did you mean') as caught:
        GLOBAL_PLANNERS.get("swirl")
    assert "glow" not in str(caught.value)
    assert command(["info"]) == 0
    printed = capfd.readouterr()
    text = " ".join((printed.out + printed.err).split())
    assert 'the entry point "swirl" has no effect' in text
    assert 'its group "navstack.foo" is unknown; ' in text
    assert "elsewhere" not in text


def test_contracts_without_pytest_say_what_to_install() -> None:
    program = (
        "import sys; sys.modules['pytest'] = None\n"
        "from navstack.core import InputError\n"
        "try:\n    from navstack.testing import critic_contract\n"
        "except InputError as error:\n    print(error, error.__suppress_context__)"
    )
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout.startswith("navstack.testing needs pytest, which is not installed; install the extra `test`: ")
    assert done.stdout.rstrip().endswith("True")


@pytest.mark.slow
def test_the_table_of_built_in_plugins_agrees_with_their_decorators() -> None:
    """`python tools/builtin_plugins.py` writes the table."""
    for registry in REGISTRIES:
        table = {name: tuple(values) for name, values in BUILTIN[registry.kind].items()}
        registered = {p.name: (p.cls.__module__, *p.aliases) for p in registry if p.origin == "navstack"}
        assert {name: registered[name] for name in table} == table
        own = {name for name, (module, *_) in registered.items() if module.startswith("navstack.")}
        assert own == set(table), registry.kind
    tool = Path(__file__).parents[1] / "tools" / "builtin_plugins.py"
    assert subprocess.run([sys.executable, str(tool), "--check"], check=False).returncode == 0


def test_a_look_up_imports_no_other_plugin() -> None:
    program = (
        "import sys; from navstack.plugins import CRITICS; from navstack.plugins.builtin import BUILTIN; "
        "before = set(sys.modules); assert 'path' in CRITICS and CRITICS.names(); "
        "print(*[m for m in set(sys.modules) - before if m.startswith('navstack.')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_a_configured_plugin_says_its_instance() -> None:
    thing = registry().get("thing")
    made = thing.configured({"a": 1}, "things/first", "first")
    assert (made.name, made.cls, made.params, made.namespace) == ("first", Thing, {"a": 1}, "things/first")
    assert made.ros_name == thing.ros_name == "things/ThingROS"
    assert (thing.name, thing.params, thing.namespace) == ("thing", None, "")


def test_a_plugin_is_made_with_its_type() -> None:
    made = Plugin[Thing]("thing", Thing, {"a": 1})
    assert (made.name, made.cls, made.params, made.origin) == ("thing", Thing, {"a": 1}, "navstack")
    assert made == Plugin("thing", Thing, {"a": 1}, aliases=("x",))
