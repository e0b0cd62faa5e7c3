"""A scenario: map, parameters, start, goals, obstacles, seed and success conditions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

from navstack import __version__
from navstack.core import OccupancyGrid, Pose2D
from navstack.core.bounded_reading import shortened
from navstack.core.errors import RecordError
from navstack.motion import InvalidMotionError
from navstack.motion.steps import GoToStep, Step, read_step, step_data
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.record import Record
from navstack.scenario.interactions import INTERACTION, as_data
from navstack.scenario.record_schema import scenario_problem
from navstack.scenario.success import SuccessConditions
from navstack.sim import Shape, World


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that determines a run. Poses are in the map frame, obstacles are (x, y, radius); metres and radians.

    Scenarios are picklable (about 50 kB plus the map's cells). `dataclasses.replace(scenario, seed=7)` changes the seed
    or the parameters.
    """

    map: OccupancyGrid
    configuration: Configuration
    start: Pose2D
    goals: tuple[Pose2D, ...]
    obstacles: tuple[tuple[float, float, float], ...] = ()
    seed: int = 0
    time_limit_s: float = 600.0
    """Simulated seconds allowed per goal; the goal is then cancelled."""
    pause_s: float = 0.0
    """Simulated seconds the robot waits between two goals."""
    stop_on_failure: bool = False
    """Skip the remaining goals after the first one that does not succeed."""
    shapes: tuple[Shape, ...] = ()
    """Further obstacles: low objects, boxes, walls, doors, pedestrians, discs on tracks."""
    steps: tuple[Step, ...] = ()
    """Goals and motions in order, instead of `goals`: see `navstack.motion.steps`."""
    interactions: tuple[Any, ...] = ()
    """What a person does during the run, models of `navstack.scenario.interactions`."""
    success: SuccessConditions = SuccessConditions()
    """Conditions that the run must meet; they do not influence the run."""
    name: str = ""
    names: dict[str, Any] = field(default_factory=dict[str, Any])
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
        return {
            **self.names,
            "ros_distro": self.configuration.navstack.ros_distro,
            "start": list(self.start),
            "goals": [list(goal) for goal in self.goals],
            "obstacles": [list(obstacle) for obstacle in self.obstacles],
            "seed": self.seed,
            "time_limit_s": self.time_limit_s,
            "pause_s": self.pause_s,
            "stop_on_failure": self.stop_on_failure,
            **self._optional_entries(),
            "navstack": __version__,
            "parameters": _encode_floats(self.configuration.tree.as_dict()),
        }

    def _optional_entries(self) -> dict[str, Any]:
        """Returns the entries that are omitted when they have their defaults."""
        entries: dict[str, Any] = {}
        if self.name:
            entries["name"] = self.name
        if self.shapes:
            entries["shapes"] = [shape.model_dump(mode="json", exclude_none=True) for shape in self.shapes]
        if self.steps:
            entries["steps"] = [step_data(step) for step in self.steps]
        if self.interactions:
            entries["interactions"] = [_encode_floats(as_data(item)) for item in self.interactions]
        if self.success != SuccessConditions():
            entries["success"] = self.success.as_dict()
        return entries

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
        problem = scenario_problem(stored)
        if problem is not None:
            raise RecordError(
                f"the scenario of {record.path or 'the record'} is damaged: {problem}; record the run again"
            )
        try:
            return cls(
                map=record.map,
                configuration=load_configuration(
                    [dict(_decode_floats(stored["parameters"]))], distro=stored["ros_distro"]
                ),
                start=Pose2D(*stored["start"]),
                goals=tuple(Pose2D(*goal) for goal in stored["goals"]),
                obstacles=tuple((x, y, r) for x, y, r in stored["obstacles"]),
                seed=stored["seed"],
                time_limit_s=stored["time_limit_s"],
                pause_s=stored.get("pause_s", stored.get("rest_s", 0.0)),
                stop_on_failure=stored.get("stop_on_failure", False),
                shapes=tuple(Shape.model_validate(shape) for shape in stored.get("shapes", ())),
                steps=tuple(read_step(step, folder=None) for step in stored.get("steps", ())),
                interactions=tuple(
                    INTERACTION.validate_python(_decode_floats(item)) for item in stored.get("interactions", ())
                ),
                success=SuccessConditions.from_dict(stored.get("success", {})),
                name=stored.get("name", ""),
                names={key: value for key, value in stored.items() if key not in (*_REQUIRED, *_OPTIONAL)},
            )
        except (TypeError, ValueError, InvalidMotionError) as exc:
            reason = shortened(" ".join(str(exc).split()), 200)
            raise RecordError(
                f"the scenario of {record.path or 'the record'} is damaged ({reason}); record the run again"
            ) from exc


_REQUIRED: Final = ("ros_distro", "start", "goals", "obstacles", "seed", "time_limit_s", "parameters")
_OPTIONAL: Final = (
    "pause_s",
    "rest_s",
    "stop_on_failure",
    "shapes",
    "steps",
    "interactions",
    "success",
    "name",
    "navstack",
)
"""`rest_s`: name of `pause_s` in records of earlier versions."""
_NOT_FINITE: Final = {".inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}


def _encode_floats(value: Any) -> Any:
    """Replaces non-finite floats, which JSON does not have, by their YAML spelling."""
    if isinstance(value, dict):
        return {key: _encode_floats(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_encode_floats(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0.0 else "-.inf"
    return value


def _decode_floats(value: Any) -> Any:
    """Inverts `_encode_floats`."""
    if isinstance(value, dict):
        return {key: _decode_floats(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_decode_floats(v) for v in value]
    return _NOT_FINITE.get(value, value) if isinstance(value, str) else value
