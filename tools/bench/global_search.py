"""Time of a search over a whole map, and how often, how soon and how surely recorded drives find their pose from nothing.

    python tools/bench/global_search.py [--repeats N] [--every S] [--seconds S] [--drift RAD_PER_M] [--no-starts]

The drives are those of golden_ros1 (NAVSTACK_GOLDEN_ROS1): `amcl_drive_*.npz`, maps in `amcl_maps.npz`. A start is taken every
`--every` seconds of each drive, with each laser; a start has `--seconds` to become certain. False confidence: an estimate that
is declared certain is more than 0.5 m off. `--drift` adds a drift of the heading to the odometry.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reference import Reference

from navstack.core import GridGeometry, LaserScan, OccupancyGrid, Transform2D
from navstack.localization import ScanMatcher, scan_beams
from navstack.localization.global_search import MatchMap, search_scan

FOLDER = Path(os.environ.get("NAVSTACK_GOLDEN_ROS1") or Path(__file__).resolve().parents[3] / "shared" / "golden_ros1")
WRONG_M = 0.5


def load_grid(name: str) -> OccupancyGrid:
    """A map of the drives."""
    with np.load(FOLDER / "amcl_maps.npz") as maps:
        cells, (resolution, x, y) = maps[name], maps[f"{name}_info"].tolist()
    return OccupancyGrid(cells, GridGeometry(cells.shape[1], cells.shape[0], resolution, x, y))


def load_drive(file: Path) -> dict[str, Any]:
    """The arrays of a drive by name."""
    with np.load(file) as data:
        return {name: data[name] for name in data.files}


def scan_of(drive: dict[str, Any], laser: str, k: int) -> tuple[LaserScan, Transform2D]:
    """Scan `k` and the pose of its sensor."""
    first, increment, nearest, farthest, x = drive[f"scan_params_{laser}"].tolist()
    raw = drive[f"scan_{laser}"][k]
    ranges = np.where(raw == 65535, np.inf, raw / 1000.0).astype(np.float32)
    return LaserScan(ranges, first, increment, nearest, farthest, float(drive["t"][k])), Transform2D(x, 0.0, 0.0)


def with_drift(odometry: NDArray[np.float64], rate: float) -> list[Transform2D]:
    """The odometry with `rate` more rad of heading per meter."""
    before, now = Transform2D(*odometry[0].tolist()), Transform2D()
    result: list[Transform2D] = []
    for row in odometry.tolist():
        step = before.inverse() @ Transform2D(*row)
        before = Transform2D(*row)
        now = now @ Transform2D(step.x, step.y, step.yaw + rate * math.hypot(step.x, step.y))
        result.append(now)
    return result


def one_start(
    matcher: ScanMatcher, drive: dict[str, Any], laser: str, odometry: list[Transform2D], first: int, seconds: float
) -> tuple[float | None, bool]:
    """(time until certain, or None; whether a certain estimate was wrong)."""
    matcher.start_globally()
    when, wrong = None, False
    times = drive["t"]
    for k in range(first, len(times)):
        if times[k] - times[first] > seconds:
            break
        estimate = matcher.update(odometry[k], *scan_of(drive, laser, k))
        if estimate is None or not estimate.details["certain"]:
            continue
        when = float(times[k] - times[first]) if when is None else when
        x, y = drive["truth"][k, :2].tolist()
        wrong |= math.hypot(estimate.pose.x - x, estimate.pose.y - y) > WRONG_M
    return when, wrong


def starts(every: float, seconds: float, drift: float) -> None:
    """Print the results of global starts, by drive and laser and in all."""
    times: list[float] = []
    count = false = 0
    for file in sorted(FOLDER.glob("amcl_drive_*.npz")):
        drive = load_drive(file)
        odometry = with_drift(drive["odom"], drift)
        matcher = ScanMatcher()
        matcher.set_map(load_grid(file.stem.split("_")[2]))
        for laser in sorted(name.removeprefix("scan_params_") for name in drive if name.startswith("scan_params_")):
            firsts = [int(np.searchsorted(drive["t"], t)) for t in np.arange(0.0, drive["t"][-1] - seconds, every)]
            results = [one_start(matcher, drive, laser, odometry, first, seconds) for first in firsts]
            found = [when for when, wrong in results if when is not None and not wrong]
            wrong = sum(wrong for _, wrong in results)
            print(
                f"{file.stem.removeprefix('amcl_drive_')} {laser}: {len(found)} of {len(results)} found, "
                f"{wrong} falsely certain, median {np.median(found):.1f} s, longest {max(found):.1f} s",
                flush=True,
            )
            times += found
            count += len(results)
            false += wrong
    print(
        f"all: {len(times)} of {count} found ({100.0 * len(times) / count:.1f} %), median {np.median(times):.1f} s, "
        f"{false} falsely certain ({100.0 * false / count:.2f} %)"
    )


def search_times(repeats: int) -> None:
    """Print the processor time of a search over Willow's map from scans along its first drive."""
    drive = load_drive(FOLDER / "amcl_drive_willow_1.npz")
    began = time.process_time()
    match_map = MatchMap(load_grid("willow"), reach=8.0)
    _ = match_map.pyramid
    print(f"distance field and block maxima, once per map: {1e3 * (time.process_time() - began):.0f} ms")
    best: list[float] = []
    complete = 0
    places = list(range(0, 1200, 100))
    for k in places:
        scan, sensor = scan_of(drive, "kinect640", k)
        beams = scan_beams(scan, sensor)
        complete += search_scan(match_map, beams).complete
        took: list[float] = []
        for _ in range(repeats):
            began = time.thread_time()
            search_scan(match_map, beams)
            took.append(time.thread_time() - began)
        best.append(1e3 * min(took))
    cells = match_map.free.size
    print(
        f"search: {cells} cells, 180 beams, 1 degree, {match_map.resolution:g} m, {len(places)} scans: median "
        f"{np.median(best):.0f} ms, longest {max(best):.0f} ms; {complete} proven complete"
    )
    reference = Reference()
    if reference.available:
        print(f"calibration {reference.calibration_ms():.1f} ms")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--every", type=float, default=5.0, help="seconds between starts")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of a start")
    parser.add_argument("--drift", type=float, default=0.0, help="rad per meter")
    parser.add_argument("--no-starts", action="store_true")
    options = parser.parse_args()
    search_times(options.repeats)
    if not options.no_starts:
        starts(options.every, options.seconds, options.drift)


if __name__ == "__main__":
    main()
