"""`navstack simulate`: drive a simulated robot to its goals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from navstack.scenario.run import RunResult, Scenario

STATE_STYLE = {"SUCCEEDED": "green", "PREEMPTED": "yellow"}


def simulate(
    map_: str = typer.Argument(
        "office",
        metavar="[SCENARIO.yaml | MAP.yaml]",
        help="A scenario file, or the name of one that is shipped (narrow_door, ..); or a map_server YAML, or the name of a "
        "packaged map.",
    ),
    start: str | None = typer.Option(None, "--start", metavar="X,Y[,YAW]", help="Where the robot stands (m, rad)."),
    goal: list[str] = typer.Option(
        [], "--goal", metavar="X,Y[,YAW]", help="Where it is to go (m, rad); repeat for more."
    ),
    params: list[str] = typer.Option(
        [],
        "--params",
        metavar="NAME|DIR|FILE",
        help="A packaged set, a folder, or files in order (repeat). [default: turtlebot, or the scenario's]",
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    distro: str | None = typer.Option(
        None,
        "--distro",
        metavar="noetic|indigo",
        help="Whose scoring scale: noetic's, or that of releases before 2018.",
    ),
    allow_missing: bool = typer.Option(
        False, "--allow-missing", help="Leave out layers and plugins that are not here."
    ),
    seed: int | None = typer.Option(
        None, "--seed", help="Of the noise; the same seed gives the same run. [default: 0, or the scenario's]", min=0
    ),
    obstacle: list[str] = typer.Option(
        [],
        "--obstacle",
        metavar="X,Y,R[,low]",
        help="A round obstacle that is not on the map; low: only bumpers notice it.",
    ),
    time_limit: float | None = typer.Option(
        None, "--time-limit", help="Simulated seconds a goal may take. [default: 600, or the scenario's]", min=0.1
    ),
    timings: bool = typer.Option(
        False, "--timings", help="Add the wall times of planning and control (ms: p50, p95, p99) to the summary."
    ),
    out: Path = typer.Option(
        Path("navstack_run"), "--out", metavar="DIR", help="Folder of record, log, summary, picture."
    ),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> int:
    """Drive a simulated robot through its goals, or through a scenario file; without arguments, a turtlebot through a packaged
    office. Options given beside a scenario file override what it says.

    Exit code 0: the run met its success conditions (unless the scenario says otherwise, every goal SUCCEEDED and nothing was
    touched).
    """
    from navstack.cli.output import print_json
    from navstack.core.files import ensure_directory, write_json
    from navstack.plot import plot_run

    scenario = _scenario(map_, start, goal, params, set_, distro, allow_missing, seed, obstacle, time_limit)
    folder = ensure_directory(out)
    result = _run(scenario, quiet=json_, timings=timings)
    assert result.recorder is not None
    files = {what: str(name) for what, name in result.recorder.save(folder).items()}
    picture = folder / "run.png"
    plot_run(result.recorder.record(), picture)
    files |= {"picture": str(picture), "summary": str(folder / "summary.json")}
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(result, document, scenario.time_limit_s)
    return 0 if result.succeeded else 1


def _scenario(
    map_name: str,
    start: str | None,
    goal: list[str],
    params: list[str],
    overrides: list[str],
    distro: str | None,
    allow_missing: bool,
    seed: int | None,
    obstacle: list[str],
    time_limit: float | None,
) -> Scenario:
    from navstack.cli.arguments import covered, map_of, note_off_the_map, parse_obstacles, parse_pose, scenario_file
    from navstack.cli.output import note_warnings
    from navstack.core.errors import InputError
    from navstack.map_io import map_names
    from navstack.parameters.configuration import load_configuration
    from navstack.parameters.sources import short_name
    from navstack.places import load_places
    from navstack.scenario.file.spec import read_scenario
    from navstack.scenario.run import Scenario
    from navstack.scenario.suites.catalogue import shipped

    start_pose = parse_pose(start, "--start") if start is not None else None
    goals = tuple(parse_pose(g, "--goal") for g in goal)
    obstacles, shapes = parse_obstacles(obstacle)
    file = scenario_file(map_name)
    if file is not None:
        spec = read_scenario(file)
        scenario = spec.build(
            params=params or None,
            overrides=overrides,
            distro=distro,
            allow_missing=allow_missing,
            seed=seed,
            time_limit_s=time_limit,
            start=start_pose,
            goals=goals or None,
            obstacles=obstacles,
            shapes=shapes,
        )
        note_warnings(scenario.configuration)
        spec.check_start(scenario)
        return scenario
    params = params or ["turtlebot"]
    path, grid = map_of(map_name, others=shipped(), what="scenario")
    if start_pose is None or not goals:
        packaged = load_places(map_name) if map_name in map_names() else None
        if packaged is None:
            missing = [name for name, none in (("--start", start_pose is None), ("--goal", not goals)) if none]
            raise InputError(
                f"{path.name} says nothing about where to start and go: give {' and '.join(f'{m} x,y[,yaw]' for m in missing)} "
                f"(m, rad); the map covers {covered(grid)}",
                argument=missing[0],
            )
        start_pose = start_pose or packaged.start
        goals = goals or packaged.goals
    configuration = load_configuration(params, overrides=overrides, distro=distro, allow_missing=allow_missing)
    note_warnings(configuration)
    note_off_the_map(grid, start_pose, goals)
    return Scenario(
        map=grid,
        configuration=configuration,
        start=start_pose,
        goals=goals,
        obstacles=obstacles,
        shapes=shapes,
        seed=seed or 0,
        time_limit_s=600.0 if time_limit is None else time_limit,
        names={"map": path.name, "params": [short_name(p) for p in params], "overrides": list(overrides)},
    )


def _run(scenario: Scenario, *, quiet: bool, timings: bool) -> RunResult:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from navstack.cli.output import loading_kernels, stderr
    from navstack.scenario.run import run_scenario, warm_up

    with loading_kernels(quiet=quiet):
        warm_up(scenario)

    # how long the tour will take is not known: the bar counts goals, the text the simulated time
    columns = (
        TextColumn("goal {task.fields[goal]} of {task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[now]:7.1f} s simulated"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=stderr(), transient=True, disable=quiet or not stderr().is_terminal) as bar:
        task = bar.add_task("", total=len(scenario.goals), goal=1, now=0.0)
        shown = -1.0

        def progress(now: float, goal: int) -> None:
            nonlocal shown
            if now - shown >= 1.0:
                shown = now
                bar.update(task, completed=goal, goal=goal + 1, now=now)

        return run_scenario(scenario, timings=timings, progress=progress)


def _print(result: RunResult, document: dict[str, Any], limit_s: float) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import reason_of, stdout

    out = stdout()
    table = Table(title="goals", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("goal", no_wrap=True)
    table.add_column("state", no_wrap=True)
    for name in ("time", "driven", "left", "recoveries"):
        table.add_column(name, justify="right", no_wrap=True)
    for goal in result.goals:
        style = STATE_STYLE.get(goal.state, "bold red")
        table.add_row(
            f"{goal.goal.x:g}, {goal.goal.y:g}, {goal.goal.yaw:.2f}",
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.2f} m",
            f"{goal.distance_left_m:.2f} m",
            str(goal.recoveries),
        )
    out.print(table)
    for goal in result.goals:
        if not goal.succeeded:
            said = f"{goal.text} " if goal.text else ""
            out.print(f"goal {goal.goal.x:g}, {goal.goal.y:g}: {escape(said + reason_of(goal, limit_s))}")
    for condition in result.conditions:
        mark = "[green]held[/]" if condition.holds else "[bold red]not held[/]"
        out.print(f"condition {condition.condition} {mark}: {escape(condition.text)}")
    m = result.metrics
    out.print(
        f"{m.length_m:.1f} m in {m.time_s:.1f} s; clearance {m.clearance_min_m:.2f} m at least, {m.clearance_mean_m:.2f} m on "
        f"average; {m.speed_mean_m_s:.2f} m/s while moving, jerk {m.jerk_rms_m_s3:.2f} m/s³, curvature "
        f"{m.curvature_mean_1_m:.2f} rad/m"
    )
    out.print(
        f"{result.simulated_s:.1f} s simulated in {result.wall_s:.2f} s: {result.real_time_factor:.0f} times real time; "
        f"{result.collisions} collisions; seed {result.seed}"
    )
    for what, name in document["files"].items():
        out.print(f"{what}: {name}", markup=False)
