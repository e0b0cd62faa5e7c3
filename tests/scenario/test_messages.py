"""Messages for invalid scenario files: file, line, column, value and fix."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from navstack.core import ScenarioError
from navstack.scenario import check_scenario, load_scenario, read_scenario
from navstack.scenario.file_reader import scenarios_in

GOOD = "map: office\nstart: corridor_west\ngoals: [office_2]\n"

KEYS = (
    "name, description, distro, allow_missing, seed, time_limit, pause, stop_on_failure, pass_through, map, places, params, set, "
    "sim, start, goals, tour, shapes, interactions, low_battery, success"
)
POSE = "[x, y], [x, y, yaw] (m, rad) or the name of a place"
PLACES = (
    "corridor_west, corridor_middle, corridor_east, office_1, office_2, office_3, meeting_room, laboratory, open_plan, manager, "
    "stores, kitchen, lounge"
)

CASES = {
    # what the file says -> line:column and the message; several in the order of the file
    "nothing": (
        "",
        f"1:1: goals are missing; add `goals: [..]`, a list of {POSE}",
        "1:1: map is missing; add `map: FILE.yaml`, relative to this file, or a packaged map (clinic, maze, office, warehouse)",
        f"1:1: start is missing; add `start: {POSE}`",
    ),
    "not yaml": (
        "map: office\nstart: [0.8, 7.4\n",
        (
            "3:1: invalid YAML: while parsing a flow sequence did not find expected ',' or ']'; check indentation, colons and "
            "brackets of this line and the one above"
        ),
    ),
    "a tab": (
        "map: office\nset:\n\tx: 1\n",
        "3:1: the line contains a tab, which YAML does not allow; replace its tabs by spaces",
    ),
    "misspelt key": (GOOD + "sede: 3\n", '4:1: a scenario has no key "sede"; did you mean seed?'),
    "other word": (GOOD + "obstacles: []\n", '4:1: a scenario has no key "obstacles"; did you mean shapes?'),
    "a tour of nothing": (
        "map: office\nstart: corridor_west\ntour: {places: []}\n",
        "3:16: the tour lists no places; list some, or omit `places:` to visit all places of the map",
    ),
    "two places of a tour misspelt": (
        "map: office\nstart: corridor_west\ntour: [office_22, office_2, kitchn]\n",
        '3:8: place "office_22" is not a known place; did you mean office_2?',
        '3:29: place "kitchn" is not a known place; did you mean kitchen?',
    ),
    "one of two goals misspelt": (
        "map: office\nstart: corridor_west\ngoals: [kitchn, office_2]\nsuccess: {goals: [SUCCEEDED, ABORTED]}\n",
        '3:9: goal 1 "kitchn" is not a known place; did you mean kitchen?',
    ),
    "foreign key": (GOOD + "color: red\n", f'4:1: a scenario has no key "color"; known keys: {KEYS}'),
    "key twice": (
        GOOD + "seed: 1\nseed: 2\n",
        "5:1: seed is set twice (first on line 4), and the second value is used; remove one of them",
    ),
    "map misspelt": (
        GOOD.replace("office\n", "offise\n"),
        '1:6: map "offise" is neither a file, relative to this file, nor a packaged map; did you mean "office"?',
        '2:8: start "corridor_west" is the name of a place, but this scenario has no places; write [x, y, yaw]',
        '3:9: goal 1 "office_2" is the name of a place, but this scenario has no places; write [x, y, yaw]',
    ),
    "map is a list": (
        "map: [office]\nstart: [1, 1]\ngoals: [[2, 2]]\n",
        "1:6: map is a list; write the file of a map, relative to this file, or a packaged map (clinic, maze, office, warehouse)",
    ),
    "place misspelt": (
        GOOD.replace("office_2", "ofice_2"),
        '3:9: goal 1 "ofice_2" is not a known place; did you mean office_2?',
    ),
    "no place": (GOOD.replace("office_2", "roof"), f'3:9: goal 1 "roof" is not a known place; known places: {PLACES}'),
    "start is a number": (GOOD.replace("corridor_west", "7"), f"2:8: start is 7, a number; write {POSE}"),
    "pose of one number": (
        GOOD.replace("corridor_west", "[7]"),
        "2:8: start has 1 number; give [x, y, yaw], {x, y, yaw} or {position: {x, y}, orientation: {x, y, z, w}}",
    ),
    "pose with a word": (
        GOOD.replace("corridor_west", "[7, east]"),
        '2:12: y of start must be a finite number, not "east"',
    ),
    "one pose as goals": (
        GOOD.replace("[office_2]", "[6.2, 12, 1.57]"),
        "3:8: goals = [6.2, 12, 1.57] is a single pose, not a list of poses; write goals: [[6.2, 12, 1.57]]",
    ),
    "empty goals": (GOOD.replace("[office_2]", "[]"), f"3:8: goals is empty; write a list of {POSE}"),
    "goals are a text": (
        GOOD.replace("[office_2]", "office_2"),
        f'3:8: goals is the text "office_2"; write a list of {POSE}',
    ),
    "goals and tour": (
        GOOD + "tour: {loops: 2}\n",
        "4:1: the scenario has both goals and a tour; remove one of them",
    ),
    "tour order": (
        "map: office\nstart: lounge\ntour: {order: sortd}\n",
        '3:15: order = "sortd" is not a valid value; write "given" or "sorted" or "random"',
    ),
    "tour place": (
        "map: office\nstart: lounge\ntour: [kitchen, kitchn]\n",
        '3:17: place "kitchn" is not a known place; did you mean kitchen?',
    ),
    "params misspelt": (
        GOOD + "params: turtlebott\n",
        (
            '4:9: params "turtlebott" is neither a file or folder, relative to this file, nor a packaged set; did you mean '
            '"turtlebot"?'
        ),
    ),
    "params missing": (
        GOOD + "params: [turtlebot, mine.yaml]\n",
        (
            '4:21: params "mine.yaml" is neither a file or folder, relative to this file, nor a packaged set; packaged sets: '
            "car_mppi, car_rpp, jackal_dwa, jackal_graceful, jackal_mppi, jackal_rollout, jackal_rpp, jackal_shim, "
            "nav2_turtlebot, omni_dwa, omni_mppi, turtlebot, turtlebot_dwb, turtlebot_graceful, turtlebot_mppi, "
            "turtlebot_rollout, turtlebot_rpp, turtlebot_shim"
        ),
    ),
    "set is a list": (
        GOOD + "set: [a=1]\n",
        "4:6: set is a list; write `NAME: VALUE` lines, for example `DWAPlannerROS/max_vel_x: 0.4`",
    ),
    "seed with a fraction": (GOOD + "seed: 1.5\n", "4:7: seed = 1.5 is a number; write an integer"),
    "seed below 0": (
        GOOD + "seed: -1\n",
        "4:7: seed = -1 is out of range; it must be at least 0 and at most 9.22337e+18",
    ),
    "time limit 0": (
        GOOD + "time_limit: 0\n",
        "4:13: time_limit = 0 is out of range; it must be greater than 0 and at most 1e+06 s",
    ),
    "pause in words": (GOOD + "pause: soon\n", '4:8: pause = "soon" is text; write a number (s)'),
    "a truth value in quotes": (
        GOOD + "stop_on_failure: 'yes'\n",
        '4:18: stop_on_failure = "yes" is text; write true or false',
    ),
    "distro": (GOOD + "distro: humble\n", '4:9: distro = "humble" is not a valid value; write "noetic" or "indigo"'),
    "success misspelt": (
        GOOD + "success: {max_tim: 9}\n",
        '4:11: success has no key "max_tim"; did you mean max_time?',
    ),
    "success of a state": (
        GOOD + "success: {goals: REACHED}\n",
        '4:18: "REACHED" is not a terminal goal state; use SUCCEEDED, ABORTED, PREEMPTED, REJECTED, RECALLED, LOST or any',
    ),
    "success of too many": (
        GOOD + "success: {goals: [ABORTED, SUCCEEDED]}\n",
        "4:18: success lists 2 states for 1 goal; list one state per goal, or give a single state for all",
    ),
    "success below 0": (
        GOOD + "success: {min_clearance: -0.1}\n",
        "4:26: min_clearance = -0.1 is out of range; it must be at least 0 m",
    ),
    "success is a text": (
        GOOD + "success: reached\n",
        '4:10: success is the text "reached"; write conditions indented below it, for example `max_time: 60`',
    ),
    "shapes is a mapping": (
        GOOD + "shapes: {radius: 1}\n",
        "4:9: shapes is a mapping; write a list, for example {radius: 0.2, pose: [3.0, 1.5]}",
    ),
    "shape without a look": (
        GOOD + "shapes:\n  - {pose: [3, 7]}\n",
        "5:5: a shape has exactly one of radius, box, polygon and segment; it has none",
    ),
    "shape with a foreign key": (
        GOOD + "shapes:\n  - {radius: 0.2, at: [3, 7]}\n",
        '5:19: shape 1 has no key "at"; did you mean pose?',
    ),
    "radius below 0": (
        GOOD + "shapes:\n  - {radius: -0.2, pose: [3, 7]}\n",
        "5:14: radius = -0.2 is out of range; it must be greater than 0 m",
    ),
    "polygon that crosses itself": (
        GOOD + "shapes:\n  - {polygon: [[0, 0], [1, 1], [1, 0], [0, 1]]}\n",
        "5:15: the polygon intersects or touches itself, or has no area; list its corners in order around it",
    ),
    "motion of no kind": (
        GOOD + "shapes:\n  - {radius: 0.2, motion: {speed: 1}}\n",
        "5:27: the motion of shape 1 has no kind; add `kind:`, one of still, track, door, pedestrian, replay",
    ),
    "motion of a wrong kind": (
        GOOD + "shapes:\n  - {radius: 0.2, motion: {kind: trak}}\n",
        '5:34: the motion of shape 1 has the unknown kind "trak"; did you mean track?',
    ),
    "track without points": (
        GOOD + "shapes:\n  - {radius: 0.2, motion: {kind: track}}\n",
        "5:27: points is required; add `points: ...`",
    ),
    "door that closes first": (
        GOOD + "shapes:\n  - {segment: [[0, 0], [1, 0]], motion: {kind: door, open: [[5, 2]]}}\n",
        "5:60: open = [5, 2] is not a time span; give [from, to] in s with 0 <= from < to",
    ),
    "box that walks": (
        GOOD + "shapes:\n  - {box: [1, 1], motion: {kind: pedestrian, goals: [[1, 1]]}}\n",
        "5:5: a pedestrian is a disc; give it a radius (typically 0.25 m)",
    ),
    "start in a wall": (
        GOOD.replace("corridor_west", "[-0.05, 3.0]"),
        "2:8: the start (-0.05, 3) is in a wall of the map; move it",
    ),
    "start at a wall": (
        GOOD.replace("corridor_west", "[0.16, 7.45]"),
        (
            "2:8: the robot at the start (0.16, 7.45, 0) collides with a wall of the map at "
            "(-0.02, 7.33); move the start"
        ),
    ),
    "start at a shape": (
        GOOD + "shapes:\n  - {name: cart, box: [0.5, 0.5], pose: [1.2, 7.6, 0.7]}\n",
        '2:8: the robot at the start (0.8, 7.45, 0) collides with shape 1 "cart"; move the start',
    ),
    "start outside": (
        GOOD.replace("corridor_west", "[-40, 9]"),
        "2:8: the start (-40, 9) is outside the map, which covers x -0.5 .. 23.5, y -0.5 .. 15.5 m; move it",
    ),
    "noise out of range": (
        GOOD + "sim: {wheel_slip: -1}\n",
        "4:19: wheel_slip = -1 is out of range; it must be at least 0 and at most 1",
    ),
    "a control cycle in thirty years": (
        GOOD + "set: {controller_frequency: 1e-9}\n",
        (
            "4:29: controller_frequency = 1e-09 Hz gives one control cycle in 1e+09 s, so goals do not end; set it to "
            "0.001 Hz or more"
        ),
    ),
    "parameter of a wrong type": (
        GOOD + "set: {controller_frequency: fast}\n",
        '4:29: controller_frequency = "fast" is text (ROS ignores it and uses 20); write a number (Hz)',
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_an_error_names_location_value_and_fix(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text, *wanted = CASES[name]
    Path("wrong.yaml").write_text(text, encoding="utf-8")
    found = [f for f in check_scenario("wrong.yaml") if f.severity == "error"]
    assert [f"{f.line}:{f.column}: {f.message}" for f in found] == wanted
    assert {f.file for f in found} == {"wrong.yaml"}


def test_all_errors_are_in_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("wrong.yaml").write_text(GOOD + "sede: 3\npause: soon\n", encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_scenario("wrong.yaml")
    assert caught.value.message == (
        "invalid scenario (2 errors):\n"
        'wrong.yaml:4:1: a scenario has no key "sede"; did you mean seed?\n'
        'wrong.yaml:5:8: pause = "soon" is text; write a number (s)'
    )
    assert [f["suggestion"] for f in caught.value.data["findings"]] == ["seed", None]


@pytest.mark.parametrize("name", ["missing.yaml", "."])
def test_a_file_that_does_not_exist(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError, match=r"cannot be read|is not a file"):
        read_scenario(name)


@pytest.mark.parametrize("key", ["map", "params", "places"])
def test_a_name_too_long_for_a_file(key: str, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    lines = {"map": "office", "start": "corridor_west", "goals": "[office_2]", key: "a" * 5000}
    file.write_text("".join(f"{k}: {v}\n" for k, v in lines.items()), encoding="utf-8")
    found = next(f for f in check_scenario(file) if f.key == key)
    assert found.message.startswith(("map", "params", "file"))
    assert found.column == len(key) + 3


def test_a_warning_about_parameters_has_the_location_in_the_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(GOOD + "set: {DWAPlannerROS/max_vel_xx: 1}\n", encoding="utf-8")
    (found,) = (f for f in check_scenario("a.yaml") if f.severity == "warning")
    assert str(found) == (
        "a.yaml:4:7: warning: max_vel_xx = 1 is not a parameter of DWAPlannerROS and has no effect; did you mean max_vel_x?"
    )


def test_an_unreachable_goal_is_a_warning_unless_expected(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    text = GOOD.replace("[office_2]", "[[-40, 9]]")
    file.write_text(text, encoding="utf-8")
    (found,) = (f for f in check_scenario(file) if f.severity == "warning")
    assert found.message == (
        "goal 1 (-40, 9) is outside the map, which covers x -0.5 .. 23.5, y -0.5 .. 15.5 m and cannot be reached; move "
        "it, or expect ABORTED under `success: goals:`"
    )
    file.write_text(text + "success: {goals: ABORTED}\n", encoding="utf-8")
    assert not [f for f in check_scenario(file) if f.severity == "warning"]


def test_positions_on_a_rotated_map(tmp_path: Path) -> None:
    image = Image.new("L", (40, 20), 254)
    image.putpixel((30, 5), 0)  # cell ix 30, iy 14
    image.save(tmp_path / "turned.png")
    (tmp_path / "turned.yaml").write_text(
        "image: turned.png\nresolution: 0.1\norigin: [5.0, 5.0, 1.5707963]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\n",
        encoding="utf-8",
    )
    file = tmp_path / "a.yaml"

    def found(x: float, y: float) -> list[str]:
        file.write_text(f"map: turned.yaml\nstart: [{x}, {y}]\ngoals: [[4.0, 6.0]]\n", encoding="utf-8")
        return [f.message for f in check_scenario(file) if f.rule == "start"]

    assert found(4.0, 6.0) == []
    (outside,) = found(6.0, 6.0)  # inside if the map were not rotated
    assert "is outside the map" in outside and "rotated by 1.5708 rad" in outside
    (wall,) = found(5.0 - 1.45, 5.0 + 3.05)
    assert "is in a wall of the map" in wall


def test_the_scenarios_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "b.yml").write_text(GOOD, encoding="utf-8")
    (tmp_path / "a.yaml").write_text(GOOD, encoding="utf-8")
    (tmp_path / "map.yaml").write_text("image: map.png\nresolution: 0.1\n", encoding="utf-8")
    (tmp_path / "notes.txt").write_text(GOOD, encoding="utf-8")
    (tmp_path / "folder.yaml").mkdir()
    assert [spec.name for spec in scenarios_in(tmp_path)] == ["a", "b"]
    (tmp_path / "c.yaml").write_text(GOOD + "goals: [\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"c\.yaml:5:1: invalid YAML"):
        scenarios_in(tmp_path)
