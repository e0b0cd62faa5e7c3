"""Scenarios: scenario files, runs, success conditions, tours and suites."""

from navstack.scenario.file.spec import ScenarioSpec, check_scenario, load_scenario, read_scenario
from navstack.scenario.outcome import GoalOutcome, RunResult
from navstack.scenario.run import Run, run_scenario, warm_up
from navstack.scenario.scenario import Scenario
from navstack.scenario.success import ConditionResult, SuccessConditions
from navstack.scenario.suites.catalogue import load_suite, shipped_scenarios, suite_names
from navstack.scenario.tour import TourResult, TourState, drive_tour

__all__ = [
    "ConditionResult",
    "GoalOutcome",
    "Run",
    "RunResult",
    "Scenario",
    "ScenarioSpec",
    "SuccessConditions",
    "TourResult",
    "TourState",
    "check_scenario",
    "drive_tour",
    "load_scenario",
    "load_suite",
    "read_scenario",
    "run_scenario",
    "shipped_scenarios",
    "suite_names",
    "warm_up",
]
