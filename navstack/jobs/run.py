"""Runs jobs: skips finished ones, distributes the others, stores each result and returns all in order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any

from navstack.core.errors import InternalError
from navstack.jobs.job import Executor, Job, JobResult, Work
from navstack.jobs.processes import ProcessExecutor
from navstack.jobs.progress import progress_of
from navstack.jobs.results_file import ResultsFile


def run_jobs(
    work: Work,
    jobs: Sequence[Job],
    *,
    what: Mapping[str, Any] | None = None,
    processes: int | None = None,
    executor: Executor | None = None,
    results: Path | None = None,
    resume: bool = False,
    progress: bool = False,
    on_result: Callable[[JobResult], None] | None = None,
) -> list[JobResult]:
    """Runs `work` on the input of every job; returns the results in the order of the jobs.

    `processes`: number of workers (default: all usable cores); or an `executor` created for the same work, which is closed at the
    end. `results`: a file that stores each result immediately, so that `resume` continues an interrupted run; `what` (JSON data)
    describes the inputs other than the jobs' keys, and a file with another description is rejected. `progress`: shows a bar on
    stderr. `on_result` is called with each new result.

    A job that raises, or whose worker dies twice, has an error result; the other jobs continue. Raises InputError and
    OutputError for a results file that cannot be used; after a KeyboardInterrupt the file can be resumed.
    """
    keys = [job.key for job in jobs]
    with ExitStack() as stack:
        if executor is not None:
            stack.callback(executor.close)
        duplicates = [key for key, count in Counter(keys).items() if count > 1]
        if duplicates:
            raise InternalError(f"two jobs have the key {duplicates[0]!r}")
        file = None
        if results is not None:
            file = stack.enter_context(ResultsFile(results, what or {}, keys, resume=resume))
        found = dict(file.done) if file is not None else {}
        left = [job for job in jobs if job.key not in found]
        report = stack.enter_context(progress_of(len(jobs), len(found), quiet=not progress))
        if left:
            if executor is None:
                executor = ProcessExecutor(work, processes)
                stack.callback(executor.close)
            queue = iter(left)
            for job in islice(queue, executor.slots):
                executor.submit(job)
            for _ in left:
                result = executor.collect()
                # submit first: the worker runs while the line is written
                for job in islice(queue, 1):
                    executor.submit(job)
                found[result.key] = result
                if file is not None:
                    file.add(result)
                if on_result is not None:
                    on_result(result)
                report(result)
        ordered = [found[key] for key in keys]
        if file is not None:
            file.put_in_order(ordered)
        return ordered
