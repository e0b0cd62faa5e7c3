"""`navstack tour`: named places, one after another."""

from __future__ import annotations

import signal
from collections.abc import Generator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from navstack.scenario.run import GoalOutcome, Scenario
    from navstack.scenario.tour import TourResult, TourState

EXIT_INTERRUPTED = 130


class TourOrder(StrEnum):
    """In which order the places are visited."""

    given = "given"
    sorted = "sorted"
    random = "random"


def tour(
    places: str = typer.Argument("office", metavar="[PLACES.yaml]", help="Named places, or a packaged map's name."),
    map_: str | None = typer.Argument(
        None,
        metavar="[MAP.yaml]",
        help="A map_server YAML or a packaged map; NAME.yaml beside NAME.places.yaml if left out.",
    ),
    place: list[str] = typer.Option([], "--place", metavar="NAME", help="Only these, in this order (repeat)."),
    every: bool = typer.Option(False, "--all", help="Every place of the file, not only its goals."),
    order: TourOrder = typer.Option(TourOrder.given, "--order", help="As given, by name, or shuffled by the seed."),
    loops: int = typer.Option(1, "--loops", help="How often the tour is driven.", min=1, max=1000),
    rest: float = typer.Option(0.0, "--rest", help="Simulated seconds to stand between two goals.", min=0.0),
    time_limit: float = typer.Option(300.0, "--time-limit", help="Simulated seconds a goal may take.", min=0.1),
    stop_on_failure: bool = typer.Option(
        False, "--stop-on-failure/--go-on", help="Whether a goal that is not reached ends the tour."
    ),
    start: str | None = typer.Option(None, "--start", metavar="X,Y[,YAW]", help="Where the robot stands (m, rad)."),
    params: list[str] = typer.Option(
        ["turtlebot"], "--params", metavar="NAME|DIR|FILE", help="A packaged set, a folder, or files in order (repeat)."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat)."),
    distro: str | None = typer.Option(None, "--distro", metavar="noetic|indigo", help="Whose scoring scale."),
    seed: int = typer.Option(0, "--seed", help="Of the noise and of the random order.", min=0),
    obstacle: list[str] = typer.Option(
        [], "--obstacle", metavar="X,Y,R[,low]", help="A round obstacle not on the map."
    ),
    out: Path = typer.Option(
        Path("navstack_tour"), "--out", metavar="DIR", help="Folder of record, log, summary, picture."
    ),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> int:
    """Drive a simulated robot to named places in turn; Ctrl-C stops the robot and keeps the log."""
    from navstack.cli.output import loading_kernels, print_json, reason_of, stderr
    from navstack.core.files import ensure_directory, write_json
    from navstack.plot import plot_run
    from navstack.scenario.run import warm_up
    from navstack.scenario.tour import drive_tour

    scenario, names = _scenario(
        places, map_, place, every, order, loops, rest, time_limit, stop_on_failure, start, params, set_, distro, seed,
        obstacle,
    )  # fmt: skip
    folder = ensure_directory(out)
    with loading_kernels(quiet=json_):
        warm_up(scenario)

    def told(name: str, outcome: GoalOutcome, state: TourState) -> None:
        if not json_:
            why = "" if outcome.succeeded else f", {reason_of(outcome, scenario.time_limit_s)}"
            stderr().print(f"{name}: {outcome.state} after {outcome.time_s:.1f} s{why}; {state}", markup=False)

    shown = -1.0
    with _interruptible() as interrupted, stderr().status("setting out") as line:

        def show(state: TourState) -> None:
            nonlocal shown
            if state.running_s - shown >= 1.0:
                shown = state.running_s
                line.update(f"{state.place or 'resting'}: {state}")

        result = drive_tour(scenario, names, on_goal=told, on_step=show, stop=lambda: bool(interrupted))
    recorder = result.run.recorder
    assert recorder is not None
    files = {what: str(name) for what, name in recorder.save(folder).items()}
    plot_run(recorder.record(), folder / "run.png")
    files |= {"picture": str(folder / "run.png"), "summary": str(folder / "summary.json")}
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(result, files, scenario.time_limit_s)
    if result.interrupted:
        return EXIT_INTERRUPTED
    return 0 if result.succeeded else 1


@contextmanager
def _interruptible() -> Generator[list[int]]:
    """The first Ctrl-C is taken down, for whoever looks between two cycles; the second ends the command at once."""
    heard: list[int] = []

    def hear(number: int, frame: object) -> None:
        del frame
        heard.append(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, hear)
    try:
        yield heard
    finally:
        signal.signal(signal.SIGINT, before)


def _scenario(
    places: str,
    map_name: str | None,
    chosen: list[str],
    every: bool,
    order: TourOrder,
    loops: int,
    rest: float,
    time_limit: float,
    stop_on_failure: bool,
    start: str | None,
    params: list[str],
    overrides: list[str],
    distro: str | None,
    seed: int,
    obstacle: list[str],
) -> tuple[Scenario, tuple[str, ...]]:
    from navstack.cli.arguments import map_of, parse_obstacles, parse_pose
    from navstack.cli.output import print_note
    from navstack.core.errors import InputError
    from navstack.map_io import map_names, map_path
    from navstack.parameters.configuration import load_configuration
    from navstack.places import load_places, visit_order
    from navstack.scenario.run import Scenario

    file = Path(places)
    if not file.exists() and places in map_names():
        map_name = map_name or places
        file = map_path(places).with_name(f"{places}.places.yaml")
    read = load_places(file)
    beside = file.with_name(file.name.removesuffix(".places.yaml") + ".yaml")
    if map_name is None:
        if beside == file or not beside.exists():
            raise InputError(
                f"which map are the places of {file.name} in? Give it after the file: navstack tour {places} MAP.yaml",
                argument="MAP.yaml",
            )
        map_name = str(beside)
    path, grid = map_of(map_name)
    unknown = [name for name in chosen if name not in read.places]
    if unknown:
        raise InputError(
            f'--place "{unknown[0]}": {file.name} has no such place; there are {", ".join(read.places)}',
            argument="--place",
        )
    start_pose = parse_pose(start, "--start") if start is not None else read.start_pose
    if start_pose is None:
        raise InputError(f"{file.name} does not say where the robot starts: give --start x,y[,yaw]", argument="--start")
    names = tuple(chosen) or (tuple(read.places) if every else read.goal_names)
    names = visit_order(names, order.value, loops=loops, seed=seed)
    configuration = load_configuration(params, overrides=overrides, distro=distro)
    for finding in configuration.findings:
        if finding.severity == "warning":
            print_note(f"{finding.location}: {finding.message}")
    obstacles, shapes = parse_obstacles(obstacle)
    scenario = Scenario(
        map=grid,
        configuration=configuration,
        start=start_pose,
        goals=tuple(read.places[name] for name in names),
        obstacles=obstacles,
        shapes=shapes,
        seed=seed,
        time_limit_s=time_limit,
        rest_s=rest,
        stop_on_failure=stop_on_failure,
        names={
            "map": path.name,
            "params": [Path(p).name for p in params],
            "overrides": list(overrides),
            "places": list(names),
        },
    )
    return scenario, names


def _print(result: TourResult, files: dict[str, str], limit_s: float) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import reason_of, stdout

    out = stdout()
    table = Table(title="tour", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("place", "state"):
        table.add_column(name, no_wrap=True)
    for name in ("time", "driven", "recoveries"):
        table.add_column(name, justify="right", no_wrap=True)
    for name, goal in zip(result.names, result.run.goals):
        style = "green" if goal.succeeded else "bold red"
        table.add_row(
            escape(name),
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.2f} m",
            str(goal.recoveries),
        )
    out.print(table)
    for name, goal in zip(result.names, result.run.goals):
        if not goal.succeeded:
            out.print(escape(f"{name}: {reason_of(goal, limit_s)}"))
    rate = result.state.success_rate
    said = "no goal has ended" if rate is None else f"success rate {100.0 * rate:.0f} %"
    left = len(result.names) - len(result.run.goals)
    out.print(
        f"{said} ({result.state.succeeded} of {result.state.done}), {result.state.running_s:.1f} s, "
        f"{result.state.distance_m:.2f} m driven, {result.run.collisions} collisions"
        + (f"; {left} goal{'s' * (left != 1)} left out" if left else "")
        + ("; interrupted" if result.interrupted else "")
    )
    for what, name in files.items():
        out.print(f"{what}: {name}")
