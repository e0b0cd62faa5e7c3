"""Steps of a scenario: those of `navstack.behaviors`, and `cover`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from navstack import behaviors
from navstack.core import Pose2D, WheelDrive
from navstack.coverage import CoverStep, cover_step_data, read_cover_step
from navstack.parameters import MotionParams
from navstack.plugins import Behavior

Step = behaviors.Step | CoverStep


def is_step(keys: Any) -> bool:
    """Return True for the keys of a mapping that is a step."""
    return "cover" in keys or behaviors.is_step(keys)


def read_step(
    values: Mapping[str, Any], *, places: Mapping[str, Pose2D] | None = None, folder: Path | None = Path()
) -> Step:
    """Return the step of a mapping, see `navstack.behaviors.read_step`. Raises InputError."""
    if "cover" in values:
        return read_cover_step(values, folder=folder)
    return behaviors.read_step(values, places=places, folder=folder)


def step_data(step: Step) -> dict[str, Any]:
    """Return a step as JSON data, which `read_step` reads."""
    return cover_step_data(step) if isinstance(step, CoverStep) else behaviors.step_data(step)


def step_text(step: Step) -> str:
    """Return a step in a few words."""
    return step.text if isinstance(step, CoverStep) else behaviors.step_text(step)


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
    return behaviors.motion_of(
        step, params, turning_radius=turning_radius, drive=drive, max_wheel_speed=max_wheel_speed
    )
