"""Tours: several named places, driven to one after another, as the tutorial MultiNav for ROS does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from navstack.core import working_time
from navstack.scenario.outcome import GoalOutcome, RunResult
from navstack.scenario.run import Run
from navstack.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True)
class TourState:
    """The state of a tour, during the run and at the end."""

    total: int
    """Number of goals of the whole tour."""
    done: int
    succeeded: int
    running_s: float
    """Simulated seconds since the start."""
    distance_m: float
    place: str | None
    """The place the robot is driving to; None between goals and at the end."""
    has_steps: bool = False
    """True if there are motions among the goals."""

    @property
    def success_rate(self) -> float | None:
        """Share of the ended goals that succeeded; None before the first goal has ended."""
        return self.succeeded / self.done if self.done else None

    def __str__(self) -> str:
        what = "steps completed" if self.has_steps else "goals reached"
        failed, left = self.done - self.succeeded, self.total - self.done
        parts = [f"{self.succeeded} of {self.total} {what}"]
        parts += [f"{failed} failed"] if failed else []
        parts += [f"{left} to go"] if left else []
        return f"{', '.join(parts)}; {self.running_s:.1f} s, {self.distance_m:.1f} m"


@dataclass(frozen=True, slots=True)
class TourResult:
    """How a tour ended."""

    run: RunResult
    names: tuple[str, ...]
    """Names of the places, those of skipped goals included."""
    state: TourState
    interrupted: bool

    @property
    def succeeded(self) -> bool:
        """True if every goal of the tour was reached."""
        return self.state.succeeded == self.state.total

    def as_dict(self) -> dict[str, Any]:
        """Returns the document of `navstack tour --json`, without the file names."""
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
    """Drives to the scenario's goals; `names` are the names of their places. `stop` is called before every cycle.

    When `stop` returns True, the current goal is canceled, the robot stops and the record is complete.
    """
    wall_start = working_time()
    run = Run(scenario)
    reported, interrupted, succeeded = 0, False, 0
    has_steps = bool(scenario.steps)

    def state() -> TourState:
        place = None if run.done or run.is_paused else names[run.goal_index]
        return TourState(
            len(names), reported, succeeded, run.robot.time, run.robot.distance_travelled, place, has_steps
        )

    while True:
        interrupted = stop is not None and stop()
        if interrupted:
            run.stop()
        running = not interrupted and run.step()
        while reported < len(run.outcomes):
            outcome = run.outcomes[reported]
            reported += 1
            succeeded += outcome.succeeded
            if on_goal is not None:
                on_goal(names[reported - 1], outcome, state())
        if not running:
            break
        if on_step is not None:
            on_step(state())
    return TourResult(run.result(working_time() - wall_start), names, state(), interrupted)
