"""The zones of a collision monitor: shape, debounce, and which points are inside."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint, Twist2D
from navstack.core.errors import InputError
from navstack.parameters.models.collision_monitor import SubPolygonParams, ZoneParams
from navstack.safety import _zone_kernels as kernels

Action = Literal["none", "stop", "slowdown", "limit", "approach"]
MOST_SHOWN: Final = 32
"""Number of triggering points that a decision keeps."""


class Shape:
    """A polygon in the base frame, or a circle around the base."""

    __slots__ = ("corners", "radius", "reach")

    def __init__(self, corners: NDArray[np.float64] | None = None, radius: float = 0.0) -> None:
        """Raises InputError for a polygon that crosses itself or has no area."""
        self.radius = radius
        if corners is None:
            self.corners: NDArray[np.float64] = np.empty((0, 2))
            self.reach = radius
            return
        polygon = shapely.Polygon(corners)
        if not polygon.is_valid or not polygon.area > 0.0:
            raise InputError("the polygon of a zone crosses itself or has no area; list its corners in order")
        # shapely.normalize would also change the first corner
        ring = np.array(corners, np.float64)
        self.corners = ring if polygon.exterior.is_ccw else ring[::-1].copy()
        self.reach = float(np.hypot(ring[:, 0], ring[:, 1]).max())

    @property
    def area(self) -> float:
        """Square metres."""
        return shapely.Polygon(self.corners).area if len(self.corners) else math.pi * self.radius**2

    def outline(self) -> NDArray[np.float64]:
        """Return corners (n, 2) for pictures."""
        if len(self.corners):
            return self.corners
        angles = np.linspace(0.0, 2.0 * math.pi, 49)[:-1]
        return self.radius * np.column_stack((np.cos(angles), np.sin(angles)))


class Zone:
    """A zone and its state from check to check."""

    def __init__(self, name: str, params: ZoneParams, sources: tuple[str, ...], footprint: Footprint | None) -> None:
        """`sources`: all sources of the monitor; `footprint`: the padded footprint, for zones that take it."""
        self.name = name
        self.params = params
        self.enabled = params.enabled
        self.sources = sources if params.sources_names is None else tuple(params.sources_names)
        self.least = params.least_points
        self.shape: Shape | None = None
        """None until a shape is known."""
        self._choices: list[tuple[SubPolygonParams, Shape]] = []
        self._hits = 0
        self._misses = 0
        self._active = False
        self._found = np.empty(MOST_SHOWN, np.int64)
        if params.type == "circle":
            self.shape = None if params.radius is None else Shape(radius=params.radius)
        elif params.type == "velocity_polygon":
            self._choices = [
                (sub, Shape(np.array(sub.corners, np.float64)))
                for name in params.velocity_polygons
                if (sub := params.sub_polygons.get(name)) is not None
            ]
        elif params.corners:
            self.shape = Shape(np.array(params.corners, np.float64))
        elif params.takes_footprint and footprint is not None:
            self.shape = Shape(footprint.vertices)

    @property
    def largest(self) -> Shape | None:
        """The largest polygon of a velocity polygon."""
        return max((shape for _, shape in self._choices), key=lambda shape: shape.area, default=None)

    def choose(self, command: Twist2D, *, largest: bool) -> bool:
        """Choose the polygon of a velocity polygon for a command; return False if none fits, so that the previous one stays.

        With `largest`, the largest polygon is used until one has fitted.
        """
        for sub, shape in self._choices:
            if _fits(sub, command, holonomic=self.params.holonomic):
                self.shape = shape
                return True
        if self.shape is None and largest:
            self.shape = self.largest
        return not self._choices

    def set_shape(self, shape: Shape) -> None:
        """Replace the shape. The debounce starts again."""
        self.shape = shape
        self.reset()

    def reset(self) -> None:
        """Reset the checks so far."""
        self._hits = self._misses = 0
        self._active = False

    def inside(self, points: NDArray[np.float64]) -> tuple[int, NDArray[np.int64]]:
        """Return the number of points (k, 2), base frame, inside, and the indices of the first `MOST_SHOWN` of them."""
        shape = self.shape
        assert shape is not None
        if len(self._found) < min(len(points), MOST_SHOWN):
            self._found = np.empty(MOST_SHOWN, np.int64)
        count = kernels.count_inside(points, shape.corners, shape.radius, shape.reach, self._found)
        return count, self._found[: min(count, MOST_SHOWN)].copy()

    def debounce(self, hit: bool) -> bool:
        """Count a check; return True while the zone acts: from the n-th hit in a row to the m-th miss in a row."""
        if hit:
            self._hits, self._misses = self._hits + 1, 0
            self._active = self._active or self._hits >= self.params.trigger_consecutive_points
        else:
            self._hits, self._misses = 0, self._misses + 1
            self._active = self._active and self._misses < self.params.release_consecutive_points
        return self._active


def _fits(sub: SubPolygonParams, command: Twist2D, *, holonomic: bool) -> bool:
    if not sub.theta_min <= command.wz <= sub.theta_max:
        return False
    if not holonomic:
        return sub.linear_min <= command.vx <= sub.linear_max
    if not sub.linear_min <= command.speed <= sub.linear_max:
        return False
    direction = math.atan2(command.vy, command.vx) if command.speed > 0.0 else 0.0
    start, end = sub.direction_start_angle, sub.direction_end_angle
    return start <= direction <= end if start <= end else not end < direction < start
