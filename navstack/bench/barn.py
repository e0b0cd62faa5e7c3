"""BARN: ten metres through a field of cylinders, without a map.

Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020; scored as the BARN Challenge does. A robot
starts at the origin of its odometry, facing along y; the goal lies 10 m ahead. Success: within 1 m of the goal, without
contact, in under 100 s, from when it has moved 0.1 m. The score of a world is `OT / clip(AT, 2 OT, 8 OT)`, OT the time
that the shortest way takes at 2 m/s and AT the time taken, and 0 without success: 0.5 at most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.configuration import Configuration, load_configuration
from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.record import RunRecorder
from navstack.scenario import Run, Scenario

START: Final = Pose2D(0.0, 0.0, 1.57)
GOAL: Final = Pose2D(0.0, 10.0, 0.0)
ORIGIN: Final = (-2.25, 3.0)
"""Where the start lies in the worlds' own coordinates (m)."""
REACHED_M: Final = 1.0
MOVED_M: Final = 0.1
TIME_LIMIT_S: Final = 100.0
OPTIMAL_SPEED: Final = 2.0

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

    @property
    def optimal_time_s(self) -> float:
        """What the shortest way takes at 2 m/s."""
        return self.optimal_length_m / OPTIMAL_SPEED

    def score(self, time_s: float) -> float:
        """The BARN score of a success after `time_s`."""
        optimal = self.optimal_time_s
        return optimal / min(max(time_s, 2.0 * optimal), 8.0 * optimal)


@dataclass(frozen=True, slots=True)
class BarnOutcome:
    """How a run through a world ended."""

    world: int
    outcome: str
    """success, collision, timeout, or the state in which the goal ended short of it (aborted, ..)."""
    time_s: float
    """Since the robot had moved 0.1 m."""
    length_m: float
    clearance_m: float
    """Least distance between the robot's outline and a cylinder, at the control cycles."""
    score: float
    turning_s: float
    """Time spent turning in place (under 0.01 m/s)."""
    text: str = ""
    """What the goal's result said, where it ended."""

    @property
    def succeeded(self) -> bool:
        """True within 1 m of the goal, without contact and in time."""
        return self.outcome == "success"


def load_worlds(file: Path) -> list[BarnWorld]:
    """The worlds of a `worlds.npz`: world, cyl_xy, cyl_offset, cyl_radius, optimal_length_m. Raises InputError."""
    try:
        with np.load(file) as data:
            numbers, lengths = data["world"].tolist(), data["optimal_length_m"].tolist()
            centres, radius = data["cyl_xy"] - ORIGIN, float(data["cyl_radius"])
            slices = list(pairwise(data["cyl_offset"].tolist()))
    except (OSError, KeyError, ValueError) as exc:
        raise InputError(f"{file} is not a file of BARN worlds ({exc})", file=str(file)) from exc
    return [
        BarnWorld(number, np.column_stack((centres[a:b], np.full(b - a, radius))), length)
        for number, length, (a, b) in zip(numbers, lengths, slices, strict=True)
    ]


def barn_configuration(
    params: Path | Sequence[str],
    *,
    distro: str | None = None,
    rough: bool = False,
    noise_m: float | None = None,
    overrides: Sequence[str] = (),
) -> Configuration:
    """The parameters of a robot as published, in the benchmark's simulator; `noise_m` of the lidar's ranges (m).

    Raises ParameterError.
    """
    simulator = dict(ROUGH_JACKAL if rough else JACKAL)
    if noise_m is not None:
        simulator["laser"] = {**simulator["laser"], "range_noise": noise_m}
    sources = [str(params)] if isinstance(params, Path) else list(params)
    return load_configuration([*sources, {"navstack": {"sim": simulator}}], overrides=overrides, distro=distro)


def barn_scenario(world: BarnWorld, configuration: Configuration, *, seed: int = 0) -> Scenario:
    """The task of a world. The map is empty: it only says how far pictures reach."""
    resolution, margin = 0.05, 1.0
    known = np.vstack((world.discs[:, :2], [(START.x, START.y), (GOAL.x, GOAL.y)]))
    low, high = known.min(axis=0) - margin, known.max(axis=0) + margin
    nx, ny = (math.ceil(side / resolution) for side in (high - low).tolist())
    geometry = GridGeometry(nx, ny, resolution, float(low[0]), float(low[1]))
    return Scenario(
        map=OccupancyGrid(np.zeros((ny, nx), np.int8), geometry),
        configuration=configuration,
        start=START,
        goals=(GOAL,),
        obstacles=tuple((x, y, r) for x, y, r in world.discs.tolist()),
        seed=seed,
        time_limit_s=2.0 * TIME_LIMIT_S,
        names={"map": f"BARN world {world.number}", "params": [], "overrides": []},
    )


def run_world(
    world: BarnWorld, configuration: Configuration, *, seed: int = 0, record: bool = False
) -> tuple[BarnOutcome, RunRecorder | None]:
    """Drives through `world` once: a pure function of its arguments. The recorder only with `record`."""
    run = Run(barn_scenario(world, configuration, seed=seed), record=record)
    robot = run.robot
    began: float | None = None
    clearance, turning, last = math.inf, 0.0, 0.0
    ended = "timeout"
    while True:
        stepped = run.step()
        pose, now = robot.pose, robot.time
        clearance = min(clearance, robot.world.clearance(pose, robot.footprint))
        velocity = robot.state().velocity
        if velocity.speed < 0.01 and abs(velocity.wz) > 0.01:
            turning += now - last
        last = now
        if began is None and pose.distance_to(START) >= MOVED_M:
            began = now
        if robot.collisions:
            ended = "collision"
            break
        if began is not None and pose.distance_to(GOAL) <= REACHED_M:
            ended = "success"
            break
        # a robot that never moves 0.1 m gets the same time
        if now - (began or 0.0) >= TIME_LIMIT_S:
            break
        if not stepped:
            ended = run.outcomes[-1].state.lower()
            break
    taken = last - (began or 0.0)
    outcome = BarnOutcome(
        world=world.number,
        outcome=ended,
        time_s=taken,
        length_m=robot.distance_travelled,
        clearance_m=0.0 if ended == "collision" else clearance,
        score=world.score(taken) if ended == "success" else 0.0,
        turning_s=turning,
        text=run.outcomes[-1].message if run.outcomes else "",
    )
    if run.recorder is not None and not run.outcomes:
        run.recorder.finish([], robot.collisions)
    return outcome, run.recorder
