"""Scenarios: scenario files, runs, success conditions, tours and suites."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.scenario.barn import GOAL as GOAL
    from navstack.scenario.barn import JACKAL as JACKAL
    from navstack.scenario.barn import ROUGH_JACKAL as ROUGH_JACKAL
    from navstack.scenario.barn import START as START
    from navstack.scenario.barn import WORLDS_FILE as WORLDS_FILE
    from navstack.scenario.barn import BarnWorld as BarnWorld
    from navstack.scenario.barn import barn_map as barn_map
    from navstack.scenario.barn import barn_spec as barn_spec
    from navstack.scenario.barn import load_worlds as load_worlds
    from navstack.scenario.file_reader import ReadContext as ReadContext
    from navstack.scenario.file_reader import check_scenario as check_scenario
    from navstack.scenario.file_reader import check_unique_names as check_unique_names
    from navstack.scenario.file_reader import load_scenario as load_scenario
    from navstack.scenario.file_reader import read_part as read_part
    from navstack.scenario.file_reader import read_scenario as read_scenario
    from navstack.scenario.file_reader import scenarios_in as scenarios_in
    from navstack.scenario.file_writer import scenario_text as scenario_text
    from navstack.scenario.file_writer import write_scenario as write_scenario
    from navstack.scenario.footprint_scenarios import FOOTPRINTS as FOOTPRINTS
    from navstack.scenario.footprint_scenarios import check_footprint as check_footprint
    from navstack.scenario.interactions import INTERACTION as INTERACTION
    from navstack.scenario.interactions import Drive as Drive
    from navstack.scenario.outcome import GoalOutcome as GoalOutcome
    from navstack.scenario.outcome import RunResult as RunResult
    from navstack.scenario.outcome import failure_advice as failure_advice
    from navstack.scenario.places import Places as Places
    from navstack.scenario.places import load_places as load_places
    from navstack.scenario.places import visit_order as visit_order
    from navstack.scenario.random_maps import FreeSpace as FreeSpace
    from navstack.scenario.random_scenarios import check_random as check_random
    from navstack.scenario.recognition import is_scenario_file as is_scenario_file
    from navstack.scenario.recognition import shipped_scenarios as shipped_scenarios
    from navstack.scenario.run import Run as Run
    from navstack.scenario.run import advice_for_goal as advice_for_goal
    from navstack.scenario.run import advice_of as advice_of
    from navstack.scenario.run import run_scenario as run_scenario
    from navstack.scenario.run import warm_up as warm_up
    from navstack.scenario.scenario import Scenario as Scenario
    from navstack.scenario.spec import ScenarioSpec as ScenarioSpec
    from navstack.scenario.spec import check_start_on_map as check_start_on_map
    from navstack.scenario.spec import scenario_error as scenario_error
    from navstack.scenario.spec import single_goal_spec as single_goal_spec
    from navstack.scenario.steps import EXAMPLES as EXAMPLES
    from navstack.scenario.steps import Step as Step
    from navstack.scenario.steps import read_step as read_step
    from navstack.scenario.steps import step_data as step_data
    from navstack.scenario.steps import step_text as step_text
    from navstack.scenario.success import ConditionResult as ConditionResult
    from navstack.scenario.success import SuccessConditions as SuccessConditions
    from navstack.scenario.suites import load_suite as load_suite
    from navstack.scenario.suites import scaled as scaled
    from navstack.scenario.suites import suite_names as suite_names
    from navstack.scenario.suites import suite_scale as suite_scale
    from navstack.scenario.tour import TourResult as TourResult
    from navstack.scenario.tour import TourState as TourState
    from navstack.scenario.tour import drive_tour as drive_tour
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
