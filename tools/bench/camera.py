#!/usr/bin/env python3
"""Time of a picture of the simulated camera (ms), with the calibration of the machine.

The map is the packaged office, seen from 60 random free poses; prints the median and the slowest of the best of five pictures.
The first picture compiles the kernels or loads them.
"""

from __future__ import annotations

import math
import statistics
import time

import numpy as np
from reference import Reference

from navstack.core import Pose2D
from navstack.map_io import load_map, map_path
from navstack.sim import Camera, CameraParams, Solids, World

POSES = 60
TARGET_MS = 5.0
"""Longest time of a picture of 640x480 pixels."""


def main() -> None:
    """Prints the table."""
    grid = load_map(map_path("office"))
    rng = np.random.default_rng(0)
    free = np.argwhere(grid.data == 0)
    r = grid.geometry.resolution
    poses = [
        Pose2D((ix + 0.5) * r, (iy + 0.5) * r, rng.uniform(-math.pi, math.pi))
        for iy, ix in free[rng.integers(len(free), size=POSES)]
    ]
    extent = (grid.geometry.width_m, grid.geometry.height_m)
    world = World(grid)
    started = time.perf_counter()
    Camera(CameraParams()).image(world, poses[0], 0.0)
    print(f"first picture: {time.perf_counter() - started:.2f} s")
    print("| pixels | people | median (ms) | slowest (ms) |\n|---|---:|---:|---:|")
    for width, height in ((320, 240), (640, 480), (1280, 960)):
        camera = Camera(CameraParams(width=width, height=height))
        for people in (0, 30, 300):
            discs = np.column_stack((rng.uniform((0.0, 0.0), extent, (people, 2)), np.full(people, 0.25)))
            no_corners = (np.empty((0, 3)), np.empty((0, 2)), np.zeros(1, np.int64))
            solids = Solids(discs, *no_corners, np.full(people, math.inf))
            best: list[float] = []
            for pose in poses:
                times: list[float] = []
                for _ in range(5):
                    started = time.perf_counter()
                    camera.image(world, pose, 0.0, solids, people)
                    times.append(time.perf_counter() - started)
                best.append(1e3 * min(times))
            target = f" (target: {TARGET_MS:g})" if (width, height) == (640, 480) else ""
            print(f"| {width}x{height} | {people} | {statistics.median(best):.2f} | {max(best):.2f}{target} |")
    reference = Reference()
    if reference.available:
        print(f"calibration {reference.calibration_ms():.1f} ms")


if __name__ == "__main__":
    main()
