"""Models of the sections of a scenario file, and its contents after reading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import field_validator

from navstack.core import OccupancyGrid, Pose2D
from navstack.core.parameters import ParamModel, param
from navstack.motion.steps import Step
from navstack.parameters.findings import Location
from navstack.parameters.sources import Source
from navstack.scenario.success import RENAMED, SuccessConditions, state_error
from navstack.sim.shapes import DoorMotion, OnTrack, PedestrianMotion, Shape, Still


class Settings(ParamModel):
    """The scalar values of a scenario file; the other keys are sections."""

    RENAMED: ClassVar[Mapping[str, str]] = {"rest": "pause"}

    name: str = param("", "name of the scenario in tables; default: the name of the file")
    description: str = param("", "what the scenario shows, in one or two sentences")
    distro: Literal["noetic", "indigo"] | None = param(
        None, "ROS release whose DWA cost scaling is used; default: as the parameters say"
    )
    allow_missing: bool = param(False, "omit layers and plugins that are not installed instead of rejecting the file")
    seed: int = param(0, "random seed of all noise; the same seed gives the same run", ge=0, le=2**63 - 1)
    time_limit: float = param(
        600.0, "simulated time allowed per goal; the goal is then cancelled", unit="s", gt=0.0, le=1e6
    )
    pause: float = param(0.0, "simulated time the robot waits between two goals", unit="s", ge=0.0, le=1e6)
    stop_on_failure: bool = param(False, "skip the remaining goals after the first one that does not succeed")


class Tour(ParamModel):
    """`tour:` places to visit, by name."""

    places: list[str] | None = param(None, "names of places, in order; default: all places of the map")
    order: Literal["given", "sorted", "random"] = param("given", "as listed, by name, or shuffled with the seed")
    loops: int = param(1, "number of repetitions of the tour", ge=1, le=1000)


class Success(ParamModel):
    """`success:` conditions that the run must meet."""

    RENAMED = RENAMED

    goals: str | list[str] = param(
        "SUCCEEDED", "terminal state required of every goal, or one state per goal; any: every state is accepted"
    )
    max_collisions: int | None = param(0, "maximum number of collisions with obstacles; null (~): no limit", ge=0)
    max_time: float | None = param(None, "maximum simulated time of the whole run", unit="s", gt=0.0)
    min_clearance: float | None = param(
        None, "minimum distance between the unpadded footprint and an obstacle", unit="m", ge=0.0
    )
    max_length: float | None = param(None, "maximum distance driven", unit="m", gt=0.0)
    max_recoveries: int | None = param(None, "maximum number of recovery behaviors run", ge=0)

    @field_validator("goals")
    @classmethod
    def _states(cls, value: str | list[str]) -> str | list[str]:
        for state in [value] if isinstance(value, str) else value:
            error = state_error(state)
            if error:
                raise ValueError(error)
        return value

    def conditions(self) -> SuccessConditions:
        """Returns the conditions in the form that a run evaluates."""
        return SuccessConditions(
            goals=self.goals if isinstance(self.goals, str) else tuple(self.goals),
            max_collisions=self.max_collisions,
            max_time_s=self.max_time,
            min_clearance_m=self.min_clearance,
            max_length_m=self.max_length,
            max_recoveries=self.max_recoveries,
        )


MOTIONS: dict[str, type[ParamModel]] = {
    "still": Still,
    "track": OnTrack,
    "door": DoorMotion,
    "pedestrian": PedestrianMotion,
}
"""`kind` of a shape's motion -> its model."""


@dataclass(slots=True)
class Parts:
    """The contents of a scenario file, as far as they could be read."""

    settings: Settings = field(default_factory=Settings)
    map_file: Path | None = None
    grid: OccupancyGrid | None = None
    """The map itself, if it does not come from a file."""
    sources: list[Source] = field(default_factory=list[Source])
    """Parameter sources: `params:`."""
    overlays: list[Source] = field(default_factory=list[Source])
    """Parameters that override the sources: `set:`, then `sim:`."""
    start: Pose2D | None = None
    start_location: Location = Location("")
    goals: tuple[Pose2D, ...] = ()
    steps: tuple[Step, ...] = ()
    """Goals and motions, if there are motions among the goals."""
    goal_names: tuple[str, ...] = ()
    goal_locations: tuple[Location, ...] = ()
    tour: Tour | None = None
    tour_names: tuple[str, ...] = ()
    """Places of the tour as listed; `tour` has the order in which they are visited."""
    places: Mapping[str, Pose2D] = field(default_factory=dict[str, Pose2D])
    shapes: tuple[Shape, ...] = ()
    interactions: tuple[Any, ...] = ()
    """Models of `navstack.scenario.interactions`."""
    success: Success = field(default_factory=Success)
