"""What a person does during a run: goals, obstacles, parameters, driving by hand. Each has its time and is part of the scenario.

Scenario files and records contain these models: `INTERACTION.validate_python` reads what `model_dump(mode="json")` writes.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, model_validator

from navstack.core import Pose2D, normalize_angle
from navstack.plugins import ParamModel, param
from navstack.scenario.fields import Stored
from navstack.scenario.steps import Step, read_step, step_data
from navstack.sim import Shape

MAX_GOALS = 1000
"""Longest queue of goals."""

Number = Annotated[float, Field(ge=-1e9, le=1e9)]
PoseList = Annotated[list[Number], Field(min_length=2, max_length=3)]
"""[x, y, yaw] or [x, y], m and rad."""


def pose_from(values: list[float]) -> Pose2D:
    """Returns the pose of [x, y, yaw] or [x, y]."""
    return Pose2D(values[0], values[1], normalize_angle(values[2]) if len(values) == 3 else 0.0)


class _Interaction(ParamModel):
    time: float = param(..., "simulated time; it takes effect at the next control cycle", unit="s", ge=0.0, le=1e7)


class GoTo(_Interaction):
    """A goal that replaces the current one at once; the queue remains."""

    kind: Literal["goal"] = param("goal", "drive to this pose now")
    pose: PoseList = param(..., "[x, y, yaw] or [x, y] in the map", unit="m, rad")


class Queue(_Interaction):
    """The goals after the current one."""

    kind: Literal["queue"] = param("queue", "replace the queue of goals")
    goals: Annotated[list[PoseList], Field(max_length=MAX_GOALS)] = param(
        ..., "poses, in order; none: empty the queue", unit="m, rad"
    )
    loop: bool = param(False, "append each goal again when the robot sets out for it")


class Cancel(_Interaction):
    """Cancels the current goal and empties the queue."""

    kind: Literal["cancel"] = param("cancel", "cancel the goal and the queue")


class PutShape(_Interaction):
    """Adds an obstacle, or moves the one of the same name."""

    kind: Literal["put"] = param("put", "add or move an obstacle")
    shape: Shape = param(..., "an obstacle with a name")

    @model_validator(mode="after")
    def _has_name(self) -> PutShape:
        if not self.shape.name:
            raise ValueError("the shape has no name; give it one, by which it can be moved and removed")
        return self


class RemoveShape(_Interaction):
    """Removes an obstacle."""

    kind: Literal["remove"] = param("remove", "remove an obstacle")
    name: str = param(..., "its name; without one: shape N or obstacle N, counted from 1")


class PlaceRobot(_Interaction):
    """Puts the robot somewhere and gives its localization the pose, as RViz's 2D Pose Estimate; both costmaps are cleared."""

    kind: Literal["place"] = param("place", "put the robot somewhere")
    pose: PoseList = param(..., "[x, y, yaw] or [x, y] in the map", unit="m, rad")


class Kidnap(_Interaction):
    """Puts the robot somewhere and leaves its localization at the previous pose."""

    kind: Literal["kidnap"] = param("kidnap", "carry the robot away")
    pose: PoseList = param(..., "[x, y, yaw] or [x, y] in the map", unit="m, rad")


class SetParameters(_Interaction):
    """Changes parameters that can change at run time."""

    kind: Literal["set"] = param("set", "change parameters")
    params: Annotated[list[str | dict[str, Any]], Field(max_length=20)] = param(
        [], "packaged sets or complete parameters that replace the current ones"
    )
    values: dict[str, Any] = param({}, "`NAME: VALUE`, for example `DWAPlannerROS/max_vel_x: 0.4`")

    @model_validator(mode="after")
    def _not_empty(self) -> SetParameters:
        if not self.params and not self.values:
            raise ValueError("nothing is set; give values: {NAME: VALUE}, or params: [NAME]")
        return self


class Drive(_Interaction):
    """Drives the robot by hand. The robot ignores its goal meanwhile; costmaps, goals and recoveries go on."""

    kind: Literal["drive"] = param("drive", "drive by hand")
    velocity: Annotated[list[Number], Field(min_length=3, max_length=3)] = param(
        ..., "[vx, vy, wz]; vy needs a holonomic robot", unit="m/s, rad/s"
    )
    until: float = param(..., "time at which the robot stops and follows its goal again", unit="s", ge=0.0, le=1e7)


class Teleop(_Interaction):
    """A command of a person's teleop, which passes the multiplexer and the collision monitor as every command does.

    Without a command multiplexer it is refused while a goal is active.
    """

    kind: Literal["teleop"] = param("teleop", "drive by teleop")
    velocity: Annotated[list[Number], Field(min_length=3, max_length=3)] = param(
        ..., "[vx, vy, wz]; vy needs a holonomic robot", unit="m/s, rad/s"
    )
    until: float = param(..., "time at which it stops, unless another command comes first", unit="s", ge=0.0, le=1e7)


class ClearCostmaps(_Interaction):
    """Resets every layer of both costmaps, as move_base's service clear_costmaps."""

    kind: Literal["clear_costmaps"] = param("clear_costmaps", "clear both costmaps")


class Edges(_Interaction):
    """Closes, opens and weights edges of the route graph in use; the route is planned again where that matters."""

    kind: Literal["edges"] = param("edges", "close, open or weight edges of the route graph")
    close: Annotated[list[int], Field(max_length=10_000)] = param([], "ids of edges to close")
    open: Annotated[list[int], Field(max_length=10_000)] = param([], "ids of edges to open again")
    costs: dict[int, float] = param({}, "cost by id that is added to an edge; 0 removes it")
    reroute: bool = param(False, "plan the route again in any case")


class StartStep(_Interaction):
    """Begins a step of a tour at once: a route, docking, coverage, a motion. What is under way is canceled; the queue remains."""

    kind: Literal["step"] = param("step", "begin a step now")
    step: Annotated[Step, Stored(dict[str, Any], lambda data: read_step(data, folder=None), step_data)] = param(
        ..., "a step with everything in it, such as `{dock: home}`"
    )


class Wait(_Interaction):
    """Lets the run go on without a goal."""

    kind: Literal["wait"] = param("wait", "go on without a goal")
    duration: float = param(..., "how long", unit="s", gt=0.0, le=1e6)


Interaction = Annotated[
    GoTo
    | Queue
    | Cancel
    | PutShape
    | RemoveShape
    | PlaceRobot
    | Kidnap
    | SetParameters
    | Drive
    | Teleop
    | ClearCostmaps
    | Edges
    | StartStep
    | Wait,
    Field(discriminator="kind"),
]
INTERACTION: TypeAdapter[Any] = TypeAdapter(Interaction)
"""Validates one interaction."""

KINDS = tuple(
    model.model_fields["kind"].default
    for model in (
        *(GoTo, Queue, Cancel, PutShape, RemoveShape),
        *(PlaceRobot, Kidnap, SetParameters, Drive, Teleop, ClearCostmaps, Edges, StartStep, Wait),
    )
)

EFFECT_S = 2.0
"""Without a goal, a run goes on for this simulated time after an interaction, so that its effect is seen (s)."""


def effect_ends(item: Any) -> float:
    """Returns the time until which a run goes on for this interaction (s)."""
    if isinstance(item, (Drive, Teleop)):
        return item.until + EFFECT_S
    return item.time + (item.duration if isinstance(item, Wait) else EFFECT_S)


def as_data(item: Any) -> dict[str, Any]:
    """Returns an interaction as JSON data."""
    data = item.model_dump(mode="json", exclude_none=True)
    return {"time": data.pop("time"), "kind": data.pop("kind"), **data}
