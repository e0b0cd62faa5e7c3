"""`navstack move`, `turn`, `drive-to` and `follow`: single motions, without a planner."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navstack.cli import options
from navstack.cli.motion_options import MotionOptions, World

if TYPE_CHECKING:
    from navstack.core import Pose2D
    from navstack.motion.steps import FollowStep
    from navstack.scenario import Scenario


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
    from navstack.cli.motion_run import run_motions
    from navstack.motion.steps import parse_length, read_step

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
    from navstack.cli.motion_run import run_motions
    from navstack.motion.steps import parse_angle, read_step

    values = {"speed": speed, "tolerance": tolerance, "frame": frame, "shortest": shortest}
    step = read_step({"turn": parse_angle(angle), **_given(values)})
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
    from navstack.cli.motion_run import run_motions
    from navstack.motion.steps import read_step

    target = _pose_or_place(pose, world)
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
    from navstack.cli.motion_run import run_motions
    from navstack.motion.steps import read_step

    values = {"speed": speed, "here": here, "fit": fit, "frame": frame, "tracking": tracking, "size": size}
    step: Any = read_step({"follow": trajectory, **_given(values)})
    scenario = chosen.build(world, (step,), start=_start_of(step))
    if chosen.start is None:
        scenario = _with_room(scenario, world, step)
    return run_motions(scenario, out, json_=json_)


def _pose_or_place(text: str, world: str) -> list[float]:
    """Pose of an argument. Raises InputError."""
    from navstack.cli.arguments import parse_pose
    from navstack.core.errors import InputError
    from navstack.map_io import map_names
    from navstack.places import load_places

    if "," in text:
        return list(parse_pose(text, "the pose"))
    places = load_places(world).places if world in map_names() else {}
    if text in places:
        return list(places[text])
    known = ", ".join(places)
    also = f", or a place of {world}: {known}" if known else ""
    raise InputError(
        f'the pose "{text}" is neither x,y or x,y,yaw in metres and radians, such as 3,7.45,1.57{also}', value=text
    )


def _with_room(scenario: Scenario, world: str, step: FollowStep) -> Scenario:
    """The scenario with a start that has room for the shape, on a packaged map."""
    from dataclasses import replace

    from navstack.cli.motion_fit import roomy_start
    from navstack.cli.output import print_note
    from navstack.map_io import map_names
    from navstack.motion.steps import trajectory_of
    from navstack.places import load_places

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
    from navstack.motion import Trajectory

    if step.trajectory is None or step.here:
        return None
    return Trajectory.from_dict(step.trajectory).start


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """The options that were given, as text or numbers."""
    return {key: str(v) if isinstance(v, StrEnum) else v for key, v in values.items() if v is not None}
