"""The velocity and acceleration limits of a local planner, independent of the names of its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from navstack.parameters.simulated_robot import sideways_speed

Limit = tuple[float, str]
"""A value (m/s, rad/s, m/s², rad/s²), and the parameter that sets it with its own value."""

VELOCITIES: Final = ("max_velocity", "min_velocity")

_NAMES: Final[Mapping[str, tuple[tuple[str, ...], ...]]] = {
    # list of the velocity smoother -> for x and yaw, the parameters of the planners
    "max_velocity": (
        ("max_vel_x", "vx_max", "max_linear_vel", "v_linear_max"),
        ("max_vel_theta", "wz_max", "v_angular_max", "rotate_to_heading_angular_vel"),
    ),
    "min_velocity": (("min_vel_x", "vx_min"), ()),
    "max_accel": (("acc_lim_x", "ax_max"), ("acc_lim_theta", "az_max", "max_angular_accel")),
    "max_decel": (("acc_lim_x", "ax_min"), ("acc_lim_theta", "az_max", "max_angular_decel", "max_angular_accel")),
}

_BOTH_WAYS: Final = frozenset({"acc_lim_x", "acc_lim_theta", "az_max", "max_angular_accel"})
"""Accelerations that also limit braking."""


@dataclass(frozen=True, slots=True)
class PlannerLimits:
    """The limits of a local planner."""

    name: str
    """Namespace of the planner."""
    params: Any

    def lists(self) -> dict[str, tuple[Limit | None, Limit | None, Limit | None]]:
        """Return the lists of the velocity smoother with the limits of the planner for x, y and yaw; None where it has none."""
        found: dict[str, tuple[Limit | None, Limit | None, Limit | None]] = {}
        for name, (x, yaw) in _NAMES.items():
            negative = name in ("min_velocity", "max_decel")
            found[name] = (self._first(x, negative), self._sideways(name), self._first(yaw, negative))
        turn = found["max_velocity"][2]
        x, y, _ = found["min_velocity"]
        found["min_velocity"] = (x, y, None if turn is None else (-turn[0], turn[1]))
        return found

    def _first(self, names: tuple[str, ...], negative: bool) -> Limit | None:
        for name in names:
            value = getattr(self.params, name, None)
            if value is None:
                continue
            if negative and name in _BOTH_WAYS:
                return (-float(value), f"{name} {value:g}")
            # a lowest velocity above 0 is no limit of driving backward
            return (float(value), f"{name} {value:g}") if negative == (float(value) < 0.0) else None
        return None

    def _sideways(self, name: str) -> Limit | None:
        if name not in VELOCITIES:
            return None
        speed, names = sideways_speed(self.params)
        written = [one for one in names if one in self.params.model_fields_set and getattr(self.params, one)]
        if speed == 0.0 or not written:
            return None
        return (speed if name == "max_velocity" else -speed, f"{written[0]} {getattr(self.params, written[0])}")
