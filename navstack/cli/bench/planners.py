"""`navstack bench planners`: every planner between the same random pairs."""

from __future__ import annotations

from pathlib import Path

import typer

from navstack.cli.bench import running


def planners(
    map_: list[str] = typer.Argument(
        ..., metavar="MAP..", help="map_server YAMLs, folders of them, or names of packaged maps."
    ),
    pairs: int = typer.Option(25, "--pairs", metavar="N", min=1, help="Random reachable pairs per map."),
    planner: list[str] = typer.Option(
        [],
        "--planner",
        metavar="NAME",
        help="All that search unless given: navfn, global_planner, astar, theta_star (repeat).",
    ),
    params: list[str] = typer.Option(["turtlebot"], "--params", metavar="NAME|DIR|FILE", help=running.PARAMS_HELP),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    seed: int = typer.Option(0, "--seed", min=0, help="Of the pairs."),
    processes: int | None = running.PROCESSES,
    out: Path | None = running.OUT,
    resume: bool = running.RESUME,
    json_: bool = running.JSON,
) -> int:
    """Plan between random reachable pairs: found, free of collision, length, cost, clearance, cells expanded and times.

    Lengths are means over the pairs for which every planner found a plan; times are of a plan from scratch.

    A map in a folder that cannot be read is named, and the others are measured. The exit code is 1 when there is such a
    map, when a planner misses a pair, or when a path meets a blocked cell: 0 says that every map was planned on, everywhere
    and safely. A map that is named itself and cannot be read ends the bench before it begins (2).
    """
    from navstack.bench.files import digest_of_configuration, digest_of_map, for_workers, short_names
    from navstack.bench.map_pairs import SEARCHING
    from navstack.bench.planners_bench import (
        PlannersTask,
        map_files,
        maps_without_pairs,
        planners_jobs,
        planners_tables,
    )
    from navstack.map_io import load_map
    from navstack.parameters.configuration import choose_global_planner

    files, unreadable = map_files(map_)
    task = PlannersTask(tuple(for_workers(p) for p in params), tuple(set_), pairs, seed)
    names = [choose_global_planner(task.configuration, n).name for n in planner or SEARCHING]
    jobs = planners_jobs(files, list(dict.fromkeys(names)))
    what = {
        "bench": "planners",
        "params": short_names(params),
        "set": list(set_),
        "parameters": digest_of_configuration(task.configuration),
        "pairs": pairs,
        "seed": seed,
        "maps": {name: digest_of_map(load_map(file)) for name, file in files.items()},
    }
    results = running.run(task, jobs, what, processes=processes, out=out, resume=resume)
    tables = planners_tables(files, results, jobs)
    document = {**what, "rows": tables[0], "all_maps": tables[-1] if len(tables) > 1 else None}
    document["plans"] = {r.key: r.value for r in results if not r.failed}
    document["unreadable"] = unreadable
    notes = [f"left out, since it cannot be read: {message}" for message in unreadable]
    notes += [
        f"{name} has no row: on it the robot finds no two poses to drive between"
        for name in maps_without_pairs(files, results, jobs)
    ]
    failed = [r for r in results if r.failed]
    code = running.report(document, tables, failed=failed, notes=notes, out=out, name="planners", json_=json_)
    bad = any(row["found"] < row["pairs"] or row["in_collision"] for row in tables[0].rows)
    return 1 if bad or unreadable else code
