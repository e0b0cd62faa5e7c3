"""What a scenario file may say, section by section."""

from __future__ import annotations

from typing import Literal

from pydantic import field_validator

from navstack.core.parameters import ParamModel, param
from navstack.scenario.success import RENAMED, not_an_end
from navstack.sim.shapes import DoorMotion, OnTrack, PedestrianMotion, Still


class Settings(ParamModel):
    """The plain values of a scenario file; its other keys are sections of their own."""

    name: str = param("", "what the scenario is called in tables; the file's name if left out")
    description: str = param("", "what it shows, in a sentence or two")
    distro: Literal["noetic", "indigo"] | None = param(None, "whose scoring scale; what the parameters say if left out")
    allow_missing: bool = param(False, "layers and plugins that are not here are left out instead of refused")
    seed: int = param(0, "of all noise; the same seed gives the same run", ge=0, le=2**63 - 1)
    time_limit: float = param(600.0, "simulated time a goal may take; then it is cancelled", unit="s", gt=0.0, le=1e6)
    rest: float = param(0.0, "simulated time that the robot stands between two goals", unit="s", ge=0.0, le=1e6)
    stop_on_failure: bool = param(False, "the goals that follow one that did not SUCCEED are left out")


class Tour(ParamModel):
    """`tour:` places to visit, by name."""

    places: list[str] | None = param(None, "names of places, in order; all places of the map if left out")
    order: Literal["given", "sorted", "random"] = param("given", "as given, by name, or shuffled by the seed")
    loops: int = param(1, "how often the tour is driven", ge=1, le=1000)


class Success(ParamModel):
    """`success:` conditions that the run must meet."""

    RENAMED = RENAMED

    goals: str | list[str] = param(
        "SUCCEEDED", "the state in which every goal must end, or one for each goal in turn; any: whichever"
    )
    max_collisions: int | None = param(0, "maximum number of collisions with obstacles; null (~): no limit", ge=0)
    max_time: float | None = param(None, "simulated time of the whole run", unit="s", gt=0.0)
    min_clearance: float | None = param(
        None, "least distance between the robot's outline and an obstacle", unit="m", ge=0.0
    )
    max_length: float | None = param(None, "length of the way driven", unit="m", gt=0.0)
    max_recoveries: int | None = param(None, "recovery behaviours run", ge=0)

    @field_validator("goals")
    @classmethod
    def _states(cls, value: str | list[str]) -> str | list[str]:
        for state in [value] if isinstance(value, str) else value:
            wrong = not_an_end(state)
            if wrong:
                raise ValueError(wrong)
        return value


MOTIONS: dict[str, type[ParamModel]] = {
    "still": Still,
    "track": OnTrack,
    "door": DoorMotion,
    "pedestrian": PedestrianMotion,
}
"""`kind` of a shape's motion -> its model."""
