"""A tour: named places, one after another, as MultiNav of the ROS tutorials does it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from navstack.scenario.run import GoalOutcome, Run, RunResult, Scenario


@dataclass(frozen=True, slots=True)
class TourState:
    """How a tour stands, while it runs and at the end."""

    total: int
    """Goals of the whole tour."""
    done: int
    succeeded: int
    running_s: float
    """Simulated seconds since the start."""
    distance_m: float
    place: str | None
    """Where the robot is going; None between goals and at the end."""

    @property
    def success_rate(self) -> float | None:
        """Of the goals that have ended; None before the first has."""
        return self.succeeded / self.done if self.done else None

    def __str__(self) -> str:
        rate = self.success_rate
        said = "" if rate is None else f" ({100.0 * rate:.0f} %)"
        return (
            f"{self.succeeded} of {self.done} goals reached{said}, {self.total - self.done} to go; "
            f"{self.running_s:.1f} s, {self.distance_m:.1f} m"
        )


@dataclass(frozen=True, slots=True)
class TourResult:
    """How a tour ended."""

    run: RunResult
    names: tuple[str, ...]
    """Of the goals in `run.goals`, and of those that were left out."""
    state: TourState
    interrupted: bool

    @property
    def succeeded(self) -> bool:
        """True when every goal of the tour was reached."""
        return self.state.succeeded == self.state.total

    def as_dict(self) -> dict[str, Any]:
        """The document of `navstack tour --json`, without its files."""
        goals = [{"place": name, **goal.as_dict()} for name, goal in zip(self.names, self.run.goals)]
        return {
            **self.run.as_dict(),
            "goals": goals,
            "left_out": list(self.names[len(goals) :]),
            "success_rate": self.state.success_rate,
            "running_s": round(self.state.running_s, 6),
            "distance_m": self.state.distance_m,
            "interrupted": self.interrupted,
        }


def drive_tour(
    scenario: Scenario,
    names: tuple[str, ...],
    *,
    on_goal: Callable[[str, GoalOutcome, TourState], None] | None = None,
    on_step: Callable[[TourState], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> TourResult:
    """Drives the scenario's goals, whose places are called `names`; `stop` is asked before every cycle.

    A stopped tour keeps its record: the goal at hand is cancelled and the robot stands.
    """
    wall_start = time.perf_counter()
    run = Run(scenario)
    told, interrupted, succeeded = 0, False, 0

    def state() -> TourState:
        going = None if run.done or run.is_resting else names[run.goal_index]
        return TourState(len(names), told, succeeded, run.robot.time, run.robot.distance_travelled, going)

    while True:
        interrupted = stop is not None and stop()
        if interrupted:
            run.stop()
        goes_on = not interrupted and run.step()
        while told < len(run.outcomes):
            outcome = run.outcomes[told]
            told += 1
            succeeded += outcome.succeeded
            if on_goal is not None:
                on_goal(names[told - 1], outcome, state())
        if not goes_on:
            break
        if on_step is not None:
            on_step(state())
    return TourResult(run.result(time.perf_counter() - wall_start), names, state(), interrupted)
