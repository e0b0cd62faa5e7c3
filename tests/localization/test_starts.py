"""Global starts along a drive: counts of right, wrong and missing answers, and the command."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.core import InputError, LaserScan, LogError, OccupancyGrid, Pose2D, Transform2D
from navstack.localization.evaluation import LEAST_SCANS, LoggedScan, run_starts
from navstack.map_io import save_map
from navstack.plugins import Localizer, PoseEstimate
from tests.localization.rooms import rooms
from tests.logs.carmen_files import circle, write_corrected_log

SCAN = LaserScan(np.ones(4, np.float32), 0.0, 0.1, 0.1, 10.0)


class Told(Localizer):
    """Becomes certain at the third scan: of the pose that is `off` (m) from the drive's; never if `off` is infinite."""

    def __init__(self, off: float, then: float | None = None) -> None:
        self.offsets = (off, off if then is None else then)
        self.scans = 0
        self._estimate: PoseEstimate | None = None

    def set_map(self, grid: OccupancyGrid) -> None:
        raise AssertionError

    def set_pose(self, pose: Pose2D, covariance: object, stamp: float) -> None:
        raise AssertionError

    def start_globally(self) -> None:
        self.scans, self._estimate = 0, None

    @property
    def estimate(self) -> PoseEstimate | None:
        return self._estimate

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        self.scans += 1
        off = self.offsets[self.scans > 5]
        certain = self.scans >= 3 and math.isfinite(off)
        shift = Transform2D(off if math.isfinite(off) else 0.0, 0.0, 0.0)
        pose = Pose2D(*(shift @ odometry))
        self._estimate = PoseEstimate(pose, np.eye(3), shift, scan.stamp, {"certain": certain})
        return self._estimate


def line(count: int, *, reference: bool = True) -> list[LoggedScan]:
    """A drive along x, half a meter and 2 s per scan."""
    frames: list[LoggedScan] = []
    for i in range(count):
        at = Transform2D(0.5 * i, 0.0, 0.0)
        scan = LaserScan(SCAN.ranges, 0.0, 0.1, 0.1, 10.0, 2.0 * i)
        frames.append(LoggedScan(i, scan, Transform2D(), at, Pose2D(*at) if reference else None))
    return frames


def test_outcomes() -> None:
    frames = line(60)
    offsets = [(0.1, None), (2.0, None), (math.inf, None), (0.2, 3.0), (0.3, None)]
    starts = run_starts(lambda: frames, lambda number: Told(*offsets[number]), 5)
    assert [r.outcome for r in starts.results] == ["found", "wrong", "uncertain", "wrong", "found"]
    assert [r.scan for r in starts.results] == [0, 8, 16, 24, 32]
    first = starts.results[0]
    assert (first.scans, first.seconds, first.meters) == (3, 4.0, pytest.approx(1.0))
    assert first.error == pytest.approx(0.1)
    # the second was wrong from its third scan to its last one
    assert starts.results[1].wrong == LEAST_SCANS - 2
    assert starts.results[1].error == pytest.approx(2.0)
    summary = starts.summary()
    assert (summary["found"], summary["uncertain"], summary["wrong"]) == (2, 1, 2)
    assert summary["rate"] == pytest.approx(0.4)
    assert summary["median"]["scans"] == 3
    assert starts.path.shape == (60, 3)


def test_drives_that_cannot_be_judged() -> None:
    with pytest.raises(LogError, match="no reference poses"):
        run_starts(lambda: line(30, reference=False), lambda _: Told(0.0), 2)
    with pytest.raises(InputError, match="50 starts: the log has 60 scans and a start needs 20, so at most 40"):
        run_starts(lambda: line(60), lambda _: Told(0.0), 50)


@pytest.mark.slow
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_corrected_log(tmp_path / "drive.log", rooms(), circle(Transform2D(1.0, 4.5, 0.2), 24))
    yaml = str(save_map(rooms(), tmp_path / "rooms.yaml")[0])
    out = tmp_path / "out"
    command = ["localize", str(log), "--map", yaml, "--starts", "2"]
    assert run([*command, "--global", "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["starts"]["scan_matching"]
    assert (found["starts"], found["found"], found["wrong"]) == (2, 2, 0)
    with (out / "starts.csv").open(encoding="utf-8") as file:
        assert [row["outcome"] for row in csv.DictReader(file)] == ["found", "found"]
    with Image.open(out / "starts.png") as picture:
        assert len(np.unique(np.asarray(picture.convert("L")))) > 20
    for wrong, named in (
        (command, "use it with --global"),
        ([*command, "--global", "--animate", "a.gif"], "exclude each other"),
    ):
        assert run(wrong) == 2
        assert named in " ".join(capsys.readouterr().err.split())
