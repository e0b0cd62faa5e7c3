"""BARN's worlds: fields of cylinders to be crossed, ten metres from start to goal.

Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020. `navstack.bench.barn` scores runs through them.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.core.files import is_file

START: Final = Pose2D(0.0, 0.0, 1.57)
GOAL: Final = Pose2D(0.0, 10.0, 0.0)
"""Both in the odometry frame (m, rad). The goal's yaw is as published; BARN does not look at how the robot stands there."""
WORLDS_FILE: Final = "worlds.npz"
"""The file of the worlds, where a folder of theirs is given."""
ORIGIN: Final = (-2.25, 3.0)
"""Where the start lies in the worlds' own coordinates (m)."""
OPTIMAL_SPEED: Final = 2.0
"""Of the shortest way in the score (m/s)."""

JACKAL: Final[Mapping[str, Any]] = {
    "physics_frequency": 100.0,
    "acc_lim_x": 10.0,
    "acc_lim_theta": 20.0,
    "command_timeout": 0.25,
    "laser": {
        "topic": "front/scan",
        "frame": "front_laser",
        "x": 0.055,
        "height": 0.2414,
        "beams": 720,
        "fov": 2 * 2.35619,
        "range_min": 0.1,
        "range_max": 10.0,
        "frequency": 20.0,
    },
}
"""A Jackal with its lidar, true odometry and no noise: the simulator that the C++ stack was measured in."""


def _rougher() -> dict[str, Any]:
    laser = {**JACKAL["laser"], "range_noise": 0.001, "frequency": 50.0}
    return {**JACKAL, "velocity_lag": 0.1, "wheel_slip": 0.01, "localization": "odometry", "laser": laser}


ROUGH_JACKAL: Final[Mapping[str, Any]] = _rougher()
"""The same with 1 mm of lidar noise, 50 scans a second, a lag of 0.1 s and 1 % of slip that odometry does not see."""


@dataclass(frozen=True, slots=True, eq=False)
class BarnWorld:
    """A field of cylinders, in the odometry frame of a robot at the start."""

    number: int
    discs: NDArray[np.float64]
    """(n, 3) x, y, radius (m)."""
    optimal_length_m: float
    """Of the shortest way, as published with the world."""

    @property
    def optimal_time_s(self) -> float:
        """What the shortest way takes at `OPTIMAL_SPEED`."""
        return self.optimal_length_m / OPTIMAL_SPEED

    def score(self, time_s: float) -> float:
        """The BARN score of a success after `time_s`, 0.0625 to 0.5: OT / clip(AT, 2 OT, 8 OT)."""
        optimal = self.optimal_time_s
        return optimal / min(max(time_s, 2.0 * optimal), 8.0 * optimal)


def barn_map(world: BarnWorld) -> OccupancyGrid:
    """An empty map around a world: the robot has none, it only says how far pictures reach."""
    resolution, margin = 0.05, 1.0
    known = np.vstack((world.discs[:, :2], [(START.x, START.y), (GOAL.x, GOAL.y)]))
    low, high = known.min(axis=0) - margin, known.max(axis=0) + margin
    nx, ny = (math.ceil(side / resolution) for side in (high - low).tolist())
    return OccupancyGrid(np.zeros((ny, nx), np.int8), GridGeometry(nx, ny, resolution, float(low[0]), float(low[1])))


def load_worlds(file: Path) -> list[BarnWorld]:
    """The worlds of a `worlds.npz`. Raises InputError.

    Its arrays: `world` (n,) numbers; `cyl_xy` (m, 2) centres of all cylinders in the worlds' own coordinates (m);
    `cyl_offset` (n + 1,) where those of each world begin; `cyl_radius` (m); `optimal_length_m` (n,).
    """
    if not is_file(file):
        raise InputError(f"there is no {file}: give the folder that holds BARN's worlds.npz", file=str(file))
    try:
        # opened here: of what is no archive, numpy would leave it open
        with file.open("rb") as opened, np.load(opened) as data:
            numbers, lengths = data["world"].tolist(), data["optimal_length_m"].tolist()
            centres, radius = data["cyl_xy"] - ORIGIN, float(data["cyl_radius"])
            slices = list(pairwise(data["cyl_offset"].tolist()))
        return [
            BarnWorld(number, np.column_stack((centres[a:b], np.full(b - a, radius))), length)
            for number, length, (a, b) in zip(numbers, lengths, slices, strict=True)
        ]
    # an array alone, no archive at all, an archive cut short, arrays that do not fit each other
    except (OSError, EOFError, zipfile.BadZipFile, KeyError, ValueError, TypeError, AttributeError) as exc:
        raise InputError(
            f"{file} is not a file of BARN worlds ({exc}); it holds the arrays world, cyl_xy, cyl_offset, cyl_radius and "
            "optimal_length_m",
            file=str(file),
        ) from exc
