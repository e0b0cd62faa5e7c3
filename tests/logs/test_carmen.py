"""The reader of CARMEN logs: messages, the rebased odometry, real logs, damaged files."""

from __future__ import annotations

import gzip
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from navstack.core import LogError, Transform2D
from navstack.logs import carmen as line_reader
from navstack.logs.carmen import angular_step
from navstack.logs.scan_log import ScanLog, logged_scans
from navstack.logs.scan_log_formats import open_scan_log
from tests.conftest import data_files
from tests.localization.rooms import rooms
from tests.logs.carmen_files import circle, write_corrected_log

LOGS = data_files("carmen/*.log.gz")
PATHS_M = {
    "csail-corrected.log.gz": (406, 379.6),
    "aces-corrected.log.gz": (440, 323.2),
    "freiburg-101-corrected.log.gz": (292, 210.6),
}
"""Scans, and lengths of the corrected paths, of the data's README."""


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    return write_corrected_log(tmp_path / "drive.log", rooms(), circle(Transform2D(1.0, 4.5, 0.2), 6))


def test_messages_and_the_odometry_without_the_rebasing(log_file: Path) -> None:
    truths = circle(Transform2D(1.0, 4.5, 0.2), 6)
    frames = list(logged_scans(open_scan_log(log_file)))
    assert [frame.index for frame in frames] == list(range(6))
    for frame, truth in zip(frames, truths, strict=True):
        assert frame.reference == pytest.approx(tuple(truth), abs=1e-5)
        assert tuple(frame.sensor) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
        assert len(frame.scan.ranges) == 180
        assert frame.scan.angle_increment == pytest.approx(math.radians(1.0))
    for (a, b), (u, v) in zip(itertools.pairwise(frames), itertools.pairwise(truths), strict=True):
        moved, true = a.odometry.inverse() @ b.odometry, u.inverse() @ v
        assert math.hypot(moved.x - true.x, moved.y - true.y) < 0.02
        assert moved.yaw - true.yaw == pytest.approx(0.02, abs=1e-4)  # the drift of a step, without the correction


def test_stamps_never_decrease_and_order_is_kept(log_file: Path) -> None:
    text = log_file.read_text(encoding="utf-8").replace(" 12.0 nohost 12.0", " 3.5 nohost 3.5")
    log_file.write_text(text, encoding="utf-8")
    scans = list(open_scan_log(log_file))
    stamps = [scan.scan.stamp for scan in scans]
    assert stamps == sorted(stamps)
    assert len(scans) == 6 and all(scan.reference is not None for scan in scans)


def test_every_second_scan(log_file: Path) -> None:
    assert [f.index for f in logged_scans(open_scan_log(log_file), every=2, first=1)] == [1, 3, 5]


def test_a_compressed_log_reads_the_same(log_file: Path) -> None:
    packed = log_file.with_suffix(".log.gz")
    packed.write_bytes(gzip.compress(log_file.read_bytes()))
    plain, same = (list(logged_scans(open_scan_log(path))) for path in (log_file, packed))
    assert [f.odometry for f in plain] == [f.odometry for f in same]
    assert all(np.array_equal(a.scan.ranges, b.scan.ranges) for a, b in zip(plain, same, strict=True))


def test_ranges_without_a_return_are_infinite(log_file: Path) -> None:
    lines = log_file.read_text(encoding="utf-8").splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("FLASER"))
    fields = lines[at].split()
    fields[2:6] = ["81.91", "50", "nan", "-1"]
    lines[at] = " ".join(fields)
    log_file.write_text("\n".join(lines), encoding="utf-8")
    ranges = next(logged_scans(open_scan_log(log_file))).scan.ranges
    assert np.isposinf(ranges[:2]).all()
    assert np.isnan(ranges[2:4]).all()


@pytest.mark.parametrize(("n", "degrees"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5), (91, 2.0)])
def test_angular_step(n: int, degrees: float) -> None:
    assert angular_step(n) == pytest.approx(math.radians(degrees))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (("FLASER 180", "FLASER 181"), "announces 181 ranges"),
        (("FLASER 180", "FLASER many"), "number of ranges, not by many"),
        (("FLASER 180", "FLASER 99999999999"), "number of ranges"),
        ((" 0 0 0 10.5 nohost 10.5", " 0 0 0 soon nohost 10.5"), "the time must be a number, not soon"),
        ((" 0 0 0 10.5 nohost 10.5", " 0 0"), "ODOM has 5 fields"),
        (("ODOM 1", "ODOM inf 1"), "x must be a finite number, not inf"),
    ],
)
def test_a_damaged_line_is_named(log_file: Path, change: tuple[str, str], named: str) -> None:
    before = log_file.read_text(encoding="utf-8")
    text = before.replace(*change, 1)
    log_file.write_text(text, encoding="utf-8")
    line = 1 + next(i for i, (a, b) in enumerate(zip(before.splitlines(), text.splitlines(), strict=True)) if a != b)
    with pytest.raises(LogError, match=named) as error:
        list(open_scan_log(log_file))
    assert str(error.value).startswith(f"{log_file}:{line}: ")


def test_files_that_are_no_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LogError, match="does not exist"):
        open_scan_log(tmp_path / "none.log")
    other = tmp_path / "other.log"
    other.write_text("hello\n", encoding="utf-8")
    with pytest.raises(LogError, match="no format that navstack reads"):
        open_scan_log(other)
    other.write_bytes(b"FLASER \0\0")
    with pytest.raises(LogError, match="binary"):
        open_scan_log(other)
    other.write_text("ODOM 0 0 0 0 0 0 1 a 1\n", encoding="utf-8")
    with pytest.raises(LogError, match="no scan"):
        list(open_scan_log(other))
    monkeypatch.setattr(line_reader, "MAX_LINE", 20)
    with pytest.raises(LogError, match="longer than 20 bytes"):
        open_scan_log(other)


def test_a_truncated_compressed_log(log_file: Path) -> None:
    packed = log_file.with_suffix(".log.gz")
    packed.write_bytes(gzip.compress(log_file.read_bytes())[:-200])
    with pytest.raises(LogError, match="damaged or incomplete"):
        list(open_scan_log(packed))
    packed.write_bytes(b"\x1f\x8bnonsense")
    with pytest.raises(LogError, match="damaged"):
        open_scan_log(packed)


@pytest.mark.slow
@pytest.mark.skipif(not LOGS, reason="no foreign data: set NAVSTACK_DATA to their folder")
@pytest.mark.parametrize("file", LOGS, ids=lambda f: f.name)
def test_real_logs(file: Path) -> None:
    log: ScanLog = open_scan_log(file)
    frames = list(logged_scans(log))
    poses = np.array([f.reference for f in frames])
    odometry = np.array([f.odometry for f in frames])
    length, driven = (float(np.hypot(*np.diff(p[:, :2], axis=0).T).sum()) for p in (poses, odometry))
    if file.name in PATHS_M:
        scans, meters = PATHS_M[file.name]
        assert len(frames) == scans
        assert length == pytest.approx(meters, abs=0.1)
    # the raw odometry of the wheels is within a few percent of the corrected path; its rebasing would add tens
    assert driven == pytest.approx(length, rel=0.05)
    steps = [
        (Transform2D(*u.tolist()).inverse() @ Transform2D(*v.tolist())).inverse() @ (a.odometry.inverse() @ b.odometry)
        for (a, b), (u, v) in zip(itertools.pairwise(frames), itertools.pairwise(poses), strict=True)
    ]
    assert np.median([math.hypot(s.x, s.y) for s in steps]) < 0.15
