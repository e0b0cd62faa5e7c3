"""Independent jobs on all cores, with results that survive a kill; used by benchmarks, sweeps and tuning.

    results = run_jobs(work, jobs, what={"params": "turtlebot"}, processes=2, results=Path("out/results.jsonl"))

`work` is a pure function of a job's input that returns JSON data. The results are in the order of the jobs and do not depend on
the number of processes or on interruptions.
"""

from navstack.jobs.job import Executor, Job, JobResult, SerialExecutor
from navstack.jobs.processes import ProcessExecutor, usable_cores
from navstack.jobs.results_file import ResultsFile
from navstack.jobs.run import run_jobs

__all__ = [
    "Executor",
    "Job",
    "JobResult",
    "ProcessExecutor",
    "ResultsFile",
    "SerialExecutor",
    "run_jobs",
    "usable_cores",
]
