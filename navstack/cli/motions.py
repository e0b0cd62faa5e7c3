"""`navstack move`, `turn`, `drive-to` and `follow`: single motions, without a planner."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from rich.markup import escape

from navstack.behaviors import Trajectory, parse_angle, parse_length, read_step, trajectory_of
from navstack.cli import options
from navstack.cli.arguments import extent_text, map_of, note_off_the_map, parse_obstacles, parse_place, scenario_file
from navstack.cli.explain.tracking import draw, print_tracking
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.output import (
    counted,
    loading_kernels,
    print_json,
    print_note,
    print_warnings,
    reason_of,
    stdout,
    titled_table,
)
from navstack.core import InputError, Pose2D, RecordError, locked_folder, write_json, write_text
from navstack.explain import explain_tracking
from navstack.map_io import map_names
from navstack.parameters import load_configuration, short_name
from navstack.plot import plot_run
from navstack.scenario import (
    Scenario,
    SuccessConditions,
    load_places,
    read_scenario,
    run_scenario,
    shipped_scenarios,
    warm_up,
)

if TYPE_CHECKING:
    from navstack.behaviors import FollowStep, Step
    from navstack.cli.interrupts import Interrupt
    from navstack.record import Record
    from navstack.scenario import GoalOutcome, Places, RunResult

# ----------------------------------------------------------------------------------------------------------------------
# The options of `navstack move`, `turn`, `follow` and `teleop` that choose the world and the robot.


TIME_LIMIT_S = 3600.0
"""Time limit of a motion, besides its own (simulated s)."""

World = Annotated[
    str,
    typer.Argument(
        metavar="[MAP|SCENARIO]",
        help="Scenario file or map_server YAML file, or name of a packaged scenario or map.",
        show_default="office",
    ),
]


class MotionOptions(NamedTuple):
    """A map with a start, or a scenario file, of which goals and interactions are not used."""

    start: options.Start = None
    params: options.ParamsOrScenario = []
    set_: options.Set = []
    distro: options.Distro = None
    seed: Annotated[
        int | None, typer.Option("--seed", help="Random seed of the simulated noise. [default: 0]", min=0)
    ] = None
    obstacle: options.Obstacles = []

    def build(self, world: str, steps: tuple[Step, ...], *, start: Pose2D | None = None) -> Scenario:
        """Returns a scenario with these steps instead of goals; `start` counts if `--start` is not given.

        Prints the warnings of the parameters. Raises InputError, MapError, ParameterError or ScenarioError.
        """
        if world.startswith("-"):  # negative numbers are allowed as arguments, so unknown options arrive here
            raise InputError(f'there is no option "{world}"; `--help` lists the options', argument=world)
        begin = parse_place(self.start, "--start", world) if self.start is not None else start
        file = scenario_file(world)
        scenario = self._from_map(world, begin) if file is None else self._from_file(file, begin)
        return replace(scenario, goals=(), steps=steps, interactions=(), success=SuccessConditions())

    def _from_file(self, file: Path, start: Pose2D | None) -> Scenario:
        obstacles, shapes = parse_obstacles(self.obstacle)
        scenario = read_scenario(file).build(
            params=self.params or None,
            overrides=self.set_,
            distro=self.distro,
            seed=self.seed,
            start=start,
            time_limit_s=TIME_LIMIT_S,
            obstacles=obstacles,
            shapes=shapes,
        )
        print_warnings(
            scenario.configuration, self.params or [str(file)], self.set_, distro=self.distro, simulated=True
        )
        return scenario

    def _from_map(self, name: str, start: Pose2D | None) -> Scenario:
        path, grid = map_of(name, {"scenario": shipped_scenarios()})
        if start is None and name in map_names():
            start = load_places(name).start
        if start is None:
            raise InputError(
                f"{path.name} defines no start; give --start x,y[,yaw] (m, rad); the map covers {extent_text(grid)}",
                argument="--start",
            )
        params = self.params or ["turtlebot"]
        configuration = load_configuration(params, overrides=self.set_, distro=self.distro)
        print_warnings(configuration, params, self.set_, distro=self.distro, simulated=True)
        note_off_the_map(grid, start, ())
        obstacles, shapes = parse_obstacles(self.obstacle)
        return Scenario(
            map=grid,
            configuration=configuration,
            start=start,
            goals=(),
            obstacles=obstacles,
            shapes=shapes,
            seed=self.seed or 0,
            time_limit_s=TIME_LIMIT_S,
            names={
                "map": path.name,
                "params": [short_name(p) for p in params],
                "overrides": [str(text) for text in self.set_],
            },
        )


class Frame(StrEnum):
    """Frame in which a motion is measured."""

    odom = "odom"
    map = "map"


class Tracking(StrEnum):
    """Tracking controller."""

    kanayama = "kanayama"
    samson = "samson"


FrameOption = Annotated[
    Frame | None,
    typer.Option("--frame", help="Measure by odometry alone, or with localization. [default: that of the parameters]"),
]


@options.with_options(chosen=MotionOptions)
def move(
    distance: Annotated[
        str, typer.Argument(metavar="DISTANCE", help="Distance (m), backwards if negative: 1.5, -0.3.")
    ],
    world: World = "office",
    speed: Annotated[float | None, typer.Option("--speed", help="Speed (m/s).", min=1e-3)] = None,
    tolerance: Annotated[float | None, typer.Option("--tolerance", help="Tolerance (m).", min=1e-4)] = None,
    frame: FrameOption = None,
    chosen: MotionOptions = MotionOptions(),
    out: options.RunOutput = Path("navstack_move"),
    json_: options.Json = False,
) -> int:
    """Drive a simulated robot straight ahead or backwards. It stops before obstacles.

    Exit codes: 0 the distance was driven, 1 it was not, 2 invalid input, 130 interrupted.
    """
    values = {"speed": speed, "tolerance": tolerance, "frame": frame}
    step = read_step({"move": parse_length(distance), **_given(values)})
    return run_motions(chosen.build(world, (step,)), out, json_=json_)


@options.with_options(chosen=MotionOptions)
def turn(
    angle: Annotated[
        str, typer.Argument(metavar="ANGLE", help="Angle, clockwise if negative: 90deg, -270deg, 1000deg, 1.57 (rad).")
    ],
    world: World = "office",
    shortest: Annotated[
        bool, typer.Option("--shortest", help="Turn to that heading the shorter way, at most half a turn.")
    ] = False,
    speed: Annotated[float | None, typer.Option("--speed", help="Turn rate (rad/s).", min=1e-3)] = None,
    tolerance: Annotated[float | None, typer.Option("--tolerance", help="Tolerance (rad).", min=1e-4)] = None,
    frame: FrameOption = None,
    chosen: MotionOptions = MotionOptions(),
    out: options.RunOutput = Path("navstack_turn"),
    json_: options.Json = False,
) -> int:
    """Turn a simulated robot in place, by more than a full turn too. It stops before obstacles.

    Exit codes: 0 the angle was turned, 1 it was not, 2 invalid input, 130 interrupted.
    """
    values = {"speed": speed, "tolerance": tolerance, "frame": frame, "shortest": shortest}
    radians = parse_angle(angle)
    if abs(radians) > 2.0 * math.pi and angle.strip().lstrip("+-").replace(".", "", 1).isdigit():
        print_note(f"{angle} is taken as radians, {math.degrees(radians):.0f} degrees; for degrees, write {angle}deg")
    step = read_step({"turn": radians, **_given(values)})
    return run_motions(chosen.build(world, (step,)), out, json_=json_)


@options.with_options(chosen=MotionOptions)
def drive_to(
    pose: Annotated[
        str,
        typer.Argument(
            metavar="X,Y[,YAW]|PLACE", help="Pose in the map (m, rad), or a place of a packaged map: 3,7.45,1.57."
        ),
    ],
    world: World = "office",
    backwards: Annotated[bool, typer.Option("--backwards", help="Drive there backwards.")] = False,
    speed: Annotated[float | None, typer.Option("--speed", help="Speed (m/s).", min=1e-3)] = None,
    tolerance: Annotated[float | None, typer.Option("--tolerance", help="Tolerance (m).", min=1e-4)] = None,
    chosen: MotionOptions = MotionOptions(),
    out: options.RunOutput = Path("navstack_drive_to"),
    json_: options.Json = False,
) -> int:
    """Drive a simulated robot straight to a pose, without a planner: face it, drive, turn to its heading.

    It stops before obstacles and does not go around them; `navstack simulate --goal` does.

    Exit codes: 0 the pose was reached, 1 it was not, 2 invalid input, 130 interrupted.
    """
    target = list(parse_place(pose, "the pose", world))
    values = {"speed": speed, "tolerance": tolerance, "backwards": backwards or None}
    step = read_step({"drive_to": target, **_given(values)})
    return run_motions(chosen.build(world, (step,)), out, json_=json_)


@options.with_options(chosen=MotionOptions)
def follow(
    trajectory: Annotated[
        str,
        typer.Argument(
            metavar="heart|figure_eight|FILE",
            help="A shape, or a file: .csv (t, x, y, ..), or .yaml or .json of a MultiDOFJointTrajectory.",
        ),
    ],
    world: World = "office",
    size: Annotated[float, typer.Option("--size", help="Largest extent of a shape (m).", min=0.1, max=1000.0)] = 2.0,
    speed: Annotated[
        float | None, typer.Option("--speed", help="Maximum speed (m/s). [default: what the robot can do]", min=1e-3)
    ] = None,
    here: Annotated[
        bool | None,
        typer.Option(
            "--here/--there", help="Begin at the robot, or where the file says. [default: shapes here, files there]"
        ),
    ] = None,
    fit: Annotated[
        bool | None,
        typer.Option("--fit/--as-is", help="Stretch its time to the robot's limits. [default: shapes yes, files no]"),
    ] = None,
    frame: Annotated[
        Frame, typer.Option("--frame", help="Follow it by localization, or by odometry alone.")
    ] = Frame.map,
    tracking: Annotated[
        Tracking | None, typer.Option("--tracking", help="Tracking controller. [default: that of the parameters]")
    ] = None,
    chosen: MotionOptions = MotionOptions(),
    out: options.RunOutput = Path("navstack_follow"),
    json_: options.Json = False,
) -> int:
    """Follow a timed trajectory with a simulated robot; print, draw and write the errors over time.

    A trajectory of a file starts where the file says, unless `--start` or `--here` is given; a shape on a packaged map at the
    first place that has room for it. If the robot cannot follow it, the limits that it breaks are listed, with the time.

    Exit codes: 0 it was followed to its end, 1 it was not, 2 invalid input or infeasible, 130 interrupted.
    """
    values = {"speed": speed, "here": here, "fit": fit, "frame": frame, "tracking": tracking, "size": size}
    step: Any = read_step({"follow": trajectory, **_given(values)})
    scenario = chosen.build(world, (step,), start=_start_of(step))
    if chosen.start is None:
        scenario = _with_room(scenario, world, step)
    return run_motions(scenario, out, json_=json_)


def _with_room(scenario: Scenario, world: str, step: FollowStep) -> Scenario:
    """The scenario with a start that has room for the shape, on a packaged map."""
    if step.trajectory is not None or step.here is False or world not in map_names():
        return scenario
    found = roomy_start(scenario, trajectory_of(step), load_places(world))
    if found is None:
        print_note(f"no place of {world} has room for {step.follow} of {step.size:g} m; try a smaller --size")
        return scenario
    name, pose = found
    if pose != scenario.start:
        print_note(
            f"{step.follow} of {step.size:g} m starts at {name}, {pose.x:g},{pose.y:g},{pose.yaw:.2f}, where it has room"
        )
    return replace(scenario, start=pose)


def _start_of(step: FollowStep) -> Pose2D | None:
    """Start of a trajectory that does not begin at the robot."""
    if step.trajectory is None or step.here:
        return None
    return Trajectory.from_dict(step.trajectory).start


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """The options that were given, as text or numbers."""
    return {key: str(v) if isinstance(v, StrEnum) else v for key, v in values.items() if v is not None}


# ----------------------------------------------------------------------------------------------------------------------
# Where on a packaged map a shape has room.


HEADINGS = tuple(k * math.pi / 6.0 for k in range(12))
"""Headings that are tried at each place (rad)."""
CHECKS = 120
"""Number of poses of the trajectory that are checked."""
ROOM_M = 0.15
"""Distance that the footprint keeps from walls: a robot with slip leaves the trajectory by some centimeters."""


def roomy_start(scenario: Scenario, trajectory: Trajectory, places: Places) -> tuple[str, Pose2D] | None:
    """Returns the first place, with a heading, at which the footprint has ROOM_M along the trajectory; None if there is none.

    The start of the map comes first, with its own heading.
    """
    first = next((name for name, pose in places.places.items() if pose == places.start_pose), "the start")
    candidates = [(first, places.start)]
    candidates += [(name, Pose2D(p.x, p.y, yaw)) for name, p in places.places.items() for yaw in HEADINGS]
    return next(((name, pose) for name, pose in candidates if _is_free(scenario, trajectory, pose)), None)


def _is_free(scenario: Scenario, trajectory: Trajectory, start: Pose2D) -> bool:
    import numpy as np

    world, footprint = scenario.world(), scenario.configuration.global_costmap.true_footprint
    poses = trajectory.moved_to(start, "map").poses(np.linspace(0.0, trajectory.duration, CHECKS))
    if not all(world.contains(Pose2D(*pose)) for pose in poses.tolist()):
        return False
    return bool((world.clearances(poses, footprint, world.solids_at(0.0)) >= ROOM_M).all())


# ----------------------------------------------------------------------------------------------------------------------
# Runs a scenario of motions, writes its files and prints its outcome.


def run_motions(scenario: Scenario, folder: Path, *, json_: bool) -> int:
    """Drives the steps of a scenario; returns the exit code. Ctrl-C and SIGTERM stop the robot and keep the record."""
    with locked_folder(folder), interrupt_flag() as interrupt:
        return _run(scenario, folder, interrupt, json_=json_)


def _run(scenario: Scenario, folder: Path, interrupt: Interrupt, *, json_: bool) -> int:
    with loading_kernels(scenario.configuration.planner_names, quiet=json_):
        warm_up(scenario)
    result = run_scenario(scenario, stop=interrupt)
    assert result.recorder is not None
    files = save_record(result.recorder, folder)
    record = result.recorder.record()
    plot_run(record, folder / "run.png")
    files["picture"] = str(folder / "run.png")
    if not json_:
        print_steps(result)
    files |= _tracking(record, folder, quiet=json_)
    files["summary"] = str(folder / "summary.json")
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        from navstack.cli.output import print_files

        print_files(files)
    if interrupt():
        return interrupt.exit_code
    return 0 if result.succeeded else 1


def print_steps(result: RunResult) -> None:
    """Prints the outcome of every step."""
    out = stdout()
    table = titled_table("steps", left=("step", "state"), right=("time", "driven", "remaining"))
    for goal in result.goals:
        style = "green" if goal.succeeded else "bold red"
        table.add_row(
            escape(goal.step or f"{goal.goal.x:g}, {goal.goal.y:g}, {goal.goal.yaw:.2f}"),
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.3f} m",
            _remaining(goal),
        )
    out.print(table)
    for goal in result.goals:
        reason = goal.text if goal.succeeded else reason_of(goal)
        out.print(escape(reason))
    if result.collisions:
        out.print(f"[bold red]{counted(result.collisions, 'collision')}[/]")


def _remaining(goal: GoalOutcome) -> str:
    """What is left of a step: the angle of a turn, the distance of everything else."""
    if goal.step.startswith("turn"):
        return f"{math.degrees(goal.yaw_left_rad):.1f} degrees"
    return f"{goal.distance_left_m:.3f} m"


def _tracking(record: Record, folder: Path, *, quiet: bool) -> dict[str, str]:
    """Prints, draws and writes how the trajectories of a run were followed; returns the files."""
    for old in (*folder.glob("tracking*.png"), *folder.glob("tracking*.csv")):  # of an earlier run
        old.unlink(missing_ok=True)
    try:
        reports = explain_tracking(record)
    except RecordError:
        return {}
    files: dict[str, str] = {}
    for number, report in enumerate(reports, 1):
        name = "tracking" if len(reports) == 1 else f"tracking_{number}"
        files[name] = str(draw(report, folder / f"{name}.png"))
        write_text(folder / f"{name}.csv", report.table())
        files[f"{name} table"] = str(folder / f"{name}.csv")
        if not quiet:
            print_tracking(report)
    return files
