"""`navstack live`: watch a simulated robot drive and take part, in the browser."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.arguments import map_of, scenario_file
from navstack.cli.output import loading_kernels, print_note, stdout
from navstack.cli.scenario_options import ScenarioOptions
from navstack.core import InputError, require
from navstack.explain import replay
from navstack.fleet import Fleet, is_of_fleet, shipped_fleets, warm_up_fleet
from navstack.live import (
    COMPILING,
    MAX_SPEED,
    FleetSession,
    FoxgloveServer,
    GraphEditor,
    LoggedSession,
    Options,
    Origin,
    Report,
    Session,
    Stage,
)
from navstack.map_io import map_names
from navstack.parameters import Configuration, short_name
from navstack.record import Record
from navstack.replay import is_of_log
from navstack.scenario import Scenario, read_scenario, shipped_scenarios, warm_up

PORT = 8765


class LiveOptions(NamedTuple):
    """How the session is shown."""

    versus: Annotated[
        list[str],
        typer.Option(
            "--versus",
            metavar="PARAMS",
            help="Drive a second robot with these parameters in the same world (repeatable).",
        ),
    ] = []
    speed: Annotated[
        str, typer.Option("--speed", metavar="FACTOR|max", help="Factor of real time; max is as fast as possible.")
    ] = "1"
    save_to: Annotated[
        Path | None, typer.Option("--save-to", metavar="DIR", help="The only folder that the page can save into.")
    ] = None
    graph: Annotated[
        Path | None,
        typer.Option(
            "--graph", metavar="FILE.geojson", help="Route graph to show, edit and drive; saved next to the file."
        ),
    ] = None
    host: Annotated[
        str, typer.Option("--host", help="Address to listen on. Beyond loopback, the printed address has a token.")
    ] = "127.0.0.1"
    port: Annotated[
        int | None,
        typer.Option("--port", help=f"Port of the page, default {PORT}; 0 is any free one.", min=0, max=65535),
    ] = None
    foxglove: Annotated[
        int | None,
        typer.Option(
            "--foxglove",
            metavar="PORT",
            help=f"Show it in Foxglove too, as topics of ROS 2. Foxglove expects {PORT}; the page is on {PORT + 1} then.",
            min=0,
            max=65535,
        ),
    ] = None
    read_only: Annotated[bool, typer.Option("--read-only", help="Pages can look, but not take part.")] = False
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False


@options.with_options(chosen=ScenarioOptions, live=LiveOptions)
def live(chosen: ScenarioOptions, live: LiveOptions) -> int:
    """Watch a robot drive in the browser, and take part: goals, obstacles, parameters, driving by hand, why.

    The robot begins to drive when the page is open. On first use kernels are compiled before; the page shows the progress.

    Opens a map, a scenario file or a recorded run (with a time line). Without arguments, a turtlebot drives through a packaged
    office. Needs the extra `live` (aiohttp).

    Exit codes: 0 stopped by the user, 2 invalid input.
    """
    require("aiohttp", "navstack live")

    prepared = _preparation(chosen, live)
    return _serve(prepared, live)


def _label(origin: Origin) -> str:
    return ", ".join(short_name(name) for name in origin.sources) or "the scenario's parameters"


class _Preparation(NamedTuple):
    """What is known of the sessions before they begin."""

    prepare: Callable[[Report], Stage]
    """Compiles kernels, and starts the sessions."""
    configuration: Configuration
    """Of the first session."""
    duration_s: float | None = None
    """Of a recorded run."""


def _preparation(chosen: ScenarioOptions, live: LiveOptions) -> _Preparation:
    """Reads the input. Raises its errors."""
    speed = _speed(live.speed)
    run = Path(chosen.map_)
    if run.suffix == ".npz" or run.joinpath("run.npz").is_file():
        if live.graph is not None:
            raise InputError("--graph needs a scenario or a map, not a recorded run")
        if live.versus:
            raise InputError("--versus needs a scenario or a map, not a recorded run")
        record = Record.load(run)
        scenario = Scenario.from_record(record)

        def recorded(report: Report) -> Stage:
            with loading_kernels(progress=partial(report, COMPILING)):
                return Stage([_recorded(record, scenario, speed)], Options(live.save_to, fixed=True, labels=("",)))

        return _Preparation(recorded, scenario.configuration, float(record.times[-1]))
    fleet = chosen.fleet()
    if fleet is not None:
        return _fleet(fleet, live)
    opened = [_open(chosen)]
    if live.versus:
        opened.append(_open(chosen._replace(params=live.versus)))
    labels = ("",) if len(opened) == 1 else tuple(_label(origin) for _, origin in opened)
    named = tuple(origin.sources for _, origin in opened)
    options = Options(live.save_to, labels=labels, named=named, graph=live.graph)
    GraphEditor(live.graph)  # a file with a mistake is refused before a browser opens

    def prepare(report: Report) -> Stage:
        for scenario, _ in opened:
            with loading_kernels(scenario.configuration.planner_names, progress=partial(report, COMPILING)):
                report("loading the kernels", 0, 0)
                warm_up(scenario)
        return Stage([Session(scenario, origin=origin, speed=speed) for scenario, origin in opened], options)

    return _Preparation(prepare, opened[0][0].configuration)


def _fleet(fleet: Fleet, live: LiveOptions) -> _Preparation:
    if live.versus or live.graph is not None:
        raise InputError("--versus and --graph are for one robot; leave them out with a fleet")
    speed = _speed(live.speed)

    def prepare(report: Report) -> Stage:
        planners = {name: None for robot in fleet.robots for name in robot.scenario.configuration.planner_names}
        with loading_kernels(tuple(planners), progress=partial(report, COMPILING)):
            report("loading the kernels", 0, 0)
            warm_up_fleet(fleet)
        return Stage([FleetSession(fleet, speed=speed)], Options(live.save_to))

    return _Preparation(prepare, fleet.robots[0].scenario.configuration)


def _recorded(record: Record, scenario: Scenario, speed: float | None) -> Session:
    """A session of a recorded run, which is simulated or replayed again. Raises RecordError if that gives another run."""
    if is_of_log(record):
        return LoggedSession(record, speed=speed)
    if is_of_fleet(record):
        raise InputError("this is the record of a robot of a fleet; open the fleet file, or explain the record")
    replay(record)
    session = Session(scenario, speed=speed)
    session.end = float(record.times[-1])
    session.pause(True)
    return session


def _open(chosen: ScenarioOptions) -> tuple[Scenario, Origin]:
    file = scenario_file(chosen.map_)
    if file is not None:
        spec = read_scenario(file)
        sources = chosen.params or [source for source in spec.sources if isinstance(source, str)]
        return chosen.build(), Origin(spec.map_file, tuple(sources))
    path, grid = map_of(chosen.map_, {"scenario": shipped_scenarios(), "fleet": shipped_fleets()})
    if chosen.map_ not in map_names() and chosen.start is None:
        from navstack.live import free_pose

        x, y = free_pose(grid)
        chosen = chosen._replace(start=f"{x!r},{y!r}")
    return chosen.build(goals_needed=False), Origin(path, tuple(chosen.params or ["turtlebot"]))


def _speed(text: str) -> float | None:
    if text == "max":
        return None
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value <= MAX_SPEED:
        raise InputError(f'--speed "{text}" is not a factor above 0, at most {MAX_SPEED:g}, or max', argument="--speed")
    return value


def _serve(prepared: _Preparation, live: LiveOptions) -> int:
    import asyncio
    import signal

    from navstack.live import Gate, LiveServer, is_loopback, serve  # need aiohttp

    foxglove = None
    port = PORT if live.port is None else live.port
    if live.foxglove is not None:
        # clients of Foxglove have no token: from elsewhere they can look only
        read_only = live.read_only or not is_loopback(live.host)
        foxglove = FoxgloveServer(
            live.host,
            live.foxglove,
            prepared.configuration,
            read_only=read_only,
            duration_s=prepared.duration_s,
        )
        if live.port is None and foxglove.port == PORT:
            port = PORT + 1
    server = LiveServer(prepared.prepare, Gate(live.host), read_only=live.read_only, foxglove=foxglove)

    async def main() -> None:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            if sys.platform != "win32":
                loop.add_signal_handler(number, stop.set)
        await serve(server, live.host, port, ready=partial(_ready, live=live, foxglove=foxglove), stop=stop)

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(main())
    return 0


def _ready(address: str, *, live: LiveOptions, foxglove: FoxgloveServer | None) -> None:
    stdout().print(f"navstack live: {address}", markup=False)
    if foxglove is not None:
        host = f"[{live.host}]" if ":" in live.host else live.host
        stdout().print(f"Foxglove: open the connection ws://{host}:{foxglove.port}", markup=False)
    sys.stdout.flush()
    if live.no_open:
        return
    if not _has_display():
        print_note("there is no display here; open the address in a browser (Ctrl+C ends the session)")
        return
    import webbrowser

    if not webbrowser.open(address):
        print_note("no browser could be opened; open the address yourself (Ctrl+C ends the session)")


def _has_display() -> bool:
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
