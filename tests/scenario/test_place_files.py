"""Places of CSV and GeoJSON files, tours that begin later or pass their goals."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.core import InputError, Pose2D
from navstack.scenario import Scenario, drive_tour, load_places
from tests.scenario.places_stage import office_scenario


def test_csv(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("x, y, yaw\n# the first\n1.0, 2.0\n3,4,1.5\n\n5,6,-1.5,dock\n")
    places = load_places(file)
    assert places.places == {"1": Pose2D(1.0, 2.0), "2": Pose2D(3.0, 4.0, 1.5), "dock": Pose2D(5.0, 6.0, -1.5)}
    assert places.goal_names == ("1", "2", "dock")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3\n", "a.csv:2:1: the line has 1 value; write x,y,yaw"),
        ("1,two\n", 'a.csv:1:3: y is "two"; write a finite number'),
        ("1,2,nan\n", 'a.csv:1:5: yaw is "nan"; write a finite number'),
        ("1,2,0,a\n1,2,0,a\n", 'a.csv:2:1: the place "a" is there twice'),
        ("x,y\n", "the file has no places; write a line x,y,yaw"),
    ],
)
def test_csv_with_mistakes(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as error:
        load_places(tmp_path / "a.csv")
    assert message in error.value.message


def point(x: float, **properties: object) -> dict[str, object]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": "Point", "coordinates": [x, 1.0]}}


def test_geojson(tmp_path: Path) -> None:
    line = {"type": "Feature", "properties": {"id": 3}, "geometry": {"type": "LineString", "coordinates": []}}
    file = tmp_path / "a.geojson"
    file.write_text(json.dumps({"features": [point(1.0, name="desk", yaw=7.0), line, point(2.0, id=9), point(3.0)]}))
    places = load_places(file)
    assert list(places.places) == ["desk", "9", "3"]
    assert places.places["desk"].yaw == pytest.approx(7.0 - 2.0 * math.pi)
    for features, message in (
        ([], "there are no points"),
        ([point(1.0), point(2.0, name="0")], "the name 0 is that of another point"),
    ):
        file.write_text(json.dumps({"features": features}))
        with pytest.raises(InputError, match=message):
            load_places(file)


@pytest.mark.slow
def test_goals_are_passed_without_a_stop() -> None:
    goals = (Pose2D(3.0, 7.5), Pose2D(5.0, 7.5), Pose2D(7.0, 7.5))
    results = {}
    for through in (False, True):
        scenario: Scenario = office_scenario(goals, pass_through=through)
        results[through] = drive_tour(scenario, ("a", "b", "c"))
    stopped, passed = results[False], results[True]
    assert stopped.succeeded
    assert passed.succeeded
    assert [goal.state for goal in passed.run.goals] == ["SUCCEEDED"] * 3
    assert passed.run.goals[0].text == "passed within 0.7 m without a stop"
    assert passed.run.goals[-1].text == "Goal reached."
    assert passed.run.simulated_s < stopped.run.simulated_s - 2.0


@pytest.mark.slow
def test_a_tour_of_a_csv_file_from_the_second_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("9.0,7.5\n3.0,7.5\n4.5,7.5\n")
    arguments = ["tour", str(tmp_path / "a.csv"), "office", "--start", "1.5,7.5", "--goal-index", "1", "--through"]
    assert run([*arguments, "--out", str(tmp_path / "out"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [goal["place"] for goal in document["goals"]] == ["2", "3"]
    assert run([*arguments[:-2], "3"]) == 2
    assert "--goal-index 3: the tour has the goals 0 to 2" in capsys.readouterr().err
