"""`navstack bench barn`: ten metres through fields of cylinders, scored by the BARN Challenge's rule."""

from __future__ import annotations

from pathlib import Path

import typer

from navstack.cli.bench import running


def barn(
    folder: Path = typer.Argument(
        ..., metavar="DIR", help="Folder with worlds.npz; cpp_results.csv beside it is compared with."
    ),
    params: list[str] = typer.Option(..., "--params", metavar="NAME|DIR|FILE", help=running.PARAMS_HELP),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    distro: str | None = typer.Option(
        None,
        "--distro",
        metavar="noetic|indigo",
        help="Whose scoring scale: noetic's, or that of releases before 2018.",
    ),
    seeds: int = typer.Option(1, "--seeds", metavar="N", min=1, help="Runs per world, with seeds 0 to N - 1."),
    noise: float | None = typer.Option(
        None, "--noise", metavar="M", min=0.0, help="Standard deviation of the lidar's ranges (m)."
    ),
    rough: bool = typer.Option(
        False,
        "--rough",
        help="1 mm of lidar noise at 50 Hz, a lag of 0.1 s and 1 % of slip that odometry does not see.",
    ),
    worlds: list[str] = typer.Option([], "--worlds", metavar="N,N..", help="These worlds only (repeat)."),
    record: bool = typer.Option(
        False, "--record", help="Runs that fail leave their records in OUT/records, for `navstack explain`."
    ),
    processes: int | None = running.PROCESSES,
    out: Path | None = running.OUT,
    resume: bool = running.RESUME,
    json_: bool = running.JSON,
) -> int:
    """Drive through the BARN worlds and score as the BARN Challenge does: a table per world, totals with confidence intervals."""
    from navstack.bench.barn_bench import BarnTask, barn_jobs, barn_report
    from navstack.bench.files import for_workers
    from navstack.core.errors import InputError

    if record and out is None:
        raise InputError("--record: say with --out where the records go", argument="--record")
    task = BarnTask(
        folder.resolve(),
        tuple(for_workers(p) for p in params),
        tuple(set_),
        distro,
        rough,
        noise,
        records=out.resolve() / "records" if record and out is not None else None,
    )
    chosen = running.whole_numbers(worlds, "--worlds")
    jobs = barn_jobs(task, chosen or None, seeds)
    what = task.described()
    results = running.run(task, jobs, what, processes=processes, out=out, resume=resume)
    found = barn_report(task, results, jobs)
    files: dict[str, Path] = {}
    if out is not None and found.outcomes:
        from navstack.plot.barn import plot_success, plot_times

        title = f"BARN, {' + '.join(what['params'])}, {what['distro']}{', rough' if rough else ''}"
        files["success"] = plot_success(found.worlds.rows, out / "success.png", title=f"{title}: how the runs ended")
        files["times"] = plot_times(found.worlds.rows, out / "times.png", title=f"{title}: time taken")
    notes = (
        ["all seeds gave the same runs: nothing here is random, and they count once"] if found.all_seeds_alike else []
    )
    tables = [found.worlds, found.totals, *([found.against_cpp] if found.against_cpp is not None else [])]
    document = {
        **what,
        "seeds": seeds,
        "worlds": found.worlds,
        "totals": found.totals,
        "against_cpp": found.against_cpp,
        "runs": [
            {"seed": s, **{name: getattr(o, name) for name in o.__slots__}}
            for o, s in zip(found.outcomes, found.seeds, strict=True)
        ],
    }
    return running.report(
        document, tables, failed=found.failed, files=files, notes=notes, out=out, name="barn", json_=json_
    )
