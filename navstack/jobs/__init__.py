"""Many independent jobs on all cores, with results that survive a kill: what benchmarks, sweeps and tuning stand on.

    results = run_jobs(work, jobs, what={"params": "turtlebot"}, processes=2, results=Path("out/results.jsonl"))

`work` is a function of a job's input alone that gives JSON. Whatever the number of processes, whatever was killed in
between: the results are the same and come in the order of the jobs.
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
