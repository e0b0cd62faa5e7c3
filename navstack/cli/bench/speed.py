"""`navstack bench speed`: how fast it is on this machine."""

from __future__ import annotations

from pathlib import Path

import typer

from navstack.cli.bench import running


def speed(
    map_: str = typer.Argument(
        "office",
        metavar="[SCENARIO.yaml | MAP]",
        help="What is driven: a scenario file, the name of one that is shipped, or a packaged map with places.",
    ),
    params: list[str] = typer.Option(
        [], "--params", metavar="NAME|DIR|FILE", help=f"{running.PARAMS_HELP} [default: turtlebot, or the scenario's]"
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    repeats: int = typer.Option(
        7, "--repeats", metavar="N", min=1, help="Runs; of each, or of their median, the best counts."
    ),
    reference: Path | None = typer.Option(
        None,
        "--reference",
        metavar="FILE",
        help="Times to compare with: those of the C++ stack's costmaps and DWA, or --json of an earlier state.",
    ),
    out: Path | None = running.OUT,
    resume: bool = running.RESUME,
    json_: bool = running.JSON,
) -> int:
    """Measure the real-time factor of the whole stack, where a simulated second goes, and single stages, on one core.

    Beside each figure stands the calibration: the time of a fixed piece of work at that moment. Ratios are made with it.
    """
    from navstack.bench.files import digest_of_scenario, for_workers, short_names
    from navstack.bench.speed_bench import SpeedTask, read_reference, speed_jobs, speed_tables
    from navstack.cli.arguments import map_of, scenario_file
    from navstack.core.errors import InputError
    from navstack.map_io import map_names
    from navstack.parameters.configuration import load_configuration
    from navstack.places import load_places
    from navstack.scenario.file.spec import read_scenario
    from navstack.scenario.run import Scenario
    from navstack.scenario.suites.catalogue import shipped

    known = read_reference(reference) if reference is not None else None
    sources = [for_workers(p) for p in params]
    file = scenario_file(map_)
    if file is not None:
        scenario = read_scenario(file).build(params=sources or None, overrides=set_)
    else:
        _, grid = map_of(map_, others=shipped(), what="scenario")
        if map_ not in map_names():
            raise InputError(
                f"{map_} says nothing about where to start and go: give a scenario file, or a packaged map: "
                f"{', '.join(map_names())}",
                argument="MAP",
                value=map_,
            )
        here = load_places(map_)
        scenario = Scenario(grid, load_configuration(sources or ["turtlebot"], overrides=set_), here.start, here.goals)
    what = {
        "bench": "speed",
        "drives": Path(map_).name,
        "params": short_names(params),
        "set": list(set_),
        "scenario": digest_of_scenario(scenario),
        "repeats": repeats,
    }
    jobs = speed_jobs()
    results = running.run(SpeedTask(scenario, repeats), jobs, what, processes=1, out=out, resume=resume)
    tables = speed_tables(results, known)
    found = {r.key: r.value for r in results if not r.failed}
    scenes = {row["scene"]: row for row in tables[-1].rows}
    document = {
        **what,
        # as `--reference` reads it
        "calibration_ms": min((told["calibration_ms"] for told in found.values()), default=None),
        "cases": {name: {"ms": row["ms"]} for name, row in scenes.items()},
        "measured": found,
        "ratios": {name: row["ratio"] for name, row in scenes.items()} if known is not None else None,
    }
    failed = [r for r in results if r.failed]
    return running.report(document, tables, failed=failed, out=out, name="speed", json_=json_)
