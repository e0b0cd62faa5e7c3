"""Scores of mapping: raw logs, pose graphs, and simulated logs whose truth is known.

    python tools/bench/slam.py graphs FOLDER
    python tools/bench/slam.py real FOLDER [--only NAME] [--out DIR]
    python tools/bench/slam.py simulated [--only NAME] [--out DIR] [--variant N]
    python tools/bench/slam.py hours [--hours N] [--only MAP] [--set NAME=VALUE ..]

FOLDER contains raw logs and graphs as described in the README of the shared data (`carmen_raw`). Times are those of the
processor. `simulated` drives two logs on each of ten maps (`--variant`: on other routes with other noise) and exits with 1 if
a false loop was accepted: one whose relative pose is more than 0.5 m or 5 degrees off. `hours` drives the same tour there and
back again (2 scans of 90 beams a second) and prints what each hour costs.
"""

from __future__ import annotations

import argparse
import gzip
import math
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import navstack as nav
from navstack.core import GridGeometry, LaserScan, NavError, OccupancyGrid, Pose2D, Transform2D, normalize_angles
from navstack.localization import LoggedScan
from navstack.logs import open_scan_log
from navstack.map_io import load_map, save_map
from navstack.mapping import Mapper, MapperParams, read_g2o, solve
from navstack.parameters import LidarParams
from navstack.sim import Lidar, OnTrack, Shape, World

OPTIMA = {"manhattanOlson3500": 146.0766, "manhattan": 3549.037, "CSAIL": 40.5551, "MIT": 41.1633, "city10000": 511.985}


# --- raw logs ---------------------------------------------------------------------------------------------------------


def _rows(path: Path) -> Iterator[list[str]]:
    with gzip.open(path, "rt") as file:
        for line in file:
            yield line.split()


def odometry_laser(path: Path) -> Iterator[LoggedScan]:
    """DP-SLAM: pairs of lines `Odometry x y theta` and `Laser n r1 .. rn`, without times."""
    odometry, n = Transform2D(), 0
    for fields in _rows(path):
        if fields and fields[0] == "Odometry":
            odometry = Transform2D(*map(float, fields[1:4]))
        elif fields and fields[0] == "Laser":
            yield _frame(n, 0.5 * n, np.array(fields[2:], np.float32), 8.0, odometry, Transform2D())
            n += 1


def wean(path: Path) -> Iterator[LoggedScan]:
    """Wean Hall: `L x y theta xl yl thetal r1 .. r180 time`, in centimeters."""
    n = 0
    for fields in _rows(path):
        if fields and fields[0] == "L":
            v = np.array(fields[1:], np.float64)
            odometry = Transform2D(v[0] / 100.0, v[1] / 100.0, v[2])
            laser = Transform2D(v[3] / 100.0, v[4] / 100.0, v[5])
            yield _frame(n, v[-1], (v[6:186] / 100.0).astype(np.float32), 79.0, odometry, odometry.inverse() @ laser)
            n += 1


def mines(path: Path) -> Iterator[LoggedScan]:
    """Mines ParisTech: one line a scan with wheel encoders and 682 ranges in millimeters over 240 degrees.

    2000 counts are a turn of the wheel. Published readers write pi / 2000 rad, and then add both wheels without halving the sum.
    """
    odometry, last = Transform2D(), None
    for n, fields in enumerate(_rows(path)):
        v = np.array(fields, np.float64)
        if last is not None:
            left, right = ((v[k] - last[k]) * math.tau / 2000.0 * 0.077 for k in (2, 3))
            turn, ahead = (right - left) / (2.0 * 0.165), 0.5 * (left + right)
            odometry = odometry @ Transform2D(ahead * math.cos(0.5 * turn), ahead * math.sin(0.5 * turn), turn)
        last = v
        ranges = (v[24:706] / 1000.0).astype(np.float32)
        ranges[ranges == 0.0] = np.inf
        scan = LaserScan(ranges, math.radians(-120.0), math.radians(240.0) / 681, 0.02, 5.5, v[0] * 1e-6)
        yield LoggedScan(n, scan, Transform2D(0.145, 0.0, 0.0), odometry, None)


def _frame(
    n: int, stamp: float, ranges: NDArray[np.float32], far: float, odometry: Transform2D, sensor: Transform2D
) -> LoggedScan:
    ranges[ranges >= far] = np.inf
    scan = LaserScan(ranges, -math.pi / 2.0, math.pi / 180.0, 0.02, far, float(stamp))
    return LoggedScan(n, scan, sensor, odometry, None)


LOGS = {
    "mit-csail": ("mit-csail.clf.gz", open_scan_log),
    "dpslam-loop5": ("dpslam-loop5.log.gz", odometry_laser),
    "wean1": ("wean1.log.gz", wean),
    "wean2": ("wean2.log.gz", wean),
    "wean4": ("wean4.log.gz", wean),
    "mines-exp1": ("mines-exp1.dat.gz", mines),
    "mines-exp2": ("mines-exp2.dat.gz", mines),
    "mbicp-zaragoza": ("mbicp-zaragoza.log.gz", open_scan_log),
}


def run(
    frames: Iterable[LoggedScan], params: MapperParams | None = None, *, blind: bool = False
) -> tuple[Mapper, float]:
    """Map the scans; return the mapper and the processor time (s). `blind`: without the odometry."""
    mapper, spent = Mapper(params), 0.0
    for frame in frames:
        began = time.process_time()
        mapper.add_scan(frame.scan.stamp, None if blind else frame.odometry, frame.scan, frame.sensor)
        spent += time.process_time() - began
    began = time.process_time()
    mapper.finish()
    return mapper, spent + time.process_time() - began


def fitted(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> Transform2D:
    """Return the rigid transform of positions (n, 2 or more) with the least squared distances from the truth."""
    a, b = poses[:, :2] - poses[:, :2].mean(0), truth[:, :2] - truth[:, :2].mean(0)
    angle = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    turned = Transform2D(0.0, 0.0, angle).apply_points(poses[:, :2].mean(0)[None])[0]
    x, y = (truth[:, :2].mean(0) - turned).tolist()
    return Transform2D(x, y, angle)


def absolute_error(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    """Return the absolute trajectory error (m, rms) after a rigid fit."""
    moved = fitted(poses, truth).apply_points(np.ascontiguousarray(poses[:, :2]))
    return float(np.sqrt(((moved - truth[:, :2]) ** 2).sum(1).mean()))


def relation_errors(
    poses: NDArray[np.float64], truth: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return translational (m) and rotational (degrees) errors of the relations between consecutive poses."""

    def steps(p: NDArray[np.float64]) -> NDArray[np.float64]:
        d, c, s = np.diff(p, axis=0), np.cos(p[:-1, 2]), np.sin(p[:-1, 2])
        return np.column_stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], d[:, 2]))

    d = steps(poses) - steps(truth)
    return np.hypot(d[:, 0], d[:, 1]), np.degrees(np.abs(normalize_angles(d[:, 2])))


def real(folder: Path, only: str | None, out: Path | None) -> None:
    """Print the table of the raw logs."""
    for name, (file, read) in LOGS.items():
        if (only and only not in name) or not (folder / file).exists():
            continue
        frames = list(read(folder / file))
        run(frames[:100])  # compiles
        for blind in (False, True):
            mapper, spent = run(frames, blind=blind)
            duration = frames[-1].scan.stamp - frames[0].scan.stamp
            accepted = sum(loop.accepted for loop in mapper.loops)
            print(
                f"{name}{' without odometry' if blind else ''}: {len(frames)} scans, {len(mapper.keyframes)} keyframes, "
                f"{mapper.travelled:.1f} m, {accepted} loops of {len(mapper.loops)}, unmatched "
                f"{len(mapper.observations.unmatched)}, {spent:.1f} s, {duration / spent:.0f} times real time"
            )
            reference = folder / f"{name}.reference.txt.gz"
            if reference.exists():
                known = np.loadtxt(reference)
                stamps, poses = mapper.trajectory()
                near = np.abs(stamps[:, None] - known[None, :, 0]).argmin(0)
                m, degrees = relation_errors(poses[near], known[:, 1:])
                print(
                    f"  ATE {absolute_error(poses[near], known[:, 1:]):.3f} m; relations {m.mean():.3f} +- {m.std():.3f} m, "
                    f"{degrees.mean():.2f} +- {degrees.std():.2f} degrees"
                )
            if out is not None:
                save_map(mapper.map(), out / f"{name}{'-blind' if blind else ''}.yaml")


def graphs(folder: Path) -> None:
    """Print the optima of the pose graphs."""
    for name, optimum in OPTIMA.items():
        graph = read_g2o(folder / f"{name}.g2o.gz")
        began = time.process_time()
        found = solve(graph, starts=("rotations",))
        spent = time.process_time() - began
        print(f"{name}: chi2 {found.chi2:.6g}, stated {optimum:g}, {found.iterations} steps, {spent:.2f} s")


# --- simulated logs ---------------------------------------------------------------------------------------------------


def ring(width: float, height: float, corridor: float, doors: float) -> OccupancyGrid:
    """Return a corridor around a block (m) with identical niches every `doors` meters, the same on opposite sides."""
    cell = 0.05
    nx, ny, c = round((width + 4.0) / cell), round((height + 4.0) / cell), round(corridor / cell)
    cells = np.full((ny, nx), 100, np.int8)
    m = round(2.0 / cell)
    cells[m:-m, m:-m] = 0
    cells[m + c : -m - c, m + c : -m - c] = 100
    step, wide, deep = round(doors / cell), round(0.9 / cell), round(0.3 / cell)
    for x in range(m + step // 2, nx - m, step):
        cells[m - deep : m, x : x + wide] = 0
        cells[-m : -m + deep, x : x + wide] = 0
    for y in range(m + step // 2, ny - m, step):
        cells[y : y + wide, m - deep : m] = 0
        cells[y : y + wide, -m : -m + deep] = 0
    return OccupancyGrid(cells, GridGeometry(nx, ny, cell))


def tour(grid: OccupancyGrid, rng: np.random.Generator, length: float) -> NDArray[np.float64]:
    """Return a path (n, 2) through far places of a map and back (m), about as long as asked."""
    from scipy.ndimage import distance_transform_edt, label

    g = grid.geometry
    clear = np.asarray(distance_transform_edt(grid.data == 0)) * g.resolution
    labeled: Any = label(clear > 0.4)
    parts: NDArray[np.int32] = np.asarray(labeled[0])
    largest = np.argmax(np.bincount(parts.ravel())[1:]) + 1
    cells = np.argwhere(parts == largest)
    places = [cells[rng.integers(len(cells))]]
    for _ in range(7):
        far = np.min([np.hypot(*(cells - place).T) for place in places], axis=0)
        places.append(cells[int(np.argmax(far))])
    points = [
        (g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution)
        for iy, ix in np.array(places).tolist()
    ]
    blocked = grid.data != 0
    path: list[NDArray[np.float64]] = []
    total, at, rest, start = 0.0, points[0], points[1:], points[0]
    while total < length:
        rest.sort(key=lambda p: math.dist(p, at))
        target = rest.pop(0) if rest else start
        if not rest and target == start:
            rest = points[1:]
        try:
            plan = nav.plan(
                blocked,
                g.resolution,
                (*at, 0.0),
                (*target, 0.0),
                robot_radius=0.3,
                values="occupied",
                origin=(g.origin_x, g.origin_y),
            )
        except NavError:
            if target == start:
                break
            continue
        leg = np.asarray(plan.path.poses)[:, :2]
        total += float(np.hypot(*np.diff(leg, axis=0).T).sum())
        path.append(leg)
        at = target
    return np.concatenate(path)


def drive(path: NDArray[np.float64], speed: float = 0.6, rate: float = 5.0) -> Iterator[tuple[float, Transform2D]]:
    """Yield times and poses of a robot that follows a path toward a point half a meter ahead, turning in place if it must."""
    gone = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
    s, yaw, t, dt = 0.0, None, 0.0, 1.0 / rate
    while s < gone[-1] - 0.3:
        x, y = (float(np.interp(s, gone, path[:, k])) for k in range(2))
        ahead = [float(np.interp(s + 0.5, gone, path[:, k])) for k in range(2)]
        wanted = math.atan2(ahead[1] - y, ahead[0] - x)
        yaw = wanted if yaw is None else yaw
        error = math.remainder(wanted - yaw, 2.0 * math.pi)
        yaw += max(-1.0, min(1.0, error / dt)) * dt
        yield t, Transform2D(x, y, yaw)
        s += speed * dt * max(0.0, math.cos(error)) if abs(error) < 1.0 else 0.0
        t += dt


def logged(
    grid: OccupancyGrid,
    lidar: LidarParams,
    seed: int,
    *,
    length: float,
    slip: bool,
    people: int,
    rate: float = 5.0,
    duration: float = 0.0,
) -> Iterator[tuple[LoggedScan, Transform2D]]:
    """Yield the scans of a simulated drive with a noisy odometry, and the true poses.

    `rate`: scans per second. `duration` (s): longer than the drive, it goes on back and there again.
    """
    rng = np.random.default_rng(seed)
    path = tour(grid, rng, length)
    if duration > 0.0:
        there = float(np.hypot(*np.diff(path, axis=0).T).sum())
        path = np.concatenate([path, path[::-1]] * math.ceil(0.3 * duration / there))
    walkers = []
    for _ in range(people):
        k = int(rng.integers(0, len(path) - 200)) if len(path) > 200 else 0
        line = path[k : k + 200 : 20] + rng.normal(0.0, 0.2, 2)
        motion = OnTrack(kind="track", points=line.tolist(), speed=0.8, start_offset=float(rng.uniform(0, 10)))
        walkers.append(Shape(pose=[0.0, 0.0, 0.0], radius=0.25, motion=motion))
    world, sensor = World(grid, shapes=walkers), Lidar(lidar, seed=seed, number=0)
    scale, bias = 1.0 + rng.normal(0.0, 0.015), rng.normal(0.0, 0.01)
    odometry, last, slipping = Transform2D(), None, 0
    for n, (t, pose) in enumerate(drive(path, rate=rate)):
        if last is not None:
            step = last.inverse() @ pose
            d = math.hypot(step.x, step.y)
            if slip and rng.random() < 0.01:
                slipping = 3
            lost = 0.5 if slipping > 0 else 1.0
            slipping -= 1
            x = step.x * scale / lost + rng.normal(0.0, 0.03 * d)
            y = step.y + rng.normal(0.0, 0.01 * d)
            turn = step.yaw * (1.0 + rng.normal(0.0, 0.03)) + bias * d + rng.normal(0.0, 0.01 * d + 0.001)
            odometry = odometry @ Transform2D(x, y, turn + (rng.normal(0.0, 0.08) if slipping == 2 else 0.0))
        last = pose
        scan = sensor.scan(world, Pose2D(*pose), n, t)
        assert isinstance(scan, LaserScan)
        yield LoggedScan(n, scan, sensor.mounting, odometry, None), pose


def near_walls(grid: OccupancyGrid, truth: OccupancyGrid, frame: Transform2D) -> float:
    """Return the share of occupied cells of a map that are in or next to an occupied cell of the truth."""
    from scipy.ndimage import binary_dilation

    walls = np.asarray(binary_dilation(truth.data >= 100, np.ones((3, 3))))
    iy, ix = np.nonzero(grid.data >= 100)
    g, t = grid.geometry, truth.geometry
    centers = (g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution)
    points = np.column_stack(centers).astype(np.float64)
    x, y = ((frame.apply_points(points) - [t.origin_x, t.origin_y]) / t.resolution).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < t.nx) & (y < t.ny)
    return float(walls[y[inside], x[inside]].sum()) / max(len(x), 1)


def resampled(grid: OccupancyGrid, cell: float = 0.05) -> OccupancyGrid:
    """Return a map with cells of `cell` meters, if its cells are larger."""
    g = grid.geometry
    factor = round(g.resolution / cell)
    if factor <= 1:
        return grid
    data = np.repeat(np.repeat(grid.data, factor, 0), factor, 1)
    return OccupancyGrid(
        data, GridGeometry(g.nx * factor, g.ny * factor, g.resolution / factor, g.origin_x, g.origin_y)
    )


RUNS = [
    # map, field of view (degrees), range (m), beams, range noise (m), length (m), slip, people
    ("office", 360, 12, 360, 0.01, 120, False, 0),
    ("office", 57, 4, 160, 0.02, 120, True, 0),
    ("clinic", 270, 20, 540, 0.02, 150, True, 4),
    ("clinic", 180, 8, 180, 0.03, 150, False, 0),
    ("warehouse", 360, 30, 720, 0.03, 150, True, 4),
    ("warehouse", 180, 10, 361, 0.02, 150, True, 0),
    ("maze", 270, 10, 270, 0.02, 150, True, 0),
    ("maze", 57, 6, 160, 0.01, 150, False, 0),
    ("symmetric", 360, 12, 360, 0.02, 160, True, 0),
    ("symmetric", 180, 8, 180, 0.02, 160, False, 0),
    ("long", 270, 30, 540, 0.03, 260, True, 4),
    ("long", 360, 8, 360, 0.02, 260, False, 0),
    ("identical", 360, 10, 360, 0.01, 200, True, 0),
    ("identical", 57, 8, 160, 0.02, 200, False, 0),
    ("intel", 180, 30, 180, 0.02, 200, True, 4),
    ("intel", 360, 12, 360, 0.03, 200, False, 0),
    ("hospital", 270, 20, 540, 0.02, 200, True, 0),
    ("hospital", 180, 8, 180, 0.01, 150, False, 4),
    ("willow", 270, 30, 540, 0.02, 250, True, 4),
    ("willow", 360, 12, 360, 0.02, 250, True, 0),
]


def world_map(name: str, shared: Path) -> OccupancyGrid | None:
    """Return one of the maps, made, packaged or shared; None for a shared one that is not there."""
    if name == "symmetric":
        return ring(30.0, 20.0, 2.0, 2.5)
    if name == "long":
        return ring(60.0, 45.0, 2.5, 5.0)
    if name == "identical":
        return ring(40.0, 12.0, 1.8, 2.0)
    folders = {
        "intel": "bwi_common__intel",
        "hospital": "turtlebot_simulator__hospital_section",
        "willow": "navigation_tutorials__willow-full-0.10",
    }
    if name in folders:
        files = sorted((shared / "maps" / folders[name]).glob("*.yaml"))
        return resampled(load_map(files[0])) if files else None
    return resampled(nav.load_map(name))


def simulated(shared: Path, only: str | None, out: Path | None, variant: int = 0) -> int:
    """Print the table of the simulated logs; return the number of false loops. `variant`: another draw of routes and noise."""
    false_loops, good, count = 0, 0, 0
    for number, (name, fov, reach, beams, noise, length, slip, people) in enumerate(RUNS):
        label = f"{name}-{fov}"
        truth = world_map(name, shared) if not only or only in label else None
        if truth is None:
            continue
        lidar = LidarParams(
            x=0.1, beams=beams, fov=math.radians(fov), range_min=0.05, range_max=reach, range_noise=noise
        )
        log = list(logged(truth, lidar, number + len(RUNS) * variant, length=length, slip=slip, people=people))
        known = np.array([pose for _, pose in log])
        for frame, _ in log:
            _ = frame.scan.ranges  # measured now, so that the time is that of mapping
        mapper, spent = run(frame for frame, _ in log)
        stamps, poses = mapper.trajectory()
        known = known[np.searchsorted([frame.scan.stamp for frame, _ in log], stamps)]
        by_stamp = dict(zip(stamps.tolist(), known.tolist(), strict=True))
        wrong = 0
        for loop in mapper.loops:
            a, b = (Transform2D(*by_stamp[t]) for t in (loop.seen_at, loop.stamp))
            error = loop.measured.inverse() @ (a.inverse() @ b)
            bad = math.hypot(error.x, error.y) > 0.5 or abs(error.yaw) > 0.09
            if loop.accepted and bad:
                wrong += 1
                print(f"  FALSE by {math.hypot(error.x, error.y):.2f} m {math.degrees(error.yaw):.1f} degrees: {loop}")
        grid = mapper.map()
        share = near_walls(grid, truth, fitted(poses, known))
        accepted = sum(loop.accepted for loop in mapper.loops)
        print(
            f"{label:>14} {reach:2d} m: {len(log)} scans, {mapper.travelled:.0f} m, ATE {absolute_error(poses, known):.3f} m, "
            f"walls {share:.1%}, loops {accepted} of {len(mapper.loops)}, false {wrong}, "
            f"unmatched {len(mapper.observations.unmatched)}, {stamps[-1] / spent:.0f} times real time",
            flush=True,
        )
        false_loops, good, count = false_loops + wrong, good + (share >= 0.95), count + 1
        if out is not None:
            save_map(grid, out / f"{label}.yaml")
    print(f"{count} logs: {good} with 95 % of the wall cells within one cell of the truth; {false_loops} false loops")
    return false_loops


def long_run(shared: Path, name: str, hours: float, params: MapperParams) -> None:
    """Print time, memory and size of a mapping by the hour of a log."""
    truth = world_map(name, shared)
    assert truth is not None
    lidar = LidarParams(x=0.1, beams=90, fov=math.radians(270.0), range_min=0.05, range_max=12.0, range_noise=0.02)
    mapper, spent, due, wrong = Mapper(params), 0.0, 0.25, []
    start: Transform2D | None = None
    for frame, pose in logged(truth, lidar, 1, length=100.0, slip=True, people=0, rate=2.0, duration=3600.0 * hours):
        _ = frame.scan.ranges  # measured now, so that the time is that of mapping
        began = time.process_time()
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan, frame.sensor)
        spent += time.process_time() - began
        start = start or pose
        seen, true = mapper.pose, start.inverse() @ pose
        assert seen is not None
        wrong.append(math.hypot(seen.x - true.x, seen.y - true.y))
        if frame.scan.stamp >= 3600.0 * due or frame.scan.stamp >= 3600.0 * hours:
            with Path("/proc/self/statm").open() as file:
                resident = int(file.read().split()[1]) * 4096 / 1e6
            print(
                f"{frame.scan.stamp / 3600.0:5.2f} h: {mapper.travelled:.0f} m, {mapper.followed:.0f} m followed, "
                f"{len(mapper.keyframes)} keyframes, {sum(loop.accepted for loop in mapper.loops)} of {len(mapper.loops)} "
                f"loops, {spent:.1f} s, {resident:.0f} MB, error {np.mean(wrong):.3f} m, at most {max(wrong):.3f} m",
                flush=True,
            )
            due, spent, wrong = due + (0.25 if due < 1.0 else 0.5), 0.0, []
        if frame.scan.stamp >= 3600.0 * hours:
            break
    began = time.process_time()
    mapper.finish()
    print(f"refinement: {time.process_time() - began:.1f} s")
    _, poses = mapper.trajectory()
    frame_of_truth = Transform2D(*start) if start is not None else Transform2D()
    print(f"walls {near_walls(mapper.map(), truth, frame_of_truth):.1%}, {len(poses)} poses in the track")


def main() -> int:
    """Run a study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=("graphs", "real", "simulated", "hours"))
    parser.add_argument("folder", nargs="?", type=Path, default=Path("../shared/data/carmen_raw"))
    parser.add_argument("--only")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--variant", type=int, default=0)
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    arguments = parser.parse_args()
    if arguments.out:
        arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.study == "graphs":
        graphs(arguments.folder)
    elif arguments.study == "real":
        real(arguments.folder, arguments.only, arguments.out)
    elif arguments.study == "hours":
        params = MapperParams.model_validate_strings(dict(text.split("=", 1) for text in arguments.set))
        long_run(arguments.folder.parent, arguments.only or "office", arguments.hours, params)
    else:
        return min(simulated(arguments.folder.parent, arguments.only, arguments.out, arguments.variant), 1)
    return 0


if __name__ == "__main__":
    sys.exit(main())
