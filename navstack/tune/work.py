"""One run of one candidate, as a job: what processes and clusters do for sweeps and tuning."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, NamedTuple

from navstack.core.errors import InternalError, ParameterError
from navstack.jobs import Job, JobResult
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.record import RunRecorder
from navstack.tune.courses import Case, Course, RunOutcome

_KEPT = 32
"""Configurations that a worker keeps: those of the candidates that are under way."""


class RunInput(NamedTuple):
    """What a job is called with."""

    overrides: tuple[str, ...]
    """The candidate, as `load_configuration` takes it."""
    case: Case


class RunWork:
    """Drives a candidate over a case of the course; pickled with all it needs, files of the user's included.

    What the result is depends on the input alone; what is kept between calls only saves time.
    """

    def __init__(self, base: Configuration, course: Course) -> None:
        self.parameters: dict[str, Any] = base.tree.as_dict()
        self.distro = base.navstack.ros_distro
        self.course = course
        self._made: OrderedDict[str, Configuration | ParameterError] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {"parameters": self.parameters, "distro": self.distro, "course": self.course, "_made": OrderedDict()}

    def configuration(self, overrides: tuple[str, ...], over: tuple[Mapping[str, Any], ...] = ()) -> Configuration:
        """The candidate's parameters, `over` lying over the robot's; raises ParameterError where they cannot be used."""
        key = repr((overrides, over))
        made = self._made.get(key)
        if made is None:
            try:
                made = load_configuration([self.parameters, *over], overrides=overrides, distro=self.distro)
            except ParameterError as error:
                made = error
            self._made[key] = made
            while len(self._made) > _KEPT:
                self._made.popitem(last=False)
        if isinstance(made, ParameterError):
            raise made
        return made

    def drive(self, given: RunInput, *, record: bool = False) -> tuple[RunOutcome, RunRecorder | None]:
        """The run itself. Parameters that cannot be used make an outcome `refused`."""
        try:
            configuration = self.configuration(given.overrides, self.course.over(given.case))
        except ParameterError as error:
            return self.course.refused("refused", error.message), None
        return self.course.outcome(given.case, configuration, record=record)

    def __call__(self, given: RunInput) -> dict[str, Any]:
        """How the run ended, as JSON."""
        return self.drive(given)[0].as_dict()


def outcome_of(result: JobResult) -> dict[str, Any]:
    """How a run ended, as `RunWork` told it. Raises InternalError where it told nothing: no run is allowed to raise."""
    if result.error is None:
        return result.value
    told = {key: value for key, value in result.error.items() if key != "message"}
    reason = result.error.get("message", "no reason given")
    raise InternalError(f"{result.key}: this run could not be driven: {reason}", **told)


def run_job(candidate_key: str, overrides: tuple[str, ...], case: Case) -> Job:
    """The job of a run."""
    return Job(f"{candidate_key}, {case.key}", RunInput(overrides, case))
