"""What a command asks of the steering of a car or a tricycle, and what the base has done of it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from navstack.core import Twist2D
from navstack.record import Record


@dataclass(frozen=True, slots=True)
class SteeringReport:
    """Steering of a base when a command was given."""

    kinematics: str
    angle: float
    """Steering angle at that time (rad)."""
    asked: float | None
    """Angle that the command asks for, not limited (rad); None if it does not drive, which leaves the wheel as it is."""
    max_angle: float
    """rad."""
    max_rate: float | None
    """rad/s."""
    turning_radius: float
    """Radius (m) of the tightest circle."""

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
        return asdict(self)


def steering_after(record: Record, time: float, command: Twist2D) -> SteeringReport | None:
    """Returns the steering at `time` (s), when `command` was given; None for a base that is not steered."""
    base = record.steered_base
    if base is None:
        return None
    asked = float(base.asked(np.array([command], np.float64))[0])
    return SteeringReport(
        base.kinematics,
        float(record.steering[record.index_at(time)]),
        None if math.isnan(asked) else asked,
        base.max_angle,
        base.max_rate,
        base.radius(base.max_angle),
    )


def steering_sentence(report: SteeringReport) -> str:
    """Returns the report in one sentence."""
    now = f"the wheel is at {report.angle:+.2f} rad"
    if report.asked is None:
        return f"steering ({report.kinematics}): {now} and stays there, for the command does not drive"
    # the angle that is asked for is a circle: wheelbase / tan = turning radius * tan(limit) / tan(angle)
    tangent = abs(math.tan(report.asked))
    wheelbase = report.turning_radius * math.tan(report.max_angle)
    circle = f"a radius of {wheelbase / tangent:.2f} m" if tangent > 1e-3 else "straight ahead"
    text = f"steering ({report.kinematics}): the command asks for {report.asked:+.2f} rad, {circle}; {now}"
    if abs(report.asked) > report.max_angle + 1e-6:
        text += (
            f"; its limit is {report.max_angle:.2f} rad, a radius of {report.turning_radius:.2f} m, so the base leaves the "
            "trajectory"
        )
    elif report.max_rate is not None and abs(report.asked - report.angle) > 1e-3:
        text += f", from where it turns at {report.max_rate:.3g} rad/s at most"
    return text
