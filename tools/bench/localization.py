"""Times of localization next to the C++ (golden_ros1/times.json): updates of amcl, the distance field, the odometry filter.

    python tools/bench/localization.py [--repeats N]

One update: motion model, sensor model and resampling with all particles kept (min_particles = max_particles), a scan of 640
beams, the map of the C++ times, a cloud of 0.3 m and 0.17 rad. Processor times; the median of the repeats counts. C++ times are
scaled by the calibration.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from reference import Reference

from navstack.core import GridGeometry, OccupancyGrid, Pose2D, Twist2D
from navstack.localization import distance_field
from navstack.localization.ekf import Ekf
from navstack.localization.particles import ParticleSet
from navstack.localization.sensor_model import Readings, SensorModel
from navstack.parameters import AmclParams
from navstack.parameters.models.ekf import STATES, EkfParams

ROS1 = Path(os.environ.get("NAVSTACK_GOLDEN_ROS1") or Path(__file__).resolve().parents[3] / "shared" / "golden_ros1")
MOTION = np.array([0.25, 0.02, 0.1])


def median_ms(run: Callable[[], object], repeats: int) -> float:
    """The median processor time of a call (ms)."""
    times: list[float] = []
    run()
    for _ in range(repeats):
        start = time.process_time()
        run()
        times.append(1e3 * (time.process_time() - start))
    return statistics.median(times)


def bench_amcl(data: Any, grid: OccupancyGrid, times: Any, scale: float, repeats: int) -> None:
    """Print the stages of an update for every case of the C++ times."""
    readings = Readings(data["willow25/w0/ranges"], float(data["willow25/w0/range_max"][0]), np.zeros(3))
    print("model, particles, beams: motion + weights + resampling = update (ms); C++ scaled; ratio")
    for row in times["amcl"]:
        count, beams = row["particles"], row["beams"]
        params = AmclParams(
            min_particles=count,
            max_particles=count,
            laser_max_beams=beams,
            laser_model_type=row["model"],
            laser_z_hit=0.5,
            laser_z_rand=0.5,
        )
        model, particles = SensorModel(params, grid), ParticleSet(params, 1)
        free = np.argwhere(grid.data.T == 0).astype(np.int32)
        alphas = np.full(5, 0.2)
        stages: list[list[float]] = []

        def update(
            model: SensorModel = model,
            particles: ParticleSet = particles,
            stages: list[list[float]] = stages,
            free: Any = free,
            alphas: Any = alphas,
        ) -> None:
            particles.draw_gaussian(Pose2D(*data["willow25/w0/truth"].tolist()), np.diag([0.09, 0.09, 0.0289]))
            stamps = [time.process_time()]
            particles.move(MOTION, 0.3, alphas, "diff")
            stamps.append(time.process_time())
            particles.weigh(model.factors(particles.poses, readings, converged=False))
            stamps.append(time.process_time())
            particles.resample(free, (0.0, 0.0), 0.1)
            particles.clusters()
            stamps.append(time.process_time())
            stages.append([1e3 * (b - a) for a, b in itertools.pairwise(stamps)])

        for _ in range(repeats + 1):
            update()
        parts = [statistics.median(stage) for stage in zip(*stages[1:], strict=True)]
        total, theirs = sum(parts), row["update_ms"] * scale
        split = " + ".join(f"{part:.3f}" for part in parts)
        print(
            f"{row['model']:21s} {count:5d} {beams:3d}: {split} = {total:.3f}; C++ {theirs:.3f}; {theirs / total:.1f} x"
        )


def bench_ekf(repeats: int) -> None:
    """Print the updates per second of the odometry filter with wheels and a gyroscope."""
    params: dict[str, Any] = {
        "odom0_config": [state in ("vx", "vy", "vyaw") for state in STATES],
        "imu0_config": [state == "vyaw" for state in STATES],
    }
    spread, count = np.diag([1e-2, 1e-4, 2e-2]), 10_000
    ekf, start = Ekf(EkfParams(**params)), [0.0]

    def run() -> None:
        for k in range(count // 2):
            stamp = start[0] + 0.02 * k
            ekf.add_odometry("odom0", stamp, Pose2D(0.0, 0.0), spread, Twist2D(0.5, 0.0, 0.1), spread)
            ekf.add_imu("imu0", stamp + 0.01, (0.0, 1.0), (0.1, 1e-4))
        start[0] += 0.02 * count

    ms = median_ms(run, repeats)
    print(f"ekf: {1e3 * count / ms:,.0f} updates/s (wheels and gyroscope, with their innovations kept)")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=40)
    repeats = parser.parse_args().repeats
    times = json.loads((ROS1 / "times.json").read_text(encoding="utf-8"))
    calibration = Reference().calibration_ms()
    scale = calibration / times["calibration_ms"]
    print(f"calibration {calibration:.1f} ms, {times['calibration_ms']} ms at the C++ times")
    with np.load(ROS1 / "amcl_willow.npz") as data:
        info = data["willow25/info"]
        geometry = GridGeometry(int(info[0]), int(info[1]), float(info[2]), float(info[3]), float(info[4]))
        grid = OccupancyGrid(data["willow25/occupancy"], geometry)
        ms = median_ms(lambda: distance_field(grid, 2.0), repeats)
        theirs = times["map_update_cspace_566x608_ms"] * scale
        print(f"distance field {info[0]:.0f} x {info[1]:.0f}: {ms:.2f} ms; C++ {theirs:.1f}; {theirs / ms:.1f} x")
        bench_amcl(data, grid, times, scale, repeats)
    bench_ekf(min(repeats, 10))


if __name__ == "__main__":
    main()
