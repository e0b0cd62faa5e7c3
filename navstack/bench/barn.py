"""BARN: ten metres through a field of cylinders, without a map.

Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020; scored as in the BARN Challenge. The robot
starts at the origin of its odometry, facing along y; the goal is 10 m ahead. Success: within 1 m of the goal, without a
collision, in under 100 s, counted from when it has moved 0.1 m. The score of a world is `OT / clip(AT, 2 OT, 8 OT)`, where OT
is the time of the shortest path at 2 m/s and AT the time taken; it is 0 without success and 0.5 at most.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from navstack.parameters.configuration import Configuration, load_configuration
from navstack.record import RunRecorder
from navstack.scenario import Run, Scenario
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

GOAL_RADIUS_M: Final = 1.0
START_RADIUS_M: Final = 0.1
"""The clock starts when the robot is this far from the start."""
TIME_LIMIT_S: Final = 100.0


@dataclass(frozen=True, slots=True)
class BarnOutcome:
    """How a run through a world ended."""

    world: int
    outcome: str
    """success, collision, timeout, or the state of a goal that ended early (aborted, ..)."""
    time_s: float
    """Time since the robot had moved 0.1 m."""
    length_m: float
    clearance_m: float
    """Smallest distance between the robot's footprint and a cylinder, at the control cycles."""
    score: float
    turning_s: float
    """Time spent turning in place (below 0.01 m/s)."""
    jerk_rms_m_s3: float = math.nan
    """As in `RunMetrics`; NaN if unknown."""
    recoveries: int = 0
    """Number of recovery behaviours run."""
    text: str = ""
    """Message of the goal's result, if the goal ended."""

    @property
    def succeeded(self) -> bool:
        """True within 1 m of the goal, without a collision and in time."""
        return self.outcome == "success"


def barn_configuration(
    params: Path | Sequence[str],
    *,
    distro: str | None = None,
    rough: bool = False,
    noise_m: float | None = None,
    overrides: Sequence[str] = (),
) -> Configuration:
    """The parameters of a robot in the simulator of the benchmark.

    `noise_m`: standard deviation of the lidar ranges (m), instead of the simulator's default. Raises ParameterError.
    """
    simulator = dict(ROUGH_JACKAL if rough else JACKAL)
    if noise_m is not None:
        simulator["laser"] = {**simulator["laser"], "range_noise": noise_m}
    sources = [str(params)] if isinstance(params, Path) else list(params)
    return load_configuration([*sources, {"navstack": {"sim": simulator}}], overrides=overrides, distro=distro)


def barn_scenario(world: BarnWorld, configuration: Configuration, *, seed: int = 0) -> Scenario:
    """The scenario of a world. Its map is empty and only sets the extent of pictures."""
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


class _Monitor:
    """Applies the rules of BARN while a run advances."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._started: float | None = None
        self._now = 0.0
        self.turning_s = 0.0

    @property
    def time_s(self) -> float:
        """Time since the robot had moved 0.1 m."""
        return self._now - (self._started or 0.0)

    def outcome_after_step(self, *, running: bool) -> str | None:
        """The outcome if the run is over; `running`: whether the scenario itself has more steps."""
        robot = self._run.robot
        pose, now = robot.pose, robot.time
        velocity = robot.state().velocity
        if velocity.speed < 0.01 and abs(velocity.wz) > 0.01:
            self.turning_s += now - self._now
        self._now = now
        if self._started is None and pose.distance_to(START) >= START_RADIUS_M:
            self._started = now
        if robot.collisions:
            return "collision"
        if self._started is not None and pose.distance_to(GOAL) <= GOAL_RADIUS_M:
            return "success"
        # the limit also holds for a robot that never moves 0.1 m
        if self.time_s >= TIME_LIMIT_S:
            return "timeout"
        return None if running else self._run.outcomes[-1].state.lower()


def run_world(
    world: BarnWorld, configuration: Configuration, *, seed: int = 0, record: bool = False
) -> tuple[BarnOutcome, RunRecorder | None]:
    """Drives through `world` once; a pure function of its arguments. The recorder is None without `record`.

    Raises InputError or PlanningError if the robot does not fit at the start.
    """
    run = Run(barn_scenario(world, configuration, seed=seed), record=record)
    outcome = drive_world(world, run)
    if run.recorder is not None and not run.outcomes:
        run.recorder.finish([], run.robot.collisions)
    return outcome, run.recorder


def drive_world(world: BarnWorld, run: Run) -> BarnOutcome:
    """Drives a new `run` of the scenario of `world` until the rules of BARN end it."""
    monitor = _Monitor(run)
    ended: str | None = None
    while ended is None:
        ended = monitor.outcome_after_step(running=run.step())
    driven = run.result(0.0)
    last = run.outcomes[-1] if run.outcomes else None
    return BarnOutcome(
        world=world.number,
        outcome=ended,
        time_s=monitor.time_s,
        length_m=run.robot.distance_travelled,
        clearance_m=0.0 if ended == "collision" else driven.min_clearance_m,
        score=world.score(monitor.time_s) if ended == "success" else 0.0,
        turning_s=monitor.turning_s,
        jerk_rms_m_s3=driven.metrics.jerk_rms_m_s3,
        recoveries=last.recoveries if last is not None else run.move_base.feedback.recoveries,
        text=last.message if last is not None else "",
    )
