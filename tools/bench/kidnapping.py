"""Kidnappings: how soon they are noticed, how often the robot finds itself again, and how often it is lost without reason.

    python tools/bench/kidnapping.py [--count N] [--seconds S] [--hours H] [--laser lidar180] [--seed N]

The drives are those of golden_ros1. A kidnapping: the robot follows a drive with its true pose as start, then is at another
place of the same or another drive of the map, at least 2 m away, while its odometry goes on without a step. Noticed: the
localizer says "lost" (or has already found the new place). Recovered: within 0.5 m of the truth at the end, not lost. Without
kidnapping, the drives are followed again and again, each time with other noise of the odometry, until `--hours` have passed.
The settings of the detection were chosen with seeds from 7000 on; measure with others.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from global_search import FOLDER, WRONG_M, load_drive, load_grid, scan_of

from navstack.core import Pose2D, Transform2D
from navstack.localization import Amcl
from navstack.localization.searching import SearchingLocalizer
from navstack.parameters import AmclParams

BEFORE_S = 10.0
Drives = dict[str, dict[str, Any]]


def parameters() -> AmclParams:
    """Those of the recorded runs of the real amcl."""
    return AmclParams(
        laser_max_beams=60,
        min_particles=500,
        max_particles=3000,
        kld_err=0.05,
        laser_z_hit=0.5,
        laser_z_short=0.05,
        laser_z_max=0.05,
        laser_z_rand=0.5,
        update_min_d=0.25,
        update_min_a=0.2,
        resample_interval=1,
    )


def steps_of(drive: dict[str, Any]) -> list[Transform2D]:
    """The motions between the scans, by the odometry."""
    poses = [Transform2D(*row) for row in drive["odom"].tolist()]
    return [Transform2D(), *(a.inverse() @ b for a, b in itertools.pairwise(poses))]


def start(drive: dict[str, Any], grid: Any, k: int, seed: int) -> SearchingLocalizer:
    """A localizer at the truth of scan `k`."""
    localizer = SearchingLocalizer(Amcl(parameters(), seed=seed))
    localizer.set_map(grid)
    x, y, yaw = drive["truth"][k].tolist()
    localizer.set_pose(Pose2D(x + 0.1, y - 0.1, yaw + 0.05), np.diag([0.04, 0.04, 0.02]), math.inf)
    return localizer


def one_kidnapping(
    drives: Drives, grid: Any, names: tuple[str, str], at: tuple[int, int], options: argparse.Namespace, seed: int
) -> tuple[float | None, float | None, bool]:
    """(seconds until noticed, seconds until recovered, whether recovered at the end)."""
    first, second = drives[names[0]], drives[names[1]]
    localizer = start(first, grid, at[0], seed)
    odometry, clock = Transform2D(), 0.0
    moves = steps_of(first)
    for k in range(at[0], at[0] + round(BEFORE_S / 0.2)):
        odometry = odometry @ moves[k]
        clock += 0.2
        scan, sensor = scan_of(first, options.laser, k)
        localizer.update(odometry, _at(scan, clock), sensor)
    moves, noticed, recovered, good = steps_of(second), None, None, False
    jumps = len(localizer.jumps)
    for n, k in enumerate(range(at[1], min(at[1] + round(options.seconds / 0.2), len(moves) - 1))):
        odometry = odometry @ (moves[k] if n else Transform2D())
        clock += 0.2
        scan, sensor = scan_of(second, options.laser, k)
        localizer.update(odometry, _at(scan, clock), sensor)
        estimate = localizer.estimate
        if noticed is None and (localizer.lost or len(localizer.jumps) > jumps):
            noticed = (n + 1) * 0.2
        if estimate is not None:
            pose = estimate.map_to_odom @ odometry
            x, y = second["truth"][k, :2].tolist()
            good = math.hypot(pose.x - x, pose.y - y) < WRONG_M and not localizer.lost
            recovered = (recovered or (n + 1) * 0.2) if good else None
    return noticed, recovered, good


def _at(scan: Any, clock: float) -> Any:
    return dataclasses.replace(scan, stamp=clock)


def kidnappings(drives: Drives, options: argparse.Namespace) -> None:
    """Print the results of all kidnappings."""
    rng = np.random.default_rng(options.seed)
    maps = {name: load_grid(name) for name in {key.split("_")[0] for key in drives}}
    noticed: list[float] = []
    recovered: list[float] = []
    for i in range(options.count):
        while True:
            one = sorted(drives)[int(rng.integers(len(drives)))]
            others = [key for key in sorted(drives) if key.split("_")[0] == one.split("_")[0]]
            two = others[int(rng.integers(len(others)))]
            last = len(drives[one]["t"]) - round(options.seconds / 0.2) - 60
            a, b = int(rng.integers(last)), int(rng.integers(last))
            end = drives[one]["truth"][a + round(BEFORE_S / 0.2)]
            if np.hypot(*(end - drives[two]["truth"][b])[:2]) > 2.0:
                break
        when, again, good = one_kidnapping(drives, maps[one.split("_")[0]], (one, two), (a, b), options, i)
        print(f"{i}: {one} {0.2 * a:.0f} s -> {two} {0.2 * b:.0f} s: noticed {when}, recovered {again}", flush=True)
        if when is not None:
            noticed.append(when)
        if good and again is not None:
            recovered.append(again)
    soon = sum(t <= 5.0 for t in noticed)
    print(
        f"{options.count} kidnappings: {soon} noticed within 5 s ({100 * soon / options.count:.0f} %), median "
        f"{np.median(noticed):.1f} s; {len(recovered)} recovered ({100 * len(recovered) / options.count:.0f} %), median "
        f"{np.median(recovered):.1f} s"
    )


def false_alarms(drives: Drives, options: argparse.Namespace) -> None:
    """Follow the drives without kidnapping, and count the alarms."""
    hours = alarms = right = jumps = wrong_jumps = 0.0
    seed = options.seed
    while hours < options.hours:
        for name, drive in drives.items():
            seed += 1
            rng = np.random.default_rng(seed)
            localizer = start(drive, load_grid(name.split("_")[0]), 0, seed)
            odometry = Transform2D()
            for k, step in enumerate(steps_of(drive)):
                noise = rng.normal(0.0, 0.05, 2) * (step.x, step.yaw)
                odometry = odometry @ Transform2D(step.x + noise[0], step.y, step.yaw + noise[1])
                scan, sensor = scan_of(drive, options.laser, k)
                before = len(localizer.alarms)
                localizer.update(odometry, scan, sensor)
                estimate = localizer.estimate
                x, y = drive["truth"][k, :2].tolist()
                if estimate is not None and len(localizer.alarms) > before:
                    pose = estimate.map_to_odom @ odometry
                    off = math.hypot(pose.x - x, pose.y - y)
                    alarms += 1
                    right += off > WRONG_M
                    print(f"{name} seed {seed}: alarm at {0.2 * k:.1f} s, {off:.2f} m off", flush=True)
            for stamp, pose in localizer.jumps:
                k = round(stamp / 0.2)
                jumps += 1
                wrong_jumps += math.hypot(pose.x - drive["truth"][k, 0], pose.y - drive["truth"][k, 1]) > WRONG_M
            hours += float(drive["t"][-1] - drive["t"][0]) / 3600.0
    print(
        f"{hours:.2f} h without kidnapping: {alarms:.0f} alarms, {right:.0f} of them with an error of more than {WRONG_M:g} m; "
        f"{jumps:.0f} poses set by a search, {wrong_jumps:.0f} wrong"
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=60.0, help="time after a kidnapping")
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--laser", default="lidar180", choices=["lidar180", "kinect640"])
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    drives = {Path(f).stem.removeprefix("amcl_drive_"): load_drive(f) for f in sorted(FOLDER.glob("amcl_drive_*.npz"))}
    began = time.process_time()
    kidnappings(drives, options)
    false_alarms(drives, options)
    print(f"{time.process_time() - began:.0f} s of processor time")


if __name__ == "__main__":
    main()
