"""The BARN worlds: fields of cylinders to cross, ten meters from start to goal.

Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020. `navstack.studies.barn` scores runs in them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry, InputError, OccupancyGrid, Pose2D, is_file, plain_kernel, read_arrays, shortened
from navstack.scenario.spec import ScenarioSpec, single_goal_spec
from navstack.sim import Shape

START: Final = Pose2D(0.0, 0.0, 1.57)
GOAL: Final = Pose2D(0.0, 10.0, 0.0)
"""Start and goal in the odometry frame (m, rad). The goal's yaw is as published; BARN does not evaluate it."""
WORLDS_FILE: Final = "worlds.npz"
"""Name of the file of the worlds in their folder."""
ORIGIN: Final = (-2.25, 3.0)
"""Position of the start in the coordinates of the world files (m)."""
MAX_BYTES: Final = 100_000_000
"""Largest size of the arrays of a file; the 300 published worlds take 1 MB."""
_ARRAYS: Final = ("world", "cyl_xy", "cyl_offset", "cyl_radius", "optimal_length_m")
_LARGEST: Final = 1e6
"""Largest number, coordinate or length of a world (m)."""
OPTIMAL_SPEED: Final = 2.0
"""Speed assumed on the shortest path by the score (m/s)."""
START_RADIUS_M: Final = 0.1
"""The time of a run counts from when the robot is this far from the start (m)."""

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
"""A Jackal with its lidar, exact odometry and no noise: the simulator with which the C++ stack was measured."""
ROUGH_JACKAL: Final[Mapping[str, Any]] = {
    **JACKAL,
    "velocity_lag": 0.1,
    "wheel_slip": 0.01,
    "localization": "odometry",
    "laser": {**JACKAL["laser"], "range_noise": 0.001, "frequency": 50.0},
}
"""The Jackal with 1 mm of lidar noise, 50 scans per second, 0.1 s of velocity lag and 1 % of unobserved wheel slip."""


@dataclass(frozen=True, slots=True, eq=False)
class BarnWorld:
    """A field of cylinders, in the odometry frame of a robot at the start."""

    number: int
    discs: NDArray[np.float64]
    """(n, 3) x, y, radius (m)."""
    optimal_length_m: float
    """Length of the shortest path, as published with the world."""

    @property
    def optimal_time_s(self) -> float:
        """Duration of the shortest path at `OPTIMAL_SPEED`."""
        return self.optimal_length_m / OPTIMAL_SPEED

    def score(self, time_s: float) -> float:
        """Returns the BARN score of a success after `time_s`, 0.0625 to 0.5: OT / clip(AT, 2 OT, 8 OT)."""
        return barn_score(self.optimal_length_m, time_s)


@plain_kernel
def barn_score(length: float, time: float) -> float:
    """Return the BARN score of a success after `time` (s): OT / clip(AT, 2 OT, 8 OT); 0.5 for a path of no `length` (m).

    OT is the duration of the shortest path at `OPTIMAL_SPEED`; AT begins when the robot has moved `START_RADIUS_M`.
    """
    optimal = length / OPTIMAL_SPEED
    return optimal / min(max(time, 2.0 * optimal), 8.0 * optimal) if optimal > 0.0 else 0.5


def barn_map(world: BarnWorld) -> OccupancyGrid:
    """Returns an empty map that covers the world; it sets the extent of pictures, the robot has no map."""
    resolution, margin = 0.05, 1.0
    points = np.vstack((world.discs[:, :2], [(START.x, START.y), (GOAL.x, GOAL.y)]))
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    nx, ny = (math.ceil(side / resolution) for side in (high - low).tolist())
    return OccupancyGrid(np.zeros((ny, nx), np.int8), GridGeometry(nx, ny, resolution, float(low[0]), float(low[1])))


def barn_scenarios(directory: Path | None) -> list[ScenarioSpec]:
    """Returns a scenario for each world of a folder (or a `worlds.npz`). Raises InputError."""
    if directory is None:
        raise InputError(
            f"the suite barn needs the folder of the BARN worlds, which contains {WORLDS_FILE}", argument="directory"
        )
    return [barn_spec(world) for world in load_worlds(directory / WORLDS_FILE if directory.is_dir() else directory)]


def barn_spec(world: BarnWorld) -> ScenarioSpec:
    """Returns the scenario of a world, in the simulator of the benchmark."""
    return single_goal_spec(
        f"world {world.number}",
        START,
        GOAL,
        100.0,
        grid=barn_map(world),
        overlays=[{"navstack": {"sim": dict(JACKAL)}}],
        shapes=tuple(Shape(radius=r, pose=[x, y]) for x, y, r in world.discs.tolist()),
    )


def load_worlds(file: Path) -> list[BarnWorld]:
    """Reads the worlds of a `worlds.npz` of at most 100 MB. Raises InputError.

    Its arrays: `world` (n,) numbers; `cyl_xy` (m, 2) centers of the cylinders of all worlds in the coordinates of the files
    (m); `cyl_offset` (n + 1,) index of each world's first cylinder; `cyl_radius` (m); `optimal_length_m` (n,).
    """
    if not is_file(file):
        raise InputError(f"{file} does not exist; give the folder that contains BARN's worlds.npz", file=str(file))
    try:
        data = read_arrays(file, _ARRAYS, MAX_BYTES)
        return _worlds(**{name: np.asarray(data[name], np.float64) for name in _ARRAYS})
    # a single array, another file type, a truncated archive, arrays of inconsistent lengths: any error of the file
    except Exception as exc:
        reason = shortened(" ".join(str(exc).split()), 200) or type(exc).__name__
        raise InputError(
            f"{file} is not a file of BARN worlds ({reason}); it must have the arrays {', '.join(_ARRAYS[:-1])} and "
            f"{_ARRAYS[-1]}",
            file=str(file),
        ) from exc


def _worlds(
    world: NDArray[np.float64],
    cyl_xy: NDArray[np.float64],
    cyl_offset: NDArray[np.float64],
    cyl_radius: NDArray[np.float64],
    optimal_length_m: NDArray[np.float64],
) -> list[BarnWorld]:
    """Returns the worlds of the arrays of a file. Raises ValueError for shapes and values that a file cannot have."""
    count = len(world)
    if (
        world.ndim != 1
        or optimal_length_m.shape != (count,)
        or cyl_offset.shape != (count + 1,)
        or cyl_radius.size != 1
    ):
        raise ValueError("its arrays do not have the shapes (n,), (m, 2), (n + 1,), () and (n,)")
    if cyl_xy.ndim != 2 or cyl_xy.shape[1] != 2:
        raise ValueError(f"cyl_xy has the shape {cyl_xy.shape}, not (m, 2)")
    for name, values in (
        ("world", world),
        ("cyl_xy", cyl_xy),
        ("cyl_radius", cyl_radius),
        ("lengths", optimal_length_m),
    ):
        if not np.isfinite(values).all() or float(np.abs(values).max(initial=0.0)) > _LARGEST:
            raise ValueError(f"{name} has values that are not finite or not below {_LARGEST:g}")
    steps = np.diff(cyl_offset)
    if not np.isfinite(cyl_offset).all() or (steps < 0).any() or cyl_offset[0] != 0 or cyl_offset[-1] > len(cyl_xy):
        raise ValueError(f"cyl_offset does not increase from 0 to at most {len(cyl_xy)}")
    radius = float(cyl_radius.reshape(()))
    if radius <= 0.0 or (optimal_length_m <= 0.0).any():
        raise ValueError("radius and lengths must be positive")
    centers = cyl_xy - ORIGIN
    return [
        BarnWorld(int(number), np.column_stack((centers[a:b], np.full(b - a, radius))), float(length))
        for number, length, (a, b) in zip(
            world, optimal_length_m, pairwise(cyl_offset.astype(int).tolist()), strict=True
        )
    ]
