"""Weights of distances and obstacle costs, which changed in 2018 (parity 31)."""

from __future__ import annotations

from typing import Literal

RosDistro = Literal["noetic", "indigo"]


def distance_weight(bias: float, resolution: float, distro: RosDistro) -> float:
    """Weight of a grid distance (cells): the bias per metre; half of that before 2018."""
    return resolution * bias * (0.5 if distro == "indigo" else 1.0)


def obstacle_weight(scale: float, resolution: float, distro: RosDistro) -> float:
    """Weight of a cost: `occdist_scale`; times the resolution before 2018."""
    return resolution * scale if distro == "indigo" else scale
