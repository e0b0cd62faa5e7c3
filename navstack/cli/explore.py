"""`navstack map explore`: let the simulated robot map a world, then drive on its map."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from navstack.cli import options
from navstack.cli.arguments import map_of, parse_obstacles, parse_place, places_of
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.output import (
    loading_kernels,
    print_files,
    print_findings,
    print_json,
    print_note,
    stderr,
    stdout,
    titled_table,
)
from navstack.core import InputError, Pose2D, ensure_directory, write_json
from navstack.map_io import map_names, save_map
from navstack.mapping import Exploration, drive_on, exploration_report, goals_on, overrides_for_exploration
from navstack.parameters import load_configuration
from navstack.plot import plot_exploration
from navstack.scenario import Scenario, load_places

if TYPE_CHECKING:
    from collections.abc import Callable

    from navstack.core import OccupancyGrid


_NARROW_RAD: Final = 0.5 * math.pi
"""Scans of a smaller angle than this do not suffice for a map: those of depth cameras."""


def explore(
    map_: options.Map,
    params: options.Params = ["turtlebot"],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for the map, its picture and the report.",
            callback=options.folder_only,
        ),
    ] = Path("navstack_explore"),
    start: options.Start = None,
    drive: Annotated[
        bool, typer.Option("--drive", help="Then drive to the places of the world, or to random poses, on the own map.")
    ] = False,
    time_limit: Annotated[
        float,
        typer.Option("--time-limit", metavar="S", help="Simulated time for the exploration (s).", min=1.0, max=1e6),
    ] = 3600.0,
    obstacle: options.Obstacles = [],
    seed: Annotated[int, typer.Option("--seed", help="Random seed of the simulated noise.", min=0)] = 0,
    set_: options.Set = [],
    distro: options.Distro = None,
    _style: options.Style = "screen",
    json_: options.Json = False,
) -> int:
    """Let the simulated robot map a world that it does not know: it drives to frontiers until nothing reachable is unknown.

    The robot has its first pose, its odometry and its scans. The map is made while it drives, and its plans are on it.

    Frontiers that it did not get to are listed. If 99 % of what is in reach is known all the same, the world is explored. It is
    not if the robot sees no way on, but less than 90 % is known: its map is wrong then.

    Exit codes: 0 explored, and every goal of --drive reached; 1 not; 2 invalid input; 130 interrupted.
    """
    path, world = map_of(map_)
    configuration = load_configuration(params, overrides=set_, distro=distro)
    print_findings(configuration.findings, params, set_)
    sim = configuration.navstack.sim
    widest = max((sim.lidar(name).fov for name in sim.lasers), default=math.tau)
    if widest < _NARROW_RAD:
        print_note(
            f"scans of {math.degrees(widest):.0f} degrees show too little of a corridor to be matched, so the map is likely "
            "wrong; a wider lidar: --set navstack.sim.laser.fov=4.7 --set navstack.sim.laser.range_max=12.0"
        )
    maps = load_configuration(params, overrides=[*overrides_for_exploration(), *set_], distro=distro)
    if configuration.navstack.sim.localization not in ("amcl", "scan_matching"):
        # whoever drives on a map of its own must find itself there
        located = ("navstack.sim.localization=scan_matching",)
        configuration = load_configuration(params, overrides=[*set_, *located], distro=distro)
    obstacles, shapes = parse_obstacles(obstacle)
    scenario = Scenario(
        map=world,
        configuration=configuration,
        start=_start(map_, start),
        goals=(),
        obstacles=obstacles,
        shapes=shapes,
        seed=seed,
        names={"map": path.name, "params": [Path(p).name for p in params]},
    )
    with interrupt_flag() as interrupt, loading_kernels([*configuration.planner_names, "mapping"], quiet=json_):
        exploration = Exploration(replace(scenario, configuration=maps), time_limit_s=time_limit)
        interrupted = _explored(exploration, interrupt, quiet=json_)
    if exploration.mapper.keyframes == 0:
        raise InputError(f"there is no map: {exploration.ended}; check the lidar of the parameters")
    grid = exploration.final_map()
    folder = ensure_directory(out)
    files = {"map": str(save_map(grid, folder / "map.yaml")[0]), "picture": str(folder / "explore.png")}
    report = exploration_report(exploration, grid)
    plot_exploration(
        exploration, grid, files["picture"], title=f"exploration of {path.name}", subtitle=_subtitle(report)
    )
    recorder = exploration.run.recorder
    assert recorder is not None
    files |= save_record(recorder, folder)
    document: dict[str, Any] = {"map": path.name, **report}
    complete = bool(report["complete"])
    if drive and not interrupted:
        with interrupt_flag() as interrupt:
            document["drive"], interrupted = _driven(scenario, grid, _places(map_), interrupt, quiet=json_)
        complete = complete and document["drive"]["reached"] == document["drive"]["goals"]
    files["report"] = str(folder / "explore.json")
    document["files"] = files
    write_json(folder / "explore.json", document)
    if json_:
        print_json(document)
    else:
        _print(document)
        print_files(files)
    if interrupted:
        return interrupt.exit_code
    return 0 if complete else 1


def _start(map_: str, start: str | None) -> Pose2D:
    if start is not None:
        return parse_place(start, "--start", map_)
    if map_ in map_names():
        return load_places(map_).start
    known = next(iter(places_of(map_).values()), None)
    if known is None:
        raise InputError("this map has no places, so give where the robot begins: --start X,Y,YAW", argument="--start")
    return known


def _places(map_: str) -> dict[str, Pose2D]:
    return dict(load_places(map_).places) if map_ in map_names() else places_of(map_)


def _explored(exploration: Exploration, stop: Callable[[], bool], *, quiet: bool) -> bool:
    """Run the exploration to its end, or until `stop`; return whether it was stopped."""
    shown = 0.0
    with stderr().status("exploring") as line:
        if quiet:
            line.stop()
        while exploration.step():
            time = exploration.run.robot.time
            if time - shown >= 5.0:
                shown = time
                area = exploration.areas[-1][2] if exploration.areas else 0.0
                line.update(
                    f"{time:.0f} s, {exploration.run.path_length:.0f} m, {area:.0f} m² known, "
                    f"{len(exploration.frontiers)} frontiers"
                )
            if stop():
                exploration.stop("interrupted")
                return True
    return False


def _driven(
    scenario: Scenario, grid: OccupancyGrid, places: dict[str, Pose2D], stop: Callable[[], bool], *, quiet: bool
) -> tuple[dict[str, Any], bool]:
    goals = goals_on(scenario, grid, places, 5)
    with stderr().status("driving on the own map") as line:
        if quiet:
            line.stop()
        run, interrupted = drive_on(scenario, grid, [pose for _, pose in goals], stop)
    outcomes = [
        {"goal": name, "state": outcome.state, "text": "" if outcome.succeeded else outcome.message or outcome.text}
        for (name, _), outcome in zip(goals, run.outcomes, strict=False)
    ]
    known = {name for name, _ in goals}
    return {
        "goals": len(goals),
        "reached": sum(outcome.succeeded for outcome in run.outcomes),
        "contacts": len(run.robot.collisions),
        "distance_m": run.path_length,
        "time_s": run.robot.time,
        "outcomes": outcomes,
        "places_out_of_reach": [name for name in places if name not in known],
    }, interrupted


def _subtitle(report: dict[str, Any]) -> str:
    return (
        f"{report['free_m2']:.0f} m² free, {report['reachable_known']:.1%} of what is in reach, {report['distance_m']:.0f} m, "
        f"{report['time_s']:.0f} s, {report['contacts']} contacts"
    )


def _print(document: dict[str, Any]) -> None:
    out = stdout()
    verdict = "explored" if document["complete"] else "not explored completely"
    out.print(f"{document['map']} {verdict}: {document['ended']}", markup=False)
    table = titled_table("", left=("",), right=("",))
    rows = {
        "free area known": f"{document['free_m2']:.1f} m²",
        "known of what is in reach": f"{document['reachable_known']:.1%} of {document['reachable_m2']:.1f} m²",
        "walls within a cell of the world's": f"{document['walls_within_a_cell']:.1%}",
        "distance, time": f"{document['distance_m']:.1f} m, {document['time_s']:.0f} s",
        "contacts": str(document["contacts"]),
        "goals, failed": f"{document['goals']}, {document['goals_failed']}",
        "pose at the end off by": f"{document['position_error_m']:.3f} m",
        "scans in the map, loops": f"{document['keyframes']}, {document['loops_accepted']}",
    }
    for label, text in rows.items():
        table.add_row(label, text)
    out.print(table)
    if document["left"]:
        left = titled_table("frontiers left", left=("at", "length", "why"))
        left.columns[2].no_wrap, left.columns[2].overflow = False, "fold"
        for each in document["left"][:8]:
            left.add_row(f"{each['x']:.2f}, {each['y']:.2f}", f"{each['size_m']:.2f} m", each["reason"])
        out.print(left)
        if len(document["left"]) > 8:
            print_note(f"and {len(document['left']) - 8} more: see explore.json")
    driven = document.get("drive")
    if driven is None:
        return
    out.print(
        f"on its own map: {driven['reached']} of {driven['goals']} goals, {driven['contacts']} contacts, "
        f"{driven['distance_m']:.1f} m, {driven['time_s']:.0f} s"
    )
    for outcome in driven["outcomes"]:
        if outcome["text"]:
            out.print(f"  {outcome['goal']}: {outcome['text']}", markup=False)
    if driven["places_out_of_reach"]:
        print_note(f"places that are out of reach on the own map: {', '.join(driven['places_out_of_reach'])}")
