"""The dock database: Nav2's format, and what is wrong in it in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core import InputError, Pose2D
from navstack.docking import Dock, DockDatabase, SimpleChargingDock, SimpleNonChargingDock, dump_docks, load_docks
from navstack.docking.errors import DockNotInDatabaseError, DockNotValidError
from navstack.parameters import load_configuration

NAV2 = """
docks:
  home_dock:
    type: 'charging_dock_1'
    frame: map
    pose: [0.3, -1.5, 1.57]
  flex_dock1: {type: charging_dock_1, frame: map, pose: [10.0, 10.0, 0.0], id: "c67f50cb"}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "docks.yaml"
    path.write_text(text)
    return path


def test_a_file_of_nav2_is_read_and_written_back(tmp_path: Path) -> None:
    docks = load_docks(write(tmp_path, NAV2))
    assert docks["home_dock"] == Dock("home_dock", "charging_dock_1", Pose2D(0.3, -1.5, 1.57), "map", "")
    assert docks["flex_dock1"].id == "c67f50cb"
    assert load_docks(write(tmp_path, dump_docks(docks))) == docks
    assert load_docks(write(tmp_path, dump_docks({}))) == {}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("dock: {}", "docks.yaml: its keys are dock, not docks"),
        ("", "it is empty, not docks"),
        ("docks: [a]", "docks.yaml:1:8: docks is not a mapping"),
        ("docks:\n  a: 3", "docks.yaml:2:3: the dock a is not a mapping"),
        ("docks:\n  a: {pose: [1, 2]}", "docks.yaml:2:13: the dock a: pose = [1.0, 2.0] is not a pose; write"),
        ("docks:\n  a: {pose: [1, 2, .nan]}", "docks.yaml:2:13: the dock a: pose = "),
        ("docks:\n  a: {pose: here}", "docks.yaml:2:13: the dock a: pose = 'here'"),
        ("docks:\n  a: {frame: map}", "docks.yaml:2:3: the dock a: pose is missing; write pose"),
        (
            "docks:\n  a: {pose: [1, 2, 3], typ: x}",
            "docks.yaml:2:24: the dock a: typ = 'x': unknown key; did you mean type?",
        ),
        ("docks: {a: {pose: [1, 2, 3", "docks.yaml:"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_docks(write(tmp_path, text))
    assert said in caught.value.message


def configuration(**server: object):  # type: ignore[no-untyped-def]
    return load_configuration(["turtlebot", {"docking_server": server}])


def test_docks_of_the_parameters_and_of_a_file(tmp_path: Path) -> None:
    made = DockDatabase.of(configuration(docks=["home"], home={"pose": [1.0, 2.0, 7.0]}))
    assert made.dock("home").pose.yaw == pytest.approx(7.0 - 6.283185307)
    write(tmp_path, NAV2)
    (tmp_path / "docking.yaml").write_text("docking_server:\n  ros__parameters:\n    dock_database: docks.yaml\n")
    found = DockDatabase.of(load_configuration(["turtlebot", str(tmp_path / "docking.yaml")]))
    assert list(found.docks) == ["home_dock", "flex_dock1"]
    with pytest.raises(DockNotInDatabaseError, match='did you mean "home_dock"') as caught:
        found.dock("home_doc")
    assert caught.value.code == 901
    with pytest.raises(InputError, match="both docks and dock_database"):
        DockDatabase.of(configuration(docks=["home"], home={"pose": [1.0, 2.0, 0.0]}, dock_database="docks.yaml"))
    with pytest.raises(InputError, match="pose is required"):
        DockDatabase.of(configuration(docks=["home"]))


def test_types_of_docks_by_name() -> None:
    server = {
        "dock_plugins": ["charger", "shelf"],
        "charger": {"plugin": "opennav_docking::SimpleChargingDock", "filter_coef": 0.5},
        "shelf": {"plugin": "opennav_docking::SimpleNonChargingDock"},
    }
    database = DockDatabase.of(configuration(**server))
    charger = database.type_named("charger")
    assert isinstance(charger, SimpleChargingDock)
    assert charger.params.filter_coef == 0.5
    assert isinstance(database.type_of(Dock("x", "shelf", Pose2D(0.0, 0.0))), SimpleNonChargingDock)
    with pytest.raises(DockNotValidError, match="has no type; name one of dock_plugins: charger, shelf") as caught:
        database.type_of(Dock("x", "", Pose2D(0.0, 0.0)))
    assert caught.value.code == 902


@pytest.mark.parametrize(
    ("server", "said"),
    [
        ({"controller": {"slowdown_radios": 1.0}}, "slowdown_radius"),
        ({"controller": {"v_linear_min": 0.5}}, "v_linear_min = 0.5 is greater than v_linear_max = 0.25; lower it"),
        ({"dock_plugins": []}, "dock_plugins is empty"),
        ({"simple_charging_dock": {"plugin": "opennav_docking::SimpelChargingDock"}}, "SimpleChargingDock"),
        ({"simple_charging_dock": {"filter_coef": 2.0}}, "filter_coef = 2 is out of range"),
        ({"simple_charging_dock": {"detector": {"plugin": "v_reflctor"}}}, 'did you mean "v_reflector"'),
        ({"max_retries": -1}, "max_retries = -1"),
    ],
)
def test_wrong_parameters_are_reported(server: dict[str, object], said: str) -> None:
    try:
        found = configuration(**server).findings
        text = "\n".join(f.message for f in found if f.severity == "warning")
    except InputError as exc:
        text = exc.message
    assert said in text
