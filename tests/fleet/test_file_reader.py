"""Fleet files: what they say, and the messages for what is wrong, with file, line and column."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core import ScenarioError
from navstack.fleet import check_fleet, is_fleet_file, load_fleet, shipped_fleets
from navstack.scenario import read_scenario

GOOD = """\
map: office
seed: 4
time_limit: 50
set: {DWAPlannerROS/max_vel_x: 0.4}
robots:
  - {name: b, start: corridor_west, goals: [office_2, [16.9, 9.6, 1.57]], priority: 2}
  - {name: a, start: corridor_east, goals: [], params: turtlebot_rpp, set: {}, time_limit: 20}
faults:
  - {time: 3, robot: b, kind: pushed, by: [0.1, 0.0, 0.2]}
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "fleet.yaml"
    file.write_text(text)
    return file


def messages(folder: Path, text: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        load_fleet(write(folder, text))
    return str(caught.value).replace(f"{folder}/", "").splitlines()[1:]


def test_a_fleet_is_read(tmp_path: Path) -> None:
    fleet = load_fleet(write(tmp_path, GOOD))
    b, a = fleet.robots
    assert (a.name, b.name, b.priority, fleet.seed) == ("a", "b", 2.0, 4)
    assert [len(robot.scenario.goals) for robot in (a, b)] == [0, 2]
    assert [robot.scenario.time_limit_s for robot in (a, b)] == [20.0, 50.0]
    assert a.scenario.map is b.scenario.map
    assert a.seed != b.seed
    assert fleet.faults[0].by == [0.1, 0.0, 0.2]
    assert load_fleet(write(tmp_path, GOOD), seed=9).robots[0].seed != b.seed


def test_what_is_wrong_is_said_with_its_place(tmp_path: Path) -> None:
    assert messages(tmp_path, GOOD.replace("name: a", "name: b")) == [
        'fleet.yaml:7:5: two robots have the name "b"; give each its own'
    ]
    assert messages(tmp_path, GOOD.replace("priority: 2", "prioritty: 2")) == [
        'fleet.yaml:6:75: robot 1 has no key "prioritty"; did you mean priority?'
    ]
    assert messages(tmp_path, GOOD.replace("corridor_east", "corridor_eastt")) == [
        'fleet.yaml:7:22: start "corridor_eastt" is not a known place; did you mean corridor_east?'
    ]
    assert messages(tmp_path, GOOD.replace("map: office", "map: offic")) == [
        'fleet.yaml:1:6: map "offic" is neither a file, relative to this file, nor a packaged map; did you mean "office"?',
        *(
            f'fleet.yaml:{line}: {name} "{place}" is the name of a place, but this scenario has no places; '
            "write [x, y, yaw]"
            for line, name, place in (
                ("6:22", "start", "corridor_west"),
                ("6:45", "goal 1", "office_2"),
                ("7:22", "start", "corridor_east"),
            )
        ),
    ]
    (fault,) = messages(tmp_path, GOOD.replace("kind: pushed", "kind: burns"))
    assert fault.startswith(
        "fleet.yaml:9:5: fault 1 has no known kind (dies, lost, pushed, silent); write for example {time:"
    )
    assert messages(tmp_path, GOOD.replace("robot: b, kind", "robot: c, kind")) == [
        'fleet.yaml:9:5: fault 1: there is no robot "c"; robots: b, a'
    ]


def test_robots_must_fit_where_they_start(tmp_path: Path) -> None:
    (wall,) = messages(tmp_path, GOOD.replace("corridor_east", "[22.2, 8.3, 0.0]"))
    assert wall.startswith("fleet.yaml:7:22: the robot at the start (22.2, 8.3, 0) collides with a wall of the map")
    (overlap,) = messages(tmp_path, GOOD.replace("corridor_east", "[1.0, 7.4, 0.0]"))
    assert overlap == "fleet.yaml:7:22: a overlaps b at the start; move one of them"


def test_routes_need_a_graph(tmp_path: Path) -> None:
    (missing,) = messages(tmp_path, GOOD.replace("goals: []", "route: [1]"))
    assert missing == "fleet.yaml:7:5: a has a route, but there is no graph; add `traffic: {graph: FILE.geojson}`"
    text = GOOD + "traffic: {rule: reservations}\n"
    assert messages(tmp_path, text) == ['fleet.yaml:10:17: rule "reservations" is unknown; did you mean reservation?']


def test_a_fleet_is_not_taken_for_a_scenario(tmp_path: Path) -> None:
    file = write(tmp_path, GOOD)
    assert is_fleet_file(file)
    with pytest.raises(ScenarioError, match="describes a fleet of robots; drive it with navstack simulate"):
        read_scenario(file)


@pytest.mark.parametrize("name", sorted(shipped_fleets()))
def test_packaged_fleets_are_without_errors(name: str) -> None:
    assert [f for f in check_fleet(shipped_fleets()[name]) if f.severity != "info"] == []
