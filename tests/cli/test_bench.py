"""`navstack bench`: tables do not depend on the number of processes or on interruptions, stdout has only JSON, and invalid
input gives one message."""

from __future__ import annotations

import csv
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from navstack.cli.app import run
from navstack.studies import Column, JobResult, Table, read_reference, read_scenarios
from navstack.studies.comparison import Pair
from navstack.studies.parameter_sets import measures_table, scenarios_table
from navstack.studies.speed import speed_tables


@pytest.fixture
def navstack(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object, code: int = 0) -> Any:
        got = run([str(a) for a in arguments])
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        assert got == code, captured.err
        if "--json" in arguments:
            return json.loads(captured.out)
        return captured.out if code == 0 else captured.err

    return call


@pytest.fixture
def jackal(data_dir: Path) -> Path:
    folder = data_dir / "params" / "jackal_barn"
    if not folder.is_dir():
        pytest.skip("no parameters of the Jackal here")
    return folder


@pytest.fixture
def fields(tmp_path: Path) -> Path:
    """Three BARN worlds with few cylinders; in the last, a ring of cylinders encloses the robot."""
    folder = tmp_path / "barn"
    folder.mkdir()
    ring = [(0.8 * math.cos(a) - 2.25, 0.8 * math.sin(a) + 3.0) for a in np.linspace(0.0, 2.0 * math.pi, 48)]
    discs = [(1.0, 8.0), (-4.0, 8.0), (-4.0, 7.0), *ring]
    np.savez(
        folder / "worlds.npz",
        world=np.array([3, 8, 9]),
        cyl_xy=np.array(discs),
        cyl_offset=np.array([0, 1, 3, len(discs)]),
        cyl_radius=0.075,
        optimal_length_m=np.array([10.0, 10.5, 10.2]),
    )
    with (folder / "cpp_results.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["world", "outcome", "AT", "length", "clearance", "score"])
        table.writerow([3, "success", 20.0, 9.3, 0.4, 0.25])
        table.writerow([8, "timeout", 100.0, 3.1, 0.3, 0.0])
    return folder


FAST = ("controller_patience=0.5", "planner_patience=0.5", "recovery_behavior_enabled=false",
        "controller_frequency=10.0", "TrajectoryPlannerROS/max_vel_x=2.0")  # fmt: skip
QUICK = tuple(word for setting in FAST for word in ("--set", setting))
"""Settings with which a run of a Jackal ends early, with or without success."""


@pytest.mark.slow
def test_barn_killed_and_resumed_by_one_process_equals_a_run_by_two(
    navstack, jackal: Path, fields: Path, tmp_path: Path
) -> None:
    command = ("bench", "barn", fields, "--params", jackal, *QUICK, "--noise", 0.002, "--seeds", 2, "--worlds", "9,8")
    # killed after the first of four results
    command_line = [sys.executable, "-m", "navstack", *(str(a) for a in command), "--processes", "1", "--out", "one"]
    results = tmp_path / "one" / "results.jsonl"
    process = subprocess.Popen(command_line, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while process.poll() is None and not (results.exists() and results.read_bytes().count(b"\n") >= 2):
            pass
    finally:
        process.kill()
        process.wait()
    assert 2 <= len(results.read_text().splitlines()) < 1 + 4
    assert "--resume" in navstack(*command, "--out", "one", code=2)
    message = navstack(*command, "--noise", 0.01, "--out", "one", "--resume", code=2)
    assert "noise_m was 0.002, now it is 0.01" in message

    one = navstack(*command, "--processes", 1, "--out", "one", "--resume", "--json")
    text = navstack(*command, "--processes", 2, "--out", "two")
    assert "navstack minus C++" in text and "two/success.png" in text
    for name in ("results.jsonl", "barn.md", "success.png", "times.png"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert [row["world"] for row in one["worlds"]] == [9, 8]
    assert [row["success"] for row in one["worlds"]] == [0, 2]
    ours, theirs = one["totals"]
    assert ours["runs"] == 4 and ours["success"]["value"] == 0.5 and ours["success"]["low"] < 0.1
    assert theirs["stack"] == "C++" and theirs["runs"] == 1 and theirs["success"]["value"] == 0.0
    assert {r["what"]: r["verdict"] for r in one["against_cpp"]}["success"] == "no difference shown"
    assert [0.3 < r["score"] <= 0.5 for r in one["runs"]] == [False, True, False, True]


@pytest.mark.slow
def test_barn_without_noise_counts_each_world_once_and_records_failures(
    navstack, jackal: Path, fields: Path, tmp_path: Path
) -> None:
    command = ("bench", "barn", fields, "--params", jackal, *QUICK, "--worlds", 9, "--seeds", 2, "--record")
    document = navstack(*command, "--out", "out", "--processes", 1, "--json")
    assert document["worlds"][0]["success"] == 0
    assert document["totals"][0]["score"]["value"] == 0.0
    assert document["against_cpp"] is None
    assert any("all seeds gave the same runs" in note for note in document["notes"])
    assert (tmp_path / "out" / "records" / "world_9_seed_1").is_dir()


def write_problems(folder: Path) -> Path:
    """A room of 8 x 5 cells with a wall that leaves the top row open."""
    (folder / "maps").mkdir(parents=True)
    rows = ["........", "...@....", "...@....", "...@....", "...@...."]
    (folder / "maps" / "room.map").write_text("type octile\nheight 5\nwidth 8\nmap\n" + "\n".join(rows) + "\n")
    lines = ["family\tmap\tsx\tsy\tgx\tgy\toptimal", "own\troom\t0\t4\t2\t4\t2.0", "own\troom\t2\t4\t4\t4\t10.0"]
    (folder / "problems.tsv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.slow
def test_movingai(navstack, tmp_path: Path) -> None:
    folder = write_problems(tmp_path / "movingai")
    document = navstack("bench", "movingai", folder, "--processes", 1, "--json")
    assert set(document["planners"]) == {"astar", "theta_star"}
    row, everything = document["planners"]["astar"]
    assert (row["map"], row["problems"], row["found"], row["optimal"]) == ("room", 2, 2, 2)
    assert everything["map"] == "all"
    text = navstack("bench", "movingai", folder, "--planner", "astar", "--map", "room", "--processes", 1)
    assert text.startswith("astar") and "theta_star" not in text and "room" in text


@pytest.mark.slow
def test_planners(navstack, tmp_path: Path) -> None:
    """The exit code is 1 because carrot_planner follows the straight line and misses a pair or hits a wall."""
    command = ("bench", "planners", "office", "--pairs", 3, "--planner", "navfn/NavfnROS", "--planner", "astar",
               "--planner", "carrot_planner", "--out", "out", "--json")  # fmt: skip
    document = navstack(*command, "--processes", 1, code=1)
    navfn, astar, carrot = document["rows"]
    for row, name in ((navfn, "navfn"), (astar, "astar")):
        assert (row["map"], row["planner"], row["found"], row["in_collision"]) == ("office", name, 3, 0)
        assert row["clearance_m"] > 0.0 and row["p99_ms"] >= row["p50_ms"] > 0.0
    assert carrot["found"] < 3 or carrot["in_collision"] > 0
    assert len(document["plans"]["navfn on office"]) == 3
    assert navstack(*command, "--resume", code=1)["rows"] == document["rows"]


def write_map(file: Path, *, wall: bool = False, image: bool = True) -> Path:
    """A free or fully occupied map of 4 x 4 m."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(
        f"image: {file.stem}.png\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\n"
    )
    if image:
        Image.new("L", (40, 40), 0 if wall else 254).save(file.with_suffix(".png"))
    return file


@pytest.mark.slow
def test_an_unreadable_map_in_a_folder_is_reported_and_skipped(navstack, tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    for name in ("a/x/map.yaml", "b/x/m.yaml", "c/x/m.yml", "d/open.yaml"):
        write_map(folder / name)
    write_map(folder / "solid.yaml", wall=True)
    write_map(folder / "absent.yaml", image=False)
    (folder / "robot.yaml").write_text("images: 3\nimage_topic: scan\n")
    (folder / "places.yaml").mkdir()
    command = ("bench", "planners", folder, "--pairs", 1, "--planner", "astar", "--processes", 1, "--json")
    document = navstack(*command, code=1)
    # an ambiguous name is replaced by the path
    assert [row["map"] for row in document["rows"]] == [
        "x",
        str(folder / "b/x/m.yaml"),
        str(folder / "c/x/m.yml"),
        "open",
    ]
    assert all(row["found"] == 1 for row in document["rows"]) and document["failed"] == []
    (unreadable,) = document["unreadable"]
    assert "absent.yaml" in unreadable and "absent.png" in unreadable
    assert [note.partition(":")[0] for note in document["notes"]] == [
        "skipped an unreadable map",
        "solid has no row",
    ]
    (folder / "absent.yaml").unlink()
    assert navstack(*command, "--out", "out")["unreadable"] == []
    Image.new("L", (40, 40), 253).save(folder / "d" / "open.png")
    assert navstack(*command, "--out", "out", "--resume")["unreadable"] == []  # the same cells from another gray value
    Image.new("L", (40, 41), 254).save(folder / "d" / "open.png")
    document = navstack(*command, "--out", "out", "--resume", code=2)
    assert "maps.open was " in document["error"]["message"]
    write_map(tmp_path / "none" / "absent.yaml", image=False)
    assert "no map can be read: " in navstack("bench", "planners", "none", code=2)
    assert "absent.png" in navstack("bench", "planners", tmp_path / "none" / "absent.yaml", code=2)


def write_scenario(file: Path, name: str = "trip", goal: str = "[4.0, 7.45, 0.0]") -> Path:
    """Writes a scenario of three meters along the corridor of the packaged office."""
    file.write_text(f"name: {name}\nmap: office\nstart: [1.0, 7.45, 0.0]\ngoals: [{goal}]\ntime_limit: 60\n")
    return file


@pytest.mark.slow
def test_compare(navstack, tmp_path: Path) -> None:
    folder = tmp_path / "scenarios"
    folder.mkdir()
    write_scenario(folder / "a.yaml")
    write_scenario(folder / "b.yaml", "nowhere", "[4.0, 30.0, 0.0]")
    document = navstack("bench", "compare", "turtlebot", "turtlebot", folder, "--set-b", "DWAPlannerROS/max_vel_x=0.25",
                    "--processes", 1, "--out", "out", "--json")  # fmt: skip
    trip, nowhere = document["by_scenario"]
    assert (trip["scenario"], trip["a_success"], trip["b_success"]) == ("trip", 1, 1)
    assert trip["difference_s"] > 2.0
    assert (nowhere["a_success"], nowhere["b_success"], nowhere["a_time_s"]) == (0, 0, None)
    measures = {row["measure"]: row for row in document["measures"]}
    assert measures["success"]["pairs"] == 2 and measures["success"]["verdict"] == "no difference shown"
    assert measures["time (s)"]["pairs"] == 1
    assert measures["time (s)"]["verdict"] == "no difference shown"  # one pair is not enough
    assert document["B"] == {"params": ["turtlebot"], "set": ["DWAPlannerROS/max_vel_x=0.25"]}
    assert (tmp_path / "out" / "compare.png").stat().st_size > 10_000
    message = navstack("bench", "compare", "turtlebot", "turtlebot", folder, "--out", "out", "--resume", code=2)
    assert "B.set.0 was" in message or "B.set was" in message


@pytest.mark.slow
def test_controllers(navstack, tmp_path: Path) -> None:
    trip = write_scenario(tmp_path / "trip.yaml", goal="[2.0, 7.45, 0.0]")
    arguments = ["bench", "controllers", trip, "--controller", "pure_pursuit", "--controller", "slow=turtlebot_rpp",
                 "--processes", 1, "--out", "out", "--json"]  # fmt: skip
    document = navstack(*arguments)
    rows = document["rows"]
    assert [(r["suite"], r["controller"], r["runs"]) for r in rows] == [
        ("trip", "pure_pursuit", 1),
        ("trip", "slow", 1),
    ]
    for row in rows:
        assert row["success"]["value"] == 1.0 and row["contacts"] == 0 and row["contacts_per_hour"]["high"] > 0.0
        assert row["time_s"]["value"] > 2.0 and row["cycle_p99_ms"]["value"] >= row["cycle_p50_ms"]["value"] > 0.0
    assert rows[0]["jerk_rms_m_s3"] == rows[1]["jerk_rms_m_s3"]
    assert document["controllers"]["slow"]["with_map"] == {"params": ["turtlebot_rpp"], "set": []}
    assert (tmp_path / "out" / "controllers.png").stat().st_size > 10_000
    assert "times against pure_pursuit" in (tmp_path / "out" / "controllers.md").read_text()
    again = navstack(*arguments, "--resume")
    assert again["rows"] == rows


@pytest.mark.slow
def test_speed(navstack, tmp_path: Path) -> None:
    trip = write_scenario(tmp_path / "trip.yaml", goal="[2.0, 7.45, 0.0]")
    document = navstack("bench", "speed", trip, "--repeats", 1, "--json")
    (tmp_path / "then.json").write_text(json.dumps(document))
    whole = document["measured"]["whole run"]
    assert whole["states"] == ["SUCCEEDED"] and whole["factors"][0] > 0.0
    stages = document["measured"]["stages of a run"]["stages"]
    assert {"local planner", "global planner", "costmaps", "simulator", "recorder"} <= set(stages)
    assert {"dwa_turtlebot", "costmap_update_4m", "voxel_update_4m"} <= set(document["cases"])
    # the document is a reference for later runs; the ratio uses both calibrations
    now = {name: {"ms": 2.0 * case["ms"]} for name, case in document["cases"].items()}
    results = [JobResult(name, {**case, "calibration_ms": 50.0}) for name, case in now.items()]
    then = read_reference(tmp_path / "then.json")
    rows = speed_tables(results, then)[-1].rows
    assert [r["ratio"] for r in rows] == [pytest.approx(50.0 / document["calibration_ms"] / 2.0)] * len(now)


def test_markdown_escapes_a_bar_in_a_cell() -> None:
    table = Table("t", (Column("name", "name"), Column("n", "n")), [{"name": "a|b\nc", "n": 1}])
    assert table.markdown().splitlines()[-1] == "| a\\|b c | 1 |"


def pair(scenario: str, a: float | None, b: float | None, seed: int = 0) -> Pair:
    sides = [{"success": t is not None, "time_s": t or 60.0, "recoveries": 0} for t in (a, b)]
    return Pair(scenario, seed, *sides)


def test_verdicts_of_a_comparison() -> None:
    pairs = [pair(f"s{i}", 20.0 + i, 18.0 + i + 0.1 * (i % 3)) for i in range(12)]
    rows = {r["measure"]: r for r in measures_table(pairs).rows}
    assert rows["time (s)"]["verdict"] == "B is better"
    assert rows["success"]["verdict"] == rows["recoveries"]["verdict"] == "no difference shown"
    pairs = [pair(f"s{i}", 20.0, None if i < 7 else 20.0) for i in range(12)]
    rows = {r["measure"]: r for r in measures_table(pairs).rows}
    assert rows["success"]["verdict"] == "A is better"
    assert rows["time (s)"]["pairs"] == 5 and rows["time (s)"]["verdict"] == "no difference shown"
    assert [r["b_success"] for r in scenarios_table(pairs).rows] == [0] * 7 + [1] * 5


def test_a_single_scenario_is_compared_over_its_seeds() -> None:
    a, b = [24.0, 24.5, 24.9, 24.1, 24.3, 24.6], [57.0, 58.2, 56.1, 57.7, 57.2, 57.4]
    pairs = [pair("one", x, y, seed) for seed, (x, y) in enumerate(zip(a, b, strict=True))]
    table = measures_table(pairs)
    time = next(r for r in table.rows if r["measure"] == "time (s)")
    wanted = stats.ttest_rel(b, a).confidence_interval(0.95)
    interval = time["difference"].interval
    assert interval.low <= wanted.low + 1e-9 and interval.high >= wanted.high - 1e-9
    assert time["verdict"] == "A is better"
    assert "seeds of one scenario" in table.title
    # several scenarios are compared over the scenarios
    more = measures_table([*pairs, *(pair("two", x, y, seed) for seed, (x, y) in enumerate(zip(a, a, strict=True)))])
    assert more.rows[1]["verdict"] == "no difference shown"
    assert "over scenarios" in more.title


def test_scenarios_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (scenario,) = read_scenarios(["narrow_door"], None)
    assert scenario.name == "narrow door"
    write_scenario(Path("narrow_door"))  # a local file takes precedence
    (scenario,) = read_scenarios(["narrow_door"], None)
    assert scenario.name == "trip"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("barn", "absent", "--params", "turtlebot"), "absent/worlds.npz does not exist; give the folder"),
        (("barn", "FIELDS"), "--params"),
        (("barn", "FIELDS", "--params", "turtlebt"), "turtlebot"),
        (("barn", "FIELDS", "--params", "turtlebot", "--worlds", "4"), "has no world 4; it has 3, 8, 9"),
        (("barn", "FIELDS", "--params", "turtlebot", "--worlds", "a"), '"a" is not a whole number'),
        (("barn", "FIELDS", "--params", "turtlebot", "--seeds", "0"), "--seeds"),
        (("barn", "FIELDS", "--params", "turtlebot", "--noise", "-1"), "--noise"),
        (("barn", "FIELDS", "--params", "turtlebot", "--distro", "hydro"), "noetic"),
        (("barn", "FIELDS", "--params", "turtlebot", "--processes", "0"), "--processes"),
        (("barn", "FIELDS", "--params", "turtlebot", "--resume"), "--out"),
        (("barn", "FIELDS", "--params", "turtlebot", "--record"), "--out"),
        (("movingai", "absent"), "contains no problems.tsv"),
        (("movingai", "PROBLEMS", "--planner", "astr"), "astar"),
        (("movingai", "PROBLEMS", "--map", "arena"), 'the problems.tsv has no problems for this map; its maps: room'),
        (("planners", "offic"), "office"),
        (("planners", "absent.yaml"), "absent.yaml"),
        (("planners", "FIELDS"), "contains no map YAML"),
        (("planners", "office", "--planner", "navfm"), "navfn"),
        (("planners", "office", "--pairs", "0"), "--pairs"),
        (("planners", "office", "--set", "nothing"), "--set"),
        (("planners", "office", "--out", "file/out"), "--out"),
        (("compare", "turtlebot", "turtlebot"), "no scenarios; give"),
        (("controllers", "ofice"), 'no scenario file and no shipped scenario is named "ofice"'),
        (("controllers", "barn"), "the BARN worlds are not part of navstack; give the folder"),
        (("controllers", "office", "office"), 'the scenario "office 0" is in two suites'),
        (("controllers", "--controller", "mpi"), 'did you mean "mppi"?'),
        (("controllers", "--controller", "mine="), '--controller "mine=" must be NAME=PARAMS'),
        (("controllers", "--controller", "dwa", "--controller", "dwa"), '--controller "dwa" is given twice'),
        (("compare", "turtlebot", "turtlebt", "SCENARIO"), "turtlebot"),
        (("compare", ",", "turtlebot", "SCENARIO"), 'A "," names no parameters'),
        (("compare", "turtlebot", ",", "SCENARIO"), 'B "," names no parameters'),
        (("compare", "turtlebot", "turtlebot", "absent.yaml"), "absent.yaml"),
        (("compare", "turtlebot", "turtlebot", "SCENARIO", "SCENARIO"), 'two scenarios have the name "trip"'),
        (("compare", "turtlebot", "turtlebot", "SCENARIO", "--count", "3"), "--suite"),
        (("compare", "turtlebot", "turtlebot", "--suite", "ofice"), "office"),
        (("compare", "turtlebot", "turtlebot", "--suite", "barn"), "give the folder of their worlds.npz as a SCENARIO"),
        (("speed", "offic"), "office"),
        (("speed", "office", "--repeats", "0"), "--repeats"),
        (("speed", "office", "--reference", "absent.json"), "cannot read absent.json"),
        (("speed", "office", "--reference", "trip.yaml"), "contains no reference times"),
        (("compare", "turtlebot", "turtlebot", "problems"), "contains neither scenario files nor"),
        (("compare", "turtlebot", "turtlebot", "SCENARIO", "--set-b", "DWAPlannerROS/max_vel_x=fast"), "max_vel_x"),
    ],
)  # fmt: skip
def test_wrong_input(navstack, fields: Path, tmp_path: Path, arguments: tuple[str, ...], match: str) -> None:
    write_problems(tmp_path / "problems")
    write_scenario(tmp_path / "trip.yaml")
    (tmp_path / "file").touch()
    places = {"FIELDS": str(fields), "PROBLEMS": "problems", "SCENARIO": "trip.yaml"}
    words = [places.get(a, a) for a in arguments]
    message = " ".join(navstack("bench", *words, code=2).split())
    assert re.search(match.replace("the problems.tsv", ".*problems.tsv"), message), message
    document = navstack("bench", *words, "--json", code=2)
    assert document["error"]["message"]


@pytest.mark.parametrize(("name", "hint"), [("narow_door", 'did you mean "narrow_door"?'), ("zzz", "shipped: ")])
def test_unknown_scenario_name(name: str, hint: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "compare", "turtlebot", "turtlebot", name]) == 2
    err = capfd.readouterr().err
    assert f'no scenario file and no shipped scenario is named "{name}"' in err
    assert hint in err
