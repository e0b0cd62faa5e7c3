"""The weights of path, goal and obstacles, which changed in 2018 (parity 31)."""

from __future__ import annotations

from typing import Literal

RosDistro = Literal["noetic", "indigo"]


def distance_scale(bias: float, resolution: float, distro: RosDistro) -> float:
    """Weight of a grid distance (cells): the bias per metre; before 2018 half of that."""
    return resolution * bias * (0.5 if distro == "indigo" else 1.0)


def obstacle_scale(scale: float, resolution: float, distro: RosDistro) -> float:
    """Weight of a cost: `occdist_scale`; before 2018 times the resolution."""
    return resolution * scale if distro == "indigo" else scale
