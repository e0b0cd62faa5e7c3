"""Drive the packaged controllers through random worlds while their lidar fails for a while, and count collisions.

    python tools/sensor_faults.py [--worlds N] [--first N] [--sets NAME ..] [--faults NAME ..] [--in-turn] [--patience S]
                                   [--out FILE]

A world is a random map with boxes that are not on it; nothing moves but the robot, so that it stands safely. During a fault the
lidar is blind (no valid range), silent (no message), frozen (the last scan again, with new stamps), lying (free everywhere) or
turned (every beam 0.5 rad beside its direction). Its source expects data (`expected_update_rate`). Blind and silent lidars must
cause no collision once that time has passed, and the robot must stand; the other faults show what cannot be detected. The runs
of the same worlds without a fault show what it costs. With `--in-turn` each world has one of the faults only, and a tenth of
them is driven without a fault, too.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.core import InputError, LaserScan, PlanningError
from navstack.scenario import ScenarioSpec, random_maps
from navstack.scenario.random_maps import FreeSpace
from navstack.scenario.run import Run
from navstack.sim import Shape

SETS: Final = (
    "turtlebot",
    "turtlebot_rollout",
    "turtlebot_mppi",
    "turtlebot_rpp",
    "turtlebot_shim",
    "turtlebot_graceful",
)
FAULTS: Final = ("blind", "silent", "frozen", "lying", "turned")
RATE_S: Final = 0.5
"""expected_update_rate of the lidar's source (s)."""
STANDING_M_S: Final = 0.02
"""A slower robot stands."""
BRAKING_S: Final = 1.0
"""Time to stand still after the source has become stale: one control period, the braking, the lag of the base (s)."""


@dataclass(frozen=True)
class Outcome:
    """How one run ended."""

    set: str
    fault: str
    world: int
    succeeded: bool
    time_s: float
    collisions: int
    during_fault: int
    """Collisions during a fault."""
    after_rate: int
    """Those of them more than RATE_S after its beginning."""
    longest_drive_s: float
    """Longest time that the robot drove on in a fault, from the beginning of the fault."""
    error: str


def world_spec(name: str, number: int, patience_s: float) -> ScenarioSpec:
    """Return the scenario of a world: the same for every set. `patience_s`: controller_patience, 0 for that of the set."""
    rng = np.random.Generator(np.random.PCG64([number, 77]))
    if number % 2:
        grid = random_maps.rooms(rng, 12.0, 10.0, (1.0, 1.4))
    else:
        grid = random_maps.discs(rng, 12.0, 10.0, 0.15, (0.1, 0.4))
    space = FreeSpace(grid, 0.4)
    start, goal = space.draw_pair(rng, 6.0, 12.0)
    shapes: list[Shape] = []
    while len(shapes) < 4:
        at = space.draw(rng)
        if min(at.distance_to(start), at.distance_to(goal)) > 1.0:
            shapes.append(Shape(box=[0.3, 0.3], pose=[at.x, at.y, at.yaw]))
    source = {"expected_update_rate": RATE_S}
    layers = {"obstacle_layer": {"scan": source}}
    sim = {"laser": {"fov": 4.7, "beams": 270, "range_max": 6.0}}
    values = {
        "name": f"world {number}",
        "start": start,
        "goals": (goal,),
        "seed": number,
        "time_limit_s": 90.0,
        "shapes": tuple(shapes),
    }
    overlay: dict[str, Any] = {"global_costmap": layers, "local_costmap": layers, "navstack": {"sim": sim}}
    if patience_s:
        overlay["controller_patience"] = patience_s
    return ScenarioSpec(values, grid=grid, sources=[name], overlays=[overlay], goal_names=("",))


class FaultyLidar:
    """Replaces the scans of a simulated robot during the windows of a fault."""

    def __init__(self, kind: str, number: int, scans: Callable[[], Sequence[Any]], clock: Callable[[], float]) -> None:
        rng = np.random.Generator(np.random.PCG64([number, 78]))
        begins = np.cumsum(rng.uniform(6.0, 12.0, 12))
        self.windows = [(float(at), float(at + length)) for at, length in zip(begins, rng.uniform(1.5, 5.0, 12))]
        self._kind, self._scans, self._clock = kind, scans, clock
        self._last: LaserScan | None = None

    def active_since(self, time: float) -> float | None:
        """Return when the fault that is active began; None if there is none."""
        return next((begin for begin, end in self.windows if begin <= time < end), None)

    def __call__(self) -> list[Any]:
        """Return the sensor data of the robot, with the fault."""
        out: list[Any] = []
        for data in self._scans():
            if not isinstance(data, LaserScan):
                out.append(data)
            elif self.active_since(data.stamp) is None:
                self._last = data
                out.append(data)
            elif (made := self._spoilt(data)) is not None:
                out.append(made)
        return out

    def _spoilt(self, scan: LaserScan) -> LaserScan | None:
        ranges = scan.ranges
        match self._kind:
            case "blind":
                ranges = np.full_like(ranges, np.nan)
            case "silent":
                return None
            case "frozen":
                ranges = ranges if self._last is None else self._last.ranges
            case "lying":
                ranges = np.full_like(ranges, np.inf)
            case _:
                ranges = np.roll(ranges, round(0.5 / scan.angle_increment))
        return LaserScan(
            ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, scan.stamp, scan.frame, scan.topic,
            scan.height,
        )  # fmt: skip


def drive(task: tuple[str, str, int, float]) -> Outcome:
    """Drive one world; `task`: set, fault (empty: none), number, controller_patience (s, 0: that of the set)."""
    name, fault, number, patience_s = task
    base = Outcome(name, fault, number, False, 0.0, 0, 0, 0, 0.0, "")
    try:
        run = Run(world_spec(name, number, patience_s).build(), record=False)
    except (InputError, PlanningError) as exc:
        return replace(base, error=str(exc))
    robot = run.robot
    lidar = FaultyLidar(fault, number, robot.scans, lambda: robot.time)
    if fault:
        robot.scans = lidar  # pyright: ignore[reportAttributeAccessIssue]
    drives = 0.0
    before = robot.pose
    while True:
        time = robot.time
        if not run.step():
            break
        since = lidar.active_since(robot.time)
        if since is not None and robot.time > time:
            speed = robot.pose.distance_to(before) / (robot.time - time)
            if speed > STANDING_M_S and lidar.active_since(time) == since:
                drives = max(drives, robot.time - since)
        before = robot.pose
    result = run.result(0.0)
    hits = [(c.time, lidar.active_since(c.time)) for c in robot.collisions]
    during = [time - since for time, since in hits if since is not None]
    return replace(
        base,
        succeeded=all(goal.succeeded for goal in result.goals),
        time_s=result.simulated_s,
        collisions=len(hits),
        during_fault=len(during),
        after_rate=sum(age > RATE_S for age in during),
        longest_drive_s=drives,
    )


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return one line per set and fault."""
    lines = [
        "| set | fault | worlds | goals reached | mean time (s) | collisions | in a fault | once stale | drove for (s) |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name in dict.fromkeys(o.set for o in outcomes):
        for fault in dict.fromkeys(o.fault for o in outcomes):
            group = [o for o in outcomes if (o.set, o.fault) == (name, fault) and not o.error]
            if not group:
                continue
            reached = [o.time_s for o in group if o.succeeded]
            mean = f"{sum(reached) / len(reached):.1f}" if reached else "-"
            drives = f"{max(o.longest_drive_s for o in group):.2f}" if fault else "-"
            sums = [sum(getattr(o, field) for o in group) for field in ("collisions", "during_fault", "after_rate")]
            lines.append(
                f"| {name} | {fault or 'none'} | {len(group)} | {len(reached)} | {mean} | {sums[0]} | {sums[1]} | {sums[2]} "
                f"| {drives} |"
            )
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sets", nargs="+", default=SETS)
    parser.add_argument("--faults", nargs="+", default=FAULTS, choices=FAULTS)
    parser.add_argument("--patience", type=float, default=0.0, help="controller_patience (s); 0: that of the sets")
    parser.add_argument("--in-turn", action="store_true", help="one of the faults per world, in turn")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, help="write the outcomes as JSON lines")
    args = parser.parse_args()
    numbers = range(args.first, args.first + args.worlds)

    def faults_of(number: int) -> Sequence[str]:
        if not args.in_turn:
            return ("", *args.faults)
        fault = args.faults[number % len(args.faults)]
        return ("", fault) if number // len(args.faults) % 10 == 0 else (fault,)

    tasks = [
        (name, fault, number, args.patience) for number in numbers for name in args.sets for fault in faults_of(number)
    ]
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(args.processes) as pool:
        for outcome in pool.map(drive, tasks):
            outcomes.append(outcome)
            if args.out is not None:
                with args.out.open("a") as file:
                    file.write(json.dumps(asdict(outcome)) + "\n")
    print("\n".join(table(outcomes)))
    refused = [o for o in outcomes if o.error]
    if refused:
        print(f"{len(refused)} runs could not start, for example: {refused[0].error}")
    late = [
        o
        for o in outcomes
        if o.fault in ("blind", "silent") and (o.after_rate or o.longest_drive_s > RATE_S + BRAKING_S)
    ]
    for o in late:
        print(f"{o.set}, {o.fault}, world {o.world}: {o.after_rate} collisions, drove for {o.longest_drive_s:.2f} s")
    return 1 if late else 0


if __name__ == "__main__":
    sys.exit(main())
