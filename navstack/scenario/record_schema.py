"""The scenario that a record contains: types and ranges, checked before it is built. A record may have been forged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from navstack.core.bounded_reading import short_repr

MAX_GOALS: Final = 100_000
MAX_OBSTACLES: Final = 10_000
MAX_SHAPES: Final = 2_000
MAX_INTERACTIONS: Final = 1_000_000
MAX_PEDESTRIANS: Final = 500
"""Every pedestrian is compared with every other one in each physics step."""

_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
_Pose = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_Disc = Annotated[list[_Number], Field(min_length=3, max_length=3)]


class StoredScenario(BaseModel):
    """The entries of a stored scenario that determine the run; other entries are names for messages."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)

    ros_distro: Literal["noetic", "indigo"]
    start: _Pose
    goals: Annotated[list[_Pose], Field(max_length=MAX_GOALS)]
    obstacles: Annotated[list[_Disc], Field(max_length=MAX_OBSTACLES)]
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    time_limit_s: Annotated[float, Field(gt=0.0, le=1e6)]
    pause_s: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    rest_s: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    stop_on_failure: bool = False
    shapes: Annotated[list[dict[str, Any]], Field(max_length=MAX_SHAPES)] = []
    steps: Annotated[list[dict[str, Any]], Field(max_length=MAX_GOALS)] = []
    interactions: Annotated[list[dict[str, Any]], Field(max_length=MAX_INTERACTIONS)] = []
    success: dict[str, Any] = {}
    name: str = ""
    parameters: dict[str, Any]


def scenario_problem(stored: Mapping[str, Any]) -> str | None:
    """Returns what is wrong with a stored scenario, in one line; None if nothing is."""
    try:
        scenario = StoredScenario.model_validate(dict(stored))
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(step) for step in error["loc"])
        value = "" if error["type"] in ("too_long", "missing") else f" ({short_repr(error['input'])})"
        return f"{where}{value}: {error['msg']}"
    return too_many_pedestrians(sum(_walks(shape) for shape in scenario.shapes))


def too_many_pedestrians(count: int) -> str | None:
    """Returns the message for more pedestrians than the simulator handles."""
    return f"{count} pedestrians; the simulator handles {MAX_PEDESTRIANS}" if count > MAX_PEDESTRIANS else None


def _walks(shape: Mapping[str, Any]) -> bool:
    motion = shape.get("motion")
    return isinstance(motion, dict) and motion.get("kind") == "pedestrian"
