"""Bags as drives: odometry and reference at the stamps of the scans, frames, topics, the commands on them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from navstack.cli.app import run
from navstack.core import LogError, Transform2D
from navstack.localization import LoggedScan, scan_beams
from navstack.logs.scan_log import ScanLog, ScanLogOptions, logged_scans
from navstack.logs.scan_log_formats import open_scan_log
from tests.localization.rooms import rooms, scan_from
from tests.logs.bag_files import SENSOR, START_NS, STEP_S, odometry_of, write_bag
from tests.logs.carmen_files import circle

COUNT = 14
MOUNTED = ScanLogOptions(mountings={"laser": (0.1, 0.05, 0.2, 0.3)})


@pytest.fixture(scope="module")
def truths() -> list[Transform2D]:
    return circle(Transform2D(1.0, 4.5, 0.2), COUNT)


@pytest.fixture(scope="module")
def bag(truths: list[Transform2D], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "drive.bag", rooms(), truths)


def assert_poses(frames: list[LoggedScan], truths: list[Transform2D]) -> None:
    expected = odometry_of(truths, drift=0.02)
    assert len(frames) == len(truths)
    for i, (frame, odometry, truth) in enumerate(zip(frames, expected, truths, strict=True)):
        assert frame.scan.stamp == pytest.approx(i * STEP_S, abs=1e-9)
        assert tuple(frame.odometry)[:2] == pytest.approx(tuple(odometry)[:2], abs=1e-9)
        assert math.remainder(frame.odometry.yaw - odometry.yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
        if frame.reference is not None:
            assert tuple(frame.reference)[:2] == pytest.approx(tuple(truth)[:2], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_poses_at_the_scans_and_an_upside_down_lidar(suffix: str, truths: list[Transform2D], tmp_path: Path) -> None:
    drive: ScanLog = open_scan_log(write_bag(tmp_path / f"drive{suffix}", rooms(), truths))
    frames = list(logged_scans(drive))
    assert_poses(frames, truths)
    assert all(frame.reference is not None for frame in frames)
    assert drive.epoch == pytest.approx(START_NS / 1e9)
    assert drive.notes == ["the reference is /base_pose_ground_truth"]
    assert not drive.problems
    grid = drive.map
    assert grid is not None and np.array_equal(grid.data, rooms().data)
    for frame, truth in zip(frames, truths, strict=True):
        expected = scan_beams(scan_from(rooms(), truth, sensor=SENSOR, reach=20.0), SENSOR, 20.0).ends
        found = scan_beams(frame.scan, frame.sensor, 20.0).ends
        # the fields of the scans are in the bag in double precision
        assert np.abs(np.sort(found, axis=0) - np.sort(expected, axis=0)).max() < 2e-6


def test_odometry_from_its_topic_and_a_mounting_by_hand(truths: list[Transform2D], tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", rooms(), truths, tf=False, static=False, truth=False)
    with pytest.raises(LogError, match="--mount laser=X,Y,Z,YAW"):
        list(open_scan_log(path))
    frames = list(logged_scans(open_scan_log(path, MOUNTED)))
    assert_poses(frames, truths)
    assert tuple(frames[0].sensor) == pytest.approx((0.1, 0.05, 0.3))
    assert all(frame.reference is None for frame in frames)


def test_the_localization_in_the_log_is_the_reference_if_there_is_no_truth(
    truths: list[Transform2D], tmp_path: Path
) -> None:
    path = write_bag(tmp_path / "drive.mcap", rooms(), truths, truth=False, localized=True)
    drive = open_scan_log(path)
    frames = list(logged_scans(drive))
    assert_poses(frames, truths)
    assert all(frame.reference is not None for frame in frames)
    assert "localization in the log" in drive.notes[0]
    none = open_scan_log(path, ScanLogOptions({"reference": "none"}))
    assert all(frame.reference is None for frame in logged_scans(none))


def test_a_part_of_the_log(bag: Path) -> None:
    part = list(logged_scans(open_scan_log(bag, ScanLogOptions(start=1.0, end=3.25))))
    assert [frame.scan.stamp for frame in part] == pytest.approx([1.0, 1.5, 2.0, 2.5, 3.0])


def test_topics_that_are_missing_or_in_doubt(truths: list[Transform2D], tmp_path: Path) -> None:
    path = write_bag(tmp_path / "two.mcap", rooms(), truths[:3], scan_topics=("/front", "/rear"))
    with pytest.raises(LogError, match="several topics of LaserScan: /front, /rear; name one with --topic scan=NAME"):
        open_scan_log(path)
    assert len(list(logged_scans(open_scan_log(path, ScanLogOptions({"scan": "rear"}))))) == 3
    with pytest.raises(LogError, match="no topic /side of LaserScan for scan; those it has: /front, /rear"):
        open_scan_log(path, ScanLogOptions({"scan": "side"}))
    with pytest.raises(LogError, match="no topic /amcl_pose of"):
        open_scan_log(path, ScanLogOptions({"scan": "rear", "reference": "/amcl_pose"}))
    alone = write_bag(tmp_path / "scans.mcap", rooms(), truths[:3], tf=False, truth=False, scan_topics=("/s",))
    with pytest.raises(LogError, match="no topic /wheel of Odometry for odom"):
        open_scan_log(alone, ScanLogOptions({"odom": "wheel"}))
    assert "the log has no /scan; its only LaserScan /s is used for it" in open_scan_log(alone, MOUNTED).notes


@pytest.mark.slow
def test_the_commands_on_a_bag(
    bag: Path, truths: list[Transform2D], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    relations = tmp_path / "drive.relations"
    lines = ["# known relations"]
    for i in range(0, COUNT - 3, 3):
        step = truths[i].inverse() @ truths[i + 3]
        stamps = [START_NS / 1e9 + STEP_S * k for k in (i, i + 3)]
        lines.append(f"{stamps[0]:.6f} {stamps[1]:.6f} {step.x:.9f} {step.y:.9f} 0 0 0 {step.yaw:.9f}")
    relations.write_text("\n".join(lines), encoding="utf-8")
    out = tmp_path / "out"
    line = ["localize", str(bag), "--relations", str(relations), "--out", str(out), "--versus", "method=amcl_only"]
    assert run([*line, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(document["tracks"]) == ["scan_matching", "amcl_only"]
    for name in document["tracks"]:
        track = document["tracks"][name]
        assert track["scans"] == COUNT
        assert track["ate"]["position_m"]["max"] < 0.3
        assert track["relations_file"]["position_m"]["count"] == 4
        assert track["relations_file"]["interpolated"] == track["relations_file"]["outside"] == 0
        assert track["relations_file"]["position_m"]["max"] < 0.4
    assert {"trajectory.csv", "trajectory_versus.csv"} < {path.name for path in out.iterdir()}
    assert run(["map", "from-log", str(bag), "--out", str(tmp_path / "made.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scans"] == COUNT
    wrong = [
        (["localize", str(bag), "--topic", "scans=/scan"], "the names are scan, odom and map"),
        (["localize", str(bag), "--topic", "scan"], "give NAME=TOPIC"),
        (["localize", str(bag), "--relations", str(bag)], "binary"),
        (["localize", str(bag), "--params", "turtlebot"], "no section amcl"),
    ]
    for command, named in wrong:
        assert run(command) == 2, command
        assert named in " ".join(capsys.readouterr().err.split()), command


@pytest.mark.parametrize("poses", ["tf", "/amcl_pose", "/base_pose_ground_truth"])
def test_scans_and_poses_suffice_for_a_map(poses: str, truths: list[Transform2D], tmp_path: Path) -> None:
    """A log without odometry: the pose of the base in the map by /tf, by a topic of a localization, by the truth."""
    path = write_bag(tmp_path / "poses.bag", rooms(), truths, tf=False, truth=False, odometry=False, poses=poses)
    suffices = ScanLogOptions(poses_suffice=True)
    drive = open_scan_log(path, suffices)
    frames = list(logged_scans(drive))
    assert len(frames) >= len(truths) - 1 and not drive.problems
    for frame in frames:
        truth = truths[round(frame.scan.stamp / STEP_S)]
        assert frame.reference is not None
        assert tuple(frame.reference)[:2] == pytest.approx(tuple(truth)[:2], abs=1e-6)
    where = "/tf" if poses == "tf" else poses
    assert f"the log has no odometry; the poses of {where} are used" in drive.notes
    with pytest.raises(LogError, match="has no odometry"):
        open_scan_log(path)


def test_scans_alone_do_not_suffice_for_a_map(truths: list[Transform2D], tmp_path: Path) -> None:
    path = write_bag(tmp_path / "scans.bag", rooms(), truths[:3], tf=False, truth=False, odometry=False)
    with pytest.raises(LogError, match=r"has no odometry.*nor poses of the robot: give a topic with --reference TOPIC"):
        open_scan_log(path, ScanLogOptions(poses_suffice=True))
