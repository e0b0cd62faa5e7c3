"""One run of one candidate as a job, for processes and clusters."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from navstack.core.errors import InternalError, ParameterError
from navstack.jobs import Executor, Job, JobResult
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.record import RunRecorder
from navstack.tune.evaluation import Case, Evaluation, RunOutcome

Outcome = dict[str, Any]
"""`RunOutcome.as_dict()`."""

_CACHED: Final = 32
"""Number of configurations that a worker caches: enough for the active candidates."""


class RunInput(NamedTuple):
    """The input of a job."""

    overrides: tuple[str, ...]
    """The candidate, as `load_configuration` takes it."""
    case: Case


class RunWork:
    """Drives candidates over the cases of an evaluation.

    Pickled with all it needs, the user's files included. Results depend on the input only; configurations are cached.
    """

    def __init__(self, base: Configuration, evaluation: Evaluation) -> None:
        self.parameters: dict[str, Any] = base.tree.as_dict()
        self.distro = base.navstack.ros_distro
        self.evaluation = evaluation
        self._cache: OrderedDict[str, Configuration | ParameterError] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_cache": OrderedDict()}

    def configuration(self, overrides: tuple[str, ...], overlays: tuple[Mapping[str, Any], ...] = ()) -> Configuration:
        """The parameters of a candidate below the `overlays`. Raises ParameterError for invalid ones."""
        key = repr((overrides, overlays))
        made = self._cache.get(key)
        if made is None:
            try:
                made = load_configuration([self.parameters, *overlays], overrides=overrides, distro=self.distro)
            except ParameterError as error:
                made = error
            self._cache[key] = made
            while len(self._cache) > _CACHED:
                self._cache.popitem(last=False)
        if isinstance(made, ParameterError):
            raise made
        return made

    def drive(self, job_input: RunInput, *, record: bool = False) -> tuple[RunOutcome, RunRecorder | None]:
        """Drives once. Invalid parameters give the outcome `refused`."""
        try:
            configuration = self.configuration(job_input.overrides, self.evaluation.overlays(job_input.case))
        except ParameterError as error:
            return self.evaluation.refused("refused", error.message), None
        return self.evaluation.outcome(job_input.case, configuration, record=record)

    def __call__(self, job_input: RunInput) -> Outcome:
        """The outcome, for JSON."""
        return self.drive(job_input)[0].as_dict()


def run_job(candidate_key: str, overrides: tuple[str, ...], case: Case) -> Job:
    """The job of a run."""
    return Job(f"{candidate_key}, {case.key}", RunInput(overrides, case))


def outcome_of(result: JobResult) -> Outcome:
    """The outcome of a `RunWork` job. Raises InternalError for a run that raised an exception."""
    if result.error is None:
        return result.value
    data = {key: value for key, value in result.error.items() if key != "message"}
    reason = result.error.get("message", "no reason given")
    raise InternalError(f"{result.key}: this run could not be driven: {reason}", **data)


def evaluate(
    executor: Executor,
    name: str,
    overrides: tuple[str, ...],
    cases: Sequence[Case],
    *,
    hopeless: Callable[[Sequence[Outcome]], bool] = lambda outcomes: False,
) -> dict[str, Outcome]:
    """Drives one candidate over the cases; the outcomes by the key of the case, in the order of the cases.

    Starts no further run once `hopeless` is true for the finished ones; then some outcomes are missing. Raises
    InternalError.
    """
    jobs = [(run_job(name, overrides, case), case) for case in cases]
    keys = {job.key: case.key for job, case in jobs}
    waiting = deque(job for job, _ in jobs)
    found: dict[str, Outcome] = {}
    running = 0
    while waiting or running:
        while waiting and running < executor.slots:
            executor.submit(waiting.popleft())
            running += 1
        result = executor.collect()
        running -= 1
        found[keys[result.key]] = outcome_of(result)
        if waiting and hopeless(list(found.values())):
            waiting.clear()
    return {case.key: found[case.key] for case in cases if case.key in found}
