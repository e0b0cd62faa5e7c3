"""Beams that hit something nearer than a scanner can measure: which commands move the robot towards it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Transform2D, Twist2D
from navstack.safety import _beam_kernels as kernels
from navstack.safety.zones import Shape

_ROUND: Final = math.cos(math.pi / 16.0) - 1e-9
"""Inscribed over circumscribed radius from which on an outline is a circle: a regular 16-gon, as Footprint.from_radius."""


@dataclass(frozen=True, slots=True, eq=False)
class NearBeams:
    """The beams of a scan that hit something between the sensor and its lowest range."""

    sensor: NDArray[np.float64]
    """(2,) position of the sensor (m)."""
    directions: NDArray[np.float64]
    """(k, 2) unit vectors."""
    range_min: float
    """Lowest range of the sensor (m)."""
    what: str
    """How many beams of what are too near."""

    @property
    def ends(self) -> NDArray[np.float64]:
        """(k, 2) points of the beams at `range_min` (m)."""
        return self.sensor + self.range_min * self.directions

    def moved(self, transform: Transform2D) -> NearBeams:
        """Return the beams in the frame into which `transform` leads."""
        c, s = math.cos(transform.yaw), math.sin(transform.yaw)
        turned = self.directions @ np.array(((c, s), (-s, c)))
        return NearBeams(transform.apply_points(self.sensor[None])[0], turned, self.range_min, self.what)

    def towards(self, body: Shape, command: Twist2D) -> NDArray[np.float64]:
        """Return places (n, 2) of an obstacle on a beam to which a command moves the robot's outline; (0, 2) if there is none.

        The beams are in the base frame. The obstacle may be anywhere outside the outline up to `range_min`, or on the outline,
        if that is farther; the nearest place, the farthest one and the one between them count.
        """
        found = np.empty((1, 2))
        u = np.array(command, np.float64)
        index = kernels.beam_ahead(self.sensor, self.directions, self.range_min, body.corners, body.radius, u, found)
        return found[: 1 if index >= 0 else 0]


def body_shape(outline: NDArray[np.float64]) -> Shape:
    """Return the shape of a robot with an outline (n, 2): a circle if it is round, so that it can turn in place."""
    radii = np.hypot(outline[:, 0], outline[:, 1])
    polygon = Shape(outline)
    radius = float(radii.max())
    inscribed = kernels.inscribed_radius(polygon.corners)
    return Shape(radius=radius) if inscribed >= _ROUND * radius else polygon
