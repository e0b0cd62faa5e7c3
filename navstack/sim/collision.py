"""A collision of the simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

from navstack.core import Pose2D


@dataclass(frozen=True, slots=True)
class Collision:
    """The robot collided with an obstacle; counted once until the robot has left it."""

    time: float
    """Seconds."""
    pose: Pose2D
    """Pose of the robot in the map where it was stopped."""
    kind: str
    """`map`, `disc` or `polygon`."""
    index: int
    """Index of the cell (iy * nx + ix), of the disc or of the polygon."""
    at: tuple[float, float]
    """Centre of the obstacle in the map (m)."""
    name: str = ""
    """Name of the shape, if it has one."""
