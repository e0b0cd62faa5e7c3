"""`navstack tune` from beginning to end: search, validation, the user's YAML files with the new values, report."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from navstack.core import OutputError, ensure_directory, require, write_json
from navstack.parameters import RewrittenFiles, rewrite_parameters, short_name
from navstack.scenario import failure_advice
from navstack.studies import report
from navstack.studies.evaluation import RunWork
from navstack.studies.executors import ProcessExecutor
from navstack.studies.jobs import Executor, SerialExecutor
from navstack.studies.problem import Problem, Trial, select_objectives
from navstack.studies.report import ReportHeader
from navstack.studies.sensitivity import Perturbation, sensitivity
from navstack.studies.setup import Setup
from navstack.studies.study import Study, is_url, open_storage
from navstack.studies.suites import split
from navstack.studies.tuning import TuningResult, Validation, tune

PARAMS_FOLDER: Final = "params"
"""Folder of the tuned YAML files in the output folder."""
OVERLAY_FILE: Final = "tuned.yaml"
JOURNAL_FILE: Final = "study.journal"


@dataclass(frozen=True, slots=True)
class TuneRequest:
    """The options of a tuning."""

    setup: Setup
    out: Path
    trials: int = 100
    objectives: tuple[str, ...] = ()
    min_success: float = 1.0
    sampler: str = "tpe"
    held_out: float = 0.4
    against: str | None = None
    storage: str | None = None
    """A file or the URL of a database; by default `study.journal` in `out`."""
    resume: bool = False
    revert: bool = True
    workers: int | None = None
    command: str = ""


@dataclass(frozen=True, slots=True)
class TuneOutput:
    """The result and the written files."""

    tuning: TuningResult
    rewritten: RewrittenFiles | None
    params: tuple[str, ...]
    """Values of `--params` for the tuned parameters; empty if nothing better was found, or nothing improved."""
    report: Path
    folder: Path
    advice: tuple[str, ...] = ()
    """Findings about the user's parameters that may explain runs that fail."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        files = {"report": str(self.report), "summary": str(self.folder / "tune.json")}
        changes = [
            {"parameter": c.name, "before": c.old, "after": c.new, "place": c.place}
            for c in (self.rewritten.changes if self.rewritten is not None else ())
        ]
        return {**report.tuning_as_dict(self.tuning), "changes": changes, "params": list(self.params), "files": files}


def run_tuning(
    request: TuneRequest,
    *,
    on_trial: Callable[[Trial, int], None] = lambda trial, ended: None,
    notify: Callable[[str], None] = lambda text: None,
) -> TuneOutput:
    """Search, validates, and writes the files and the report.

    `on_trial` is called with each ended trial and their number, `notify` at the start of each step. Raises InputError and
    OutputError before anything runs.
    """
    require("optuna", "tuning")
    require("ruamel.yaml", "writing tuned parameters")
    run = _TuningRun(request)
    with ExitStack() as stack:
        tuning = run.search(stack, on_trial, notify)
    rewritten: RewrittenFiles | None = None
    params: tuple[str, ...] = ()
    if tuning.improved:
        notify("writing the parameters")
        rewritten = _rewrite(request.setup, tuning)
        params = tuple(rewritten.save(run.params_folder))
    notify("drawing the report")
    fixed_runs = report.draw_fixed_runs(tuning, run.training, run.held_out, run.folder) if tuning.found else []
    failed_runs = report.draw_failed_runs(tuning, run.held_out or run.training, run.folder)
    page = report.write_report(run.folder, tuning, _header(request, tuning), rewritten, fixed_runs, failed_runs)
    output = TuneOutput(tuning, rewritten, params, page, run.folder, failure_advice(request.setup.base.findings))
    write_json(run.folder / "tune.json", output.as_dict())
    return output


class _TuningRun:
    """The parts of a tuning; checks the request on construction."""

    def __init__(self, request: TuneRequest) -> None:
        setup = request.setup
        self._request = request
        train, held_out = split(setup.names, request.held_out, setup.options.seed, setup.suite.held_out)
        self.problem = Problem(
            setup.base,
            setup.space,
            setup.evaluation(train),
            select_objectives(request.objectives),
            request.min_success,
        )
        self.training = RunWork(setup.base, self.problem.evaluation)
        self.held_out = RunWork(setup.base, setup.evaluation(held_out)) if held_out else None
        self._reference = self._reference_work()
        self.folder = ensure_directory(request.out)
        self.params_folder = self.folder / PARAMS_FOLDER
        if self.params_folder.exists() and any(self.params_folder.iterdir()) and not request.resume:
            raise OutputError(f"{self.params_folder} contains files, which are not overwritten; give another --out")

    def _reference_work(self) -> RunWork | None:
        """Drive the reference parameter set over the validation cases."""
        against = self._request.against
        if against is None:
            return None
        judged = self.held_out or self.training
        return RunWork(self._request.setup.reference(against), judged.evaluation)

    def search(
        self, stack: ExitStack, on_trial: Callable[[Trial, int], None], notify: Callable[[str], None]
    ) -> TuningResult:
        """Run the study and the validation; the stack closes storage and executors."""
        request = self._request
        place = request.storage or str(self.folder / JOURNAL_FILE)
        study = Study(
            self.problem,
            stack.enter_context(open_storage(place)),
            sampler=request.sampler,
            seed=request.setup.options.seed,
            resume=request.resume,
            single_process=not is_url(place),
            place=place,
        )

        def executor(work: RunWork) -> Executor:
            made = _executor(work, request.workers)
            stack.callback(made.close)
            return made

        return tune(
            study,
            executor(self.training),
            request.trials,
            validation=Validation(
                held_out=self.held_out.evaluation.cases if self.held_out is not None else (),
                executor=executor(self.held_out) if self.held_out is not None else None,
                reference=executor(self._reference) if self._reference is not None else None,
                reference_name=short_name(request.against or ""),
            ),
            revert=request.revert,
            on_trial=on_trial,
            notify=notify,
        )


def _executor(work: RunWork, workers: int | None) -> Executor:
    # a single worker is this process: nothing to start
    return SerialExecutor(work) if workers == 1 else ProcessExecutor(work, workers)


def _rewrite(setup: Setup, tuning: TuningResult) -> RewrittenFiles:
    return rewrite_parameters(
        setup.sources,
        setup.space.settings(tuning.candidate),
        overrides=setup.options.overrides,
        distro=setup.options.distro,
        allow_missing=setup.options.allow_missing,
        overlay=OVERLAY_FILE,
    )


def run_sensitivity(
    setup: Setup,
    out: Path,
    *,
    workers: int | None = None,
    command: str = "",
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[Perturbation], Path]:
    """`navstack tune --why`: the perturbations, greatest effect first, and the report."""
    folder = ensure_directory(out)
    evaluation = setup.evaluation()
    executor = _executor(RunWork(setup.base, evaluation), workers)
    try:
        found = sensitivity(setup.space, executor, evaluation.cases, progress=progress)
    finally:
        executor.close()
    summary = (
        f"{len(found)} changes of one parameter each, over the same {len(evaluation.cases)} runs of {setup.suite.name}."
    )
    summary += _scale_sentence(setup)
    names = _names(setup)
    page = report.write_sensitivity_report(
        folder, found, ReportHeader(f"Sensitivity of {names}", names, command, summary)
    )
    write_json(folder / "why.json", {"steps": [p.as_dict() for p in found], "files": {"report": str(page)}})
    return found, page


def _names(setup: Setup) -> str:
    # short names: the report must not contain paths of this machine
    return ", ".join(short_name(p) for p in setup.options.params)


def _scale_sentence(setup: Setup) -> str:
    text = setup.scale_text
    return f" {text[0].upper()}{text[1:]}." if text else ""


def _header(request: TuneRequest, tuning: TuningResult) -> ReportHeader:
    setup = request.setup
    held_out = len(tuning.held_out.cases) if tuning.held_out is not None else 0
    summary = (
        f"{len(tuning.trials)} trials with the sampler {request.sampler}, random seed {setup.options.seed}, on "
        f"{len(tuning.training.cases)} training runs of {setup.suite.name}; {held_out} held-out runs for validation."
    )
    summary += _scale_sentence(setup)
    names = _names(setup)
    return ReportHeader(f"Tuning of {names}", names, request.command, summary, short_name(request.against or ""))
