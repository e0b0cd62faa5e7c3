"""`navstack tune`: better parameters for the user's YAML files, validated on held-out scenarios."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli import options
from navstack.cli.options import with_options
from navstack.cli.search_options import Resume, SearchArguments, Workers

if TYPE_CHECKING:
    from navstack.tune.setup import Setup


Trials = Annotated[int, typer.Option("--trials", metavar="N", help="Number of candidates.", min=1)]
Why = Annotated[
    bool,
    typer.Option("--why", help="No search: show the effect of halving and doubling each parameter, in all scenarios."),
]
Objectives = Annotated[
    list[str],
    typer.Option(
        "--objective",
        metavar="NAME",
        help="score (default), time, clearance, smoothness or success; several give a Pareto front (repeatable).",
    ),
]
MinSuccess = Annotated[
    float, typer.Option("--min-success", help="Required success rate, with several objectives.", min=0.0, max=1.0)
]
Sampler = Annotated[str, typer.Option("--sampler", metavar="tpe|cmaes|random", help="Sampler of the candidates.")]
HeldOut = Annotated[
    float,
    typer.Option(
        "--held-out",
        metavar="SHARE",
        help="Share of the scenarios reserved for validation; always half of a packaged suite.",
    ),
]
Against = Annotated[
    str | None,
    typer.Option("--against", metavar="NAME|DIR|FILE", help="Also compare the result with these parameters."),
]
Storage = Annotated[
    str | None,
    typer.Option(
        "--storage",
        metavar="FILE|URL",
        help="Storage of the study: a file (default: OUT/study.journal), or a database for several machines.",
    ),
]
Revert = Annotated[
    bool,
    typer.Option("--revert/--keep-all", help="Revert changes that make no difference, or keep all changes."),
]
Out = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder for the tuned YAML files, the report and the study.",
        callback=options.folder_only,
    ),
]


@with_options(search=SearchArguments)
def tune(
    search: SearchArguments,
    trials: Trials = 100,
    why: Why = False,
    objective: Objectives = [],
    min_success: MinSuccess = 1.0,
    sampler: Sampler = "tpe",
    held_out: HeldOut = 0.4,
    against: Against = None,
    workers: Workers = None,
    storage: Storage = None,
    resume: Resume = False,
    revert: Revert = True,
    out: Out = Path("navstack_tune"),
    json_: options.Json = False,
) -> int:
    """Search for better parameters and validate them on scenarios that the search has not seen."""
    from navstack.cli.tune_output import announce, print_result, trial_progress
    from navstack.core.optional_dependencies import require

    require("optuna", "tuning")
    require("ruamel.yaml", "writing tuned parameters")
    setup = search.prepare()
    command = shlex.join(["navstack", *sys.argv[1:]])
    if why:
        return _sensitivity(setup, out, workers, command, json_)
    from navstack.tune.pipeline import TuneRequest, run_tuning

    request = TuneRequest(
        setup=setup,
        out=out,
        trials=trials,
        objectives=tuple(objective),
        min_success=min_success,
        sampler=sampler,
        held_out=held_out,
        against=against,
        storage=storage,
        resume=resume,
        revert=revert,
        workers=workers,
        command=command,
    )
    announce(setup, quiet=json_)
    with trial_progress(trials, quiet=json_) as (on_trial, notify):
        result = run_tuning(request, on_trial=on_trial, notify=notify)
    print_result(result, as_json=json_)
    return 0


def _sensitivity(setup: Setup, out: Path, workers: int | None, command: str, json_: bool) -> int:
    from navstack.cli.output import counting_bar, print_json, print_note, stdout
    from navstack.tune.pipeline import run_sensitivity

    if not json_:
        count, runs = len(setup.space), len(setup.evaluation().cases)
        print_note(f"{count} parameter{'s' * (count != 1)}, each halved and doubled over {runs} run{'s' * (runs != 1)}")
    with counting_bar("driving", quiet=json_) as progress:
        found, page = run_sensitivity(setup, out, workers=workers, command=command, progress=progress)
    if json_:
        print_json({"steps": [p.as_dict() for p in found], "files": {"report": str(page)}})
        return 0
    for number, one in enumerate(found, 1):
        stdout().print(f"{number:>3}. {one.sentence}", markup=False)
    stdout().print(f"report: {page}", markup=False)
    return 0
