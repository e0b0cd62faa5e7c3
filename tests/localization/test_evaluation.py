"""Localizers run over drives, and the commands that do it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from navstack.cli.app import run
from navstack.core import InputError, LaserScan, LogError, OccupancyGrid, Pose2D, Transform2D
from navstack.localization.evaluation import follow
from navstack.localization.methods import Method, methods
from navstack.localization.searching import SURE_M, is_sure
from navstack.logs import logged_scans, open_scan_log
from navstack.map_io import load_map
from navstack.plugins import Localizer, ParamModel, PoseEstimate
from tests.localization.rooms import rooms
from tests.logs.carmen_files import circle, write_corrected_log


@pytest.fixture(scope="module")
def log_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "drive.log"
    return write_corrected_log(path, rooms(), circle(Transform2D(1.0, 4.5, 0.2), 16))


@pytest.mark.slow
def test_a_map_from_odd_scans_and_tracking_on_the_even_ones(
    log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    yaml = tmp_path / "map.yaml"
    assert run(["map", "from-log", str(log_file), "--scans", "odd", "--out", str(yaml), "--json"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert made["scans"] == 8
    assert (load_map(yaml).data == 100).sum() == made["occupied"]
    out = tmp_path / "out"
    line = ["localize", str(log_file), "--map", str(yaml), "--scans", "even", "--out", str(out), "--json"]
    line += ["--versus", "match_beams=30", "--animate", str(tmp_path / "film.gif")]
    assert run(line) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(document["tracks"]) == ["scan_matching", "scan_matching match_beams=30"]
    for track in document["tracks"].values():
        assert track["scans"] == 8
        assert track["ate"]["position_m"]["max"] < 0.2
        assert track["relations"]["position_m"]["count"] == 7
    names = {"localize.json", "localize.png", "errors.png", "trajectory.csv", "trajectory_versus.csv"}
    assert {path.name for path in out.iterdir()} == names
    assert len((out / "trajectory.csv").read_text(encoding="utf-8").splitlines()) == 9
    with Image.open(out / "localize.png") as picture:
        assert len(np.unique(np.asarray(picture.convert("L")))) > 20
    with Image.open(tmp_path / "film.gif") as film:
        assert getattr(film, "n_frames", 1) == 8


class Says(Localizer):
    """A localizer at the origin that says what it is told about its pose, one scan after the other."""

    class Params(ParamModel):
        """None."""

    def __init__(self, says: list[dict[str, bool]]) -> None:
        self.says = says
        self.found: PoseEstimate | None = None

    def set_map(self, grid: OccupancyGrid) -> None:
        """Not used."""

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64], stamp: float) -> None:
        """Not used."""

    def start_globally(self) -> None:
        """Not used."""

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        details = self.says.pop(0)
        self.found = PoseEstimate(Pose2D(0.0, 0.0), 1e-4 * np.eye(3), odometry.inverse(), scan.stamp, details)
        return self.found

    @property
    def estimate(self) -> PoseEstimate | None:
        return self.found


def test_in_doubt_is_not_lost(log_file: Path) -> None:
    says = [{"lost": True, "certain": False}, {"lost": False, "certain": False}, {"lost": False, "certain": True}, {}]
    frames = list(logged_scans(open_scan_log(log_file)))[: len(says)]
    track = follow(frames, Says(says), globally=True)
    assert track.lost.tolist() == [True, False, False, False]
    assert track.in_doubt.tolist() == [False, True, False, False]
    assert track.sure.tolist() == [False, False, True, True]
    assert track.summary()["lost"] == track.summary()["in_doubt"] == 1


@pytest.mark.slow
def test_a_global_start_over_a_drive(log_file: Path) -> None:
    localizer, cloud = Method().build(0)
    localizer.set_map(rooms())
    track = follow(logged_scans(open_scan_log(log_file)), localizer, globally=True, cloud=cloud)
    assert track.lost[0]
    assert not track.lost[-1]
    assert track.errors[-1] < 0.2
    assert sorted(track.clouds) == list(range(16))
    assert track.particles[0] >= track.particles[-1] >= 1


def test_inputs_of_the_commands(log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path / "m.yaml")]
    wrong = [
        (["map", "from-log", str(log_file), "--resolution", "0", *out], "--resolution must be a length"),
        (["map", "from-log", str(tmp_path / "none.log"), *out], "does not exist"),
        (["localize", str(log_file), "--map", "office", "--global", "--initial-pose", "1,2,0"], "exclude each other"),
        (["localize", str(log_file), "--map", "office", "--set", "method=magic"], "the methods are"),
        (["localize", str(log_file), "--map", "office", "--set", "beams"], "must be KEY=VALUE"),
        (["localize", str(log_file), "--map", "office", "--set", "beams=3"], "beams"),
    ]
    for line, named in wrong:
        assert run(line) == 2, line
        assert named in " ".join(capsys.readouterr().err.split()), line
    assert not (tmp_path / "m.yaml").exists()


def test_methods_by_name() -> None:
    method = Method.parse(["method=amcl", "max_particles=300", "lost_evidence=3.0"], "--set")
    assert method.label == "amcl max_particles=300 lost_evidence=3.0"
    assert methods() == ["amcl", "amcl_only", "dead_reckoning", "mapping", "scan_matching"]
    for name in methods():
        Method(name).build(1)
    with pytest.raises(InputError, match="has no parameter"):
        Method("amcl_only", {"match_beam": 3}).build(0)
    with pytest.raises(InputError, match="max_particles"):
        Method("amcl", {"max_particles": "many"}).build(0)


def test_a_drive_without_reference_needs_a_pose(log_file: Path) -> None:
    localizer, _ = Method().build(0)
    localizer.set_map(rooms())
    frames = list(logged_scans(open_scan_log(log_file)))
    with pytest.raises(LogError, match="--initial-pose"):
        follow([dataclasses.replace(frames[0], reference=None)], localizer)
    with pytest.raises(LogError, match="no scan"):
        follow([], localizer)


def test_an_estimate_without_a_verdict_is_sure_by_the_spread_of_its_position() -> None:
    """Both axes count, and the yaw does not."""

    def sure(xx: float, yy: float, xy: float = 0.0, **details: bool) -> bool:
        covariance = np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, 9.0]])
        return is_sure(PoseEstimate(Pose2D(0.0, 0.0), covariance, Transform2D(), 0.0, dict(details)))

    half = 0.5 * SURE_M**2
    assert sure(0.9 * half, 0.9 * half)
    assert not sure(1.1 * half, 1.1 * half)
    assert not sure(2.1 * half, 0.0) and not sure(0.0, 2.1 * half)
    assert sure(0.9 * half, 0.9 * half, xy=0.9 * half)
    assert not sure(0.0, 0.0, lost=True) and not sure(0.0, 0.0, certain=False) and sure(9.0, 9.0, certain=True)
