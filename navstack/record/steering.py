"""The steered base of a record: what a drawing of its wheels needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import short_repr
from navstack.parameters import SimParams


@dataclass(frozen=True, slots=True)
class SteeredBase:
    """A base with a steering angle, whose frame is at the center of its rear axle."""

    kinematics: str
    """`ackermann` or `tricycle`."""
    wheelbase: float
    """From the rear axle to the front wheels (m)."""
    max_angle: float
    """Maximum steering angle (rad)."""
    max_rate: float | None
    """Maximum rate of the steering angle (rad/s); None: unlimited."""

    @classmethod
    def of(cls, sim: SimParams) -> SteeredBase | None:
        """Returns that of a simulated robot; None if it is not steered."""
        if not sim.is_steered:
            return None
        return cls(sim.kinematics, sim.wheelbase, sim.steering_limit, sim.max_steering_rate)

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
        return {
            "kinematics": self.kinematics,
            "wheelbase": self.wheelbase,
            "max_angle": self.max_angle,
            "max_rate": self.max_rate,
        }

    def asked(self, commands: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns (n,) the steering angles (rad) that commands (n, 3) vx, vy, wz ask for; NaN for those that do not drive."""
        vx, wz = commands[:, 0], commands[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(np.abs(vx) > 1e-6, np.arctan(self.wheelbase * wz / vx), np.nan)

    def radius(self, angle: float) -> float:
        """Returns the radius (m) of the circle of the rear axle at a steering angle (rad), inf straight ahead."""
        return self.wheelbase / math.tan(angle) if angle != 0.0 else math.inf

    def wheels(self, width: float, angle: float) -> list[tuple[float, float, float]]:
        """Returns position (m) and direction (rad) of the wheels in the base frame; `width` (m) is that of the body.

        The track is 0.8 of the width. The directions of a car's front wheels meet on the rear axle (Ackermann).
        """
        half = 0.4 * width
        rear = [(0.0, half, 0.0), (0.0, -half, 0.0)]
        if self.kinematics == "tricycle":
            return [*rear, (self.wheelbase, 0.0, angle)]
        curvature = math.tan(angle) / self.wheelbase
        directions = [math.atan(self.wheelbase * curvature / (1.0 - side * half * curvature)) for side in (1.0, -1.0)]
        return [*rear, (self.wheelbase, half, directions[0]), (self.wheelbase, -half, directions[1])]


def steered_base_of(meta: dict[str, Any]) -> SteeredBase | None:
    """Returns the steered base of a record's meta; None without one."""
    found = meta.get("steering")
    return None if found is None else SteeredBase(**found)


def check_steering(meta: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
    """Raises ValueError unless `steering` has one angle per sample and a base."""
    found, angles = meta.get("steering"), arrays.get("steering")
    if (found is None) != (angles is None):
        raise ValueError("steering needs both its base and its angles")
    if found is None or angles is None:
        return
    if angles.dtype != np.dtype("<f8") or angles.shape != (len(arrays["samples"]),):
        raise ValueError("steering does not have one angle per sample")
    kinds = {"kinematics": str, "wheelbase": float, "max_angle": float, "max_rate": (float, type(None))}
    if not isinstance(found, dict) or set(found) != set(kinds):
        raise ValueError(f"the base of steering is {short_repr(found)}")
    for key, kind in kinds.items():
        value = found[key]
        if not isinstance(value, kind) or (isinstance(value, float) and not (math.isfinite(value) and value > 0.0)):
            raise ValueError(f"{key} of the base of steering is {short_repr(value)}")
