"""Steps of a scenario: those of `navstack.behaviors`, and tasks of other packages: {dock: home}, {undock: true}, {cover: all}."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError, field_validator

from navstack import behaviors
from navstack.behaviors import InvalidMotionError
from navstack.core import Pose2D, WheelDrive, short_repr
from navstack.coverage import CoverStep, cover_step_data, read_cover_step
from navstack.parameters import MotionParams
from navstack.plugins import Behavior, ParamModel, param


class DockStep(ParamModel):
    """Dock."""

    dock: str = param(..., "name of the dock")
    navigate_to_staging_pose: bool = param(True, "drive to the staging pose first, if the robot is not near it")
    until_charge: float | None = param(
        None, "stay until the battery has this share of its capacity; none: until it is charged at all", gt=0.0, le=1.0
    )


class UndockStep(ParamModel):
    """Drive out of the dock."""

    undock: str = param("", "type of the dock; `true`: that of the nearest one")
    max_undocking_time: float = param(30.0, "time limit", unit="s", gt=0.0)

    @field_validator("undock", mode="before")
    @classmethod
    def _any_type(cls, value: Any) -> Any:
        return "" if value is True or value is None else value


Step = behaviors.Step | DockStep | UndockStep | CoverStep
_TASKS: Final[dict[str, type[ParamModel]]] = {"dock": DockStep, "undock": UndockStep, "cover": CoverStep}
EXAMPLES: Final = f"{behaviors.EXAMPLES}, {{dock: NAME}}, {{undock: true}}, {{cover: all}}"


def is_step(keys: Any) -> bool:
    """Return True for the keys of a mapping that is a step."""
    return behaviors.is_step(keys) or any(kind in keys for kind in _TASKS)


def read_step(
    values: Mapping[str, Any], *, places: Mapping[str, Pose2D] | None = None, folder: Path | None = Path()
) -> Step:
    """Return the step of a mapping; arguments and errors as of `navstack.behaviors.read_step`."""
    kinds = [kind for kind in _TASKS if kind in values]
    if not is_step(values):
        raise InvalidMotionError(f"{short_repr(dict(values))} is not one step; steps are {EXAMPLES}")
    if not kinds:
        return behaviors.read_step(values, places=places, folder=folder)
    if len(kinds) > 1 or behaviors.is_step(values):
        raise InvalidMotionError(f"{short_repr(dict(values))} is not one step; steps are {EXAMPLES}")
    kind = kinds[0]
    if kind == "cover":
        return read_cover_step(values, folder=folder)
    try:
        step: Any = _TASKS[kind].model_validate(dict(values))
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in error["loc"]) or kind
        known = f"known keys: {', '.join(_TASKS[kind].model_fields)}"
        what = known if error["type"] == "extra_forbidden" else error["msg"]
        raise InvalidMotionError(f"{where} of the step {kind} is {short_repr(error['input'])}: {what}") from None
    return step


def step_data(step: Step) -> dict[str, Any]:
    """Return a step as JSON data, which `read_step` reads."""
    if isinstance(step, UndockStep):
        return {**step.model_dump(mode="json", exclude_defaults=True), "undock": step.undock or True}
    if isinstance(step, DockStep):
        return step.model_dump(mode="json", exclude_defaults=True)
    return cover_step_data(step) if isinstance(step, CoverStep) else behaviors.step_data(step)


def step_text(step: Step) -> str:
    """Return a step in a few words."""
    if isinstance(step, DockStep):
        return f"dock at {step.dock}"
    if isinstance(step, CoverStep):
        return step.text
    return "undock" if isinstance(step, UndockStep) else behaviors.step_text(step)


def motion_of(
    step: Step,
    params: MotionParams,
    *,
    turning_radius: float = 0.0,
    drive: WheelDrive | None = None,
    max_wheel_speed: float = math.inf,
) -> Behavior:
    """Return the motion of a step, see `navstack.behaviors.motion_of`. Raises InputError for one that the base cannot do."""
    if isinstance(step, CoverStep):
        return step.motion(params, turning_radius=turning_radius)
    if isinstance(step, (DockStep, UndockStep)):
        raise InvalidMotionError(f"{step_text(step)} is a task of several motions; give it to the goals of a scenario")
    return behaviors.motion_of(
        step, params, turning_radius=turning_radius, drive=drive, max_wheel_speed=max_wheel_speed
    )
