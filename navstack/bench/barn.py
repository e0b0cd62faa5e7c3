"""BARN: ten metres through a field of cylinders, without a map.

Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020; scored as the BARN Challenge does. A robot
starts at the origin of its odometry, facing along y; the goal lies 10 m ahead. Success: within 1 m of the goal, without
contact, in under 100 s, from when it has moved 0.1 m. The score of a world is `OT / clip(AT, 2 OT, 8 OT)`, OT the time
that the shortest way takes at 2 m/s and AT the time taken, and 0 without success: 0.5 at most.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from navstack.parameters.configuration import Configuration, load_configuration
from navstack.record import RunRecorder
from navstack.scenario.run import Run, Scenario
from navstack.scenario.suites.barn_worlds import GOAL, JACKAL, ROUGH_JACKAL, START, BarnWorld, barn_map, load_worlds

__all__ = [
    "JACKAL",
    "ROUGH_JACKAL",
    "BarnOutcome",
    "BarnWorld",
    "barn_configuration",
    "barn_scenario",
    "load_worlds",
    "run_world",
]

REACHED_M: Final = 1.0
MOVED_M: Final = 0.1
TIME_LIMIT_S: Final = 100.0


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
    jerk_rms_m_s3: float = math.nan
    """As `RunMetrics` has it; NaN where nobody knows."""
    recoveries: int = 0
    """Recovery behaviours run."""
    text: str = ""
    """What the goal's result said, where it ended."""

    @property
    def succeeded(self) -> bool:
        """True within 1 m of the goal, without contact and in time."""
        return self.outcome == "success"


def barn_configuration(
    params: Path | Sequence[str],
    *,
    distro: str | None = None,
    rough: bool = False,
    noise_m: float | None = None,
    overrides: Sequence[str] = (),
) -> Configuration:
    """The parameters of a robot as published, in the benchmark's simulator.

    `noise_m`: standard deviation of the lidar's ranges (m), in the place of the simulator's own. Raises ParameterError.
    """
    simulator = dict(ROUGH_JACKAL if rough else JACKAL)
    if noise_m is not None:
        simulator["laser"] = {**simulator["laser"], "range_noise": noise_m}
    sources = [str(params)] if isinstance(params, Path) else list(params)
    return load_configuration([*sources, {"navstack": {"sim": simulator}}], overrides=overrides, distro=distro)


def barn_scenario(world: BarnWorld, configuration: Configuration, *, seed: int = 0) -> Scenario:
    """The task of a world. The map is empty: it only says how far pictures reach."""
    return Scenario(
        map=barn_map(world),
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
    """Drives through `world` once: a pure function of its arguments. The recorder only with `record`.

    Raises InputError or PlanningError when the robot cannot stand at the start.
    """
    run = Run(barn_scenario(world, configuration, seed=seed), record=record)
    robot = run.robot
    began: float | None = None
    turning, last = 0.0, 0.0
    ended = "timeout"
    while True:
        stepped = run.step()
        pose, now = robot.pose, robot.time
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
    driven = run.result(0.0)
    outcome = BarnOutcome(
        world=world.number,
        outcome=ended,
        time_s=taken,
        length_m=robot.distance_travelled,
        clearance_m=0.0 if ended == "collision" else driven.nearest_m,
        score=world.score(taken) if ended == "success" else 0.0,
        turning_s=turning,
        jerk_rms_m_s3=driven.metrics.jerk_rms_m_s3,
        recoveries=run.outcomes[-1].recoveries if run.outcomes else run.move_base.feedback.recoveries,
        text=run.outcomes[-1].message if run.outcomes else "",
    )
    if run.recorder is not None and not run.outcomes:
        run.recorder.finish([], robot.collisions)
    return outcome, run.recorder
