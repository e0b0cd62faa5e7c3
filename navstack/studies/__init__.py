"""Many runs are one pipe: `Task` (a benchmark, a comparison, a sweep) -> `Job` -> `Table`.

A task names its jobs, executors run them in processes or on a cluster, a results file keeps what is finished, and the task puts
the results into tables. Tuning searches with the same jobs and executors, and compares runs with the same statistics.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.studies.barn import BarnTask as BarnTask
    from navstack.studies.comparison import Comparison as Comparison
    from navstack.studies.controllers import ControllersTask as ControllersTask
    from navstack.studies.controllers import read_groups as read_groups
    from navstack.studies.controllers import read_tunings as read_tunings
    from navstack.studies.doctor import Cause as Cause
    from navstack.studies.doctor import Diagnosis as Diagnosis
    from navstack.studies.doctor import diagnose as diagnose
    from navstack.studies.doctor import make_drives as make_drives
    from navstack.studies.doctor import record_of as record_of
    from navstack.studies.inputs import for_workers as for_workers
    from navstack.studies.inputs import short_names as short_names
    from navstack.studies.jobs import Job as Job
    from navstack.studies.jobs import JobResult as JobResult
    from navstack.studies.movingai import DEFAULT_PLANNERS as DEFAULT_PLANNERS
    from navstack.studies.movingai import MovingaiTask as MovingaiTask
    from navstack.studies.parameter_sets import CompareTask as CompareTask
    from navstack.studies.parameter_sets import ParameterSet as ParameterSet
    from navstack.studies.parameter_sets import read_scenarios as read_scenarios
    from navstack.studies.pipeline import TuneOutput as TuneOutput
    from navstack.studies.pipeline import TuneRequest as TuneRequest
    from navstack.studies.pipeline import run_sensitivity as run_sensitivity
    from navstack.studies.pipeline import run_tuning as run_tuning
    from navstack.studies.planners import SEARCHING as SEARCHING
    from navstack.studies.planners import PlannersTask as PlannersTask
    from navstack.studies.planners import map_files as map_files
    from navstack.studies.problem import Trial as Trial
    from navstack.studies.random_scenarios import FootprintTask as FootprintTask
    from navstack.studies.random_scenarios import RandomTask as RandomTask
    from navstack.studies.run_page import write_run_report as write_run_report
    from navstack.studies.safety import SafetyTask as SafetyTask
    from navstack.studies.search_space import SearchSpace as SearchSpace
    from navstack.studies.search_space import candidates as candidates
    from navstack.studies.search_space_parser import parse_search_space as parse_search_space
    from navstack.studies.setup import SearchOptions as SearchOptions
    from navstack.studies.setup import Setup as Setup
    from navstack.studies.setup import prepare as prepare
    from navstack.studies.speed import SpeedTask as SpeedTask
    from navstack.studies.speed import read_reference as read_reference
    from navstack.studies.sweep import Sweep as Sweep
    from navstack.studies.sweep import run_sweep as run_sweep
    from navstack.studies.table import Column as Column
    from navstack.studies.table import Table as Table
    from navstack.studies.table import as_json as as_json
    from navstack.studies.task import LINE_INTERVAL_S as LINE_INTERVAL_S
    from navstack.studies.task import Report as Report
    from navstack.studies.task import Task as Task
    from navstack.studies.task import run_jobs as run_jobs
    from navstack.studies.task import time_left_bar as time_left_bar
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
