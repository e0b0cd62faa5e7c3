"""Steps of a tour, as mappings.

{move: 0.5}, {turn: 90 deg}, {follow: heart}, {wait: 2}, {goto: kitchen}, {drive_to: [x, y, yaw]}, {route: GRAPH, to: kitchen}
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError, field_validator

from navstack.behaviors.base import Motion
from navstack.behaviors.drive_to_pose import DriveToPose
from navstack.behaviors.errors import InvalidMotionError, InvalidTrajectoryError
from navstack.behaviors.follow import FollowTrajectory
from navstack.behaviors.straight import Move
from navstack.behaviors.trajectory import Trajectory, figure_eight, heart, load_trajectory
from navstack.behaviors.turn import Turn
from navstack.behaviors.wait import Pause
from navstack.core import Pose2D, WheelDrive, normalize_angle, short_repr
from navstack.parameters import MotionParams
from navstack.plugins import Behavior, ParamModel, param
from navstack.routes import (
    FollowRoute,
    InvalidGraphError,
    RoutePlanner,
    graph_text,
    load_graph,
    parse_graph,
    read_operations,
    read_scorers,
)

SHAPES: Final = ("heart", "figure_eight")
BASE_PERIOD_S: Final = 60.0
"""Period of a shape before it is fitted to the robot."""
_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_UNITS: Final = {"deg": math.pi / 180.0, "degrees": math.pi / 180.0, "°": math.pi / 180.0, "rad": 1.0, "": 1.0}

Number = Annotated[float, Field(ge=-1e6, le=1e6)]


def parse_angle(text: str) -> float:
    """Return an angle (rad) of `270deg`, `-90 deg`, `1.57 rad` or `1.57`. Raises InvalidMotionError."""
    match = re.fullmatch(rf"({_NUMBER})\s*(\S*)", text.strip())
    if match is None or match[2].lower() not in _UNITS:
        raise InvalidMotionError(f'the angle "{text}" is neither rad nor deg; write 90deg or 1.57', value=text)
    return float(match[1]) * _UNITS[match[2].lower()]


def parse_length(text: str, what: str = "distance") -> float:
    """Return a number of `1.5`, `1.5m`, `2 s`. Raises InvalidMotionError."""
    match = re.fullmatch(rf"({_NUMBER})\s*[ms]?", text.strip())
    if match is None:
        raise InvalidMotionError(f'the {what} "{text}" is not a number', value=text)
    return float(match[1])


class _Step(ParamModel):
    """What every step may set."""

    time_allowance: float | None = param(None, "time limit; none: that of the parameters", unit="s", gt=0.0)


class _Driven(_Step):
    speed: float | None = param(None, "speed; none: that of the parameters", unit="m/s", gt=0.0)
    tolerance: float | None = param(None, "distance that counts as reached", unit="m", gt=0.0)


class MoveStep(_Driven):
    """Drive straight ahead."""

    move: Number = param(..., "distance, backwards if negative", unit="m")
    frame: Literal["odom", "map"] | None = param(None, "frame in which it is measured; none: that of the parameters")


class TurnStep(_Step):
    """Turn in place."""

    turn: Number = param(..., "angle, clockwise if negative; `90 deg` in files", unit="rad")
    shortest: bool = param(False, "turn to that heading the shorter way")
    speed: float | None = param(None, "turn rate; none: that of the parameters", unit="rad/s", gt=0.0)
    tolerance: float | None = param(None, "angle that counts as reached", unit="rad", gt=0.0)
    frame: Literal["odom", "map"] | None = param(None, "frame in which it is measured; none: that of the parameters")

    @field_validator("turn", mode="before")
    @classmethod
    def _angle(cls, value: Any) -> Any:
        return parse_angle(value) if isinstance(value, str) else value


class DriveToStep(_Driven):
    """Turn to a pose, drive straight to it, turn to its heading; without a planner."""

    drive_to: Annotated[list[Number], Field(min_length=2, max_length=3)] = param(..., "[x, y, yaw] in the map")
    backwards: bool = param(False, "drive backwards")


class FollowStep(_Step):
    """Follow a shape or a trajectory."""

    follow: str = param(..., "heart, figure_eight, or a file: .csv, or .yaml or .json of a MultiDOFJointTrajectory")
    size: float = param(2.0, "largest extent of a shape", unit="m", gt=0.0, le=1000.0)
    speed: float | None = param(None, "maximum speed; none: as fast as the limits allow", unit="m/s", gt=0.0)
    here: bool | None = param(None, "begin at the robot's pose; default: for shapes, not for files")
    fit: bool | None = param(None, "stretch its time to the robot's limits; default: for shapes, not for files")
    frame: Literal["odom", "map"] = param("map", "frame in which it is followed")
    tracking: Literal["kanayama", "samson"] | None = param(None, "tracking controller; none: that of the parameters")
    trajectory: dict[str, Any] | None = param(None, "the trajectory itself, in records")


class WaitStep(_Step):
    """Stand still."""

    wait: Annotated[float, Field(ge=0.0, le=1e6)] = param(..., "how long", unit="s")


class RouteStep(ParamModel):
    """Drive along a route on a graph."""

    route: str = param(..., "graph: a GeoJSON file of nav2_route")
    to: Annotated[list[Number], Field(min_length=2, max_length=3)] | int = param(
        ..., "goal: [x, y, yaw] in the map, a place, or the id of a node"
    )
    follow: Literal["path", "planner"] = param(
        "path", "follow the edges, or plan from node to node with the global planner"
    )
    closed: list[int] = param([], "ids of edges that are closed from the start")
    parameters: dict[str, Any] = param({}, "parameters of Nav2's route_server, such as smooth_corners: true")
    graph: str | None = param(None, "the graph itself, in records")


class GoToStep(ParamModel):
    """Drive to a goal with the planners."""

    goto: Annotated[list[Number], Field(min_length=2, max_length=3)] = param(..., "[x, y, yaw] in the map, or a place")
    place: str = param("", "name of the place")

    @property
    def pose(self) -> Pose2D:
        """The goal."""
        x, y, *yaw = self.goto
        return Pose2D(x, y, normalize_angle(yaw[0]) if yaw else 0.0)


Step = MoveStep | TurnStep | DriveToStep | FollowStep | WaitStep | RouteStep | GoToStep
KINDS: Final[dict[str, type[ParamModel]]] = {
    "move": MoveStep,
    "turn": TurnStep,
    "drive_to": DriveToStep,
    "follow": FollowStep,
    "wait": WaitStep,
    "route": RouteStep,
    "goto": GoToStep,
}
EXAMPLES: Final = (
    "{move: 0.5}, {turn: 90 deg}, {follow: heart}, {wait: 2}, {goto: PLACE}, {drive_to: [x, y, yaw]}, "
    "{route: GRAPH.geojson, to: PLACE}"
)


def is_step(keys: Any) -> bool:
    """Return True for the keys of a mapping that is a step."""
    return _kinds(keys) != []


def _kinds(keys: Any) -> list[str]:
    """Return the kinds of step that keys of a mapping name; `follow` of a route is a value of it."""
    found = [kind for kind in KINDS if kind in keys]
    return ["route"] if "route" in found and set(found) <= {"route", "follow"} else found


def read_step(
    values: Mapping[str, Any], *, places: Mapping[str, Pose2D] | None = None, folder: Path | None = Path()
) -> Step:
    """Return the step of a mapping. Places are looked up in `places`, files of trajectories below `folder` (None: not at all).

    Raises InvalidMotionError, and InvalidTrajectoryError for a file.
    """
    kinds = _kinds(values)
    if len(kinds) != 1:
        raise InvalidMotionError(f"{short_repr(dict(values))} is not one step; steps are {EXAMPLES}")
    kind, known = kinds[0], places or {}
    values = dict(values)
    target = values[kind]
    if kind in ("goto", "drive_to") and isinstance(target, str):
        if target not in known:
            raise InvalidMotionError(f'{kind} "{target}" is not a place; known places: {", ".join(known) or "none"}')
        values[kind] = list(known[target])
        if kind == "goto":
            values["place"] = target
    if kind == "route":
        _read_graph(values, known, folder)
    if kind == "follow" and isinstance(target, str) and target not in SHAPES and "trajectory" not in values:
        if folder is None:
            raise InvalidMotionError(f"the step follow {short_repr(target)} has no trajectory")
        values["trajectory"] = _from_file(target, folder).as_dict()
    try:
        step: Any = KINDS[kind].model_validate(values)
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in error["loc"]) or kind
        unknown = error["type"] == "extra_forbidden"
        what = f"known keys: {', '.join(KINDS[kind].model_fields)}" if unknown else error["msg"]
        raise InvalidMotionError(f"{where} of the step {kind} is {short_repr(error['input'])}: {what}") from None
    return step


def step_data(step: Step) -> dict[str, Any]:
    """Return a step as JSON data, which `read_step` reads."""
    return step.model_dump(mode="json", exclude_none=True, exclude_defaults=True)


def step_text(step: Step) -> str:
    """Return a step in a few words."""
    match step:
        case MoveStep():
            return f"move {step.move:g} m"
        case TurnStep():
            return f"turn {math.degrees(step.turn):g} deg"
        case DriveToStep():
            return f"drive to {', '.join(f'{v:g}' for v in step.drive_to)}"
        case FollowStep():
            return f"follow {Path(step.follow).stem}"
        case WaitStep():
            return f"wait {step.wait:g} s"
        case RouteStep():
            to = f"node {step.to}" if isinstance(step.to, int) else ", ".join(f"{v:g}" for v in step.to)
            return f"route {Path(step.route).stem} to {to}"
        case GoToStep():
            return step.place or f"{', '.join(f'{v:g}' for v in step.goto)}"


def motion_of(
    step: Step,
    params: MotionParams,
    *,
    turning_radius: float = 0.0,
    drive: WheelDrive | None = None,
    max_wheel_speed: float = math.inf,
) -> Behavior:
    """Return the motion of a step. `turning_radius` (m) is that of a base that cannot turn in place.

    `drive` are its wheels and `max_wheel_speed` their limit (m/s at the rim), which trajectories must keep.

    Raises InvalidMotionError for a step that this base cannot do, and for a goto, which is a goal.
    """
    if turning_radius > 0.0 and isinstance(step, (TurnStep, DriveToStep)):
        raise InvalidMotionError(
            f"{step_text(step)}: a base with a turning radius of {turning_radius:.2f} m cannot turn in place; use goto"
        )
    motion = _motion(step, params)
    if isinstance(motion, Motion):
        motion.min_turning_radius = turning_radius
        motion.drive, motion.max_wheel_speed = drive, max_wheel_speed
    return motion


def _motion(step: Step, params: MotionParams) -> Behavior:
    match step:
        case MoveStep():
            return Move(step.move, _changed(params, step, frame=step.frame, speed_linear=step.speed))
        case TurnStep():
            p = _changed(params, step, frame=step.frame, speed_radian=step.speed, tolerance_radian=step.tolerance)
            return Turn(step.turn, p, shortest=step.shortest)
        case DriveToStep():
            x, y, *yaw = step.drive_to
            p = _changed(params, step, speed_linear=step.speed)
            return DriveToPose(Pose2D(x, y, yaw[0] if yaw else 0.0), p, backwards=step.backwards)
        case FollowStep():
            p = _changed(params, step, follow_speed=step.speed, tracking=step.tracking)
            shape = step.trajectory is None
            return FollowTrajectory(
                trajectory_of(step),
                p,
                here=shape if step.here is None else step.here,
                fit=shape if step.fit is None else step.fit,
                measured_in=step.frame,
            )
        case WaitStep():
            return Pause(step.wait, params)
        case RouteStep():
            return route_of(step)
        case GoToStep():
            raise InvalidMotionError("goto is a goal, not a motion; send it to the goal manager")


def route_of(step: RouteStep) -> FollowRoute:
    """Return the drive of a step. Raises ParameterError, and InvalidGraphError for the graph, or an edge that is not there."""
    graph = parse_graph(step.graph or "", step.route)
    params, scorers = read_scorers(step.parameters)
    planner = RoutePlanner(graph, params, scorers)
    for edge in step.closed:
        graph.edge(edge)
    if step.closed:
        planner.dynamic_edges.adjust(closed=step.closed)
    goal = step.to if isinstance(step.to, int) else GoToStep(goto=step.to).pose
    if isinstance(goal, int):
        graph.node(goal)
    return FollowRoute(planner, goal, operations=read_operations(step.parameters), between_nodes=step.follow)


def _read_graph(values: dict[str, Any], places: Mapping[str, Pose2D], folder: Path | None) -> None:
    """Put the pose of a place and the text of the graph into the values of a route."""
    target, file = values.get("to"), values["route"]
    if isinstance(target, str):
        if target not in places:
            raise InvalidMotionError(
                f'to "{target}" of the route is not a place; known places: {", ".join(places) or "none"}'
            )
        values["to"] = list(places[target])
    if "graph" not in values and isinstance(file, str):
        if folder is None:
            raise InvalidMotionError(f"the step route {short_repr(file)} has no graph")
        path = folder / Path(file).expanduser()
        try:
            values["graph"] = graph_text(load_graph(path))
        except InvalidGraphError as exc:
            raise InvalidMotionError(exc.message) from None


def _changed(params: MotionParams, step: _Step, **values: Any) -> MotionParams:
    """Return the parameters with the values that the step sets."""
    values["time_allowance"] = step.time_allowance
    if isinstance(step, _Driven):
        values["tolerance"] = step.tolerance
    return params.model_copy(update={key: value for key, value in values.items() if value is not None})


def trajectory_of(step: FollowStep) -> Trajectory:
    """Return the trajectory of a step, not yet placed and fitted."""
    if step.trajectory is not None:
        return Trajectory.from_dict(step.trajectory)
    if step.follow == "figure_eight":
        return figure_eight(step.size, step.size / 1.5, BASE_PERIOD_S)
    it = heart(1.0, BASE_PERIOD_S)
    extent = float((it.position.max(axis=0) - it.position.min(axis=0)).max())
    return heart(step.size / extent, BASE_PERIOD_S)


def _from_file(name: str, folder: Path) -> Trajectory:
    path = folder / Path(name).expanduser()
    if path.suffix.lower() not in (".csv", ".json", ".yaml", ".yml"):
        raise InvalidTrajectoryError(
            f'follow "{name}": neither a shape ({", ".join(SHAPES)}) nor a file that ends with .csv, .yaml or .json',
            value=name,
        )
    return load_trajectory(path)
