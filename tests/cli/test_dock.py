"""`navstack dock` from the command line: what it prints, its picture, its exit codes, and wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.core import InputError
from navstack.plot import plot_docking
from navstack.record import Record

NEAR = ["--start", "2.85,7.42,3.1"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("detector", ["camera", "reflector", "none"])
def test_docks_and_undocks_in_the_office(capsys: pytest.CaptureFixture[str], folder: Path, detector: str) -> None:
    assert run(["dock", "--detector", detector, "--noise", "0.005", "--undock", *NEAR]) == 0
    out = capsys.readouterr().out
    assert "SUCCEEDED: docked at dock" in out
    assert "SUCCEEDED: undocked from dock" in out
    for name in ("dock.png", "undock.png"):
        assert (folder / "navstack_dock" / name).stat().st_size > 10_000
    summary = json.loads((folder / "navstack_dock" / "summary.json").read_text())
    assert summary["goals"][0]["figures"]["docking"]["num_retries"] <= 3


@pytest.mark.slow
def test_a_dock_without_power_is_explained(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    unpowered = ["--set", "navstack/sim/dock/powered=false", "--set", "docking_server/max_retries=0"]
    assert run(["dock", *NEAR, *unpowered]) == 1
    out = capsys.readouterr().out
    assert "WAIT_FOR_CHARGE 906" in out
    assert "FAILED_TO_CHARGE (906)" in out
    assert run(["explain", "goal", "navstack_dock"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "WAIT_FOR_CHARGE, attempt 1: ended 0.00 m from the dock" in told
    assert "failed with 906" in told
    record = Record.load(folder / "navstack_dock" / "run.npz")
    with pytest.raises(InputError, match="docking 2: this run has 1 of them"):
        plot_docking(record, folder / "x.png", docking=2)
    assert plot_docking(record, folder / "whole.svg", whole=True).exists()


@pytest.mark.slow
def test_a_dock_of_the_parameters_by_its_name(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    text = "docking_server:\n  docks: [a, b]\n  a: {pose: [9.0, 7.4, 0.0]}\n  b: {pose: [2.0, 7.45, 3.14159]}\n"
    (folder / "docks.yaml").write_text(text)
    arguments = ["dock", "--params", "turtlebot", "--params", "docks.yaml", *NEAR, "--json"]
    # the default docking_threshold, 5 cm, is more than the contacts allow: the robot drives on until the current flows
    for more in ([], ["--set", "docking_server/simple_charging_dock/docking_threshold=0.005"]):
        assert run([*arguments, "--dock", "b", *more]) == 0
        document = json.loads(capsys.readouterr().out)
        assert abs(document["error"]["x_m"]) < 0.01
    never = ["--set", "docking_server/simple_charging_dock/charging_threshold=1e6"]
    assert run([*arguments, "--dock", "b", *never]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["goals"][0]["error_name"] == "FAILED_TO_CHARGE"
    assert run([*arguments, "--dock", "c"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == 901


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["maze"], "no dock is known; give --dock X,Y,YAW"),
        (["--dock", "home"], 'no dock is called "home"'),
        (["--dock", "1,x"], "--dock"),
        (["--detector", "sonar"], "--detector"),
        (["--noise", "-1"], "--noise"),
        (["offce"], "office"),
    ],
)
def test_wrong_input(capsys: pytest.CaptureFixture[str], arguments: list[str], said: str) -> None:
    assert run(["dock", *arguments]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
