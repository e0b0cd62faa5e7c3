"""A scenario: map, parameters, start, goals, obstacles, seed and success conditions.

`Scenario` is the only description of a run. Python builds it directly; a record stores its fields as JSON (`as_dict`) and
restores them by their types (`from_record`); a file sets them by their keys (`navstack.scenario.file_reader`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, TypeAdapter, ValidationError

from navstack import __version__
from navstack.behaviors import GoToStep, InvalidMotionError
from navstack.core import OccupancyGrid, Pose2D, RecordError, short_repr, shortened
from navstack.parameters import Configuration, load_configuration
from navstack.record import Record
from navstack.scenario.fields import (
    Disc,
    NotStored,
    Pose,
    Stored,
    decode_floats,
    described,
    encode_floats,
)
from navstack.scenario.interactions import Interaction, as_data
from navstack.scenario.steps import Step, read_step, step_data
from navstack.scenario.success import SuccessConditions
from navstack.sim import PedestrianMotion, Shape, World

MAX_GOALS: Final = 100_000
MAX_OBSTACLES: Final = 10_000
MAX_SHAPES: Final = 2_000
MAX_INTERACTIONS: Final = 1_000_000
MAX_PEDESTRIANS: Final = 500
"""Every pedestrian is compared with every other one in each physics step."""


def _shape_data(shape: Shape) -> dict[str, Any]:
    return shape.model_dump(mode="json", exclude_none=True)


_Shape = Annotated[Shape, PlainSerializer(_shape_data)]
_Step = Annotated[Step, Stored(dict[str, Any], lambda data: read_step(data, folder=None), step_data)]
_Interaction = Annotated[
    Interaction, BeforeValidator(decode_floats), PlainSerializer(lambda item: encode_floats(as_data(item)))
]
_Conditions = Annotated[
    SuccessConditions, Stored(dict[str, Any], SuccessConditions.from_dict, SuccessConditions.as_dict)
]


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that determines a run. Poses are in the map frame, obstacles are (x, y, radius); meters and radians.

    Scenarios are picklable (about 50 kB plus the map's cells). `dataclasses.replace(scenario, seed=7)` changes the seed
    or the parameters.
    """

    map: Annotated[OccupancyGrid, NotStored()]
    configuration: Annotated[Configuration, NotStored()]
    start: Pose
    goals: Annotated[tuple[Pose, ...], Field(max_length=MAX_GOALS)]
    obstacles: Annotated[tuple[Disc, ...], Field(max_length=MAX_OBSTACLES)] = ()
    seed: Annotated[
        int,
        described("random seed of all noise; the same seed gives the same run", ge=0, le=2**63 - 1),
        Field(strict=True),
    ] = 0
    time_limit_s: Annotated[
        float,
        described("simulated time allowed per goal; the goal is then canceled", unit="s", gt=0.0, le=1e6),
        Field(strict=True, allow_inf_nan=False),
    ] = 600.0
    pause_s: Annotated[
        float,
        described("simulated time the robot waits between two goals", unit="s", ge=0.0, le=1e6),
        Field(strict=True, allow_inf_nan=False),
    ] = 0.0
    stop_on_failure: Annotated[
        bool, described("skip the remaining goals after the first one that does not succeed"), Field(strict=True)
    ] = False
    name: Annotated[str, described("name of the scenario in tables; default: the name of the file")] = ""
    shapes: Annotated[tuple[_Shape, ...], Field(max_length=MAX_SHAPES)] = ()
    """Further obstacles: low objects, boxes, walls, doors, pedestrians, discs on tracks."""
    steps: Annotated[tuple[_Step, ...], Field(max_length=MAX_GOALS)] = ()
    """Goals and motions in order, instead of `goals`: see `navstack.motion.steps`."""
    interactions: Annotated[tuple[_Interaction, ...], Field(max_length=MAX_INTERACTIONS)] = ()
    """What a person does during the run, models of `navstack.scenario.interactions`."""
    success: _Conditions = SuccessConditions()
    """Conditions that the run must meet; they do not influence the run."""
    names: Annotated[dict[str, Any], NotStored()] = field(default_factory=dict[str, Any])
    """Names of the map and the parameter sources, for the record."""

    @property
    def items(self) -> tuple[Pose2D | Step, ...]:
        """What the robot does, in order: goals, or the steps."""
        return tuple(step.pose if isinstance(step, GoToStep) else step for step in self.steps) or self.goals

    def world(self) -> World:
        """Returns the map with all obstacles."""
        return World(self.map, self.obstacles, shapes=self.shapes)

    def as_dict(self) -> dict[str, Any]:
        """Returns the scenario as JSON data for the record; with the map, `from_record` restores it from this."""
        written = _stored().dump_python(self, exclude=_NOT_STORED, warnings=False)
        omitted = {f.name for f in fields(self) if f.name in _OMITTED and getattr(self, f.name) == f.default}
        return {
            **self.names,
            "ros_distro": self.configuration.navstack.ros_distro,
            **{k: list(v) if isinstance(v, tuple) else v for k, v in written.items() if k not in omitted},
            "navstack": __version__,
            "parameters": encode_floats(self.configuration.tree.as_dict()),
        }

    @classmethod
    def from_record(cls, record: Record) -> Scenario:
        """Restores the scenario of a record, with the parameters it was recorded with.

        Raises RecordError for records without a complete scenario, ParameterError for parameters that this version
        rejects.
        """
        stored = record.scenario
        missing = [key for key in _REQUIRED if key not in stored]
        if record.map is None:
            missing.append("map")
        if missing or record.map is None:
            raise RecordError(
                f"{record.path or 'the record'} cannot be run again ({', '.join(missing)} missing): an older navstack or "
                "another program wrote it; record the run again",
                missing=missing,
            )
        known = {f.name for f in fields(cls)} - _NOT_STORED
        values = {key: stored[key] for key in known if key in stored}
        if "rest_s" in stored:  # the name of `pause_s` in records of earlier versions
            values.setdefault("pause_s", stored["rest_s"])
        others = known | {*_REQUIRED, "rest_s", "navstack"}
        values["names"] = {key: value for key, value in stored.items() if key not in others}
        try:
            parameters = _StoredParameters.model_validate({key: stored[key] for key in _StoredParameters.model_fields})
            # a record may have been forged: the whole scenario is checked before its parameters are loaded
            scenario = _stored().validate_python({**values, "map": record.map, "configuration": None})
            problem = too_many_pedestrians(sum(isinstance(shape.motion, PedestrianMotion) for shape in scenario.shapes))
            if problem is not None:
                raise ValueError(problem)
        except (TypeError, ValueError, InvalidMotionError) as exc:
            reason = _first_problem(exc) if isinstance(exc, ValidationError) else " ".join(str(exc).split())
            raise RecordError(
                f"the scenario of {record.path or 'the record'} is damaged: {shortened(reason, 200)}; record the run again"
            ) from exc
        sources = [dict(decode_floats(parameters.parameters))]
        return replace(scenario, configuration=load_configuration(sources, distro=parameters.ros_distro))

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        return f"Scenario({name}{len(self.items)} goals, {len(self.shapes) + len(self.obstacles)} obstacles, seed {self.seed})"


_NOT_STORED: Final = {"map", "configuration", "names"}
_REQUIRED: Final = ("ros_distro", "start", "goals", "obstacles", "seed", "time_limit_s", "parameters")
_OMITTED: Final = ("name", "shapes", "steps", "interactions", "success")
"""Fields that a record has only where they differ from their defaults."""


class _StoredParameters(BaseModel):
    """The parameters of a stored scenario, from which its configuration is loaded."""

    model_config = ConfigDict(strict=True)

    ros_distro: Literal["noetic", "indigo"]
    parameters: dict[str, Any]


@cache
def _stored() -> TypeAdapter[Scenario]:
    """Return what reads and writes the fields of a scenario in a record."""
    return TypeAdapter(Scenario)


def _first_problem(exc: ValidationError) -> str:
    error = exc.errors(include_url=False, include_context=False)[0]
    where = ".".join(str(step) for step in error["loc"])
    value = "" if error["type"] in ("too_long", "missing") else f" ({short_repr(error['input'])})"
    return f"{where}{value}: {error['msg']}"


def too_many_pedestrians(count: int) -> str | None:
    """Returns the message for more pedestrians than the simulator handles."""
    return f"{count} pedestrians; the simulator handles {MAX_PEDESTRIANS}" if count > MAX_PEDESTRIANS else None
