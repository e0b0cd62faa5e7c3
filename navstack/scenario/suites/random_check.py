"""Drives random scenarios and checks invariants: no exception, no hang, a terminal state and a reason for every goal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from navstack.core.errors import InputError, PlanningError
from navstack.scenario.outcome import RunResult
from navstack.scenario.run import Run
from navstack.scenario.scenario import Scenario
from navstack.scenario.success import TERMINAL_STATES
from navstack.scenario.suites.random_scenarios import random_scenario

TIME_LIMIT_SLACK_S: Final = 5.0
"""Simulated seconds a goal may take to end after its time limit; a cancel takes effect within one control cycle."""


@dataclass(frozen=True, slots=True)
class RandomScenarioResult:
    """The result of checking a random scenario."""

    number: int
    outcome: str
    """The terminal states of its goals; `refused NAME` if it could not start; `exception`."""
    simulated_s: float
    collisions: int
    faults: tuple[str, ...]
    """Invariant violations."""


def check_random(number: int, *, time_limit_s: float = 12.0) -> RandomScenarioResult:
    """Drives the random scenario with that number and checks the invariants. An exception is a violation too."""
    faults: list[str] = []
    run: Run | None = None
    try:
        scenario = random_scenario(number, time_limit_s=time_limit_s).build()
        run = Run(scenario, record=False)
        # more cycles than any of them needs: a run that exceeds them would not end
        duration_s = len(scenario.items) * (scenario.time_limit_s + scenario.pause_s + TIME_LIMIT_SLACK_S)
        cycles_left = math.ceil(100.0 * duration_s)
        while run.step():
            cycles_left -= 1
            if cycles_left < 0:
                faults.append(f"the run does not end: still driving at {run.robot.time:.1f} s")
                break
        result = run.result(0.0)
    except (InputError, PlanningError) as error:
        # refused at the start: an obstacle at the start pose, contradictory parameters
        if run is None:
            return RandomScenarioResult(number, f"refused {error.name}", 0.0, 0, ())
        return _exception(number, run.robot.time, error)
    except Exception as error:
        # any exception that gets here is a violation
        return _exception(number, 0.0 if run is None else run.robot.time, error)
    faults += _violations(scenario, result)
    states = " ".join(goal.state for goal in result.goals)
    return RandomScenarioResult(number, states, result.simulated_s, result.collisions, tuple(faults))


def _exception(number: int, simulated_s: float, error: Exception) -> RandomScenarioResult:
    return RandomScenarioResult(number, "exception", simulated_s, 0, (f"{type(error).__name__}: {error}",))


def _violations(scenario: Scenario, result: RunResult) -> list[str]:
    faults: list[str] = []
    for i, goal in enumerate(result.goals, 1):
        if goal.state not in TERMINAL_STATES:
            faults.append(f"goal {i} is not in a terminal state: {goal.state}")
        if goal.state != "SUCCEEDED" and not (goal.message or goal.text):
            faults.append(f"goal {i} ended {goal.state} without a reason")
        if goal.time_s > scenario.time_limit_s + TIME_LIMIT_SLACK_S:
            faults.append(f"goal {i} took {goal.time_s:.1f} s, its time limit is {scenario.time_limit_s:.1f} s")
    stopped = scenario.stop_on_failure and any(not goal.succeeded for goal in result.goals)
    if len(result.goals) < len(scenario.items) and not stopped:
        faults.append(f"{len(scenario.items) - len(result.goals)} goals were not driven")
    if result.succeeded and result.collisions:
        faults.append(f"success despite {result.collisions} collisions")
    if result.min_clearance_m == 0.0 and not result.collisions:
        faults.append("the footprint overlapped an obstacle, but no collision was reported")
    for name, value in result.metrics.as_dict().items():
        if isinstance(value, float) and math.isnan(value) and name != "clearance_mean_m":
            faults.append(f"the metric {name} is NaN")
    return faults
