"""A whole tuning, as `navstack tune` asks for it: search, proof, the user's YAML with the new values, report."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navstack.core.errors import OutputError
from navstack.core.files import ensure_directory, write_json
from navstack.jobs import Executor, ProcessExecutor, SerialExecutor
from navstack.parameters.sources import short_name
from navstack.tune import report
from navstack.tune.extras import need
from navstack.tune.layout import Written, written
from navstack.tune.objectives import chosen
from navstack.tune.scenarios import split
from navstack.tune.sensitivity import Step, sensitivity
from navstack.tune.session import Tuning, tune
from navstack.tune.setup import Setup
from navstack.tune.storage import is_url, opened
from navstack.tune.study import Problem, Study, Trial
from navstack.tune.work import RunWork

PARAMS = "params"
"""Folder of the tuned YAML, below the output's."""


@dataclass(frozen=True, slots=True)
class TuneRequest:
    """What is wanted beyond what is driven."""

    setup: Setup
    out: Path
    trials: int = 100
    objectives: tuple[str, ...] = ()
    min_success: float = 1.0
    sampler: str = "tpe"
    held_out: float = 0.4
    against: str | None = None
    storage: str | None = None
    """A file or a database's URL; `study.journal` in `out` unless given."""
    resume: bool = False
    set_back: bool = True
    workers: int | None = None
    command: str = ""


@dataclass(frozen=True, slots=True)
class Done:
    """What a tuning leaves behind."""

    tuning: Tuning
    written: Written | None
    params: tuple[str, ...]
    """What `--params` takes; empty where nothing better was found."""
    report: Path
    folder: Path

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        files = {"report": str(self.report), "summary": str(self.folder / "tune.json")}
        changes = [
            {"parameter": c.name, "before": c.old, "after": c.new, "place": c.place}
            for c in (self.written.changes if self.written is not None else ())
        ]
        return {**report.tuning_as_dict(self.tuning), "changes": changes, "params": list(self.params), "files": files}


def run_tuning(
    request: TuneRequest,
    *,
    hear: Callable[[Trial, int], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Done:
    """Searches, proves, writes. Raises InputError and OutputError before anything runs, where something cannot be."""
    need("optuna", "tuning")
    need("ruamel.yaml", "writing tuned parameters")
    setup = request.setup
    train, kept = split(setup.names, request.held_out, setup.asked.seed, setup.place.held_out)
    problem = Problem(setup.base, setup.space, setup.course(train), chosen(request.objectives), request.min_success)
    other = setup.other(request.against) if request.against is not None else None
    folder = ensure_directory(request.out)
    target = folder / PARAMS
    if target.exists() and any(target.iterdir()) and not request.resume:
        raise OutputError(f"{target} holds files already; give another --out, so that nothing is overwritten")
    storage = request.storage or str(folder / "study.journal")
    work = RunWork(setup.base, problem.course)
    judged = setup.course(kept) if kept else None
    judge = RunWork(setup.base, judged) if judged is not None else None
    with ExitStack() as stack:
        opened_storage = stack.enter_context(opened(storage))
        study = Study(
            problem,
            opened_storage,
            sampler=request.sampler,
            seed=setup.asked.seed,
            resume=request.resume,
            alone=not is_url(storage),
            place=storage,
        )

        def executor(by: RunWork) -> Executor:
            made = _executor(by, request.workers)
            stack.callback(made.close)
            return made

        tuning = tune(
            study,
            executor(work),
            request.trials,
            held_out=judged,
            held_out_executor=executor(judge) if judge is not None else None,
            reference=(executor(RunWork(other, judged or problem.course)), short_name(request.against or ""))
            if other is not None
            else None,
            set_back=request.set_back,
            hear=hear,
            say=say,
        )
    made: Written | None = None
    params: tuple[str, ...] = ()
    if tuning.found:
        say("writing the parameters")
        made = written(
            setup.sources,
            setup.space.settings(tuning.candidate),
            overrides=setup.asked.overrides,
            distro=setup.asked.distro,
            allow_missing=setup.asked.allow_missing,
        )
        params = tuple(made.save(target))
    say("drawing the report")
    mended = report.draw_mended(tuning, work, judge, folder) if tuning.found else []
    page = report.write_report(folder, tuning, _about(request, tuning), made, mended)
    done = Done(tuning, made, params, page, folder)
    write_json(folder / "tune.json", done.as_dict())
    return done


def run_why(
    setup: Setup,
    out: Path,
    *,
    workers: int | None = None,
    command: str = "",
    hear: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[Step], Path]:
    """`navstack tune --why`: the steps, greatest effect first, and the report."""
    folder = ensure_directory(out)
    course = setup.course()
    executor = _executor(RunWork(setup.base, course), workers)
    try:
        steps = sensitivity(setup.space, executor, course.cases, hear=hear)
    finally:
        executor.close()
    how = f"{len(steps)} changes, each over the same {len(course.cases)} runs of {setup.place.name}, one parameter at a time."
    about = report.Circumstances(f"What matters in {_names(setup)}", _names(setup), command, how)
    page = report.write_why(folder, steps, about)
    write_json(folder / "why.json", {"steps": [s.as_dict() for s in steps], "files": {"report": str(page)}})
    return steps, page


def _executor(work: RunWork, workers: int | None) -> Executor:
    # one worker is this process: nothing to start, and nothing to be killed behind our back
    return SerialExecutor(work) if workers == 1 else ProcessExecutor(work, workers)


def _names(setup: Setup) -> str:
    # where a source lies on this machine is nobody's business
    return ", ".join(short_name(p) for p in setup.asked.params)


def _about(request: TuneRequest, tuning: Tuning) -> report.Circumstances:
    setup = request.setup
    held = len(tuning.held_out.cases) if tuning.held_out is not None else 0
    how = (
        f"{len(tuning.trials)} trials by {request.sampler}, seed {setup.asked.seed}, over {len(tuning.training.cases)} "
        f"training runs of {setup.place.name}; {held} held-out runs for the proof."
    )
    return report.Circumstances(
        f"Tuning of {_names(setup)}", _names(setup), request.command, how, short_name(request.against or "")
    )
