"""`navstack replay` and `navstack bag`: what they print and write, and wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.map_io import load_map
from navstack.record import Record
from navstack.replay import export_run
from navstack.scenario import Run, read_scenario, shipped_scenarios


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run, with `run.bag` in it."""
    folder = tmp_path_factory.mktemp("recorded")
    run = Run(read_scenario(shipped_scenarios()["narrow_door"]).build())
    while run.step():
        pass
    assert run.recorder is not None
    run.recorder.save(folder)
    export_run(run.recorder.record(), folder / "run.bag")
    return folder


@pytest.mark.slow
def test_info(recorded: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["bag", "info", str(recorded / "run.bag")]) == 0
    out = capfd.readouterr().out
    assert '/scan: sensor_msgs/LaserScan in "base_laser_link", 97 messages, 10 Hz' in out
    assert "base_footprint (50.0 Hz, longest gap 0.02 s at" in out
    assert "yes localization: map -> odom" in out
    assert run(["bag", "info", str(recorded / "run.bag"), "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["roots"] == ["map"] and all(need["found"] for need in document["needs"])


@pytest.mark.slow
def test_export_and_replay(recorded: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    layout = tmp_path / "layout.json"
    target = tmp_path / "run.mcap"
    assert run(["bag", "export", str(recorded), "--to", str(target), "--layout", str(layout)]) == 0
    assert "is equal to the record" in " ".join(capfd.readouterr().out.split())
    assert "/global_costmap/costmap" in json.loads(layout.read_text())["configById"]["3D!navstack"]["topics"]
    out = tmp_path / "out"
    assert (
        run(["replay", str(target), "--params", "turtlebot", "--versus", "turtlebot_rpp", "--out", str(out), "--json"])
        == 0
    )
    document = json.loads(capfd.readouterr().out)
    same = document["replay"]["commands"]
    assert same["cycles"] == same["equal"] > 10 and same["first"] is None
    assert document["versus"]["commands"]["different"] > 0
    assert (out / "commands.png").stat().st_size > 5000
    record = Record.load(out)
    assert record.scenario["log"]["path"] == str(target)
    assert run(["explain", "command", str(out), "--time", "3"]) == 0
    assert run(["plot", str(out), "--out", str(tmp_path / "x.png")]) == 0
    target.unlink()
    capfd.readouterr()
    assert run(["live", str(out), "--no-open", "--port", "0"]) == 2
    assert "is the replay of a log, which is needed again" in " ".join(capfd.readouterr().err.split())


@pytest.mark.slow
def test_scenario(recorded: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "moment" / "scenario.yaml"
    assert run(["bag", "scenario", str(recorded / "run.bag"), "--at", "5", "--out", str(file)]) == 0
    text = capfd.readouterr().out
    assert "observed obstacles that the map does not have" in text
    scenario = read_scenario(file).build()
    assert scenario.goals and scenario.start.x > 3.0
    assert load_map(file.with_name("scenario_map.yaml")).data.shape == scenario.map.data.shape


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bag", "info", "nothing.bag"], "nothing.bag does not exist; give the path of a recorded log"),
        (["replay", "RUN", "--topic", "scan"], '--topic "scan": give NAME=TOPIC, such as scan=/front/scan'),
        (["replay", "RUN", "--topic", "scan=/x"], "has no topic /x; its topics are"),
        (
            ["replay", "RUN", "--mount", "laser=1,2"],
            '--mount "1,2" has 2 numbers; give x,y,z,yaw in meters and radians',
        ),
        (["replay", "RUN", "--goal", "soon:1,2"], '"soon" is not a number'),
        (["replay", "RUN", "--from", "5", "--to", "4"], "--from 5 is not before --to 4"),
        (["replay", "RUN", "--map", "/nomap"], "has no topic /nomap"),
        (["replay", "RUN", "--initial-pose", "1,2,0"], "leave --initial-pose out"),
        (["bag", "scenario", "RUN", "--at", "99"], "99 s is not in it"),
        (["bag", "export", "RECORD", "--to", "run.db3"], "end the name with .bag (ROS 1) or .mcap (ROS 2)"),
    ],
)
def test_wrong_input(
    recorded: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    given = [{"RUN": str(recorded / "run.bag"), "RECORD": str(recorded)}.get(text, text) for text in arguments]
    if arguments[0] == "replay":
        given += ["--out", str(tmp_path / "out")]
    assert run(given) == 2
    assert message in " ".join(capfd.readouterr().err.split())


@pytest.mark.slow
def test_truncated_bag(recorded: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content = (recorded / "run.bag").read_bytes()
    cut = tmp_path / "cut.bag"
    cut.write_bytes(content[: len(content) // 2])
    assert run(["bag", "info", str(cut)]) == 2
    assert "is truncated (offset" in capfd.readouterr().err
    assert run(["bag", "info", str(cut), "--partial"]) == 0
    streams = capfd.readouterr()
    assert "/scan" in streams.out and "is truncated" in streams.err
    assert run(["replay", str(cut), "--partial", "--out", str(tmp_path / "out")]) == 0
