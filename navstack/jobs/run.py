"""Running many jobs: what is done is skipped, the rest shared out, each result kept at once, all given back in order."""

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
    heard: Callable[[JobResult], None] | None = None,
) -> list[JobResult]:
    """Runs `work` on every job's input; the results in the order of the jobs, whoever ran them and whenever.

    `processes`: workers, all usable cores unless given; or another `executor` made for the same work, which is closed
    at the end, however it ends. `results`: a file that takes each result as it comes, so that a run that was killed goes on with
    `resume`; `what` (JSON) says what shapes the results beyond the jobs' keys, and a file of something else is refused.
    `progress`: a bar with the time left on stderr. `heard` is called with each result as it comes.

    A job that raises, or whose worker dies twice, gives a result with an error; the others go on. Raises InputError and
    OutputError for a results file that cannot be used; KeyboardInterrupt leaves the file as it is, to be resumed.
    """
    keys = [job.key for job in jobs]
    with ExitStack() as stack:
        if executor is not None:
            stack.callback(executor.close)
        doubled = [key for key, many in Counter(keys).items() if many > 1]
        if doubled:
            raise InternalError(f"two jobs have the key {doubled[0]!r}")
        file = None
        if results is not None:
            file = stack.enter_context(ResultsFile(results, what or {}, keys, resume=resume))
        found = dict(file.done) if file is not None else {}
        left = [job for job in jobs if job.key not in found]
        told = stack.enter_context(progress_of(len(jobs), len(found), quiet=not progress))
        if left:
            if executor is None:
                executor = ProcessExecutor(work, processes)
                stack.callback(executor.close)
            queue = iter(left)
            for job in islice(queue, executor.slots):
                executor.submit(job)
            for _ in left:
                result = executor.collect()
                # the worker first: it works while the line is written
                for job in islice(queue, 1):
                    executor.submit(job)
                found[result.key] = result
                if file is not None:
                    file.add(result)
                if heard is not None:
                    heard(result)
                told(result)
        ordered = [found[key] for key in keys]
        if file is not None:
            file.put_in_order(ordered)
        return ordered
