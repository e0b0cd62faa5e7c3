"""The mapper: its track, loops, map, report, and inputs that are defective."""

import dataclasses
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from navstack.core import LaserScan, LogError, Transform2D
from navstack.localization import LoggedScan
from navstack.mapping import Mapper, MapperParams, load_session, report_document, save_session, solve
from navstack.mapping.loops import Loop
from tests.mapping.simulated import lap

pytestmark = pytest.mark.slow


def mapped(*, blind: bool = False, params: MapperParams | None = None, count: int | None = None) -> Mapper:
    """Return the mapper after a lap."""
    mapper = Mapper(params)
    for frame, _ in lap()[:count]:
        mapper.add_scan(frame.scan.stamp, None if blind else frame.odometry, frame.scan)
    mapper.finish()
    return mapper


def worst_error(mapper: Mapper) -> float:
    """Return the largest distance of the track from the truth, which begins where the map does (m)."""
    start = lap()[0][1]
    truth = start.inverse().apply_poses(np.array([pose for _, pose in lap()]))
    stamps, poses = mapper.trajectory()
    row = np.searchsorted([frame.scan.stamp for frame, _ in lap()], stamps)
    return float(np.hypot(*(poses - truth[row])[:, :2].T).max())


@pytest.fixture(scope="module")
def finished() -> Mapper:
    return mapped()


def test_a_lap_is_closed_and_its_track_is_the_truth(finished: Mapper) -> None:
    drift = (lap()[0][1].inverse() @ lap()[-1][1]).inverse() @ lap()[-1][0].odometry
    assert math.hypot(drift.x, drift.y) > 1.0
    assert worst_error(finished) < 0.1
    assert sum(loop.accepted for loop in finished.loops) >= 2
    for loop in finished.loops:
        assert loop.reason
        assert str(loop).startswith("accepted" if loop.accepted else "rejected")


def test_accepted_loops_are_true(finished: Mapper) -> None:
    truth = {frame.scan.stamp: pose for frame, pose in lap()}
    for loop in finished.loops:
        if loop.accepted:
            error = loop.measured.inverse() @ (truth[loop.seen_at].inverse() @ truth[loop.stamp])
            assert math.hypot(error.x, error.y) < 0.1
            assert abs(error.yaw) < 0.03


def test_scans_alone_suffice_where_they_overlap() -> None:
    assert worst_error(mapped(blind=True)) < 0.2


def test_scans_alone_suffice_at_uneven_times() -> None:
    mapper = Mapper()
    rng, stamp, truth = np.random.default_rng(3), 0.0, []
    for frame, pose in lap():
        stamp += float(rng.choice([0.07, 0.14, 0.15, 0.29]))
        mapper.add_scan(stamp, None, frame.scan)
        truth.append(lap()[0][1].inverse() @ pose)
    mapper.finish()
    _, poses = mapper.trajectory()
    assert float(np.hypot(*(poses - np.array(truth))[:, :2].T).max()) < 0.1
    assert not mapper.observations.lost


@pytest.mark.parametrize("first", [40, 60, 100])
def test_without_odometry_a_gap_is_never_passed_in_silence(first: int, tmp_path: Path) -> None:
    """The sides of the block look alike, so a place after a gap may be taken for another one."""
    mapper = Mapper()
    for n, (frame, _) in enumerate(lap()):
        if not first <= n < first + 40:
            mapper.add_scan(frame.scan.stamp, None, frame.scan)
    mapper.finish()
    assert mapper.observations.lost[0].known_until == pytest.approx(0.2 * (first - 1))
    words = "tracking lost at", "no odometry tells how the robot moved from"
    lines = [line for line in report_document(mapper)["lines"] if line.startswith(words)]
    assert f"{0.2 * (first - 1):.1f}" in lines[0]
    assert load_session(save_session(mapper, tmp_path / "a.npz")).observations == mapper.observations


def test_scans_that_fit_nothing_are_not_placed_without_odometry_until_they_fit_again() -> None:
    mapper, scans = Mapper(), [frame.scan for frame, _ in lap()]
    elsewhere = dataclasses.replace(scans[0], ranges=(1.0 + 0.3 * np.sin(np.arange(181.0))).astype(np.float32))
    for n, scan in enumerate(scans):
        mapper.add_scan(0.2 * n, None, elsewhere if 100 <= n < 105 else scan)
    mapper.finish()
    (lost,) = mapper.observations.lost
    assert (lost.scans, lost.until) == (5, pytest.approx(20.8))
    stamps, poses = mapper.trajectory()
    truth = lap()[0][1].inverse().apply_poses(np.array([pose for _, pose in lap()]))
    assert len(stamps) == len(scans) - 5
    assert float(np.hypot(*(poses - truth[np.rint(stamps / 0.2).astype(int)])[:, :2].T).max()) < 0.2
    assert "5 scans to 20.8 s are not in the map" in "\n".join(report_document(mapper)["lines"])


def test_the_map_has_the_walls_where_they_are(finished: Mapper) -> None:
    import shapely

    from tests.mapping.simulated import WALLS

    grid = finished.map()
    iy, ix = np.nonzero(grid.data == 100)
    g = grid.geometry
    points = np.column_stack((g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution))
    world = lap()[0][1].apply_points(points.astype(np.float64))
    away = shapely.distance(shapely.points(world), WALLS)
    # within one cell of a wall: half its diagonal, and one cell
    assert np.mean(away < 1.5 * g.resolution) > 0.97


def test_the_same_scans_give_the_same_bits_on_any_number_of_threads(finished: Mapper, tmp_path: Path) -> None:
    code = (
        "import hashlib\n"
        "from tests.mapping.test_mapper import mapped\n"
        "m = mapped()\n"
        "print(hashlib.sha256(m.graph.poses.tobytes() + m.map().data.tobytes()).hexdigest())"
    )
    import hashlib

    here = hashlib.sha256(finished.graph.poses.tobytes() + finished.map().data.tobytes()).hexdigest()
    import os

    root = Path(__file__).parents[2]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(root)}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=root, check=True
    )
    assert run.stdout.strip() == here


def test_a_mapping_goes_on_to_the_same_bits_from_its_file(finished: Mapper, tmp_path: Path) -> None:
    first = Mapper()
    for frame, _ in lap()[:150]:
        first.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    again = load_session(save_session(first, tmp_path / "map.mapping.npz"))
    for frame, _ in lap()[150:]:
        again.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    again.finish()
    assert np.array_equal(again.graph.poses, finished.graph.poses)
    assert [loop.reason for loop in again.loops] == [loop.reason for loop in finished.loops]
    assert np.array_equal(again.trajectory()[1], finished.trajectory()[1])


def test_a_finished_mapping_goes_on_as_if_it_had_not_been_finished(finished: Mapper, tmp_path: Path) -> None:
    first = Mapper()
    for frame, _ in lap()[:150]:
        first.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    first.finish()
    assert first.final_graph is not None
    refined, loops = first.graph.poses.copy(), len(first.loops)
    again = load_session(save_session(first, tmp_path / "map.mapping.npz"))
    assert np.array_equal(again.graph.poses, refined)
    for each in (first, again):
        each.finish()
        assert np.array_equal(each.graph.poses, refined)
        assert len(each.loops) == loops
        for frame, _ in lap()[150:]:
            each.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
        each.finish()
        assert np.array_equal(each.graph.poses, finished.graph.poses)
        assert [loop.reason for loop in each.loops] == [loop.reason for loop in finished.loops]


@pytest.fixture
def before_a_loop() -> tuple[Mapper, Loop, list[LoggedScan]]:
    """A mapper that has just accepted its first loop, that loop, and the scans that follow."""
    mapper, rest = Mapper(), [frame for frame, _ in lap()]
    while True:
        frame = rest.pop(0)
        loops = mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan).loops
        if any(loop.accepted for loop in loops):
            return mapper, loops[-1], rest


def test_wrong_loops_that_wait_do_not_take_later_ones_with_them(
    before_a_loop: tuple[Mapper, Loop, list[LoggedScan]], tmp_path: Path
) -> None:
    mapper, first, rest = before_a_loop
    poses = [Transform2D(*pose) for pose in mapper.graph.poses.tolist()]
    # 0.3 m of the way between keyframes 5 and 7 would be missing
    wrong = [
        dataclasses.replace(first, keyframe=j, place=i, correction=(0.0, 0.0, 0.0), in_graph=False, measured=measured)
        for i in range(2, 6)
        for j in range(7, 11)
        for measured in [poses[i].inverse() @ Transform2D(-0.3, 0.0, 0.0) @ poses[j]]
    ]
    mapper.pending += wrong
    mapper._accept(wrong)  # pyright: ignore[reportPrivateUsage]
    assert all(loop.accepted for loop in wrong)  # it waits
    mapper = load_session(save_session(mapper, tmp_path / "map.mapping.npz"))
    for frame in rest:
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    mapper.finish()
    made = [loop for loop in mapper.loops if loop.keyframe <= 10]
    assert len(made) == len(wrong)
    for loop in made:
        assert not loop.accepted
        assert "a match along the way would be off by" in loop.reason
    assert not any(edge.is_loop and edge.j <= 10 for edge in mapper.graph.edges)
    assert sum(loop.accepted for loop in mapper.loops if loop.keyframe > first.keyframe) >= 3
    assert worst_error(mapper) < 0.1


def test_a_loop_that_the_final_graph_contradicts_is_withdrawn_until_more_scans_come() -> None:
    mapper, rest = Mapper(), [frame for frame, _ in lap()]
    while sum(loop.accepted for loop in mapper.loops) < 8:
        frame = rest.pop(0)
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    loop = next(loop for loop in mapper.loops if loop.accepted)
    wrong = loop.measured @ Transform2D(0.4, 0.0, 0.0)
    for n, edge in enumerate(mapper.graph.edges):
        if edge.is_loop and (edge.i, edge.j) == (loop.place, loop.keyframe):
            mapper.graph.edges[n] = edge._replace(measured=wrong)
    before = [str(each) for each in mapper.loops]
    mapper.finish()
    assert not loop.accepted and loop.reason.startswith("the final graph is off by ")
    assert str(loop).startswith("rejected")
    assert mapper.final_graph is not None
    assert not any(
        edge.is_loop and (edge.i, edge.j) == (loop.place, loop.keyframe) for edge in mapper.final_graph.edges
    )
    assert sum(each.accepted for each in mapper.loops) >= 6
    assert worst_error(mapper) < 0.1
    mapper.add_scan(rest[0].scan.stamp, rest[0].odometry, rest[0].scan)
    assert loop.accepted and len(before) <= len(mapper.loops)


def test_a_wrong_match_does_not_reject_loops_elsewhere() -> None:
    mapper, rest = Mapper(), [frame for frame, _ in lap()]
    while len(mapper.keyframes) < 12:
        frame = rest.pop(0)
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    x, y, yaw = mapper.graph.edges[5].measured
    contradicting = mapper.graph.edges[5]._replace(measured=Transform2D(x + 0.3, y, yaw))
    mapper.graph.edges.append(contradicting)
    mapper._links.extend((5, 6, x))  # pyright: ignore[reportPrivateUsage]
    mapper.graph.poses[:] = solve(mapper.graph, starts=("poses",)).poses
    assert mapper.graph.edge_chi2()[5] > 50.0
    for frame in rest:
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    assert not any("would be off" in loop.reason for loop in mapper.loops)
    assert sum(loop.accepted and loop.place < 10 for loop in mapper.loops) >= 6  # those that close the lap


def test_more_laps_need_few_more_keyframes_and_go_on_from_a_file(tmp_path: Path) -> None:
    mapper = again = Mapper(MapperParams(keyframes_per_place=2))
    count: list[int] = []
    worst = 0.0
    drive = lap(3.0)
    for n, (frame, pose) in enumerate(drive):
        made = mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
        true = drive[0][1].inverse() @ pose
        assert mapper.pose is not None
        worst = max(worst, math.hypot(mapper.pose.x - true.x, mapper.pose.y - true.y))
        count.append(len(mapper.keyframes))
        if n == len(drive) * 5 // 6:
            assert made.keyframe is None
            again = load_session(save_session(mapper, tmp_path / "map.mapping.npz"))
    laps = np.diff(count[:: len(drive) // 3 - 1])
    assert laps[-1] < 0.1 * laps[0]
    assert worst < 0.1
    assert mapper.followed > 0.4 * mapper.travelled
    for frame, _ in drive[len(drive) * 5 // 6 + 1 :]:
        again.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    for each in (mapper, again):
        each.finish()
    assert np.array_equal(again.trajectory()[1], mapper.trajectory()[1])
    truth = drive[0][1].inverse().apply_poses(np.array([pose for _, pose in drive]))
    assert np.hypot(*(mapper.trajectory()[1] - truth)[:, :2].T).max() < 0.1
    lines = report_document(mapper)["lines"]
    assert any("needed no new keyframes" in line for line in lines)
    # the odometry of the laps: 3 % too long, turns 2 % too large
    assert any("multiply distances by 0.97" in line and "turns by 0.9" in line for line in lines)


def test_files_that_are_no_mapping_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "map.mapping.npz"
    with pytest.raises(LogError, match="cannot read"):
        load_session(file)
    file.write_bytes(b"PK\3\4 no")
    with pytest.raises(LogError, match="no file of a mapping"):
        load_session(file)
    np.savez(file, ranges=np.zeros(3))
    with pytest.raises(LogError, match="no file of a mapping"):
        load_session(file)


# --- hostile input ----------------------------------------------------------------------------------------------------


def test_defective_scans_are_counted_and_change_nothing(finished: Mapper) -> None:
    mapper = Mapper()
    bad = np.full(181, np.nan, np.float32)
    for n, (frame, _) in enumerate(lap()):
        scan = frame.scan
        mapper.add_scan(scan.stamp, frame.odometry, scan)
        if n % 40 == 5:
            assert mapper.add_scan(scan.stamp, frame.odometry, scan).rejected
            assert mapper.add_scan(scan.stamp - 3.0, frame.odometry, scan).rejected
            assert mapper.add_scan(math.nan, frame.odometry, scan).rejected
            assert mapper.add_scan(scan.stamp + 0.01, Transform2D(math.nan, 0.0, 0.0), scan).rejected
    mapper.finish()
    assert np.array_equal(mapper.graph.poses, finished.graph.poses)
    lines = " ".join(report_document(mapper)["lines"])
    assert "its time is not after that of the scan before" in lines
    assert "its odometry is not finite" in lines
    empty = Mapper()
    assert "fewer than" in empty.add_scan(0.0, None, dataclasses.replace(lap()[0][0].scan, ranges=bad)).rejected
    assert "fewer than" in empty.add_scan(1.0, None, LaserScan(np.ones(1, np.float32), 0.0, 0.1, 0.0, 9.0)).rejected
    empty.finish()
    assert report_document(empty)["keyframes"] == 0
    with pytest.raises(LogError, match=r"no scan could be used, so there is no map \(2 scans: fewer than"):
        empty.map()


def test_a_jump_of_the_odometry_is_reported_and_not_believed() -> None:
    mapper = Mapper()
    jump = Transform2D(5.0, -3.0, 1.0)
    for n, (frame, _) in enumerate(lap()):
        mapper.add_scan(frame.scan.stamp, jump @ frame.odometry if n > 100 else frame.odometry, frame.scan)
    mapper.finish()
    assert worst_error(mapper) < 0.2
    assert any("odometry jumps" in line for line in report_document(mapper)["lines"])


def test_a_gap_is_reported() -> None:
    mapper = Mapper()
    for n, (frame, _) in enumerate(lap()[:120]):
        mapper.add_scan(frame.scan.stamp + (30.0 if n >= 60 else 0.0), frame.odometry, frame.scan)
    mapper.finish()
    assert any(line.startswith("gap: no scan from") for line in report_document(mapper)["lines"])


@pytest.mark.parametrize("turned", [0.5, -1.2, math.pi])
def test_a_laser_at_another_angle_than_stated_is_found(turned: float) -> None:
    mapper = Mapper()
    for frame, _ in lap()[:130]:
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan, Transform2D(0.0, 0.0, turned))
    mapper.finish()
    document = report_document(mapper)
    assert abs(math.remainder(document["mounting"]["yaw"] + turned, math.tau)) < 0.1
    assert any("the laser is mounted at another angle" in line for line in document["lines"])


def test_a_laser_as_stated_is_not_reported(finished: Mapper) -> None:
    assert not [line for line in report_document(finished)["lines"] if line.startswith("the laser")]


def test_a_laser_that_is_upside_down_is_found() -> None:
    mapper = Mapper()
    for frame, _ in lap():
        mirrored = np.ascontiguousarray(frame.scan.ranges[::-1])
        mapper.add_scan(frame.scan.stamp, frame.odometry, dataclasses.replace(frame.scan, ranges=mirrored))
    mapper.finish()
    assert any("turns the wrong way" in line for line in report_document(mapper)["lines"])
