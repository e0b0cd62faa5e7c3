"""`navstack cover`: plan, and drive, a tool over all of a map or polygon that the footprint can reach."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer

from navstack.behaviors import parse_angle
from navstack.bringup import costmap_on_map
from navstack.cli import options
from navstack.cli.arguments import map_of, note_off_the_map, parse_obstacles, parse_place, places_of
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
from navstack.coverage import (
    CoverageDrive,
    CoveragePlan,
    least_clearance,
    left_in,
    plan_coverage,
    read_cover_step,
    roomy_start,
    visits_of,
)
from navstack.map_io import map_names
from navstack.parameters import load_configuration
from navstack.plot import plot_coverage
from navstack.scenario import Run, Scenario, load_places
from navstack.sim import energy_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from navstack.core import OccupancyGrid
    from navstack.coverage import CoverStep
    from navstack.parameters import Configuration

LEFT_SHOWN = 8
"""Parts that were left, in the table."""


class CoverOptions(NamedTuple):
    """What to cover, and with which tool."""

    map_: options.Map
    params: options.Params = ["turtlebot"]
    polygon: Annotated[
        Path | None,
        typer.Option(
            "--polygon", metavar="FILE", help="GeoJSON polygons (m, map frame): border and holes. [default: all]"
        ),
    ] = None
    tool_width: Annotated[
        float, typer.Option("--tool-width", metavar="M", help="Width of the tool: a disc at the robot's center (m).")
    ] = 0.35
    angle: Annotated[
        str, typer.Option("--angle", metavar="ANGLE|best", help="Angle of the swaths, or best: the fewest swaths.")
    ] = "best"
    headland: Annotated[
        bool, typer.Option("--headland/--no-headland", help="Drive along the border first, or not at all.")
    ] = True
    route: Annotated[
        str, typer.Option("--route", metavar="MODE", help="Order in a cell: BOUSTROPHEDON, SNAKE or SPIRAL.")
    ] = "BOUSTROPHEDON"
    clearance: Annotated[
        float, typer.Option("--clearance", metavar="M", help="Distance of the footprint from obstacles (m).", min=0.0)
    ] = 0.075
    start: options.Start = None
    obstacle: options.Obstacles = []
    seed: Annotated[int, typer.Option("--seed", help="Random seed of the simulated noise.", min=0)] = 0
    set_: options.Set = []
    distro: options.Distro = None

    def step(self) -> CoverStep:
        """Return the step. Raises InputError for a wrong value."""
        swaths: dict[str, Any] = {}
        if self.angle.strip().lower() != "best":
            swaths = {"mode": "SET_ANGLE", "best_angle": parse_angle(self.angle)}
        if not (math.isfinite(self.tool_width) and self.tool_width > 0.0):
            raise InputError(
                f"--tool-width {self.tool_width:g} is not a width; give meters above 0, such as 0.35",
                argument="--tool-width",
            )
        values = {
            "cover": "all" if self.polygon is None else str(self.polygon),
            "operation_width": self.tool_width,
            "clearance": self.clearance,
            "generate_headland": self.headland,
            "swath_mode": swaths,
            "route_mode": {"mode": self.route.upper()},
        }
        return read_cover_step(values)


@options.with_options(chosen=CoverOptions)
def cover(
    chosen: CoverOptions,
    drive: Annotated[
        bool, typer.Option("--drive/--plan", help="Drive the plan in the simulator, or plan only.")
    ] = False,
    out: options.RunOutput = Path("navstack_cover"),
    _style: options.Style = "screen",
    json_: options.Json = False,
) -> int:
    """Plan, and drive, a tool over all of a map or polygon that the footprint can reach.

    Exit codes: 0 planned, and driven if asked for; 1 the drive failed; 2 invalid input; 130 interrupted.
    """
    step = chosen.step()
    path, grid = map_of(chosen.map_)
    configuration = load_configuration(chosen.params, overrides=chosen.set_, distro=chosen.distro)
    print_findings(configuration.findings, chosen.params, chosen.set_)
    if drive:  # a base that cannot drive this is reported before anything is written
        step.motion(configuration.navstack.motion, turning_radius=configuration.navstack.sim.turning_radius)
    with loading_kernels(["coverage"], quiet=json_):
        start, plan = _planned(chosen, configuration, grid, step, drive=drive)
    folder = ensure_directory(out)
    document: dict[str, Any] = {
        "map": path.name,
        "start": list(start),
        "operation_width": step.operation_width,
        "clearance": step.clearance,
        "swath_angle": plan.swath_angle,
        "planning_time_s": plan.planning_time,
        "wanted_m2": _wanted_m2(grid, plan),
        "plan": plan.figures.as_dict(),
    }
    line, at_work = plan.line()
    visits = visits_of(plan.area, line, at_work)
    left = [part.as_dict() for part in left_in(plan.area, visits, least_m2=0.1 * step.operation_width**2)]
    files = {"picture": folder / "coverage.png", "summary": folder / "coverage.json"}
    subtitle = _subtitle(document["plan"])
    plot_coverage(plan, grid, files["picture"], title=f"{path.stem}: plan", subtitle=subtitle)
    code = 0
    names = {what: str(file) for what, file in files.items()}
    if drive:
        code = _drive(chosen, configuration, grid, start, step, folder, document, names, quiet=json_)
        left = document.pop("left_driven", left)
    document |= {"left": left, "files": names}
    write_json(files["summary"], document)
    if json_:
        print_json(document)
    else:
        _print(document, path.name)
        print_files(names)
    return code


def _planned(
    chosen: CoverOptions, configuration: Configuration, grid: OccupancyGrid, step: CoverStep, *, drive: bool
) -> tuple[Pose2D, CoveragePlan]:
    """Return the start and the plan on the costmap of a robot that knows only the map."""
    start = _start(chosen)
    costmap = costmap_on_map(configuration, grid, start or _middle(grid))
    resolution = costmap.master.geometry.resolution
    least = least_clearance(resolution)
    if step.clearance < least:
        print_note(
            f"a drive keeps {least:g} m from obstacles, not --clearance {step.clearance:g}: it holds positions to "
            f"{least - resolution:.2g} m, and a scan may mark a wall one cell of {resolution:g} m too early"
        )
        if drive:
            step = step.model_copy(update={"clearance": least})
    if start is None:
        start = roomy_start(costmap.master, costmap.footprint, clearance=step.clearance)
        print_note(f"no start is given: begins at ({start.x:.2f}, {start.y:.2f}), in the largest region")
    note_off_the_map(grid, start, [])
    # the first plan loads the kernels; the time of the second is that of the plan
    plan_coverage(costmap.master, costmap.footprint, start, step, polygon=step.polygon)
    return start, plan_coverage(costmap.master, costmap.footprint, start, step, polygon=step.polygon)


def _wanted_m2(grid: OccupancyGrid, plan: CoveragePlan) -> float:
    """Return the free area of the map, inside the polygon (m²)."""
    factor = plan.area.grid.nx // grid.geometry.nx
    known = np.repeat(np.repeat(grid.data != -1, factor, axis=0), factor, axis=1)
    same = known.shape == plan.area.grid.shape
    return int((plan.area.wanted & known).sum() if same else plan.area.wanted.sum()) * plan.area.cell_area


def _start(chosen: CoverOptions) -> Pose2D | None:
    if chosen.start is not None:
        return parse_place(chosen.start, "--start", chosen.map_)
    if chosen.map_ in map_names():
        return load_places(chosen.map_).start_pose
    return next(iter(places_of(chosen.map_).values()), None)


def _middle(grid: OccupancyGrid) -> Pose2D:
    left, right, bottom, top = grid.geometry.extent
    return Pose2D(0.5 * (left + right), 0.5 * (bottom + top), 0.0)


def _drive(
    chosen: CoverOptions,
    configuration: Configuration,
    grid: OccupancyGrid,
    start: Pose2D,
    step: CoverStep,
    folder: Path,
    document: dict[str, Any],
    names: dict[str, str],
    *,
    quiet: bool,
) -> int:
    """Drive the step in the simulator; add the figures to the document. Returns the exit code."""
    obstacles, shapes = parse_obstacles(chosen.obstacle)
    scenario = Scenario(
        map=grid,
        configuration=configuration,
        start=start,
        goals=(),
        steps=(step,),
        obstacles=obstacles,
        shapes=shapes,
        seed=chosen.seed,
        time_limit_s=1e6,
        names={"map": document["map"], "params": [Path(p).name for p in chosen.params]},
    )
    with interrupt_flag() as interrupt, loading_kernels(configuration.planner_names, quiet=quiet):
        run, behavior, interrupted = _driven(scenario, interrupt, quiet=quiet)
    assert run.recorder is not None
    names |= save_record(run.recorder, folder)
    outcome = run.outcomes[0]
    track = run.track()
    points, works = np.ascontiguousarray(track[:, 1:3]), behavior.works_at(track[:, 0])
    report = behavior.report(points, works)
    document["driven"] = {**report["driven"], "plans": report["plans"], "state": outcome.state, "text": outcome.text}
    document["clearance"] = report["clearance"]
    document["driven"]["collisions"] = len(run.robot.collisions)
    battery, figures = configuration.navstack.sim.battery, report["driven"]
    figures["energy_wh"] = document["driven"]["energy_wh"] = energy_of(battery, figures["time_s"], figures["length_m"])
    document["left_driven"] = report["left"]
    names["driven"] = str(folder / "driven.png")
    assert behavior.plan is not None
    plot_coverage(
        behavior.plan,
        grid,
        folder / "driven.png",
        track=points,
        works=works,
        title=f"{Path(document['map']).stem}: driven",
        subtitle=_subtitle(report["driven"]),
    )
    if interrupted:
        return interrupt.exit_code
    return 0 if outcome.succeeded else 1


def _driven(scenario: Scenario, stop: Callable[[], bool], *, quiet: bool) -> tuple[Run, CoverageDrive, bool]:
    """Run the scenario to its end, or until `stop`; return the run, its behavior, and whether it was stopped."""
    run = Run(scenario)
    behavior: CoverageDrive | None = None
    interrupted, shown = False, 0.0
    with stderr().status("driving") as line:
        if quiet:
            line.stop()
        while run.step():
            running = run.move_base.motions.running
            if running is not None and isinstance(running.motion, CoverageDrive):
                behavior = running.motion
                if run.robot.time - shown >= 10.0:
                    shown = run.robot.time
                    line.update(
                        f"{running.data.get('legs_left', '?')} of {running.data.get('legs', '?')} legs, {shown:.0f} s"
                    )
            if stop():
                run.stop()
                interrupted = True
                break
    if behavior is None or behavior.plan is None:
        outcome = run.outcomes[0]
        raise InputError(f"the drive did not begin: {outcome.message or outcome.text}")
    return run, behavior, interrupted


def _subtitle(figures: dict[str, Any]) -> str:
    text = (
        f"{figures['share']:.1%} of {figures['reachable_m2']:.1f} m² in reach, overlap {figures['overlap']:.1%}, "
        f"{figures['work_m']:.0f} m at work, {figures['travel_m']:.0f} m with the tool off, {figures['turns']} turns"
    )
    return f"{text}, {figures['time_s']:.0f} s, {figures['energy_wh']:.1f} Wh" if "time_s" in figures else text


def _texts(figures: dict[str, Any], planning_time_s: float) -> dict[str, str]:
    """Return the lines of a column of the table."""
    return {
        "covered": f"{figures['covered_m2']:.1f} m²",
        "of what is in reach": f"{figures['share']:.1%} of {figures['reachable_m2']:.1f} m²",
        "overlap": f"{figures['overlap']:.1%}",
        "length at work": f"{figures['work_m']:.1f} m",
        "length with the tool off": f"{figures['travel_m']:.1f} m",
        "turns": str(figures["turns"]),
        "time": f"{figures['time_s']:.0f} s" if "time_s" in figures else f"planned in {planning_time_s:.2f} s",
    } | ({"energy": f"{figures['energy_wh']:.1f} Wh"} if "time_s" in figures else {})


def _print(document: dict[str, Any], name: str) -> None:
    out = stdout()
    table = titled_table(
        f"coverage of {name}", left=("",), right=("plan", *(("driven",) if "driven" in document else ()))
    )
    columns = [document["plan"], *([document["driven"]] if "driven" in document else [])]
    texts = [_texts(figures, document["planning_time_s"]) for figures in columns]
    for label in texts[-1]:
        table.add_row(label, *(column.get(label, "") for column in texts))
    out.print(table)
    wanted, reach = document["wanted_m2"], document["plan"]["reachable_m2"]
    if wanted > reach:
        print_note(
            f"{wanted - reach:.1f} of {wanted:.1f} m² of free space are out of reach of the footprint or the tool"
        )
    left = document["left"]
    if left:
        parts = titled_table("left", left=("at", "area", "why"))
        parts.columns[2].no_wrap, parts.columns[2].overflow = False, "fold"
        for part in left[:LEFT_SHOWN]:
            parts.add_row(f"{part['x']:.2f}, {part['y']:.2f}", f"{part['area_m2']:.2f} m²", part["reason"])
        out.print(parts)
        if len(left) > LEFT_SHOWN:
            rest = sum(part["area_m2"] for part in left[LEFT_SHOWN:])
            print_note(f"and {len(left) - LEFT_SHOWN} smaller parts, {rest:.2f} m² together: see coverage.json")
