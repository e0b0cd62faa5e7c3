"""Invalid input gives one clear message, exit code 2 (1 for a failed goal), no traceback and no partial files."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.cli.app import run

GOOD = {"image": "map.png", "resolution": 0.05, "origin": [0.0, 0.0, 0.0], "negate": 0}
GOOD |= {"occupied_thresh": 0.65, "free_thresh": 0.196}


def write_map(folder: Path, *, drop: str | None = None, **changes: object) -> Path:
    """A walled room of 6 x 4 m, divided by a wall at x = 4 m without a door; unknown beyond x = 5.5 m."""
    pixels = np.full((80, 120), 254, np.uint8)
    pixels[:, 110:] = 205
    pixels[[0, -1], :] = 0
    pixels[:, [0, 80, -1]] = 0
    Image.fromarray(pixels).save(folder / "map.png")
    entries = {k: v for k, v in (GOOD | changes).items() if k != drop}
    text = "".join(f"{k}: {v}\n" for k, v in entries.items())
    path = folder / "map.yaml"
    path.write_text(text)
    return path


class Outcome:
    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


@pytest.fixture
def navstack(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Outcome:
        code = run([str(a) for a in arguments])
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        return Outcome(code, captured.out, captured.err)

    return call


GOOD_PLAN = ("--start", "1,1", "--goal", "3,3")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (None, "map.yaml"),
        ("", "empty"),
        ("- a\n- b\n", "mapping"),
        ("image: [\n", "map.yaml"),
    ],
)
def test_invalid_map_yaml(navstack, tmp_path: Path, content: str | None, match: str) -> None:
    path = tmp_path / "map.yaml"
    if content is not None:
        path.write_text(content)
    outcome = navstack("plan", path, *GOOD_PLAN)
    assert outcome.code == 2
    assert match in outcome.err


@pytest.mark.parametrize("key", ["image", "resolution", "origin"])
def test_map_yaml_without_a_required_key(navstack, tmp_path: Path, key: str) -> None:
    outcome = navstack("plan", write_map(tmp_path, drop=key), *GOOD_PLAN)
    assert outcome.code == 2
    assert key in outcome.err
    assert "map.yaml" in outcome.err


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("resolution", 0, 2),
        ("resolution", ".nan", 2),
        ("resolution", -0.05, 2),
        ("resolution", "fine", 2),
        ("image", "absent.png", 1),
        ("origin", "[0, 0]", 3),
    ],
)
def test_map_yaml_with_a_bad_value_names_the_line(navstack, tmp_path: Path, key: str, value: object, line: int) -> None:
    outcome = navstack("plan", write_map(tmp_path, **{key: value}), *GOOD_PLAN)
    assert outcome.code == 2
    assert f"map.yaml:{line}" in outcome.err
    assert key in outcome.err


def test_corrupt_image(navstack, tmp_path: Path) -> None:
    path = write_map(tmp_path)
    (tmp_path / "map.png").write_bytes(b"\x89PNG\r\n\x1a\n but not one")
    outcome = navstack("plan", path, *GOOD_PLAN)
    assert outcome.code == 2
    assert "map.png" in outcome.err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "goal", "words", "name"),
    [
        ("50,1", "3,3", "start", "START_OUTSIDE_MAP"),
        ("1,1", "3,-7", "goal", "GOAL_OUTSIDE_MAP"),
        ("1,1", "4.02,2", "goal", "GOAL_OCCUPIED"),
        ("4.02,2", "1,1", "start", "START_OCCUPIED"),
        ("1,1", "5.6,2", "unknown", "GOAL_OCCUPIED"),
        ("nan,1", "3,3", "--start", "INVALID_INPUT"),
        ("1,1", "3,inf", "--goal", "INVALID_INPUT"),
        ("1;1", "3,3", "--start", "INVALID_INPUT"),
        ("1,1,0,0", "3,3", "--start", "INVALID_INPUT"),
        ("1,1", "x,3", "--goal", "INVALID_INPUT"),
    ],
)
def test_bad_poses(navstack, tmp_path: Path, start: str, goal: str, words: str, name: str) -> None:
    arguments = ("plan", write_map(tmp_path), "--start", start, "--goal", goal)
    outcome = navstack(*arguments)
    assert outcome.code == 2
    assert words in outcome.err
    as_json = navstack(*arguments, "--json")
    document = json.loads(as_json.out)
    assert document["error"]["name"] == name
    assert document["error"]["message"]


@pytest.mark.slow
def test_no_path_is_a_failed_goal(navstack, tmp_path: Path) -> None:
    path = write_map(tmp_path)
    outcome = navstack("plan", path, "--start", "1,1", "--goal", "5,2", "--json", "--out", tmp_path / "out")
    assert outcome.code == 1
    assert json.loads(outcome.out)["error"]["name"] == "NO_VALID_PATH"
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["plan.png"]  # shows the reason


@pytest.mark.slow
def test_simulate_an_unreachable_goal(navstack, tmp_path: Path) -> None:
    path = write_map(tmp_path)
    outcome = navstack("simulate", path, "--start", "1,1", "--goal", "5,2", "--out", tmp_path / "out", "--json")
    assert outcome.code == 1
    goal = json.loads(outcome.out)["goals"][0]
    assert goal["state"] == "ABORTED"
    assert goal["text"] == "Failed to find a valid plan. Even after executing recovery behaviors."
    assert goal["error_name"] == "NO_VALID_PATH"
    assert goal["recoveries"] > 0


def test_simulate_from_inside_a_wall(navstack, tmp_path: Path) -> None:
    outcome = navstack("simulate", write_map(tmp_path), "--start", "4.02,2", "--goal", "1,1", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert "collides with an obstacle" in outcome.err
    assert "fits at" in outcome.err
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("base_global_planner=navfn/NavFnROS", "NavfnROS"),
        ("DWAPlannerROS/max_vel_x=fast", "max_vel_x"),
        ("local_costmap/robot_radius=-0.2", "robot_radius"),
        ("local_costmap/footprint=[[0,0],[1,0]]", "footprint"),
        ("global_costmap/plugins=static_layer", "plugins"),
        ("no equals sign", "--set"),
    ],
)
def test_bad_parameters(navstack, tmp_path: Path, override: str, words: str) -> None:
    outcome = navstack("plan", write_map(tmp_path), *GOOD_PLAN, "--set", override)
    assert outcome.code == 2
    assert words in outcome.err


def test_a_misspelt_parameter_is_a_warning(navstack, tmp_path: Path) -> None:
    (tmp_path / "more.yaml").write_text("DWAPlannerROS: {max_vel_xx: 0.4}\n")
    outcome = navstack("check", "turtlebot", str(tmp_path / "more.yaml"), "--json")
    assert outcome.code == 0
    findings = json.loads(outcome.out)["findings"]
    assert any(f["severity"] == "warning" and "max_vel_xx" in f["message"] for f in findings)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "office", "--start", "corridor_wst", "--goal", "kitchen"], "did you mean corridor_west?"),
        (["plan", "office", "--start", "corridor_west", "--goal", "nowhere_at_all"], "places: corridor_west, "),
        (["simulate", "office", "--goal", "kitchn"], "did you mean kitchen?"),
        (["turn", "90", "office", "--start", "kitchn"], "did you mean kitchen?"),
    ],
)
def test_names_of_places_that_do_not_exist(navstack, arguments: list[str], words: str) -> None:
    outcome = navstack(*arguments)
    assert outcome.code == 2 and words in outcome.err


def test_places_are_taken_wherever_a_pose_is(navstack, tmp_path: Path) -> None:
    assert "m " in navstack("plan", "office", "--start", "corridor_west", "--goal", "kitchen").out
    # of a map in a file: the places next to it
    path = write_map(tmp_path)
    start, goal = GOOD_PLAN[GOOD_PLAN.index("--start") + 1], GOOD_PLAN[GOOD_PLAN.index("--goal") + 1]
    assert "no file of places" in navstack("plan", path, "--start", "a", "--goal", goal).err
    places = Path(path).with_suffix(".places.yaml")
    places.write_text(f"a: [{start}, 0]\nb: [{goal}, 0]\n" if start.count(",") == 1 else f"a: [{start}]\nb: [{goal}]\n")
    assert navstack("plan", path, "--start", "a", "--goal", "b").code == navstack("plan", path, *GOOD_PLAN).code == 0


def test_an_override_that_sets_nothing_ends_the_command_with_the_full_names(navstack, tmp_path: Path) -> None:
    outcome = navstack("plan", write_map(tmp_path), *GOOD_PLAN, "--set", "inflation_radius=0.4")
    assert outcome.code == 2 and outcome.out == ""
    assert outcome.err.count("inflation_radius = 0.4 sets nothing") == 1 and "--set argument 1" in outcome.err
    assert "did you mean" not in outcome.err
    names = ("global_costmap/inflation_layer/inflation_radius", "local_costmap/inflation_layer/inflation_radius")
    for name in names:
        assert name in outcome.err
    written = [text for name in names for text in ("--set", f"{name}=0.4")]
    assert navstack("check", "turtlebot", *written).code == 0


def test_several_warnings_are_one_line_with_the_command_that_shows_them(navstack, tmp_path: Path) -> None:
    (tmp_path / "more file.yaml").write_text("DWAPlannerROS: {a: 1}\nlocal_costmap: {b: 1}\n")
    arguments = (
        "plan",
        write_map(tmp_path),
        *GOOD_PLAN,
        "--params",
        "turtlebot",
        "--params",
        str(tmp_path / "more file.yaml"),
    )
    err = navstack(*arguments, "--set", "planner_frequency=1.0").err
    [line] = [text for text in err.splitlines() if "warning" in text]
    assert line.startswith("2 warnings about the parameters; `navstack check turtlebot ")
    command = shlex.split(line.partition("`")[2].partition("`")[0])
    assert command[-2:] == ["--set", "planner_frequency=1.0"]
    assert navstack(*command[1:], "--severity", "warning").out.count(": warning: ") == 2
    assert navstack("--verbose", *arguments).err.count("warning: ") == 2


def test_unknown_packaged_names(navstack) -> None:
    outcome = navstack("simulate", "offic")
    assert outcome.code == 2
    assert "office" in outcome.err
    outcome = navstack("simulate", "--params", "turtlebt")
    assert outcome.code == 2
    assert "turtlebot" in outcome.err


def test_unknown_planner(navstack, tmp_path: Path) -> None:
    outcome = navstack("plan", write_map(tmp_path), *GOOD_PLAN, "--planner", "navfm")
    assert outcome.code == 2
    assert "navfn" in outcome.err


@pytest.mark.parametrize("obstacle", ["1,2", "1,2,0", "1,2,-1", "a,b,c"])
def test_bad_obstacles(navstack, tmp_path: Path, obstacle: str) -> None:
    outcome = navstack("simulate", write_map(tmp_path), "--start", "1,1", "--goal", "2,2", "--obstacle", obstacle)
    assert outcome.code == 2
    assert "--obstacle" in outcome.err


def test_an_output_folder_that_cannot_be_written(navstack, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    outcome = navstack(
        "simulate", write_map(tmp_path), "--start", "1,1", "--goal", "2,2", "--out", tmp_path / "file" / "out"
    )
    assert outcome.code == 2
    assert "--out" in outcome.err


def test_an_output_folder_without_permission(navstack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "locked"
    # root can write anywhere, so the answer of the system is replaced
    monkeypatch.setattr("navstack.core.files.os.access", lambda path, mode: Path(path) != folder)
    outcome = navstack("plan", write_map(tmp_path), *GOOD_PLAN, "--out", folder)
    assert outcome.code == 2
    assert "--out" in outcome.err


def test_invalid_record(navstack, tmp_path: Path) -> None:
    (tmp_path / "run.npz").write_bytes(b"PK\x03\x04 cut short")
    outcome = navstack("plot", tmp_path / "run.npz")
    assert outcome.code == 2
    assert "run.npz" in outcome.err
    outcome = navstack("plot", tmp_path / "absent")
    assert outcome.code == 2


def test_invalid_command_lines(navstack) -> None:
    assert navstack("simulate", "--no-such-option").code == 2
    assert navstack("plan").code == 2
    outcome = navstack("plan", "--json")
    assert json.loads(outcome.out)["error"]["code"] == 9001


@pytest.mark.parametrize(
    "command",
    ["simulate {}", "plan {} --start 1,1 --goal 2,2", "simulate --params {}", "check {}", "plot {}", "tour {}"]
    + ["explain goal {}", "params show {}", "bench barn {} --params turtlebot", "bench compare turtlebot turtlebot {}"],
)
def test_impossible_file_names(navstack, command: str) -> None:
    outcome = navstack(*command.format("a" * 5000).split())
    assert outcome.code == 2
    assert "aaaa" in outcome.out + outcome.err


def test_swapped_x_and_y(navstack, tmp_path: Path) -> None:
    path = write_map(tmp_path)  # 6 x 4 m
    outcome = navstack("plan", path, "--start", "1,1", "--goal", "3,5")
    assert outcome.code == 2
    assert "the goal 3,5 is outside the map, which covers x 0 .. 6, y 0 .. 4 m; are x and y swapped? 5,3 is inside" in (
        outcome.err
    )
    assert "swapped" not in navstack("plan", path, "--start", "1,1", "--goal", "30,50").err


def test_missing_start_and_goal(navstack, tmp_path: Path) -> None:
    outcome = navstack("simulate", write_map(tmp_path))
    assert outcome.code == 2
    assert "give --start x,y[,yaw] and --goal x,y[,yaw] (m, rad); the map covers x 0 .. 6, y 0 .. 4 m" in outcome.err


def test_misspelt_scenario(navstack) -> None:
    outcome = navstack("simulate", "narow_door")
    assert outcome.code == 2
    assert 'did you mean "narrow_door"?' in outcome.err
    # plan takes no scenario, so it suggests none
    assert "narrow_door" not in navstack("plan", "narow_door", *GOOD_PLAN).err


def test_plan_skips_missing_plugins_only_with_allow_missing(navstack, tmp_path: Path) -> None:
    path = write_map(tmp_path)
    extra = "global_costmap/plugins=[{name: static_layer, type: 'costmap_2d::StaticLayer'}, {name: x, type: 'my::Own'}]"
    assert navstack("plan", path, *GOOD_PLAN, "--set", extra).code == 2
    outcome = navstack("plan", path, *GOOD_PLAN, "--set", extra, "--allow-missing")
    assert outcome.code == 0
    assert "my::Own" in outcome.err


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("map: office\nstart: [0.8, 7.45\ngoals: [[2, 7.45]]\n", "3:6: invalid YAML"),
        ("map: office\n\tstart: [0.8, 7.45]\n", "2:1: the line contains a tab"),
        ("start: [0.8, 7.45]\ngaols: [[2, 7.45]]\n", 'a.yaml:2:1: a scenario has no key "gaols"; did you mean goals?'),
        ("", "a.yaml:1:1: map is missing"),
        (
            "map: office\nstart: [0.16, 7.45]\ngoals: [[2, 7.45]]\n",
            "a.yaml:2:8: the robot at the start",
        ),
        ("map: office\nstart: [0.8, 7.45]\ngoals: [" + "[2, 7.45]," * 120_000 + "]\n", "larger than 1 MB"),
    ],
)
def test_errors_of_a_scenario_file(navstack, text: str, match: str) -> None:
    Path("a.yaml").write_text(text)
    outcome = navstack("simulate", "a.yaml", "--out", "out")
    assert outcome.code == 2
    assert match in outcome.err
    assert not Path("out").exists()


def test_a_large_map_yaml_is_refused(navstack) -> None:
    Path("map.yaml").write_text("image: map.png\norigin: [" + "[2, 7.45]," * 120_000 + "]\n")
    outcome = navstack("plan", "map.yaml", *GOOD_PLAN)
    assert outcome.code == 2
    assert "larger than 100 kB" in outcome.err


def test_out_of_memory(navstack, monkeypatch: pytest.MonkeyPatch) -> None:
    def allocate(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 671. GiB")

    monkeypatch.setattr("navstack.cli.simulate.warm_up", allocate)
    outcome = navstack("simulate", "--out", "out")
    assert outcome.code == 2
    assert "out of memory: Unable to allocate 671. GiB" in outcome.err


def test_a_heading_in_degrees(navstack) -> None:
    poses = ("plan", "office", "--start", "0.8,7.45", "--goal")
    degrees, radians = navstack(*poses, "3,7.45,90deg", "--json"), navstack(*poses, f"3,7.45,{np.pi / 2.0!r}", "--json")
    assert json.loads(degrees.out)["poses"] == json.loads(radians.out)["poses"]
    assert "radians" not in degrees.err
    assert "the yaw 90 is taken as radians; for degrees, write 90deg" in navstack(*poses, "3,7.45,90").err
    wrong = navstack(*poses, "3,7.45,ndeg")
    assert wrong.code == 2 and "write 90deg" in wrong.err
