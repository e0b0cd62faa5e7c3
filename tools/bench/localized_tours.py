"""Tours through an office and Willow Garage on estimated poses, next to the same tours on the true pose.

    python tools/bench/localized_tours.py [--count N] [--map office|willow|both] [--seed N] [--verbose]

Each tour has three goals and is driven twice with one seed: with `localization: truth`, and with `localization: amcl` and
`odometry: ekf` (wheels and a gyroscope). Everything that goes wrong on robots goes wrong in both: wheels slip, unequal wheels
turn the odometry, the gyroscope drifts, beams are noisy and get lost, people walk about, and things stand around that are not on
the map. The localizer starts 0.3 m and 0.15 rad off. A tour succeeds if every goal is reached, and the robot is then truly within
0.5 m of it. The map and the places of Willow Garage are those of golden_ros1 (NAVSTACK_GOLDEN_ROS1).
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from global_search import FOLDER, WRONG_M, load_drive, load_grid
from reference import Reference

from navstack.core import NavError, OccupancyGrid, Pose2D
from navstack.map_io import load_map, map_path, packaged_map_file
from navstack.parameters import load_configuration
from navstack.scenario import Run, Scenario, load_places
from navstack.sim import PedestrianMotion, Shape

GOALS = 3
ROOM_M = 0.5
"""Free space around starts, goals and people."""
NOISE: dict[str, Any] = {
    "wheel_slip": 0.05,
    "wheel_slip_turn": 0.02,
    "odometry_noise": 0.03,
    "odometry_turn": 0.03,
    "laser/fov": 4.0,
    "laser/beams": 180,
    "laser/range_max": 10.0,
    "laser/range_noise": 0.01,
    "laser/dropout": 0.02,
    "imus": "[imu]",
    "imu/yaw_rate_noise": 0.01,
    "imu/yaw_rate_bias": 0.003,
    "imu/yaw_rate_drift": 0.0005,
}
ESTIMATED: dict[str, Any] = {"localization": "amcl", "odometry": "ekf", "initial_pose_error": "[0.25, -0.17, 0.15]"}
AMCL = ("amcl/min_particles=500", "amcl/max_particles=2000", "amcl/laser_max_beams=60")
RECOVERIES = (
    "recovery_behaviors=[{name: localize, type: spin_to_localize}, {name: conservative_reset, type: "
    "clear_costmap_recovery/ClearCostmapRecovery}, {name: rotate, type: rotate_recovery/RotateRecovery}]"
)


@dataclass(frozen=True, slots=True)
class Result:
    """One tour."""

    reached: int
    contacts: int
    """Contacts with walls and things; people walk into the robot, too."""
    simulated_s: float
    cpu_s: float
    off: np.ndarray[Any, Any]
    """Distance of the believed from the true position in each control cycle (m)."""
    alarms: int
    states: tuple[str, ...]

    @property
    def succeeded(self) -> bool:
        """True if every goal was reached."""
        return self.reached == GOALS


def room_of(grid: OccupancyGrid) -> np.ndarray[Any, Any]:
    """(ny, nx) distance to the nearest cell that is not free (m)."""
    from scipy.ndimage import distance_transform_edt

    found: Any = distance_transform_edt(np.asarray(grid.data == 0))
    return found * grid.geometry.resolution


def places_of(name: str, grid: OccupancyGrid) -> np.ndarray[Any, Any]:
    """(n, 3) poses with free space around them, between which a robot can drive."""
    if name == "office":
        poses = np.array(
            [tuple(pose) for pose in load_places(packaged_map_file("office", ".places.yaml")).places.values()]
        )
    else:
        poses = np.concatenate([load_drive(FOLDER / f"amcl_drive_willow_{i}.npz")["truth"][::25] for i in (1, 2)])
    g, room = grid.geometry, room_of(grid)
    ix, iy = ((poses[:, k] - o) / g.resolution for k, o in ((0, g.origin_x), (1, g.origin_y)))
    return poses[room[iy.astype(int), ix.astype(int)] > ROOM_M]


def tour(name: str, grid: OccupancyGrid, places: np.ndarray[Any, Any], seed: int, *, estimated: bool) -> Scenario:
    """Tour `seed`: goals at least 4 m apart, 12 things that are not on the map and leave 0.65 m next to them, 5 people."""
    rng = np.random.default_rng(seed)
    settings = {**NOISE, **(ESTIMATED if estimated else {})}
    overrides = [f"navstack/sim/{key}={value}" for key, value in settings.items()]
    configuration = load_configuration(["turtlebot"], overrides=[*overrides, *AMCL, RECOVERIES])
    stops: list[Pose2D] = []
    while len(stops) <= GOALS:
        stop = Pose2D(*places[rng.integers(len(places))].tolist())
        if not stops or stops[-1].distance_to(stop) > 4.0:
            stops.append(stop)
    shapes: list[Shape] = []
    free = np.argwhere(room_of(grid) > 0.9)
    g = grid.geometry
    while len(shapes) < 12:
        iy, ix = free[rng.integers(len(free))].tolist()
        x, y = g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution
        if min(math.hypot(stop.x - x, stop.y - y) for stop in stops) < 1.0 or not any(
            math.hypot(stop.x - x, stop.y - y) < 12.0 for stop in stops
        ):
            continue
        shapes.append(Shape(radius=float(rng.uniform(0.1, 0.25)), pose=[x, y]))
    while len(shapes) < 17:
        ends = places[rng.choice(len(places), 2, replace=False), :2].tolist()
        if min(math.hypot(stops[0].x - ends[0][0], stops[0].y - ends[0][1]), math.dist(*ends)) > 2.0:
            motion = PedestrianMotion(goals=[ends[1], ends[0]])
            shapes.append(Shape(name=f"person {len(shapes) - 11}", radius=0.2, pose=ends[0], motion=motion))
    return Scenario(
        grid, configuration, stops[0], tuple(stops[1:]), shapes=tuple(shapes), seed=seed, time_limit_s=240.0, name=name
    )


def drive(scenario: Scenario) -> Result:
    """Drive a tour."""
    began = time.process_time()
    run = Run(scenario, scans=False)
    robot, off = run.robot, [0.0]
    while run.step():
        believed = robot.frames.lookup(robot.map_frame, robot.base_frame)
        off.append(math.hypot(believed.x - robot.pose.x, believed.y - robot.pose.y))
    cpu = time.process_time() - began
    reached = sum(goal.succeeded and goal.distance_left_m < WRONG_M for goal in run.outcomes)
    localizer: Any = robot.estimation.localizer
    contacts = sum(not collision.name.startswith("person") for collision in robot.collisions)
    alarms = 0 if localizer is None else len(localizer.alarms)
    states = tuple(goal.state if goal.succeeded else goal.error_name for goal in run.outcomes)
    return Result(reached, contacts, robot.time, cpu, np.array(off), alarms, states)


def report(name: str, results: list[Result]) -> None:
    """Print the sums of the tours."""
    off = np.concatenate([result.off for result in results])
    simulated, cpu = (sum(getattr(result, what) for result in results) for what in ("simulated_s", "cpu_s"))
    print(
        f"{name}: {sum(r.succeeded for r in results)} of {len(results)} tours, {sum(r.reached for r in results)} of "
        f"{GOALS * len(results)} goals; {sum(r.contacts for r in results)} contacts; off by {np.sqrt(np.mean(off**2)):.3f} m "
        f"rms, 95 % {np.quantile(off, 0.95):.3f} m, most {off.max():.2f} m; {sum(r.alarms for r in results)} alarms; "
        f"{simulated:.0f} s simulated at {simulated / cpu:.0f} times real time (processor time)",
        flush=True,
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="tours of each map")
    parser.add_argument("--map", default="both", choices=["office", "willow", "both"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbose", action="store_true", help="print every tour")
    options = parser.parse_args()
    reference = Reference()
    if reference.available:
        print(f"calibration {reference.calibration_ms():.1f} ms")
    for name in ("office", "willow") if options.map == "both" else (options.map,):
        grid = load_map(map_path("office")) if name == "office" else load_grid("willow")
        places = places_of(name, grid)
        results: dict[bool, list[Result]] = {False: [], True: []}
        seed = options.seed
        while len(results[True]) < options.count:
            seed += 1
            for estimated in (False, True):
                try:
                    result = drive(tour(name, grid, places, seed, estimated=estimated))
                except NavError as error:  # the start is occupied by a thing
                    if options.verbose:
                        print(f"{name} {seed}: left out: {error.message}")
                    break
                results[estimated].append(result)
                if options.verbose:
                    what = "amcl, ekf" if estimated else "truth"
                    print(f"{name} {seed} {what}: {result.states}, most off {result.off.max():.2f} m", flush=True)
        report(f"{name}, truth", results[False])
        report(f"{name}, amcl and ekf", results[True])


if __name__ == "__main__":
    main()
