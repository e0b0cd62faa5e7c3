"""Replay of logs: times real time with a 640-beam scan, and the memory for a large bag.

    python tools/bench/replay.py [--gigabytes G] [--folder DIR]

1. The packaged office is simulated, exported as a bag and as MCAP, and replayed: times real time, in CPU time of one core.
2. A synthetic bag of G gigabytes (default 1) is written: images of a camera that nothing uses, between scans, odometry and tf
   of a robot that drives in a circle. `navstack bag info` and `navstack replay` read it, each in a process: time and memory.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from navstack.cli.scenario_options import ScenarioOptions
from navstack.core import LaserScan, Pose2D, Transform2D, Twist2D
from navstack.logs import open_log
from navstack.logs.writer import BagWriter, typestore
from navstack.replay import LogReplay, export_run, find_topics, logged_map
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as ros
from navstack.scenario import Run

START_NS = 1_700_000_000 * 10**9
IMAGE_BYTES = 640 * 480
IMAGE_RATE = 10.0
RADIUS_M, SPEED = 2.0, 0.3


def replay_factor(folder: Path, suffix: str) -> tuple[float, float]:
    """Return simulated seconds per CPU second, and the share of equal commands."""
    scenario = ScenarioOptions(map_="office").build()
    run = Run(scenario)
    while run.step():
        pass
    assert run.recorder is not None
    file = folder / f"office.{suffix}"
    export_run(run.recorder.record(), file)
    best, equal = 0.0, 0.0
    for _ in range(3):
        with open_log(file) as log:
            grid = logged_map(log, find_topics(log, scenario.configuration))
            replay = LogReplay(log, scenario.configuration, grid)
            begin = time.process_time()
            replay.run()
            best = max(best, run.robot.time / (time.process_time() - begin))
            pairs = [cycle for cycle in replay.cycles if cycle.controlled]
            equal = sum(cycle.command == cycle.recorded for cycle in pairs) / len(pairs)
    return best, equal


def write_large_bag(path: Path, gigabytes: float) -> float:
    """Write the synthetic bag; return its duration (s)."""
    store = typestore(ros1=True)
    build = MessageBuilder(store, ros1=True)
    writer = BagWriter(path, store)
    duration = gigabytes * 1e9 / (IMAGE_BYTES * IMAGE_RATE)
    image = np.random.default_rng(0).integers(0, 256, IMAGE_BYTES, np.uint8)
    ranges = np.full(640, 5.0, np.float32)
    scan = LaserScan(ranges, -0.5, 1.0 / 639.0, 0.45, 6.0, 0.0, "laser")
    static = [
        (START_NS, "base_footprint", "laser", Transform2D(0.1), 0.3),
        (START_NS, "map", "odom", Transform2D(), 0.0),
    ]
    writer.write("/tf_static", ros.TRANSFORMS[0], START_NS, build.transforms(static), latched=True)
    for i in range(int(duration * 50)):
        now = START_NS + i * 20_000_000
        angle = SPEED / RADIUS_M * i / 50
        pose = Pose2D(RADIUS_M * math.cos(angle), RADIUS_M * math.sin(angle), angle + 0.5 * math.pi)
        moved = [(now, "odom", "base_footprint", Transform2D(*pose), 0.0)]
        writer.write("/tf", ros.TRANSFORMS[0], now, build.transforms(moved))
        velocity = Twist2D(SPEED, 0.0, SPEED / RADIUS_M)
        writer.write("/odom", ros.ODOMETRY, now, build.odometry(now, "odom", "base_footprint", pose, velocity))
        if i % 5 == 0:
            writer.write("/scan", ros.SCAN, now, build.scan(now, scan))
            header = build.header(now, "camera")
            picture = build.of(
                "sensor_msgs/msg/Image",
                header=header,
                height=480,
                width=640,
                encoding="mono8",
                is_bigendian=0,
                step=640,
                data=image,
            )
            writer.write("/camera/image_raw", "sensor_msgs/msg/Image", now, picture)
    writer.close()
    return duration


def measured(arguments: list[str]) -> tuple[float, float]:
    """Run a navstack command; return its CPU time (s) and the peak memory of all commands so far (MB)."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "navstack", "-q", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, after.ru_maxrss / 1000.0


def main() -> None:
    parser = argparse.ArgumentParser(description="Replay of logs: times real time and memory")
    parser.add_argument("--gigabytes", type=float, default=1.0)
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        folder = Path(name)
        for suffix in ("bag", "mcap"):
            factor, equal = replay_factor(folder, suffix)
            print(
                f"office, .{suffix}: {factor:.0f} times real time (CPU), {100 * equal:.1f} % of the commands equal to the bit"
            )
        file = folder / "large.bag"
        duration = write_large_bag(file, arguments.gigabytes)
        print(f"synthetic bag: {file.stat().st_size / 1e9:.2f} GB, {duration:.0f} s")
        cpu, peak = measured(["bag", "info", str(file)])
        rate = file.stat().st_size / 1e6 / cpu
        print(f"bag info: {duration / cpu:.0f} times real time (CPU), {rate:.0f} MB/s, peak {peak:.0f} MB")
        options = ["--map", "none", "--goal", "0:-2,0", "--out", str(folder / "out")]
        for record in ("--no-record", "--record"):
            cpu, peak = measured(["replay", str(file), *options, record])
            print(f"replay {record}: {duration / cpu:.0f} times real time (CPU), peak {peak:.0f} MB")


if __name__ == "__main__":
    main()
