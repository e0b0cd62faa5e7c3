"""`navstack map build`, `map solve` and `explain map`, as their user runs them."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from navstack.cli import app as cli
from tests.mapping.simulated import lap

Run = Callable[..., str]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command in this process; return what it printed."""

    def call(*arguments: str, code: int = 0) -> str:
        assert cli.run(list(arguments)) == code, capsys.readouterr()
        captured = capsys.readouterr()
        return captured.err if code else captured.out

    return call


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CARMEN log without ODOM lines, as the raw logs of the benchmarks."""
    file = tmp_path_factory.mktemp("logs") / "lap.log"
    lines = []
    for frame, _ in lap()[:140]:
        ranges = " ".join(f"{value:.3f}" for value in frame.scan.ranges.tolist())
        pose = " ".join(f"{value:.6f}" for value in frame.odometry)
        stamp = f"{1e9 + frame.scan.stamp:.6f}"
        lines.append(f"FLASER {len(frame.scan.ranges)} {ranges} {pose} {pose} {stamp} robot {frame.scan.stamp:.6f}\n")
    lines.insert(70, lines[20])  # a time that goes back
    file.write_text("".join(lines))
    return file


@pytest.mark.slow
def test_a_raw_log_becomes_a_map_that_is_explained_and_resumed(run: Run, log: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.yaml"
    text = run("map", "build", str(log), "--out", str(whole))
    assert "keyframes on" in text
    report = json.loads(whole.with_suffix(".report.json").read_text())
    assert report["problems"] == {"the time of a scan is not after that of the scan before; it got a later one": 1}
    for suffix in (".pgm", ".g2o", ".png", ".report.json", ".mapping.npz"):
        assert whole.with_suffix(suffix).stat().st_size > 100
    part = tmp_path / "new" / "part.yaml"  # the folder is made
    run("map", "build", str(log), "--out", str(part), "--limit", "80", "--json")
    for _ in range(2):  # the second time, it goes on from a mapping that is finished
        run("map", "build", str(log), "--out", str(part), "--resume", "--json")
        assert part.with_suffix(".pgm").read_bytes() == whole.with_suffix(".pgm").read_bytes()
        assert part.with_suffix(".g2o").read_bytes() == whole.with_suffix(".g2o").read_bytes()
    cell = json.loads(run("explain", "map", str(whole), "--at", "1.5,0.2", "--json"))
    assert cell["state"] == "free"
    assert cell["hits"] == 0
    assert cell["misses"] == len(cell["scans"]) > 3
    assert "outside the map" in run("explain", "map", str(whole), "--at", "99,0", code=2)
    solved = json.loads(run("map", "solve", str(whole.with_suffix(".g2o")), "--json"))
    assert solved["chi2"] <= solved["chi2_before"] * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("minimum_travel_distanse=1", 'did you mean "minimum_travel_distance"?'),
        ("resolution=fine", "--set resolution="),
        ("resolution=0", "--set resolution="),
    ],
)
def test_a_wrong_parameter_is_refused(run: Run, log: Path, tmp_path: Path, option: str, message: str) -> None:
    out = tmp_path / "map.yaml"
    assert message in " ".join(run("map", "build", str(log), "--out", str(out), "--set", option, code=2).split())
    assert not list(tmp_path.iterdir())


def test_resume_needs_a_mapping(run: Run, log: Path, tmp_path: Path) -> None:
    assert "does not exist" in run("map", "build", str(log), "--out", str(tmp_path / "map.yaml"), "--resume", code=2)
