"""Parameters of the wheels of the simulated robot: `navstack: sim: wheels:`."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import field_validator

from navstack.core.parameters import ParamModel, param

MAX_WHEELS = 4


class WheelParams(ParamModel):
    """The wheels of the base: their limits, their encoders, and the odometry made of them.

    Without `drive`, the base has no wheels of its own: it executes velocities, and its odometry is continuous. The defaults are
    those of a Kobuki.
    """

    drive: Literal["none", "differential", "omni", "mecanum"] = param(
        "none",
        "none: no wheels; differential: two on one axle (kinematics: differential); omni: on a circle; mecanum: four with "
        "rollers at 45 degrees (both with kinematics: holonomic)",
    )
    separation: float = param(0.23, "differential, mecanum: distance between left and right wheels", unit="m", gt=0.0)
    wheelbase: float = param(0.3, "mecanum: distance between the axles", unit="m", gt=0.0)
    circle_radius: float = param(0.15, "omni: radius of the circle on which the wheels are", unit="m", gt=0.0)
    angles: list[float] = param(
        [1.0471975511965976, 3.141592653589793, -1.0471975511965976],
        "omni: positions of the 3 or 4 wheels on that circle, from straight ahead",
        unit="rad",
    )
    radius: float = param(0.035, "radius of the wheels", unit="m", gt=0.0)
    max_speed: float | None = param(
        None,
        "maximum speed of a wheel; a faster command is slowed down on its arc; none: unlimited",
        unit="rad/s",
        gt=0.0,
    )
    max_acceleration: float | None = param(
        None, "maximum acceleration of each wheel; none: unlimited", unit="rad/s²", gt=0.0
    )
    ticks_per_revolution: float | None = param(
        None, "counts of the encoders per revolution (Kobuki: 2578.33); none: continuous", gt=0.0, le=1e9
    )
    integration: Literal["exact", "rk2", "euler"] = param(
        "exact",
        "how the odometry integrates: along the arc, the heading at half of the step, or the heading at its start",
    )
    radius_errors: list[float] = param(
        [], "relative error of the true radius of each wheel (left, right; or in the order of the drive); none: 0"
    )

    @field_validator("angles")
    @classmethod
    def _check_angles(cls, value: list[float]) -> list[float]:
        distinct = {round(math.remainder(angle, 2.0 * math.pi), 9) for angle in value}
        if not 3 <= len(value) <= MAX_WHEELS or len(distinct) < len(value):
            raise ValueError(f"angles = {value} must be 3 or 4 different positions of omni wheels")
        return value

    @field_validator("radius_errors")
    @classmethod
    def _check_errors(cls, value: list[float]) -> list[float]:
        if len(value) > MAX_WHEELS or any(abs(error) > 0.5 for error in value):
            raise ValueError(f"radius_errors = {value} must be at most {MAX_WHEELS} numbers from -0.5 to 0.5")
        return value

    @property
    def count(self) -> int:
        """Number of wheels."""
        return {"none": 0, "differential": 2, "omni": len(self.angles), "mecanum": 4}[self.drive]

    @property
    def metres_per_tick(self) -> float:
        """Way of the rim per count of the encoder (m); 0 for continuous encoders."""
        ticks = self.ticks_per_revolution
        return 0.0 if ticks is None else 2.0 * math.pi * self.radius / ticks
