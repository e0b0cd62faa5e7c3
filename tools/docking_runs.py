"""Dock a simulated robot many times and print how well it docks.

    python tools/docking_runs.py [--count 1000] [--detector camera|reflector] [--seed 0] [--processes 2] [--cases]

Each run starts at a random pose in a room before the dock, drives to the staging pose and docks. Its localization has errors of
2 cm and 2 degrees, and so has every detection of the camera; the lidar that sees the reflector has an error of 1 cm per beam. The
errors in the table are those of the true pose from the pose in the dock. `--cases` runs the hostile cases instead: each must end
with its code.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from multiprocessing import get_context
from typing import Any, Final

import numpy as np

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.docking import DockDatabase, Docking
from navstack.move_base import MoveBase
from navstack.parameters import Configuration, load_configuration
from navstack.sim import Shape, SimulatedRobot, World, contact_error, dock_shapes

DOCK: Final = (2.6, 0.4, 0.0)
"""Pose of the docked base (m, rad)."""
NOISE_M: Final = 0.02
NOISE_RAD: Final = math.radians(2.0)
GOOD_M, GOOD_RAD = 0.01, math.radians(1.0)
TIME_LIMIT_S: Final = 300.0
CAMERA, REFLECTOR = "camera", "reflector"


@cache
def room() -> OccupancyGrid:
    """A room of 8 x 6 m with walls."""
    cells = np.zeros((120, 160), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return OccupancyGrid(cells, GridGeometry(160, 120, 0.05, -4.0, -3.0))


@dataclass(frozen=True)
class Case:
    """One docking: what differs from the usual run, and how it must end."""

    name: str
    code: int = 0
    detector: str = CAMERA
    docking: dict[str, Any] = field(default_factory=dict)
    """Parameters of docking_server."""
    dock_type: dict[str, Any] = field(default_factory=dict)
    sim: dict[str, Any] = field(default_factory=dict)
    dock: dict[str, Any] = field(default_factory=dict)
    """Parameters of the simulated dock."""
    shapes: tuple[Shape, ...] = ()
    options: dict[str, Any] = field(default_factory=dict)
    """Arguments of `Docking`."""
    start: Pose2D = Pose2D(0.5, -0.8, 0.5)
    meddle: Callable[[Docking, SimulatedRobot], None] | None = None
    """Called after each tick."""


def configuration(case: Case) -> Configuration:
    """The turtlebot with a dock, and with the errors of the runs."""
    by_lidar = case.detector == REFLECTOR
    marker_x = 0.32 if by_lidar else 0.25
    laser = {"fov": 4.7, "beams": 941, "range_min": 0.05, "range_max": 8.0, "frequency": 10.0, "range_noise": 0.01}
    detector: dict[str, Any] = {"plugin": "v_reflector"} if by_lidar else {"plugin": "pose_topic"}
    dock_type = {
        "plugin": "opennav_docking::SimpleChargingDock",
        "use_external_detection_pose": True,
        "external_detection_translation_x": -marker_x,
        "docking_threshold": 0.005,
        "filter_coef": 0.02,
        "detector": detector,
        **case.dock_type,
    }
    dock = {"pose": list(DOCK), "marker_x": marker_x, "body": "v_reflector" if by_lidar else "box", **case.dock}
    sim: dict[str, Any] = {
        "acc_lim_x": 1.0,
        "acc_lim_theta": 2.0,
        "localization_noise": NOISE_M,
        "localization_yaw_noise": NOISE_RAD,
        "localization_frequency": 2.0,
        "docks": ["home"],
        "home": dock,
        "dock_camera": {"noise": NOISE_M, "yaw_noise": NOISE_RAD},
    }
    if by_lidar:
        sim |= {"laser": laser}
    server = {"docks": ["home"], "home": {"pose": list(DOCK)}, "simple_charging_dock": dock_type, **case.docking}
    values = {"docking_server": server, "navstack": {"sim": {**sim, **case.sim}}}
    return load_configuration(["turtlebot", values])


def random_start(seed: int) -> Pose2D:
    """A pose in the room that is not beside or behind the dock, where the narrow view of the turtlebot misses the dock itself."""
    rng = np.random.default_rng(seed)
    while True:
        x, y = float(rng.uniform(-3.5, 2.0)), float(rng.uniform(-2.5, 2.5))
        if math.hypot(x - DOCK[0], y - DOCK[1]) > 0.8:
            return Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))


@dataclass(frozen=True)
class Outcome:
    """How one docking ended."""

    code: int
    message: str
    retries: int
    error_m: float
    error_rad: float
    seconds: float
    collisions: int
    states: tuple[str, ...]

    @property
    def good(self) -> bool:
        """Docked within 1 cm and 1 degree, by the true pose."""
        return self.code == 0 and self.error_m <= GOOD_M and self.error_rad <= GOOD_RAD


class Bench:
    """A simulated robot before a dock."""

    def __init__(self, case: Case, seed: int, start: Pose2D | None = None) -> None:
        made = self.configuration = configuration(case)
        world = World(room(), shapes=(*case.shapes, *dock_shapes(made.navstack.sim)))
        self.robot: SimulatedRobot = simulated_robot(made, world, start or case.start, seed=seed)
        self.move_base: MoveBase = build_move_base(made, self.robot, static_map=room())
        self.database = DockDatabase.of(made)
        self.move_base.tick(0.0)

    def dock(self, meddle: Callable[[Docking, SimulatedRobot], None] | None = None, **options: Any) -> Docking:
        """Dock until the end, at most TIME_LIMIT_S."""
        task = Docking(self.move_base, self.database, "home", **options)
        task.start()
        while not task.is_done and self.robot.time < TIME_LIMIT_S:
            self.robot.advance_to(self.move_base.next_due(self.robot.time))
            self.move_base.tick(self.robot.time)
            task.advance()
            if meddle is not None:
                meddle(task, self.robot)
        return task


def run(case: Case, seed: int, start: Pose2D | None = None) -> Outcome:
    """Dock once."""
    bench = Bench(case, seed, start)
    task = bench.dock(case.meddle, **case.options)
    error = contact_error(bench.configuration.navstack.sim.dock("home"), bench.robot.pose)
    return Outcome(
        task.result.error_code,
        task.result.message,
        task.log.retries,
        math.hypot(error.x, error.y),
        abs(error.yaw),
        bench.robot.time,
        len(bench.robot.collisions),
        tuple(visit.state for visit in task.log.visits),
    )


def run_random(detector: str, seed: int) -> Outcome:
    """Dock once from a random pose."""
    return run(Case("random", detector=detector), seed, random_start(seed))


# --- hostile cases ----------------------------------------------------------------------------------------------------


def _push(task: Docking, robot: SimulatedRobot) -> None:
    """Push the robot by 15 cm and 15 degrees, once, 40 cm before the dock."""
    if "pushed" not in vars(robot) and math.hypot(robot.pose.x - DOCK[0], robot.pose.y - DOCK[1]) < 0.4:
        vars(robot)["pushed"] = True
        x, y, yaw = robot.pose
        robot.place(Pose2D(x, y + 0.15, yaw + 0.26))


def _hold(task: Docking, robot: SimulatedRobot) -> None:
    """Hold the robot whenever it comes nearer than 30 cm."""
    if math.hypot(robot.pose.x - DOCK[0], robot.pose.y - DOCK[1]) < 0.3:
        robot.place(Pose2D(DOCK[0] - 0.5, DOCK[1], 0.0))


def _cancel(task: Docking, robot: SimulatedRobot) -> None:
    """Cancel while it drives into the dock."""
    if task.log.state.name == "CONTROLLING" and robot.time - task.log.visits[-1].begin > 1.0:
        task.cancel()


def cases() -> list[Case]:
    """The hostile cases."""
    other = Shape(name="other robot", radius=0.18, pose=[DOCK[0], DOCK[1], 0.0])
    short = {"max_retries": 1, "dock_approach_timeout": 10.0}
    return [
        Case("dock occupied, seen by the costmap", 905, shapes=(other,), docking=short),
        Case("dock occupied, reflector hidden", 904, REFLECTOR, shapes=(other,), docking=short),
        Case("robot pushed once", 0, meddle=_push),
        Case("robot held back again and again", 905, meddle=_hold, docking=short),
        Case("no detection at all", 904, sim={"dock_camera": {"dropout": 1.0}}),
        Case("detection lost 0.5 m before the marker", 904, sim={"dock_camera": {"range_min": 0.5}}),
        Case("reflector of another shape", 904, REFLECTOR, dock={"reflector_angle": 3.6}),
        Case("battery does not charge", 906, dock={"powered": False}, docking={"max_retries": 1}),
        Case("staging pose out of reach", 903, shapes=_wall(), options={"max_staging_time_s": 30.0}),
        Case("canceled", 9011, meddle=_cancel),
    ]


def _wall() -> tuple[Shape, ...]:
    """A closed box around the staging pose and the dock."""
    x0, x1, y0, y1 = 1.2, 3.6, -0.6, 1.4
    corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]
    return tuple(Shape(segment=[a, b]) for a, b in pairwise(corners))


# --- tables -----------------------------------------------------------------------------------------------------------


def table(outcomes: Sequence[Outcome]) -> str:
    """The figures of many runs."""
    docked = [one for one in outcomes if one.code == 0]
    good = sum(one.good for one in outcomes)
    millimeters = np.array([1000.0 * one.error_m for one in docked] or [math.nan])
    degrees = np.degrees([one.error_rad for one in docked] or [math.nan])
    retries = Counter(one.retries for one in docked)
    failures = Counter(one.code for one in outcomes if one.code)
    lateral, turned = np.quantile(millimeters, 0.95), np.quantile(degrees, 0.95)
    lines = [
        f"dockings                    {len(outcomes)}",
        f"charging                    {len(docked)} ({len(docked) / len(outcomes):.2%})",
        f"within 1 cm and 1 degree    {good} ({good / len(outcomes):.2%})",
        f"without / 1 / 2 / 3 retries {' / '.join(str(retries[k]) for k in range(4))}",
        f"error, mean / 95 % / max    {millimeters.mean():.1f} / {lateral:.1f} / {millimeters.max():.1f} mm",
        f"                            {degrees.mean():.2f} / {turned:.2f} / {degrees.max():.2f} degrees",
        f"time, mean                  {np.mean([one.seconds for one in outcomes]):.1f} s",
        f"collisions                  {sum(one.collisions for one in outcomes)}",
        f"failures by code            {dict(failures) or 'none'}",
    ]
    return "\n".join(lines)


def _run_random(arguments: tuple[str, int]) -> Outcome:
    return run_random(*arguments)


def main() -> int:
    """Print the table, or the hostile cases; exit with 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--detector", choices=(CAMERA, REFLECTOR), default=CAMERA)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--cases", action="store_true")
    given = parser.parse_args()
    if given.cases:
        wrong = 0
        for case in cases():
            outcome = run(case, given.seed)
            right = outcome.code == case.code
            wrong += not right
            print(
                f"{'ok  ' if right else 'FAIL'} {case.name}: {outcome.code}, {case.code} expected; {outcome.retries} retries"
            )
            if outcome.message:
                print(f"       {outcome.message}")
        return int(wrong > 0)
    work = [(given.detector, given.seed + k) for k in range(given.count)]
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        outcomes = list(pool.map(_run_random, work, chunksize=4))
    print(table(outcomes))
    for number, one in enumerate(outcomes):
        if not one.good:
            errors = f"{one.error_m:.4f} m, {math.degrees(one.error_rad):.2f} degrees"
            print(f"run {given.seed + number}: {one.code} {one.message} {errors}")
    return int(sum(one.good for one in outcomes) < 0.995 * len(outcomes))


if __name__ == "__main__":
    sys.exit(main())
